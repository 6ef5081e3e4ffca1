"""What each operator command does. One file a subject; daemon/console/interpreter.py has the table of commands."""

from daemon.commands import (
    calibrating,
    camera_selection,
    controller_terminal,
    grippers,
    jobs,
    maintaining,
    models,
    moving,
    observing,
    placing,
    positions,
    run_notes,
    signals,
    simulated_parts,
    teaching,
)
from daemon.console.interpreter import ConsoleCommand


def every_command(kind: str = "real") -> list[ConsoleCommand]:
    """All commands in the order of `help`; those of the simulated operator only in a simulated or recorded cell."""
    hand = {"simulated": simulated_parts.COMMANDS, "recorded": simulated_parts.RECORDED_COMMANDS}
    return [
        *observing.COMMANDS,
        *moving.COMMANDS,
        *jobs.COMMANDS,
        *camera_selection.COMMANDS,
        *positions.COMMANDS,
        *placing.COMMANDS,
        *teaching.COMMANDS,
        *models.COMMANDS,
        *calibrating.COMMANDS,
        *controller_terminal.COMMANDS,
        *grippers.COMMANDS,
        *signals.COMMANDS,
        *run_notes.COMMANDS,
        *maintaining.COMMANDS,
        *hand.get(kind, ()),
    ]
