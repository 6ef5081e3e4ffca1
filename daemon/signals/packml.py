"""PackML's state of the cell (ISA-TR88.00.02), the five that a machine must have. Pure."""

from enum import StrEnum


class PackMLState(StrEnum):
    """PackML's names."""

    STOPPED = "Stopped"
    """The arm is not enabled."""
    IDLE = "Idle"
    """Enabled; no job runs, or an auto waits for the line."""
    EXECUTE = "Execute"
    """A job runs that may move the arm."""
    COMPLETE = "Complete"
    """A part was brought, and the line has not acknowledged it."""
    ABORTED = "Aborted"
    """A fault is active, or the arm is being stopped."""


def packml_state(stopped: bool, enabled: bool, at_work: bool, done: bool) -> PackMLState:
    """The cell's state. stopped: a fault is active, or a stop is under way; enabled: the arm is; at_work: a job may
    move the arm and does not wait for the line to start; done: `part_done` is on."""
    if stopped:
        return PackMLState.ABORTED
    if not enabled:
        return PackMLState.STOPPED
    if at_work:
        return PackMLState.EXECUTE
    return PackMLState.COMPLETE if done else PackMLState.IDLE
