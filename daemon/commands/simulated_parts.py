"""Commands in place of a person's hand: parts of a simulated cell, and the next pair of a recorded one."""

import asyncio

from daemon.cell.simulated_operator import DEFAULT_PARTS, SimulatedOperator
from daemon.console.context import CommandContext
from daemon.console.interpreter import CommandResult, Frontend, command, number, one_of
from daemon.errors import CommandError

STEADY = "steady"
"""Before the labels that are scattered: each on its steadiest side."""


def _hand(context: CommandContext, label: str | None = None) -> SimulatedOperator:
    """The simulated operator; label: a part that they must have. Raises CommandError."""
    hand = context.hardware.operator
    if hand is None:
        raise CommandError("this cell is real: place the part by hand")
    if label is not None and label not in hand.labels:
        raise CommandError(f"the simulated cell has no {label}; it has {', '.join(hand.labels)}")
    return hand


def show(context: CommandContext, label: str) -> str:
    """Hold the part before the cameras in the next of its characteristic views; returns a line about it."""
    view = _hand(context, label).show(label, len(context.trainer.model_store.views(label)))
    return f"(simulated) The {label} is shown, characteristic view {view + 1}."


def lay(context: CommandContext, label: str) -> str:
    """Put the part alone in the middle of the table; returns a line about it."""
    _hand(context, label).lay(label)
    return f"(simulated) The {label} is placed on the table."


async def know_drawings(context: CommandContext) -> dict[str, str]:
    """Give the drawn parts, as they are now, to a simulated cell; returns the reason for each that it cannot show."""
    hand = context.hardware.operator
    if hand is None:
        return {}
    return await asyncio.to_thread(lambda: hand.draw(context.trainer.drawings()))


@command("show LABEL [VIEW]", most=2, choices=lambda context: _hand(context).labels)
async def show_part(context: CommandContext, words: list[str], _: Frontend) -> CommandResult:
    """(simulated) hold a part before the cameras.

    Also a part that was taught from a drawing.
    """
    label = one_of(words, 0, _hand(context).labels, "part", show_part.usage)
    view = _hand(context).show(label, number(words[1], "VIEW", 1, 9) - 1 if len(words) > 1 else 0)
    return CommandResult(f"The {label} is held before the cameras, view {view + 1}.")


@command("scatter [steady] [LABEL...]", most=None, choices=lambda context: (*_hand(context).labels, STEADY))
async def scatter(context: CommandContext, words: list[str], _: Frontend) -> CommandResult:
    """(simulated) scatter parts over the table.

    scatter cube cube   two cubes, each on any side that it can lie on
    scatter steady      each part on the side on which its mass centre is lowest
    """
    steady = words[:1] == [STEADY] and STEADY not in _hand(context).labels
    words = words[1:] if steady else words
    labels = [one_of(words, k, _hand(context).labels, "part", scatter.usage) for k in range(len(words))]
    labels = labels or list(DEFAULT_PARTS)
    _hand(context).scatter(labels, steady)
    return CommandResult(f"On the table: {', '.join(labels)}.")


@command("next")
async def next_pair(context: CommandContext, words: list[str], _: Frontend) -> CommandResult:
    """(recorded) show the next pair."""
    if not context.hardware.cameras.step():
        raise CommandError("this cell does not play recorded pairs")
    return CommandResult("The next pair is shown.")


@command("clear")
async def clear(context: CommandContext, words: list[str], _: Frontend) -> CommandResult:
    """(simulated) remove all parts."""
    _hand(context).clear()
    return CommandResult("The table is empty.")


@command("switch SIGNAL on|off", most=2, choices=lambda context: context.cycle.production_line.names(inputs=True))
async def switch(context: CommandContext, words: list[str], _: Frontend) -> CommandResult:
    """(simulated) switch an input of the line, as a person or a PLC would."""
    name = one_of(words, 0, context.cycle.production_line.names(inputs=True), "input of facetd.yaml", switch.usage)
    on = one_of(words, 1, ("on", "off"), "word", switch.usage) == "on"
    signal = context.cycle.production_line.signals[name]
    _hand(context).cell.switch_input(signal.number, on is (signal.level == "high"))
    return CommandResult(f"{name} is {'on' if on else 'off'}.")


RECORDED_COMMANDS = (next_pair,)
COMMANDS = (show_part, scatter, switch, clear)
