"""The serial line as it is in cells: adapters that come back under another name, converters that echo, noise."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import os
import termios
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers.puma560 import READY_RAD, forward
from drivers.simcell.controller import Manners
from drivers.val2.contact_findings import ContactFindings, Exchange, Heard, UnclearError
from drivers.val2.conversation import answer_from as answer
from drivers.val2.conversation import is_twice
from drivers.val2.dialect import Dialect
from drivers.val2.errors import Garbled, LinkError, NoAnswer, PortError
from drivers.val2.first_contact import _line
from drivers.val2.link import Link
from drivers.val2.location import location_from_matrix
from drivers.val2.port import OpenPort, Port, SerialPort
from drivers.val2.wire import Garble, Prompt, Text
from tests.fakes.arm_line import QUICK, MakesLine
from tests.fakes.in_time import lived
from tests.fakes.waiting import until_so


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
        await until_so(lambda: not link.connected)
        await link.open()
        with after.server.controller() as controller:
            controller.lines.clear()
        await link.test_stop()
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

    def __init__(self, port: Port, on_bytes) -> None:
        self._port, self._on_bytes = port, on_bytes

    def write(self, data: bytes) -> None:
        """Send all of data."""
        asyncio.get_running_loop().call_soon(self._on_bytes, data)
        self._port.write(data)

    def overtake(self) -> None:
        """See Port."""
        self._port.overtake()

    def close(self) -> None:
        """Let go of the port."""
        self._port.close()


def echoing(path, dialect, on_bytes, on_lost):
    return Converter(SerialPort(path, dialect, on_bytes, on_lost), on_bytes)


def echoing_before_a_slow_controller(path, dialect, on_bytes, on_lost):
    """The converter's echo is whole, and taken for the controller's, before that one's begins."""

    def late(data: bytes) -> None:
        asyncio.get_running_loop().call_later(5.0 * dialect.echo_settle_s, on_bytes, data)

    return Converter(SerialPort(path, dialect, late, on_lost), on_bytes)


def test_behind_a_converter_that_echoes_a_controller_that_does_not_is_one_that_does(arm_line: MakesLine) -> None:
    async def scene() -> None:
        link = Link(arm_line(Manners(echo=False)).server.port, QUICK, open_port=echoing)
        await link.open()
        await link.command("SPEED 10")
        np.testing.assert_allclose((await link.where()).joints_deg, np.degrees(READY_RAD), atol=1e-3)
        await link.stop_motion()
        await link.close()

    asyncio.run(scene())


def test_behind_a_converter_that_echoes_a_controller_that_echoes_too_is_told_before_anything_moves() -> None:
    """What came back first would be the converter's: what the controller read could not be compared with anything."""
    steps = _line(ContactFindings())
    step = next(steps)
    assert isinstance(step, Exchange)
    assert step.data == b"WHERE"
    with pytest.raises(UnclearError, match="both echo"):
        steps.send(Heard(((0.1, b"WWHHEERREE"),), 1.0))


def echoing_before_a_controller_that_takes_its_time(path, dialect, on_bytes, on_lost):
    """What the controller says comes a character at a time, and not as fast as the line could carry it."""
    free_s = [0.0]

    def slow(data: bytes) -> None:
        loop = asyncio.get_running_loop()
        for byte in data:
            free_s[0] = max(free_s[0], loop.time()) + 0.005
            loop.call_at(free_s[0], on_bytes, bytes([byte]))

    return Converter(SerialPort(path, dialect, slow, on_lost), on_bytes)


@pytest.mark.parametrize(
    "converter", [echoing, echoing_before_a_slow_controller, echoing_before_a_controller_that_takes_its_time]
)
def test_behind_a_converter_that_echoes_a_controller_that_echoes_too_is_told_on_opening_and_no_line_is_opened(
    arm_line: MakesLine, converter: OpenPort
) -> None:
    """Without an introduction as well: somebody put another converter in, or its switch over."""

    async def scene() -> None:
        cell = arm_line()
        link = Link(cell.server.port, QUICK, open_port=converter)
        with pytest.raises(NoAnswer, match="the serial converter and the controller both echo"):
            await link.open()
        assert not link.connected
        with cell.server.controller() as controller:
            assert "ABORT" in controller.lines, "what nobody can be sure is at rest is told to stop"

    asyncio.run(scene())


@pytest.mark.parametrize("converter", [echoing, echoing_before_a_slow_controller])
def test_a_converter_whose_echo_is_switched_on_in_mid_day_is_told_as_one(
    arm_line: MakesLine, converter: OpenPort
) -> None:
    async def scene() -> None:
        quiet = [True]

        class Switched(Converter):
            def write(self, data: bytes) -> None:
                if quiet[0]:
                    self._port.write(data)
                else:
                    super().write(data)

        def switched(path, dialect, on_bytes, on_lost):
            made = converter(path, dialect, on_bytes, on_lost)
            return Switched(made._port, on_bytes)  # type: ignore[attr-defined]

        cell = arm_line()
        dialect = replace(QUICK, typing_attempts=1)
        link = Link(cell.server.port, dialect, open_port=switched)
        await link.open()
        quiet[0] = False
        with pytest.raises(LinkError, match="both echo"):
            await link.where()
        await link.close()

    asyncio.run(scene())


@pytest.mark.parametrize(
    ("back", "twice"),
    [
        (b"WHEREWHERE", True), (b"WWHHEERREE", True), (b"WHWEREHERE", True), (b"WHEREWHERE\r\n", True),
        (b"WHERE", False), (b"WHEREWHER", False), (b"WHEREE", False), (b"WWHHEERRE#", False), (b"WHEREHWERE", False),
        (b"WHERE*Ill*", False),
    ],
)  # fmt: skip
def test_two_copies_of_what_was_typed_are_no_noise(back: bytes, twice: bool) -> None:
    assert is_twice(b"WHERE", back) is twice


@pytest.mark.parametrize(("again", "told"), [(b"\rO BREAK\r\n", "both echo"), (b"\r\n", "arrived damaged")])
def test_a_second_echo_that_the_end_of_the_line_falls_into_is_no_noise(again: bytes, told: str) -> None:
    events = [Garble(b"D", "", "D"), Text(again, again.decode().strip()), Prompt(b".")]
    with pytest.raises(Garbled, match=told):
        answer("DO BREAK", events, 0.1, Dialect())


def test_an_adapter_pulled_out_just_as_it_is_opened_is_one_that_is_gone(
    arm_line: MakesLine, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The kernel refuses what is set then with an error that is neither pyserial's nor the system's."""

    def gone(*_: object) -> None:
        raise termios.error(errno.EIO, os.strerror(errno.EIO))

    async def scene() -> None:
        port = arm_line().server.port
        monkeypatch.setattr(termios, "tcflush", gone)
        with pytest.raises(PortError, match=f"^{port}: the port is gone"):
            await Link(port, QUICK).open()

    asyncio.run(scene())


@pytest.mark.parametrize("number", [errno.ENODEV, errno.ENXIO, errno.EIO])
def test_what_the_kernel_says_of_a_device_that_is_gone_is_told_plainly(
    monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    def gone(*_: object) -> None:
        raise OSError(number, os.strerror(number))

    async def scene() -> None:
        monkeypatch.setattr(os, "open", gone)
        with pytest.raises(PortError, match=r"^/dev/ttyUSB7: the port is gone"):
            SerialPort("/dev/ttyUSB7", QUICK, lambda _: None, lambda _: None)

    asyncio.run(scene())


def test_a_burst_of_noise_as_a_motor_starts_delays_a_reading_and_spoils_none(timed_line: MakesLine) -> None:
    async def scene() -> None:
        cell = timed_line()
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

    lived(scene())


XOFF = b"\x13"
"""What one spoiled bit makes of a 3, and of an S."""


async def held_by_noise(cell: Any) -> None:
    os.write(cell.server._master, XOFF)
    await asyncio.sleep(0.05)  # the kernel does not say when it has taken it


def test_a_stop_goes_out_on_a_line_that_noise_holds_and_so_does_what_is_typed_on_one_that_was_opened_anew(
    arm_line: MakesLine,
) -> None:
    """No XON follows: every stop was refused by the system, for as long as the daemon ran, and the arm went on."""

    async def scene() -> None:
        cell = arm_line()
        far = location_from_matrix(forward(READY_RAD + np.radians([90, -20, 5, 0, 10, 0])))
        async with cell.link(replace(QUICK, software_flow_control=True)) as link:
            await link.command("SPEED 2")
            await link.move(far)
            with cell.server.controller() as controller:
                assert not controller.machine.at_rest()
            await held_by_noise(cell)
            with pytest.raises(LinkError, match="the line takes no more bytes"):
                link._open_session.send(b".", b"")
            assert await link.stop_motion() is not None
            with cell.server.controller() as controller:
                assert controller.machine.at_rest()
            await held_by_noise(cell)
            await link.close()
            await link.open()
            await link.where()

    asyncio.run(scene())


def test_what_waits_on_a_line_goes_out_neither_before_a_stop_nor_after_it_was_let_go(
    arm_line: MakesLine, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A pseudo-terminal keeps nothing waiting: what the kernel is told is all there is to see."""
    told: list[tuple[str, int]] = []
    monkeypatch.setattr(termios, "tcflush", lambda _, what: told.append(("flush", what)))
    monkeypatch.setattr(termios, "tcflow", lambda _, what: told.append(("flow", what)))

    async def scene() -> None:
        async with arm_line().link() as link:
            for let_go in (link.stop_motion, link.close):
                told.clear()
                await let_go()
                assert told == [
                    ("flush", termios.TCOFLUSH), ("flow", termios.TCOOFF), ("flow", termios.TCOON)
                ]  # fmt: skip

    asyncio.run(scene())
