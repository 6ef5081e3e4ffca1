"""Where the table has a pattern both cameras see how it lies; where it has none, or most is nearer, they do not."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from daemon import frames
from daemon.arrays import Array
from daemon.vision.facets.one_look import table_estimation
from daemon.vision.facets.one_look.table_estimation import estimate_table, plane_of_most
from daemon.vision.facets.table_plane import TablePlane
from daemon.vision.geometry import baseline
from daemon.vision.image.stereo_images import open_stereo
from tests.fakes import rendered
from tests.fakes.printed import print_pair, straight_rig
from tests.fakes.solids import CUBE


def table_at(distance_mm: float, tilt: float, roll: float) -> Array:
    """cyclopean_from_table, x y in the table: tilted about the cameras' x, and that turned by the roll."""
    turn = frames.rotation_from_vector(np.array([0.0, 0.0, roll])) @ frames.rotation_from_vector(
        np.array([tilt, 0.0, 0.0])
    )
    return frames.rigid(turn, np.array([0.0, 0.0, distance_mm]))


def seen(where: Array, body=None, lies=None, known: TablePlane | None = None, **kind) -> TablePlane | None:
    pair = print_pair(body, where if lies is None else lies, table=where, **{"speckled": True, **kind})
    return estimate_table(open_stereo(*pair, straight_rig()), known)


@pytest.mark.parametrize(
    ("distance_mm", "tilt", "roll"), [(300.0, 0.0, 0.9), (340.0, 0.6, 1.2), (420.0, -0.7, 1.0), (360.0, 0.5, -0.4)]
)
def test_a_patterned_table_is_seen_where_it_lies(distance_mm: float, tilt: float, roll: float) -> None:
    where = table_at(distance_mm, tilt, roll)
    found = seen(where)
    up = -where[:3, 2] * np.sign(where[2, 2])
    assert found.up @ up > np.cos(np.radians(0.15))
    around = frames.apply(where, 60.0 * np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]))
    assert np.abs(around @ found.up - found.level_mm).max() < 0.4


def test_both_pictures_compared_say_it_better_than_blocks_do(monkeypatch: pytest.MonkeyPatch) -> None:
    tables = [table_at(340.0, 0.6, 1.2), table_at(420.0, -0.7, 1.0), table_at(360.0, 0.5, -0.4)]
    compared = [tilt_deg(where) for where in tables]
    monkeypatch.setattr(table_estimation, "_compared", lambda plane, *_: plane)
    assert np.mean(compared) < 0.5 * np.mean([tilt_deg(where) for where in tables])


def tilt_deg(where: Array) -> float:
    """How far a table is seen tilted."""
    found = seen(where)
    assert found is not None
    return float(np.degrees(np.arccos(min(abs(float(found.up @ where[:3, 2])), 1.0))))


def test_a_part_on_it_does_not_move_it() -> None:
    where = table_at(340.0, 0.6, 1.2)
    on_it = where @ frames.rigid(np.diag([1.0, -1.0, -1.0]), np.zeros(3))  # its lowest side, z = 0, down in the table
    bare, laden = seen(where), seen(where, CUBE, on_it)
    assert laden.up @ bare.up > np.cos(np.radians(0.1))
    assert laden.level_mm == pytest.approx(bare.level_mm, abs=0.2)


def test_a_plain_table_is_not_seen() -> None:
    assert seen(table_at(340.0, 0.6, 1.2), speckled=False, patterned=False) is None


def test_in_a_plain_picture_nothing_is_matched(monkeypatch: pytest.MonkeyPatch) -> None:
    where = table_at(340.0, 0.6, 1.2)
    monkeypatch.setattr(table_estimation, "_disparities", lambda *_: pytest.fail("matched"))
    on_it = where @ frames.rigid(np.diag([1.0, -1.0, -1.0]), np.zeros(3))
    assert seen(where, CUBE, on_it, speckled=False, patterned=False) is None


def test_a_printed_part_on_a_plain_table_is_no_table() -> None:
    where = table_at(340.0, 0.6, 1.2)
    assert (
        seen(
            where, CUBE, where @ frames.rigid(np.diag([1.0, -1.0, -1.0]), np.zeros(3)), speckled=False, patterned=False
        )
        is None
    )


def test_threads_along_the_baseline_say_nothing_of_the_distance() -> None:
    assert seen(table_at(300.0, 0.0, 0.0), speckled=False) is None


def test_noise_is_no_table() -> None:
    rng = np.random.default_rng(5)
    left, right = rng.integers(0, 255, (2, 480, 640)).astype(np.uint8)
    assert estimate_table(open_stereo(left, right, straight_rig())) is None


@pytest.mark.parametrize(
    ("off_px", "where", "table"),
    [
        (30.0, "in a quarter", True),
        (-30.0, "in a quarter", False),
        (-30.0, "here and there", True),
        (0.0, "in one place", False),
    ],
)
def test_much_may_stand_on_a_table_and_nothing_may_lie_beyond_it(
    off_px: float, where: str, table: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A quarter of the picture is nearer, or farther, than the plane that the rest lies in; a pattern that repeats
    itself makes much of some places look farther; and what has a pattern in one place alone may be a part's face."""
    rng = np.random.default_rng(6)
    images = open_stereo(*print_pair(None, table_at(340.0, 0.0, 0.9)), straight_rig())
    disparities = np.full((160, 213), 60.0, np.float32)
    other = np.zeros(disparities.shape, bool)
    if where == "here and there":
        other[:, 80:160] = rng.random((160, 80)) < 0.7
    elif where == "in a quarter":
        other[:80, :106] = True
    else:
        disparities[:40] = disparities[125:] = disparities[:, :45] = disparities[:, 180:] = 0.0
    disparities[other] += off_px * rng.uniform(0.3, 1.0, other.sum()).astype(np.float32)
    monkeypatch.setattr(table_estimation, "_disparities", lambda *_: disparities)
    assert (estimate_table(images) is not None) == table


@pytest.mark.parametrize("slant", [0.0, 0.3])
@pytest.mark.parametrize(("rig", "columns", "rows"), [("A0", 756, 581), ("B", 640, 480)])
def test_coarse_pictures_are_taken_from_where_the_lenses_say(rig: str, columns: int, rows: int, slant: float) -> None:
    geometry = baseline(rendered.rig(rendered.HERE, rig))
    found = table_estimation.rectified(geometry, columns, rows, slant)
    _, tall, wide = found.left.shape
    places = np.stack(np.meshgrid(np.arange(wide), np.arange(tall)), 2).reshape(-1, 2).astype(float)
    moved = np.array([slant, 0.0]) * (places[:, 1:] - tall / 2)
    for camera, taken, at in ((geometry.left, found.left, places), (geometry.right, found.right, places - moved)):
        shown = places[:, 0] >= (found.margin if camera is geometry.left else 0)
        off_px = taken.reshape(2, -1).T - camera.pixels(found.ideal(at))
        assert np.abs(off_px[shown]).max() < 0.1


def test_what_only_the_left_camera_sees_says_nothing_against_a_table() -> None:
    """Of a near table the left third is not in the right picture; what is matched there all the same lies far away."""
    canvas = straight_canvas()
    places, near = table_estimation.coarse_places((160, 213)), 140.0
    low, high = canvas.in_both(places)
    alone = (near < low) | (near > high)
    assert 0.3 < alone.mean() < 0.5
    far = np.random.default_rng(7).uniform(1.0, 48.0, len(places))
    disparities = np.where(alone, far, near).astype(np.float32)
    found = plane_of_most(places, disparities, canvas)
    assert np.abs(places @ found - near).max() < 0.1


@pytest.mark.parametrize(("slant", "upright"), [(0.12, True), (0.6, True), (-0.6, False)])
def test_grain_at_a_slant_is_seen_by_upright_cameras_and_by_others_where_the_table_is_known(
    slant: float, upright: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    where = table_at(340.0, 0.0, 0.9)
    images = open_stereo(*print_pair(None, where, table=where, speckled=True), straight_rig())
    monkeypatch.setattr(table_estimation, "_pictures", lambda _, canvas: grain(slant, canvas))
    found = estimate_table(images)
    assert (found is not None) == upright
    up = np.array([0.0, -slant / 60.0, -1 / 300.0])  # of a baseline of 60 mm, 300 mm away in front
    known = TablePlane(up / np.linalg.norm(up), -1.0 / float(np.linalg.norm(up)))
    assert estimate_table(images, known).up @ known.up > np.cos(np.radians(1.0))


def grain(slant: float, canvas: table_estimation.Rectified) -> tuple[np.ndarray, np.ndarray]:
    """Coarse pictures of wood whose disparity grows so from row to row."""
    rng = np.random.default_rng(8)
    _, tall, wide = canvas.left.shape
    fibres = cv2.GaussianBlur(rng.normal(size=(tall, 2 * wide)).astype(np.float32), (0, 0), sigmaX=9, sigmaY=0.9)
    turned = cv2.getRotationMatrix2D((wide, tall / 2), 35, 1.0)
    wood = cv2.warpAffine(fibres, turned, (2 * wide, tall), borderMode=cv2.BORDER_REFLECT)
    column, row = np.meshgrid(np.arange(wide), np.arange(tall))
    nearer = 233 * 60 / 300 + slant * (row - tall / 2) - canvas.base[1] * row - canvas.base[2]
    pair = [cv2.remap(wood, (column + by).astype(np.float32), row.astype(np.float32), 1) for by in (0 * row, nearer)]
    return tuple(np.clip(128 + 150 * one + rng.normal(0, 2, one.shape), 0, 255).astype(np.uint8) for one in pair)


def straight_canvas() -> table_estimation.Rectified:
    return table_estimation.rectified(baseline(straight_rig()), 640, 480, 0.0)


@pytest.mark.parametrize("seed", range(5))
def test_a_plane_is_found_among_wrong_matches(seed: int) -> None:
    rng = np.random.default_rng(seed)
    places = np.column_stack([rng.uniform(0, 213, 3000), rng.uniform(0, 160, 3000), np.ones(3000)])
    plane = np.array([0.02, -0.05, 40.0])
    disparities = places @ plane + rng.normal(0, 0.1, 3000)
    disparities[:1200] = rng.uniform(5, 130, 1200)
    order = rng.permutation(3000)
    found = plane_of_most(places[order], disparities[order].astype(np.float32), straight_canvas())
    assert np.abs(places @ (found - plane)).max() < 0.1
