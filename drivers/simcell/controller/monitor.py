"""Monitor commands of VAL II. instructions.py has those typed after DO."""

import re
from collections.abc import Generator, Iterable
from dataclasses import replace

import numpy as np

from drivers.arrays import Array
from drivers.rigid import rigid, turn
from drivers.simcell.controller.commands import (
    Ask,
    Command,
    Verb,
    Wait,
    bare,
    carry_out,
    come_to_rest,
    define,
    print_input,
    set_speed,
)
from drivers.simcell.controller.expressions import SYNTAX_ERROR, MonitorError, numbers, point_name
from drivers.simcell.controller.instructions import INSTRUCTIONS
from drivers.simcell.controller.machine import Machine
from drivers.simcell.controller.manners import Manners
from drivers.val2.location import Location, location_from_matrix, matrix_from_location

LOCATION_HEADER = "".join(f"{name:>10}" for name in "XYZOAT")
HAND_OPEN_MM = 90.0
LEADING_ZERO = re.compile(r"(^|[ ])(-?)0\.")
TRAILING_ZEROS = re.compile(r"(\.\d*[1-9])?((?(1)|\.)0+)(?=[ ]|$)")
JOINT_HEADER = "".join(f"{'JT' + str(k):>10}" for k in range(1, 7))


def run(machine: Machine, text: str) -> Command:
    """Run the command of a typed line; an empty line does nothing. Raises MonitorError."""
    if machine.manners.upper_only and text != text.upper():
        raise MonitorError("*Illegal command*")
    line = " ".join(text.upper().split(None, 1))
    if line:
        yield from carry_out(machine, line, MONITOR_COMMANDS)


def stops(text: str, manners: Manners) -> bool:
    """Whether a line brakes the arm at once."""
    return means(text, "ABORT" if manners.stops_at_once else "PANIC", manners)


def means(text: str, word: str, manners: Manners) -> bool:
    """Whether a typed line is the word, abbreviated or not."""
    typed = text.strip() if manners.upper_only else text.strip().upper()
    return typed == word or (manners.abbreviations and len(typed) >= 2 and word.startswith(typed))


def power_up(questions: Iterable[str]) -> Command:
    """The dialogue before the first prompt."""
    yield "VAL II simulated controller, PUMA"
    for question in questions:
        yield from _yes(question)


def _yes(question: str) -> Generator[Ask, str | None, bool]:
    """Ask until the answer begins with Y or N."""
    while True:
        answer = ((yield Ask(question)) or "").strip().upper()
        if answer[:1] in ("Y", "N"):
            return answer[0] == "Y"


def _row(values: Iterable[float], decimals: Iterable[int] = (3,) * 6) -> str:
    """Numbers in columns, without a negative zero."""
    pairs = zip(values, decimals, strict=True)
    return "".join(f"{f'{round(float(value), places) + 0.0:.{places}f}':>10}" for value, places in pairs)


# Monitor commands


def _do(machine: Machine, arguments: str) -> Command:
    if not arguments:
        raise MonitorError(SYNTAX_ERROR)
    return carry_out(machine, " ".join(arguments.split(None, 1)), INSTRUCTIONS)


def _where(machine: Machine) -> Command:
    if machine.faults.repeated_places and machine.printed_place:
        machine.faults.repeated_places -= 1
    else:
        machine.printed_place = _place(machine)
    yield from machine.printed_place


def _place(machine: Machine) -> list[str]:
    manners = machine.manners
    mm, degrees = manners.decimals
    x, y, z, *angles = location_from_matrix(machine.pose()).values()
    lengths = (value / manners.unit_mm for value in (x, y, z))
    place = _row((*lengths, *angles), (mm, mm, mm, degrees, degrees, degrees))
    joints = _row(manners.printed_deg(machine.joints()), (degrees,) * 6)
    if manners.where == "one header":
        heads = [f"{one}/JT{k}" for k, one in enumerate("XYZOAT", 1)] + ["HAND"] * manners.hand_column
        hand = f"{0.0 if machine.hand_closed else HAND_OPEN_MM:>10.{mm}f}" if manners.hand_column else ""
        lines = ["".join(f"{head:>10}" for head in heads), place + hand, joints]
    else:
        lines = [LOCATION_HEADER, place, JOINT_HEADER, joints]
    return [_printed(line, manners) for line in lines]


def _printed(line: str, manners: Manners) -> str:
    """Apply the variant's number format; the columns stay."""
    if not manners.trailing_zeros:
        line = TRAILING_ZEROS.sub(lambda found: (found[1] or "") + " " * len(found[2]), line)
    return line if manners.leading_zero else LEADING_ZERO.sub(r"\1 \2.", line)


def _calibrate(machine: Machine) -> Command:
    if not (yield from _yes("Are you sure (Y/N)?")):
        return
    if not machine.arm_power:
        machine.miss_arm_power()
        raise MonitorError("*Arm power off*")
    yield Wait(machine.now_s + machine.faults.pendant_s)
    yield Wait(machine.calibrate())
    machine.calibrated = True


def _abort(machine: Machine) -> Command:
    if machine.manners.stops_at_once:
        machine.stop(machine.by, machine.by_others)
    return come_to_rest(machine)


def _panic(machine: Machine) -> Command:
    if machine.manners.stops_at_once:
        raise MonitorError("*Illegal command*")
    machine.stop(machine.by, machine.by_others)
    return come_to_rest(machine)


def _point(machine: Machine, arguments: str) -> Command | None:
    name, _, value = (part.strip() for part in arguments.partition("="))
    point_name(name)
    if not value:
        return _typed_point(machine, name)
    define(machine, name, value)
    return None


def _typed_point(machine: Machine, name: str) -> Command:
    """Show a location and take changes until an empty line."""
    precise, places = name.startswith("#"), machine.memory.named(name)
    typed: list[float] = []
    if name in places:
        typed = list(np.degrees(places[name]) if precise else location_from_matrix(places[name]).values())
    while True:
        yield JOINT_HEADER if precise else LOCATION_HEADER
        yield _row(typed or [0.0] * 6)
        answer = ((yield Ask("Change?")) or "").strip()
        if not answer:
            break
        typed = numbers(answer, 6, dict(enumerate(typed)))
    if typed:
        places[name] = np.radians(typed) if precise else matrix_from_location(Location(*typed))


def _here(machine: Machine, arguments: str) -> None:
    name = point_name(arguments)
    machine.memory.named(name)[name] = machine.joints() if name.startswith("#") else machine.pose()


def _list_locations(machine: Machine) -> Command:
    yield LOCATION_HEADER + "   /" + JOINT_HEADER
    for name, place in sorted(machine.memory.transforms.items()):
        yield f"{name:<10}" + _row(location_from_matrix(place).values())
    for name, joints in sorted(machine.memory.precision_points.items()):
        yield f"{name:<10}" + _row(np.degrees(joints))


def _tool(machine: Machine, arguments: str) -> Command:
    yield from come_to_rest(machine)
    machine.arm.tool = machine.place(arguments) if arguments else np.eye(4)


def _base(machine: Machine, arguments: str) -> Command:
    """BASE dx, dy, dz, rotation: pose of the base in the world."""
    yield from come_to_rest(machine)
    x, y, z, turn_deg = numbers(arguments, 4)
    base: Array = rigid(turn([0, 0, 1], np.radians(turn_deg)), [x, y, z])
    machine.arm.geometry = replace(machine.arm.geometry, world_from_base=base)


def _status(machine: Machine) -> Command:
    yield f"Monitor speed {machine.speed_percent:.1f}"
    yield f"Arm power {'on' if machine.arm_power else 'off'}"
    yield "Calibrated" if machine.calibrated else "Not calibrated"
    yield "No program running"


def _execute(machine: Machine, arguments: str) -> Command:
    """EXECUTE program: its instructions one after the other, then the prompt."""
    if not arguments:
        raise MonitorError(SYNTAX_ERROR)
    instructions = machine.memory.programs.get(arguments)
    if instructions is None:
        raise MonitorError("*Undefined program*")
    for instruction in instructions:
        yield from _do(machine, instruction)
    yield from come_to_rest(machine)
    yield f"Program completed: Stopped at step {len(instructions) + 1}"


MONITOR_COMMANDS: dict[str, Verb] = {
    "ABORT": bare(_abort),
    "BASE": _base,
    "CALIBRATE": bare(_calibrate),
    "DO": _do,
    "EXECUTE": _execute,
    "HERE": _here,
    "LISTL": bare(_list_locations),
    "LISTR": print_input("LISTR"),
    "PANIC": bare(_panic),
    "POINT": _point,
    "SPEED": set_speed,
    "STATUS": bare(_status),
    "TOOL": _tool,
    "WHERE": bare(_where),
}
