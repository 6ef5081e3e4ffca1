"""`job`: what it lists and shows, what it begins, and what it refuses."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import pytest

from daemon.commands import every_command
from daemon.console.interpreter import CommandResult, Interpreter
from daemon.events.pick_order import OrderStep, PickOrder
from daemon.pick.place_table import PlaceTable
from tests.fakes.fake_context import FakeFrontend, fake_context


@pytest.fixture
def context(tmp_path: Path) -> Any:
    context = fake_context(tmp_path)
    context.config.jobs = tmp_path / "jobs"
    context.cycle.placing = PlaceTable()
    context.begun = []

    async def begin_auto(order: PickOrder) -> None:
        context.begun.append(order)

    context.begin_auto = begin_auto
    return context


def say(context: Any, text: str) -> CommandResult:
    return asyncio.run(Interpreter(context, every_command()).interpret(text, FakeFrontend()))


def put(context: Any, name: str, text: str) -> None:
    context.config.jobs.mkdir(exist_ok=True)
    (context.config.jobs / f"{name}.yaml").write_text(text)


def test_a_job_is_listed_shown_and_begun(context: Any) -> None:
    put(context, "kit", "version: 1\nsteps: [{part: cube, count: 2}]\nif_missing: wait\n")
    assert say(context, "job").text == say(context, "job list").text == "kit: 2 parts, in turn: 2 cube"
    shown = say(context, "job show kit").text
    assert "2 cube to where it belongs" in shown
    assert "if a part is missing: wait" in shown
    for typed, count in (("job run kit", 2), ("job run kit.yaml 3", 6)):
        result = say(context, typed)
        again = "looking again every 10 s when a part is missing"
        assert result.text.startswith(f"Picking, job kit, {count} parts, {again};")
        assert context.begun[-1].count == count
    assert context.begun[0].steps == (OrderStep("cube", 2),)
    assert not context.begun[0].on_signal
    for typed, count in (("job run kit signal", 2), ("job run kit 3 signal", 6)):
        assert f"{count} parts, each when the line asks for it;" in say(context, typed).text
        assert (context.begun[-1].count, context.begun[-1].on_signal) == (count, True)


@pytest.mark.parametrize(
    ("typed", "told"),
    [
        ("job run kit", "steps[0].part: expected a taught part (cube), found wedge"),
        ("job run other", "no such job; choose from: kit"),
        ("job run", "job is missing"),
        ("job run kit 0", "TIMES"),
        ("job run kit 1 1", "one word too many"),
        ("job run kit 1 1 signal", "one word too many"),
        ("job run kit signal 1", "one word too many"),
        ("job run kit signals", "TIMES"),
        ("job walk", "walk: expected list, run or show"),
    ],
)
def test_what_cannot_be_begun_is_one_line_and_nothing_moves(context: Any, typed: str, told: str) -> None:
    put(context, "kit", "version: 1\nsteps: [{part: wedge}]\n")
    result = say(context, typed)
    assert told in result.text
    assert result.status != 0
    assert context.begun == []


def test_a_job_with_a_fault_is_listed_with_it_beside_those_without(context: Any) -> None:
    put(context, "kit", "version: 1\nsteps: [{part: cube}]\n")
    put(context, "worse", "version: 1\nsteps: 3\n")
    text = say(context, "job list").text
    assert "kit: 1 part, in turn: 1 cube" in text
    assert "worse.yaml:2: steps: expected a list, found 3" in text


def test_without_jobs_it_says_where_to_put_one(context: Any) -> None:
    assert say(context, "job list").text == f"There is no job. Put a job file into {context.config.jobs}."
    assert "there is no job: put a job file into" in say(context, "job run kit").text
