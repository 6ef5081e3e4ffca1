"""What an operator reads of a look."""

from __future__ import annotations

import asyncio
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from daemon.commands import every_command
from daemon.commands.looking import describe_scene
from daemon.console.interpreter import Console
from daemon.vision.values import Cause, Facet, FacetView, Part, Recognition, Scene
from tests.worlds.fake_context import FakeDoor, fake_context


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


@pytest.mark.parametrize("columns", [40, 80])
def test_tables_of_views_and_parts_fit_the_terminal(tmp_path: Path, columns: int) -> None:
    note = {"taught": "2026-11-23T04:31:16+00:00", "facets": [["square"] * 3], "who": "anna (process 17168)"}
    view = SimpleNamespace(name="pentagonal_prism/1", label="pentagonal_prism", number=1, damage=None, note=note)
    context = fake_context(tmp_path)
    context.trainer.model_store.views = lambda *_: [view]
    console = Console(context, every_command())
    for word in ("views", "parts"):
        told = asyncio.run(console.interpret(word, FakeDoor(columns=columns))).text
        assert max(map(len, told.splitlines())) <= columns
        assert word == "parts" or "2026-11-23 04:31 UTC" in told
