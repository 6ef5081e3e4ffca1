"""When two pairs show the same: noise and lamps are no change, an edge that moved is, in either camera."""

import asyncio
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from daemon.arm.settling import NotSettledError, Settling, change, settled_pair, still
from daemon.vision.image.grey import block_means
from tests.fakes.fake_cell import FakePair, FakePicture


def view(edge_px: int, rng: np.random.Generator, lamps: float = 0.0, sigma: float = 2.0) -> np.ndarray:
    """A bright thing whose left edge is at edge_px, on a dark ground, with noise."""
    image = np.full((120, 160), 60.0 + lamps)
    image[30:90, edge_px : edge_px + 40] += 120.0
    return np.clip(image + rng.normal(0, sigma, image.shape), 0, 255).astype(np.uint8)


def pair(left: np.ndarray, right: np.ndarray, taken_s: float = 0.0) -> FakePair:
    return FakePair(FakePicture(left, taken_s), FakePicture(right, taken_s))


def test_blocks_are_means_of_eight_by_eight_pixels_and_what_is_left_over_is_cut():
    image = np.zeros((17, 24), np.uint8)
    image[:8, 8:16] = 64
    image[16:] = 255
    np.testing.assert_allclose(block_means(image), [[0, 64, 0], [0, 0, 0]])


def test_noise_is_no_change_and_lamps_that_brighten_all_are_none_either():
    rng = np.random.default_rng(0)
    largest, typical = change(view(40, rng), view(40, rng, lamps=8.0))
    assert largest < 6.0 * typical
    assert typical < 1.0


@pytest.mark.parametrize("sigma", [0.5, 2.0, 4.0])
def test_a_shift_of_a_pixel_is_seen_in_whatever_noise(sigma):
    rng, settling = np.random.default_rng(1), Settling()
    here, there = view(40, rng, sigma=sigma), view(41, rng, sigma=sigma)
    assert still(pair(here, here), pair(view(40, rng, sigma=sigma), view(40, rng, sigma=sigma)), settling)
    assert not still(pair(here, here), pair(there, here), settling)
    assert not still(pair(here, here), pair(here, there), settling), "either camera shows it"


def test_where_all_of_the_image_moves_it_is_not_taken_for_noise():
    rng = np.random.default_rng(2)
    stripes = np.tile(np.where(np.arange(160) // 8 % 2, 180, 60), (120, 1)).astype(float)
    moved = np.roll(stripes, 8, axis=1)
    noisy = [(image + rng.normal(0, 2, image.shape)).astype(np.uint8) for image in (stripes, moved)]
    assert not still(pair(noisy[0], noisy[0]), pair(noisy[1], noisy[1]), Settling())


class ShownCameras:
    """Shows what it is given, a pair every 30 ms; tells what it was asked for."""

    def __init__(self, edges: list[int]) -> None:
        self.edges, self.now_s, self.asked_s, self.rng = edges, 0.0, list[float](), np.random.default_rng(3)

    async def grab(self, not_before_s: float, timeout_s: float) -> FakePair:
        self.asked_s.append(not_before_s)
        self.now_s = max(self.now_s, not_before_s) + 0.03
        edge = self.edges.pop(0) if len(self.edges) > 1 else self.edges[0]
        return pair(view(edge, self.rng), view(edge, self.rng), self.now_s)


def settle(cameras: ShownCameras, rest_s: float = 1.0):
    cell: Any = SimpleNamespace(cameras=cameras, clock=lambda: cameras.now_s)
    return asyncio.run(settled_pair(cell, rest_s, Settling(timeout_s=1.0)))


def test_the_first_two_pairs_that_agree_are_taken_and_none_from_before_the_rest():
    cameras = ShownCameras([40, 46, 50, 50])
    found = settle(cameras)
    assert cameras.asked_s[0] == 1.0
    assert all(later > earlier for earlier, later in zip(cameras.asked_s, cameras.asked_s[1:], strict=False))
    assert found.before.left.taken_s == pytest.approx(1.09)
    assert found.pictures.left.taken_s == pytest.approx(1.12)
    assert found.seconds == pytest.approx(0.09)


def test_the_second_pair_is_wholly_later_than_the_later_frame_of_the_first():
    cameras = ShownCameras([50])
    grab = cameras.grab

    async def skewed(not_before_s: float, timeout_s: float) -> FakePair:
        taken = await grab(not_before_s, timeout_s)
        return FakePair(taken.left, FakePicture(taken.right.pixels, taken.right.taken_s + 0.01))

    cameras.grab = skewed
    found = settle(cameras)
    assert cameras.asked_s == [1.0, found.before.right.taken_s]


def test_an_arm_that_never_comes_to_rest_is_told_after_the_time():
    cameras = ShownCameras([20 + 7 * (k % 9) for k in range(200)])
    with pytest.raises(NotSettledError, match="still change 1 s after"):
        settle(cameras)
    assert 2.0 < cameras.now_s < 2.2
