"""Named parts are moved to where their edges are; what has no name, or shows other edges, stays as it was measured."""

import numpy as np

from daemon import frames
from daemon.store.library import load_facets
from daemon.vision.geometry.polyhedron import exact
from daemon.vision.image.stereo_images import open_stereo
from daemon.vision.model.merge import MetricModel
from daemon.vision.model.model import Model
from daemon.vision.refine.edge_adjustment import refined_parts
from daemon.vision.values import UNKNOWN, Part, Recognition
from tests.fakes.painted import paint_pair
from tests.fakes.rigs import rig
from tests.fakes.solids import CUBE, PYRAMID, pose

WHERE = pose(np.array([0.75, 0.25, 0.6]), 0.3, 300.0)
SHAPE = exact(CUBE.corners_mm, CUBE.facets)
MODEL = Model(load_facets(), metric={"cube": MetricModel(SHAPE, (0,))})
QUARTER = frames.rigid(frames.rotation_from_vector(np.array([0.0, 0.0, np.pi / 2])), np.zeros(3))
OFF = np.array([0.3, -0.2, 0.8, 0.003, -0.004, 0.002])


def cube_at(where, label="cube", sigma_mm=0.6):
    """A cube as recognition hands it on, two of its facets measured, each of them where this pose has it."""
    facing = np.argsort(-SHAPE.facing(where))[:2]
    fitted = tuple(frames.apply(where, SHAPE.corners_mm[SHAPE.rings[k]]) for k in facing)
    covariance = np.diag([sigma_mm**2] * 3 + [np.radians(0.5) ** 2] * 3)
    taken = Recognition(label, 1.0, 1.0, 1.0, None, False, "")
    return Part(taken, (), where, covariance, 0.3, fitted, np.stack([where, where @ QUARTER]))


def images_of(body):
    return open_stereo(*paint_pair([(body, WHERE)], np.random.default_rng(5), rig()), rig())


def test_a_named_part_is_moved_to_its_edges_with_its_corners_and_all_it_may_equally_be():
    images, thought = images_of(CUBE), cube_at(frames.perturb(WHERE, OFF))
    (found,) = refined_parts([thought], MODEL, images)
    assert np.linalg.norm(frames.difference(found.cyclopean_from_part, WHERE)[:3]) < 0.25
    truth = frames.apply(WHERE, CUBE.corners_mm)
    for corner in np.concatenate(found.fitted_mm):
        assert np.linalg.norm(truth - corner, axis=1).min() < 0.3
    assert np.allclose(found.equivalents[0], found.cyclopean_from_part)
    assert np.allclose(found.equivalents[1], found.cyclopean_from_part @ QUARTER)
    assert np.trace(found.covariance[:3, :3]) < np.trace(thought.covariance[:3, :3])


def test_what_has_no_name_stays_as_it_was_measured():
    thought = cube_at(frames.perturb(WHERE, OFF), UNKNOWN)
    assert refined_parts([thought], MODEL, images_of(CUBE)) == (thought,)


def test_a_part_whose_edges_are_another_s_stays_as_it_was_measured():
    thought = cube_at(frames.perturb(WHERE, OFF), sigma_mm=0.1)
    assert refined_parts([thought], MODEL, images_of(PYRAMID)) == (thought,)
