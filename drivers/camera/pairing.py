"""Synchronise two cameras: which two frames were exposed at the same time. Pure: time stamps in, indices out.

Times are in seconds on the monotonic clock.
"""

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class FrameExposure:
    """When a frame was exposed: the earliest possible start, and the middle."""

    start_s: float
    middle_s: float


def exposure_of(stamp_s: float, stamped_at_start: bool, period_s: float, exposure_s: float) -> FrameExposure:
    """Exposure of a frame from its driver's stamp, at the start of exposure or the end of read-out.

    Source: V4L2_BUF_FLAG_TSTAMP_SRC_*. The read-out of a rolling shutter takes up to a period, so that at its end the
    first row's exposure began up to period + exposure ago.
    """
    if stamped_at_start:
        return FrameExposure(stamp_s, stamp_s + exposure_s / 2)
    return FrameExposure(stamp_s - period_s - exposure_s, stamp_s - (period_s + exposure_s) / 2)


def newest_pair(
    left: Sequence[FrameExposure], right: Sequence[FrameExposure], not_before_s: float, max_skew_s: float
) -> tuple[int, int] | None:
    """Indices of the newest two frames that are each other's nearest in time, at most max_skew_s apart, and both
    exposed entirely after not_before_s. None where there is no such pair yet.
    """
    if not left or not right:
        return None

    def nearest(moment: FrameExposure, others: Sequence[FrameExposure]) -> int:
        return min(range(len(others)), key=lambda k: abs(others[k].middle_s - moment.middle_s))

    pairs = ((i, nearest(moment, right)) for i, moment in enumerate(left))
    good = [
        (i, j)
        for i, j in pairs
        if nearest(right[j], left) == i
        and min(left[i].start_s, right[j].start_s) >= not_before_s
        and abs(right[j].middle_s - left[i].middle_s) <= max_skew_s
    ]
    return max(good, key=lambda ij: min(left[ij[0]].middle_s, right[ij[1]].middle_s), default=None)


def why_no_pair(
    left: Sequence[FrameExposure],
    right: Sequence[FrameExposure],
    not_before_s: float,
    max_skew_s: float,
    silent_since_s: float,
    names: tuple[str, str] = ("left", "right"),
) -> str:
    """A message that says why undamaged frames make no pair.

    silent_since_s: a camera whose newest frame is older than that counts as silent; names: of the cameras, one twice
    where it is used alone.
    """
    both = dict(zip(names, (left, right), strict=True))
    silent = [name for name, frames in both.items() if not frames or frames[-1].middle_s < silent_since_s]
    if silent:
        return f"no frame {'any more ' if any(both[name] for name in silent) else ''}from the {_cameras(silent)}"
    fresh = [[m for m in frames if m.start_s >= not_before_s] for frames in (left, right)]
    if not all(fresh):
        late_ms = (not_before_s - min(max(m.start_s for m in frames) for frames in (left, right))) * 1000.0
        return f"the newest frames are {late_ms:.0f} ms too old (exposed before the arm came to rest)"
    skew_ms = min(abs(a.middle_s - b.middle_s) for a in fresh[0] for b in fresh[1]) * 1000.0
    return (
        f"the frames are {skew_ms:.1f} ms apart, more than max_skew_ms {max_skew_s * 1000.0:g}: "
        "raise the frame rate, synchronise the cameras, or raise the limit"
    )


def _cameras(names: Sequence[str]) -> str:
    return " and the ".join(names) + " camera"
