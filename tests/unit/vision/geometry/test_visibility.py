"""Which facets a camera sees whole: what faces it, and is covered by nothing."""

from __future__ import annotations

import numpy as np
import pytest

from daemon.vision.geometry import encloses, visible_from
from tests.fakes import drawn

UP, ASLANT = np.array([0.0, 0, 1]), np.array([0.6, 0, 0.8])


def test_only_facets_that_face_the_camera_show() -> None:
    cube = drawn.block(50, 50, 50)
    shown = visible_from(cube, np.array([UP, ASLANT, -UP]))
    assert cube.normals[shown[0]] == pytest.approx(UP[None])
    assert sorted(map(tuple, cube.normals[shown[1]].round(6))) == [(0, 0, 1), (1, 0, 0)]
    assert cube.normals[shown[2]] == pytest.approx(-UP[None])


def test_another_thing_in_the_line_of_sight_covers_and_one_behind_or_beside_does_not() -> None:
    cube = drawn.block(50, 50, 50)
    middle = cube.corners_mm.mean(axis=0)
    sheet = middle + np.array([[-10.0, -10, 0], [10, -10, 0], [10, 10, 0], [-10, 10, 0]])
    corner = np.array([25.0, 25, 0])
    for at, covers in ((UP * 100 + corner, True), (UP * 100 - UP * 400, False), (UP * 100 + [200, 0, 0], False)):
        assert visible_from(cube, UP[None], beside=[sheet + at]).any() != covers


def test_what_lies_in_a_solid_with_a_hollow_edge_is_told_from_what_lies_in_its_notch() -> None:
    block = drawn.solid("l.obj", drawn.obj(*drawn.prism(drawn.L_BLOCK, 30)))
    outline, middle = np.array(drawn.L_BLOCK, float), block.corners_mm.mean(axis=0)
    shift = middle - [*outline.mean(axis=0), 15.0]
    points = shift + np.array([[10.0, 10, 15], [10, 55, 1], [55, 10, 29], [40, 40, 15], [10, 10, -1], [10, 10, 31]])
    assert encloses(block, points).tolist() == [True, True, True, False, False, False]
    assert encloses(block, points.reshape(2, 3, 3)).tolist() == [[True] * 3, [False] * 3]


def test_a_solid_without_its_bottom_still_encloses_what_lies_in_it() -> None:
    cube = drawn.block(50, 50, 50)
    lid = cube.only([k for k in range(6) if cube.normals[k, 2] > -0.5])
    inner, outer = np.array([[0.0, 0.0, 10.0], [0.0, 0.0, 60.0]]) + lid.centres_mm.mean(axis=0)
    assert encloses(lid, np.stack([inner, outer])).tolist() == [True, False]
