"""Command `cameras`, and the question about the cameras after a camera fault. Nothing here moves the arm."""

from daemon.arm import CAMERA_NAMES, CameraName, Fault
from daemon.cell.camera_trial import camera_faults, pair_fault, shutters, unsteady
from daemon.console.context import CommandContext
from daemon.console.interpreter import CommandResult, Frontend, command, no_more, one_of, yes_or_no
from daemon.errors import CommandError
from daemon.events.codes import CauseCode, FaultCause

WORDS = ("left", "right", "both", "moving")
USAGE = "cameras [left|right|both|moving]"
OTHER: dict[CameraName, CameraName] = {"left": "right", "right": "left"}
COST = "each look takes two images with a move of 40 to 120 mm between them; a pick takes about a third longer"
UNMEASURED = "not measured: too little moved in view; repeat, with a newspaper that fills the view"
CAMERA_SOURCES = ("CameraError", "VisionError", "MisleadingImagesError", "cameras")
"""Sources of faults that a camera may have caused."""
PERHAPS_KNOCKED = (CauseCode.CAMERA_KNOCKED, CauseCode.LOOKS_DISAGREE)


@command(USAGE, "move", most=1, choices=WORDS, looks=lambda words: words in ([], ["moving"]))
async def cameras(context: CommandContext, words: list[str], frontend: Frontend) -> CommandResult:
    """Choose the cameras in use: both, or one alone.

    left, right   that camera alone, when the other is missing, dark or frozen; the arm moves it between two images
    both          both again, after a test that they still agree with the calibration
    moving        test for a rolling shutter: you move a newspaper to and fro before the cameras
    Without a word facetd tests both cameras, also whether they hold exposure and focus; nothing moves.
    """
    if not words:
        return await _show(context)
    word = one_of(words, 0, WORDS, "word", USAGE)
    no_more(words, 1, USAGE)
    if word == "moving":
        return await _shutters(context, frontend)
    if context.hardware.kind == "recorded" or context.calibration.alone is not None:
        raise CommandError("this cell (recorded, or with one camera) always uses the same cameras")
    if word != "both" and context.calibration.fixed:
        raise CommandError(f"cameras {word}: one fixed camera alone cannot measure distances")
    if word == "both":
        hardware, supervisor = context.hardware, context.cycle.supervisor
        trial = pair_fault(hardware.cameras, context.calibration.rig, hardware.clock)
        wrong = await supervisor.run("test both cameras", trial, moves=False)
        if wrong is not None:
            raise CommandError(f"both cameras cannot be used yet: {wrong}")
        await context.look_with(None, "both cameras agree with the calibration")
        return CommandResult("Using both cameras.", {"alone": None})
    alone: CameraName = "left" if word == "left" else "right"
    wrong = (await _camera_problems(context)).get(alone)
    if wrong is not None:
        raise CommandError(f"the {alone} camera cannot be used: {wrong}")
    await context.look_with(alone, "chosen by an operator")
    context.one_camera_allowed = True
    return CommandResult(f"Using the {alone} camera alone: {COST}. `cameras both` switches back.", {"alone": alone})


async def _show(context: CommandContext) -> CommandResult:
    wrong: dict[CameraName, str] = {} if context.calibration.alone is not None else await _camera_problems(context)
    used = context.hardware.cameras.alone
    lines = ["Using both cameras." if used is None else f"Using the {used} camera alone."]
    lines += [f"{camera} camera: {why}" for camera, why in wrong.items()]
    not_held: dict[CameraName, list[str]] = {}
    if not wrong and context.hardware.kind != "recorded":
        trial = unsteady(context.hardware.cameras, context.hardware.clock)
        not_held = await context.cycle.supervisor.run("look at a still scene", trial, moves=False)
        context.not_held = {camera: tuple(whys) for camera, whys in not_held.items()}
        lines += [f"{camera} camera: {why}" for camera, whys in not_held.items() for why in whys]
        lines += [] if not_held else ["Exposure and focus are held before a still scene."]
    return CommandResult("\n".join(lines), {"alone": used, "wrong": dict(wrong), "not_held": not_held})


async def _shutters(context: CommandContext, frontend: Frontend) -> CommandResult:
    """Measure how each camera reads out its rows. Nothing moves the arm: a person moves what is seen."""
    if context.hardware.kind == "recorded":
        raise CommandError("a shutter cannot be measured on recorded pictures")
    asked = "Move a newspaper that fills the view to and fro, about once a second, until the answer comes. Start? [y/n]"
    if frontend.asks and not await yes_or_no(frontend, asked):
        raise CommandError("cancelled; nothing was measured")
    trial = shutters(context.hardware.cameras, context.hardware.clock)
    found = await context.cycle.supervisor.run("look at a moving scene", trial, moves=False)
    context.shutters = {**(context.shutters or {}), **found}
    used = [camera for camera in CAMERA_NAMES if context.hardware.cameras.alone in (None, camera)]
    lines = [f"{camera} camera: {found.get(camera, UNMEASURED)}" for camera in used]
    return CommandResult("\n".join(lines), {"shutters": dict(found)})


async def _camera_problems(context: CommandContext) -> dict[CameraName, str]:
    """Test each camera, while nothing else looks or moves; returns the problem by camera. Raises RefusedError."""
    trial = camera_faults(context.hardware.cameras, context.hardware.clock)
    return await context.cycle.supervisor.run("test the cameras", trial, moves=False)


async def remaining_camera(context: CommandContext, cause: FaultCause) -> tuple[CameraName, str] | None:
    """The camera that still works after a fault of the other, and that one's problem; else None."""
    hardware = context.hardware
    if (
        cause.source not in CAMERA_SOURCES
        or hardware.kind == "recorded"
        or hardware.cameras.alone is not None
        or context.calibration.fixed
    ):
        return None
    wrong = await _camera_problems(context)
    if len(wrong) != 1:
        return None
    lost, why = next(iter(wrong.items()))
    return OTHER[lost], why


async def offer_one_camera(context: CommandContext, fault: Fault, frontend: Frontend) -> str | None:
    """Ask whether to continue with the camera that still works; returns a message. Raises CommandError on a no."""
    cause = fault.cause
    left = await remaining_camera(context, cause)
    if left is None:
        both = context.hardware.cameras.alone is None and not context.calibration.fixed
        knocked = both and cause.code in PERHAPS_KNOCKED
        return "If one camera was knocked, use the other: `cameras left` or `cameras right`." if knocked else None
    alone, why = left
    problem = f"The {OTHER[alone]} camera does not work: {why}. The {alone} camera works; {COST}."
    if not frontend.asks:
        return f"{problem} `cameras {alone}` uses it."
    if not await yes_or_no(frontend, f"{problem} Use the {alone} camera alone? [y/n]"):
        raise CommandError(f"The fault is not cleared: {fault}. Repair the {OTHER[alone]} camera, then `resume`.")
    await context.look_with(alone, f"{OTHER[alone]} camera: {why}")
    context.one_camera_allowed = True
    return f"Using the {alone} camera alone. Once the {OTHER[alone]} camera is repaired: `cameras both`."


COMMANDS = (cameras,)
