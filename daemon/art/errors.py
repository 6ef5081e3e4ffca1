"""Errors of this package on bad input, each with what was expected and what was found."""

import numpy as np


class ArtError(ValueError):
    """Root of the errors of this package."""


class InputError(ArtError):
    """Unusable samples, labels or matrices; the message names the shape, value or row."""


class ParameterError(ArtError):
    """A parameter out of its range, or an option that does not exist."""


def within(name: str, value: float, low: float, high: float) -> None:
    """Raise ParameterError unless low <= value <= high and value is finite."""
    if not (isinstance(value, (int, float, np.floating, np.integer)) and low <= value <= high and np.isfinite(value)):
        raise ParameterError(f"{name}: expected a number in [{low}, {high}], found {value!r}")
