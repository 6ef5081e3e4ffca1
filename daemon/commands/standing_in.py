"""The operator's hand where there is no table to reach: in a simulated cell, and among recorded pairs.

In a real cell a person does this; these commands exist only where the cell is not real.
"""

from __future__ import annotations

from daemon.console import Answer, Command, CommandError, Door, no_more, number, one_of
from daemon.desk import Desk
from daemon.simulated import USUAL, SimulatedHand


def show(desk: Desk, label: str) -> str:
    """Hold the part before the cameras in the next of its characteristic views; gives a line about it."""
    hand = _hand(desk)
    if label not in hand.labels:
        raise CommandError(f"the simulated cell has no {label}; it has {', '.join(hand.labels)}")
    view = hand.show(label, len(desk.school.shelf.views(label)))
    return f"(simulated) A hand shows the {label}, characteristic view {view + 1}."


async def place(desk: Desk, words: list[str], _: Door) -> Answer:
    """Hold one part before the cameras."""
    usage = "place LABEL [VIEW]"
    label = one_of(words, 0, _hand(desk).labels, "part", usage)
    no_more(words, 2, usage)
    view = _hand(desk).show(label, number(words[1], "VIEW", 1, 9) - 1 if len(words) > 1 else 0)
    return Answer(f"The {label} is held before the cameras, view {view + 1}.")


async def scatter(desk: Desk, words: list[str], _: Door) -> Answer:
    """Strew parts over the table."""
    labels = [one_of(words, k, _hand(desk).labels, "part", "scatter [LABEL...]") for k in range(len(words))]
    labels = labels or list(USUAL)
    _hand(desk).scatter(labels)
    return Answer(f"On the table: {', '.join(labels)}.")


async def next_pair(desk: Desk, words: list[str], _: Door) -> Answer:
    """In a recorded cell, go on to the next pair."""
    no_more(words, 0, "next")
    if not desk.hardware.eyes.step():
        raise CommandError("these cameras are not recorded pairs")
    return Answer("The next pair is shown.")


async def clear(desk: Desk, words: list[str], _: Door) -> Answer:
    """Take everything away."""
    no_more(words, 0, "clear")
    _hand(desk).clear()
    return Answer("The table is empty.")


def _hand(desk: Desk) -> SimulatedHand:
    if desk.hardware.hand is None:
        raise CommandError("this cell is real: put the part there yourself")
    return desk.hardware.hand


def _labels(desk: Desk) -> tuple[str, ...]:
    return _hand(desk).labels


RECORDED_COMMANDS = (Command("next", "next", "(recorded) show the next pair", next_pair),)
COMMANDS = (
    Command("place", "place LABEL [VIEW]", "(simulated) hold a part before the cameras", place, choices=_labels),
    Command("scatter", "scatter [LABEL...]", "(simulated) strew parts over the table", scatter, choices=_labels),
    Command("clear", "clear", "(simulated) take all parts away", clear),
)
