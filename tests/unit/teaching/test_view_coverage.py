"""Whether a part was shown well enough: what was never seen, and what it could be taken for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from daemon.teaching.trainer import Trainer
from daemon.teaching.view_coverage import (
    Mistake,
    ViewCoverage,
    assess_coverage,
    confusable_pairs,
    simulated_view,
    unconnected_facets,
    visible_facets,
)
from daemon.vision.geometry.polyhedron import Polyhedron
from daemon.vision.geometry.visibility import visible_from
from daemon.vision.model.aspect_sets import spread
from tests.fakes import drawn
from tests.fakes.taught import taught


def box(a: float, b: float, c: float, faces: int = 6) -> Polyhedron:
    corners, rings = drawn.box(a, b, c)
    spread_mm2 = np.repeat(0.01 * np.eye(3)[None], 8, axis=0)
    return Polyhedron(corners, tuple(rings[:faces]), spread_mm2, ("rectangle",) * faces)


def test_areas_of_a_closed_solid_cancel_and_open_edges_are_counted() -> None:
    assert np.allclose(box(50, 60, 70).areas_mm2.sum(axis=0), 0)
    assert box(50, 60, 70).open_edges == 0
    assert box(50, 60, 70, faces=5).open_edges == 4


def test_directions_are_unit_vectors_all_round() -> None:
    directions = spread(60)
    assert np.allclose(np.linalg.norm(directions, axis=1), 1)
    assert np.linalg.norm(directions.mean(axis=0)) < 0.02


def test_an_imagined_view_shows_the_facets_that_face_the_cameras(trainer: Trainer) -> None:
    towards = np.array([1.0, 1.0, 1.0]) / np.sqrt(3)
    view = simulated_view(box(50, 60, 70), towards, trainer.rig)
    assert view is not None
    assert len(view.facets) == 3
    assert view.touching.sum() == 6
    for facet in view.facets:
        corners = facet.corners_mm
        normal = np.cross(corners[1] - corners[0], corners[2] - corners[1])
        assert normal @ corners.mean(axis=0) < 0, "outward normals look towards the cameras"


def test_what_was_never_seen_and_what_it_could_be_taken_for_is_told(trainer: Trainer) -> None:
    taught(trainer, "cube", "pyramid")
    trainer.train()
    trainer.accept(trainer.model_store.candidate)
    cube = assess_coverage(trainer.model, "cube", trainer.rig)
    assert len(cube.facets) == 3
    assert cube.open_edges == 6
    assert 0.3 < cube.unseen < 0.6, "three of six sides are known"
    assert cube.turn_away is not None
    assert cube.named > 0
    alone = [mistake for mistake in cube.mistakes if mistake.facets == ("square",)]
    assert alone, "a single square is no proof of a cube"


def test_a_side_that_meets_none_of_the_others_is_told_from_what_lies_elsewhere(trainer: Trainer) -> None:
    """A bracket shown alone: its third side, whose edge no camera saw, was told to be something else's, and nobody was
    told what to do about it."""
    view = simulated_view(box(50, 60, 70), np.array([1.0, 1.0, 1.0]) / np.sqrt(3), trainer.rig)
    assert view is not None
    shown, lone = view.only([0, 1]), view.only([2])
    near = replace(lone.facets[0], corners_mm=lone.facets[0].corners_mm + 10.0)
    far = replace(near, corners_mm=near.corners_mm + 300.0)
    others = [replace(lone, facets=(facet,)) for facet in (far, near)]
    assert unconnected_facets(shown, others) == ([near], [far])
    assert unconnected_facets(shown, []) == ([], [])


def test_many_directions_at_once_see_what_each_alone_sees() -> None:
    solid = drawn.solid("l.obj", drawn.obj(*drawn.prism(drawn.L_BLOCK, 40)))
    directions = spread(50)
    seen = visible_from(solid, directions)
    assert [tuple(np.flatnonzero(row)) for row in seen] == [visible_facets(solid, towards) for towards in directions]
    assert 0 < seen.sum() < (directions @ solid.normals.T > 0.3).sum(), "one arm hides some of the step"


def test_two_parts_are_as_alike_as_the_view_of_most_facets_that_leaves_them_open() -> None:
    def one(label: str, *mistakes: Mistake) -> ViewCoverage:
        return ViewCoverage(label, ("square",) * 6, 0, 0.0, 0.5, mistakes, None)

    pairs = confusable_pairs(
        [
            one("a", Mistake(("a", "b"), ("square",), 9), Mistake(("unknown",), ("triangle",), 5)),
            one("b", Mistake(("a", "b", "c"), ("square", "square"), 2), Mistake(("a",), ("square", "square"), 4)),
        ]
    )
    assert [(p.labels, p.facets, p.viewpoints) for p in pairs] == [
        (("a", "b"), ("square", "square"), 4),
        (("b", "c"), ("square", "square"), 2),
    ]
