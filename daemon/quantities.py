"""Types of numbers in the configuration, with their bounds, and the reading of numbers that people type.

Every type has two bounds, so that nan, which compares with nothing, never becomes a limit that refuses nothing.
daemon/store/yamlfile.py reports a value out of bounds with file, line and key. The unit is in the field's name.
"""

import argparse
import contextlib
import re
from collections.abc import Callable
from typing import Annotated, TypeVar

from msgspec import Meta

DECIMAL = re.compile(r"[+-]?(?:[0-9]{1,9}(?:\.[0-9]{0,9})?|\.[0-9]{1,9})")
WHOLE = re.compile(r"[0-9]{1,15}")
LONGEST_SHOWN = 40
N = TypeVar("N", int, float)

Coordinate = Annotated[float, Meta(ge=-5000, le=5000)]
Length = Annotated[float, Meta(gt=0, le=5000)]
Room = Annotated[float, Meta(ge=0, le=500)]
Direction = Annotated[float, Meta(ge=-360, le=360)]
Lean = Annotated[float, Meta(ge=-90, le=90)]
Turn = Annotated[float, Meta(gt=0, le=360)]
Sigma = Annotated[float, Meta(gt=0, le=100)]
Percent = Annotated[float, Meta(ge=0.1, le=100)]
Share = Annotated[float, Meta(gt=0, le=1)]
Seconds = Annotated[float, Meta(gt=0, le=3600)]
Pixels = Annotated[float, Meta(gt=0, le=100)]
Few = Annotated[int, Meta(ge=1, le=100)]
Name = Annotated[str, Meta(min_length=1, max_length=4096)]


def decimal(text: str, unit: str = "") -> float:
    """Read a number that a person typed: ASCII digits and a point, of bounded length, with or without its unit. Other
    forms that Python accepts are errors: 1_0, 1e3, inf, digits of other scripts. Raises ValueError. Also an argparse
    type.
    """
    word = text.strip().removesuffix(unit).rstrip() if unit else text.strip()
    if not DECIMAL.fullmatch(word):
        raise ValueError(f"expected a number{f' in {unit}' if unit else ''}, such as 12.5, found {shown(text)}")
    return float(word)


def whole(text: str) -> int:
    """Read a whole number, 0 or more, that a person typed. Raises ValueError. Also an argparse type."""
    if not WHOLE.fullmatch(text):
        raise ValueError(f"expected a whole number, found {shown(text)}")
    return int(text)


def within(read: Callable[[str], N], least: N, most: N | None = None) -> Callable[[str], N]:
    """An argparse type: a number that `read` (decimal, whole) reads, from `least` to `most`."""
    expected = f"{least:g} or more" if most is None else f"{least:g} to {most:.10g}"

    def number(text: str) -> N:
        with contextlib.suppress(ValueError):
            value = read(text)
            if least <= value and (most is None or value <= most):
                return value
        raise argparse.ArgumentTypeError(f"expected {expected}, found {shown(text)}")

    return number


def shown(text: str) -> str:
    """A typed text for an error message, cut where it is long."""
    return text if len(text) <= LONGEST_SHOWN else f"{text[:LONGEST_SHOWN]}... ({len(text)} characters)"
