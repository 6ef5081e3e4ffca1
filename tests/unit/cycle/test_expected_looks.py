"""On the approach only the expected part is looked for, by its edges; the rest is looked for when it counts."""

import asyncio
from types import SimpleNamespace

import numpy as np
from cell_fakes import TruthSight, World, build, rig, shape_of

from daemon import frames
from daemon.arm.workcell import Reading
from daemon.pick.following import expected_fit, expected_scene
from daemon.pick.looking import Settling, epipolar_px, take_look, whole_look
from daemon.vision.registration.corner_pose import Fit
from daemon.vision.report import scene_json

POSE = frames.rigid(frames.rotation_from_vector(np.array([2.6, 0.4, 0.3])), np.array([5.0, -8.0, 300.0]))
FIT = Fit(POSE, np.diag([0.1, 0.1, 0.3, 1e-5, 1e-5, 1e-5]), 0.1, 9)


def taken(expect):
    world = World(np.random.default_rng(0))
    world.put("cube", 520, 0, 0.3)
    cell, sight = build(world), TruthSight(world)

    async def story():
        reading = Reading(world.at, np.zeros(6))
        look = await take_look(cell, sight, reading, 0.0, Settling(), -300.0, expect)
        return look, await whole_look(sight, look)

    return asyncio.run(story())


def test_what_was_expected_and_found_is_all_that_is_looked_for_until_the_whole_look_is_asked_for():
    expected = expected_scene("pyramid", shape_of("pyramid"), 0.9, FIT, rig())
    look, whole = taken(lambda left, right, at: expected)
    assert (look.whole, look.scene) == (False, expected)
    assert whole.whole
    assert whole.scene is not expected
    assert whole.taken_s == look.taken_s


def test_where_the_expected_is_not_found_everything_is_looked_for():
    look, whole = taken(lambda left, right, at: None)
    assert look.whole
    assert whole is look


def test_a_part_found_again_is_told_as_the_facets_that_face_the_cameras():
    shape = shape_of("cube")
    scene = expected_scene("cube", shape, 0.9, FIT, rig())
    (part,) = scene.parts
    told = scene_json(scene)["parts"][0]
    assert told["label"] == "cube"
    assert 1 <= len(part.facets) <= 3
    for facet in part.facets:
        np.testing.assert_allclose(rig().left.project(facet.corners_mm), facet.left_px)
        assert np.cross(*np.diff(facet.corners_mm[:3], axis=0)) @ facet.corners_mm.mean(axis=0) < 0
        assert (np.linalg.eigvalsh(facet.covariance_mm2) > 0).all()
    assert np.isnan(epipolar_px(scene))
    again = expected_fit(SimpleNamespace(scene=scene))
    np.testing.assert_array_equal(again.cyclopean_from_part, POSE)
    np.testing.assert_array_equal(again.covariance, FIT.covariance)
