"""What each monitor command of VAL II does. A command is a generator: it yields what it waits for, prints through the
controller, and raises MonitorError with the message to print. No bytes, no clock of its own. DO is in instructions.py.
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from drivers.simcell.controller.expressions import (
    SYNTAX_ERROR,
    MonitorError,
    location,
    numbers,
    point_name,
)
from drivers.simcell.controller.instructions import INSTRUCTIONS
from drivers.simcell.controller.waits import Ask, Command, Wait
from drivers.simcell.controller.words import Verb, come_to_rest, define, none, pose, set_speed, tidy, verb_for
from drivers.val2.location import Location, location_from_matrix, matrix_from_location

if TYPE_CHECKING:
    from drivers.simcell.controller.core import Controller

LOCATION_HEADER = "".join(f"{name:>10}" for name in "XYZOAT")
JOINT_HEADER = "".join(f"{'JT' + str(k):>10}" for k in range(1, 7))


def run(controller: Controller, text: str) -> Command:
    """The command of a typed line; an empty line is none."""
    words = text.strip().upper().split(None, 1)
    if words:
        yield from verb_for(words[0], MONITOR_COMMANDS)(controller, words[1].strip() if len(words) > 1 else "")


def is_abort(text: str) -> bool:
    """Whether a line is ABORT, abbreviated or not."""
    word = text.strip().upper()
    return len(word) >= 2 and "ABORT".startswith(word)


def power_up(controller: Controller) -> Command:
    """The dialogue before the first prompt."""
    controller.say("VAL II simulated controller, PUMA 560")
    yield from _yes(controller, "Load VAL-II from floppy (Y/N)?")
    yield from _yes(controller, "Initialize (Y/N)?")


def _yes(controller: Controller, question: str) -> Generator[Wait | Ask, str | None, bool]:
    """Ask until the answer begins with Y or N."""
    while True:
        answer = ((yield Ask(question)) or "").strip().upper()
        if answer[:1] in ("Y", "N"):
            return answer[0] == "Y"


# Monitor commands


def _do(controller: Controller, arguments: str) -> Command:
    words = arguments.split(None, 1)
    if not words:
        raise MonitorError(SYNTAX_ERROR)
    yield from verb_for(words[0], INSTRUCTIONS)(controller, words[1].strip() if len(words) > 1 else "")


def _where(controller: Controller, arguments: str) -> Command:
    none(arguments)
    joints = controller.arm.joints_at(controller.now_s)
    here = location_from_matrix(controller.arm.reported_pose_at(controller.now_s)).values()
    controller.say(LOCATION_HEADER)
    controller.say("".join(f"{tidy(value, 2 if k < 3 else 3):>10}" for k, value in enumerate(here)))
    controller.say(JOINT_HEADER)
    controller.say("".join(f"{tidy(value, 3):>10}" for value in np.degrees(joints)))
    yield from ()


def _calibrate(controller: Controller, arguments: str) -> Command:
    none(arguments)
    if not (yield from _yes(controller, "Are you sure (Y/N)?")):
        return
    if not controller.arm_power:
        controller.arm_power_was_missing()
        raise MonitorError("*Arm power off*")
    yield Wait(controller.now_s + controller.faults.pendant_s)
    yield Wait(controller.now_s + controller.manners.calibration_s)
    controller.calibrated = True


def _abort(controller: Controller, arguments: str) -> Command:
    none(arguments)
    controller.arm.halt(controller.now_s)
    yield from come_to_rest(controller)


def _point(controller: Controller, arguments: str) -> Command:
    name, _, value = (part.strip() for part in arguments.partition("="))
    point_name(name)
    if value:
        define(controller, name, value)
        return
    is_precise = name.startswith("#")
    memory = controller.memory
    known = memory.precision_points.get(name) if is_precise else memory.transforms.get(name)
    values = [0.0] * 6
    if known is not None:
        values = list(np.degrees(known)) if is_precise else list(location_from_matrix(known).values())
    defined = known is not None
    while True:
        controller.say(JOINT_HEADER if is_precise else LOCATION_HEADER)
        controller.say("".join(f"{tidy(v, 3):>10}" for v in values))
        answer = ((yield Ask("Change?")) or "").strip()
        if not answer:
            break
        values = numbers(answer, 6, dict(enumerate(values)))
        defined = True
    if defined and is_precise:
        memory.precision_points[name] = np.radians(values)
    elif defined:
        memory.transforms[name] = matrix_from_location(Location(*values))


def _here(controller: Controller, arguments: str) -> Command:
    name = point_name(arguments)
    if name.startswith("#"):
        controller.memory.precision_points[name] = controller.arm.joints_at(controller.now_s)
    else:
        controller.memory.transforms[name] = pose(controller)
    yield from ()


def _list_locations(controller: Controller, arguments: str) -> Command:
    none(arguments)
    controller.say(LOCATION_HEADER + "   /" + JOINT_HEADER)
    for name, place in sorted(controller.memory.transforms.items()):
        controller.say(f"{name:<10}" + "".join(f"{tidy(v, 3):>10}" for v in location_from_matrix(place).values()))
    for name, joints in sorted(controller.memory.precision_points.items()):
        controller.say(f"{name:<10}" + "".join(f"{tidy(v, 3):>10}" for v in np.degrees(joints)))
    yield from ()


def _tool(controller: Controller, arguments: str) -> Command:
    yield from come_to_rest(controller)
    controller.arm.tool = location(arguments, controller.memory, pose(controller)) if arguments else np.eye(4)


def _base(controller: Controller, arguments: str) -> Command:
    """BASE dx, dy, dz, rotation: how the base stands in the world."""
    yield from come_to_rest(controller)
    x, y, z, turn_deg = numbers(arguments, 4)
    c, s = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
    base = np.array([[c, -s, 0, x], [s, c, 0, y], [0, 0, 1, z], [0, 0, 0, 1.0]])
    controller.arm.geometry = replace(controller.arm.geometry, world_from_base=base)


def _status(controller: Controller, arguments: str) -> Command:
    none(arguments)
    controller.say(f"Monitor speed {controller.speed_percent:.1f}")
    controller.say(f"Arm power {'on' if controller.arm_power else 'off'}")
    controller.say("Calibrated" if controller.calibrated else "Not calibrated")
    controller.say("No program running")
    yield from ()


def _execute(controller: Controller, arguments: str) -> Command:
    """No programs are kept here, so there is none to run."""
    yield from ()
    raise MonitorError("*Undefined program*" if arguments else SYNTAX_ERROR)


MONITOR_COMMANDS: dict[str, Verb] = {
    "ABORT": _abort,
    "BASE": _base,
    "CALIBRATE": _calibrate,
    "DO": _do,
    "EXECUTE": _execute,
    "HERE": _here,
    "LISTL": _list_locations,
    "POINT": _point,
    "SPEED": set_speed,
    "STATUS": _status,
    "TOOL": _tool,
    "WHERE": _where,
}
