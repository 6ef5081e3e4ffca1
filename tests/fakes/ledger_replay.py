"""Replay a wire ledger with today's protocol, to compare the events that it reads from the same bytes."""

from __future__ import annotations

from collections.abc import Iterable

from drivers.ledger import Record
from drivers.val2.wire import ControllerQuestion, LineEvent, Prompt, Reader


def replay(records: Iterable[Record], echo: bool = True) -> list[LineEvent]:
    """Parse every incoming record's bytes again; returns the events of today's protocol.

    echo: whether that controller echoed what was typed. The replay is faithful when `what_was_heard` names
    the same.
    """
    reader, typing, kept = Reader(), False, list(records)
    events: list[LineEvent] = []
    for k, record in enumerate(kept):
        data = _bytes(record)
        if record["way"] == "in":
            events += reader.receive(data)
            if record["what"] in (Prompt.what, ControllerQuestion.what):
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
    """The kinds of events, and their bytes, that were recorded."""
    return [(str(r["what"]), _bytes(r)) for r in records if r["way"] == "in"]


def what_was_read(events: Iterable[LineEvent]) -> list[tuple[str, bytes]]:
    """The kinds of events, and their bytes."""
    return [(event.what, event.raw) for event in events]


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
    """Whether these are characters of a command line, not a line end or a cancel key."""
    return all(0x20 <= byte <= 0x7E for byte in data)


def _bytes(record: Record) -> bytes:
    return str(record["bytes"]).encode("latin-1")
