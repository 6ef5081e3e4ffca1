"""Write to systemd's journal and notify systemd (sd_notify); without systemd, write lines to stderr."""

import contextlib
import os
import queue
import socket
import sys
import threading
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from daemon.errors import printable, visible
from daemon.events.codes import CauseCode

try:
    from systemd import journal as systemd_journal
except ImportError:
    systemd_journal = None

STOPPED = "stopped "
"""Begin of the fault text of a person's stop (arm/supervisor.py)."""
STAGE_S = 60
"""Longest stage of a start, s (TimeoutStartSec in deploy/facetd.service)."""
CRITICAL, ERROR, WARNING, NOTICE, INFO = 2, 3, 4, 5, 6

# One id a kind of message, so that `journalctl MESSAGE_ID=...` finds all of that kind on any machine.
MESSAGE_IDS: Mapping[str, str] = {
    "run_start": "6f1f5a0d3f0e4a5e9a3c8a1c2f4b7d10",
    "run_end": "6f1f5a0d3f0e4a5e9a3c8a1c2f4b7d11",
    "cycle_start": "6f1f5a0d3f0e4a5e9a3c8a1c2f4b7d12",
    "cycle_end": "6f1f5a0d3f0e4a5e9a3c8a1c2f4b7d13",
    "refusal": "6f1f5a0d3f0e4a5e9a3c8a1c2f4b7d14",
    "fault": "6f1f5a0d3f0e4a5e9a3c8a1c2f4b7d15",
    "command": "6f1f5a0d3f0e4a5e9a3c8a1c2f4b7d16",
    "model": "6f1f5a0d3f0e4a5e9a3c8a1c2f4b7d17",
    "trouble": "6f1f5a0d3f0e4a5e9a3c8a1c2f4b7d18",
    "trouble_over": "6f1f5a0d3f0e4a5e9a3c8a1c2f4b7d19",
    "reload": "6f1f5a0d3f0e4a5e9a3c8a1c2f4b7d1a",
}


def write(kind: str, text: str, priority: int = INFO, **fields: Any) -> None:
    """Write one record, text and fields (CYCLE, PART, ...). Returns at once: it must not delay the arm."""
    plain = {name: printable(str(value)) for name, value in fields.items() if value is not None}
    _JOURNAL.put((kind, visible(text), priority, plain))


def write_removed(runs: Sequence[Path]) -> None:
    """Report the runs that the quota removed, if any."""
    if runs:
        write("trouble", f"quota: removed {', '.join(folder.name for folder in runs)}", NOTICE)


def stuck(run: Path, why: str) -> str:
    """Text about a run that the quota cannot remove."""
    return f"quota: {run} cannot be removed: {why}; move it away (it no longer counts)"


def flush(timeout_s: float) -> None:
    """Wait until all records are written, at most timeout_s."""
    through = threading.Event()
    _JOURNAL.put(through)
    through.wait(timeout_s)


class JournalThread:
    """Writes records in order, in its own thread; drops records beyond a backlog of a thousand."""

    def __init__(self) -> None:
        self._waiting: queue.Queue[tuple[str, str, int, dict[str, str]] | threading.Event] = queue.Queue(1000)
        self._thread: threading.Thread | None = None

    def put(self, item: tuple[str, str, int, dict[str, str]] | threading.Event) -> None:
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name="journal", daemon=True)
            self._thread.start()
        with contextlib.suppress(queue.Full):
            self._waiting.put_nowait(item)

    def _run(self) -> None:
        while True:
            item = self._waiting.get()
            if isinstance(item, threading.Event):
                item.set()
            else:
                with contextlib.suppress(Exception):  # no journal, a closed stderr: the next record may succeed
                    _write(*item)


_JOURNAL = JournalThread()


def _write(kind: str, text: str, priority: int, fields: dict[str, str]) -> None:
    if systemd_journal is not None and os.environ.get("JOURNAL_STREAM"):
        identity = {"MESSAGE_ID": MESSAGE_IDS[kind]} if kind in MESSAGE_IDS else {}
        systemd_journal.send(text, PRIORITY=priority, SYSLOG_IDENTIFIER="facetd", **identity, **fields)
    else:
        print(f"facetd: {text}", file=sys.stderr, flush=True)


def notify(*states: str) -> None:
    """Notify systemd (sd_notify): READY=1, STATUS=..., WATCHDOG=1, ...; nothing without systemd. Never waits: a
    listener that does not read would block the main loop, and with it the arm's stop."""
    address = os.environ.get("NOTIFY_SOCKET")
    if not address:
        return
    if address.startswith("@"):
        address = "\0" + address[1:]
    with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as sender:
        sender.setblocking(False)
        sender.connect(address)
        sender.sendall("\n".join(map(printable, states)).encode())


def starting(stage: str) -> None:
    """Report the stage of the start, and ask systemd for STAGE_S more from now: a slow computer takes its time."""
    notify(f"STATUS=starting: {stage}", f"EXTEND_TIMEOUT_USEC={STAGE_S * 1_000_000}")


def watchdog_s() -> float | None:
    """Period of WATCHDOG=1, half of systemd's limit; None without a watchdog."""
    limit_us = os.environ.get("WATCHDOG_USEC", "")
    watched = os.environ.get("WATCHDOG_PID", str(os.getpid()))
    return int(limit_us) / 2e6 if limit_us.isdecimal() and watched == str(os.getpid()) else None


class JournalledLog:
    """A run log that also writes important records to the journal, and passes faults, refusals and commands to `notice`
    with kind, text and operator. It only writes: no decision depends on it."""

    def __init__(self, log: Any, notice: Callable[[str, str, str | None], None] = lambda *_: None) -> None:
        self.log, self._notice = log, notice

    def record(self, kind: str, /, **fields: Any) -> None:
        """Write one record; the journal gets it even where the run log fails."""
        try:
            self.log.record(kind, **fields)
        finally:
            self._write_journal(kind, fields)

    def _write_journal(self, kind: str, fields: Mapping[str, Any]) -> None:
        text = _line(kind, fields)
        if text is None:
            return
        plain = {
            "CYCLE": fields.get("cycle"),
            "PART": fields.get("label") or fields.get("target"),
            "STOP": fields.get("stops"),
            "RULE": fields.get("rule"),
            "OUTCOME": fields.get("outcome"),
            "WHO": fields.get("who"),
        }
        write(kind, text, _priority(kind, fields), **plain)
        if kind in ("fault", "rest", "refusal", "command", "model"):
            self._notice(kind, text, fields.get("who"))


def fault_line(fault: str, code: object) -> str:
    """A fault for people, from its text and its cause's code; a person's stop is one as well, but no failure."""
    return f"STOPPED {fault.removeprefix(STOPPED)}" if code == CauseCode.OPERATOR_STOP else f"FAULT {fault}"


def _line(kind: str, fields: Mapping[str, Any]) -> str | None:
    """The text of a record for people; None for a record that only the run log needs."""
    match kind:
        case "cycle_start":
            return f"cycle {fields.get('cycle')}: looking for {fields.get('target') or 'any part'}"
        case "cycle_end":
            why = f": {fields['why']}" if fields.get("why") else ""
            ended = f"{fields.get('outcome')} {fields.get('label') or ''}".strip()
            return f"cycle {fields.get('cycle')}: {ended}{why}"
        case "refusal":
            return f"refused, {fields.get('rule')}: {fields.get('text')}"
        case "fault":
            return fault_line(str(fields.get("text")), fields.get("code"))
        case "rest":
            return str(fields.get("text"))
        case "command":
            return f"{fields.get('who')} at {fields.get('door')}: {fields.get('text')}"
        case "model" if fields.get("action") != "start":
            return f"model {fields.get('action')}: version {fields.get('version')}"
    return None


def _priority(kind: str, fields: Mapping[str, Any]) -> int:
    if kind == "fault":
        return ERROR
    if kind == "refusal" or (kind == "cycle_end" and fields.get("outcome") in ("missed", "lost", "fault")):
        return WARNING
    return INFO
