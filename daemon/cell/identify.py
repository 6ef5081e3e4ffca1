"""Identify a controller on a serial port: run the steps of drivers/val2/first_contact.py with a transcript and a stop.

identified_arm.py finds the arm. Also replays a transcript: lines of JSON, each {"t_s", "way", "bytes" or "text"}; way
is out, in, heard (ends an exchange: what came in before belongs to it), speed, says, asks, answers, unclear or stop.
"""

import asyncio
import contextlib
import json
from collections.abc import Awaitable, Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from daemon.errors import FacetdError
from drivers.val2 import first_contact
from drivers.val2.contact_findings import Consult as Consult
from drivers.val2.contact_findings import ContactFindings as ContactFindings
from drivers.val2.contact_findings import Exchange, Heard, Speed, Step, Tell, UnclearError
from drivers.val2.dialect import Dialect
from drivers.val2.errors import Disturbed, LinkError
from drivers.val2.first_contact import BAUDS as BAUDS
from drivers.val2.first_contact import BY_PENDANT
from drivers.val2.port import OpenPort, Port, SerialPort

Write = Callable[[dict[str, Any]], None]
STOP_TWICE_S = 0.3
APART_S = 0.03
"""Bytes nearer together than this are one line of the transcript, with the time of the last."""


class StoppedByPersonError(FacetdError):
    """The person stopped the identification, and the stop was sent."""


EXPECTED: tuple[type[Exception], ...] = (UnclearError, StoppedByPersonError, LinkError)
"""Errors that end an identification."""
serial_port: OpenPort = SerialPort


@dataclass(frozen=True)
class Person:
    """The person at the terminal: reads lines, answers questions, may stop at any time."""

    tell: Callable[[str], None]
    answer: Callable[[Consult], Awaitable[str]]
    wants_stop: asyncio.Event


class ContactLine:
    """The open port, the received bytes with their times, and the transcript."""

    def __init__(self, path: str, open_port: OpenPort, clock: Callable[[], float], write: Write) -> None:
        self._path, self._open_port, self.clock, self._write = path, open_port, clock, write
        self._port: Port | None = None
        self._came: list[tuple[float, bytes]] = []
        self._news = asyncio.Event()
        self._broken: LinkError | OSError | None = None
        """The port was lost, or the transcript cannot be written."""
        self._heard, self._heard_s = b"", 0.0

    def open(self, baud: int) -> None:
        """Open the port at a baud rate. Raises LinkError."""
        self.close()
        self._port = self._open_port(self._path, Dialect(baud=baud), self._hear, self._end)

    def close(self) -> None:
        self._note_heard()
        if self._port is not None:
            self._port.close()
            self._port = None

    def send(self, data: bytes) -> None:
        """Send bytes. Raises LinkError, or OSError where they cannot be recorded."""
        self.note("out", bytes=data.decode("latin-1"))
        self.check()
        if self._port is not None:
            self._port.write(data)

    def send_stop(self, data: bytes) -> None:
        """Send bytes that stop the arm, even where they cannot be recorded, or somebody changed the port just then.
        Raises LinkError."""
        self.note("out", bytes=data.decode("latin-1"))
        if self._port is not None:
            with contextlib.suppress(Disturbed):
                self._port.write(data)
                return
            self._port.write(data)

    def check(self) -> None:
        """Raise LinkError or OSError where further bytes cannot be sent or recorded."""
        if self._broken is not None:
            raise self._broken

    def taken(self) -> list[tuple[float, bytes]]:
        """Take the bytes received since the last call."""
        came, self._came = self._came, []
        return came

    @property
    def last_s(self) -> float | None:
        """Time of the last received bytes, or None."""
        return self._came[-1][0] if self._came else None

    async def news(self, most_s: float) -> None:
        """Wait for bytes, at most most_s. Raises LinkError, OSError."""
        self._news.clear()
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(max(most_s, 0.0)):
                await self._news.wait()
        self.check()

    def note(self, way: str, **what: str) -> None:
        """Write a line of the transcript, after the bytes received before it."""
        self._note_heard()
        self._keep({"t_s": round(self.clock(), 4), "way": way, **what})

    def _hear(self, data: bytes) -> None:
        now_s = self.clock()
        if now_s - self._heard_s > APART_S:
            self._note_heard()
        self._heard, self._heard_s = self._heard + data, now_s
        self._came.append((now_s, data))
        self._news.set()

    def _note_heard(self) -> None:
        if self._heard:
            self._keep({"t_s": round(self._heard_s, 4), "way": "in", "bytes": self._heard.decode("latin-1")})
            self._heard = b""

    def _keep(self, record: dict[str, Any]) -> None:
        try:
            self._write(record)
        except OSError as error:
            self._end(error)

    def _end(self, error: LinkError | OSError) -> None:
        self._broken = error
        self._news.set()


async def identify(
    path: str, open_port: OpenPort, person: Person, write: Write, bauds: Sequence[int] = BAUDS, pendant: bool = False
) -> ContactFindings:
    """Identify the controller at a port. write: receives each line of the transcript; pendant: whether the person moves
    the arm to more poses.

    Raises UnclearError with a question, LinkError, StoppedByPersonError after the stop was sent, and what write raises.
    """
    known = ContactFindings()
    line = ContactLine(path, open_port, asyncio.get_running_loop().time, write)
    steps = first_contact.introduce(known, bauds, pendant)
    reply: Any = None
    try:
        while True:
            try:
                step = steps.send(reply)
            except StopIteration:
                line.check()
                return known
            reply = await _unless_stopped(_do(step, line, person), known, line, person)
    except StoppedByPersonError:
        raise
    except BaseException as error:  # disk full, terminal lost: nobody watches the arm any more
        if isinstance(error, UnclearError):
            line.note("unclear", text=str(error))
        if known.moved:
            await _typed(known.stop_bytes, known.pace_s, line.send_stop)
            with contextlib.suppress(OSError):
                person.tell(f"{known.stop_word} was sent. Check that the arm is at rest")
        raise
    finally:
        steps.close()
        line.close()


async def _unless_stopped(doing: Awaitable[Any], known: ContactFindings, line: ContactLine, person: Person) -> Any:
    """Await a step, and send the stop as soon as the person wants it. Raises StoppedByPersonError."""
    task, stop = asyncio.ensure_future(doing), asyncio.ensure_future(person.wants_stop.wait())
    try:
        await asyncio.wait({task, stop}, return_when=asyncio.FIRST_COMPLETED)
        if person.wants_stop.is_set():
            task.cancel()  # else its bytes would mix with those of the stop
            await asyncio.wait({task})
            line.note("stop", text="wanted by the person")
            for _ in range(2):
                await _typed(known.stop_bytes, known.pace_s, line.send_stop)
                await asyncio.sleep(STOP_TWICE_S)
            raise StoppedByPersonError(f"stopped: {known.stop_word} was sent twice. Check that the arm is at rest")
        return task.result()
    finally:
        for one in (task, stop):
            one.cancel()
        await asyncio.gather(task, stop, return_exceptions=True)


async def _do(step: Step, line: ContactLine, person: Person) -> Heard | str | None:
    if isinstance(step, Exchange):
        return await _exchange(step, line)
    line.note(step.way, text=step.text)
    if isinstance(step, Speed):
        person.tell(f"listening at {step.baud} baud; identifying the line takes some 20 s, and nothing moves")
        line.open(step.baud)
    elif isinstance(step, Tell):
        person.tell(step.text)
    else:
        answer = await person.answer(step)
        line.note("answers", text=answer)
        return answer
    return None


async def _typed(data: bytes, pace_s: float, send: Callable[[bytes], None]) -> None:
    """Send data at once, or with pace_s between its characters."""
    for part in filter(None, [data] if pace_s <= 0 else [data[k : k + 1] for k in range(len(data))]):
        send(part)
        if pace_s > 0:
            await asyncio.sleep(pace_s)


async def _exchange(step: Exchange, line: ContactLine) -> Heard:
    await _typed(step.data, step.pace_s, line.send)
    sent_s = line.clock()
    while True:
        now_s = line.clock()
        ends_s = sent_s + step.most_s
        if line.last_s is not None:
            ends_s = min(ends_s, max(line.last_s, sent_s) + step.quiet_s)
        if now_s >= ends_s - 1e-9:
            pieces = tuple((max(0.0, at_s - sent_s), piece) for at_s, piece in line.taken())
            line.note("heard")  # on a busy computer more bytes may have arrived than the times suggest
            return Heard(pieces, now_s - sent_s)
        await line.news(ends_s - now_s)


# Replay of a transcript


def replay(transcript: Iterable[dict[str, Any]]) -> Iterator[str]:
    """Replay a transcript with today's identification: a line where it first differs.

    It receives the recorded bytes at their times as long as it sends the recorded ones.
    """
    records = list(transcript)
    known = ContactFindings()
    bauds = [int(record["text"]) for record in records if record["way"] == "speed"]
    pendant = any(record["way"] == "asks" and record["text"].startswith(BY_PENDANT) for record in records)
    steps = first_contact.introduce(known, bauds, pendant)
    at, reply = 0, None
    while True:
        try:
            step = steps.send(reply)
        except StopIteration:
            return
        except UnclearError as unclear:
            recorded = [record["text"] for record in records if record["way"] == "unclear"]
            if recorded != [str(unclear)]:
                yield f"it ends here with: {unclear}"
            return
        difference, at, reply = _compared(step, records, at)
        if difference is not None:
            steps.close()
            yield difference
            return


def _compared(step: Step, records: list[dict[str, Any]], at: int) -> tuple[str | None, int, Any]:
    """(difference or None, index of the next record, the recorded answer)."""
    if isinstance(step, Exchange):
        return _compared_exchange(step, records, at)
    _text_before_bytes(records, at)
    if at >= len(records) or (records[at]["way"], records[at].get("text")) != (step.way, step.text):
        then = "nothing" if at >= len(records) else f"{records[at]['way']} {records[at].get('text', '')!r}"
        return f"record {at + 1}: then {then}, now {step.way} {step.text!r}", at, None
    if not isinstance(step, Consult):
        return None, at + 1, None
    _text_before_bytes(records, at + 1)
    return None, at + 2, records[at + 1]["text"]


def _text_before_bytes(records: list[dict[str, Any]], at: int) -> None:
    """Bytes received after the end of an exchange belong to the next one: move the text in between before them."""
    text_at = _after_bytes(records, at)
    records[at : text_at + 1] = [*records[text_at : text_at + 1], *records[at:text_at]]


def _after_bytes(records: list[dict[str, Any]], at: int) -> int:
    """Index of the first record from `at` on that is not received bytes."""
    return next((k for k in range(at, len(records)) if records[k]["way"] != "in"), len(records))


def _compared_exchange(step: Exchange, records: list[dict[str, Any]], at: int) -> tuple[str | None, int, Any]:
    sent, sent_s, pieces = b"", records[at]["t_s"] if at < len(records) else 0.0, []
    while at < len(records) and len(sent) < len(step.data) and records[at]["way"] in ("out", "in"):
        data = records[at]["bytes"].encode("latin-1")
        if records[at]["way"] == "out":
            sent, sent_s = sent + data, records[at]["t_s"] + step.pace_s
        else:
            pieces.append((0.0, data))
        at += 1
    if sent != step.data:
        return f"record {at}: then {sent!r} was typed, now {step.data!r}", at, None
    last_s, ends = None, _after_bytes(records, at)
    marked = ends < len(records) and records[ends]["way"] == "heard"  # older transcripts have only the times
    while at < len(records) and records[at]["way"] == "in":
        since_s = max(0.0, records[at]["t_s"] - sent_s)
        ends_s = step.most_s if last_s is None and not pieces else min(step.most_s, (last_s or 0.0) + step.quiet_s)
        if since_s > ends_s + 1e-3 and not marked:
            break
        pieces.append((since_s, records[at]["bytes"].encode("latin-1")))
        last_s, at = since_s, at + 1
    if marked:
        return None, at + 1, Heard(tuple(pieces), max(0.0, records[at]["t_s"] - sent_s))
    seconds = step.most_s if not pieces else min(step.most_s, (last_s or 0.0) + step.quiet_s)
    return None, at, Heard(tuple(pieces), seconds)


def read_transcript(lines: Iterable[str]) -> Iterator[dict[str, Any]]:
    """Parse the lines of a transcript. Raises ValueError with the line number."""
    for number, line in enumerate(lines, 1):
        try:
            record = json.loads(line)
            record["t_s"], record["way"]
        except (ValueError, KeyError, TypeError) as error:
            raise ValueError(f"line {number}: not a line of a transcript ({error})") from None
        yield record
