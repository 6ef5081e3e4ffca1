"""What monitor commands and instructions share: finding a verb, the arm's pose, naming locations, printing numbers."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from drivers.simcell.controller.expressions import (
    ILLEGAL_VALUE,
    SYNTAX_ERROR,
    MonitorError,
    location,
    number,
    precision_point,
)
from drivers.simcell.controller.waits import Command, Wait

if TYPE_CHECKING:
    from drivers.simcell.controller.core import Controller

Array = NDArray[np.float64]

Verb = Callable[["Controller", str], Command]
FASTEST_PERCENT = 100.0


def none(arguments: str) -> None:
    if arguments:
        raise MonitorError(SYNTAX_ERROR)


def verb_for(word: str, table: dict[str, Verb]) -> Verb:
    """The table's entry for a word or an unambiguous beginning of one."""
    if word in table:
        return table[word]
    meant = [name for name in table if name.startswith(word)]
    if len(meant) == 1:
        return table[meant[0]]
    raise MonitorError("*Ambiguous name*" if meant else "*Illegal command*")


def pose(controller: Controller) -> Array:
    return controller.arm.reported_pose_at(controller.now_s)


def target_pose(controller: Controller, text: str) -> Array:
    return location(text, controller.memory, pose(controller))


def define(controller: Controller, name: str, value: str) -> None:
    if not name.startswith("#"):
        controller.memory.transforms[name] = target_pose(controller, value)
        return
    precise = precision_point(value, controller.memory)
    if precise is None:
        raise MonitorError(SYNTAX_ERROR)
    controller.memory.precision_points[name] = precise


def tidy(value: float, decimals: int) -> str:
    """Without the minus of a negative zero."""
    return f"{round(float(value), decimals) + 0.0:.{decimals}f}"


def set_speed(controller: Controller, arguments: str) -> Command:
    percent = number(arguments)
    if not 0 < percent <= FASTEST_PERCENT:
        raise MonitorError(ILLEGAL_VALUE)
    controller.speed_percent = percent
    yield from ()


def come_to_rest(controller: Controller) -> Command:
    """Nothing, until the arm is at rest."""
    while not controller.arm.at_rest(controller.now_s):
        yield Wait(controller.arm.rests_s)
