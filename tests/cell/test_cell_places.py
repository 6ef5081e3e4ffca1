"""End to end on the simulated cell: parts set down at their places, seen there, and what is told when they are not."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daemon.events.codes import DecisionCode
from daemon.pick.planning.place_goals import Goal, goal_of
from daemon.store.place_file import Place, PlaceSettings
from daemon.store.place_status import PlaceStatus
from drivers.simcell.parts import TAUGHT
from drivers.simcell.world import PlacedPart, World
from tests.fakes.chosen import few
from tests.fakes.regrasps import turned_over
from tests.fakes.set_downs import Mishap, drawn_model, model_of, places_of, set_down_made, side_down_of, true_error
from tests.fakes.simulated_cell import rig

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("seed", few([0, 6, 2, 3], 2))
def test_a_part_is_set_down_at_its_place_turned_as_it_is_to_be_and_seen_right(seed: int, tmp_path: Path) -> None:
    made = asyncio.run(set_down_made(seed, TAUGHT[seed % len(TAUGHT)], tmp_path, drawn_model()))
    assert (made.end.outcome, made.state.status, made.where) == ("picked", PlaceStatus.RIGHT, "table"), made.end.why
    assert made.error_mm < 1.0
    assert made.error_deg < 1.0
    assert made.state.off_mm == pytest.approx(made.error_mm, abs=0.7)


def nudged(world: World, part: PlacedPart, rng: np.random.Generator) -> None:
    world.nudge(part.name, 2.5, 1.5)


def turned(world: World, part: PlacedPart, rng: np.random.Generator) -> None:
    world.nudge(part.name, 0.0, 0.0, np.radians(4.0))


def taken(world: World, part: PlacedPart, rng: np.random.Generator) -> None:
    world.remove(part.name)


@pytest.mark.parametrize(
    ("mishap", "status"), few([(turned, PlaceStatus.OFF), (nudged, PlaceStatus.OFF), (taken, PlaceStatus.MISSING)], 1)
)
def test_what_happened_to_a_part_after_it_was_let_go_is_told(
    mishap: Mishap, status: PlaceStatus, tmp_path: Path
) -> None:
    made = asyncio.run(set_down_made(4, "cube", tmp_path, drawn_model(), mishap))
    assert made.state.status is status, made.state
    assert made.end.outcome == ("off" if status is PlaceStatus.OFF else "released")


def test_a_tray_that_was_half_filled_is_gone_on_with_where_it_was_left(tmp_path: Path) -> None:
    """The second place is one at which a killed daemon was about to let go: looked at, found empty, and filled."""

    async def story() -> tuple[list[str], list[str], list[tuple[float, float]]]:
        async with rig(seed=5, model=drawn_model()) as here:
            here.cell.scatter(["cube"], np.random.default_rng(5))
            side = side_down_of(here, "cube")
            assert side is not None
            places = tuple(
                Place(f"tray.{k}", PlaceSettings(part="cube"), np.eye(4), None, side, (400.0, y, -300.0), 10.0)
                for k, y in enumerate((-250.0, 250.0), start=1)
            )
            table = places_of(here, tmp_path, places)
            first = await here.cycle.pick()
            table.statuses.put("tray.2", PlaceStatus.CLAIMED)
            table.statuses.put("tray.2", PlaceStatus.SET)
            again = places_of(here, tmp_path, places)
            here.cell.world.stand("cube", 0, 520.0, 40.0, 0.3)
            second = await here.cycle.pick()
            pairs = zip(places, here.cell.world.parts, strict=True)
            errors = [true_error(again.goals[place.name], part) for place, part in pairs]
            return [first.outcome, second.outcome], [str(again.status(p.name)) for p in places], errors

    outcomes, statuses, errors = asyncio.run(story())
    assert (outcomes, statuses) == (["picked", "picked"], ["seen right", "seen right"])
    assert max(mm for mm, _ in errors) < 1.0


def test_a_part_that_no_one_grasp_brings_to_its_place_is_laid_on_the_table_and_taken_anew() -> None:
    """In other scenes one grasp does, or its edges do not show in the gripper, and it goes to the bin."""
    made = asyncio.run(turned_over("bracket", 0, 0, 2001, model_of(("bracket",))))
    assert (made.grasps, made.laid) == (2, 1)
    assert (made.end.outcome, made.state.status, made.where) == ("picked", PlaceStatus.RIGHT, "table"), made.told
    assert made.error_mm < 1.0
    assert made.error_deg < 1.0


def test_a_place_is_taught_by_the_part_that_is_held_there(tmp_path: Path) -> None:
    """A pick is stopped on its way with the part, and the arm brought low over the table, from there by the pendant:
    what is said of the part there, and how sure that is, is held against where the cell truly has it."""

    async def story() -> tuple[str, float, float, float, float]:
        async with rig(seed=6, model=drawn_model()) as here:
            here.cell.scatter(["cube"], np.random.default_rng(6))
            heard, stops = here.log.heard, list[asyncio.Task[Any]]()

            def hears(kind: str, fields: dict[str, Any]) -> None:
                heard(kind, fields)
                if kind == "decision" and fields["code"] == DecisionCode.IN_GRIPPER:
                    stops.append(asyncio.ensure_future(here.cycle.supervisor.stop("by the test")))

            here.log.heard = hears
            await here.cycle.pick()
            await asyncio.gather(*stops)
            here.cycle.supervisor.resume()
            low = (await here.cycle.where()).world_from_tool.copy()
            low[2, 3] = -230.0
            await here.cycle.move_to(low, "low over the table")
            turned = (await here.cycle.where()).joints_rad + np.radians([7.0, 0.0, 0.0, 0.0, 0.0, 5.0])
            with here.cell.server.controller() as controller:
                controller.machine.drive_by_pendant(turned)
            while not await here.robot.at_rest():
                pass
            label, pose, errs_mm, errs_deg = await here.cycle.held_here()
            held = here.cell.world.held
            assert held is not None
            shape = drawn_model().metric[label].solid
            level = goal_of(Place("nest", PlaceSettings(part=label), np.eye(4), np.eye(4)), shape)
            there = Goal(level.place, shape, tuple(pose @ each for each in level.poses), 0.0)
            lies = replace(held, pose=held.world_from_part(here.cell.world_from_tool()))
            return (label, *true_error(there, lies), errs_mm, errs_deg)

    label, error_mm, error_deg, errs_mm, errs_deg = asyncio.run(story())
    assert label == "cube"
    assert error_mm < 3.0 * errs_mm < 3.0
    assert error_deg < 3.0 * errs_deg < 3.0
