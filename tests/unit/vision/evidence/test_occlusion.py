"""What lies before a part hides its edges; what lies behind it, or is as far away, does not."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from daemon.arrays import Array
from daemon.store.library import load_facets
from daemon.vision.evidence import registered
from daemon.vision.evidence.counter_evidence import MOST_LIKELY_DUPLICATE, counter_evidence_of
from daemon.vision.evidence.edge_places import PLACES, edge_places
from daemon.vision.evidence.occlusion import hidden_places
from daemon.vision.evidence.registered import register_at
from daemon.vision.geometry import exact
from daemon.vision.hypotheses import EdgeHypothesis, Search, edge_distances
from daemon.vision.image import StereoImages, open_stereo
from daemon.vision.model import empty_model, learn_view
from daemon.vision.recognition import recognise_group
from tests.fakes import painted
from tests.fakes.printed import straight_rig
from tests.fakes.solids import Body, pose, prism, view_of

BLOCK = prism(np.array([[0.0, 0], [60, 0], [60, 45], [0, 45]]), 40.0)
WHERE = pose(np.array([-0.5, 0.3, 0.8]), 0.3, 330.0)
FLAT = prism(np.array([[0.0, 0], [40, 0], [40, 40], [0, 40]]), 4.0)
PLATE = Body(FLAT.corners_mm, FLAT.facets[1:] + FLAT.facets[:1])  # of another grey than the block is

OUTSIDE = np.array([[0.0, 0, 0, 900], [0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0]])


def plate(nearer_mm: float) -> Array:
    """Over a corner of the block, so much nearer than its middle, turned a little."""
    middle = BLOCK.corners_mm.mean(0) @ WHERE[:3, :3].T + WHERE[:3, 3]
    there = pose(np.array([0.05, 0.1, 1.0]), 0.4, 330.0)
    towards = middle / np.linalg.norm(middle)
    aside = np.array([-30.0, 36.0, 0.0]) - there[:3, :3] @ PLATE.corners_mm.mean(0)
    there[:3, 3] = middle + aside - nearer_mm * towards
    return there


@cache
def images_of(nearer_mm: float) -> StereoImages:
    bodies: list[tuple[Body, Array]] = [(BLOCK, WHERE), (PLATE, plate(nearer_mm))]
    bodies = bodies if nearer_mm > 0 else bodies[::-1]
    return open_stereo(*painted.paint_pair(bodies, np.random.default_rng(3), straight_rig()), straight_rig())


def hidden(images: StereoImages) -> tuple[float, float]:
    """The shares of the block's places where no edge shows, of all, and of those that something nearer hides."""
    solid = exact(BLOCK.corners_mm, BLOCK.facets)
    missing = covered = every = 0
    for one, seen in enumerate(edge_places(solid, WHERE, images)):
        hides = hidden_places(solid, WHERE, images, one, seen.visible, seen.there)
        assert not (hides & (seen.there | ~seen.visible)).any()
        missing, covered, every = (
            missing + (seen.visible & ~seen.there).sum(),
            covered + hides.sum(),
            every + seen.visible.sum(),
        )
    return missing / every, covered / max(missing, 1)


def test_edges_behind_something_nearer_are_hidden_and_do_not_speak_against_a_part() -> None:
    missing, covered = hidden(images_of(70.0))
    assert missing > 0.05
    assert covered > 0.7
    against = counter_evidence_of(exact(BLOCK.corners_mm, BLOCK.facets), WHERE, images_of(70.0))
    assert against.duplicate < MOST_LIKELY_DUPLICATE


def test_what_touches_a_part_hides_its_edges_where_its_own_run_on_across_them() -> None:
    """So near to the part both cameras have its edges as far apart as those of the part."""
    missing, covered = hidden(images_of(3.0))
    assert missing > 0.05
    assert covered > 0.7


def test_the_edges_of_a_longer_part_run_on_and_hide_nothing_of_a_shorter_one() -> None:
    longer = prism(np.array([[0.0, 0], [60, 0], [60, 60], [0, 60]]), 40.0)
    images = open_stereo(
        *painted.paint_pair([(longer, WHERE)], np.random.default_rng(3), straight_rig()), straight_rig()
    )
    missing, covered = hidden(images)
    assert missing > 0.05
    assert covered < 0.1


@pytest.mark.parametrize("aside_mm", [0.0, 150.0, -150.0, 400.0])
def test_a_part_that_one_camera_or_neither_sees_is_asked_like_any_other(aside_mm: float) -> None:
    images, model = images_of(70.0), learn_view(empty_model(load_facets()), view_of(BLOCK, WHERE), "block")
    search = Search(images, model, (), (), (edge_distances(images.left), edge_distances(images.right)), None)
    there = recognise_group(view_of(BLOCK, WHERE), model).part.cyclopean_from_part.copy()
    there[0, 3] += aside_mm
    (registered_part,) = register_at(search, [EdgeHypothesis("block", there)])
    asked = registered_part.without_hidden()
    for before, after in zip(registered_part.seen, asked.seen, strict=True):
        assert (after.visible <= before.visible).all()
    if aside_mm == 0.0:
        assert asked.odds > registered_part.odds
    else:
        assert asked.odds >= registered_part.odds - 1e-9


def test_of_a_part_outside_a_picture_nothing_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    images, model = images_of(70.0), learn_view(empty_model(load_facets()), view_of(BLOCK, WHERE), "block")
    search = Search(images, model, (), (), (edge_distances(images.left), edge_distances(images.right)), None)
    everything = np.ones((len(model.metric["block"].solid.lines[0]), PLACES), bool)
    monkeypatch.setattr(registered, "hidden_of", lambda *_: (everything, everything))
    (registered_part,) = register_at(search, [EdgeHypothesis("block", WHERE + OUTSIDE)])
    assert [len(seen.visible) for seen in registered_part.without_hidden().seen] == [0, 0]


def test_what_lies_behind_a_part_hides_nothing_of_it() -> None:
    assert hidden(images_of(-70.0)) == pytest.approx((0.0, 0.0), abs=0.02)


def test_a_corner_that_is_not_there_is_hidden_by_nothing() -> None:
    cut = prism(np.array([[0.0, 0], [60, 0], [60, 45], [18, 45], [0, 27]]), 40.0)
    images = open_stereo(*painted.paint_pair([(cut, WHERE)], np.random.default_rng(3), straight_rig()), straight_rig())
    missing, covered = hidden(images)
    assert missing > 0.05
    assert covered < 0.2
    assert counter_evidence_of(exact(BLOCK.corners_mm, BLOCK.facets), WHERE, images).duplicate > MOST_LIKELY_DUPLICATE
