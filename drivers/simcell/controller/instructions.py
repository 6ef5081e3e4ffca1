"""Program instructions of VAL II, typed after DO: motion, gripper, configuration."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from drivers.arrays import Array
from drivers.puma560 import NEST_RAD, READY_RAD
from drivers.simcell.controller.commands import (
    Command,
    Verb,
    Wait,
    bare,
    come_to_rest,
    define,
    percent_of_full,
    print_input,
)
from drivers.simcell.controller.expressions import (
    ILLEGAL_VALUE,
    SYNTAX_ERROR,
    MonitorError,
    number,
    precision_point,
    split_arguments,
)
from drivers.simcell.controller.machine import Machine

MOST_PROGRAM_PERCENT = 300.0
Target = Callable[[Machine], Array]
"""Target of a motion, evaluated when it starts: HERE depends on the motion before."""


def _joint_move(machine: Machine, joints: Target, percent: float | None = None) -> Command:
    yield from _moved(machine, lambda: machine.move_joints(joints(machine), percent))


def _moved(machine: Machine, start: Callable[[], None]) -> Command:
    """Start a motion after the one before. Raises MonitorError without power or calibration."""
    yield from come_to_rest(machine)
    machine.check_ready()
    start()
    if machine.manners.prompt_after_move == "end":
        yield from come_to_rest(machine)


def _to_joints(joints_rad: Array) -> Verb:
    return bare(lambda machine: _joint_move(machine, lambda _: joints_rad))


def _to_pose(target: Callable[[str], Target]) -> Verb:
    """Joint-interpolated."""

    def verb(machine: Machine, arguments: str) -> Command:
        pose = target(arguments)
        return _joint_move(machine, lambda machine: machine.joints_for(pose(machine)))

    return verb


def _straight(target: Callable[[str], Target]) -> Verb:
    def verb(machine: Machine, arguments: str) -> Command:
        pose = target(arguments)
        return _moved(machine, lambda: machine.move_straight(pose(machine)))

    return verb


def _place(arguments: str) -> Target:
    return lambda machine: machine.place(arguments)


def _departed(arguments: str) -> Target:
    back = number(arguments)
    return lambda machine: _backed(machine.pose(), back * machine.manners.unit_mm)


def _approached(arguments: str) -> Target:
    parts = split_arguments(arguments)
    if len(parts) != 2:
        raise MonitorError(SYNTAX_ERROR)
    back = number(parts[1])
    return lambda machine: _backed(machine.place(parts[0]), back * machine.manners.unit_mm)


def _backed(pose: Array, back_mm: float) -> Array:
    """The pose moved by back_mm back along its own z."""
    backed = pose.copy()
    backed[:3, 3] -= back_mm * pose[:3, 2]
    return backed


def _move(machine: Machine, arguments: str) -> Command:
    def joints(machine: Machine) -> Array:
        precise = precision_point(arguments, machine.memory)
        return machine.joints_for(machine.place(arguments)) if precise is None else precise

    return _joint_move(machine, joints)


def _drive(machine: Machine, arguments: str) -> Command:
    parts = split_arguments(arguments)
    if len(parts) != 3:
        raise MonitorError(SYNTAX_ERROR)
    joint, change_deg, _ = (number(part) for part in parts)
    percent = percent_of_full(parts[2])
    if joint not in range(1, 7):
        raise MonitorError(ILLEGAL_VALUE)
    change = np.where(np.arange(1, 7) == joint, change_deg, 0.0)

    def target(machine: Machine) -> Array:
        manners = machine.manners
        return manners.joints_rad(manners.printed_deg(machine.joints()) + change)

    return _joint_move(machine, target, percent)


def _break(machine: Machine) -> Command:
    if not machine.manners.knows_break:
        raise MonitorError("*Illegal command*")
    return come_to_rest(machine)


def _set(machine: Machine, arguments: str) -> None:
    name, equals, value = (part.strip() for part in arguments.partition("="))
    if not equals or not value:
        raise MonitorError(SYNTAX_ERROR)
    define(machine, name, value)


def _hand(closed: bool) -> Verb:
    def act(machine: Machine) -> Command:
        yield from come_to_rest(machine)
        yield Wait(machine.now_s + machine.manners.hand_s)
        machine.hand(closed)

    return bare(act)


def _configure(**change: bool) -> Verb:
    def act(machine: Machine) -> None:
        machine.wanted = replace(machine.wanted, **change)

    return bare(act)


def _program_speed(machine: Machine, arguments: str) -> None:
    """SPEED n [ALWAYS] of a program, percent of the monitor's."""
    share, _, always = arguments.strip().partition(" ")
    percent = number(share)
    if always not in ("", "ALWAYS"):
        raise MonitorError(SYNTAX_ERROR)
    if not 0 < percent <= MOST_PROGRAM_PERCENT:
        raise MonitorError(ILLEGAL_VALUE)
    machine.program_speed(percent, bool(always))


def _signal(machine: Machine, arguments: str) -> None:
    """SIGNAL n, -m, ...: outputs on, and off."""
    values = [number(part) for part in split_arguments(arguments)]
    if any(not value or value != int(value) for value in values):
        raise MonitorError(ILLEGAL_VALUE)
    machine.signal([int(value) for value in values])


INSTRUCTIONS: dict[str, Verb] = {
    "ABOVE": _configure(above=True),
    "APPRO": _to_pose(_approached),
    "APPROS": _straight(_approached),
    "BELOW": _configure(above=False),
    "BRAKE": bare(Machine.halt),
    "BREAK": bare(_break),
    "CLOSEI": _hand(closed=True),
    "DEPART": _to_pose(_departed),
    "DEPARTS": _straight(_departed),
    "DRIVE": _drive,
    "FLIP": _configure(flip=True),
    "LEFTY": _configure(lefty=True),
    "MOVE": _move,
    "MOVES": _straight(_place),
    "NEST": _to_joints(NEST_RAD),
    "NOFLIP": _configure(flip=False),
    "OPENI": _hand(closed=False),
    "READY": _to_joints(READY_RAD),
    "RIGHTY": _configure(lefty=False),
    "SET": _set,
    "SIGNAL": _signal,
    "SPEED": _program_speed,
    "TYPE": print_input("TYPE"),
}
