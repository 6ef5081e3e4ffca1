"""A part of which both cameras see one facet, and one camera another whole: its edges there prove the part."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from daemon import frames
from daemon.arrays import Array
from daemon.store.library import load_facets
from daemon.teaching.solid_from_mesh import solid_drawn
from daemon.vision.geometry import StereoRig, exact
from daemon.vision.geometry.polyhedron import SolidBatch
from daemon.vision.image import open_stereo
from daemon.vision.look import look
from daemon.vision.model import learn_solids
from daemon.vision.model.model import Model, empty_model
from daemon.vision.refine import count_visible_facets, edge_samples_of
from daemon.vision.refine.edge_pose import facets_in_view
from tests.fakes.chosen import few
from tests.fakes.drawn import obj
from tests.fakes.painted import paint_pair
from tests.fakes.rigs import rig
from tests.fakes.solids import CUBE, PYRAMID, TRIANGULAR, Body, pose, prism

Image = NDArray[np.uint8]
SOLID = exact(PYRAMID.corners_mm, PYRAMID.facets)
TURNS = np.radians(np.arange(-40.0, 40.5, 0.5))


@pytest.fixture(scope="module")
def model() -> Model:
    library = load_facets()
    bodies = {"pyramid": PYRAMID, "cube": CUBE, "triangular_prism": TRIANGULAR}
    drawn = [
        (name, solid_drawn(f"{name}.obj", obj(b.corners_mm, list(b.facets)), "mm", library))
        for name, b in bodies.items()
    ]
    return learn_solids(empty_model(library), [(name, solid, name) for name, solid in drawn])


@cache
def seen_by_one(camera: int) -> tuple[Array, Image, Image]:
    """The pyramid with one face towards the cameras, turned to where that camera sees a second whole and the other
    camera none."""
    blank = np.zeros(rig().image_size[::-1], np.uint8)
    images = open_stereo(blank, blank, rig())
    for turn in TURNS:
        where = pose(np.array([np.sin(turn), -np.cos(turn), 0.1]), np.pi / 2, 320.0)
        in_view = facets_in_view(SOLID, images, where)
        if in_view.all(0).sum() == 1 and in_view[camera].sum() == 2 and in_view[1 - camera].sum() == 1:
            return where, *paint_pair([(PYRAMID, where)], np.random.default_rng(3), rig())
    raise AssertionError("no such view")


def shown(body: Body, where: Array, pictures: tuple[Image, Image], by: StereoRig | None = None) -> int:
    solid, images = exact(body.corners_mm, body.facets), open_stereo(*pictures, by or rig())
    return count_visible_facets(
        solid, images, where, edge_samples_of(SolidBatch.of([solid]), images, where[None], 0.25)
    )


@pytest.mark.parametrize("camera", few([0, 1], 1))
def test_a_facet_that_one_camera_alone_sees_whole_proves_a_part(model: Model, camera: int) -> None:
    where, left, right = seen_by_one(camera)
    (part,) = look(left, right, rig(), model).parts
    assert part.recognition.label == "pyramid"
    assert shown(PYRAMID, where, (left, right)) == 2
    found = frames.apply(part.cyclopean_from_part, model.metric["pyramid"].solid.corners_mm)
    true = frames.apply(where, PYRAMID.corners_mm)
    assert np.linalg.norm(found[:, None] - true, axis=2).min(1).max() < 1.0


@pytest.mark.parametrize("camera", few([1, 0], 1))
def test_a_plate_like_its_one_face_lacks_what_that_camera_should_see(model: Model, camera: int) -> None:
    where, left, right = seen_by_one(camera)
    (face,) = np.flatnonzero(facets_in_view(SOLID, open_stereo(left, right, rig()), where).all(0)).tolist()
    plate = Body(PYRAMID.corners_mm, (PYRAMID.facets[face],))
    pictures = paint_pair([(plate, where)], np.random.default_rng(3), rig())
    assert not any(part.named for part in look(*pictures, rig(), model).parts)
    assert shown(PYRAMID, where, pictures) == 1


def test_facets_of_which_each_camera_sees_another_prove_nothing() -> None:
    """Seen along the ridge of a steep roof each camera has one side of it, and neither is measured."""
    roof = prism(np.array([[-10.0, 0.0], [10.0, 0.0], [0.0, 90.0]]), 50.0)
    where = pose(np.array([0.0, 1.0, 0.0]), np.pi / 2, 420.0)
    wide = rig(base_mm=200.0, turn_rad=0.23)
    pictures = paint_pair([(roof, where)], np.random.default_rng(3), wide)
    in_view = facets_in_view(exact(roof.corners_mm, roof.facets), open_stereo(*pictures, wide), where)
    assert in_view.any(1).all()
    assert not in_view.all(0).any()
    assert shown(roof, where, pictures, wide) == 0
