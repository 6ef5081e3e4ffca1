"""Commands that calibrate with the arm and a board: stereo, hand-eye, both, verify, and the touch test.

A result is stored beside earlier ones (daemon/store/calibrations.py) and taken into use at once; a failed calibration
changes nothing.
"""

import asyncio
from collections.abc import Callable
from dataclasses import asdict

import numpy as np

from daemon import frames
from daemon.calibration.arm_error import ArmError
from daemon.calibration.board import Board, BoardError, parse_board
from daemon.calibration.file import Calibration, calibration_text, load_calibration, same_geometry
from daemon.calibration.hand_eye import HandEyeError, HandEyeResult
from daemon.calibration.session import (
    BoardView,
    CalibrationSession,
    FurtherView,
    SessionError,
    VerificationResult,
    best_further_view,
    board_in_world,
    solve_camera,
    solve_hand_eye,
    solve_stereo,
    verify,
    view_tour,
    views_by_hand,
)
from daemon.calibration.stereo import StereoError, StereoResult
from daemon.cell import sections
from daemon.commands.step_mode import with_questions
from daemon.console.context import CommandContext
from daemon.console.interpreter import CommandResult, Frontend, command, no_more, one_of
from daemon.errors import NOT_DONE, NOT_UNDERSTOOD, CommandError, FacetdError
from daemon.pick.following import CameraMount, least_error, mount_of
from daemon.pick.pose_fusion import Doubt
from daemon.pick.settings import Settings
from daemon.quantities import decimal, whole
from daemon.store.calibrations import CONFIGURED

KINDS = ("stereo", "camera", "by-hand", "hand-eye", "verify", "touch")
STORED = ("list", "use")
USAGE = "calibrate stereo|camera|by-hand|hand-eye|verify|touch [CxR SQUARE_MM [charuco [legacy] [DICT]]] | list | use N"
POSES = {"stereo": 28, "camera": 28, "hand-eye": 16, "verify": 8, "touch": 0}
USUAL_BOARD = ("9x6", "16")
SPEED_PCT = 60.0
OVER_MM, TOUCH_ABOVE_MM = 60.0, 2.0
"""Heights of the finger tips above the corner: before the last move, which is straight and slow, and after it."""
WORTH_A_POSE = 0.95
"""A further pose is recommended where it leaves less than this share of the error."""
ARM_WORSE = 3.0
"""The arm counts as inaccurate where its error is this many times what the configuration says. The poses of a tour are
far apart and tilted; looks at one part are near each other, and an error that depends on the pose is alike in them."""


@command(USAGE, "move", most=None, choices=(*KINDS, *STORED), looks=lambda words: words[:1] == ["list"],
         further=lambda context, word: map(str, (CONFIGURED, *context.config.calibrations.numbers())) if word == "use"
         else ())  # fmt: skip
async def calibrate(context: CommandContext, words: list[str], frontend: Frontend) -> CommandResult:
    """Calibrate the cameras and the hand-eye, or verify them.

    stereo    both cameras and hand-eye, from a tour of 28 poses (about ten minutes on a real arm)
    camera    the same for a cell with one camera
    by-hand   both cameras, from a board that you hold; nothing moves, messages say which view is missing
    hand-eye  where the cameras are, on the arm or in the world, from a tour of 16 poses; nothing else changes
    verify    8 new poses: errors in mm and px, passed or failed
    touch     the gripper moves above a corner of the board; you type how far off it is
    list      the calibrations made here, and that of facetd.yaml (0); `use N` takes one into use
    First put the board flat where all of it is in view, and `enable` the arm. With fixed cameras (cameras.mounting:
    world) the gripper holds the board instead, in their view, except for `touch`. CxR: inner corners (9x6), SQUARE_MM:
    size of a square (16).
    """
    kind = one_of(words, 0, (*KINDS, *STORED), "kind of calibration", USAGE)
    if kind in STORED:
        return await _use(context, words, frontend) if kind == "use" else _list(context, words)
    _check_cameras(context, kind)
    if kind not in ("verify", "touch"):
        await asyncio.to_thread(context.config.calibrations.check)
    board = _board(words[1:])
    held = sections.mounting(context.config) == "world" and kind not in ("touch", "by-hand")
    hand = context.hardware.operator
    if hand is not None:
        hand.show_board(board.columns, board.rows, board.square_mm, board.kind == "charuco", held)
        await frontend.say(f"(simulated) The board is {'in the gripper' if held else 'placed on the table'}.")
    try:
        if kind == "by-hand":
            return await _by_hand(context, board, frontend)
        session = _session(context, board, held)
        tour = view_tour(session, POSES[kind], frontend.say, SPEED_PCT, mounting_alone=kind == "hand-eye")
        views = await with_questions(context, tour, frontend)
        if kind == "verify":
            return verification_result(verify(views, board, context.calibration))
        if kind == "touch":
            return await _touch(context, views[0], board, frontend)
        return await _solved(context, kind, views, session, frontend)
    except (SessionError, StereoError, HandEyeError, BoardError) as error:
        raise CommandError(f"calibrate {kind}: {error}") from None
    finally:
        if hand is not None:
            hand.put_back()
            if held:
                context.cycle.holding(False)


def _check_cameras(context: CommandContext, kind: str) -> None:
    """Check that the cameras in use are those to be calibrated. Raises CommandError."""
    one = sections.alone(context.config)
    if context.hardware.cameras.alone != one:
        raise CommandError(f"calibrate {kind}: only one camera is in use; repair the other, then `cameras both`")
    wrong = {"stereo": "camera", "by-hand": "camera"} if one else {"camera": "stereo"}
    if kind in wrong:
        cameras = "one camera" if one else "two cameras"
        raise CommandError(f"calibrate {kind}: this cell has {cameras}: `calibrate {wrong[kind]}`")
    if one == "right":
        raise CommandError("calibrate: name the only camera cameras.left in facetd.yaml")
    if one and kind != "camera" and context.calibration.alone is None:
        raise CommandError("calibrate: the calibration in use is for two cameras: `calibrate camera` first")


def _session(context: CommandContext, board: Board, held: bool = False) -> CalibrationSession:
    """A calibration session. held: the gripper holds the board; nothing moves before the cameras have seen it."""
    cycle = context.cycle
    prepare_to_move = cycle.supervisor.mover.wait_until_at_rest if held else cycle.prepare_to_move
    settling = cycle.settings.settling
    return CalibrationSession(cycle.supervisor, prepare_to_move, settling, board, context.calibration, held)


def _board(words: list[str]) -> Board:
    size, square, *rest = [*words, *USUAL_BOARD[len(words) :]] if len(words) < 2 else words
    try:
        return parse_board(size, decimal(square), rest)
    except (BoardError, ValueError) as error:
        raise CommandError(f"calibrate: {error}", NOT_UNDERSTOOD) from None


async def _solved(
    context: CommandContext, kind: str, views: list[BoardView], session: CalibrationSession, frontend: Frontend
) -> CommandResult:
    before = after = context.calibration
    board, reach = session.board, session.supervisor.mover.reach
    lines: list[str] = []
    data: dict[str, object] = {"poses": len(views)}
    if kind == "stereo":
        after, stereo = await context.study(solve_stereo, views, board, after)
        lines += _stereo_lines(stereo)
        data["stereo"] = {"rms_px": stereo.stereo_rms_px, "epipolar_px": stereo.epipolar_px, "sigmas": stereo.sigmas}
    if kind == "camera":
        after, camera = await context.study(solve_camera, views, board, after)
        lines += [f"not used: {name}: {reason}" for name, reason in camera.dropped.items()]
        focal = f"focal length {camera.camera.matrix[0, 0]:.2f} +- {camera.focal_sigma_px:.2f} px"
        lines.append(f"camera: residual {camera.rms_px:.3f} px rms, {focal}")
        data["camera"] = {"rms_px": camera.rms_px, "focal_sigma_px": camera.focal_sigma_px}
    # A new rig has a new cyclopean frame: a hand-eye of the old one would be wrong by their difference.
    after, hand_eye = await context.study(solve_hand_eye, views, board, after)
    further = await context.study(best_further_view, views, board, after, hand_eye.arm, reach)
    lines += [*_hand_eye_lines(hand_eye, further), arm_line(hand_eye.arm, context.config.values.pick.doubt)]
    data["hand_eye"] = {
        "sigma_mm": hand_eye.sigma_mm,
        "sigma_deg": hand_eye.sigma_deg,
        "diversity_deg": hand_eye.diversity_deg,
        "left_out_mm": list(hand_eye.left_out_mm),
        "arm_mm": hand_eye.arm.mm,
        "arm_deg": hand_eye.arm.deg,
        "warning": hand_eye.warning,
    }
    lines += [_change_of_hand_eye(before, after), *await _store_and_use(context, before, after, frontend.who)]
    lines += grasp_lines(mount_of(context.cycle.cell), context.cycle.settings)
    lines.append("Residuals are not accuracy. Measure accuracy from new poses: `calibrate verify`.")
    return CommandResult("\n".join(lines), data)


async def _by_hand(context: CommandContext, board: Board, frontend: Frontend) -> CommandResult:
    """Calibrate both cameras from a board that a person holds; no arm is needed."""
    views = await views_by_hand(_session(context, board), frontend.say)
    before = context.calibration
    after, stereo = await context.study(solve_stereo, views, board, before)
    lines = [*_stereo_lines(stereo), *await _store_and_use(context, before, after, frontend.who)]
    lines.append("Next: `calibrate hand-eye` (the common frame of the cameras has changed).")
    return CommandResult(
        "\n".join(lines), {"views": len(views), "rms_px": stereo.stereo_rms_px, "sigmas": stereo.sigmas}
    )


async def _store_and_use(context: CommandContext, before: Calibration, after: Calibration, who: str) -> list[str]:
    """Store the new calibration and take it into use. before: the calibration in use while it was solved."""
    calibrations = context.config.calibrations
    used, number = CONFIGURED, CONFIGURED

    async def change() -> Callable[[], None]:
        nonlocal used, number
        used, number = calibrations.current, await asyncio.to_thread(calibrations.keep, calibration_text(after))
        if not same_geometry(before, context.calibration):
            calibrations.use(used)
            raise CommandError(f"another calibration came into use meanwhile; `calibrate use {number}` uses this one")
        return lambda: calibrations.use(used)

    try:
        taken = await context.reload(who, change)
    except FacetdError as error:
        if number == CONFIGURED:
            raise
        raise CommandError(f"stored as calibration {number}, not in use: {error}") from None
    return [
        taken,
        f"Stored as calibration {number}, {calibrations.path(number)}; `calibrate use {used}` switches back.",
    ]


def _list(context: CommandContext, words: list[str]) -> CommandResult:
    no_more(words, 1, USAGE)
    calibrations = context.config.calibrations
    rows = [f"{'':>4}  {'written (UTC)':<16}"]
    for number in (CONFIGURED, *calibrations.numbers()):
        in_use = "in use" if number == calibrations.current else ""
        rows.append(f"{number:>4}  {calibrations.made(number)}  {in_use:<6}  {calibrations.path(number)}")
    return CommandResult("\n".join(rows), {"current": calibrations.current, "numbers": calibrations.numbers()})


async def _use(context: CommandContext, words: list[str], frontend: Frontend) -> CommandResult:
    no_more(words, 2, USAGE)
    calibrations = context.config.calibrations
    known = (CONFIGURED, *calibrations.numbers())
    word = one_of(words, 1, map(str, known), "calibration", USAGE)
    number = whole(word)
    load_calibration(calibrations.path(number))  # refuse one that cannot be used

    async def change() -> Callable[[], None]:
        before = calibrations.current
        calibrations.use(number)
        return lambda: calibrations.use(before)

    taken = await context.reload(frontend.who, change)
    return CommandResult(f"Calibration {word} is in use. {taken}", {"current": number})


def _stereo_lines(found: StereoResult) -> list[str]:
    rig, sigma = found.rig, found.sigmas
    lines = [f"not used: {name}: {reason}" for name, reason in found.dropped.items()]
    lines.append(f"cameras: residual {found.stereo_rms_px:.3f} px rms, {found.epipolar_px:.3f} px to the epipolar line")
    for name, camera in (("left", rig.left), ("right", rig.right)):
        lines.append(f"  {name:5} focal length {camera.matrix[0, 0]:.2f} +- {sigma[f'{name}.fx']:.2f} px")
    lines.append(f"  baseline {rig.baseline_mm:.3f} +- {sigma['baseline_mm']:.3f} mm")
    return lines


def _hand_eye_lines(result: HandEyeResult, further: FurtherView | None) -> list[str]:
    lines = [
        f"hand-eye: known to {result.sigma_mm:.2f} mm and {result.sigma_deg:.3f} degrees (one standard deviation)",
        f"  the arm turned {result.diversity_deg:.0f} degrees about its second axis; "
        f"a pose, predicted from the others, is off by {np.median(result.left_out_mm):.2f} mm, "
        f"at most {max(result.left_out_mm):.2f}",
    ]
    if further is not None:
        left = f"random error at a part: {further.before_mm:.2f} mm"
        helps = (
            f"one more pose helps most with the board {further.away_mm:.0f} mm away and tilted by "
            f"{further.tilt_deg:.0f} degrees: {further.after_mm:.2f} mm"
        )
        worth = further.after_mm < WORTH_A_POSE * further.before_mm
        lines.append(f"  {left}; {helps if worth else 'more poses would hardly help'}")
    return lines + ([f"  warning: {result.warning}"] if result.warning else [])


def grasp_lines(mount: CameraMount, settings: Settings) -> list[str]:
    """The error at a grasp that calibration and arm leave from each stand-off, and the error that a grasp allows."""
    stops = settings.stops
    least = [(mm, least_error(mount, mm, settings.doubt)) for mm in stops.stand_offs_mm]
    each = ", ".join(f"{err.predicted_mm:.2f} mm and {err.predicted_deg:.2f} deg from {mm:g} mm" for mm, err in least)
    lines = [
        f"Error at a grasp by calibration and arm alone: {each}. A grasp needs {stops.enough_mm:g} mm and "
        f"{stops.enough_deg:g} deg (pick.stops)."
    ]
    _, nearest = least[-1]
    if nearest.predicted_mm > stops.enough_mm or nearest.predicted_deg > stops.enough_deg:
        lines.append("No look can be accurate enough to grasp: calibrate again, with the board larger in view.")
    return lines


def arm_line(found: ArmError, configured: Doubt) -> str:
    """The measured accuracy of the arm, compared with the configured one."""
    text = f"arm accuracy: {found.mm:.2f} mm and {found.deg:.3f} degrees an axis (one standard deviation)"
    if found.mm <= ARM_WORSE * configured.arm_mm and found.deg <= ARM_WORSE * configured.arm_deg:
        return text
    here = f"pick: {{doubt: {{arm_mm: {found.mm:.2f}, arm_deg: {found.deg:.3f}}}}}"
    return (
        f"{text}; pick.doubt assumes {configured.arm_mm:g} and {configured.arm_deg:g}: "
        f"write `{here}` into facetd.yaml, or check the arm for wear"
    )


def _change_of_hand_eye(before: Calibration, after: Calibration) -> str:
    if before.hand_eye is None or after.hand_eye is None:
        return "This is the first hand-eye calibration."
    mm, turn = frames.size(frames.difference(after.hand_eye, before.hand_eye))
    return f"The hand-eye differs from the previous calibration by {mm:.2f} mm and {np.degrees(turn):.2f} degrees."


def verification_result(found: VerificationResult) -> CommandResult:
    """The errors of a verification as text. The first view, from where the arm was, is one of its poses."""
    lines = [
        f"From {found.poses - 1} new poses and the first one: lengths {found.length_mm:.2f} mm off "
        f"(scale {100 * found.scale_error:+.2f} %), {found.epipolar_px:.2f} px to the epipolar line, "
        f"the same corner is measured at positions {found.spread_mm:.2f} mm apart (hand-eye and arm together).",
        *(f"FAILED {failure}" for failure in found.failures),
    ]
    lines.append("PASSED" if found.passed else "Do not pick with this calibration.")
    return CommandResult("\n".join(lines), {**asdict(found), "passed": found.passed}, 0 if found.passed else NOT_DONE)


async def _touch(context: CommandContext, view: BoardView, board: Board, frontend: Frontend) -> CommandResult:
    """Move the closed gripper over the board's first corner; the operator types how far off it is."""
    world_from_board = board_in_world(view, board, context.calibration)
    heights_mm = frames.apply(world_from_board, board.points_mm())[:, 2]
    corner, table_mm = world_from_board[:3, 3], context.config.values.pick.limits.table_z_mm
    tip_mm = context.config.values.pick.gripper.tip_mm
    over, down = (
        frames.rigid(np.diag([-1.0, 1.0, -1.0]), corner + np.array([0.0, 0.0, tip_mm + above_mm]))
        for above_mm in (OVER_MM, TOUCH_ABOVE_MM)
    )
    purpose = f"touch test, {TOUCH_ABOVE_MM:g} mm above the corner"
    await with_questions(context, context.cycle.go_down(over, down, purpose), frontend)
    await frontend.say(f"The finger tips should be {TOUCH_ABOVE_MM:g} mm above the first inner corner of the board.")
    answer = await frontend.ask("How far off are they, along world x and y, in mm? (e.g. 0.5 -0.3) ")
    try:
        off = np.array([decimal(word) for word in answer.replace(",", " ").split()[:2]])
        if len(off) != 2:
            raise ValueError
    except ValueError:
        raise CommandError("expected two numbers, such as 0.5 -0.3; nothing was recorded", NOT_UNDERSTOOD) from None
    distance = float(np.linalg.norm(off))
    context.log.record("touch", off_mm=off.tolist(), distance_mm=distance, corner=corner.tolist())
    verdict = "good" if distance <= 1.0 else "do not pick: `calibrate hand-eye`, check arm.flange_from_tool"
    lines = [
        f"{distance:.2f} mm off: {verdict}.",
        f"The board's face is at z {heights_mm.min():.1f} to {heights_mm.max():.1f} mm; "
        f"pick.limits.table_z_mm is {table_mm:g}.",
    ]
    data = {"off_mm": off.tolist(), "board_z_mm": [heights_mm.min(), heights_mm.max()], "table_z_mm": table_mm}
    return CommandResult("\n".join(lines), data, 0 if distance <= 1.0 else NOT_DONE)


COMMANDS = (calibrate,)
