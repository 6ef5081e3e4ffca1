"""`place`: what it says of places, teaches, clears and drops, and what it refuses."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from daemon import frames
from daemon.commands import every_command, placing
from daemon.console.interpreter import CommandResult, Interpreter
from daemon.pick.place_table import PlaceTable
from daemon.pick.planning.place_plan import PlannedMotion, SidePlan
from daemon.pick.settings import Settings
from daemon.store.place_file import FILE, PatternEntry, PlaceEntry, load_places, with_place, write_places
from daemon.store.place_status import PlaceStatus, PlaceStatuses
from tests.fakes.fake_cell import shape_of
from tests.fakes.fake_context import FakeFrontend, fake_context

POSE = ((1.0, 0.0, 0.0, 400.0), (0.0, 1.0, 0.0, -200.0), (0.0, 0.0, 1.0, -275.0), (0.0, 0.0, 0.0, 1.0))


class Recogniser:
    labels = ("cube", "pyramid")

    def shape(self, label: str) -> Any:
        return shape_of(label) if label in self.labels else None


@pytest.fixture
def context(tmp_path: Path) -> Any:
    """Two places, nest and other, of cubes; a reload takes the file over."""
    path = tmp_path / FILE
    for name in ("nest", "other"):
        write_places(path, with_place(load_places(path), name, PlaceEntry(part="cube", pose=POSE)))
    context = fake_context(tmp_path)

    def take_over() -> None:
        table = PlaceTable(load_places(path), PlaceStatuses(tmp_path))
        table.know({label: shape_of(label) for label in Recogniser.labels})
        context.cycle.placing = table

    async def reload(who: str | None, change: Any = None) -> str:
        if change is not None:
            await change()
        take_over()
        return "reloaded"

    take_over()
    context.cycle.recogniser = Recogniser()
    context.config.places_file = path
    context.config.values.pick = SimpleNamespace(limits=SimpleNamespace(table_z_mm=-300.0))
    context.reload = reload
    return context


def say(context: Any, text: str, frontend: FakeFrontend | None = None) -> CommandResult:
    interpreter = Interpreter(context, every_command())
    return asyncio.run(interpreter.interpret(text, frontend or FakeFrontend()))


def test_places_are_shown_with_what_is_known_of_them(context: Any) -> None:
    context.cycle.placing.statuses.put("nest", PlaceStatus.CLAIMED)
    context.cycle.placing.statuses.put("nest", PlaceStatus.OFF, 1.52, 0.31, "1.52 mm and 0.31 degrees off")
    answer = say(context, "place show")
    assert "nest" in answer.text
    assert "cube: off, 1.52 mm and 0.31 degrees off" in " ".join(answer.text.split())
    assert answer.data["places"]["other"]["status"] == "free"
    assert answer.data["places"]["other"]["at"] == pytest.approx([400, -200, -275])
    assert "side 6: 4 corners, 50 50 50 50 mm" in say(context, "place show cube").text
    assert say(context, "place").text == answer.text


def test_a_cell_without_places_says_where_parts_go(context: Any) -> None:
    for name in ("nest", "other"):
        assert say(context, f"place drop {name}").status == 0
    assert say(context, "place show").text == "No place is taught; every part goes to the bin."
    assert say(context, "place check").text.startswith("Every place is free")


def test_a_place_is_taught_where_the_part_lies_flat_on_the_table(context: Any) -> None:
    lean = frames.rigid(frames.rotation_from_vector(np.array([0.01, 0.0, 0.0])), np.array([450.0, 100.0, -274.3]))
    context.cycle.located = lean
    answer = say(context, "place teach slot cube")
    assert answer.status == 0, answer.text
    assert context.cycle.told == ["locate cube"]
    place = context.cycle.placing.places.named("slot")
    assert place.frame_from_part[:3, 3] == pytest.approx([450.0, 100.0, -275.0], abs=0.01)
    state = context.cycle.placing.statuses.of("slot")
    assert state.status is PlaceStatus.RIGHT, "the part lies there"
    assert "place clear slot" in answer.text


def test_a_place_is_taught_by_the_part_in_the_gripper(context: Any) -> None:
    """It is not filled yet, and not free either: the part is above it."""
    context.cycle.located = frames.rigid(np.eye(3), np.array([450.0, 100.0, -274.6]))
    answer = say(context, "place teach slot here")
    assert answer.status == 0, answer.text
    assert context.cycle.told == ["held here"]
    place = context.cycle.placing.places.named("slot")
    assert place.part == "cube"
    assert place.frame_from_part[:3, 3] == pytest.approx([450.0, 100.0, -275.0], abs=0.01)
    assert context.cycle.placing.statuses.of("slot").status is PlaceStatus.CLAIMED
    assert "slot is where the cube is in the gripper" in answer.text
    assert "Known to 0.30 mm and 0.10 degrees (one standard deviation)." in answer.text
    assert "cannot be used" not in answer.text


def test_a_place_that_is_known_less_well_than_its_tolerance_is_told_so(context: Any) -> None:
    context.cycle.located = frames.rigid(np.eye(3), np.array([450.0, 100.0, -274.6]))
    for errs in ((0.6, 0.1), (0.1, 0.6)):
        context.cycle.errs = errs
        answer = say(context, "place teach slot here", FakeFrontend(answers=["y"]))
        assert "too much for its tolerance of 1 mm and 1 degrees. If you can, lay the part there" in " ".join(
            answer.text.split()
        )


def test_a_place_taught_in_the_air_by_a_part_that_leans_is_said_to_be_of_no_use(context: Any) -> None:
    turn = frames.rotation_from_vector(np.array([0.3, 0.0, 0.0]))
    context.cycle.located = frames.rigid(turn, np.array([450.0, 100.0, -100.0]))
    answer = say(context, "place teach slot here")
    assert "It cannot be used: cube would not lie flat there: teach the place again" in answer.text


def test_a_place_that_moved_is_told_and_to_be_looked_at(context: Any) -> None:
    statuses, path = context.cycle.placing.statuses, context.config.places_file
    for status in (PlaceStatus.CLAIMED, PlaceStatus.SET, PlaceStatus.RIGHT):
        statuses.put("nest", status)
    moved = tuple((*row[:3], row[3] + 30.0 * (k == 0)) for k, row in enumerate(POSE))
    write_places(path, with_place(load_places(path), "nest", PlaceEntry(part="cube", pose=moved)))  # type: ignore[arg-type]
    asyncio.run(context.reload("x"))
    answer = say(context, "place show nest")
    assert "to be looked at, it was seen right 30.0 mm from where it is now" in " ".join(answer.text.split())
    assert "place nest: it was seen right 30.0 mm from where it is now" in context.troubles.active["places"]
    assert "place check" in context.troubles.active["places"]
    assert sorted(say(context, "place check").data["places"]) == ["nest", "other"], "both were meant for one spot"
    say(context, "place clear all", FakeFrontend(answers=["y"]))
    assert "places" not in context.troubles.active


def test_a_kill_while_a_place_is_taught_leaves_no_place_that_counts_as_free(
    context: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    context.cycle.located = np.array(POSE)
    path = context.config.places_file

    def killed(*_: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(placing, "write_places", killed)
    with pytest.raises(KeyboardInterrupt):
        say(context, "place teach slot cube")
    write_places(path, with_place(load_places(path), "slot", PlaceEntry(part="cube", pose=POSE)))
    asyncio.run(context.reload("x"))
    assert context.cycle.placing.statuses.of("slot").status is PlaceStatus.RIGHT


def test_a_place_that_is_taught_again_keeps_its_manner(context: Any) -> None:
    entry = PlaceEntry(part="cube", pose=POSE, tolerance_mm=0.4, approach_mm=90.0)
    asyncio.run(context.reload("x"))
    write_places(context.config.places_file, with_place(context.cycle.placing.places, "nest", entry))
    asyncio.run(context.reload("x"))
    context.cycle.located = np.array(POSE)
    no = FakeFrontend(answers=["n"])
    assert say(context, "place teach nest cube", no).status == 1
    assert no.asked == ["There is a place nest. Replace its pose? [y/n]"]
    assert say(context, "place teach nest cube", FakeFrontend(answers=["y"])).status == 0
    place_settings = context.cycle.placing.places.named("nest").settings
    assert (place_settings.tolerance_mm, place_settings.approach_mm) == (0.4, 90.0)


def test_a_place_that_a_person_emptied_is_filled_again(context: Any) -> None:
    for name in ("nest", "other"):
        context.cycle.placing.statuses.put(name, PlaceStatus.CLAIMED)
    assert say(context, "place clear nest").status == 0
    assert context.cycle.placing.statuses.of("nest").status is PlaceStatus.EMPTIED
    asking = FakeFrontend(answers=["n"])
    assert say(context, "place clear all", asking).status == 1
    assert context.cycle.placing.statuses.of("other").status is PlaceStatus.CLAIMED
    assert say(context, "place clear all", FakeFrontend(answers=["y"])).status == 0
    assert not context.cycle.placing.taken()


def test_a_pattern_is_shown_looked_at_and_cleared_by_its_name(context: Any) -> None:
    tray = PatternEntry(part="cube", first=POSE, row_end_mm=(580, -200, -275), column_end_mm=(400, 0, -275), columns=3,
                        rows=2)  # fmt: skip
    path = context.config.places_file
    write_places(path, replace(load_places(path).file, patterns={"tray": tray}))
    asyncio.run(context.reload("x"))
    statuses = context.cycle.placing.statuses
    for name in ("tray.2", "tray.5", "nest"):
        statuses.put(name, PlaceStatus.CLAIMED)
    assert sorted(say(context, "place show tray").data["places"]) == [f"tray.{k}" for k in range(1, 7)]
    assert sorted(say(context, "place check tray").data["places"]) == ["tray.2", "tray.5"]
    asking = FakeFrontend(answers=["y"])
    assert say(context, "place clear tray", asking).text.startswith("6 places marked as emptied")
    assert asking.asked == ["Are all 6 places empty? [y/n]"]
    assert statuses.of("tray.5").status is PlaceStatus.EMPTIED
    assert statuses.of("nest").status is PlaceStatus.CLAIMED


def test_places_are_not_cleared_under_a_pick(context: Any) -> None:
    context.cycle.doing = "pick"
    assert "a job is running" in say(context, "place clear nest").text


def test_only_places_that_are_not_free_are_looked_at_unless_one_is_named(context: Any) -> None:
    context.cycle.placing.statuses.put("other", PlaceStatus.CLAIMED)
    say(context, "place check")
    say(context, "place check nest")
    assert context.cycle.told == ["look at other", "look at nest"]


def test_parts_say_where_they_go_and_status_counts_places(context: Any) -> None:
    context.cycle.placing.statuses.put("other", PlaceStatus.CLAIMED)
    goes = say(context, "parts").data["parts"]
    assert goes["cube"]["goes"] == "to 2 places, 1 free"
    assert goes["pyramid"]["goes"] == "to the bin"
    answer = say(context, "status")
    assert answer.data["places"] == {"free": 1, "claimed": 1}
    assert "places    2: 1 claimed, 1 free" in answer.text
    assert "each_place" not in answer.data, "outlines of a thousand places are 150 kB"
    nest, other = say(context, "status places").data["each_place"]
    assert (nest["name"], nest["part"], nest["status"], other["status"]) == ("nest", "cube", "free", "claimed")
    assert sorted(nest["outline"]) == [[375.0, -225.0], [375.0, -175.0], [425.0, -225.0], [425.0, -175.0]]


def test_from_which_sides_a_part_can_be_brought_to_its_places_is_told_side_by_side(context: Any) -> None:
    context.parts = ("cube", "pyramid")
    context.cycle.settings = Settings()
    first, second = (PlannedMotion(told, *[np.eye(4)] * 4) for told in ("50 mm wide", "49 mm wide"))
    yes, some = SidePlan(1, 4, 4, (first,), ""), SidePlan(2, 3, 4, (first, second), "out of reach")
    no = SidePlan(3, 0, 4, (), "none of its 12 grasps in reach can set it down at nest")
    context.cycle.plans, frontend = (yes, some, no), FakeFrontend()
    answer = say(context, "place plan cube nest", frontend)
    assert frontend.said[:3] == [
        "nest, from side 1 down: yes, 50 mm wide",
        "nest, from side 2 down: in 3 of 4 headings on the table: 2 grasps: 50 mm wide, laid down, then 49 mm wide; "
        "in the others: out of reach",
        "nest, from side 3 down: no: none of its 12 grasps in reach can set it down at nest",
    ]
    picture = context.config.places_file.with_name("place-plan.svg")
    told = "The cube can be brought to nest from 4 of 6 sides that it can lie on."
    assert answer.text == f"{told} Picture: {picture}"
    assert [(plan["found"], len(plan["grasps"])) for plan in answer.data["plans"]["nest"]][:3] == [
        (4, 1),
        (3, 2),
        (0, 0),
    ]
    assert picture.read_text().count("<polygon") >= 3 * (2 + 4)
    assert "nest from 4 of 6 sides; other from 4 of 6 sides" in say(context, "place plan cube").text
    context.cycle.plans = (no,)
    assert say(context, "place plan cube nest").status == 1
    assert say(context, "place plan pyramid").text == "The pyramid has no place: it goes to the bin."


@pytest.mark.parametrize(
    ("text", "want"),
    [
        ("place plan", "part is missing: place plan PART [NAME]; choose from:"),
        ("place plan cube shelf", "shelf: no such place"),
        ("place pile", "pile: expected check, clear, drop, plan, show or teach; usage: place show"),
        ("place check shelf", "shelf: no such place"),
        ("place clear", "place or pattern is missing: place clear NAME|all"),
        ("place teach slot", "PART is missing: place teach NAME PART|here"),
        ("place teach slot here now", "now: one word too many"),
        ("place teach Slot cube", "a place's name has small letters"),
        ("place teach all cube", "a place's name has small letters"),
        ("place teach slot bracket", "bracket: no such part"),
        ("place drop shelf", "shelf: no such place or pattern"),
        ("place show nest now", "now: one word too many"),
    ],
)
def test_what_cannot_be_meant_changes_nothing(context: Any, text: str, want: str) -> None:
    before = context.config.places_file.read_bytes()
    answer = say(context, text)
    assert want in answer.text
    assert answer.status != 0
    assert context.cycle.told == []
    assert context.config.places_file.read_bytes() == before


def test_in_a_simulated_cell_the_old_word_for_showing_a_part_leads_to_the_new_one(context: Any) -> None:
    context.hardware.operator = SimpleNamespace(labels=("cube", "pyramid"))
    assert "`show cube 2`" in say(context, "place cube 2").text
