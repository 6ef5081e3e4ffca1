"""The operator's hand where there is no table to reach: in a simulated cell, and among recorded pairs.

In a real cell a person does this; these commands exist only where the cell is not real.
"""

from __future__ import annotations

from daemon.cell.simulated_hand import USUAL, SimulatedHand
from daemon.console.context import CommandContext
from daemon.console.interpreter import Answer, Command, CommandError, Door, no_more, number, one_of


def show(context: CommandContext, label: str) -> str:
    """Hold the part before the cameras in the next of its characteristic views; gives a line about it."""
    hand = _hand(context)
    if label not in hand.labels:
        raise CommandError(f"the simulated cell has no {label}; it has {', '.join(hand.labels)}")
    view = hand.show(label, len(context.trainer.model_store.views(label)))
    return f"(simulated) A hand shows the {label}, characteristic view {view + 1}."


async def place(context: CommandContext, words: list[str], _: Door) -> Answer:
    """Hold one part before the cameras."""
    usage = "place LABEL [VIEW]"
    label = one_of(words, 0, _hand(context).labels, "part", usage)
    no_more(words, 2, usage)
    view = _hand(context).show(label, number(words[1], "VIEW", 1, 9) - 1 if len(words) > 1 else 0)
    return Answer(f"The {label} is held before the cameras, view {view + 1}.")


async def scatter(context: CommandContext, words: list[str], _: Door) -> Answer:
    """Strew parts over the table."""
    labels = [one_of(words, k, _hand(context).labels, "part", "scatter [LABEL...]") for k in range(len(words))]
    labels = labels or list(USUAL)
    _hand(context).scatter(labels)
    return Answer(f"On the table: {', '.join(labels)}.")


async def next_pair(context: CommandContext, words: list[str], _: Door) -> Answer:
    """In a recorded cell, go on to the next pair."""
    no_more(words, 0, "next")
    if not context.hardware.eyes.step():
        raise CommandError("these cameras are not recorded pairs")
    return Answer("The next pair is shown.")


async def clear(context: CommandContext, words: list[str], _: Door) -> Answer:
    """Take everything away."""
    no_more(words, 0, "clear")
    _hand(context).clear()
    return Answer("The table is empty.")


def _hand(context: CommandContext) -> SimulatedHand:
    if context.hardware.hand is None:
        raise CommandError("this cell is real: put the part there yourself")
    return context.hardware.hand


def _labels(context: CommandContext) -> tuple[str, ...]:
    return _hand(context).labels


RECORDED_COMMANDS = (Command("next", "next", "(recorded) show the next pair", next_pair),)
COMMANDS = (
    Command("place", "place LABEL [VIEW]", "(simulated) hold a part before the cameras", place, choices=_labels),
    Command("scatter", "scatter [LABEL...]", "(simulated) strew parts over the table", scatter, choices=_labels),
    Command("clear", "clear", "(simulated) take all parts away", clear),
)
