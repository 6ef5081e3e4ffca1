"""Why a part has no name, as an operator would say it who sees the pictures. Each case has one thing wrong with it."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from daemon.vision.health import ADVICE, cause_of_nothing, depth_doubt, with_causes
from daemon.vision.values import Cause, Facet, NearestGuess, Part, Recognition

Image = NDArray[np.uint8]
SQUARE = np.array([[300.0, 200], [300, 280], [380, 280], [380, 200]])
ON = slice(192, 289), slice(282, 389)  # where the square and its surroundings lie in either camera


def noisy(levels: np.ndarray, seed: int = 0) -> tuple[Image, Image]:
    rng = np.random.default_rng(seed)
    left, right = (np.clip(levels + rng.normal(0, 2, levels.shape), 0, 255).astype(np.uint8) for _ in range(2))
    return left, right


def plain(level: float = 120.0) -> np.ndarray:
    """A grey table with a brighter square on it."""
    levels = np.full((480, 640), level)
    levels[200:281, 290:381] *= 1.4
    return levels


def part(at: tuple[float, float] = (0, 0), label: str = "unknown", mm: float = 300.0, *, two_fit: bool = False) -> Part:
    """A single square facet moved by so many px, mm away."""
    px = SQUARE + np.array(at)
    corners = np.column_stack([(px - [320, 240]) * mm / 700, np.full(4, mm)])
    facet = Facet(corners, np.repeat(np.eye(3)[None] * 0.01, 4, 0), px, px - [10, 0], np.zeros(4), 0.0, "square", 0.5)
    pose = np.eye(4)
    pose[:3, 3] = corners.mean(0)
    candidates = ("cube", "pyramid") if two_fit else ()
    return Part(Recognition(label, 0.5, 0, 0, None, two_fit, "a square", candidates), (facet,), pose, np.eye(6), 0.1)


def guess(*shows: bool) -> NearestGuess:
    """The square's own four sides, each of which shows or not."""
    edges = np.stack([SQUARE, np.roll(SQUARE, -1, 0)], 1)
    return NearestGuess("cube", edges, edges - [10, 0], np.array(shows), np.array(shows))


def cause(one: Part, levels: np.ndarray, *others: Part, guesses: tuple[NearestGuess, ...] = ()) -> Cause:
    found = with_causes((*others, one), guesses, noisy(levels))[-1].recognition
    assert found.cause is not None
    assert found.reason == f"{ADVICE[found.cause].words} (a square)"
    return found.cause


def test_what_nothing_is_wrong_with_is_like_nothing_taught() -> None:
    assert cause(part(), plain()) is Cause.STRANGE


def test_a_part_with_a_name_has_no_cause() -> None:
    (named,) = with_causes((part(label="cube"),), (), noisy(plain()))
    assert named.recognition.cause is None
    assert named.recognition.reason == "a square"


@pytest.mark.parametrize("at", [(0, -198), (0, 198), (-295, 0), (258, 0)])
def test_an_outline_that_ends_at_the_border_of_either_camera_was_cut_there(at: tuple[float, float]) -> None:
    assert cause(part(at), plain()) is Cause.BORDER
    inward = tuple(np.array(at) * 0.9)
    assert cause(part((inward[0], inward[1])), plain()) is Cause.STRANGE


def test_the_light_is_judged_where_the_part_lies() -> None:
    dark, bright = plain(), plain()
    dark[ON] = 12
    bright[ON] = 300
    assert cause(part(), dark) is Cause.DARK
    assert cause(part(), bright) is Cause.BURNT
    elsewhere = plain()
    elsewhere[300:, :] = 12
    elsewhere[:100, :] = 300
    assert cause(part(), elsewhere) is Cause.STRANGE


def test_one_camera_in_the_dark_is_enough() -> None:
    left, right = noisy(plain())
    (found,) = with_causes((part(),), (), (left, right // 12))
    assert found.recognition.cause is Cause.DARK


def test_a_named_part_before_it_hides_it_and_one_behind_it_or_beside_it_does_not() -> None:
    assert cause(part(), plain(), part((60, 0), "cube", 250)) is Cause.HIDDEN
    assert cause(part(), plain(), part((60, 0), "cube", 350)) is Cause.STRANGE
    assert cause(part(), plain(), part((100, 0), "cube", 250)) is Cause.STRANGE
    assert cause(part(), plain(), part((60, 0), "unknown", 250)) is Cause.STRANGE


def test_a_guess_most_of_which_shows_is_a_part_that_something_hides() -> None:
    assert cause(part(), plain(), guesses=(guess(True, True, True, False),)) is Cause.HIDDEN
    assert cause(part(), plain(), guesses=(guess(True, False, False, False),)) is Cause.STRANGE
    assert cause(part((-150, 0)), plain(), guesses=(guess(True, True, True, False),)) is Cause.STRANGE


def test_what_fits_two_parts_shows_too_little() -> None:
    assert cause(part(two_fit=True), plain()) is Cause.ALIKE


@pytest.mark.parametrize("two_fit", [False, True])
def test_a_patterned_table_is_the_cause_where_nothing_nearer_is(two_fit: bool) -> None:
    rng = np.random.default_rng(1)
    grain = cv2.GaussianBlur(rng.normal(size=(480, 640)), (0, 0), 5)
    assert cause(part(two_fit=two_fit), plain() + 12 * grain / grain.std()) is Cause.PATTERNED


def test_where_nothing_is_seen_the_whole_picture_is_asked() -> None:
    empty = np.full((480, 640), 120.0)
    rings = 20 * np.sin(np.hypot(*np.mgrid[-240:240, -320:320]) / 4)
    assert cause_of_nothing(noisy(empty)) is None
    assert cause_of_nothing(noisy(empty / 10)) is Cause.DARK
    assert cause_of_nothing(noisy(empty * 3)) is Cause.BURNT
    assert cause_of_nothing(noisy(empty + rings)) is Cause.PATTERNED


def test_print_and_edges_at_two_depths_are_said_to_be_the_rigs_calibration():
    apart = replace(guess(True, True), print_apart_px=-3.0)
    (said,) = depth_doubt([guess(True, True), apart])
    assert said.startswith("depth calibration: edges and print of what may be cube do not agree")
    assert "(3 px); `facetctl calibrate stereo`" in said
