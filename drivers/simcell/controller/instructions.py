"""What each program instruction of VAL II does when it is typed after DO: motion, hand, configuration. Generators as in
monitor.py; no bytes, no clock of their own.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from drivers.puma560 import NEST_RAD, READY_RAD, UnreachableError
from drivers.simcell.arm import SingularWristError
from drivers.simcell.controller.expressions import (
    ILLEGAL_VALUE,
    SYNTAX_ERROR,
    MonitorError,
    number,
    point_name,
    precision_point,
    split_arguments,
)
from drivers.simcell.controller.waits import Command, Wait
from drivers.simcell.controller.words import (
    FASTEST_PERCENT,
    Verb,
    come_to_rest,
    define,
    none,
    pose,
    set_speed,
    target_pose,
)

if TYPE_CHECKING:
    from drivers.simcell.controller.core import Controller

Array = NDArray[np.float64]


def _move(controller: Controller, arguments: str) -> Command:
    yield from _joint_move(controller, lambda: _joints_for(controller, arguments))


def _moves(controller: Controller, arguments: str) -> Command:
    yield from _straight_move(controller, lambda: target_pose(controller, arguments))


def _ready(controller: Controller, arguments: str) -> Command:
    none(arguments)
    yield from _joint_move(controller, lambda: READY_RAD)


def _nest(controller: Controller, arguments: str) -> Command:
    none(arguments)
    yield from _joint_move(controller, lambda: NEST_RAD)


def _drive(controller: Controller, arguments: str) -> Command:
    parts = split_arguments(arguments)
    if len(parts) != 3:
        raise MonitorError(SYNTAX_ERROR)
    joint, change_deg, percent = (number(part) for part in parts)
    if joint not in range(1, 7) or not 0 < percent <= FASTEST_PERCENT:
        raise MonitorError(ILLEGAL_VALUE)

    def target() -> Array:
        joints = controller.arm.joints_at(controller.now_s).copy()
        joints[int(joint) - 1] += np.radians(change_deg)
        return joints

    yield from _joint_move(controller, target, percent / 100)


def _depart(controller: Controller, arguments: str) -> Command:
    back_mm = number(arguments)
    yield from _joint_move(controller, lambda: _joints_at(controller, _backed(pose(controller), back_mm)))


def _departs(controller: Controller, arguments: str) -> Command:
    back_mm = number(arguments)
    yield from _straight_move(controller, lambda: _backed(pose(controller), back_mm))


def _appro(controller: Controller, arguments: str) -> Command:
    place, back_mm = _place_and_distance(arguments)
    yield from _joint_move(controller, lambda: _joints_at(controller, _backed(target_pose(controller, place), back_mm)))


def _appros(controller: Controller, arguments: str) -> Command:
    place, back_mm = _place_and_distance(arguments)
    yield from _straight_move(controller, lambda: _backed(target_pose(controller, place), back_mm))


def _set(controller: Controller, arguments: str) -> Command:
    name, equals, value = (part.strip() for part in arguments.partition("="))
    if not equals or not value:
        raise MonitorError(SYNTAX_ERROR)
    define(controller, point_name(name), value)
    yield from ()


def _break(controller: Controller, arguments: str) -> Command:
    none(arguments)
    yield from come_to_rest(controller)


def _brake(controller: Controller, arguments: str) -> Command:
    none(arguments)
    controller.arm.halt(controller.now_s)
    yield from ()


def _openi(controller: Controller, arguments: str) -> Command:
    none(arguments)
    yield from _hand(controller, closed=False)


def _closei(controller: Controller, arguments: str) -> Command:
    none(arguments)
    yield from _hand(controller, closed=True)


def _configure(**change: bool) -> Verb:
    def verb(controller: Controller, arguments: str) -> Command:
        none(arguments)
        controller.wanted = replace(controller.wanted, **change)
        yield from ()

    return verb


# What they share


def _hand(controller: Controller, closed: bool) -> Command:
    yield from come_to_rest(controller)
    yield Wait(controller.now_s + controller.manners.hand_s)
    controller.hand_closed = closed
    controller.on_hand(closed)


def _joint_move(controller: Controller, target: Callable[[], Array], speed: float | None = None) -> Command:
    yield from _wait_to_move(controller)
    share = controller.speed_percent / 100 if speed is None else speed
    _begin(controller, lambda: controller.arm.move_joints(target(), share, controller.now_s))
    yield from _after_start(controller)


def _straight_move(controller: Controller, target: Callable[[], Array]) -> Command:
    yield from _wait_to_move(controller)
    share = controller.speed_percent / 100
    _begin(controller, lambda: controller.arm.move_straight(target(), share, controller.now_s))
    yield from _after_start(controller)


def _wait_to_move(controller: Controller) -> Command:
    """One motion after the other; none without power and calibration."""
    yield from come_to_rest(controller)
    if not controller.arm_power:
        raise MonitorError("*Arm power off*")
    if not controller.calibrated:
        raise MonitorError("*Not calibrated*")
    if controller.faults.refusals:
        raise MonitorError(controller.faults.refusals.pop(0))


def _begin(controller: Controller, start: Callable[[], None]) -> None:
    try:
        start()
    except SingularWristError as error:
        raise MonitorError("*Wrist singularity*") from error
    except UnreachableError as error:
        message = "*Location out of range*" if error.joint is None else f"*Joint {error.joint} out of range*"
        raise MonitorError(message) from error
    controller.move_started()


def _after_start(controller: Controller) -> Command:
    if controller.manners.prompt_after_move == "end":
        yield from come_to_rest(controller)


def _joints_for(controller: Controller, text: str) -> Array:
    precise = precision_point(text, controller.memory)
    return precise if precise is not None else _joints_at(controller, target_pose(controller, text))


def _joints_at(controller: Controller, pose: Array) -> Array:
    return controller.arm.joints_for(pose, controller.wanted, controller.now_s)


def _backed(pose: Array, back_mm: float) -> Array:
    """The pose back_mm back along its own z."""
    backed = pose.copy()
    backed[:3, 3] -= back_mm * pose[:3, 2]
    return backed


def _place_and_distance(arguments: str) -> tuple[str, float]:
    parts = split_arguments(arguments)
    if len(parts) != 2:
        raise MonitorError(SYNTAX_ERROR)
    return parts[0], number(parts[1])


INSTRUCTIONS: dict[str, Verb] = {
    "ABOVE": _configure(above=True),
    "APPRO": _appro,
    "APPROS": _appros,
    "BELOW": _configure(above=False),
    "BRAKE": _brake,
    "BREAK": _break,
    "CLOSEI": _closei,
    "DEPART": _depart,
    "DEPARTS": _departs,
    "DRIVE": _drive,
    "FLIP": _configure(flip=True),
    "LEFTY": _configure(lefty=True),
    "MOVE": _move,
    "MOVES": _moves,
    "NEST": _nest,
    "NOFLIP": _configure(flip=False),
    "OPENI": _openi,
    "READY": _ready,
    "RIGHTY": _configure(lefty=False),
    "SET": _set,
    "SPEED": set_speed,
}
