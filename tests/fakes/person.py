"""A person at a terminal with `facetctl`: types, reads, disconnects."""

from __future__ import annotations

import os
import pty
import re
import select
import signal
import sys
import time
from pathlib import Path

SEQUENCE = re.compile(rb"\x1b(\[[0-9;?]*[ -/]*[@-~]|[^\[])")
BEGUN = re.compile(rb"(.*?)((?:\x1b(?:\[[0-9;?]*)?)?)\Z", re.DOTALL)
"""Control sequences (cursor, colours), with an incomplete one at the end: a terminal does not show them."""


def piped(text: str) -> int:
    """The read end of a pipe that contains this text."""
    read, write = os.pipe()
    os.write(write, text.encode())
    os.close(write)
    return read


class Person:
    """One `facetctl` (or another program) with these words on a pty of its own, beside the daemon whose socket lies in
    `folder`."""

    def __init__(self, folder: Path, *words: str, program: str = "daemon.ctl") -> None:
        self.seen, self._raw = "", b""
        self.gone = False
        """Whether facetctl has ended."""
        self.asked_for_cursor = False
        """Whether the program asked for the cursor's position. This terminal never answers."""
        self._pid, self._handle = pty.fork()
        if self._pid == 0:
            signal.signal(signal.SIGINT, signal.SIG_DFL)  # whoever began the tests in the background ignores it
            os.environ.update(FACETD_SOCKET=str(folder / "facetd.sock"), HOME=str(folder), TERM="xterm")
            os.environ.pop("XDG_STATE_HOME", None)
            os.execv(sys.executable, [sys.executable, "-m", program, *words])

    def types(self, keys: str) -> None:
        """Press keys."""
        os.write(self._handle, keys.encode("latin-1"))

    def sees(self, text: str, within_s: float = 60.0) -> str:
        """Wait for a text in new output; returns the output before it."""
        deadline = time.monotonic() + within_s
        while text not in self.seen:
            assert time.monotonic() < deadline, f"{text!r} did not come; what came: {self.seen!r}"
            self._read(0.1)
        before, _, self.seen = self.seen.partition(text)
        return before

    def sees_for(self, seconds: float) -> str:
        """The new output within some seconds."""
        deadline = time.monotonic() + seconds
        while (left_s := deadline - time.monotonic()) > 0 and self._read(left_s):
            continue
        text, self.seen = self.seen, ""
        return text

    def leaves(self) -> int:
        """Wait for the end of facetctl; returns its exit status."""
        deadline = time.monotonic() + 30.0
        while self._read(0.1):
            assert time.monotonic() < deadline, f"still there; what came: {self.seen!r}"
        _, status = os.waitpid(self._pid, 0)
        os.close(self._handle)
        return os.waitstatus_to_exitcode(status)

    def _read(self, within_s: float) -> bool:
        """Read the next output. False where facetctl has ended."""
        if not select.select([self._handle], [], [], within_s)[0]:
            return True
        try:
            self._raw += os.read(self._handle, 4096)
        except OSError:
            self.gone = True
            return False
        whole, begun = BEGUN.match(self._raw).groups()
        self.asked_for_cursor |= b"\x1b[6n" in whole
        self.seen, self._raw = self.seen + SEQUENCE.sub(b"", whole).decode("utf-8", "replace"), begun
        return True
