"""What two facets that share an edge are to the memory: lengths, angles, types; and how unsure."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon import frames
from daemon.art import RelationalView
from daemon.vision.geometry.polyhedron import Polyhedron
from daemon.vision.model.relations import FEATURES, SIGMA_SCALE, SIGMAS, relational_view
from tests.fakes import drawn
from tests.fakes.remembered import LIBRARY
from tests.fakes.solids import TETRAHEDRON, pose

BRICK = drawn.block(40, 50, 60)
LENGTHS, ANGLES = slice(0, 3), slice(3, 6)
directions = st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda d: np.linalg.norm(d) > 0.3)


def related(solid: Polyhedron, sigma_mm: float = 0.0, tolerance_mm: float = 0.0) -> RelationalView:
    """What is known of a solid of which each corner is off by so much along each axis."""
    spread = np.repeat(sigma_mm**2 * np.eye(3)[None], len(solid.corners_mm), 0)
    return relational_view(
        replace(solid, covariance_mm2=spread), [(name,) for name in solid.types], LIBRARY, tolerance_mm
    )


def millimetres(features: np.ndarray) -> np.ndarray:
    return np.asarray(1000.0 ** features[..., LENGTHS])


def radians(features: np.ndarray) -> np.ndarray:
    return np.asarray(2 * np.pi * features[..., ANGLES])


def moved(solid: Polyhedron, where: np.ndarray) -> Polyhedron:
    return replace(solid, corners_mm=frames.apply(where, solid.corners_mm))


@settings(max_examples=25, deadline=None)
@given(directions, st.floats(-3, 3))
def test_features_of_a_box_are_its_lengths_and_angles_wherever_it_lies(direction, roll) -> None:
    view = related(moved(BRICK, pose(np.array(direction), roll)))
    np.testing.assert_array_equal(view.touching, BRICK.touching)
    for f, g in np.argwhere(view.touching):
        (shared,) = (
            (a, b) for (a, b), (k, _) in BRICK.edges.items() if k == f and BRICK.edges.get((b, a), (-1,))[0] == g
        )
        along = np.linalg.norm(BRICK.corners_mm[shared[0]] - BRICK.corners_mm[shared[1]])
        across = next(n for n in sorted({round(s) for s in _sides(f)}, key=lambda s: s == round(along)))
        assert millimetres(view.features[f, g]) == pytest.approx([along, across, across])
        assert radians(view.features[f, g]) == pytest.approx([np.pi / 2] * 3)
    assert not view.features[~view.touching].any()
    assert not view.doubt.any()


def _sides(facet: int) -> np.ndarray:
    ring = BRICK.corners_mm[BRICK.rings[facet]]
    return np.asarray(np.linalg.norm(ring - np.roll(ring, -1, 0), axis=1))


def test_categories_are_type_numbers_and_open_ones_are_all_there() -> None:
    two = BRICK.only(BRICK.seams[0])
    view = relational_view(two, [("square", "rectangle"), ("rectangle",)], LIBRARY, 0.0)
    square, rectangle = (next(t.number for t in LIBRARY.types if t.name == name) for name in ("square", "rectangle"))
    assert view.categories.tolist() == [[square, rectangle], [rectangle, rectangle]]


@pytest.mark.parametrize("sigma_mm", [0.05, 0.3])
def test_doubt_is_in_proportion_to_the_corners_errors(sigma_mm: float) -> None:
    one, two = related(BRICK, sigma_mm), related(BRICK, 2 * sigma_mm)
    touching = one.touching
    assert (one.doubt[touching] > 0).all()
    assert not one.doubt[~touching].any()
    np.testing.assert_allclose(two.doubt, 2 * one.doubt)
    np.testing.assert_array_equal(two.features, one.features)
    np.testing.assert_allclose(related(BRICK, 0.0, sigma_mm).doubt, one.doubt)
    np.testing.assert_allclose(related(BRICK, 3 * sigma_mm, 4 * sigma_mm).doubt, 5 * one.doubt)


def test_features_scatter_as_their_doubt_has_it() -> None:
    """Lengths and angles to a tenth; of dihedral angles, told more simply, never less than they scatter."""
    sigma_mm, rng = 0.3, np.random.default_rng(4)
    told = related(BRICK, sigma_mm)
    touching = told.touching
    seen = np.array([
        related(replace(BRICK, corners_mm=BRICK.corners_mm + rng.normal(0, sigma_mm, (8, 3)))).features[touching]
        for _ in range(300)
    ])  # fmt: skip
    scatter, sigma = seen.std(0), told.doubt[touching] / (SIGMAS * SIGMA_SCALE)
    assert scatter[:, :5].mean(0) == pytest.approx(sigma[:, :5].mean(0), rel=0.1)
    assert scatter[:, 5].mean() < 1.05 * sigma[:, 5].mean()
    assert sigma[:, 5].mean() < 2 * scatter[:, 5].mean()


def test_the_dihedral_angle_inside_tells_a_hollow_from_an_edge() -> None:
    block = drawn.solid("l.obj", drawn.obj(*drawn.prism(drawn.L_BLOCK, 40)))
    view = related(block)
    angles = np.degrees(radians(view.features)[..., 2])
    hollow = [(f, g) for f, g in np.argwhere(view.touching) if angles[f, g] > 180]
    assert angles[view.touching] == pytest.approx(np.where(angles[view.touching] > 180, 270, 90))
    assert len(hollow) == 2, "the step, seen from either side"
    assert hollow[0] == pytest.approx(hollow[1][::-1])
    pointed = Polyhedron(TETRAHEDRON.corners_mm, TETRAHEDRON.facets, np.zeros((4, 3, 3)), ("equilateral",) * 4)
    there = radians(related(pointed).features)[~np.eye(4, dtype=bool)]
    assert there[:, 2] == pytest.approx(np.arccos(1 / 3), abs=1e-4)


def test_a_mirror_image_swaps_what_follows_and_what_precedes() -> None:
    skew = np.array([[1, 0.25, 0.1], [0, 1, 0.3], [0, 0, 1]])
    handed = replace(BRICK, corners_mm=BRICK.corners_mm @ skew.T)
    mirrored = replace(
        handed, corners_mm=handed.corners_mm * [-1, 1, 1], facets=tuple(ring[::-1] for ring in handed.facets)
    )
    one, other = related(handed), related(mirrored)
    np.testing.assert_allclose(other.features, one.features[..., [0, 2, 1, 4, 3, 5]], atol=1e-12)
    assert np.abs(other.features - one.features).max() > 0.01


def test_every_feature_lies_between_nothing_and_one_whatever_the_size() -> None:
    for scale in (1e-4, 1.0, 1e4):
        features = related(replace(BRICK, corners_mm=BRICK.corners_mm * scale)).features
        assert features.shape == (6, 6, FEATURES)
        assert features.min() >= 0
        assert features.max() <= 1
