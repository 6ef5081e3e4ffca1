"""The wire as a ledger: every line sent, echoed and answered, each record carrying the hash of the one before.

Records are plain dictionaries; where they are kept is not this file's business.

    {"seq": 3, "t_s": 12.304, "way": "out", "what": "sent", "bytes": "WHERE", "prev": "ab..", "hash": "c0.."}

way: out (to the controller) or in. what: sent, or the kind of event that was heard. bytes: one character a byte
(latin-1), so that all bytes one way, in order, are the stream of that way.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
from collections.abc import Callable, Iterable
from typing import Any

from drivers.val2.wire import Event, Prompt, Question, Reader

Record = dict[str, Any]
BEGINNING = "0" * 64
CHAINED = ("seq", "t_s", "way", "what", "bytes", "prev")


class LedgerError(Exception):
    """The ledger is not what was written: the message names the record."""


class Ledger:
    """Chains records and hands each on."""

    def __init__(self, on_record: Callable[[Record], None] | None = None) -> None:
        self._on_record = on_record
        self._seq, self._prev = 0, BEGINNING

    def sent(self, data: bytes, t_s: float) -> None:
        """Bytes that went to the controller."""
        self._record(t_s, "out", "sent", data)

    def heard(self, event: Event, t_s: float) -> None:
        """An event, and the bytes it was read from."""
        self._record(t_s, "in", _kind(type(event)), event.raw)

    def _record(self, t_s: float, way: str, what: str, data: bytes) -> None:
        if self._on_record is None:
            return
        record: Record = {
            "seq": self._seq,
            "t_s": round(t_s, 6),
            "way": way,
            "what": what,
            "bytes": data.decode("latin-1"),
            "prev": self._prev,
        }
        record["hash"] = _hash(record)
        self._seq, self._prev = self._seq + 1, record["hash"]
        with contextlib.suppress(Exception):  # a record nobody could keep is missed by `verify`; the line goes on
            self._on_record(record)


def verify(records: Iterable[Record]) -> int:
    """Check the chain; how many records it has. Raises LedgerError at the first one that was altered, lost or moved.

    What a keeper of records adds to them under other names is not looked at.
    """
    prev, count = BEGINNING, 0
    for record in records:
        if record.get("seq") != count:
            raise LedgerError(f"record {count}: found number {record.get('seq')}; one is missing or out of order")
        if record.get("prev") != prev:
            raise LedgerError(f"record {count}: does not follow the record before it")
        if record.get("hash") != _hash(record):
            raise LedgerError(f"record {count}: was altered after it was written")
        prev, count = str(record["hash"]), count + 1
    return count


def replay(records: Iterable[Record], echo: bool = True) -> list[Event]:
    """Read every incoming record's bytes again: the events today's protocol makes of them.

    echo: whether that controller echoed what was typed. The replay is faithful when `what_was_heard` names the same.
    """
    reader, typing, kept = Reader(), False, list(records)
    events: list[Event] = []
    for k, record in enumerate(kept):
        data = _bytes(record)
        if record["way"] == "in":
            events += reader.receive(data)
            if record["what"] in (_kind(Prompt), _kind(Question)):
                events += reader.silence()
        elif not _is_typed(data):
            typing = False
            reader.line_ended(echoed=echo and not data.strip(b"\r\n"))
        elif not typing:
            typing = True
            if echo:
                reader.typed(_line_from(kept[k:]))
    return events


def what_was_heard(records: Iterable[Record]) -> list[tuple[str, bytes]]:
    """The kinds of event, and their bytes, that were heard then."""
    return [(str(r["what"]), _bytes(r)) for r in records if r["way"] == "in"]


def what_was_read(events: Iterable[Event]) -> list[tuple[str, bytes]]:
    """Kinds of event, and their bytes."""
    return [(_kind(type(event)), event.raw) for event in events]


def _line_from(records: Iterable[Record]) -> bytes:
    """The whole line that was being typed, character by character perhaps: the link told its reader all of it first."""
    line = b""
    for record in records:
        if record["way"] == "out":
            if not _is_typed(_bytes(record)):
                break
            line += _bytes(record)
    return line


def _is_typed(data: bytes) -> bool:
    """Whether these are characters of a command line, not a line end or what cancels one."""
    return all(0x20 <= byte <= 0x7E for byte in data)


def _bytes(record: Record) -> bytes:
    return str(record["bytes"]).encode("latin-1")


def _kind(event: type[Event]) -> str:
    return event.__name__.lower()


def _hash(record: Record) -> str:
    plain = {key: record.get(key) for key in CHAINED}
    text = json.dumps(plain, sort_keys=True, separators=(",", ":"), ensure_ascii=True)
    return hashlib.sha256(text.encode("ascii")).hexdigest()
