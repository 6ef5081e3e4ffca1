"""A PLC at the whole daemon, on a socket that was handed in: pymodbus's own client."""

from __future__ import annotations

import os
import shutil
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.fakes.daemon_process import Daemon

pytest.importorskip("pymodbus")
from pymodbus.client import ModbusTcpClient

pytestmark = pytest.mark.slow
MODBUS = "modbus: {roles: [permit_pick, cycle_start], silence_s: 30}\n"


@pytest.fixture
def folder(tmp_path: Path) -> Iterator[Path]:
    short = Path(f"/tmp/facetd-test-{os.getpid()}-{tmp_path.name[-12:]}")
    shutil.rmtree(short, ignore_errors=True)
    short.mkdir()
    yield short
    shutil.rmtree(short, ignore_errors=True)


def test_a_plc_reads_the_state_of_the_daemon_and_its_permits_end_with_its_connection(folder: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        daemon = Daemon(folder, MODBUS, listener=listener)
        try:
            daemon.hears("READY=1")
            assert "no PLC is connected" in daemon.do("signal show")["text"]
            plc = ModbusTcpClient("127.0.0.1", port=listener.getsockname()[1], timeout=20)
            assert plc.connect()
            assert plc.read_input_registers(0, count=1).registers == [2], "Stopped"
            assert plc.read_discrete_inputs(0, count=4).bits[:4] == [False] * 4
            assert not plc.write_coil(0, True).isError()
            assert "coil 0 of the PLC: on" in daemon.do("signal show")["text"]
            assert daemon.do("enable")["status"] == 0
            assert plc.read_input_registers(0, count=1).registers == [4], "Idle"
            plc.close()
            while "no PLC is connected" not in daemon.do("signal show")["text"]:
                pass
        finally:
            daemon.close()


def test_without_a_socket_that_is_told_and_no_plc_permits(folder: Path) -> None:
    daemon = Daemon(folder, MODBUS)
    try:
        daemon.hears("READY=1")
        assert "no socket was handed in" in daemon.do("status")["data"]["troubles"]["modbus"]
    finally:
        daemon.close()
