"""Errors of this package beyond those of the memory."""

from daemon.art.errors import ArtError, ParameterError


class NotTrainedError(ArtError):
    """The network has not learnt any sample."""


def one_of(name: str, value: object, options: tuple[str, ...]) -> None:
    """Raise ParameterError unless value is one of the options."""
    if value not in options:
        raise ParameterError(f"{name}: expected one of {', '.join(options)}, found {value!r}")
