"""What each of the operators' words does. One file a subject; daemon/console/interpreter.py finds them."""

from __future__ import annotations

from daemon.commands import calibrating, eyes, keeping, learning, looking, models, moving, placing, simulated_hand
from daemon.console.interpreter import Command


def every_command(kind: str = "real") -> list[Command]:
    """All commands in the order `help` shows them; those of the hand in a simulated or recorded cell only there."""
    hand = {"simulated": simulated_hand.COMMANDS, "recorded": simulated_hand.RECORDED_COMMANDS}
    return [
        *looking.COMMANDS,
        *moving.COMMANDS,
        *eyes.COMMANDS,
        *placing.COMMANDS,
        *learning.COMMANDS,
        *models.COMMANDS,
        *calibrating.COMMANDS,
        *keeping.COMMANDS,
        *hand.get(kind, ()),
    ]
