"""What can go wrong in the ART room, by name. Every message says what was found and what was expected.

No other exception leaves this package on bad input; nothing here knows what the numbers mean.
"""


class ArtError(ValueError):
    """Root of everything this package raises on purpose."""


class InputError(ArtError):
    """The samples, labels or matrices handed in cannot be used; the message names the shape, value or row."""


class ParameterError(ArtError):
    """A parameter lies outside its range or names an option that does not exist."""


class NotTrainedError(ArtError):
    """Something was asked of a network that has not seen a single sample."""
