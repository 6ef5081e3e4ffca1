"""The wire ledger: whole, and good enough to be played again to the protocol and to a controller."""

import asyncio
import json
from collections.abc import Sequence
from copy import copy
from typing import Any

import pytest

from drivers.ledger import Ledger
from drivers.puma560 import READY_RAD
from drivers.simcell.arm import SimulatedArm
from drivers.simcell.controller import Controller, LineFault, Machine
from drivers.val2.dialect import Dialect
from drivers.val2.link import Link
from drivers.val2.location import Location
from drivers.val2.wire import Prompt, Reader
from tests.fakes.arm_line import ArmLine, MakesLine
from tests.fakes.in_time import lived
from tests.fakes.ledger_replay import replay, what_was_heard, what_was_read

Records = list[dict[str, Any]]
SCALE = 20.0
GOAL = Location(520.0, 0.0, -100.0, 0.0, 80.0, 0.0)


def a_session(timed_line: MakesLine, faults: Sequence[LineFault] = (), **settings: Any) -> Records:
    """The ledger of a short session: questions asked, moves made, errors met; perhaps with noise."""

    async def scene() -> ArmLine:
        cell = timed_line(time_scale=SCALE)
        async with cell.link(Dialect(resync_s=0.4, **settings)) as link:
            cell.faults.line.extend(map(copy, faults))
            await link.command("SPEED 80")
            await link.move(GOAL)
            await link.wait_until_at_rest(GOAL)
            await link.calibrate("N")
            for text in ("HERE P", "DO SET Q=P", "STATUS"):
                await link.command(text)
            await link.stop_motion()
        return cell

    records: Records = json.loads(json.dumps(lived(scene()).records))
    return records


def test_a_session_s_ledger_is_whole(timed_line: MakesLine) -> None:
    records = a_session(timed_line)
    assert [record["seq"] for record in records] == list(range(len(records)))
    assert len(records) > 20


@pytest.mark.parametrize(
    "faults",
    [
        [],
        [LineFault("to_host", "drop", after=9)],
        [LineFault("to_controller", "double", after=25)],
        [LineFault("to_host", "flip", after=180, count=3)],
    ],
)
@pytest.mark.parametrize("pause_s", [0.0, 0.0005])
def test_a_ledger_played_to_the_protocol_gives_the_same_events(
    timed_line: MakesLine, faults: list[LineFault], pause_s: float
) -> None:
    records = a_session(timed_line, faults, character_pause_s=pause_s)
    assert what_was_read(replay(records)) == what_was_heard(records)


def test_a_character_doubled_in_a_line_typed_slowly_is_the_same_garble_again() -> None:
    """What doubled may look like the end of the line as far as it was typed; the link knew what was still to come."""
    records: Records = []
    ledger, reader = Ledger(records.append), Reader()
    reader.typed(b"SPEED 80")
    for k in range(7):
        ledger.sent(b"SPEED 80"[k : k + 1], 0.1 * k)
    for event in reader.receive(b"SPEED 88"):
        ledger.heard(event.what, event.raw, 0.7)
    ledger.sent(b"0", 0.8)
    ledger.sent(b"\x15", 0.9)
    assert records[7]["what"] == "garble"
    assert what_was_read(replay(records)) == what_was_heard(records)


def test_a_ledger_drives_a_simulated_controller_to_the_same_answers(timed_line: MakesLine) -> None:
    records = a_session(timed_line)
    then = "".join(record["bytes"] for record in records if record["way"] == "in")
    controller = Controller(Machine(SimulatedArm(joints_rad=READY_RAD)))
    now = ""
    for record in records:
        passed_s = (record["t_s"] - records[0]["t_s"]) * SCALE
        if record["way"] == "out":
            controller.receive(record["bytes"].encode("latin-1"), passed_s)
        now += controller.output(passed_s).decode("latin-1")
    controller.tick(passed_s + 10.0)
    now += controller.output(passed_s + 10.0).decode("latin-1")
    assert without_places_on_the_way(now) == without_places_on_the_way(then)


def without_places_on_the_way(said: str) -> list[str]:
    """What was said, but for tables of a moving arm: the last table stays, and every line that is not of a table."""
    lines = [line.strip() for line in said.removeprefix(".").replace("\n", "").split("\r")]
    tables = [k for k, line in enumerate(lines) if line.startswith("X ")]
    within = {k + j for k in tables for j in range(4)}
    last = [line for k, line in enumerate(lines) if k in range(tables[-1], tables[-1] + 4)]
    return last + [line for k, line in enumerate(lines) if k not in within]


def test_prompts_are_kept_apart_from_the_dots_in_numbers(timed_line: MakesLine) -> None:
    prompts = [record for record in a_session(timed_line) if record["what"] == Prompt.__name__.lower()]
    assert all(record["bytes"].strip("\r\n^U") == "." for record in prompts)


def test_a_keeper_that_fails_loses_records_and_never_the_line(arm_line: MakesLine) -> None:
    kept: Records = []

    def keep(record: dict[str, Any]) -> None:
        if len(kept) == 5:
            raise OSError(28, "No space left on device")
        kept.append(record)

    async def scene() -> None:
        link = Link(arm_line(time_scale=SCALE).server.port, Dialect(resync_s=0.4), on_wire=keep)
        await link.open()
        await link.command("SPEED 80")
        await link.stop_motion()
        assert link.permission.stop_tests
        await link.close()

    asyncio.run(scene())
    assert len(kept) == 5
