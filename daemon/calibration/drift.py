"""The watch over a calibration in use: every look's own corners and known edges tell when an eye has moved. Pure.

Corners that no longer lie on their epipolar lines say how the right eye has pitched and rolled against the left; parts
whose edges come out long or short say how it has turned in or out. One look is noisy, a drift is slow and a knock is
sudden: an exponentially weighted mean is held against the spread of the looks just after calibrating.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from daemon.arm import EyeName
from daemon.arrays import Array
from daemon.vision.health import AXES, Clue


@dataclass(frozen=True)
class DriftSettings:
    """learn: looks that set what is usual; settled: after so many of them a look that does not fit ends the learning,
    so that an eye knocked in its first hour does not teach its new place; weight: of a new look in the mean; sigmas:
    how far from usual is too far; wild: how many sigmas a look may be off before it needs a second one to be believed;
    least_deg: what is never reported; stop_deg: what stops autonomous picking."""

    learn: int = 20
    settled: int = 8
    weight: float = 0.15
    sigmas: float = 6.0
    wild: float = 6.0
    least_deg: float = 0.03
    stop_deg: float = 0.1


@dataclass(frozen=True, eq=False)
class DriftState:
    """What is known so far, by axis (3,). usual rad, from `learnt` looks of total information `known` and summed
    squared standardised residuals `squares`; mean rad of what came after, from information `fresh_known`, with
    `fresh_squares` the same information weighted twice; doubted: the side on which the last look was too wild to be
    believed alone; since: when the axis left its usual place."""

    usual: Array
    learnt: NDArray[np.int64]
    known: Array
    squares: Array
    mean: Array
    fresh_known: Array
    fresh_squares: Array
    doubted: Array
    since: tuple[str | None, ...] = (None, None, None)


@dataclass(frozen=True)
class Drift:
    """An eye has moved: which way, degrees, since when, whether that stops autonomous picking, and in words."""

    axis: str
    degrees: float
    since: str
    stops: bool
    text: str


def fresh() -> DriftState:
    """A watch that has seen nothing: to be used after each calibration."""
    zero = np.zeros(3)
    return DriftState(zero, np.zeros(3, np.int64), zero, zero, zero, zero, zero, zero)


def observe(
    watch: DriftState, seen: Clue, settings: DriftSettings, alone: EyeName | None = None
) -> tuple[DriftState, Drift | None]:
    """Take one look into account. The Drift is the largest that stands, or None; alone: the one eye, whose second place
    counts as the right eye."""
    strange = (watch.learnt >= settings.settled) & (np.abs(_standardised(watch, seen)) > settings.wild)
    unsettled = (watch.learnt < settings.learn) & (watch.fresh_known == 0)
    learning = np.isfinite(seen.sigma) & unsettled & ~strange
    judging = np.isfinite(seen.sigma) & ~learning
    watch = _judged(_learnt(watch, seen, learning), seen, judging, settings)
    far = _too_far(watch, settings)
    since = tuple((old or seen.at) if now else None for old, now in zip(watch.since, far, strict=True))
    watch = replace(watch, since=since)
    return watch, _drift(watch, far, settings, alone)


def _learnt(watch: DriftState, seen: Clue, learning: NDArray[np.bool_]) -> DriftState:
    """Weighted mean and spread of the first looks (West 1979)."""
    information = np.where(learning, seen.sigma**-2.0, 0.0)
    known = watch.known + information
    step = np.where(learning, seen.turn - watch.usual, 0.0)
    usual = watch.usual + step * information / np.maximum(known, 1e-30)
    squares = watch.squares + information * step * np.where(learning, seen.turn - usual, 0.0)
    return replace(watch, usual=usual, learnt=watch.learnt + learning, known=known, squares=squares)


def _scale(watch: DriftState) -> Array:
    """(3,) how many times larger the looks' spread is than their sigmas said; at least half, so that luck in the first
    looks makes no later one look wild."""
    scale: Array = np.sqrt(np.maximum(watch.squares / np.maximum(watch.learnt - 1, 1), 0.25))
    return scale


def _standardised(watch: DriftState, seen: Clue) -> Array:
    """(3,) how many sigmas a look is off from what was usual and what has become of it; 0 where it says nothing."""
    off: Array = seen.turn - watch.usual - watch.mean
    return off / np.where(np.isfinite(seen.sigma), seen.sigma * _scale(watch), np.inf)


def _judged(watch: DriftState, seen: Clue, judging: NDArray[np.bool_], settings: DriftSettings) -> DriftState:
    """The exponentially weighted mean of the looks since, each with its information. One wild look (a misread corner)
    is kept out; when the next is off on the same side, the eye has moved, and it counts."""
    news = seen.turn - watch.usual
    off = _standardised(watch, seen)
    side = np.where(judging & (np.abs(off) > settings.wild), np.sign(off), 0.0)
    believed = judging & ((side == 0) | (side == watch.doubted))
    fade = np.where(believed, 1 - settings.weight, 1.0)
    information = np.where(believed, seen.sigma**-2.0, 0.0)
    known = fade * watch.fresh_known + information
    mean = watch.mean + (news - watch.mean) * information / np.maximum(known, 1e-30)
    return replace(
        watch,
        mean=mean,
        fresh_known=known,
        fresh_squares=fade**2 * watch.fresh_squares + information,
        doubted=np.where(judging, side, watch.doubted),
    )


def _too_far(watch: DriftState, settings: DriftSettings) -> NDArray[np.bool_]:
    """Which axes have left their usual place: beyond `sigmas` of the two means' own doubt, and worth saying."""
    known = np.maximum(watch.fresh_known, 1e-30)
    doubt = _scale(watch) * np.sqrt(watch.fresh_squares / known**2 + 1 / np.maximum(watch.known, 1e-30))
    far: NDArray[np.bool_] = np.abs(watch.mean) > np.maximum(settings.sigmas * doubt, np.radians(settings.least_deg))
    return far & (watch.fresh_known > 0)


def _drift(watch: DriftState, far: NDArray[np.bool_], settings: DriftSettings, alone: EyeName | None) -> Drift | None:
    if not far.any():
        return None
    worst = int(np.argmax(np.where(far, np.abs(watch.mean), 0.0)))
    degrees = float(np.degrees(watch.mean[worst]))
    since = watch.since[worst] or ""
    stops = abs(degrees) >= settings.stop_deg
    what = f"right camera {AXES[worst]} by {degrees:+.2f} degrees against the left"
    if alone is not None:
        what = f"{alone} camera no longer as calibrated on the hand ({AXES[worst]} by {degrees:+.2f} degrees)"
    text = f"{what} since {since}: "
    text += "calibrate before picking goes on" if stops else "see that its mount is tight, and calibrate soon"
    return Drift(AXES[worst], degrees, since, stops, text)


class DriftWatch:
    """One calibration, watched. A new calibration gets a new one, and so do other eyes; alone: the one that looks."""

    def __init__(self, alone: EyeName | None = None) -> None:
        self.alone = alone
        self.drift: Drift | None = None
        self._watch: DriftState = fresh()

    def seen(self, clue: Clue, at: str) -> Drift | None:
        """Take one look into account (at: when, for people); the drift that stands, or None."""
        self._watch, self.drift = observe(self._watch, replace(clue, at=at), DriftSettings(), self.alone)
        return self.drift
