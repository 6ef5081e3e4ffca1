"""What can go wrong in the ART room, by name. Every message says what was found and what was expected.

No other exception leaves this package on bad input; nothing here knows what the numbers mean.
"""

import numpy as np


class ArtError(ValueError):
    """Root of everything this package raises on purpose."""


class InputError(ArtError):
    """The samples, labels or matrices handed in cannot be used; the message names the shape, value or row."""


class ParameterError(ArtError):
    """A parameter lies outside its range or names an option that does not exist."""


class NotTrainedError(ArtError):
    """Something was asked of a network that has not seen a single sample."""


def within(name: str, value: float, low: float, high: float) -> None:
    """ParameterError unless low <= value <= high (high infinite: any finite number above low)."""
    if not (isinstance(value, (int, float, np.floating, np.integer)) and low <= value <= high and np.isfinite(value)):
        raise ParameterError(f"{name}: expected a number in [{low}, {high}], found {value!r}")


def one_of(name: str, value: object, options: tuple[str, ...]) -> None:
    """ParameterError unless value is one of the options."""
    if value not in options:
        raise ParameterError(f"{name}: expected one of {', '.join(options)}, found {value!r}")
