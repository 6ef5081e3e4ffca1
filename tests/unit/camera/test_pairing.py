"""Two frames of one moment: nearest in time, within the skew, never stale, the newest there is."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.camera.pairing import FrameExposure, exposure_of, newest_pair, why_no_pair


def frames(*times_s: float, long_s: float = 0.0) -> list[FrameExposure]:
    return [FrameExposure(t - long_s, t) for t in times_s]


def test_the_newest_two_of_one_moment_are_chosen() -> None:
    assert newest_pair(frames(1.0, 1.1, 1.2), frames(1.001, 1.101, 1.201), 0.0, 0.02) == (2, 2)


def test_a_frame_whose_partner_has_not_come_yet_waits_for_it() -> None:
    assert newest_pair(frames(1.0, 1.1), frames(1.001), 0.0, 0.02) == (0, 0)


def test_a_frame_that_began_before_the_arm_came_to_rest_is_never_used() -> None:
    left, right = frames(1.0, 1.1, long_s=0.06), frames(1.0, 1.1, long_s=0.06)
    assert newest_pair(left, right, 1.05, 0.02) is None
    assert newest_pair(left, right, 1.04, 0.02) == (1, 1)


def test_frames_too_far_apart_are_no_pair() -> None:
    assert newest_pair(frames(1.0), frames(1.021), 0.0, 0.02) is None
    assert newest_pair(frames(1.0), frames(1.019), 0.0, 0.02) == (0, 0)


def test_a_frame_is_not_paired_with_one_that_has_a_nearer_partner() -> None:
    assert newest_pair(frames(1.0, 1.02), frames(1.021), 0.0, 0.05) == (1, 0)
    assert newest_pair(frames(0.999, 1.04), frames(1.0), 0.0, 0.05) == (0, 0)


times = st.lists(st.integers(0, 400), max_size=6, unique=True).map(lambda t: [x / 100 for x in sorted(t)])


@given(times, times, st.integers(0, 400), st.integers(1, 10))
def test_no_choice_is_stale_or_skewed_and_none_that_is_newer_was_passed_over(
    left_s: list[float], right_s: list[float], rest: int, skew: int
) -> None:
    left, right, rest_s, skew_s = frames(*left_s), frames(*right_s), rest / 100, skew / 100
    chosen = newest_pair(left, right, rest_s, skew_s)

    def mutual(i: int, j: int) -> bool:
        gap = abs(left_s[i] - right_s[j])
        return gap <= min(abs(left_s[i] - r) for r in right_s) and gap <= min(abs(x - right_s[j]) for x in left_s)

    good = {
        (i, j): min(left_s[i], right_s[j])
        for i in range(len(left_s))
        for j in range(len(right_s))
        if min(left_s[i], right_s[j]) >= rest_s and abs(left_s[i] - right_s[j]) <= skew_s - 1e-9 and mutual(i, j)
    }
    if chosen is not None:
        i, j = chosen
        assert min(left_s[i], right_s[j]) >= rest_s
        assert abs(left_s[i] - right_s[j]) <= skew_s + 1e-9
    if good and len(good) == len({i for i, _ in good}) == len({j for _, j in good}):  # no ties between partners
        assert chosen is not None
        assert min(left_s[chosen[0]], right_s[chosen[1]]) >= max(good.values()) - 1e-9


def test_a_stamp_at_the_start_of_exposure_and_one_at_the_end_of_read_out_give_the_same_moment() -> None:
    period_s, light_s = 1 / 15, 0.01
    start = exposure_of(10.0, True, period_s, light_s)
    end = exposure_of(10.0 + period_s + light_s, False, period_s, light_s)
    assert start.start_s == pytest.approx(end.start_s)
    assert start.start_s <= start.middle_s <= end.middle_s


def test_the_reason_why_there_is_no_pair_is_said() -> None:
    assert why_no_pair([], frames(1.0), 0.0, 0.02, 0.5) == "no frame from the left camera"
    assert why_no_pair([], [], 0.0, 0.02, 0.5) == "no frame from the left and the right camera"
    assert why_no_pair(frames(1.0), frames(9.0), 0.0, 0.02, 5.0) == "no frame any more from the left camera"
    assert "200 ms too old" in why_no_pair(frames(1.0), frames(1.1), 1.2, 0.02, 0.5)
    assert "30.0 ms apart, more than max_skew_ms 20" in why_no_pair(frames(1.0), frames(1.03), 0.0, 0.02, 0.5)
