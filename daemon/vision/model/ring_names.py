"""Names of facets whose outline has arcs, and every type as people call it.

In: rings of elements, and what their straight sides alone would bound. Out: names. An arc that rounds a corner
is no element of its own: what counts is the polygon, and which of its corners are round. Source: D'Souza, section 5.7
(rounded corners, circular facets).
"""

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from daemon.vision.model.arcs import Element

NAME_STEP_DEG, UNSURE = 15, 0.25  # sweeps are named to this step, and are so unsure, in steps
SMOOTH = np.radians(20.0)  # an arc that turns by less into the next element touches it
CORNER = np.radians(140.0)  # an arc of a larger sweep is a round end, no rounded corner
RIGHT = np.radians(10.0)  # how far from 90 degrees a corner may be that is meant to be right
POLYGONS = ("triangle", "quadrilateral", "pentagon", "hexagon", "heptagon", "octagon", "nonagon", "decagon")
"""Names of facets of three sides and more that the library does not have."""


class RingReading(NamedTuple):
    """How a ring is read: up to which turn, rad, an arc touches its neighbour, and by how much, in steps, its sweeps
    are larger than measured."""

    smooth_rad: float = SMOOTH
    steps: float = 0.0


READINGS = (
    RingReading(),
    RingReading(steps=-UNSURE),
    RingReading(steps=UNSURE),
    RingReading(SMOOTH / 2),
    RingReading(1.5 * SMOOTH),
)
"""The likeliest first. Near the limit of a step, or of touching, they differ."""


def rounded_corners(ring: Sequence[Element], reading: RingReading) -> tuple[bool, ...] | None:
    """Whether an arc rounds the corner behind each straight side of a ring; None where it has other arcs."""
    beside = [(ring[k - 1], one, ring[(k + 1) % len(ring)]) for k, one in enumerate(ring)]
    rounds = all(
        before.straight
        and after.straight
        and max(abs(before.turn_rad), abs(one.turn_rad)) < reading.smooth_rad
        and abs(one.sweep_rad) < CORNER
        for before, one, after in beside
        if not one.straight
    )
    behind = tuple(not after.straight for _, one, after in beside if one.straight)
    return behind if rounds and len(behind) > 2 else None


def rounded_name(polygon: str, rounded: Sequence[bool]) -> str:
    """The name of a polygon, by its own, some or all of whose corners are rounded, in order."""
    if not any(rounded):
        return polygon
    if all(rounded):
        return f"rounded_{polygon}"
    turns = (tuple(rounded[k:]) + tuple(rounded[:k]) for k in range(len(rounded)))
    which = [k + 1 for k, one in enumerate(max(turns)) if one]
    if which[-1] == len(which):
        return f"{polygon}_with_{len(which)}_rounded_corner{'' if len(which) == 1 else 's'}"
    return f"{polygon}_with_rounded_corners_{'_'.join(map(str, which[:-1]))}_and_{which[-1]}"


def outline_name(ring: Sequence[Element], reading: RingReading) -> str:
    """The name of a facet with arcs that are no rounded corners: `stadium`, or its elements in order, `s` a side, `a90`
    and `h90` an arc of 90 degrees that bends outwards and inwards, `~` behind one that touches the next, else `.`."""
    if len(ring) == 1:
        return "disc"
    degrees = [_degrees(one, reading) for one in ring]
    if len(ring) == 2 and any(one.straight for one in ring):  # where an arc that sweeps 300 degrees meets its chord
        size = max(degrees)
        return "half_disc" if size == 180 else f"{'d_shape' if size > 180 else 'segment'}_{size}"
    smooth = [
        abs(one.turn_rad) < reading.smooth_rad and not (one.straight and ring[(k + 1) % len(ring)].straight)
        for k, one in enumerate(ring)
    ]
    words = [
        ("s" if one.straight else f"{'a' if one.sweep_rad > 0 else 'h'}{size}") + ("~" if touches else ".")
        for one, size, touches in zip(ring, degrees, smooth, strict=True)
    ]
    first = min(range(len(words)), key=lambda k: words[k:] + words[:k])
    spelt = "".join(words[first:] + words[:first])
    size = degrees[first]
    right = [abs(one.turn_rad - np.pi / 2) < RIGHT for one, touches in zip(ring, smooth, strict=True) if not touches]
    if spelt == "a180~s~a180~s~":
        return "stadium"
    if spelt == "a180~s.s.s~" and all(right):
        return "rectangle_with_a_round_end"
    ends = ring[first], ring[first - 1]
    if spelt == f"a{size}.s.s." and all(abs(one.turn_rad - np.pi / 2) < RIGHT for one in ends):
        return "quarter_disc" if size == 90 else f"sector_{size}"
    return f"outline_{spelt}"


def facet_name(kind: str) -> str:
    """A type as people call it: `polygon6` is a hexagon, `polygon11` an 11-sided polygon, `d_shape_300` a 300-degree D
    shape, `arc90`, of models of earlier releases, a 90-degree arc."""
    if kind.startswith("outline_"):
        return _counted_elements(kind.removeprefix("outline_"))
    with_angle = re.fullmatch(r"(arc|d_shape|segment|sector)_?(\d+)", kind)
    if with_angle is not None:
        return f"{with_angle[2]}-degree {with_angle[1].replace('d_shape', 'D shape')}"
    return re.sub(r"polygon(\d+)", lambda found: _polygon(int(found[1])), kind).replace("_", " ")


def facets_counted(kinds: Iterable[str], joined: str = ", ") -> str:
    """`5 rectangles, 1 hexagon`, the most frequent type first."""
    counted = Counter(facet_name(kind) for kind in kinds).most_common()
    return joined.join(f"{count} {name if count == 1 else _plural(name)}" for name, count in counted)


def _degrees(one: Element, reading: RingReading) -> int:
    steps = abs(np.degrees(one.sweep_rad)) / NAME_STEP_DEG + reading.steps
    return NAME_STEP_DEG * int(np.clip(round(steps), 1, 360 / NAME_STEP_DEG))


def _polygon(sides: int) -> str:
    return POLYGONS[sides - 3] if 3 <= sides < len(POLYGONS) + 3 else f"{sides}-sided polygon"


def _counted_elements(spelt: str) -> str:
    """`outline of 3 sides and 1 arc (90 degrees)`."""
    sides, arcs = spelt.count("s"), re.findall(r"([ah])(\d+)", spelt)
    sizes = ", ".join(f"{size}{'' if sense == 'a' else ' inwards'}" for sense, size in arcs)
    counts = (f"{count} {word}{'' if count == 1 else 's'}" for count, word in ((sides, "side"), (len(arcs), "arc")))
    return f"outline of {' and '.join(counts)} ({sizes} degrees)"


def _plural(name: str) -> str:
    return re.sub(r"(?= with | of |$)", "s", name, count=1)
