"""A camera that does not hold exposure or focus, or has a rolling shutter, is found by its pictures."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
import pytest

from daemon.vision.health import measure_steadiness, overridden

SIZE, FPS = (480, 360), 30.0
TEXTURE = cv2.GaussianBlur(np.random.default_rng(0).normal(0, 1, (500, 1800)).astype(np.float32), (0, 0), 3)
TEXTURE = (TEXTURE - TEXTURE.min()) / np.ptp(TEXTURE) * 180 + 30


def frame(
    way_px: Callable[[float], float], at_s: float, rng: np.random.Generator, readout_s: float = 0.0, depth: float = 0.0,
    gain: float = 1.0, blur_px: float = 0.0,
) -> np.ndarray:  # fmt: skip
    """A texture that moves along the rows; depth: how much farther the last row moves than the first, as a share."""
    width, height = SIZE
    share = np.arange(height) / height
    shift = np.array([way_px(at_s + readout_s * (part - 0.5)) * (1 + depth * part) for part in share])
    x = (np.arange(width) + 500 - shift[:, None]).astype(np.float32)
    y = np.broadcast_to(np.arange(height)[:, None] + 60, x.shape).astype(np.float32)
    image = cv2.remap(TEXTURE, x, y, cv2.INTER_LINEAR) * gain
    image = cv2.GaussianBlur(image, (0, 0), blur_px) if blur_px else image
    return np.clip(image + rng.normal(0, 2, image.shape), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("readout_ms", [0, 10, 20, 30])
@pytest.mark.parametrize("seed", range(3))
def test_a_rolling_shutter_is_measured_whatever_the_perspective_and_a_global_one_is_none(
    readout_ms: int, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    period_s, reach_px, depth = rng.uniform(0.8, 1.8), rng.uniform(25, 60), rng.uniform(0, 0.5)
    times = np.arange(40) / FPS

    def way_px(at_s: float) -> float:
        """To and fro, from rest."""
        return float(reach_px * np.sin(2 * np.pi * at_s / period_s) * np.clip((at_s - 0.2) / 0.3, 0, 1))

    found = measure_steadiness([frame(way_px, t, rng, readout_ms / 1000, depth) for t in times], times.tolist())
    assert 1000 * found.readout_s == pytest.approx(readout_ms, abs=9)
    assert bool(found.faults()) is (readout_ms > 0)
    assert all(line.startswith("rolling shutter") for line in found.faults())


@pytest.mark.parametrize(
    ("faults", "told"),
    [
        (lambda k: {}, ""),
        (lambda k: {"gain": 1 + 0.08 * np.sin(k)}, "brightness changes"),
        (lambda k: {"blur_px": 0.01 + 1.5 * abs(np.sin(k))}, "sharpness changes"),
    ],
    ids=["steady", "exposure", "focus"],
)
def test_what_changes_in_a_still_scene_is_named(faults: Callable[[int], dict[str, float]], told: str) -> None:
    rng, times = np.random.default_rng(4), np.arange(10) / FPS
    images = [frame(lambda _: 0.0, t, rng, **faults(k)) for k, t in enumerate(times)]  # type: ignore[arg-type]
    found = measure_steadiness(images, times.tolist())
    assert [line[: len(told)] for line in found.faults()] == ([told] if told else [])
    assert np.isnan(found.readout_s), "nothing moved"


def test_at_one_speed_nothing_tells_a_rolling_shutter_from_a_slanted_scene() -> None:
    rng, times = np.random.default_rng(5), np.arange(12) / FPS
    found = measure_steadiness([frame(lambda t: 150 * t, t, rng, 0.03) for t in times], times.tolist())
    assert np.isnan(found.readout_s)
    assert not found.faults()


@pytest.mark.parametrize("image", [np.zeros((4, 4), np.uint8), np.full((48, 64), 255, np.uint8)])
@pytest.mark.parametrize("count", [0, 1, 2, 6])
def test_pictures_that_show_nothing_tell_nothing(image: np.ndarray, count: int) -> None:
    assert measure_steadiness([image] * count, [k / FPS for k in range(count)]).faults() == []


def test_an_exposure_without_effect_is_told_and_one_with_effect_or_too_dark_a_picture_is_not() -> None:
    bright, dark = np.full((48, 64), 120, np.uint8), np.full((48, 64), 85, np.uint8)
    assert "automatic exposure overrides it" in (overridden([bright], [bright], 0.7) or "")
    assert overridden([bright], [dark], 0.7) is None
    assert overridden([bright], [bright], 0.95) is None, "the device could shorten it no further"
    assert overridden([bright // 8], [bright // 8], 0.7) is None
