"""A part is learnt by walking round it as it lies in the simulated cell, and is then known."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daemon.arm import RefusedError
from daemon.commands.teaching import teach
from daemon.errors import CommandError
from daemon.teaching.mesh import read_mesh
from daemon.teaching.part_from_looks import deviations
from daemon.vision.geometry import Polyhedron
from tests.fakes.fake_context import FakeFrontend
from tests.fakes.simulated_time import SimulatedLoop
from tests.fakes.walked_round import DRAWN, drawn_cell, lay

pytestmark = pytest.mark.slow


class Person(FakeFrontend):
    """Answers every question alike, and keeps what was asked and said."""

    def __init__(self, answer: str = "y") -> None:
        super().__init__()
        self.answer, self.lines = answer, list[str]()

    @property
    def asks(self) -> bool:
        """Somebody sits there."""
        return True

    async def ask(self, question: str) -> str:
        """See the class."""
        self.asked.append(question)
        return self.answer if "new part" not in question else "y"

    async def say(self, text: str) -> None:
        """See the class."""
        self.lines.append(text)


def run(story: Any) -> Any:
    with asyncio.Runner(loop_factory=SimulatedLoop) as runner:
        return runner.run(story)


def test_a_part_of_eight_facets_is_learnt_to_three_tenths_of_a_millimetre_and_of_a_degree(tmp_path: Path) -> None:
    async def story() -> Any:
        async with drawn_cell(7, tmp_path) as here:
            lay(here, "hexagon", 0, 0.3)
            began_s = here.now_s
            answer = await teach.run(here.context, ["hexagon", "--around", "12"], Person())
            return answer, here.now_s - began_s, here.context.trainer.train()

    answer, seconds, trained = run(story())
    data = answer.data
    assert len(data["facets"]) == 7
    assert data["at_table"] == 6
    assert data["open_edges"] == {}
    corners = np.array(data["corners_mm"])
    sure = np.repeat(0.05**2 * np.eye(3)[None], len(corners), axis=0)
    learnt = Polyhedron(corners, tuple(tuple(ring) for ring in data["rings"]), sure)
    beside = [one for one in deviations(learnt, DRAWN["hexagon"]) if one is not None]
    assert len(beside) == 7
    assert max(one.length_mm for one in beside) < 0.3
    assert max(one.angle_deg for one in beside) < 0.3
    assert seconds < 60
    assert len(read_mesh("mesh.stl", Path(data["stl"]).read_bytes()).polygons) == 4 + 6 * 2
    assert all(verdict.right for verdict in trained.verdicts)
    assert not trained.left_out


def test_without_a_yes_nothing_moves(tmp_path: Path) -> None:
    async def story() -> Any:
        async with drawn_cell(7, tmp_path) as here:
            lay(here, "brick", 0, 0.3)
            frontend = Person("n")
            answer = await teach.run(here.context, ["brick", "--around"], frontend)
            return answer, frontend.asked[-1], here.log.said("move")

    answer, asked, moves = run(story())
    assert answer.data == {"kept": False}
    assert "10 places" in asked
    assert "20 s" in asked
    assert moves == []


def test_a_stop_on_the_way_ends_it_and_keeps_nothing(tmp_path: Path) -> None:
    async def story() -> Any:
        async with drawn_cell(7, tmp_path) as here:
            lay(here, "brick", 0, 0.3)
            teaching = asyncio.ensure_future(teach.run(here.context, ["brick", "--around"], Person()))
            await asyncio.sleep(3.0)
            await here.cycle.supervisor.stop("by a test")
            moves = len(here.log.said("move"))
            with pytest.raises(RefusedError, match="walk round: stopped by a test"):
                await teaching
            await asyncio.sleep(5.0)
            return moves, len(here.log.said("move")), here.context.trainer.model_store.views()

    before, after, views = run(story())
    assert 0 < before == after
    assert views == []


def test_an_empty_table_is_told_after_the_survey_views(tmp_path: Path) -> None:
    async def story() -> None:
        async with drawn_cell(7, tmp_path) as here:
            here.cell.clear()
            with pytest.raises(CommandError, match="no part is seen"):
                await teach.run(here.context, ["brick", "--around", "6"], Person())
            assert here.cycle.supervisor.fault_text is None

    run(story())


def test_one_camera_walks_round_as_well(tmp_path: Path) -> None:
    async def story() -> Any:
        async with drawn_cell(7, tmp_path, alone="left") as here:
            lay(here, "brick", 0, 0.4)
            return await teach.run(here.context, ["brick", "--around", "10"], Person())

    data = run(story()).data
    assert len(data["facets"]) == 5
    corners = np.array(data["corners_mm"])
    sure = np.repeat(0.05**2 * np.eye(3)[None], len(corners), axis=0)
    learnt = Polyhedron(corners, tuple(tuple(ring) for ring in data["rings"]), sure)
    beside = [one for one in deviations(learnt, DRAWN["brick"]) if one is not None]
    assert max(one.length_mm for one in beside) < 0.6
