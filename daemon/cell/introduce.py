"""A first contact carried out on a port: bytes out and in on time, every one into a transcript, a stop at any moment.

What is typed is drivers/val2/introduction.py's; here is the port, the person and the clock. A transcript is lines of
JSON, each {"t_s", "way", "bytes" or "text"}: way is out, in, speed, says, asks, answers, unclear or stop.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
from collections.abc import Awaitable, Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from daemon.arrays import Array
from daemon.calibration.arm_from_readings import LENGTHS, ArmFound, NoArmError, find_arm, settle
from daemon.errors import FacetdError
from drivers.puma560 import PUMA560
from drivers.pumas import PUBLISHED, Likeness, PublishedArm, likeness
from drivers.val2 import introduction
from drivers.val2.dialect import Dialect
from drivers.val2.errors import PortError
from drivers.val2.introduction import (
    BAUDS,
    BY_PENDANT,
    Acquaintance,
    Consult,
    Exchange,
    Finding,
    Heard,
    Speed,
    Step,
    Tell,
    UnclearError,
)
from drivers.val2.location import matrix_from_location
from drivers.val2.port import OpenPort, Port, SerialPort

Write = Callable[[dict[str, Any]], None]
STOP_TWICE_S = 0.3
MISFIT_MORE = 2.4
"""A reading: steps are whole degrees, so that what the last digits of the joints leave out is the same in all readings,
and adds up in each; zeros that are free swallow it."""
APART_S = 0.03
"""Bytes nearer together than this are one line of the transcript, at the time of the last."""


class StoppedByPersonError(FacetdError):
    """A stop was wanted, and was sent."""


EXPECTED: tuple[type[Exception], ...] = (UnclearError, StoppedByPersonError, PortError)
"""How a first contact ends otherwise than well."""
serial_port: OpenPort = SerialPort
__all__ = [
    "BAUDS", "EXPECTED", "Acquaintance", "Arm", "Consult", "Person", "StoppedByPersonError", "again", "arm_file",
    "arm_of", "introduce", "page", "read_transcript", "serial_port",
]  # fmt: skip


@dataclass(frozen=True)
class Person:
    """Who sits there: is told a line, answers a question, and may want a stop at any time."""

    tell: Callable[[str], None]
    answer: Callable[[Consult], Awaitable[str]]
    wants_stop: asyncio.Event


class _Line:
    """The open port, what came and when, and the transcript."""

    def __init__(self, path: str, open_port: OpenPort, clock: Callable[[], float], write: Write) -> None:
        self._path, self._open_port, self.clock, self._write = path, open_port, clock, write
        self._port: Port | None = None
        self._came: list[tuple[float, bytes]] = []
        self._news = asyncio.Event()
        self._lost: PortError | None = None
        self._heard, self._heard_s = b"", 0.0

    def open(self, baud: int) -> None:
        """Claim the port at a speed. Raises PortError."""
        self.close()
        self.note("speed", text=str(baud))
        self._port = self._open_port(self._path, Dialect(baud=baud), self._hear, self._end)

    def close(self) -> None:
        """Let go of the port."""
        self._note_heard()
        if self._port is not None:
            self._port.close()
            self._port = None

    def send(self, data: bytes) -> None:
        """Raises PortError."""
        if self._lost is not None:
            raise self._lost
        if self._port is not None:
            self.note("out", bytes=data.decode("latin-1"))
            self._port.write(data)

    def taken(self) -> list[tuple[float, bytes]]:
        """What came since it was asked last."""
        came, self._came = self._came, []
        return came

    @property
    def last_s(self) -> float | None:
        """When something came last."""
        return self._came[-1][0] if self._came else None

    async def news(self, most_s: float) -> None:
        """Wait until something comes, most_s at most. Raises PortError."""
        self._news.clear()
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(self._news.wait(), max(most_s, 0.0))
        if self._lost is not None:
            raise self._lost

    def note(self, way: str, **what: str) -> None:
        """A line of the transcript; what was heard before it comes first."""
        self._note_heard()
        self._write({"t_s": round(self.clock(), 4), "way": way, **what})

    def _hear(self, data: bytes) -> None:
        now_s = self.clock()
        if now_s - self._heard_s > APART_S:
            self._note_heard()
        self._heard, self._heard_s = self._heard + data, now_s
        self._came.append((now_s, data))
        self._news.set()

    def _note_heard(self) -> None:
        if self._heard:
            self._write({"t_s": round(self._heard_s, 4), "way": "in", "bytes": self._heard.decode("latin-1")})
            self._heard = b""

    def _end(self, error: PortError) -> None:
        self._lost = error
        self._news.set()


async def introduce(
    path: str,
    open_port: OpenPort,
    person: Person,
    write: Write,
    bauds: Sequence[int] = BAUDS,
    pendant: bool = False,
) -> Acquaintance:
    """The first contact at a port. write: takes each line of the transcript; pendant: whether the person brings the arm
    to more places.

    Raises UnclearError with a question, PortError, StoppedByPersonError once the stop was sent.
    """
    known = Acquaintance()
    line = _Line(path, open_port, asyncio.get_running_loop().time, write)
    steps = introduction.introduce(known, bauds, pendant)
    reply: Any = None
    try:
        while True:
            try:
                step = steps.send(reply)
            except StopIteration:
                return known
            reply = await _unless_stopped(_do(step, line, person), known, line, person)
    except UnclearError as unclear:
        line.note("unclear", text=str(unclear))
        if known.moved:  # by its own WHERE nobody knows whether it rests
            await _typed(known.stop_bytes, known.pace_s, line)
        raise
    finally:
        steps.close()
        line.close()


async def _unless_stopped(doing: Awaitable[Any], known: Acquaintance, line: _Line, person: Person) -> Any:
    """What comes of it; or, at the moment a stop is wanted, the stop. Raises StoppedByPersonError."""
    task, stop = asyncio.ensure_future(doing), asyncio.ensure_future(person.wants_stop.wait())
    try:
        await asyncio.wait({task, stop}, return_when=asyncio.FIRST_COMPLETED)
        if person.wants_stop.is_set():
            line.note("stop", text="wanted by the person")
            for _ in range(2):
                await _typed(known.stop_bytes, known.pace_s, line)
                await asyncio.sleep(STOP_TWICE_S)
            raise StoppedByPersonError(f"stopped: {known.stop_word} was sent, twice. Look whether the arm rests")
        return task.result()
    finally:
        for one in (task, stop):
            one.cancel()
        await asyncio.gather(task, stop, return_exceptions=True)


async def _do(step: Step, line: _Line, person: Person) -> Heard | str | None:
    if isinstance(step, Exchange):
        return await _exchange(step, line)
    if isinstance(step, Speed):
        person.tell(f"listening at {step.baud} baud; how it speaks takes some 20 s, and nothing moves")
        line.open(step.baud)
    elif isinstance(step, Tell):
        line.note("says", text=step.text)
        person.tell(step.text)
    else:
        line.note("asks", text=step.text)
        answer = await person.answer(step)
        line.note("answers", text=answer)
        return answer
    return None


async def _typed(data: bytes, pace_s: float, line: _Line) -> None:
    """All of it, or pace_s between its characters."""
    for part in filter(None, [data] if pace_s <= 0 else [data[k : k + 1] for k in range(len(data))]):
        line.send(part)
        if pace_s > 0:
            await asyncio.sleep(pace_s)


async def _exchange(step: Exchange, line: _Line) -> Heard:
    await _typed(step.data, step.pace_s, line)
    sent_s = line.clock()
    while True:
        now_s = line.clock()
        ends_s = sent_s + step.most_s
        if line.last_s is not None:
            ends_s = min(ends_s, max(line.last_s, sent_s) + step.quiet_s)
        if now_s >= ends_s - 1e-9:
            pieces = tuple((max(0.0, at_s - sent_s), piece) for at_s, piece in line.taken())
            return Heard(pieces, now_s - sent_s)
        await line.news(ends_s - now_s)


# Which arm it is

FITTED = "least squares over WHERE's places and joints"
LOOSE_MM = 0.1
TOO_LOOSE_MM = 0.3
"""Standard deviations, told larger than they are (a place is taken to be off by two of its last digits)."""
LEAST_TOLD = 0.001
"""mm or degrees: no controller prints its places so finely that less could be told."""


@dataclass(frozen=True, eq=False)
class Arm:
    """The arm that the readings show, after a published one's lengths where they are those, and how these were
    found. source: `published` or `typed` where the readings settle all but the lengths."""

    found: ArmFound
    alike: Likeness | None
    others: tuple[str, ...]
    how: str
    source: str = ""


def arm_of(known: Acquaintance, typed_mm: tuple[float, float, float, float] | None = None) -> Arm:
    """Which arm makes the readings, and whose it is. typed_mm: its a2, a3, d3, d4, as its drawing has them, where none
    is published. Raises NoArmError."""
    arms = PUBLISHED if typed_mm is None else (PublishedArm("arm of the lengths typed", typed_mm, "its operator"),)
    places = np.array([matrix_from_location(where.location) for where in known.readings])
    printed = np.array([where.joints_deg for where in known.readings])
    mm, degrees = known.findings["digits"].value
    digits = (10.0**-mm, 10.0**-degrees)
    found, alike, sigma = _found(places, printed, digits, arms)
    if alike is not None and alike.unit_mm != 1.0:
        known.found("unit_mm", alike.unit_mm, f"WHERE's lengths are a {alike.arm.name}'s in this unit", "likely")
        places[:, :3, 3] *= alike.unit_mm
        digits = (alike.unit_mm * digits[0], digits[1])
        found, alike, sigma = _found(places, printed, digits, arms)
    if alike is None and typed_mm is not None:
        raise NoArmError(
            f"WHERE shows {_lengths(found)}: not the lengths typed, {', '.join(f'{one:g}' for one in typed_mm)} mm"
        )
    if max(sigma) < LOOSE_MM or alike is None:
        return Arm(found, alike, (), FITTED)
    settled = sorted(_like_published(found, arms, places, printed, digits, sigma), key=lambda each: each[0])
    best = settled[0]
    fits = best[0] <= found.misfit + MISFIT_MORE * len(printed)
    if not fits and typed_mm is not None:
        raise NoArmError(f"the lengths typed do not fit WHERE's places, which show {_lengths(found)}")
    if not fits:
        return Arm(found, None, (), f"{FITTED}; no published lengths fit them")
    others = tuple({each[1].name for each in settled[1:] if each[0] < best[0] + 9.0} - {best[1].name})
    return Arm(
        best[2],
        replace(alike, arm=best[1]),
        others,
        f"the readings lie so near together that they leave {max(sigma):.1f} mm open; the lengths are those "
        + (f"published for the {best[1].name} ({best[1].source})" if typed_mm is None else "typed")
        + ", which fit",
        "published" if typed_mm is None else "typed",
    )


def _found(
    places: Array, printed: Array, digits: tuple[float, float], arms: Sequence[PublishedArm]
) -> tuple[ArmFound, Likeness | None, tuple[float, float, float, float]]:
    """The arm, which of arms it is like, and how well its lengths are known."""
    found = find_arm(places, printed, digits)
    sigma = found.sigma["a2"], found.sigma["a3"], found.sigma["d3"], found.sigma["d4"]
    return found, likeness(found.lengths_mm, sigma, arms), sigma


def _lengths(found: ArmFound) -> str:
    return ", ".join(
        f"{name} {value:.1f} mm {_sure(found, name)}" for name, value in zip(LENGTHS, found.lengths_mm, strict=True)
    )


def _like_published(
    found: ArmFound,
    arms: Sequence[PublishedArm],
    places: Array,
    printed: Array,
    digits: tuple[float, float],
    sigma: Sequence[float],
) -> Iterator[tuple[float, Any, ArmFound]]:
    """For each published arm near enough: its misfit, itself, and the readings' arm with its lengths."""
    for arm in arms:
        if likeness(found.lengths_mm, tuple(sigma), (arm,)) is None:  # type: ignore[arg-type]
            continue
        a2, a3, d3, d4 = arm.lengths_mm
        for elbow_mm in {a3, -a3}:
            lengths = a2, elbow_mm, float(np.copysign(d3, found.d3_mm)), d4
            made = settle(found, places, printed, lengths, digits)
            yield made.misfit, arm, made


# What is kept: arm.yaml and a page


def _zeros_deg(found: ArmFound, known: Acquaintance) -> list[float]:
    """Joints' zeros, each by so many whole turns that the arm, where it was read, is nearest to the middle of a PUMA's
    ranges: which turn it is, no place can tell."""
    printed = np.array([where.joints_deg for where in known.readings]).mean(axis=0)
    ours = Dialect(
        joint_signs=found.convention.signs,  # type: ignore[arg-type]
        joint_3_against_horizon=found.convention.against_horizon,
    ).our_angles_deg(tuple(printed))
    middle = np.degrees(PUMA560.limits_rad).mean(axis=1)
    turns = np.round((middle - np.array(ours) - np.array(found.zeros_deg)) / 360.0)
    return [round(float(zero), 3) for zero in np.array(found.zeros_deg) + 360.0 * turns]


def arm_file(known: Acquaintance, arm: Arm | None) -> dict[str, Any]:
    """arm.yaml: the dialect, and the geometry where readings showed one; each value with how it was found, how sure."""
    dialect = {name: _entry(known.findings[name]) for name in known.dialect()}
    made: dict[str, Any] = {"version": 1, "dialect": dialect}
    if arm is not None:
        found = arm.found
        dialect |= {
            "joint_signs": _value(list(found.convention.signs), FITTED, "certain"),
            "joint_zeros_deg": _value(_zeros_deg(found, known), FITTED, _sure(found, "zero_2")),
            "joint_3_against_horizon": _value(found.convention.against_horizon, FITTED, "certain"),
        }
        base = np.eye(4)
        base[:3, 3] = found.base_mm
        made["geometry"] = {
            **{
                f"{name}_mm": _value(round(value, 3), arm.how, _length_sure(arm, name))
                for name, value in zip(LENGTHS, found.lengths_mm, strict=True)
            },
            "world_from_base": _value(
                _rows(base), "where axes 1 and 2 cross; BASE's turn is in joint 1's zero", _sure(found, "base_x")
            ),
            "controller_flange": _value(
                _rows(found.wrist_from_tool), "WHERE's place from the wrist centre; TOOL must have been nothing",
                _sure(found, "tool_z"),
            ),
        }  # fmt: skip
    return made


def _sure(found: ArmFound, name: str) -> str:
    return "open" if name in found.undetermined else f"+-{max(2 * found.sigma[name], LEAST_TOLD):.2g}"


def _length_sure(arm: Arm, name: str) -> str:
    return arm.source or _sure(arm.found, name)


def _entry(finding: Finding) -> dict[str, Any]:
    return _value(finding.value, finding.found, finding.sure)


def _value(value: Any, found: str, sure: str) -> dict[str, Any]:
    return {"value": value, "found": found, "sure": sure}


def _rows(matrix: Array) -> list[list[float]]:
    return [[round(float(value), 9) for value in row] for row in matrix]


def page(known: Acquaintance, arm: Arm | None) -> str:
    """What was seen, for a person."""
    lines = ["What the controller showed", ""]
    lines += [f"  {f.name:<20} {f.value!r:<24} {f.sure}: {f.found}" for f in known.findings.values()]
    if arm is not None:
        lines += ["", "Which arm it is", "", *_about(arm)]
    lines += ["", "What nobody can find out from here", "",
              "  the joints' limits (type them from the plate, counted as WHERE does: arm.yaml, geometry.limits_deg)",
              "  whether the arm was calibrated rightly: it counts from where CAL left it",
              "  where joint 6 ends and the tool begins: TOOL's turn about the flange is in joint 6's zero",
              "  how high the shoulder stands, and what is in reach"]  # fmt: skip
    return "\n".join(lines) + "\n"


def _about(arm: Arm) -> Iterator[str]:
    found, alike = arm.found, arm.alike
    if alike is None:
        yield "  none that is published here: its own lengths are used"
        if max(found.sigma[name] for name in LENGTHS) > TOO_LOOSE_MM:
            yield "  Small steps leave them too loose: a WHERE elsewhere will not fit, and is taken for spoilt."
            yield "  Say it again with --pendant, or with --lengths A2,A3,D3,D4, in mm, from the maker's drawing."
    else:
        side = {None: "the shoulder's side is a matter of where its front is", True: "shoulder offset to the left",
                False: "shoulder offset to the right"}[alike.mirrored]  # fmt: skip
        yield f"  {alike.arm.name}, {side}"
    if arm.others:
        yield f"  it could as well be: {', '.join(arm.others)}; say it again with --pendant: six places would tell"
    for name, value in zip(LENGTHS, found.lengths_mm, strict=True):
        yield f"  {name} {value:9.2f} mm  {_length_sure(arm, name)}"
    signs = " ".join("+" if sign > 0 else "-" for sign in found.convention.signs)
    zeros = " ".join(f"{zero:.6g}" for zero in np.round(found.zeros_deg, 2) + 0.0)
    yield f"  joints 1 to 6: signs {signs}, zeros {zeros} degrees"
    if found.convention.against_horizon:
        yield "  joint 3 is counted against the horizon"
    yield f"  misfit {found.place_mm:.3f} mm, {found.turn_deg:.4f} degrees; {arm.how}"
    if found.undetermined:
        yield f"  left open by the readings: {', '.join(found.undetermined)}"


# Again, from a transcript


def again(transcript: Iterable[dict[str, Any]]) -> Iterator[str]:
    """Today's introduction against a recorded one: a line for each place where it would say something else.

    It hears what was heard then, at its time, as long as it types what was typed then.
    """
    records = list(transcript)
    known = Acquaintance()
    bauds = [int(record["text"]) for record in records if record["way"] == "speed"]
    pendant = any(record["way"] == "asks" and record["text"].startswith(BY_PENDANT) for record in records)
    steps = introduction.introduce(known, bauds, pendant)
    at, reply = 0, None
    while True:
        try:
            step = steps.send(reply)
        except StopIteration:
            return
        except UnclearError as unclear:
            told = [record["text"] for record in records if record["way"] == "unclear"]
            if told != [str(unclear)]:
                yield f"it ends here with: {unclear}"
            return
        was, at, reply = _as_then(step, records, at)
        if was is not None:
            steps.close()
            yield was
            return


def _as_then(step: Step, records: list[dict[str, Any]], at: int) -> tuple[str | None, int, Any]:
    """What differs (None: nothing), where the record goes on, and what was answered then."""
    if isinstance(step, Exchange):
        return _exchange_as_then(step, records, at)
    way, text = {Speed: ("speed", str(getattr(step, "baud", ""))), Tell: ("says", getattr(step, "text", "")),
                 Consult: ("asks", getattr(step, "text", ""))}[type(step)]  # fmt: skip
    if at >= len(records) or (records[at]["way"], records[at].get("text")) != (way, text):
        then = "nothing" if at >= len(records) else f"{records[at]['way']} {records[at].get('text', '')!r}"
        return f"record {at + 1}: then {then}, now {way} {text!r}", at, None
    if way != "asks":
        return None, at + 1, None
    return None, at + 2, records[at + 1]["text"]


def _exchange_as_then(step: Exchange, records: list[dict[str, Any]], at: int) -> tuple[str | None, int, Any]:
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
    last_s = None
    while at < len(records) and records[at]["way"] == "in":
        since_s = max(0.0, records[at]["t_s"] - sent_s)
        ends_s = step.most_s if last_s is None and not pieces else min(step.most_s, (last_s or 0.0) + step.quiet_s)
        if since_s > ends_s + 1e-3:
            break
        pieces.append((since_s, records[at]["bytes"].encode("latin-1")))
        last_s, at = since_s, at + 1
    seconds = step.most_s if not pieces else min(step.most_s, (last_s or 0.0) + step.quiet_s)
    return None, at, Heard(tuple(pieces), seconds)


def read_transcript(lines: Iterable[str]) -> Iterator[dict[str, Any]]:
    """The records of a transcript. Raises ValueError naming the line."""
    for number, line in enumerate(lines, 1):
        try:
            record = json.loads(line)
            record["t_s"], record["way"]
        except (ValueError, KeyError, TypeError) as error:
            raise ValueError(f"line {number}: not a line of a transcript ({error})") from None
        yield record
