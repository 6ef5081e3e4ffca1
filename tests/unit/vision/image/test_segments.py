"""Straight segments, faint ones too, and the corners where two meet."""

from __future__ import annotations

from collections import Counter

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon.vision.image import segments
from daemon.vision.image.segments import (
    MAX_SEGMENTS,
    Segments,
    cells_of,
    find_segments,
    join_segments,
    segment_corners,
    segments_by_lsd,
    shared_out,
)

SQUARE = np.array([[150.0, 110.0], [330.0, 130.0], [310.0, 300.0], [135.0, 285.0]])


def picture(contrast: float, noise: float = 1.0) -> np.ndarray:
    fine = np.full((4 * 480, 4 * 640), 90.0, np.float32)
    cv2.fillPoly(fine, [np.rint((SQUARE + 0.5) * 4 - 0.5).astype(np.int32)], 90.0 + contrast)
    small = cv2.resize(fine, (640, 480), interpolation=cv2.INTER_AREA)
    grain = np.random.default_rng(0).normal(0, noise, small.shape)
    return np.clip(cv2.GaussianBlur(small, (0, 0), 0.7) + grain, 0, 255).astype(np.uint8)


def off(points: np.ndarray) -> np.ndarray:
    """How far each corner of the square is from the nearest of some points."""
    return np.linalg.norm(SQUARE[:, None] - points, axis=2).min(1)


@pytest.mark.parametrize("contrast", [80.0, -70.0, 9.0])
def test_a_square_has_four_sides_and_four_corners(contrast: float) -> None:
    corners = segment_corners(find_segments(picture(contrast)))
    assert off(corners.at).max() < 1.5


@pytest.mark.parametrize("contrast", [6.0, 80.0, 150.0])
def test_faint_sides_are_found_and_strong_ones_draw_no_lines_beside_them(contrast: float) -> None:
    around = np.linalg.norm(np.roll(SQUARE, 1, 0) - SQUARE, axis=1).sum()
    assert segments_by_lsd(picture(6.0)).shape[0] < 4
    assert 0.85 * around < find_segments(picture(contrast)).lengths_px.sum() < 1.15 * around


def test_the_longest_segments_come_first() -> None:
    assert (np.diff(find_segments(picture(80.0)).lengths_px) <= 0).all()


def test_segments_run_with_the_brighter_side_on_one_hand() -> None:
    middle = SQUARE.mean(0)

    def hand(contrast: float) -> set[float]:
        ends = segments_by_lsd(picture(contrast))
        long = ends[np.hypot(*(ends[:, 2:] - ends[:, :2]).T) > 60]
        way, to = long[:, 2:] - long[:, :2], middle - long[:, :2]
        return set(np.sign(way[:, 0] * to[:, 1] - way[:, 1] * to[:, 0]))

    assert len(hand(80.0)) == len(hand(-70.0)) == 1
    assert hand(80.0) != hand(-70.0)


def test_an_empty_picture_has_none() -> None:
    found = find_segments(np.full((480, 640), 70, np.uint8))
    assert found.start.shape == (0, 2)
    assert segment_corners(found).at.shape == (0, 2)


def test_segments_meet_near_an_end_of_both_and_their_arms_run_away_from_there() -> None:
    start = np.array([[100.0, 100.0], [204.0, 96.0], [150.0, 300.0]])
    end = np.array([[200.0, 100.0], [204.0, 190.0], [150.0, 101.0]])
    corners = segment_corners(Segments(start, end))
    assert np.allclose(corners.at, [[204.0, 100.0]])  # the third meets the first in its middle, which is no corner
    assert {tuple(arm) for arm in corners.arms[0]} == {(100.0, 100.0), (204.0, 190.0)}
    assert sorted(corners.sign[0]) == [-1, 1]


def test_pieces_of_a_broken_edge_are_also_one_segment_that_reaches_its_corners() -> None:
    pieces = Segments(
        np.array([[118.0, 100.0], [145.0, 100.5], [100.0, 160.0]]),
        np.array([[140.0, 100.2], [190.0, 101.0], [100.0, 100.0]]),
    )
    whole = join_segments(pieces)
    assert whole.lengths_px.tolist() == pytest.approx([72.0, 60.0, 45.0, 22.0], abs=0.1)
    assert len(segment_corners(pieces).at) == 0
    assert np.allclose(segment_corners(whole).at, [[100.0, 100.0]], atol=0.5)


def test_pieces_that_turn_or_step_aside_are_not_joined() -> None:
    start = np.array([[100.0, 100.0], [135.0, 106.0], [135.0, 95.0], [200.0, 100.0]])
    end = np.array([[130.0, 100.0], [170.0, 106.0], [165.0, 90.0], [230.0, 100.0]])
    assert len(join_segments(Segments(start, end)).start) == len(start)


@given(st.lists(st.integers(0, 6), max_size=60), st.integers(0, 70))
def test_what_is_shared_out_is_the_best_of_each_group_and_none_has_more_than_one_that_could(
    groups: list[int], most: int
) -> None:
    kept = shared_out(np.array(groups, np.intp), most).tolist()
    assert kept == sorted(kept)
    assert len(kept) == min(most, len(groups))
    count = Counter(groups[k] for k in kept)
    most_of_one = max(count.values(), default=0)
    for group in set(groups):
        own = [k for k, one in enumerate(groups) if one == group]
        assert [k for k in kept if groups[k] == group] == own[: count[group]]
        assert count[group] == len(own) or count[group] >= most_of_one - 1


def test_of_a_table_with_a_grain_the_segments_of_a_part_are_kept() -> None:
    """The grain's are a thousand, and each of them longer."""
    start = np.stack([np.tile(np.arange(0.0, 1000.0, 20.0), 20), np.repeat(np.arange(20.0) * 40, 50)], 1)
    grain = Segments(start, start + np.array([0.0, 35.0]))
    part = Segments(np.array([[300.0, 300.0], [300.0, 320.0]]), np.array([[320.0, 300.0], [320.0, 321.0]]))
    found = join_segments(Segments(np.concatenate([grain.start, part.start]), np.concatenate([grain.end, part.end])))
    assert len(found.start) == MAX_SEGMENTS < len(grain.start)
    assert {(20.0, 0.0), (20.0, 1.0)} <= {tuple(way) for way in (found.end - found.start).round(6).tolist()}
    assert (np.diff(found.lengths_px) <= 1e-9).all()


def test_of_a_ruled_table_the_corners_of_a_part_are_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(segments, "MAX_CORNERS", 30)
    lines = 40.0 * np.arange(1, 12)
    across = np.stack([np.full(11, 20.0), lines], 1), np.stack([np.full(11, 480.0), lines], 1)
    down = across[0][:, ::-1] + np.array([150.0, 0.0]), across[1][:, ::-1] + np.array([150.0, 0.0])
    small = np.array([[700.0, 700.0]] * 2), np.array([[715.0, 700.0], [700.0, 715.0]])
    found = segment_corners(Segments(*(np.concatenate(each) for each in zip(across, down, small, strict=True))))
    assert len(found.at) == 30
    assert (np.abs(found.at - 700.0).max(1) < 1.0).any()
    assert (np.abs(found.at_most(len(set(cells_of(found.at)))).at - 700.0).max(1) < 1.0).any()
