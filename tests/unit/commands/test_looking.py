"""What an operator reads of a look."""

from __future__ import annotations

import numpy as np

from daemon.commands.looking import describe_scene
from daemon.vision.values import Cause, Facet, FacetView, Part, Recognition, Scene


def test_a_part_without_a_name_comes_with_the_cause_and_what_to_do_about_it() -> None:
    px = np.array([[300.0, 200], [300, 280], [380, 280], [380, 200]])
    facet = Facet(np.eye(4, 3), np.zeros((4, 3, 3)), px, px, np.zeros(4), 0.0, "square", 0.5)
    why = Recognition("unknown", 0.5, 0, 0, None, False, "part of it is hidden (a square)", cause=Cause.HIDDEN)
    note = f"unknown: {why.reason}"
    told = describe_scene(
        Scene((Part(why, (facet,), np.eye(4), np.eye(6), 0.1),), (), FacetView((), (), (), (), 2.0), (note,)), 80
    )
    assert "not named: part of it is hidden; move what lies before it, or look from another side" in told
    assert note not in told
