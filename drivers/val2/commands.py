"""The text of VAL II commands. Strings only: nothing is sent from here."""

from __future__ import annotations

import re
from math import isfinite

from drivers.val2.location import Location

MOVES_THE_ARM = re.compile(
    r"DO\s+(MOVES?T?|READY|NEST|DRIVE|DEPARTS?|APPROS?|OPENI?|CLOSEI?)\b|EX(ECUTE)?\b|CAL(IBRATE)?\b",
    re.IGNORECASE,
)


def trans(location: Location) -> str:
    """TRANS(...) with the digits VAL II prints: mm to 2 decimals, degrees to 3. Raises ValueError on inf and nan."""
    values = location.values()
    if not all(isfinite(value) for value in values):
        raise ValueError(f"not a location: {values}")
    lengths = [f"{value:.2f}" for value in values[:3]]
    angles = [f"{value:.3f}" for value in values[3:]]
    return f"TRANS({','.join(lengths + angles)})"


def move(location: Location) -> str:
    """Joint-interpolated move."""
    return f"DO MOVE {trans(location)}"


def straight_move(location: Location, variable: str | None) -> tuple[str, ...]:
    """Straight-line move, in one line or (variable given) by way of a variable."""
    if variable is None:
        return (f"DO MOVES {trans(location)}",)
    return (f"DO SET {variable}={trans(location)}", f"DO MOVES {variable}")


def speed(percent: float) -> str:
    """Monitor speed. Raises ValueError outside 0.1 to 100 percent."""
    if not 0.1 <= percent <= 100:
        raise ValueError(f"speed {percent} percent: expected 0.1 to 100")
    return f"SPEED {percent:g}"


def moves_the_arm(command: str) -> bool:
    """Whether a typed command may set anything in motion (the hand included)."""
    return MOVES_THE_ARM.match(command.strip()) is not None


def tool(flange_from_tool: Location) -> str:
    """Where the tool point lies, seen from the flange."""
    return f"TOOL {trans(flange_from_tool)}"
