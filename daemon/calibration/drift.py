"""Drift detection: the corners and edges of each observation show when a camera has moved. Pure.

The distance of corners from their epipolar lines shows pitch and roll of the right camera against the left; the
measured length of parts' edges shows its yaw. One observation is noisy, a drift is slow, a mechanical shock sudden: an
exponentially weighted mean is compared with the spread of the observations just after the calibration.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from daemon.arm import CameraName
from daemon.arrays import Array
from daemon.vision.health import AXES, Clue

LEARN, LEAST_LEARN = 20, 8
"""Observations that set the reference; after how many of them an outlier ends the learning, so that a camera displaced
in its first hour does not set a wrong reference."""
WEIGHT = 0.15
"""Weight of a new observation in the mean."""
DRIFT_SIGMAS, OUTLIER_SIGMAS = 6.0, 6.0
"""Deviation that counts as drift; deviation of one observation that needs a second one to confirm it."""
LEAST_DEG, STOP_DEG = 0.03, 0.1
"""Smallest drift reported; smallest drift that stops autonomous picking."""


@dataclass(frozen=True, eq=False)
class DriftState:
    """State of the drift detection, by axis (3,). reference: rad, from `learnt_count` observations of total
    `information` with the sum `squares` of squared standardised residuals; mean: rad, deviation since, of
    `recent_information`, with `recent_squares` the sum of squared weights; outlier_side: sign of an unconfirmed
    outlier; since: when the axis left its reference."""

    reference: Array
    learnt_count: NDArray[np.int64]
    information: Array
    squares: Array
    mean: Array
    recent_information: Array
    recent_squares: Array
    outlier_side: Array
    since: tuple[str | None, ...] = (None, None, None)


@dataclass(frozen=True)
class Drift:
    """A camera has moved: by how much, whether that stops autonomous picking, the message."""

    degrees: float
    stops: bool
    text: str


def initial_state() -> DriftState:
    """The state after a calibration, before any observation."""
    zero = np.zeros(3)
    return DriftState(zero, np.zeros(3, np.int64), zero, zero, zero, zero, zero, zero)


def observe(state: DriftState, clue: Clue, alone: CameraName | None = None) -> tuple[DriftState, Drift | None]:
    """Add one observation. Returns the largest active drift, or None. alone: the only camera in use, whose second place
    counts as the right camera."""
    outlier = (state.learnt_count >= LEAST_LEARN) & (np.abs(_standardised(state, clue)) > OUTLIER_SIGMAS)
    unfinished = (state.learnt_count < LEARN) & (state.recent_information == 0)
    learning = np.isfinite(clue.sigma) & unfinished & ~outlier
    updating = np.isfinite(clue.sigma) & ~learning
    state = _mean_updated(_reference_updated(state, clue, learning), clue, updating)
    drifted = _drifted_axes(state)
    since = tuple((old or clue.at) if now else None for old, now in zip(state.since, drifted, strict=True))
    state = replace(state, since=since)
    return state, _drift(state, drifted, alone)


def _reference_updated(state: DriftState, clue: Clue, learning: NDArray[np.bool_]) -> DriftState:
    """Weighted mean and spread of the first observations (West 1979)."""
    information = np.where(learning, clue.sigma**-2.0, 0.0)
    total = state.information + information
    step = np.where(learning, clue.turn - state.reference, 0.0)
    reference = state.reference + step * information / np.maximum(total, 1e-30)
    squares = state.squares + information * step * np.where(learning, clue.turn - reference, 0.0)
    return replace(
        state, reference=reference, learnt_count=state.learnt_count + learning, information=total, squares=squares
    )


def _scale(state: DriftState) -> Array:
    """(3,) ratio of the observations' spread to their predicted sigmas; at least a half, so that a lucky small spread
    at first makes no outlier of later observations."""
    return np.sqrt(np.maximum(state.squares / np.maximum(state.learnt_count - 1, 1), 0.25))


def _standardised(state: DriftState, clue: Clue) -> Array:
    """(3,) deviation of an observation from reference plus mean, in sigmas; 0 where it measures nothing."""
    off: Array = clue.turn - state.reference - state.mean
    return off / np.where(np.isfinite(clue.sigma), clue.sigma * _scale(state), np.inf)


def _mean_updated(state: DriftState, clue: Clue, updating: NDArray[np.bool_]) -> DriftState:
    """Exponentially weighted mean of the deviations, by information. A single outlier (a misread corner) is left out;
    if the next observation deviates to the same side, the camera has moved, and it counts."""
    change = clue.turn - state.reference
    off = _standardised(state, clue)
    side = np.where(updating & (np.abs(off) > OUTLIER_SIGMAS), np.sign(off), 0.0)
    accepted = updating & ((side == 0) | (side == state.outlier_side))
    fade = np.where(accepted, 1 - WEIGHT, 1.0)
    information = np.where(accepted, clue.sigma**-2.0, 0.0)
    total = fade * state.recent_information + information
    mean = state.mean + (change - state.mean) * information / np.maximum(total, 1e-30)
    return replace(
        state,
        mean=mean,
        recent_information=total,
        recent_squares=fade**2 * state.recent_squares + information,
        outlier_side=np.where(updating, side, state.outlier_side),
    )


def _drifted_axes(state: DriftState) -> NDArray[np.bool_]:
    """Return which axes have drifted: beyond DRIFT_SIGMAS standard deviations of the difference of the means, and
    LEAST_DEG."""
    recent = np.maximum(state.recent_information, 1e-30)
    sigma = _scale(state) * np.sqrt(state.recent_squares / recent**2 + 1 / np.maximum(state.information, 1e-30))
    limit = np.maximum(DRIFT_SIGMAS * sigma, np.radians(LEAST_DEG))
    return np.asarray(np.abs(state.mean) > limit)


def _drift(state: DriftState, drifted: NDArray[np.bool_], alone: CameraName | None) -> Drift | None:
    if not drifted.any():
        return None
    worst = int(np.argmax(np.where(drifted, np.abs(state.mean), 0.0)))
    degrees = float(np.degrees(state.mean[worst]))
    stops = abs(degrees) >= STOP_DEG
    movement = f"right camera {AXES[worst]} by {degrees:+.2f} degrees against the left"
    if alone is not None:
        movement = f"{alone} camera no longer as calibrated on the gripper ({AXES[worst]} by {degrees:+.2f} degrees)"
    text = f"{movement} since {state.since[worst]}: "
    text += "calibrate before you pick again" if stops else "check that its mount is tight, and calibrate soon"
    return Drift(degrees, stops, text)


class DriftWatch:
    """Drift detection of one calibration and choice of cameras; alone: the only camera in use, or None."""

    def __init__(self, alone: CameraName | None = None) -> None:
        self.alone = alone
        self.drift: Drift | None = None
        self._state = initial_state()

    def add(self, clue: Clue, at: str) -> Drift | None:
        """Add one observation (at: its time, for people). Returns the active drift, or None."""
        self._state, self.drift = observe(self._state, replace(clue, at=at), self.alone)
        return self.drift
