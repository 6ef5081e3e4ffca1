"""The renderer against geometry it does not use: OpenCV's own projection, and what light must do."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from drivers.simcell.boards import BoardPrint, board_thing
from drivers.simcell.light import CellLight
from drivers.simcell.optics import Array32, Eye, distort, undistort
from drivers.simcell.parts import STRANGERS, TAUGHT, part_shape
from drivers.simcell.render import Retina, Thing, radiance
from drivers.simcell.rigid import Array, apply, inverse, rigid, turn
from drivers.simcell.truth import Lamp, Lighting, Table, load_truth

TRUTH = load_truth(Path(__file__).parents[3] / "etc" / "simcell.yaml")
TABLE = Table(height_mm=-300.0, centre_mm=[520.0, 0.0], scatter_radius_mm=115.0, half_size_mm=450.0)
STARK = Lighting(
    ambient=40.0,
    lamps=[Lamp(position_mm=[100.0, -700.0, 500.0], radius_mm=20.0, level=220.0)],
    gloss=0.0,
    facet_albedo=0.8,
    table_albedo=0.02,
)
"""Facets against a nearly black table, so that shadows do not blur the measured edges."""


def looking(eye_mm: list[float], at_mm: list[float], roll_rad: float = 0.0) -> Array:
    """world_from_cyclopean that looks at a point."""
    z = np.array(at_mm) - np.array(eye_mm)
    z = z / np.linalg.norm(z)
    x = np.cross(z, [0.0, 0.0, 1.0])
    x = x / np.linalg.norm(x)
    return rigid(np.column_stack([x, np.cross(z, x), z]) @ turn([0, 0, 1], roll_rad), eye_mm)


def projected(eye: Eye, world_from_cyclopean: Array, points: Array) -> Array:
    """(N, 3) world -> (N, 2) px by OpenCV's projection."""
    camera_from_world = inverse(world_from_cyclopean @ eye.cyclopean_from_camera)
    seen, _ = cv2.projectPoints(apply(camera_from_world, points), np.zeros(3), np.zeros(3), eye.matrix, eye.distortion)
    return np.asarray(seen[:, 0, :], float)


def edge_offsets(image: Array32, line_px: Array, half_px: float = 4.0) -> Array:
    """How far (px) the image shows each point of a projected edge off; only where there is one clear step.

    The levels on both sides are taken as straight lines over the distance; what is left of the sum over the profile is
    the step times the offset.
    """
    along = np.gradient(line_px, axis=0)
    normal = np.column_stack([-along[:, 1], along[:, 0]]) / np.linalg.norm(along, axis=1)[:, None]
    steps = np.linspace(-half_px, half_px, 160, endpoint=False) + half_px / 160
    where = (line_px[:, None] + steps[None, :, None] * normal[:, None]).astype(np.float32)
    profile = cv2.remap(image, where[..., 0], where[..., 1], cv2.INTER_LINEAR).astype(float)
    model = np.zeros_like(profile)
    step, misfit = np.zeros(len(profile)), np.zeros(len(profile))
    for sign in (-1, 1):
        side, beside = sign * steps > 0, sign * steps > 1.5
        slope, level = np.polyfit(steps[beside], profile[:, beside].T, 1)
        model[:, side] = level[:, None] + slope[:, None] * steps[side]
        misfit += np.abs(profile - model)[:, beside].max(axis=1)
        step += sign * level
    offset = -(profile - model).mean(axis=1) * 2 * half_px / step
    return np.asarray(offset[(np.abs(step) > 20) & (misfit < 0.02 * np.abs(step))])


def picture(things: list[Thing], pose: Array, eye: Eye, lighting: Lighting = STARK) -> Array32:
    light = CellLight(TABLE, lighting)
    light.cast([apply(thing.world_from_solid, thing.solid.vertices) for thing in things])
    return radiance(Retina(eye, 640, 480), pose, things, light)


@pytest.mark.parametrize("label", ["cube", "triangular_prism", "pentagonal_prism", "pyramid"])
@pytest.mark.parametrize("stand_off_mm", [200.0, 450.0])
def test_edges_lie_within_five_thousandths_of_a_pixel_of_where_projection_puts_them(
    label: str, stand_off_mm: float
) -> None:
    shape, eye = part_shape(label), TRUTH.left.eye()
    rest = rigid(turn([0, 0, 1], 0.3), [520.0, 0.0, -300.0]) @ shape.rests[0]
    pose = looking([520 - 0.6 * stand_off_mm, -0.3 * stand_off_mm, -280 + 0.742 * stand_off_mm], [520, 0, -280], 0.2)
    image = picture([Thing(shape.hull, rest, STARK.facet_albedo)], pose, eye)
    corners = apply(rest, shape.hull.vertices)
    to_eye = pose[:3, 3] - corners.mean(axis=0)
    normals = shape.hull.normals @ rest[:3, :3].T
    sides = {
        tuple(sorted(pair))
        for face, normal in zip(shape.hull.faces, normals, strict=True)
        if normal @ to_eye > 0.3 * np.linalg.norm(to_eye)
        for pair in zip(face, (*face[1:], face[0]), strict=True)
    }
    offsets = []
    for a, b in sides:
        share = np.linspace(0.2, 0.8, 120)[:, None]
        found = edge_offsets(image, projected(eye, pose, corners[a] * (1 - share) + corners[b] * share))
        if len(found) == 120:
            offsets.append(found.mean())
            assert np.sqrt(np.mean(found**2)) < 0.06
    assert len(offsets) >= 4
    assert np.max(np.abs(offsets)) < 0.005


def test_distortion_is_opencvs_and_undoes_itself() -> None:
    straight = np.random.default_rng(0).uniform(-0.5, 0.5, (200, 2))
    coefficients = [-0.08, 0.03, 0.0004, -0.0003, 0.01]
    rays = np.column_stack([straight, np.ones(200)])
    theirs, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), np.eye(3), np.array(coefficients))
    assert np.allclose(distort(straight, coefficients), theirs[:, 0, :], atol=1e-12)
    assert np.allclose(undistort(distort(straight, coefficients), coefficients), straight, atol=1e-10)


def test_a_nearer_part_hides_a_farther_one() -> None:
    cube, eye = part_shape("cube"), TRUTH.left.eye()
    front = Thing(cube.hull, rigid(np.eye(3), [480.0, 0.0, -275.0]), 0.8)
    back = Thing(cube.hull, rigid(np.eye(3), [560.0, 0.0, -275.0]), 0.2)
    pose = looking([150.0, 0.0, -220.0], [520.0, 0.0, -280.0])
    both, alone = picture([front, back], pose, eye), picture([front], pose, eye)
    assert np.allclose(both, picture([back, front], pose, eye)), "whichever is named first"
    middle = np.round(projected(eye, pose, np.array([[455.0, 0.0, -265.0]]))[0]).astype(int)
    patch = np.s_[middle[1] - 5 : middle[1] + 5, middle[0] - 5 : middle[0] + 5]
    assert np.allclose(both[patch], alone[patch])
    assert not np.allclose(both, alone)


def test_a_part_casts_its_shadow_away_from_the_lamp_and_softer_the_farther() -> None:
    bright = Lighting(ambient=40.0, lamps=STARK.lamps, gloss=0.0, facet_albedo=0.8, table_albedo=0.6)
    light = CellLight(TABLE, bright)
    pose = looking([520.0, -1.0, 200.0], [520.0, 0.0, -300.0])
    centres = Retina(TRUTH.left.eye(), 640, 480).centres
    world_from_camera = pose @ TRUTH.left.eye().cyclopean_from_camera
    bare = light.table_levels(centres, world_from_camera)
    corners = apply(rigid(np.eye(3), [520.0, 0.0, -275.0]), part_shape("cube").hull.vertices)
    light.cast([corners])
    lost = bare - light.table_levels(centres, world_from_camera)

    def at(x_mm: float, y_mm: float) -> float:
        u, v = np.round(projected(TRUTH.left.eye(), pose, np.array([[x_mm, y_mm, -300.0]]))[0]).astype(int)
        return float(lost[v, u] / bare[v, u])

    assert at(545.0, 45.0) > 0.5, "behind the part, seen from the lamp"
    assert abs(at(500.0, -80.0)) < 0.05, "towards the lamp"
    assert abs(at(520.0, 170.0)) < 0.05, "beyond the shadow's end"


def test_a_tall_part_throws_its_shadow_onto_its_neighbour_and_only_where_the_lamp_is_hidden() -> None:
    eye, pose = TRUTH.left.eye(), looking([520.0, 150.0, 100.0], [520.0, 40.0, -280.0])
    low = Thing(part_shape("cube").hull, rigid(np.eye(3), [530.0, 60.0, -275.0]), 0.8)
    tall = Thing(part_shape("triangular_prism").hull, rigid(np.eye(3), [500.0, 5.0, -265.0]), 0.8)
    alone, shaded = picture([low], pose, eye), picture([low, tall], pose, eye)

    def lost(x_mm: float, y_mm: float) -> float:
        u, v = np.round(projected(eye, pose, np.array([[x_mm, y_mm, -250.0]]))[0]).astype(int)
        return float((alone - shaded)[v, u] / alone[v, u])

    assert lost(508.0, 37.0) > 0.3, "the corner of the top that lies behind the tall part as the lamp sees it"
    assert lost(553.0, 83.0) == 0.0, "the far corner"


@pytest.mark.parametrize("charuco", [False, True])
def test_a_board_is_found_by_opencv_where_its_pose_says(charuco: bool) -> None:
    board, eye = BoardPrint(charuco=charuco), TRUTH.right.eye()
    axes = np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    world_from_board = rigid(axes @ turn([1, 0.5, 0], 0.3), [570.0, 85.0, -250.0])
    pose = looking([480.0, -20.0, 90.0], [520.0, 0.0, -280.0], 0.1)
    lighting = TRUTH.lighting
    image = picture([board_thing(board, world_from_board)], pose, eye, lighting)
    grey = np.clip(cv2.GaussianBlur(image, (0, 0), TRUTH.sensor.blur_px), 0, 255).astype(np.uint8)
    if charuco:
        dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
        layout = cv2.aruco.CharucoBoard((10, 7), 16.0, 12.0, dictionary)
        found, numbers, _, _ = cv2.aruco.CharucoDetector(layout).detectBoard(grey)
        wanted = np.asarray(layout.getChessboardCorners(), float)[numbers.ravel()]
        assert len(wanted) == 54
    else:
        complete, found = cv2.findChessboardCorners(grey, (9, 6))
        assert complete
        wanted = board.inner_corners_mm()
        if np.linalg.norm(found[0] - projected(eye, pose, apply(world_from_board, wanted[:1]))) > 20:
            found = found[::-1]
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-4)
    found = cv2.cornerSubPix(grey, np.ascontiguousarray(found), (4, 4), (-1, -1), stop).reshape(-1, 2)
    off = found - projected(eye, pose, apply(world_from_board, wanted))
    assert np.linalg.norm(off.mean(axis=0)) < 0.03
    assert np.sqrt(np.mean(np.sum(off**2, axis=1))) < 0.08


@pytest.mark.parametrize("label", [*TAUGHT, *STRANGERS])
def test_every_part_rests_on_the_table_and_nowhere_below(label: str) -> None:
    shape = part_shape(label)
    assert shape.rests
    for rest in shape.rests:
        heights = apply(rest, shape.hull.vertices)[:, 2]
        assert heights.min() == pytest.approx(0.0, abs=1e-9)
        assert np.sum(heights < 1e-6) >= 3


def test_the_parts_have_the_measures_they_are_known_by() -> None:
    def sides(label: str) -> set[float]:
        solid = part_shape(label).hull
        pairs = {tuple(sorted(p)) for face in solid.faces for p in zip(face, (*face[1:], face[0]), strict=True)}
        return {round(float(np.linalg.norm(solid.vertices[a] - solid.vertices[b])), 3) for a, b in pairs}

    assert sides("cube") == {50.0}
    assert sides("pyramid") == {50.0, round(float(np.sqrt(50**2 + 2 * 25**2)), 3)}
    assert sides("triangular_prism") == {50.0, 70.0}
    assert sides("pentagonal_prism") == {32.0, 70.0}
