"""The serial line as it is in cells: adapters that come back under another name, converters that echo, noise."""

from __future__ import annotations

import asyncio
import contextlib
from pathlib import Path

import numpy as np
import pytest

from drivers.puma560 import READY_RAD
from drivers.simcell.controller import Manners
from drivers.val2.errors import LinkError, PortError
from drivers.val2.introduction import Acquaintance, Heard, UnclearError, _line
from drivers.val2.link import Dialect, Link
from drivers.val2.port import Port, SerialPort
from tests.worlds.arm_line import QUICK, MakesLine


def named(folder: Path, port: str) -> Path:
    """A name under by-id, as udev gives it."""
    name = folder / "usb-Prolific_USB-Serial_Controller-if00-port0"
    name.unlink(missing_ok=True)
    name.symlink_to(port)
    return name


def test_an_adapter_that_comes_back_as_another_device_is_found_by_its_name(arm_line: MakesLine, tmp_path: Path) -> None:
    """The link opens what the name means at that moment, not what it meant when the daemon started."""

    async def scene() -> None:
        before, after = arm_line(), arm_line()
        link = Link(str(named(tmp_path, before.server.port)), QUICK)
        await link.open()
        np.testing.assert_allclose((await link.where()).joints_deg, np.degrees(READY_RAD), atol=1e-3)
        name = named(tmp_path, after.server.port)
        before.server.stop()
        with pytest.raises(PortError):
            await link.where()
        await asyncio.sleep(0.05)
        assert not link.connected
        await link.open()
        with after.server.controller() as controller:
            controller.lines.clear()
        await link.prove_stop()
        with after.server.controller() as controller:
            assert "ABORT" in controller.lines
        await link.close()
        assert name.is_symlink()

    asyncio.run(scene())


def test_an_adapter_that_is_out_is_told_by_the_name_it_has_in_the_configuration(tmp_path: Path) -> None:
    async def scene() -> None:
        link = Link(str(named(tmp_path, "/dev/ttyUSB-gone")), QUICK)
        with pytest.raises(PortError, match=r"usb-Prolific.*no such port; is the adapter plugged in"):
            await link.open()

    asyncio.run(scene())


class Converter:
    """An RS-422 converter that hears itself: what is sent comes back at once, and then whatever the far end says."""

    def __init__(self, port: Port, on_bytes) -> None:  # type: ignore[no-untyped-def]
        self._port, self._on_bytes = port, on_bytes

    def write(self, data: bytes) -> None:
        """Send all of data."""
        asyncio.get_running_loop().call_soon(self._on_bytes, data)
        self._port.write(data)

    def close(self) -> None:
        """Let go of the port."""
        self._port.close()


def echoing(path, dialect, on_bytes, on_lost):  # type: ignore[no-untyped-def]
    return Converter(SerialPort(path, dialect, on_bytes, on_lost), on_bytes)


def test_behind_a_converter_that_echoes_a_controller_that_does_not_is_one_that_does(arm_line: MakesLine) -> None:
    async def scene() -> None:
        link = Link(arm_line(Manners(echo=False)).server.port, QUICK, open_port=echoing)
        await link.open()
        await link.speed(10)
        np.testing.assert_allclose((await link.where()).joints_deg, np.degrees(READY_RAD), atol=1e-3)
        await link.abort()
        await link.close()

    asyncio.run(scene())


def test_behind_a_converter_that_echoes_a_controller_that_echoes_too_is_told_before_anything_moves() -> None:
    """What came back first would be the converter's: what the controller read could not be compared with anything."""
    steps = _line(Acquaintance())
    assert next(steps).data == b"WHERE"
    with pytest.raises(UnclearError, match="comes back twice"):
        steps.send(Heard(((0.1, b"WWHHEERREE"),), 1.0))


def test_a_burst_of_noise_as_a_motor_starts_delays_a_reading_and_spoils_none(arm_line: MakesLine) -> None:
    async def scene() -> None:
        cell = arm_line()
        async with cell.link(Dialect(resync_s=0.4, typing_s=0.4, answer_s=1.0, typing_attempts=20)) as link:
            for burst in range(6):
                with cell.server.controller():
                    cell.faults.seed_noise(burst, 0.03)
                with contextlib.suppress(LinkError):
                    where = await link.where()
                    np.testing.assert_allclose(where.joints_deg, np.degrees(READY_RAD), atol=1e-3)
                with cell.server.controller():
                    cell.faults.seed_noise(0, 0.0)
                if link.question is not None:  # noise that ends as a question does is taken for one until it is sought
                    await link.close()
                    await link.open()
            np.testing.assert_allclose((await link.where()).joints_deg, np.degrees(READY_RAD), atol=1e-3)

    asyncio.run(scene())
