"""The port's settings, which another program may change: they are put back at once, and that is reported."""

from __future__ import annotations

import asyncio
import os
import termios
import tty

import pytest

from drivers.simcell.controller import Manners
from drivers.val2.dialect import Dialect
from drivers.val2.errors import Disturbed, LinkError
from drivers.val2.port import SerialPort
from tests.fakes.arm_line import MakesLine
from tests.fakes.waiting import until_so

TYPED_IN = r"another program changed the settings of this port \(stty\?\); facetd put them back"


def stty_sane(port: str) -> None:
    """As a person types it: input waits for the end of a line, and is echoed back."""
    handle = os.open(port, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    iflag, oflag, cflag, lflag, *rest = termios.tcgetattr(handle)
    sane = [iflag | termios.ICRNL | termios.IXON, oflag | termios.OPOST, cflag, lflag | termios.ICANON | termios.ECHO]
    termios.tcsetattr(handle, termios.TCSANOW, [*sane, *rest])
    os.close(handle)


class Opened:
    """A port on a pseudo-terminal, and what it reports."""

    def __init__(self) -> None:
        self.far, near = os.openpty()
        tty.setraw(near)
        self.heard, self.troubles, self.news = b"", list[LinkError](), asyncio.Event()
        self.path = os.ttyname(near)
        self.port = SerialPort(self.path, Dialect(), self._hear, self._trouble)
        os.close(near)

    def _hear(self, data: bytes) -> None:
        self.heard += data
        self.news.set()

    def _trouble(self, error: LinkError) -> None:
        self.troubles.append(error)
        self.news.set()

    async def until_news(self) -> None:
        self.news.clear()
        await asyncio.wait_for(self.news.wait(), 60.0)

    def close(self) -> None:
        self.port.close()
        os.close(self.far)


def settings(port: str) -> list[object]:
    handle = os.open(port, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    try:
        return termios.tcgetattr(handle)
    finally:
        os.close(handle)


def test_settings_that_another_program_changes_while_nothing_is_sent_are_put_back_and_reported_once() -> None:
    """What came meanwhile waited in the kernel for the end of a line: the prompt has none."""

    async def scene() -> None:
        one = Opened()
        before = settings(one.path)
        stty_sane(one.path)
        os.write(one.far, b"\r\n.")
        while not one.troubles:
            await one.until_news()
        assert settings(one.path) == before
        while not one.heard.endswith(b"."):
            await one.until_news()
        one.port.write(b"WHERE")
        one.close()
        (told,) = one.troubles
        assert isinstance(told, Disturbed)
        assert told.message.startswith(f"{one.path}: another program changed the settings")

    asyncio.run(scene())


def test_nothing_is_sent_on_a_port_that_another_program_changed_but_a_stop() -> None:
    async def scene() -> None:
        one = Opened()
        for stops in (False, True):
            stty_sane(one.path)
            if stops:
                one.port.overtake()
            else:
                with pytest.raises(Disturbed, match=TYPED_IN):
                    one.port.write(b"DO MOVE A\r")
        one.port.write(b"ABORT\r")
        assert os.read(one.far, 100) == b"ABORT\r"
        assert len(one.troubles) == 2
        one.close()

    asyncio.run(scene())


def test_whoever_waits_for_the_end_of_a_motion_hears_at_once_that_the_port_was_changed(arm_line: MakesLine) -> None:
    """The controller's prompt would not have come through before the longest wait for a motion was over."""

    async def scene() -> None:
        line = arm_line(time_scale=1.0)
        disturbed = list[str]()
        async with line.link() as link:
            link.disturbed = lambda: disturbed.append("beliefs void")
            await link.test_stop()
            await link.command("SPEED 1")
            await link.command("DO DRIVE 1, 90, 1")
            breaking = asyncio.create_task(link.command("DO BREAK", timeout_s=600.0))
            await until_so(lambda: "DO BREAK\r" in line.sent())
            stty_sane(line.server.port)
            with pytest.raises(Disturbed, match=TYPED_IN):
                await asyncio.wait_for(breaking, 60.0)
            assert disturbed == ["beliefs void"]
            assert not link.permission.stop_tests
            assert await link.stop_motion() is not None
            await link.where()

    asyncio.run(scene())


def test_what_somebody_did_to_the_port_between_two_commands_is_reported_to_the_next_and_a_stop_goes_on(
    arm_line: MakesLine,
) -> None:
    async def scene() -> None:
        line = arm_line(Manners())
        async with line.link() as link:
            stty_sane(line.server.port)
            assert await link.stop_motion() is not None
            with pytest.raises(Disturbed, match=TYPED_IN):
                await link.where()
            await link.where()

    asyncio.run(scene())
