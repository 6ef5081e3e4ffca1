"""The serial port on asyncio; only this module uses pyserial. Sends bytes, receives bytes by callback; no protocol."""

import asyncio
import contextlib
import os
import termios
from collections.abc import Callable
from typing import Protocol

import serial

from drivers.val2.dialect import Dialect
from drivers.val2.errors import Disturbed, LinkError, PortError

CHECK_SETTINGS_S = 0.2
"""How often the port's settings are checked while nothing is sent. A check is one system call."""


class Port(Protocol):
    """The interface of an open port."""

    def write(self, data: bytes) -> None:
        """Send all of data. Raises PortError."""

    def overtake(self) -> None:
        """Make the next bytes go out at once: discard unsent bytes, and release a line that XOFF holds."""

    def close(self) -> None:
        """Close the port; may be called twice."""


OpenPort = Callable[[str, Dialect, Callable[[bytes], None], Callable[[LinkError], None]], Port]
"""path, dialect, on_bytes, on_trouble (PortError: the port is gone; Disturbed: somebody changed its settings, and they
were put back) -> an open port. Raises PortError."""


class SerialPort:
    """An open port that passes on bytes as they come, and keeps its settings as they were on opening.

    Another program that opens the same device can change the settings (`stty sane`), because the lock is only advisory.
    Then input would wait for the end of a line, and the kernel would echo it back to the controller.
    """

    def __init__(
        self, path: str, dialect: Dialect, on_bytes: Callable[[bytes], None], on_trouble: Callable[[LinkError], None]
    ) -> None:
        """Open and claim the port. Raises PortError. Needs a running event loop, which calls both callbacks."""
        self._path, self._on_bytes, self._on_trouble = path, on_bytes, on_trouble
        try:
            self._serial = serial.Serial(
                path,
                baudrate=dialect.baud,
                xonxoff=dialect.software_flow_control,
                rtscts=dialect.hardware_flow_control,
                timeout=0,
                exclusive=True,
            )
            self._settings = termios.tcgetattr(self._serial.fileno())
        except (serial.SerialException, OSError, ValueError, termios.error) as error:
            raise PortError(f"{path}: {_plain_reason(error)}") from error
        self._loop = asyncio.get_running_loop()
        self._loop.add_reader(self._serial.fileno(), self._readable)
        self._check = self._loop.call_later(CHECK_SETTINGS_S, self._check_settings)

    def write(self, data: bytes) -> None:
        """See Port. Raises Disturbed, too, where somebody changed the port's settings."""
        if not self._serial.is_open:
            raise PortError(f"{self._path}: the port is closed")
        if (changed := self._restore_settings()) is not None:
            raise changed
        try:
            # Not pyserial's write: with timeout 0 it loops for ever on a line that is held.
            written = os.write(self._serial.fileno(), data)
        except BlockingIOError:
            written = 0
        except (serial.SerialException, OSError) as error:
            raise PortError(f"{self._path}: {_plain_reason(error)}") from error
        if written != len(data):
            raise PortError(f"{self._path}: the line takes no more bytes ({written} of {len(data)} went out)")

    def overtake(self) -> None:
        """See Port. One damaged bit turns a 3 or an S into XOFF, and then no XON follows. The kernel releases such a
        line only after a request to hold it."""
        self._restore_settings()
        with contextlib.suppress(serial.SerialException, termios.error):  # the next write reports a port that is gone
            handle = self._serial.fileno()
            termios.tcflush(handle, termios.TCOFLUSH)
            termios.tcflow(handle, termios.TCOOFF)
            termios.tcflow(handle, termios.TCOON)

    def close(self) -> None:
        """See Port. Unsent bytes are discarded: on a held line the kernel would wait for them for half a minute, and
        block the daemon."""
        if self._serial.is_open:
            self._check.cancel()
            self.overtake()
            self._loop.remove_reader(self._serial.fileno())
            self._serial.close()

    def _readable(self) -> None:
        try:
            data = self._serial.read(4096)
        except (serial.SerialException, OSError) as error:
            self.close()
            self._on_trouble(PortError(f"{self._path}: {_plain_reason(error)}"))
            return
        if data:
            self._on_bytes(data)

    def _check_settings(self) -> None:
        self._restore_settings()
        self._check = self._loop.call_later(CHECK_SETTINGS_S, self._check_settings)

    def _restore_settings(self) -> Disturbed | None:
        """If another program changed the port's settings, restore them and report it."""
        with contextlib.suppress(serial.SerialException, termios.error):  # the next read reports a port that is gone
            handle = self._serial.fileno()
            if termios.tcgetattr(handle) == self._settings:
                return None
            termios.tcsetattr(handle, termios.TCSANOW, self._settings)
            changed = Disturbed(
                f"{self._path}: another program changed the settings of this port (stty?); facetd put them back"
            )
            self._on_trouble(changed)
            return changed
        return None


def _plain_reason(error: Exception) -> str:
    """What happened and what to do, without pyserial's wording."""
    text = str(error)
    if "exclusively lock" in text or "Device or resource busy" in text:
        return "in use by another program; stop that program or name another port"
    if "No such file" in text:
        return "no such port; is the adapter plugged in and the path right?"
    if "Permission denied" in text:
        return "permission denied; is this user in the group dialout?"
    if any(words in text for words in ("returned no data", "Input/output error", "No such device")):
        return "the port is gone (unplugged, or its other end was closed)"
    return text
