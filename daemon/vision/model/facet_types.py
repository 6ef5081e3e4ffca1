"""The library of 2-D facets and the three levels of typing: number of sides, angles, side ratios.

In: corners with covariance, arcs, and a library (values; the YAML is read elsewhere). Out: names and type numbers.
Tolerances are not constants: each test weighs a deviation by the covariance predicted for these very corners, plus
what the library allows a real part to deviate from its drawing.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from zlib import crc32

import numpy as np

from daemon.arrays import Array
from daemon.vision.geometry import Measures, Polyhedron, chi_square_limit, measure_each
from daemon.vision.model.arcs import Element, elements_by_corners, ring_elements
from daemon.vision.model.ring_names import READINGS, outline_name, rounded_corners, rounded_name

Value = float | str
LARGEST_NUMBER = 0.85  # of a library type; above lie the numbers of facets the library lacks
ARC_NUMBERS = 0.005  # the numbers of `arc<degrees>` lie within so much above that
LEVEL_SIGMAS = 6.0  # an angle off by more fails level two, whatever the rest says
FALSE_ALARM = 1e-4  # how rarely a true square may fail to be called one
SIGMA_SCALE = 1.5  # how far predicted corner errors may be too small before typing suffers
RESOLVED_MM, DOUBTFUL_MM = 2.5, 5.0
"""Radius from which on a look can tell a rounded corner from a sharp one, and from which on it always does."""
STEP_MM = 1e-3  # by which ends of sides are moved to see how their lines meet


@dataclass(frozen=True)
class FacetType:
    """One kind of facet. angles_rad and ratios hold, side by side, a number, or a letter: equal letters, equal values.

    A letter that occurs once leaves its value free. number: the type number of section 4.4.1, in (0, 1).
    """

    name: str
    number: float
    angles_rad: tuple[Value, ...]
    ratios: tuple[Value, ...]

    @property
    def sides(self) -> int:
        """Number of sides (level 1)."""
        return len(self.angles_rad)

    @cached_property
    def tests(self) -> tuple[tuple[Array, Array, int], ...]:
        """Return the test for each distinct turn of the corners: (A, b, rows of A about angles) with A @ [angles, log
        sides] = b."""
        found: list[tuple[Array, Array, int]] = []
        for turn in range(self.sides):
            angle_rows = _rows(_turned(self.angles_rad, turn), 0, 2 * self.sides, absolute=True)
            ratio_rows = _rows(_turned(self.ratios, turn), self.sides, 2 * self.sides, absolute=False)
            rows = angle_rows + ratio_rows
            a = np.array([r for r, _ in rows]).reshape(-1, 2 * self.sides)
            b = np.array([v for _, v in rows])
            if not any(_same(a, b, c, d) for c, d, _ in found):
                found.append((a, b, len(angle_rows)))
        return tuple(found)


@dataclass(frozen=True)
class FacetLibrary:
    """The known facet types and how far a real part may deviate: angle in rad, side ratio as a fraction."""

    types: tuple[FacetType, ...]
    angle_tolerance_rad: float = np.deg2rad(0.5)
    ratio_tolerance: float = 0.01
    by_sides: dict[int, tuple[FacetType, ...]] = field(init=False, compare=False, repr=False)

    def __post_init__(self) -> None:
        sides = {t.sides for t in self.types}
        object.__setattr__(self, "by_sides", {n: tuple(t for t in self.types if t.sides == n) for n in sorted(sides)})

    def type_named(self, name: str) -> FacetType | None:
        """The type of that name, or None (`polygon<N>` and arcs are not in the library)."""
        return next((t for t in self.types if t.name == name), None)


@dataclass(frozen=True)
class Typing:
    """One type a facet may have: how badly it fits (chi2 of dof), and by how many conditions it is pinned down."""

    name: str
    number: float
    chi2: float
    dof: int


def type_facet(
    corners_mm: Array, covariance_mm2: Array, library: FacetLibrary, arcs_mm: Sequence[Array] = ()
) -> tuple[Typing, ...]:
    """Every type the facet may have, the most particular first: a square before a rectangle. Never empty.

    corners_mm (N, 3), those of chords among them, covariance_mm2 (N, 3, 3); arcs_mm: points (K, 3) along each arc of
    the outline. What no library type fits is `polygon<N>`; with arcs it is named by them, see ring_names.py. Source:
    D'Souza, section 4.4.2.
    """
    return types_of_each([corners_mm], [covariance_mm2], library, [arcs_mm])[0]


def types_of_each(
    corners_mm: Sequence[Array],
    covariance_mm2: Sequence[Array],
    library: FacetLibrary,
    arcs_mm: Sequence[Sequence[Array]] | None = None,
) -> list[tuple[Typing, ...]]:
    """Return the types of many facets, as `type_facet` does of one."""
    arcs = arcs_mm or [()] * len(corners_mm)
    each = zip(corners_mm, covariance_mm2, measure_each(corners_mm), arcs, strict=True)
    return [_types_of(*facet, library) for facet in each]


def with_types_of_arcs(solid: Polyhedron, library: FacetLibrary) -> Polyhedron:
    """The solid with its facets that have arcs named by them; other types stay."""
    types = list(solid.types)
    for facet in {arc.facet for arc in solid.arcs}:
        own, ring = [arc.points_mm for arc in solid.arcs if arc.facet == facet], solid.rings[facet]
        types[facet] = type_facet(solid.corners_mm[ring], solid.covariance_mm2[ring], library, own)[0].name
    return replace(solid, types=tuple(types))


def _types_of(
    corners_mm: Array, covariance_mm2: Array, measures: Measures, arcs_mm: Sequence[Array], library: FacetLibrary
) -> tuple[Typing, ...]:
    sides = len(corners_mm)
    ring = ring_elements(corners_mm, arcs_mm) if arcs_mm else ()
    fits = () if ring else _straight_types(covariance_mm2, measures, library)
    if fits:
        return fits
    ring = ring or elements_by_corners(corners_mm, covariance_mm2)
    if ring:
        return _round_types(corners_mm, covariance_mm2, ring, library)
    return (_other(f"polygon{sides}"),)


def _straight_types(covariance_mm2: Array, measures: Measures, library: FacetLibrary) -> tuple[Typing, ...]:
    """The library's types that a facet without arcs may have."""
    sides = len(covariance_mm2)
    candidates = library.by_sides.get(sides, ())
    if not candidates:
        return ()
    covariance = measures.covariance(covariance_mm2) * SIGMA_SCALE**2
    covariance[np.diag_indices(sides)] += library.angle_tolerance_rad**2
    ends = np.arange(sides, 2 * sides)
    covariance[ends, ends] += library.ratio_tolerance**2
    fits = [t for t in (_test(kind, measures, covariance) for kind in candidates) if t]
    return tuple(sorted(fits, key=lambda t: (-t.dof, t.chi2)))


def _round_types(
    corners_mm: Array, covariance_mm2: Array, ring: Sequence[Element], library: FacetLibrary
) -> tuple[Typing, ...]:
    """The types of a facet with arcs, in every way it can be read; without what a look cannot resolve, and then without
    what it can hardly resolve."""
    found = dict[str, Typing]()
    sharp = tuple[Typing, ...]()
    for least_mm in (RESOLVED_MM, DOUBTFUL_MM):
        for reading in READINGS:
            rounded = rounded_corners(ring, reading)
            if rounded is None:
                name = outline_name(ring, reading)
                found.setdefault(name, _other(name))
                continue
            sharp = sharp or _sharp_types(corners_mm, covariance_mm2, ring, library)
            radii = [ring[(k + 1) % len(ring)].radius_mm for k, one in enumerate(ring) if one.straight]
            for base in sharp:
                name = rounded_name(base.name, [radius >= least_mm for radius in radii])
                found.setdefault(name, Typing(name, type_number(name, library), base.chi2, base.dof))
    return tuple(found.values())


def _sharp_types(
    corners_mm: Array, covariance_mm2: Array, ring: Sequence[Element], library: FacetLibrary
) -> tuple[Typing, ...]:
    """The types of the polygon that the straight sides of a ring bound, whose corners arcs round."""
    sides = [one for one in ring if one.straight]
    corners, spread = list[Array](), list[Array]()
    for one, after in zip(sides, [*sides[1:], *sides[:1]], strict=True):
        if one.last == after.first:
            corners.append(corners_mm[one.last])
            spread.append(covariance_mm2[one.last])
            continue
        ends = [one.first, one.last, after.first, after.last]
        moved = corners_mm[ends].ravel() + STEP_MM * np.vstack([np.zeros(12), np.eye(12)])
        met = _met(moved.reshape(-1, 4, 3))
        rows = ((met[1:] - met[0]) / STEP_MM).reshape(4, 3, 3)
        corners.append(met[0])
        spread.append((rows.swapaxes(1, 2) @ covariance_mm2[ends] @ rows).sum(0))
    return type_facet(np.array(corners), np.array(spread), library)


def _met(ends: Array) -> Array:
    """(M, 3) where the lines through ends (M, 4, 3), two each, are nearest to each other, on the first."""
    one, other, apart = ends[:, 1] - ends[:, 0], ends[:, 3] - ends[:, 2], ends[:, 0] - ends[:, 2]
    a, b, c = (one * one).sum(1), (one * other).sum(1), (other * other).sum(1)
    share = (b * (other * apart).sum(1) - c * (one * apart).sum(1)) / np.maximum(a * c - b * b, 1e-12)
    return np.asarray(ends[:, 0] + share[:, None] * one)


def conditions(measures: Measures, name: str, library: FacetLibrary) -> tuple[Array, Array]:
    """(A, b) with A @ [angles, log sides] = b for a facet of that type, in the turn that fits its measures best.

    No rows for a type the library does not have.
    """
    kind = library.type_named(name)
    values = measures.values
    if kind is None or kind.sides != len(measures.sides):
        return np.zeros((0, len(values))), np.zeros(0)
    a, b, _ = min(kind.tests, key=lambda test: float(((test[0] @ values - test[1]) ** 2).sum()))
    return a, b


def type_number(name: str, library: FacetLibrary) -> float:
    """The type number of a type.

    The library's; or, for what the library lacks, one of its own for each number of sides, above LARGEST_NUMBER and
    below 1.
    """
    kind = library.type_named(name)
    return kind.number if kind else _other_number(name)


def _other(name: str) -> Typing:
    return Typing(name, _other_number(name), 0.0, 0)


def _other_number(name: str) -> float:
    """Return the number of a type that the library lacks: `arc<degrees>` is one of models of earlier releases."""
    if name.startswith("arc") and name[3:].isdigit():
        return LARGEST_NUMBER + ARC_NUMBERS * int(name[3:]) / 360
    if name.startswith("polygon") and name[7:].isdigit():
        return 1.0 - 1.0 / (int(name[7:]) + 4.0)
    return 1.0 - (1.0 - LARGEST_NUMBER - ARC_NUMBERS) * (crc32(name.encode()) + 1.0) / (2**32 + 1)


def _test(kind: FacetType, measures: Measures, covariance: Array) -> Typing | None:
    """The best turn of one type: angles first, then side ratios; None where a level fails."""
    best: Typing | None = None
    values = measures.values
    for a, b, angles in kind.tests:
        if len(b) == 0:
            return Typing(kind.name, kind.number, 0.0, 0)
        off = a @ values - b
        spread = a @ covariance @ a.T
        if angles and np.abs(off[:angles]).max() > LEVEL_SIGMAS * np.sqrt(spread.diagonal()[:angles].max()):
            continue
        chi2 = float(off @ np.linalg.solve(spread, off))
        if chi2 < _limit(len(b)) and (best is None or chi2 < best.chi2):
            best = Typing(kind.name, kind.number, chi2, len(b))
    return best


def _rows(values: tuple[Value, ...], start: int, width: int, *, absolute: bool) -> list[tuple[list[float], float]]:
    """Conditions on the entries from `start` on.

    Numbers against their value (or against the first number's), letters against the first entry of that letter.
    """
    rows: list[tuple[list[float], float]] = []
    first: dict[str, int] = {}
    for i, value in enumerate(values):
        row = [0.0] * width
        row[start + i] = 1.0
        number = None if isinstance(value, str) else float(value)
        key = value if isinstance(value, str) else ""
        if number is not None and absolute:
            rows.append((row, number))
        elif key in first:
            row[start + first[key]] = -1.0
            other = values[first[key]]
            rows.append((row, 0.0 if number is None or isinstance(other, str) else float(np.log(number / other))))
        else:
            first[key] = i
    return rows


def _turned(values: tuple[Value, ...], turn: int) -> tuple[Value, ...]:
    return values[turn:] + values[:turn]


def _same(a: Array, b: Array, c: Array, d: Array) -> bool:
    """Whether two sets of conditions say the same: equal row spaces of [A | b]."""
    one, two = np.column_stack([a, b]), np.column_stack([c, d])
    if one.shape != two.shape:
        return False
    rank = np.linalg.matrix_rank(one)
    return bool(np.linalg.matrix_rank(np.vstack([one, two])) == rank)


@cache
def _limit(dof: int) -> float:
    """Return the largest chi-square allowed; cached, as a look asks for the same few again and again."""
    return chi_square_limit(dof, FALSE_ALARM)
