"""What the picture of a look shows beside facets: what an unnamed part came nearest to, with its edges."""

from __future__ import annotations

import numpy as np

from daemon.vision.draw import MARGIN, SCALE, SHOWS, SHOWS_NOT, draw_scene
from daemon.vision.values import FacetView, NearestGuess, Scene

GREY = np.full((120, 160), 90, np.uint8)
ACROSS, DOWN = [[20.0, 30.0], [120.0, 30.0]], [[120.0, 30.0], [120.0, 90.0]]


def along(picture: np.ndarray, ends: list[list[float]], colour: tuple[int, int, int]) -> float:
    """The share of a line that has a colour; ends in px of the left camera."""
    places = np.linspace(ends[0], ends[1], 200) * SCALE + [0, MARGIN + 8]
    return float(np.mean([np.abs(picture[int(y), int(x)].astype(int) - colour).max() < 60 for x, y in places]))


def scene(*guesses: NearestGuess) -> Scene:
    return Scene((), (), FacetView((), (), (), (), 2.0), guesses=guesses)


def test_edges_for_a_guess_are_drawn_through_and_edges_against_it_dashed() -> None:
    edges = np.array([ACROSS, DOWN])
    shows = np.array([True, False])
    guess = NearestGuess("cube", edges, edges, shows, shows)
    plain, drawn = (draw_scene(GREY, GREY, s) for s in (scene(), scene(guess)))
    assert along(plain, ACROSS, SHOWS) == 0
    assert along(drawn, ACROSS, SHOWS) > 0.9
    assert 0.3 < along(drawn, DOWN, SHOWS_NOT) < 0.8
    assert drawn.shape[0] > plain.shape[0]  # the line below that says so


def test_the_share_that_shows_is_by_length_over_both_cameras() -> None:
    edges = np.array([ACROSS, DOWN])  # 100 px and 60 px
    guess = NearestGuess("cube", edges, edges[:1], np.array([False, True]), np.array([True]))
    assert guess.share == 160 / 260
    nothing = NearestGuess("cube", np.zeros((0, 2, 2)), np.zeros((0, 2, 2)), np.zeros(0, bool), np.zeros(0, bool))
    assert nothing.share == 0
    draw_scene(GREY, GREY, scene(nothing))
