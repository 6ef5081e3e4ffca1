"""Commands that only look: status, look, try, where, parts. Only `look around` moves the arm; none changes a model."""

import textwrap
import time
from typing import Any

import numpy as np

from daemon import VERSION
from daemon.arm import Fault
from daemon.commands.ascii_sketch import sketch
from daemon.commands.placing import counted, destinations, each_place
from daemon.commands.signals import signal_levels
from daemon.commands.step_mode import with_questions
from daemon.config import gripper_unknown
from daemon.console.context import CommandContext
from daemon.console.interpreter import RIGHTS, CommandResult, Frontend, command, number, one_of
from daemon.console.phrases import cut_off, duration, millimetres, plural
from daemon.console.text_layout import table
from daemon.errors import CommandError
from daemon.maintenance.doctor import remedy_of
from daemon.maintenance.journal import fault_line
from daemon.pick.find import describe_parts
from daemon.pick.looks import Look
from daemon.pick.transitions import SHOWN
from daemon.pick.world import WorldModel
from daemon.vision.geometry import Polyhedron
from daemon.vision.health import ADVICE, findings_json, troubles
from daemon.vision.model import facet_name
from daemon.vision.report import scene_json
from daemon.vision.values import Facet, Part, Scene

PLACES, MOST_PLACES = 3, 20
MARKS = "abcdefghijklmnopqrstuvwxyz"


@command("status [places]", at_once=True, first=True, most=1, choices=("places",))
async def status(context: CommandContext, words: list[str], frontend: Frontend) -> CommandResult:
    """Show the state of the cell, the running job, faults and troubles.

    status places   with `--json` also each place with its outline, as the dashboard draws it
    """
    if words:
        one_of(words, 0, ("places",), "word", status.usage)
    state = context.cycle.status()
    model, model_store = context.trainer.model, context.trainer.model_store
    in_use = "not accepted yet" if model_store.current is None else f"version {model_store.current}"
    up = duration(time.monotonic() - context.started_s)
    lines = [
        f"cell      {context.hardware.kind}; {_cell_state(state)}",
        f"doing     {_doing(context, state)}",
        f"model     {in_use}; knows {', '.join(model.labels)}"
        if model.labels
        else "model     none yet: `teach`, then `train`",
        f"so far    {_counted(state)}; up {up}; facetd {VERSION}",
        f"run       {context.run_log.folder}",
    ]
    pick_order = context.cycle.pick_order
    if pick_order is not None and not state["auto"]:
        lines.insert(2, f"auto      {cut_off(pick_order)}: `auto resume` continues it, `auto off` cancels it")
    candidate = frontend.shown = model_store.candidate
    if candidate is not None:
        lines.insert(3, f"candidate version {candidate}, not in use yet: `try`, then `accept`")
    if context.cycle.production_line.has_line:
        waits = "" if state["waits_for"] is None else f"; waits for {state['waits_for']}"
        lines.insert(-1, f"line      PackML state {state['packml']}{waits}")
    if context.config.values.grippers:
        lines.insert(-1, f"gripper   {context.config.gripper or gripper_unknown(context.config)}")
    places = counted(context)
    if places:
        places_text = ", ".join(f"{count} {status}" for status, count in sorted(places.items()))
        lines.insert(-1, f"places    {sum(places.values())}: {places_text}")
    left_out: Any = state["skipped"]
    lines += map(_skipped, left_out)
    lines += [f"TROUBLE   {text}" for text in context.troubles.active.values()]
    lines[1:1] = _to_do(state, context.cycle.supervisor.permission.fault)
    data: dict[str, Any] = {
        **state,
        "version": VERSION,
        "cell": context.hardware.kind,
        "seed": context.hardware.seed,
        "gripper": context.config.gripper,
        "mounting": "world" if context.calibration.fixed else "hand",
        "model": {"version": model_store.current, "labels": list(model.labels), "candidate": candidate},
        "troubles": dict(context.troubles.active),
        "places": places,
        **({"each_place": each_place(context)} if words else {}),
        "signals": signal_levels(context),
        "run": str(context.run_log.folder),
        "up_s": round(time.monotonic() - context.started_s, 1),
    }
    return CommandResult("\n".join(lines), data)


def _cell_state(state: dict[str, Any]) -> str:
    if state["fault"]:
        moves = "stopping: not confirmed at rest yet" if state.get("stopping") else "nothing moves until `resume`"
        return f"{fault_line(state['fault'], state['fault_code'])} ({moves})"
    typed_lines = state.get("by_hand_only")
    words = ["arm enabled" if state["enabled"] else "arm enabled for `robot` only" if typed_lines else "arm disabled"]
    words += [word for word in ("paused", "dry", "step") if state.get(word)]
    return ", ".join(words)


def _to_do(state: dict[str, Any], fault: Fault | None) -> list[str]:
    """What to do before `resume`, and about the gripper."""
    lines = []
    if fault is not None and (mend := remedy_of(fault.cause)):
        lines.append(f"to do     {mend}")
    if not state["doing"] and state["holding"] is None:
        lines.append("gripper   content unknown: report it by `holding yes` or `holding no`")
    if not state["doing"] and state["holding"]:
        lines.append("gripper   holds a part: the next pick first puts it into the bin")
    return lines


def _skipped(part: dict[str, Any]) -> str:
    """A part that the last pick or auto skipped, as a line."""
    x, y, z = part["at"]
    return f"skipped   {part['label']} at world x {x:.0f} y {y:.0f} z {z:.0f} mm: {part['why']}"


def _counted(state: dict[str, Any]) -> str:
    """Picks since the start, counted as tried by daemon/events/outcomes.py."""
    more = "".join(f", {state[key]} {key}" for key in ("released", "aborted") if state[key])
    return f"{state['picked']} of {state['tried']} picked{more}"


def _doing(context: CommandContext, state: dict[str, Any]) -> str:
    text = f"{state['doing'] or 'nothing'} ({SHOWN[state['state']]})"
    order = context.cycle.pick_order
    if state["auto"] and order is not None and order.count is not None:
        left_s = state["left_s"]
        text += f", {plural(order.count, 'part')} still to pick" + (f" of job {order.job}" if order.job else "")
        text += "" if left_s is None else f", about {duration(left_s)}"
    if state["target"]:
        text += f", {state['target']}, look {state['stop']}"
    if state["pending"]:
        text += f"; waits for `confirm` or `refuse`: {state['pending']}"
    if not state["doing"] and state["last"] and state["last"] != f"fault: {state['fault']}":
        text += f"; last: {state['last']}"
    return text


@command("look [around [N]]", "move", most=2, choices=("around",), first=True, looks=lambda words: not words)
async def look(context: CommandContext, words: list[str], frontend: Frontend) -> CommandResult:
    """Look once and show the result; nothing moves.

    Positions are in the camera frame, those of `look around` in the world frame.
    With one camera the arm moves that by 40 to 120 mm between two images, and back. Enable the arm first, and keep the
    gripper above the parts.
    look around   looks from here and from up to N more places (3), until everything is recognised and two more
                  sides show nothing new. Each look shows what is new. The arm stays where it looked last.
    """
    if words:
        one_of(words, 0, ("around",), "word", look.usage)
        most = number(words[1], "N", 1, MOST_PLACES) if len(words) > 1 else PLACES
        return around_result(await with_questions(context, context.cycle.look_around(most), frontend), frontend.columns)
    seen = await take_look(context, frontend, "look")
    lines = [describe_scene(seen.scene, frontend.columns), _timing(seen), *troubles(seen.health)]
    return CommandResult("\n".join(lines), look_json(seen))


def around_result(known: WorldModel, columns: int) -> CommandResult:
    """What each look of `look around` added, and the parts known at the end."""
    texts = [f"Look {n}, at {g.about}. Before: {g.before}. Now: {g.after}." for n, g in enumerate(known.gained, 2)]
    for part in known.found:
        x, y, z = part.centre
        name = f"{part.label} ({100 * part.recognition.confidence:.1f} %)" if part.named else "without a name"
        why = "" if part.named else f": {part.recognition.reason}"
        texts.append(f"{name} at world x {x:.0f} y {y:.0f} z {z:.0f} mm{why}")
    texts.append(f"{plural(len(known.looks), 'look')}: {describe_parts(known.found)}.")
    lines = [line for text in texts for line in textwrap.wrap(text, columns - 1, subsequent_indent="  ")]
    data = {"looks": len(known.looks), "gained": [vars(g) for g in known.gained]}
    parts = [{"label": p.label, "confidence": p.recognition.confidence, "at": p.centre.tolist()} for p in known.found]
    return CommandResult("\n".join(lines), {**data, "parts": parts}, 0 if all(p.named for p in known.found) else 1)


async def take_look(context: CommandContext, frontend: Frontend, purpose: str) -> Look:
    """Take a look. With one camera this moves the arm, which a read-only frontend may not. Raises CommandError."""
    if context.hardware.cameras.alone is not None and frontend.may == "look":
        raise CommandError(f"with one camera a look moves the arm, and this {frontend.name} is read-only ({RIGHTS})")
    return await with_questions(context, context.cycle.look(purpose), frontend)


@command("try")
async def try_now(context: CommandContext, words: list[str], frontend: Frontend) -> CommandResult:
    """Look once with the candidate model, or the one in use, and show the reasons."""
    candidate = frontend.shown = context.trainer.model_store.candidate
    recogniser = context.trainer.in_use if candidate is None else context.trainer.version(candidate)
    seen = await take_look(context, frontend, "try")
    scene = await context.worker(recogniser.see, *seen.taken.images, context.table_in(seen), seen.taken.rig)
    which = "the model in use" if candidate is None else f"candidate {candidate}"
    lines = [f"With {which}:"]
    for mark, part in zip(MARKS, scene.parts, strict=False):
        found = part.recognition
        lines.append(f"{mark} {describe_part(part)}")
        lines.append(f"    because: {found.reason}")
        lines.append(f"    runner-up {found.runner_up or 'none'}, activation {found.activation:.3f}")
    if not scene.parts:
        lines.append("no part is seen" + "".join(f"; {note}" for note in scene.notes))
    return CommandResult("\n".join(lines), {"with": which, **scene_json(scene)}, 0 if scene.parts else 1)


@command("where")
async def where(context: CommandContext, words: list[str], _: Frontend) -> CommandResult:
    """Show the position of the arm, as its controller reports it."""
    reading = await context.cycle.where()
    pose, joints = reading.world_from_tool, np.degrees(reading.joints_rad)
    x, y, z = pose[:3, 3]
    tilt = np.degrees(np.arccos(np.clip(-pose[2, 2], -1.0, 1.0)))
    lines = [
        f"world x {x:.2f}  y {y:.2f}  z {z:.2f} mm; tilted {tilt:.1f} degrees from straight down",
        "joints " + "  ".join(f"{angle:.2f}" for angle in joints) + " degrees",
    ]
    return CommandResult("\n".join(lines), {"world_from_tool": pose.tolist(), "joints_deg": joints.tolist()})


@command("parts")
async def parts(context: CommandContext, words: list[str], frontend: Frontend) -> CommandResult:
    """List the parts: their views, size, facets that a suction cup can take, and where they go."""
    views = context.trainer.model_store.views()
    rows, data = [], {}
    for label in context.parts:
        stored = sum(view.label == label for view in views)
        metric = context.trainer.model.metric.get(label)
        known = "not taught"
        if metric is not None:
            known = f"{plural(len(metric.solid.facets), 'facet')}, {metric.solid.size_mm:.0f} mm across"
        goes, taken = destinations(context, label), "" if metric is None else _grasped_by(context, metric.solid)
        rows.append((label, "; ".join(text for text in (f"{plural(stored, 'view')}, {known}", taken, goes) if text)))
        data[label] = {"views": stored, "taught": metric is not None, "goes": goes, "taken": taken or None}
    return CommandResult(
        table(rows, frontend.columns) or "no part is in parts.yaml and none is taught; `teach LABEL`", {"parts": data}
    )


def _grasped_by(context: CommandContext, solid: Polyhedron) -> str:
    """How the gripper grasps a part, as text."""
    pick = context.config.values.pick
    try:
        return pick.gripper.takes(solid, pick.stops.enough_mm)
    except ValueError as error:
        return f"no gripper takes it: {error}"


def describe_scene(scene: Scene, columns: int) -> str:
    """The result of a look for a terminal: a sketch of the left image, and a line or two a part."""
    outlines = [(facet.left_px, mark) for mark, part in zip(MARKS, scene.parts, strict=False) for facet in part.facets]
    lines = [sketch(outlines, columns)] if outlines else ["No part is seen."]
    for mark, part in zip(MARKS, scene.parts, strict=False):
        lines.append(f"{mark} {describe_part(part)}")
        if part.recognition.cause is not None:
            lines.append("    not named: {0.words}; {0.remedy}".format(ADVICE[part.recognition.cause]))
    reasons = {part.recognition.reason for part in scene.parts}
    lines += [f"  note: {note}" for note in scene.notes if not any(reason in note for reason in reasons)]
    return "\n".join(lines)


def describe_part(part: Part) -> str:
    """One part as text: name, confidence, position, facets."""
    found = part.recognition
    x, y, z = part.cyclopean_from_part[:3, 3]
    side, above = "right" if x > 0 else "left", "below" if y > 0 else "above"
    at = f"{z:.0f} mm from the camera, {abs(x):.0f} mm {side}, {abs(y):.0f} mm {above}"
    name = f"{found.label} ({100 * found.confidence:.1f} %)"
    if found.label == "unknown":
        name = "unknown" + (f", perhaps {' or '.join(found.candidates)}" if found.candidates else "")
    return f"{name}, {at}: {', '.join(describe_facet(facet) for facet in part.facets)}"


def describe_facet(facet: Facet) -> str:
    """One facet as text: square 50 50 50 50 mm."""
    sides = np.linalg.norm(facet.corners_mm - np.roll(facet.corners_mm, -1, axis=0), axis=1)
    return f"{facet_name(facet.type)} {millimetres(sides)}"


def look_json(seen: Look) -> dict[str, Any]:
    """A look as JSON values."""
    return {
        **scene_json(seen.scene),
        "world_from_cyclopean": seen.world_from_cyclopean.tolist(),
        "seconds": round(seen.seconds, 4),
        "settled_s": round(seen.taken.settled_s, 4),
        "from_light_s": round(seen.from_light_s, 4),
        "epipolar_px": None if np.isnan(seen.epipolar_px) else round(seen.epipolar_px, 4),
        "health": findings_json(seen.health),
    }


def _timing(seen: Look) -> str:
    stages = "  ".join(f"{name} {1000 * s:.0f} ms" for name, s in seen.scene.seconds.items())
    return (
        f"images steady after {1000 * seen.taken.settled_s:.0f} ms, exposure to result "
        f"{1000 * seen.from_light_s:.0f} ms, total {1000 * seen.seconds:.0f} ms ({stages})"
    )


COMMANDS = (status, look, try_now, where, parts)
