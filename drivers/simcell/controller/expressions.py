"""Parse arguments of VAL II commands: numbers, names, TRANS(...), compound locations."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isfinite

import numpy as np

from drivers.arrays import Array
from drivers.val2.location import Location, matrix_from_location

LARGEST_NUMBER = 1e6
NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)(E[-+]?\d{1,2})?")
NAME = re.compile(r"[A-Z][A-Z0-9._]{0,14}")
FUNCTION = re.compile(r"(TRANS|PPOINT)\s*\((.*)\)")


class MonitorError(Exception):
    """A message that the controller prints, with its asterisks."""


SYNTAX_ERROR, ILLEGAL_VALUE, UNDEFINED_VALUE = "*Syntax error*", "*Illegal value*", "*Undefined value*"


@dataclass
class Memory:
    """Locations by name: transformations (4, 4) mm and, with names that begin with #, precision points (6,) rad.
    unit_mm: unit of typed lengths; programs: their instructions."""

    unit_mm: float = 1.0
    transforms: dict[str, Array] = field(default_factory=dict)
    precision_points: dict[str, Array] = field(default_factory=dict)
    programs: dict[str, tuple[str, ...]] = field(default_factory=dict)

    def named(self, name: str) -> dict[str, Array]:
        return self.precision_points if name.startswith("#") else self.transforms


def numbers(text: str, at_most: int, defaults: Mapping[int, float] | None = None) -> list[float]:
    """Parse up to at_most numbers between commas; an empty one has its default, or 0."""
    parts = [part.strip() for part in text.split(",")] if text.strip() else []
    if len(parts) > at_most:
        raise MonitorError(SYNTAX_ERROR)
    values = [(defaults or {}).get(k, 0.0) for k in range(at_most)]
    for k, part in enumerate(parts):
        if part:
            values[k] = number(part)
    return values


def number(text: str) -> float:
    """Parse one number. Raises MonitorError."""
    if not NUMBER.fullmatch(text.strip()):
        raise MonitorError(SYNTAX_ERROR)
    value = float(text)
    if not isfinite(value) or abs(value) > LARGEST_NUMBER:
        raise MonitorError(ILLEGAL_VALUE)
    return value


def split_arguments(text: str) -> list[str]:
    """Split at the commas outside of parentheses."""
    parts, depth, start = [], 0, 0
    for k, character in enumerate(text):
        depth += (character == "(") - (character == ")")
        if character == "," and depth == 0:
            parts.append(text[start:k].strip())
            start = k + 1
    return [*parts, text[start:].strip()]


def location(text: str, memory: Memory, here: Array) -> Array:
    """Evaluate a transformation expression, (4, 4) mm: terms joined by colons, each TRANS(...), HERE or a name.

    Raises MonitorError for bad syntax and undefined names.
    """
    pose = np.eye(4)
    for term in text.split(":"):
        pose = pose @ _term(term.strip(), memory, here)
    return pose


def precision_point(text: str, memory: Memory) -> Array | None:
    """A precision point (6,) rad, or None where the text is not one. Raises MonitorError where it is undefined."""
    call = FUNCTION.fullmatch(text)
    if call and call.group(1) == "PPOINT":
        return np.radians(numbers(call.group(2), 6))
    if not text.startswith("#"):
        return None
    point_name(text)
    if text not in memory.precision_points:
        raise MonitorError(UNDEFINED_VALUE)
    return memory.precision_points[text]


def point_name(text: str) -> str:
    """Check the name of a location. Raises MonitorError."""
    if not NAME.fullmatch(text.removeprefix("#")):
        raise MonitorError(SYNTAX_ERROR)
    return text


def _term(text: str, memory: Memory, here: Array) -> Array:
    call = FUNCTION.fullmatch(text)
    if call and call.group(1) == "TRANS":
        x, y, z, *angles = numbers(call.group(2), 6)
        return matrix_from_location(Location(*(value * memory.unit_mm for value in (x, y, z)), *angles))
    if text == "HERE":
        return here
    if text in memory.transforms:
        return memory.transforms[point_name(text)]
    point_name(text)
    raise MonitorError(UNDEFINED_VALUE)
