"""A camera that does not hold exposure or focus, or has a rolling shutter, is found by its pictures."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from daemon.vision.health import measure_steadiness, overridden
from tests.fakes.moving_texture import FPS, frame


@pytest.mark.parametrize(("readout_ms", "seed"), [(0, 0), (10, 1), (20, 2), (30, 0)])
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
    assert found.faults() == []
    assert (found.shutter or "").startswith("rolling shutter" if readout_ms else "global shutter")


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
    images = [frame(lambda _: 0.0, t, rng, **faults(k)) for k, t in enumerate(times)]
    found = measure_steadiness(images, times.tolist())
    assert [line[: len(told)] for line in found.faults()] == ([told] if told else [])
    assert np.isnan(found.readout_s), "nothing moved"


def test_at_one_speed_nothing_tells_a_rolling_shutter_from_a_slanted_scene() -> None:
    rng, times = np.random.default_rng(5), np.arange(12) / FPS
    found = measure_steadiness([frame(lambda t: 150 * t, t, rng, 0.03) for t in times], times.tolist())
    assert np.isnan(found.readout_s)
    assert found.shutter is None


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
