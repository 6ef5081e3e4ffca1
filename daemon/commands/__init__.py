"""What each operator command does. One file a subject; daemon/console/interpreter.py has the table of commands."""

from itertools import chain

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

MODULES = (
    observing, moving, jobs, camera_selection, positions, placing, teaching, models, calibrating, controller_terminal,
    grippers, signals, run_notes, maintaining,
)  # fmt: skip
"""In the order of `help`."""


def every_command(kind: str = "real") -> list[ConsoleCommand]:
    """All commands in the order of `help`; those of the simulated operator only in a simulated or recorded cell."""
    by_kind = {"simulated": simulated_parts.COMMANDS, "recorded": simulated_parts.RECORDED_COMMANDS}
    return [*chain.from_iterable(module.COMMANDS for module in MODULES), *by_kind.get(kind, ())]
