"""Modbus TCP with pymodbus's own client on localhost: what a PLC gives and reads, and what is left once it is gone."""

from __future__ import annotations

import asyncio
import contextlib
import os
import socket
from collections.abc import Awaitable, Callable, Iterator, Sequence
from typing import Any

import pytest

from daemon.signals.modbus import COILS, ModbusServer, PLCInputs, PLCReadings, inherited_socket, readings
from daemon.signals.packml import PackMLState
from daemon.signals.production_line import ProductionLine
from daemon.signals.settings import ModbusSettings

pytest.importorskip("pymodbus")
from pymodbus.client import AsyncModbusTcpClient

from tests.fakes.waiting import until_so

ROLES = ("permit_pick", "cycle_start")
EXECUTE = readings(PackMLState.EXECUTE, done=False, enabled=True, clock_s=70_000.0, picked=3, failed=1)


class Nothing:
    """A controller at which no signal is."""

    async def set_outputs(self, numbers: Sequence[int]) -> None:
        raise AssertionError(numbers)

    work_valves = set_outputs

    async def ask_input(self, text: str) -> str:
        raise AssertionError(text)


class Served:
    """A server on a port of localhost."""

    def __init__(self, roles: Sequence[str] = ROLES, silence_s: float = 30.0) -> None:
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.port = self.listener.getsockname()[1]
        self.plc, self.reads = PLCInputs(roles), EXECUTE
        self.server = ModbusServer(self.listener, ModbusSettings(silence_s=silence_s), self.plc, self._reads)

    def _reads(self) -> PLCReadings:
        return self.reads

    async def client(self) -> AsyncModbusTcpClient:
        client = AsyncModbusTcpClient("127.0.0.1", port=self.port, reconnect_delay=0, retries=0, timeout=20)
        assert await client.connect()
        return client


def told(story: Callable[[Served], Awaitable[Any]], **settings: Any) -> Any:
    async def run() -> Any:
        served = Served(**settings)
        task = asyncio.create_task(served.server.serve())
        try:
            return await story(served)
        finally:
            task.cancel()

    return asyncio.run(run())


async def until(so: Callable[[], bool]) -> None:
    await until_so(lambda: so())


def test_a_plc_reads_the_state_and_gives_the_roles_that_are_its_own() -> None:
    async def story(served: Served) -> None:
        client = await served.client()
        assert (await client.read_discrete_inputs(0, count=4)).bits[:4] == [True, False, False, True]
        assert (await client.read_input_registers(0, count=4)).registers == [6, 70_000 % 65_536, 3, 1]
        assert served.plc.on("permit_pick") is False
        assert not (await client.write_coil(0, True)).isError()
        assert not (await client.write_coil(2, True)).isError()
        assert (await client.read_coils(0, count=5)).bits[:5] == [True, False, True, False, False]
        assert (served.plc.on("permit_pick"), served.plc.on("cycle_start")) == (True, True)
        client.close()

    told(story)


@pytest.mark.parametrize(
    "ask",
    [
        lambda client: client.write_coil(COILS.index("permit_place"), True),
        lambda client: client.write_coils(0, [True, True]),
        lambda client: client.write_coil(len(COILS), True),
        lambda client: client.write_register(0, 1),
        lambda client: client.read_holding_registers(0, count=1),
        lambda client: client.read_discrete_inputs(3, count=2),
        lambda client: client.read_input_registers(9, count=1),
    ],
)
def test_what_is_not_the_plc_s_is_refused_and_changes_nothing(ask: Any) -> None:
    async def story(served: Served) -> None:
        client = await served.client()
        assert (await ask(client)).isError()
        assert not any(served.plc.on(role) for role in COILS)
        assert not (await client.write_coil(0, True)).isError(), "the conversation goes on"
        client.close()

    told(story)


def test_a_lost_client_is_a_lost_permit_and_a_new_one_begins_with_none() -> None:
    async def story(served: Served) -> None:
        line = ProductionLine({}, Nothing(), None, lambda: 0.0, lambda *_, **__: None, served.plc)
        client = await served.client()
        await client.write_coil(0, True)
        assert await line.read("PLC's permit_pick")
        client.close()
        await until(lambda: not served.plc.heard)
        assert not await line.read("PLC's permit_pick")
        client = await served.client()
        await until(lambda: served.plc.heard)
        assert not await line.read("PLC's permit_pick")
        client.close()

    told(story)


def test_a_client_that_no_longer_asks_is_lost_and_half_a_request_is_no_request() -> None:
    async def story(served: Served) -> None:
        client = await served.client()
        await client.write_coil(0, True)
        assert served.plc.on("permit_pick")
        await until(lambda: not served.plc.heard)
        reader, writer = await asyncio.open_connection("127.0.0.1", served.port)
        await until(lambda: served.plc.heard)
        while served.plc.heard:
            writer.write(b"\x00")
            await asyncio.sleep(0.01)
        with contextlib.suppress(ConnectionError):
            assert await reader.read() == b"", "closed"
        client.close()
        writer.close()

    told(story, silence_s=0.2)


def test_a_second_client_is_closed_and_takes_nothing_from_the_first() -> None:
    async def story(served: Served) -> None:
        client = await served.client()
        await client.write_coil(0, True)
        reader, writer = await asyncio.open_connection("127.0.0.1", served.port)
        assert await reader.read() == b""
        writer.close()
        assert served.plc.on("permit_pick")
        assert not (await client.read_coils(0, count=1)).isError()
        client.close()

    told(story)


def test_noise_ends_the_conversation_or_is_refused_and_permits_nothing() -> None:
    async def story(served: Served) -> None:
        for noise in (b"GET / HTTP/1.1\r\n\r\n" * 40, bytes(300), b"\xff" * 300, bytes.fromhex("000100000002016e")):
            _, writer = await asyncio.open_connection("127.0.0.1", served.port)
            await until(lambda: served.plc.heard)
            writer.write(noise)
            writer.close()
            await until(lambda: not served.plc.heard)
            assert served.plc.on("permit_pick") is None
        client = await served.client()
        assert not (await client.read_coils(0, count=1)).isError()
        client.close()

    told(story, silence_s=5.0)


def test_a_start_that_stayed_on_while_the_plc_was_away_does_not_count_again() -> None:
    plc = PLCInputs(("cycle_start",))
    line = ProductionLine({}, Nothing(), None, lambda: 0.0, lambda *_, **__: None, plc)

    def wanted(looks: int) -> bool:
        left = iter([True] * looks + [False])
        return asyncio.run(line.wanted(lambda: next(left)))

    plc.connected()
    assert not wanted(1), "seen off"
    plc.lost()
    assert not wanted(1)
    plc.connected()
    plc.give("cycle_start", True)
    assert not wanted(2), "on since before it was heard again"
    plc.give("cycle_start", False)
    assert not wanted(1)
    plc.give("cycle_start", True)
    assert wanted(1)


@pytest.fixture
def passed() -> Iterator[socket.socket]:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        yield listener


def test_the_socket_that_systemd_hands_in_is_taken_by_its_name(passed: socket.socket, monkeypatch: Any) -> None:
    monkeypatch.setattr("daemon.signals.modbus.FIRST_FD", os.dup(passed.fileno()))
    mine = {"LISTEN_PID": str(os.getpid()), "LISTEN_FDS": "1", "LISTEN_FDNAMES": "modbus"}
    assert inherited_socket(environment={**mine, "LISTEN_PID": "1"}) is None
    assert inherited_socket(environment={**mine, "LISTEN_FDNAMES": "other"}) is None
    assert inherited_socket(environment={}) is None
    taken = inherited_socket(environment=mine)
    assert taken is not None
    assert taken.getsockname() == passed.getsockname()
    assert not taken.get_inheritable()
    taken.close()
