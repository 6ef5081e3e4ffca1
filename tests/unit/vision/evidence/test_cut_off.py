"""Parts that leave the picture: named where what is in view proves them, and silent where they could be longer."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from daemon import frames
from daemon.store.library import load_facets
from daemon.teaching.solid_from_mesh import solid_drawn
from daemon.vision.evidence import by_edges
from daemon.vision.evidence.competing import LEAST_APART, lead_over_other_lengths, leaves_a_picture
from daemon.vision.evidence.photo_consistency import face_consistency
from daemon.vision.geometry import StereoRig, exact
from daemon.vision.geometry.polyhedron import SolidBatch
from daemon.vision.image import StereoImages, open_stereo
from daemon.vision.look import look
from daemon.vision.model import learn_solid
from daemon.vision.model.model import Model, empty_model
from daemon.vision.recognition import group_recognition
from daemon.vision.refine.edge_pose import facets_in_view
from daemon.vision.refine.edge_samples import edge_samples_of
from tests.fakes.drawn import box, obj
from tests.fakes.printed import print_pair, straight_rig
from tests.fakes.solids import Body, pose

BOX = solid_drawn("box.obj", obj(*box(70.0, 45.0, 40.0)), "mm", load_facets())
CORNER_FIRST, END_ON = pose(np.array([0.75, 0.35, 0.6]), 0.3, 330.0), pose(np.array([0.05, 0.75, 0.65]), 0.05, 330.0)


@cache
def model() -> Model:
    return learn_solid(empty_model(load_facets()), BOX, "box")


def shown(where, cut_px: int):
    """The box, and so much of both pictures cut away on the left."""
    body = Body(BOX.corners_mm, BOX.facets)
    left, right = (np.ascontiguousarray(image[:, cut_px:]) for image in print_pair(body, where, 3, printed=False))
    whole = straight_rig()
    images = []
    for camera in (whole.left, whole.right):
        matrix = camera.matrix.copy()
        matrix[0, 2] -= cut_px
        images.append(replace(camera, matrix=matrix))
    return (left, right), StereoRig(images[0], images[1], (whole.image_size[0] - cut_px, whole.image_size[1]))


def seen_at(where, rig: StereoRig):
    """(2, K, 2) where both cameras have the box's corners."""
    return np.stack([camera.project(frames.apply(where, BOX.corners_mm)) for camera in (rig.left, rig.right)])


def cut_by(where, share: float) -> int:
    """What to cut away for the camera that loses most of the box to lose such a share of its width."""
    across = seen_at(where, straight_rig())[..., 0]
    return int((across.min(1) + share * np.ptp(across, axis=1)).min())


def both(where, share: float) -> StereoImages:
    pictures, rig = shown(where, cut_by(where, share))
    return open_stereo(pictures[0], pictures[1], rig)


@pytest.mark.parametrize("share", [0.06, 0.15])
def test_a_part_of_which_a_corner_leaves_the_picture_is_named(share: float) -> None:
    pictures, rig = shown(CORNER_FIRST, cut_by(CORNER_FIRST, share))
    (part,) = [one for one in look(pictures[0], pictures[1], rig, model()).parts if one.named]
    off = frames.apply(part.cyclopean_from_part, model().metric["box"].solid.corners_mm)
    true = frames.apply(CORNER_FIRST, BOX.corners_mm)
    assert np.linalg.norm(off[:, None] - true, axis=2).min(1).max() < 1.5


def test_a_part_that_could_be_longer_outside_the_picture_is_not_named() -> None:
    pictures, rig = shown(END_ON, cut_by(END_ON, 0.25))
    assert not any(one.named for one in look(pictures[0], pictures[1], rig, model()).parts)


def test_what_leaves_a_picture_is_open_in_size_only_where_no_edge_along_it_ends_in_view() -> None:
    for where, share, open_size in ((CORNER_FIRST, 0.06, False), (END_ON, 0.25, True), (END_ON, 0.0, False)):
        images = both(where, share)
        laid = SolidBatch.of([BOX])
        seen = [one.only(0, laid) for one in edge_samples_of(laid, images, where[None], 0.4)]
        assert leaves_a_picture(BOX, where, images) is (share > 0)
        assert (lead_over_other_lengths(BOX, where, seen, images, 0.4) < LEAST_APART) is open_size


def test_a_facet_that_is_mostly_outside_the_picture_is_not_in_view() -> None:
    whole, most_gone = both(END_ON, 0.0), both(END_ON, 0.7)
    assert facets_in_view(BOX, whole, END_ON).all(0).sum() == 2
    assert not facets_in_view(BOX, most_gone, END_ON).all(0).any()


def test_print_outside_the_picture_says_nothing() -> None:
    body = Body(BOX.corners_mm, BOX.facets)
    left, right = print_pair(body, CORNER_FIRST, 3)
    cut = cut_by(CORNER_FIRST, 0.3)
    _, rig = shown(CORNER_FIRST, cut)
    printed = open_stereo(np.ascontiguousarray(left[:, cut:]), np.ascontiguousarray(right[:, cut:]), rig)
    alike = face_consistency(exact(BOX.corners_mm, BOX.facets), CORNER_FIRST, printed)
    assert alike is not None
    assert alike > 0.9


def test_the_name_of_a_part_that_leaves_the_picture_must_be_surer(monkeypatch: pytest.MonkeyPatch) -> None:
    pictures, rig = shown(CORNER_FIRST, cut_by(CORNER_FIRST, 0.15))
    monkeypatch.setattr(group_recognition, "MIN_PROBABILITY", 1.1)  # facets name nothing
    assert any(one.named for one in look(pictures[0], pictures[1], rig, model()).parts)
    monkeypatch.setattr(by_edges, "LEAST_CUT_OFF", 1.1)
    assert not any(one.named for one in look(pictures[0], pictures[1], rig, model()).parts)
