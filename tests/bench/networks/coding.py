"""Coding of samples: check, round to a binary grid, complement-code.

The grid makes results exact. Every coded value is a multiple of a power of two small enough that any sum of
them is exact in float64: |I ^ w| comes out the same in whatever order, block or thread it is added up, ties are true
ties, and "smallest index wins" means the same on every machine. Activations themselves are in
tests/bench/networks/fuzzy.py."""

from math import ceil, log2
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daemon.arrays import Array
from daemon.art.errors import InputError

FINEST_GRID_BITS = 44


def grid_step(length: int) -> float:
    """The step of the grid for coded samples of this length: 2**-44 (6e-14) up to 256 values, coarser beyond.

    The sum of `length` multiples of the step, each at most 1, then fits the 53 bits of a float64.
    """
    return float(2.0 ** -min(FINEST_GRID_BITS, 52 - ceil(log2(max(length, 2)))))


def on_grid(values: Array, step: float) -> Array:
    """The nearest multiples of step. Two numbers closer than half a step may become the same."""
    return np.asarray(np.rint(values / step) * step, dtype=np.float64)


def as_samples(X: Any, features: int | None = None) -> Array:
    """X as (N, M) float64, or InputError: not two-dimensional, not finite, outside [0, 1], or not M = features wide."""
    try:
        samples = np.asarray(X, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"samples: expected numbers, found {type(X).__name__} ({error})") from error
    if samples.ndim != 2:
        raise InputError(f"samples: expected (N, M), found shape {samples.shape}")
    if samples.shape[1] == 0:
        raise InputError("samples: expected at least one feature, found none")
    if features is not None and samples.shape[1] != features:
        raise InputError(f"samples: expected {features} features as trained, found {samples.shape[1]}")
    return samples


def as_unit_samples(X: Any, features: int | None = None) -> Array:
    """As `as_samples`, and within [0, 1]; the error names the first row and column outside."""
    samples = as_samples(X, features)
    refuse_first(~np.isfinite(samples), samples, "a finite number")
    refuse_first((samples < 0.0) | (samples > 1.0), samples, "a value in [0, 1]")
    return samples


def refuse_first(bad: NDArray[np.bool_], samples: Array, expected: str) -> None:
    """InputError naming the first place where bad is set; nothing where it is nowhere set."""
    if bad.any():
        row, column = (int(k) for k in np.argwhere(bad)[0])
        raise InputError(f"samples: row {row}, column {column}: expected {expected}, found {samples[row, column]}")


def code(samples: Array, complement: bool) -> Array:
    """(N, M) in [0, 1] -> (N, 2M) complement-coded (a, 1 - a), or (N, M) raw; on the grid either way.

    Complement coding keeps |I| = M whatever the sample, so that absence counts like presence and weights cannot
    wither (D'Souza, appendix B). Raw is what the thesis's printed activations were made with.
    """
    length = samples.shape[1] * (2 if complement else 1)
    gridded = on_grid(samples, grid_step(length))
    return np.hstack([gridded, 1.0 - gridded]) if complement else gridded
