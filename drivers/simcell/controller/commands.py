"""Commands of the simulated controller: their type, and what monitor commands and instructions share.

A verb acts on a machine at once, or returns a generator that yields lines to print, waits, and questions.
"""

import re
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
    """A verb without arguments."""

    def verb(machine: Machine, arguments: str) -> Command | None:
        if arguments:
            raise MonitorError(SYNTAX_ERROR)
        return act(machine)

    return verb


def carry_out(machine: Machine, text: str, table: Mapping[str, Verb]) -> Command:
    """Run the command of a verb, or of an unambiguous prefix of one, with its arguments. Raises MonitorError."""
    word, _, arguments = text.partition(" ")
    by_prefix = machine.manners.abbreviations
    matches = [word] if word in table else [name for name in table if by_prefix and name.startswith(word)]
    if len(matches) != 1:
        raise MonitorError("*Ambiguous name*" if matches else "*Illegal command*")
    command = table[matches[0]](machine, arguments.strip())
    if command is not None:
        yield from command


def come_to_rest(machine: Machine) -> Command:
    """Wait until the arm is at rest."""
    while not machine.at_rest():
        yield Wait(machine.arm.rests_s)


def define(machine: Machine, name: str, value: str) -> None:
    """Define a location or, with a name that begins with #, a precision point. Raises MonitorError."""
    if not point_name(name).startswith("#"):
        machine.memory.transforms[name] = machine.place(value)
        return
    precise = precision_point(value, machine.memory)
    if precise is None:
        raise MonitorError(SYNTAX_ERROR)
    machine.memory.precision_points[name] = precise


def print_input(word: str) -> Verb:
    """SIG(n) after `word`: -1 while the input is on, else 0. Other controllers have another word for it."""

    def verb(machine: Machine, arguments: str) -> Command:
        call = re.fullmatch(r"SIG\((\d{1,4})\)", arguments)
        if word != machine.manners.reads_inputs_by:
            raise MonitorError("*Illegal command*")
        if call is None:
            raise MonitorError(SYNTAX_ERROR)
        yield "-1" if machine.input_is_on(int(call[1])) else "0"

    return verb


def percent_of_full(text: str) -> float:
    """Parse a speed, percent. Raises MonitorError."""
    percent = number(text)
    if not 0 < percent <= FULL_PERCENT:
        raise MonitorError(ILLEGAL_VALUE)
    return percent


def set_speed(machine: Machine, arguments: str) -> None:
    """SPEED n."""
    machine.speed_percent = percent_of_full(arguments)
