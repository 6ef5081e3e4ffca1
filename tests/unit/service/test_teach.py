"""Teaching: what is shown is learnt beside the model in use; what is still missing is said from the geometry."""

from __future__ import annotations

from pathlib import Path

import drawn
import numpy as np
import pytest
import rendered

from daemon.store.library import load_facets, load_parts
from daemon.store.model_store import ModelStore
from daemon.teaching.sufficiency import imagined_view, judge, open_edges, spread
from daemon.teaching.trainer import Trainer
from daemon.vision.geometry.polyhedron import Polyhedron
from daemon.vision.model.model import TeachError


def scenes(kind: str) -> list[Path]:
    found = sorted(rendered.ALL.glob(f"{kind}-B-*"))
    if not found:
        here = rendered.ALL
        pytest.skip(f"the scenes that parts are taught from are not here ({here}); FACETD_SHARED says where they are")
    return found


@pytest.fixture
def trainer(tmp_path: Path) -> Trainer:
    return Trainer(ModelStore(tmp_path), rendered.rig(rendered.HERE, "B"), load_facets(), load_parts())


def taught(trainer: Trainer) -> list[str]:
    labels = []
    for scene in scenes("train"):
        label = rendered.truth(scene)["objects"][0]["label"]
        trainer.store(label, *rendered.pair(scene), {})
        labels.append(label)
    return labels


def test_taught_views_make_a_candidate_and_the_model_in_use_is_not_touched(trainer: Trainer) -> None:
    labels = taught(trainer)
    assert [view.label for view in trainer.waiting()] == sorted(labels)
    before = trainer.in_use
    trained = trainer.train()
    assert trained.left_out == ()
    assert len(trained.verdicts) == len(labels)
    assert trainer.model.labels == ()
    assert before.labels == ()
    assert trainer.accept() == trained.version
    assert set(trainer.in_use.labels) == set(labels)
    assert trainer.waiting() == []
    again = Trainer(trainer.model_store, trainer.rig, trainer.library, trainer.parts)
    assert again.model.labels == trainer.model.labels, "a restart finds the model that was accepted"


def test_nothing_in_view_is_refused_with_what_to_do_and_nothing_is_kept(trainer: Trainer) -> None:
    grey = np.full((480, 640), 90, np.uint8)
    with pytest.raises(TeachError, match="no part is seen; put it where both cameras see it"):
        trainer.store("cube", grey, grey, {})
    assert trainer.model_store.views() == []
    with pytest.raises(TeachError, match="no views to train on"):
        trainer.train()


def test_a_view_that_can_no_longer_be_read_is_left_out_and_named(trainer: Trainer) -> None:
    taught(trainer)
    (trainer.model_store.views()[0].folder / "left.png").write_bytes(b"")
    trained = trainer.train()
    assert len(trained.left_out) == 1
    assert "not an image" in trained.left_out[0]


def box(a: float, b: float, c: float, faces: int = 6) -> Polyhedron:
    corners, rings = drawn.box(a, b, c)
    spread_mm2 = np.repeat(0.01 * np.eye(3)[None], 8, axis=0)
    return Polyhedron(corners, tuple(rings[:faces]), spread_mm2, ("rectangle",) * faces)


def test_areas_of_a_closed_solid_cancel_and_open_edges_are_counted() -> None:
    assert np.allclose(box(50, 60, 70).areas_mm2.sum(axis=0), 0)
    assert open_edges(box(50, 60, 70)) == 0
    assert open_edges(box(50, 60, 70, faces=5)) == 4


def test_directions_are_unit_vectors_all_round() -> None:
    directions = spread(60)
    assert np.allclose(np.linalg.norm(directions, axis=1), 1)
    assert np.linalg.norm(directions.mean(axis=0)) < 0.02


def test_an_imagined_view_shows_the_facets_that_face_the_cameras(trainer: Trainer) -> None:
    towards = np.array([1.0, 1.0, 1.0]) / np.sqrt(3)
    view = imagined_view(box(50, 60, 70), towards, trainer.rig)
    assert view is not None
    assert len(view.facets) == 3
    assert view.touching.sum() == 6
    for facet in view.facets:
        corners = facet.corners_mm
        normal = np.cross(corners[1] - corners[0], corners[2] - corners[1])
        assert normal @ corners.mean(axis=0) < 0, "outward normals look towards the cameras"


def test_what_was_never_seen_and_what_it_could_be_taken_for_is_told(trainer: Trainer) -> None:
    taught(trainer)
    trainer.train()
    trainer.accept()
    cube = judge(trainer.model, "cube", trainer.rig)
    assert len(cube.facets) == 3
    assert cube.open_edges == 6
    assert 0.3 < cube.unseen < 0.6, "three of six sides are known"
    assert cube.turn_away is not None
    assert cube.named > 0
    alone = [mistake for mistake in cube.mistakes if mistake.facets == ("square",)]
    assert alone, "a single square is no proof of a cube"
