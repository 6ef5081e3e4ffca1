"""The library of 2-D facets and the three levels of typing: number of sides, angles, side ratios.

In: corners with covariance and a library (values; the YAML is read elsewhere). Out: names and type numbers.
Tolerances are not constants: each test weighs a deviation by the covariance predicted for these very corners, plus
what the library allows a real part to deviate from its drawing.
"""

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property

import numpy as np

from daemon.arrays import Array
from daemon.vision.geometry import Measures, chi_square_limit, measure_each
from daemon.vision.model.arcs import arc_name

Value = float | str
LARGEST_NUMBER = 0.85  # of a library type; above lie the numbers of facets the library lacks
ARC_NUMBERS = 0.005  # the numbers of arcs lie within so much above that
LEVEL_SIGMAS = 6.0  # an angle off by more fails level two, whatever the rest says
FALSE_ALARM = 1e-4  # how rarely a true square may fail to be called one
SIGMA_SCALE = 1.5  # how far predicted corner errors may be too small before typing suffers
POLYGONS = ("triangle", "quadrilateral", "pentagon", "hexagon", "heptagon", "octagon", "nonagon", "decagon")
"""Names of facets of three sides and more that the library does not have."""


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


def type_facet(corners_mm: Array, covariance_mm2: Array, library: FacetLibrary) -> tuple[Typing, ...]:
    """Every type the facet may have, the most particular first: a square before a rectangle. Never empty.

    corners_mm (N, 3), covariance_mm2 (N, 3, 3). What no library type fits is `polygon<N>`, or `arc<degrees>` where
    its corners run round one circle. Source: D'Souza, section 4.4.2.
    """
    return types_of_each([corners_mm], [covariance_mm2], library)[0]


def types_of_each(
    corners_mm: Sequence[Array], covariance_mm2: Sequence[Array], library: FacetLibrary
) -> list[tuple[Typing, ...]]:
    """Return the types of many facets, as `types_of` does of one."""
    each = zip(corners_mm, covariance_mm2, measure_each(corners_mm), strict=True)
    return [_types_of(*facet, library) for facet in each]


def _types_of(
    corners_mm: Array, covariance_mm2: Array, measures: Measures, library: FacetLibrary
) -> tuple[Typing, ...]:
    sides = len(corners_mm)
    candidates = library.by_sides.get(sides, ())
    if candidates:
        covariance = measures.covariance(covariance_mm2) * SIGMA_SCALE**2
        covariance[np.diag_indices(sides)] += library.angle_tolerance_rad**2
        ends = np.arange(sides, 2 * sides)
        covariance[ends, ends] += library.ratio_tolerance**2
        fits = [t for t in (_test(kind, measures, covariance) for kind in candidates) if t]
        if fits:
            return tuple(sorted(fits, key=lambda t: (-t.dof, t.chi2)))
    name = arc_name(corners_mm, covariance_mm2) or f"polygon{sides}"
    return (Typing(name, _other_number(name), 0.0, 0),)


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


def facet_name(kind: str) -> str:
    """A type as people call it: `polygon6` is a hexagon, `polygon11` an 11-sided polygon, `arc90` a 90-degree arc."""
    other = re.fullmatch(r"(polygon|arc)(\d+)", kind)
    if other is None:
        return kind.replace("_", " ")
    number = int(other[2])
    if other[1] == "arc":
        return f"{number}-degree arc"
    return POLYGONS[number - 3] if 3 <= number < len(POLYGONS) + 3 else f"{number}-sided polygon"


def facets_counted(kinds: Iterable[str], joined: str = ", ") -> str:
    """`5 rectangles, 1 hexagon`, the most frequent type first."""
    counted = Counter(facet_name(kind) for kind in kinds).most_common()
    return joined.join(f"{count} {name}{'' if count == 1 else 's'}" for name, count in counted)


def _other_number(name: str) -> float:
    digits = int("".join(c for c in name if c.isdigit()) or "0")
    if name.startswith("arc"):
        return LARGEST_NUMBER + ARC_NUMBERS * digits / 360
    return 1.0 - 1.0 / (digits + 4.0)


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
