"""Phrases that several commands share: counts, durations, yes and no."""

from collections.abc import Iterable

from daemon.events.pick_order import PickOrder
from daemon.store.recovery_state import RecoveryState


def plural(count: int, noun: str) -> str:
    """1 view, 2 views."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def duration(seconds: float) -> str:
    """5 s, 3 min, 2 h, 4 days."""
    for unit, length in (("days", 86400.0), ("h", 3600.0), ("min", 60.0)):
        if seconds >= 2 * length:
            return f"{seconds / length:.0f} {unit}"
    return f"{seconds:.0f} s"


def at_utc(iso: str) -> str:
    """2026-11-23T04:31:16+00:00 -> `2026-11-23 04:31`, for a table headed UTC."""
    return iso.replace("T", " ")[:16] or "-"


def millimetres(lengths: Iterable[float]) -> str:
    """50 50 49.6 mm -> `50 50 50 mm`."""
    return " ".join(f"{length:.0f}" for length in lengths) + " mm"


def at_mm(point: Iterable[float]) -> str:
    """(3,) mm -> `x 12.0  y 3.4  z -5.0 mm`."""
    return "x {:.1f}  y {:.1f}  z {:.1f} mm".format(*point)


def cut_off(pick_order: PickOrder) -> str:
    """The auto or job that a stop, a restart or a missing part interrupted."""
    if pick_order.count is None:
        return "`auto on` was interrupted before the table was empty"
    left = f"{plural(pick_order.count, 'part')} still to pick"
    return f"`auto on` was interrupted with {left}" if pick_order.job is None else f"Job {pick_order.job} has {left}"


def describe_interruption(state: RecoveryState) -> str:
    """Describe how the previous run ended, and what the operator must do."""
    what = f"the previous run, {state.run}, " + (
        "ended" if state.ended else f"was interrupted in state {state.state or 'unknown'}"
    )
    if state.damage:
        what = f"{state.damage}: how the previous run ended is unknown"
    if state.fault is not None:
        what += f", with a fault: {state.fault}"
    if state.hand_closed:
        what += f", possibly with {f'the {state.label}' if state.label else 'a part'} in the gripper"
    if state.auto is not None:
        what += f"; {cut_off(state.auto)}"
    return f"{what}: check the cell, then `resume`"


YES, NO = ("y", "yes", "ja", "j"), ("n", "no", "nein")


def is_yes(answer: str) -> bool:
    """Whether an answer is yes."""
    return answer.strip().lower() in YES


def is_no(answer: str) -> bool:
    """Whether an answer is no; another word is neither yes nor no."""
    return answer.strip().lower() in NO
