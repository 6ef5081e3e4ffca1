"""A facet's type is a matter of its shape: not of where it lies, how large it is, or which corner comes first."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon import frames
from daemon.arrays import Array
from daemon.store.library import load_facets
from daemon.vision.geometry.facet_measures import measure
from daemon.vision.model.facet_types import (
    LARGEST_NUMBER,
    FacetLibrary,
    conditions,
    type_facet,
    type_number,
)
from daemon.vision.model.ring_names import facet_name, facets_counted
from tests.fakes.solids import regular

LIBRARY = load_facets()
SURE = 0.01  # mm, of corners that are as drawn

lengths = st.floats(20.0, 90.0)
seeds = st.integers(0, 2**31)
motions = st.builds(
    lambda turn, place: frames.rigid(frames.rotation_from_vector(np.array(turn)), np.array(place)),
    st.tuples(*[st.floats(-3, 3)] * 3),
    st.tuples(*[st.floats(-500, 500)] * 3),
)


def flat(corners: object) -> Array:
    """(N, 2) -> (N, 3) in the plane z = 0."""
    plane = np.asarray(corners, float)
    return np.column_stack([plane, np.zeros(len(plane))])


def rectangle(width: float, height: float) -> Array:
    return flat([[0, 0], [width, 0], [width, height], [0, height]])


def isosceles(base: float, height: float) -> Array:
    return flat([[0, 0], [base, 0], [base / 2, height]])


# What each library type looks like: sizes in which it is that type and no more particular one.
DRAWN = {
    "square": lengths.map(lambda a: flat(regular(4, a))),
    "rectangle": st.tuples(lengths, st.floats(1.25, 3)).map(lambda s: rectangle(s[0], s[0] * s[1])),
    "equilateral_triangle": lengths.map(lambda a: flat(regular(3, a))),
    "isosceles_triangle": st.tuples(lengths, st.floats(1.1, 2.5)).map(lambda s: isosceles(s[0], s[0] * s[1])),
    "pentagon": lengths.map(lambda a: flat(regular(5, a))),
}
drawn = st.sampled_from(sorted(DRAWN)).flatmap(lambda name: st.tuples(st.just(name), DRAWN[name]))
irregular = st.tuples(st.integers(3, 9), seeds).map(lambda s: star(*s))


def star(count: int, seed: int) -> Array:
    """Any plain polygon that goes round its middle once."""
    rng = np.random.default_rng(seed)
    angles = 2 * np.pi * (np.arange(count) + rng.uniform(0, 0.7, count)) / count
    return flat(rng.uniform(25, 60, (count, 1)) * np.column_stack([np.cos(angles), np.sin(angles)]))


def spread(count: int, sigma_mm: float = SURE) -> Array:
    return np.tile(sigma_mm**2 * np.eye(3), (count, 1, 1))


def name_of(corners: Array, covariance: Array) -> str:
    return type_facet(corners, covariance, LIBRARY)[0].name


@settings(max_examples=30, deadline=None)
@given(drawn, motions)
def test_what_is_drawn_in_the_library_is_typed_so_wherever_it_lies(kind: tuple[str, Array], motion: Array) -> None:
    name, corners = kind
    found = type_facet(frames.apply(motion, corners), spread(len(corners)), LIBRARY)
    assert (found[0].name, found[0].number) == (name, type_number(name, LIBRARY))


@given(st.one_of(drawn.map(lambda kind: kind[1]), irregular), motions, seeds, st.floats(0.5, 3.0))
@settings(max_examples=60, deadline=None)
def test_typing_does_not_see_motion_numbering_or_scale(corners: Array, motion: Array, seed: int, scale: float) -> None:
    rng = np.random.default_rng(seed)
    root = rng.normal(0, 0.15, (len(corners), 3, 3))
    covariance = root @ root.transpose(0, 2, 1) + spread(len(corners), 0.05)
    turn, by = motion[:3, :3], int(rng.integers(len(corners)))
    moved = np.roll(scale * frames.apply(motion, corners), by, axis=0)
    moved_covariance = np.roll(scale**2 * turn @ covariance @ turn.T, by, axis=0)
    one, other = (type_facet(*facet, LIBRARY) for facet in ((corners, covariance), (moved, moved_covariance)))
    if {"disc", "outline"} & {own[0].name.split("_")[0] for own in (one, other)}:
        return  # what still is a circle is told in mm: test_arcs.py
    assert [t.name for t in one] == [t.name for t in other]
    np.testing.assert_allclose([t.chi2 for t in one], [t.chi2 for t in other], rtol=1e-5, atol=1e-6)


@settings(max_examples=30, deadline=None)
@given(drawn, seeds)
def test_a_more_particular_type_comes_before_one_that_it_is_a_case_of(kind: tuple[str, Array], seed: int) -> None:
    name, corners = kind
    names = [t.name for t in type_facet(corners, spread(len(corners)), LIBRARY)]
    assert names[0] == name
    general = {"square": "rectangle", "equilateral_triangle": "isosceles_triangle"}
    if name in general:
        assert general[name] in names[1:]


@pytest.mark.parametrize("name", sorted(DRAWN))
def test_measured_with_the_noise_that_is_predicted_it_keeps_its_type(name: str) -> None:
    rng, kept = np.random.default_rng(1), 0
    corners = {"rectangle": rectangle(50, 80), "isosceles_triangle": isosceles(50, 70)}.get(
        name, flat(regular({"square": 4, "equilateral_triangle": 3, "pentagon": 5}.get(name, 3), 50.0))
    )
    for _ in range(300):
        noisy = corners + rng.normal(0, 0.3, corners.shape)
        kept += name in [t.name for t in type_facet(noisy, spread(len(corners), 0.3), LIBRARY)]
    assert kept >= 299


@settings(max_examples=30, deadline=None)
@given(lengths, st.floats(1.12, 1.5), motions)
def test_what_is_surely_longer_than_wide_is_no_square(side: float, ratio: float, motion: Array) -> None:
    corners = rectangle(side, side * ratio)
    assert name_of(frames.apply(motion, corners), spread(4)) == "rectangle"


@settings(max_examples=30, deadline=None)
@given(lengths, st.floats(6.0, 30.0), motions)
def test_what_surely_leans_has_no_right_angles(side: float, lean_deg: float, motion: Array) -> None:
    aside = side * np.tan(np.radians(lean_deg))
    corners = flat([[0, 0], [side, 0], [side + aside, side], [aside, side]])
    assert name_of(frames.apply(motion, corners), spread(4)) == "polygon4"


@settings(max_examples=30, deadline=None)
@given(drawn, motions)
def test_the_conditions_of_its_type_hold_of_a_drawn_facet(kind: tuple[str, Array], motion: Array) -> None:
    name, corners = kind
    moved = frames.apply(motion, corners)
    a, b = conditions(measure(moved), name, LIBRARY)
    assert len(b) > 0
    np.testing.assert_allclose(a @ measure(moved).values, b, atol=1e-6)


def test_types_the_library_lacks_have_numbers_of_their_own_above_its() -> None:
    names = [f"polygon{n}" for n in range(3, 15)] + [f"arc{d}" for d in range(15, 361, 15)]
    names += ["disc", "stadium", "half_disc", "quarter_disc", "rectangle_with_a_round_end", "rounded_polygon3"]
    names += [f"rounded_{t.name}" for t in LIBRARY.types] + [f"{t.name}_with_1_rounded_corner" for t in LIBRARY.types]
    numbers = [type_number(name, LIBRARY) for name in names]
    assert np.diff(np.sort([t.number for t in LIBRARY.types] + numbers)).min() > 5e-5
    assert min(numbers[:12]) > 0.8
    assert min(numbers[12:]) > LARGEST_NUMBER
    assert max(numbers) < 1.0


def test_without_squares_in_the_library_a_square_is_a_rectangle() -> None:
    """The coarse level of section 4.4.1: a library without the entry."""
    coarse = FacetLibrary(tuple(t for t in LIBRARY.types if t.name != "square"))
    square = flat(regular(4, 50.0))
    exactly = np.repeat(1e-6 * np.eye(3)[None], 4, axis=0)
    assert type_facet(square, exactly, LIBRARY)[0].name == "square"
    assert [t.name for t in type_facet(square, exactly, coarse)] == ["rectangle"]


@pytest.mark.parametrize(
    ("kind", "name"),
    [
        ("square", "square"),
        ("equilateral_triangle", "equilateral triangle"),
        ("polygon3", "triangle"),
        ("polygon10", "decagon"),
        ("polygon11", "11-sided polygon"),
        ("polygon", "polygon"),
        ("arc90", "90-degree arc"),
        ("rounded_polygon6", "rounded hexagon"),
        ("square_with_1_rounded_corner", "square with 1 rounded corner"),
        ("d_shape_300", "300-degree D shape"),
        ("outline_a90.h30~s.s.", "outline of 2 sides and 2 arcs (90, 30 inwards degrees)"),
    ],
)
def test_people_read_a_type_by_its_usual_name(kind: str, name: str) -> None:
    assert facet_name(kind) == name


def test_facets_are_counted_most_frequent_first() -> None:
    assert facets_counted(["polygon6", "square", "square", "polygon6", "square"]) == "3 squares, 2 hexagons"
    assert facets_counted(["square", "polygon6"], " and ") == "1 square and 1 hexagon"
    assert facets_counted(2 * ["rectangle_with_a_round_end"]) == "2 rectangles with a round end"
