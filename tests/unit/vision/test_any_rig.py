"""Whatever two cameras stand in, a look is of bounded work and memory, or says at once that they give no depth."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from daemon import frames
from daemon.store.library import load_facets
from daemon.teaching.solid_from_mesh import solid_drawn
from daemon.vision.geometry import StereoRig
from daemon.vision.hypotheses import directional_edge_map
from daemon.vision.image import VisionError, open_stereo, stretch_slopes
from daemon.vision.look import look
from daemon.vision.model import learn_solid
from daemon.vision.model.model import Model, empty_model
from daemon.vision.refine import edge_samples
from tests.fakes.drawn import box, obj
from tests.fakes.printed import print_pair, straight_rig
from tests.fakes.solids import CUBE, pose

IMAGES = 100
"""No look may take more memory than so many of its pictures, nor read maps of segments and slopes at more places."""
PAIR = print_pair(CUBE, pose(np.array([0.75, 0.35, 0.6]), 0.3, 330.0), 3)


@pytest.fixture(scope="module")
def model() -> Model:
    drawing = solid_drawn("box.obj", obj(*box(60.0, 45.0, 30.0)), "mm", load_facets())
    return learn_solid(empty_model(load_facets()), drawing, "box")


def moved_anywhere(rng: np.random.Generator) -> StereoRig:
    """One camera, then moved any way and turned by up to 25 degrees about anything: in axes of the baseline, as
    moved_rig has them."""
    own = straight_rig()
    ahead = rng.normal(size=3)
    x = ahead / np.linalg.norm(ahead)
    y = np.cross([0.0, 0.0, 1.0], x)
    y /= np.linalg.norm(y)
    first = np.stack([x, y, np.cross(x, y)])
    axis = rng.normal(size=3)
    turn = frames.rotation_from_vector(np.radians(rng.uniform(0, 25)) * axis / np.linalg.norm(axis))
    half = np.array([rng.uniform(5, 75), 0.0, 0.0])
    left, right = frames.rigid(first, -half), frames.rigid(first @ turn, half)
    images = [replace(own.left, cyclopean_from_camera=place) for place in (left, right)]
    return StereoRig(images[0], images[1], own.image_size)


def test_a_look_through_any_rig_is_bounded_by_its_pictures(model: Model, monkeypatch: pytest.MonkeyPatch) -> None:
    places = 0
    hits, slopes = directional_edge_map.DirectionalEdgeMap.hits, stretch_slopes

    def counted_hits(seen, way, x, y):
        nonlocal places
        places += x.size
        return hits(seen, way, x, y)

    def counted_slopes(*asked):
        nonlocal places
        found = slopes(*asked)
        places += found.size
        return found

    monkeypatch.setattr(directional_edge_map.DirectionalEdgeMap, "hits", counted_hits)
    monkeypatch.setattr(edge_samples, "stretch_slopes", counted_slopes)
    rng, refused = np.random.default_rng(6), 0
    rigs = [straight_rig(), *(moved_anywhere(rng) for _ in range(8))]
    tracemalloc.start()
    try:
        for rig in rigs:
            places = 0
            tracemalloc.reset_peak()
            before = tracemalloc.get_traced_memory()[0]
            try:
                look(*PAIR, rig, model)
            except VisionError:
                refused += 1
            assert tracemalloc.get_traced_memory()[1] - before < IMAGES * PAIR[0].size
            assert places < IMAGES * PAIR[0].size
    finally:
        tracemalloc.stop()
    assert 2 < refused < 7


def test_a_rig_that_looks_along_its_baseline_is_refused_at_once() -> None:
    own = straight_rig()
    forward = [replace(own.left, cyclopean_from_camera=frames.rigid(np.eye(3)[[2, 1, 0]] * [[1], [1], [-1]], at))
               for at in (np.array([-30.0, 0, 0]), np.array([30.0, 0, 0]))]  # fmt: skip
    with pytest.raises(
        VisionError, match=r"left image: the camera looks along the line between the two cameras .* move it sideways"
    ):
        open_stereo(*PAIR, StereoRig(forward[0], forward[1], own.image_size))


@pytest.mark.parametrize("size", [(640, 480), (3840, 2160), (480, 6000)])
def test_a_map_is_never_much_larger_than_its_image(size: tuple[int, int]) -> None:
    for wide in ([1.0, 0.8], [5.0, 4.0], [0.4, 30.0], [1e4, 1e4]):
        scale = directional_edge_map.map_scale(600.0 / directional_edge_map.SHRINK, np.array(wide), size[::-1])
        width, height = np.array(wide) * scale
        assert (
            width * height <= 1.01 * directional_edge_map.LARGEST * size[0] * size[1] / directional_edge_map.SHRINK**2
        )
        assert (height + directional_edge_map.ROOM) * directional_edge_map.DIRECTIONS <= directional_edge_map.MOST_ROWS
