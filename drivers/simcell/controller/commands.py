"""What a command is, and what monitor commands and instructions share.

A command is what a verb does with a machine: at once, or as a generator that yields a line to print, a moment it waits
for, or a question. No bytes; the line is core.py's.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping
from dataclasses import dataclass

from drivers.simcell.controller.expressions import (
    ILLEGAL_VALUE,
    SYNTAX_ERROR,
    MonitorError,
    number,
    point_name,
    precision_point,
)
from drivers.simcell.controller.machine import FULL_PERCENT, Machine


@dataclass(frozen=True)
class Wait:
    """A command waits for a moment."""

    until_s: float


@dataclass(frozen=True)
class Ask:
    """A command waits for an answer."""

    question: str


Command = Generator[str | Wait | Ask, str | None, None]
Verb = Callable[[Machine, str], Command | None]


def bare(act: Callable[[Machine], Command | None]) -> Verb:
    """The verb of what takes no arguments."""

    def verb(machine: Machine, arguments: str) -> Command | None:
        if arguments:
            raise MonitorError(SYNTAX_ERROR)
        return act(machine)

    return verb


def carry_out(machine: Machine, text: str, table: Mapping[str, Verb]) -> Command:
    """What a verb, or an unambiguous beginning of one, and its arguments ask for. Raises MonitorError."""
    word, _, arguments = text.partition(" ")
    begins = machine.manners.abbreviations
    meant = [word] if word in table else [name for name in table if begins and name.startswith(word)]
    if len(meant) != 1:
        raise MonitorError("*Ambiguous name*" if meant else "*Illegal command*")
    command = table[meant[0]](machine, arguments.strip())
    if command is not None:
        yield from command


def come_to_rest(machine: Machine) -> Command:
    """Nothing, until the arm is at rest."""
    while not machine.at_rest():
        yield Wait(machine.arm.rests_s)


def define(machine: Machine, name: str, value: str) -> None:
    """Give a location or, with a name that begins with #, a precision point its value. Raises MonitorError."""
    if not point_name(name).startswith("#"):
        machine.memory.transforms[name] = machine.place(value)
        return
    precise = precision_point(value, machine.memory)
    if precise is None:
        raise MonitorError(SYNTAX_ERROR)
    machine.memory.precision_points[name] = precise


def percent_of_full(text: str) -> float:
    """A speed. Raises MonitorError."""
    percent = number(text)
    if not 0 < percent <= FULL_PERCENT:
        raise MonitorError(ILLEGAL_VALUE)
    return percent


def set_speed(machine: Machine, arguments: str) -> None:
    """SPEED n."""
    machine.speed_percent = percent_of_full(arguments)
