"""Two cameras: rays that meet, polygons that match, corners that settle, and the thesis's formula beside them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from daemon import frames
from daemon.arrays import Array
from daemon.vision.facets.grouping import lying_under
from daemon.vision.facets.one_look.candidates import PolygonMatch, in_both, match_polygons, outlines_of
from daemon.vision.facets.one_look.corner_adjustment import EdgeObservations, solve_corners
from daemon.vision.facets.one_look.reconstruct import find_facets
from daemon.vision.geometry.rig import Camera, StereoRig, baseline
from daemon.vision.image.stereo_images import open_stereo
from daemon.vision.settings import VisionSettings
from daemon.vision.thesis import by_formula, converging
from daemon.vision.values import Facet, FacetView
from tests.fakes.limit import limit
from tests.fakes.painted import paint_pair
from tests.fakes.rigs import rig
from tests.fakes.solids import CUBE, KNOWN, pose, seen_facets

DIRECTION = np.array([1.0, 0.45, 0.8])


def tilted_rig() -> StereoRig:
    """A rig whose cameras stand at different heights and depths, as a real one may."""
    turn = frames.rotation_from_vector(np.array([0.03, 0.09, -0.02]))
    left = Camera(rig().left.matrix, rig().left.distortion, frames.rigid(turn, np.array([-29.0, 1.5, -0.7])))
    return StereoRig(left, rig().right, (640, 480))


@pytest.mark.parametrize("stereo", [rig(), tilted_rig()], ids=["as designed", "askew"])
@given(st.floats(-60, 60), st.floats(-60, 60), st.floats(200, 900))
@settings(max_examples=25, deadline=None)
def test_a_point_seen_by_both_cameras_is_where_it_was(stereo: StereoRig, x: float, y: float, z: float) -> None:
    both = baseline(stereo)
    point = np.array([[x, y, z]])
    left, right = both.left.ideal(stereo.left.project(point)), both.right.ideal(stereo.right.project(point))
    assert left[0, 1] == pytest.approx(right[0, 1], abs=1e-6)
    assert both.points(left, right) == pytest.approx(point, abs=2e-3)
    again_left, again_right = both.project(point)
    assert again_left == pytest.approx(left, abs=1e-6)
    assert both.right.pixels(again_right) == pytest.approx(stereo.right.project(point), abs=1e-3)


def test_the_thesis_formula_is_right_at_the_fixation_point_and_compensation_helps_off_it() -> None:
    stereo = rig()
    constants = converging(stereo)
    at = np.array([[0.0, 0.0, constants.fixation_mm]])
    assert by_formula(stereo.left.project(at), stereo.right.project(at), stereo, constants) == pytest.approx(
        at, abs=1.5
    )
    off = np.array([[0.0, 0.0, 0.62 * constants.fixation_mm]])
    px = stereo.left.project(off), stereo.right.project(off)
    bare = abs(by_formula(*px, stereo, constants)[0, 2] - off[0, 2])
    mended = abs(by_formula(*px, stereo, constants, compensated=True)[0, 2] - off[0, 2])
    assert mended < 0.3 * bare


def test_polygons_match_whatever_corner_and_order_they_come_in() -> None:
    stereo = rig()
    both = baseline(stereo)
    corners = frames.apply(pose(DIRECTION, 0.3), CUBE.corners_mm)
    facets = [corners[list(CUBE.facets[k])] for k in seen_facets(CUBE, pose(DIRECTION, 0.3))]
    left = [stereo.left.project(f) for f in facets]
    right = [np.roll(stereo.right.project(f), k + 1, axis=0) for k, f in enumerate(facets)][::-1]
    best: dict[int, PolygonMatch] = {}
    for m in match_polygons(left, right, both, VisionSettings()):
        best.setdefault(m.left, m)
    assert [best[k].right for k in range(len(left))] == [len(left) - 1 - k for k in range(len(left))]
    for k, m in best.items():
        again = np.roll(right[m.right], -m.shift, axis=0)
        assert again == pytest.approx(stereo.right.project(facets[k]), abs=1e-9)


def pulls_of(points: Array, ring: NDArray[np.intp], shift: float) -> Array:
    """(N, 3) exact side lines of one facet in one camera of a rig in its own baseline frame."""
    ideal = np.stack([(points[:, 0] + shift) / points[:, 2], points[:, 1] / points[:, 2]], 1)
    start, end = ideal[ring], ideal[np.roll(ring, -1)]
    chord = end - start
    normal = np.stack([-chord[:, 1], chord[:, 0]], 1) / np.linalg.norm(chord, axis=1)[:, None]
    return np.concatenate([normal, -np.sum(normal * start, 1)[:, None]], 1)


@given(st.integers(0, 10_000))
@settings(max_examples=8, deadline=None)
def test_corners_settle_where_exact_sides_put_them(seed: int) -> None:
    both = baseline(rig())
    rng = np.random.default_rng(seed)
    corners = frames.apply(pose(rng.normal(size=3), rng.uniform(0, 6)), CUBE.corners_mm[list(CUBE.facets[1])])
    ring = np.arange(4)
    lines = np.stack([pulls_of(corners, ring, s * both.length_mm / 2) for s in (1, -1)])
    ends, whiten = np.stack([ring, np.roll(ring, -1)], 1), np.tile(700 / 0.05 * np.eye(2), (2, 4, 1, 1))
    seen = EdgeObservations(ends, lines, whiten, np.ones(4))
    solid = solve_corners(corners + rng.normal(0, 0.5, corners.shape), seen, [ring], both)
    depths = np.abs(solid.corners_mm - corners)
    assert depths.max() < 0.05 + 3 * np.sqrt(np.trace(solid.covariance_mm2, axis1=1, axis2=2).max())
    assert solid.misfit < 0.1


def errors_mm(view: FacetView, corners_mm: Array) -> Array:
    seen = np.vstack([f.corners_mm for g in view.groups for f in g.facets])
    return np.asarray(np.linalg.norm(seen[:, None] - corners_mm[None], axis=2).min(1))


@pytest.mark.parametrize("label", list(KNOWN))
def test_a_painted_part_is_seen_whole_and_to_a_fraction_of_a_millimetre(label: str) -> None:
    body = KNOWN[label]
    where = pose(DIRECTION, 0.4, 340.0)
    view = find_facets(*paint_pair([(body, where)], np.random.default_rng(5)), rig())
    assert len(view.groups) == 1
    assert len(view.groups[0].facets) == len(seen_facets(body, where))
    assert np.median(errors_mm(view, frames.apply(where, body.corners_mm))) < 0.2
    assert errors_mm(view, frames.apply(where, body.corners_mm)).max() < 1.0


def test_all_corners_run_so_that_the_normal_looks_at_the_cameras() -> None:
    view = find_facets(*paint_pair([(CUBE, pose(DIRECTION, 0.4))], np.random.default_rng(6)), rig())
    for facet in view.groups[0].facets:
        p = facet.corners_mm
        normal = np.cross(p - p[0], np.roll(p, -1, axis=0) - p[0]).sum(0)
        assert normal @ p.mean(0) < 0


def test_mirrored_cameras_give_mirrored_answers() -> None:
    stereo = rig()
    where = pose(np.array([1.0, 0.8, 0.9]), 0.4, 340.0)
    left, right = paint_pair([(CUBE, where)], np.random.default_rng(7), stereo)
    straight = find_facets(left, right, stereo)
    mirrored = find_facets(right[:, ::-1].copy(), left[:, ::-1].copy(), mirrored_rig(stereo))
    one, other = corners_of(straight), corners_of(mirrored) * [-1.0, 1.0, 1.0]
    assert len(one) == len(other)
    away = np.linalg.norm(one[:, None] - other[None], axis=2).min(1)
    assert away.max() < 0.15


def mirrored_rig(stereo: StereoRig) -> StereoRig:
    """The rig as a mirror in the plane x = 0 shows it, its stereo flipped left to right."""
    flip = np.diag([-1.0, 1.0, 1.0])

    def camera(camera: Camera) -> Camera:
        matrix = camera.matrix.copy()
        matrix[0, 2] = stereo.image_size[0] - 1 - matrix[0, 2]
        k1, k2, p1, p2, k3 = camera.distortion
        turn, place = camera.cyclopean_from_camera[:3, :3], camera.cyclopean_from_camera[:3, 3]
        return Camera(matrix, np.array([k1, k2, p1, -p2, k3]), frames.rigid(flip @ turn @ flip, flip @ place))

    return StereoRig(camera(stereo.right), camera(stereo.left), stereo.image_size)


def corners_of(view: FacetView) -> Array:
    return np.vstack([f.corners_mm for g in view.groups for f in g.facets])


def test_two_parts_apart_are_two_groups() -> None:
    near, far = pose(DIRECTION, 0.4, 330.0), pose(DIRECTION, 1.0, 380.0)
    near[0, 3], far[0, 3] = -45.0, 50.0
    view = find_facets(*paint_pair([(CUBE, far), (KNOWN["pyramid"], near)], np.random.default_rng(8)), rig())
    assert len(view.groups) == 2
    assert view.groups[0].facets[0].corners_mm[:, 2].mean() < view.groups[1].facets[0].corners_mm[:, 2].mean()


@pytest.mark.parametrize("detector", ["mic", "median"])
@pytest.mark.parametrize("formula", ["thesis", "thesis_compensated"])
def test_the_thesis_ways_stay_selectable_and_come_near(detector: str, formula: str) -> None:
    where = pose(DIRECTION, 0.4, 340.0)
    chosen = VisionSettings(corner_detector=detector, stereo_formula=formula)  # type: ignore[arg-type]
    view = find_facets(*paint_pair([(CUBE, where)], np.random.default_rng(9)), rig(), chosen)
    assert np.median(errors_mm(view, frames.apply(where, CUBE.corners_mm))) < 15.0


def test_the_limit_meter_says_how_near_the_corners_come_to_what_is_possible() -> None:
    view = find_facets(*paint_pair([(CUBE, pose(DIRECTION, 0.4))], np.random.default_rng(10)), rig())
    reading = limit(view)
    assert reading is not None
    assert 0.002 < reading.bound_px < 0.1
    assert reading.ratio > 0.5
    assert reading.noise_sigma == pytest.approx(2.0, rel=0.25)
    assert reading.blur_px == pytest.approx(0.7, abs=0.2)


def test_an_empty_view_has_no_limit() -> None:
    assert limit(FacetView((), (), (), (), 2.0)) is None


def test_a_facet_carries_its_own_uncertainty() -> None:
    where = pose(DIRECTION, 0.4, 340.0)
    truth = frames.apply(where, CUBE.corners_mm)
    edge_observations = []
    for seed in range(3):
        view = find_facets(*paint_pair([(CUBE, where)], np.random.default_rng(seed)), rig())
        for facet in (f for g in view.groups for f in g.facets):
            edge_observations += [pull(facet, k, truth) for k in range(len(facet.corners_mm))]
    assert 0.2 < np.median(edge_observations) < 2.0


def pull(facet: Facet, corner: int, truth: Array) -> float:
    error = facet.corners_mm[corner] - truth[np.argmin(np.linalg.norm(truth - facet.corners_mm[corner], axis=1))]
    return float(np.sqrt(error @ np.linalg.solve(facet.covariance_mm2[corner], error) / 3))


def lying(corners_mm: Array) -> Facet:
    """A facet with those corners, known to 0.3 mm."""
    n = len(corners_mm)
    px = np.zeros((n, 2))
    return Facet(corners_mm, np.repeat(0.09 * np.eye(3)[None], n, 0), px, px, np.zeros(n), 0.0)


def test_a_shadow_that_the_part_stands_on_is_told_from_its_faces() -> None:
    where = pose(DIRECTION, 0.4)
    solid = frames.apply(where, CUBE.corners_mm)
    faces = [lying(solid[list(CUBE.facets[k])]) for k in seen_facets(CUBE, where)]
    shadow = np.array([[-25.0, -25, 0], [25, -25, 0], [60, -70, 0], [-10, -70, 0]])
    assert lying_under(faces) == ()
    assert lying_under([*faces, lying(frames.apply(where, shadow))]) == (len(faces),)


def test_the_shadows_of_two_lamps_are_told_from_a_flat_part_s_faces() -> None:
    """As many corners lie on the table as rise from it: a pyramid from above."""
    where = pose(np.array([0.1, 0.05, 1.0]), 0.0)
    solid = frames.apply(where, KNOWN["pyramid"].corners_mm)
    faces = [lying(solid[list(KNOWN["pyramid"].facets[k])]) for k in seen_facets(KNOWN["pyramid"], where)]
    left, right = (
        np.array([[-25.0, 25, 0], [-25, -25, 0], [-45, -30, 0]]),
        np.array([[25.0, -25, 0], [25, 25, 0], [70, 30, 0]]),
    )
    shadows = [lying(frames.apply(where, corners)) for corners in (left, right)]
    assert len(faces) == 4
    assert lying_under(faces) == ()
    assert lying_under([*faces, *shadows]) == (4, 5)


def test_what_one_camera_alone_outlines_is_left_for_a_second_look() -> None:
    settings_ = VisionSettings()
    left, right = paint_pair([(CUBE, pose(DIRECTION, 0.4))], np.random.default_rng(11))
    right[:, 320:] = right[:, 320:].mean()
    images = open_stereo(left, right, rig())
    both, alone = (outlines_of(images, settings_, in_one=in_one) for in_one in (False, True))
    assert len(both[0]) < len(alone[0])
    assert set(both[0]) <= set(alone[0])


def test_rough_polygons_are_compared_by_the_epipolar_band_they_span_and_by_depth() -> None:
    settings_, geometry = VisionSettings(), baseline(rig())
    square = np.array([[200.0, 200], [200, 260], [260, 260], [260, 200]])
    ideal = geometry.left.ideal(square)
    shift = geometry.length_mm / 350.0

    def there(disparity: float, down_px: float = 0.0) -> Array:
        return geometry.right.pixels(ideal - [disparity, -down_px / geometry.left.focal_px])

    others = [there(shift), there(shift, 20.0), there(-shift), there(geometry.length_mm / 10.0)]
    left, right = in_both([square], others, geometry, settings_)
    assert left.tolist() == [True]
    assert right.tolist() == [True, False, False, False]
    assert in_both([square], others[1:], geometry, settings_)[0].tolist() == [False]
    assert [flags.tolist() for flags in in_both([square], [], geometry, settings_)] == [[False], []]
