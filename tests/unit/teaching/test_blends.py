"""Fillets and chamfers that no camera resolves: the part has the edges they were made from."""

from __future__ import annotations

from collections.abc import Callable
from itertools import product

import numpy as np
import pytest

from daemon.store.library import load_facets
from daemon.teaching.solid_from_mesh import Drawing, read_drawing
from tests.fakes import drawn

SIDES = np.array([40.0, 50.0, 60.0])
L_BLOCK = np.array(drawn.L_BLOCK, float)


def drawing(corners: np.ndarray, rings: list[tuple[int, ...]]) -> Drawing:
    return read_drawing("part.obj", drawn.obj(corners, rings), "mm", load_facets())


def hull(points: np.ndarray) -> Drawing:
    from scipy.spatial import ConvexHull  # by the test that needs it, not by every worker that collects

    return drawing(points, [tuple(map(int, one)) for one in ConvexHull(points).simplices])


def rounded_box(radius: float, steps: int = 5) -> Drawing:
    turns = np.linspace(0, np.pi / 2, steps)
    ball = [[np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)] for t in turns for p in turns]
    signs = np.array(list(product((-1, 1), repeat=3)))
    return hull(np.concatenate([sign * (SIDES / 2 - radius + radius * np.array(ball)) for sign in signs]))


def chamfered_box(leg: float) -> Drawing:
    signs = np.array(list(product((-1, 1), repeat=3)))
    return hull(np.concatenate([sign * (SIDES / 2 - leg * (1 - np.eye(3))) for sign in signs]))


def cut_corners(outline: np.ndarray, size: float, steps: int) -> list[tuple[float, float]]:
    """Each corner of an outline of right angles rounded to that radius in so many steps, or cut off in one."""
    found: list[tuple[float, float]] = []
    for before, here, after in zip(np.roll(outline, 1, 0), outline, np.roll(outline, -1, 0), strict=True):
        one, two = ((end - here) / np.linalg.norm(end - here) for end in (before, after))
        middle = here + size * (one + two)
        turns = np.linspace(0, np.pi / 2, steps + 1)
        found += [tuple(middle - size * (two * np.cos(t) + one * np.sin(t))) for t in turns]
    return found


def is_the_box(found: Drawing) -> bool:
    want = np.array(list(product((-1, 1), repeat=3))) * SIDES / 2
    near = np.linalg.norm(want[:, None] - found.solid.corners_mm, axis=2).min(axis=1)
    return bool(len(found.solid.corners_mm) == 8 and near.max() < 0.01 and found.solid.open_edges == 0)


@pytest.mark.parametrize("radius", [0.3, 0.8, 1.3])
def test_a_box_that_is_rounded_all_over_is_a_box(radius: float) -> None:
    found = rounded_box(radius)
    assert is_the_box(found)
    assert found.solid.types == ("rectangle",) * 6
    assert found.curved == ()
    (note,) = found.notes
    assert note.startswith("small fillets and chamfers (1 in all")


@pytest.mark.parametrize("leg", [0.2, 0.5, 0.8])
def test_a_box_with_all_edges_broken_is_a_box(leg: float) -> None:
    assert is_the_box(chamfered_box(leg))


@pytest.mark.parametrize("box", [rounded_box, chamfered_box])
def test_what_a_camera_can_see_stays(box: Callable[[float], Drawing]) -> None:
    found = box(4.0)
    assert found.notes == ()
    assert len(found.solid.corners_mm) == 24


@pytest.mark.parametrize(("size", "steps"), [(1.0, 1), (0.5, 6), (1.8, 6), (1.8, 12)])
def test_a_prism_whose_corners_are_cut_has_its_edges_hollow_and_not(size: float, steps: int) -> None:
    found = drawing(*drawn.prism(cut_corners(L_BLOCK, size, steps), 40))
    assert sorted(map(len, found.solid.facets)) == [4] * 6 + [6] * 2
    assert (len(found.solid.corners_mm), found.solid.open_edges, len(found.solid.smooth)) == (12, 0, 0)
    assert np.allclose(np.ptp(found.solid.corners_mm, axis=0), [60, 60, 40], atol=0.01)


def test_a_low_step_and_a_thin_plate_are_no_blends() -> None:
    step = [(0.0, 0.0), (60.0, 0.0), (60.0, 20.0), (30.0, 20.0), (30.0, 20.9), (0.0, 20.9)]
    found = drawing(*drawn.prism(step, 30))
    assert (len(found.solid.facets), found.notes) == (8, ())
    plate = drawing(*drawn.bored_block(60, 40, 1.0, 8.0, 36))
    assert (len(plate.solid.facets), plate.notes, [str(one) for one in plate.curved]) == (6, (), ["bore of 16 mm"])
