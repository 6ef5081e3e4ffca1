"""Numbers of the configuration as types: what a value may be at all. The unit is in the field's name. And numbers that
people type: read here, and nowhere else (tests/unit/test_typed_numbers.py).

A limit that is no number compares with nothing and so would never refuse: each of these has two ends, and neither takes
it. Whoever types a section by them (daemon/store/yamlfile.py) refuses what lies outside with its file, line and key.
"""

from __future__ import annotations

import re
from typing import Annotated

from msgspec import Meta

DECIMAL = re.compile(r"[+-]?(?:[0-9]{1,9}(?:\.[0-9]{0,9})?|\.[0-9]{1,9})")
WHOLE = re.compile(r"[0-9]{1,15}")
LONGEST_SHOWN = 40

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
    """A number that somebody typed: ASCII digits and a point, of bounded length, its unit behind it or not. What Python
    reads besides is none: 1_0, 1e3, inf, digits of other scripts. Raises ValueError, which says so. Also an argument's
    type."""
    word = text.strip().removesuffix(unit).rstrip() if unit else text.strip()
    if not DECIMAL.fullmatch(word):
        raise ValueError(f"expected a number{f' in {unit}' if unit else ''}, such as 12.5, found {shown(text)}")
    return float(word)


def whole(text: str) -> int:
    """A whole number, 0 or more, that somebody typed, as decimal is. Raises ValueError. Also an argument's type."""
    if not WHOLE.fullmatch(text):
        raise ValueError(f"expected a whole number, found {shown(text)}")
    return int(text)


def shown(text: str) -> str:
    """What was typed, as it is told back: cut where it is long."""
    return text if len(text) <= LONGEST_SHOWN else f"{text[:LONGEST_SHOWN]}... ({len(text)} characters)"
