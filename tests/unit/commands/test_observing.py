"""What an operator reads of a look."""

from __future__ import annotations

import asyncio
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from daemon.arm import Fault
from daemon.commands import every_command
from daemon.commands.observing import describe_scene
from daemon.console.interpreter import Interpreter
from daemon.events.codes import CauseCode, FaultCause
from daemon.vision.values import Cause, Facet, FacetView, Part, Recognition, Scene
from tests.fakes.fake_context import FakeFrontend, fake_context


def test_a_part_without_a_name_comes_with_the_cause_and_what_to_do_about_it() -> None:
    px = np.array([[300.0, 200], [300, 280], [380, 280], [380, 200]])
    facet = Facet(np.eye(4, 3), np.zeros((4, 3, 3)), px, px, np.zeros(4), 0.0, "square", 0.5)
    why = Recognition("unknown", 0.5, 0, 0, None, False, "part of it does not show (a square)", cause=Cause.HIDDEN)
    note = f"unknown: {why.reason}"
    told = describe_scene(
        Scene((Part(why, (facet,), np.eye(4), np.eye(6), 0.1),), (), FacetView((), (), (), (), 2.0), (note,)), 80
    )
    assert "not named: part of it does not show; look from nearer or from another side, or move what covers it" in told
    assert note not in told


@pytest.mark.parametrize("columns", [40, 80])
def test_tables_of_views_and_parts_fit_the_terminal(tmp_path: Path, columns: int) -> None:
    note = {"taught": "2026-11-23T04:31:16+00:00", "facets": [["square"] * 3], "who": "anna (process 17168)"}
    view = SimpleNamespace(name="pentagonal_prism/1", label="pentagonal_prism", number=1, damage=None, note=note)
    context = fake_context(tmp_path)
    context.trainer.model_store.views = lambda *_: [view]
    console = Interpreter(context, every_command())
    for word in ("views", "parts"):
        told = asyncio.run(console.interpret(word, FakeFrontend(columns=columns))).text
        assert max(map(len, told.splitlines())) <= columns
        assert word == "parts" or "2026-11-23 04:31 UTC" in told


@pytest.mark.parametrize(
    ("fault", "held", "told"),
    [
        (None, None, ["gripper   content unknown: report it by `holding yes` or `holding no`"]),
        (None, True, ["gripper   holds a part: the next pick first puts it into the bin"]),
        (None, False, []),
        (Fault("stopped by ann"), False, []),
        (
            Fault("*Arm power off*", (FaultCause(CauseCode.ARM_POWER),)),
            False,
            ["to do     find out what cut it, switch arm power on at the controller, then `resume`"],
        ),
    ],
)
def test_status_tells_what_stands_between_the_operator_and_the_next_pick(
    fault: Fault | None, held: bool | None, told: list[str], tmp_path: Path
) -> None:
    """A hand that might hold a part was told by the next `pick` only, and what to do about a fault by the guide."""
    context = fake_context(tmp_path)
    context.cycle.fault, context.cycle.held = fault, held
    lines = asyncio.run(Interpreter(context, every_command()).interpret("status", FakeFrontend())).text.splitlines()
    assert lines[0].startswith("cell")
    assert lines[1 : 1 + len(told)] == told
    assert lines[1 + len(told)].startswith("doing")


def test_status_lists_what_the_last_pick_left_alone(tmp_path: Path) -> None:
    """The guide had said so, and only `--json` did."""
    context = fake_context(tmp_path)
    left = {"label": "cube", "at": [520.4, -90.0, -275.2], "why": "no grasp holds it as it lies"}
    context.cycle.skipped = [left]
    told = asyncio.run(Interpreter(context, every_command()).interpret("status", FakeFrontend())).text.splitlines()
    assert told[-1] == "skipped   cube at world x 520 y -90 z -275 mm: no grasp holds it as it lies"


def test_status_says_what_a_pick_is_at_in_words(tmp_path: Path) -> None:
    context = fake_context(tmp_path)
    status = context.cycle.status()
    context.cycle.status = lambda: status | {"doing": "pick", "state": "stop_n"}
    answer = asyncio.run(Interpreter(context, every_command()).interpret("status", FakeFrontend()))
    assert "doing     pick (approach)" in answer.text
