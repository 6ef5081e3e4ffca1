"""What each of the operators' words does. One file a subject; the interpreter that finds them is daemon/console.py."""

from __future__ import annotations

from daemon.commands import keeping, learning, looking, moving, standing_in
from daemon.console import Command


def every_command(simulated: bool) -> list[Command]:
    """All commands in the order `help` shows them; those of the hand in a simulated cell only there."""
    return [
        *looking.COMMANDS,
        *moving.COMMANDS,
        *learning.COMMANDS,
        *keeping.COMMANDS,
        *(standing_in.COMMANDS if simulated else ()),
    ]
