"""What an outline in one eye may be: guesses, and none where no pose would look like it."""

from __future__ import annotations

import numpy as np
import pytest

from daemon.store.library import load_facets
from daemon.vision.geometry import baseline
from daemon.vision.model import empty_model, learn_view
from daemon.vision.registration.pose_guesses import guesses_from_corners, guesses_from_outline
from tests.worlds.rigs import rig
from tests.worlds.solids import CUBE, pose, view_of

WHERE = pose(np.array([0.6, 0.5, 0.7]), 0.3, 320.0)
MODEL = learn_view(empty_model(load_facets()), view_of(CUBE, WHERE), "cube")
GEOMETRY = baseline(rig())
OUTLINES = {
    "one point": [[300.0, 200.0]] * 4,
    "two corners in one place": [[300.0, 200.0], [295.4, 208.4], [363.8, 191.0], [363.8, 191.0]],
    "a line": [[300.0, 200.0], [320.0, 200.0], [340.0, 200.0], [360.0, 200.0]],
    "crossing itself": [[300.0, 200.0], [400.0, 300.0], [400.0, 200.0], [300.0, 300.0]],
    "folded back": [[300.0, 200.0], [400.0, 200.0], [300.0, 200.0], [400.0, 200.0]],
}


@pytest.mark.parametrize("name", OUTLINES)
def test_an_outline_that_is_no_polygon_is_no_guess_and_no_crash(name: str) -> None:
    corners = np.array(OUTLINES[name])
    for guess in guesses_from_outline(corners, "left", GEOMETRY, MODEL):
        assert np.isfinite(guess.poses).all()
    for guess in guesses_from_corners([(corners, "left")], GEOMETRY, MODEL):
        assert np.isfinite(guess.poses).all()
