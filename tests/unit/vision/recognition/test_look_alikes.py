"""The families of look-alike parts are what they say, and what is said to tell two of them apart does."""

from __future__ import annotations

import numpy as np
import pytest

from daemon.vision.geometry import Polyhedron
from drivers.rigid import rigid
from drivers.simcell.parts import box, shape
from tests.bench.look_alikes import answers, shown
from tests.fakes.distinguishable import TELLS_MM, telling_mm
from tests.fakes.drawn import solid
from tests.fakes.families import FAMILIES, LARGER, alike, cut
from tests.fakes.photographed import photograph, seen_by_one

SEEDS = range(0, 6, 2)


def _solids(family: str, seed: int) -> tuple[Polyhedron, Polyhedron]:
    first, second = (solid(f"{part.label}.obj", part.drawing) for part in alike(family, seed).parts)
    return first, second


@pytest.mark.parametrize("family", FAMILIES)
def test_each_pair_is_two_closed_solids_that_can_stand_and_the_same_for_a_seed(family: str) -> None:
    for seed in SEEDS:
        pair, again = alike(family, seed), alike(family, seed)
        assert [p.drawing for p in pair.parts] == [p.drawing for p in again.parts]
        assert pair.parts[0].drawing != pair.parts[1].drawing
        for part, one in zip(pair.parts, _solids(family, seed), strict=True):
            assert part.shape.rests
            assert one.open_edges == 0


@pytest.mark.parametrize("seed", SEEDS)
def test_mirror_images_have_the_same_distances_and_cannot_be_turned_onto_each_other(seed: int) -> None:
    one, other = _solids("mirror", seed)
    assert _areas_mm2(one) == pytest.approx(_areas_mm2(other), abs=0.5)
    assert not _fits_turned(one, other)
    assert _fits_turned(one, Polyhedron(other.corners_mm * [-1, 1, 1], one.facets, one.covariance_mm2, one.types))


def _areas_mm2(one: Polyhedron) -> list[float]:
    return sorted(np.linalg.norm(one.areas_mm2, axis=1).tolist())


def _fits_turned(one: Polyhedron, other: Polyhedron) -> bool:
    """Whether some turn takes the corners of one onto those of the other, both about their middles."""
    a = one.corners_mm - one.corners_mm.mean(0)
    b = other.corners_mm - other.corners_mm.mean(0)
    first = a[:3]
    lengths = np.linalg.norm(first[:, None] - first, axis=2)
    for triple in np.ndindex(len(b), len(b), len(b)):
        target = b[list(triple)]
        if np.abs(np.linalg.norm(target[:, None] - target, axis=2) - lengths).max() > 0.05:
            continue
        u, _, vt = np.linalg.svd(target.T @ first)
        rotation = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt
        if np.linalg.norm((a @ rotation.T)[:, None] - b, axis=2).min(1).max() < 0.2:
            return True
    return False


@pytest.mark.parametrize("seed", SEEDS)
def test_sizes_are_so_much_apart(seed: int) -> None:
    one, other = _solids("size", seed)
    assert other.size_mm / one.size_mm == pytest.approx(LARGER, abs=1e-3)


def test_other_dihedral_angles_leave_the_facets_as_they_were() -> None:
    for seed in SEEDS:
        one, other = _solids("dihedral", seed)
        assert _areas_mm2(one) == pytest.approx(_areas_mm2(other), abs=0.5)
        assert not _fits_turned(one, other)


def test_a_cut_corner_tells_where_it_is_in_view_and_not_where_it_is_behind() -> None:
    corners = box((0, 0, 0), (50, 60, 70))
    at = int(np.flatnonzero((corners == corners.max(0)).all(1))[0])
    whole, less = shape("whole", corners), shape("less", *cut(corners, at, np.full(3, 0.4)).clouds)
    towards = corners[at] / np.linalg.norm(corners[at])
    before, behind = (rigid(_facing(side * towards), [0.0, 0.0, 350.0]) for side in (1, -1))
    assert telling_mm(whole, less, before) > TELLS_MM
    assert telling_mm(less, whole, before) > TELLS_MM
    assert telling_mm(whole, less, behind) < TELLS_MM / 2
    assert telling_mm(less, whole, behind) < TELLS_MM / 2


def test_a_cap_and_a_pit_that_are_away_show_nothing_though_the_other_sides_are_nearly_alike() -> None:
    one, other = (part.shape for part in alike("dihedral", 40).parts)
    away = rigid(_facing(np.array([0.0, 0.0, -1.0])), [0.0, 0.0, 350.0])
    assert telling_mm(one, other, away) == telling_mm(other, one, away) == 0


def _facing(towards: np.ndarray) -> np.ndarray:
    """(3, 3) a rotation that turns a direction to the cameras (-z), a little aside."""
    aside = np.cross(towards, [0.3, 0.5, 0.8])
    aside /= np.linalg.norm(aside)
    return np.array([aside, np.cross(-towards, aside), -towards])


def test_a_pair_is_shown_in_each_mode_and_a_stranger_is_never_named_rightly() -> None:
    found = {one.mode: one for one in answers("size", 2)}
    assert list(found) == ["both", "alone", "stranger"]
    assert not found["stranger"].right
    assert found["alone"].right


def test_of_a_view_for_one_camera_that_alone_has_a_second_facet() -> None:
    pair, lies, photo = shown("size", 0, one_camera=True)
    shape = pair.parts[lies].shape
    assert seen_by_one(shape, photo.cyclopean_from_part)
    assert not seen_by_one(shape, shown("size", 0)[2].cyclopean_from_part)
    with pytest.raises(LookupError, match=shape.label):
        photograph(shape, np.random.default_rng(0), lambda _: False)
