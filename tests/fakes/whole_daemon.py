"""The whole daemon in one process on simulated time, with its cell, its operators, and injected faults.

The service is daemon/service.py, with a real socket and serial terminal; only the controller's line is in memory,
because a pty has a clock of its own. The cell outlives the daemon, as a real one does.

Permission to move follows from the operators' commands alone (Words), as typed here. Its withdrawal follows from their
commands and from the daemon's output, which counts only against the daemon. All other facts are in the machine's
history (drivers/simcell/motion_monitor.py).
"""

from __future__ import annotations

import asyncio
import errno
import itertools
import json
import os
import pty
import select
import shlex
import shutil
import signal
import socket
import stat
import tempfile
import time
import tty
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from functools import cache, partial
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import yaml

from daemon import frames, service
from daemon.arm.belief import Beliefs
from daemon.arm.body import within_mm
from daemon.calibration.file import load_calibration
from daemon.cell import build as build_room
from daemon.cell import sections
from daemon.cell.cameras import ThreadedCameras
from daemon.cell.hardware import Hardware
from daemon.cell.sections import arm_geometry, dialect
from daemon.cell.simulated_operator import SimulatedOperator
from daemon.cell.val2_arm import Val2Arm
from daemon.cli.demo import VIEWS
from daemon.commands import moving
from daemon.config import Config
from daemon.console.context import CommandContext
from daemon.events.outcomes import Outcome
from daemon.maintenance import journal
from daemon.pick.outcome import CycleEnd
from daemon.pick.recogniser import ModelRecogniser
from daemon.service import NO_DEVICE, Service
from daemon.store import model as models
from daemon.store import runlog
from daemon.store.library import load_facets
from daemon.vision.model.model import empty_model, learn_view
from drivers.rigid import rigid, turn
from drivers.simcell.cell import SimulatedCell
from drivers.simcell.controller import Manners, Mishap
from drivers.simcell.history import DropRecord
from drivers.simcell.motion_monitor import Violation
from drivers.simcell.world import PartPlace
from drivers.val2.link import Link
from tests.fakes.computing import ComputesHere
from tests.fakes.memory_line import MemoryLine
from tests.fakes.others_heard import OthersHeard
from tests.fakes.simulated_time import SimulatedLoop

ETC = Path(__file__).resolve().parents[2] / "etc"
PIXELS = 0.5
"""Scale of the simulated images against the cell's, each way: smaller images are processed faster."""
SLOWEST, FASTEST = 25.0, 40.0
"""Percent: speed limits that the configuration sets alternately; the motion monitor has the same ones."""
POST = {"low_mm": (300.0, 215.0, -300.0), "high_mm": (345.0, 260.0, -20.0)}
"""A post that nothing of the arm enters; the daemon is told of one a little larger, for what it does not know of the
arm."""
SPARE_MM = 3.0
COMPUTED_S = 0.7
"""Duration of a calculation outside the event loop: a look, a plan."""
MOMENT_S = 1e-7
"""What is typed at a moment counts from just after it, one after the other: what left at that very moment had left
before."""
SLICE_S = 0.25
"""How often somebody looks whether the line is clear, and how often a command that may ask looks whether it must. What
the daemon says at its sockets is read as it comes."""
TAUGHT = ("cube", "pentagonal_prism")
STARTS, TRIES = 5, 4
"""How often the daemon may start; how often a view that was not seen whole is shown again."""
END_S = 9.0
"""The unit's TimeoutStopSec, less the time that the disk may need."""
HARMED_S = 8.0
"""How long the arm's stop may take, with all its attempts, if the line damages it."""
STOPPED_S = 2.0
"""How long a stop that is typed at a terminal may be in transit."""
HELD_STILL_S, NOTICED_S = 10.0, 1.0
"""A daemon that did not run for longer than this lets nothing go on by itself, once it has had so long to notice."""
AT_REST = ("Stopped", "Nothing moves.", "The arm does not move until")
"""How an answer begins that reports the arm at rest."""
READERS = ("load_facets", "load_parts", "load_model")
MOVES = ("pick", "auto", "go", "hand", "robot", "calibrate", "confirm", "teach", "step", "look", "try", "where",
         "resume", "enable")  # fmt: skip
"""Commands after which the arm may move again after a stop that left no fault."""


Key = tuple[object, object]
"""The frontend, and the number of its line."""


class Words:
    """Tracks the operators' commands, and reports to the motion monitor what they permit."""

    def __init__(self, story: Story) -> None:
        self._story = story
        self.enabled, self._stopped = False, False
        self._in_doubt = 0
        """How many control-Cs are not yet answered with whether there was anything to stop."""
        self._enabling: dict[Key, str] = {}
        self._resuming: set[Key] = set()
        self._stopping: set[Key] = set()
        """Stops that are not answered yet: each is typed on the line more than once."""
        self._dry, self._resumed = False, 0
        self._typed: dict[Key, tuple[str, int]] = {}
        """Lines that are not done yet, with the number of resumes when they were typed."""
        self._by_hand: dict[Key, int | None] = {}
        """What may open the hand: lines that are not done yet, and those (with their status) that failed: they may yet
        be carried out."""

    @property
    def allowed(self) -> bool:
        """Whether the arm may move, according to the operators' commands."""
        stopped = self._in_doubt or (self._stopped and not self._resuming)
        return (self.enabled or bool(self._enabling)) and not stopped and not self._dry

    @property
    def _sent_off(self) -> bool:
        """Whether an operator waits for a motion: on a line that was reopened the stop is tested before it."""
        lines = (text for key, (text, _) in self._typed.items() if isinstance(key[0], SocketOperator))
        return any(is_word(first_word(line), known) for line in lines for known in MOVES)

    def said(self, text: str, key: Key, may: str) -> None:
        """A line was typed at a frontend with these rights; key: that of its future answer."""
        word = first_word(text)
        motion_monitor, now_s = self._story.cell.motion_monitor, self._story.stamp_s()
        if is_word(word, "stop"):
            self.stop(f"`{text}`")
        alone = len(text.split()) == 1
        aborts = alone and is_word(word, "abort")
        if aborts:
            motion_monitor.stop_received(now_s, f"`{text}`")
        if aborts or is_word(word, "stop"):
            self._stopping.add(key)
            self._tell(False)
            if not isinstance(key[0], SocketOperator):  # a terminal tells no answers apart
                self._story.loop.call_later(STOPPED_S, self._stop_over, key)
        if may == "look":
            return
        self._held_or_not(text, key, now_s)
        if alone and is_word(word, "disable"):
            self.enabled = False
        if is_word(word, "enable"):
            self._enabling[key] = text
        if is_word(word, "resume"):
            self._resuming.add(key)
        if is_word(word, "hand") or is_word(word, "robot"):
            self._by_hand[key] = None
            motion_monitor.drop_permitted(now_s)
        elif any(is_word(word, known) for known in MOVES):
            self._by_hand = {line: status for line, status in self._by_hand.items() if status is None}
            motion_monitor.drop_permitted(now_s, bool(self._by_hand))
        if is_word(word, "robot"):
            motion_monitor.typed_by_person(now_s, typed_to_controller(text))
        self._tell(any(is_word(word, known) for known in MOVES))

    def _held_or_not(self, text: str, key: Key, now_s: float) -> None:
        """A release of moves counts when it is typed and when it is done; a hold, when it is done."""
        self._typed[key] = text, self._resumed
        self._let_go(text, now_s)
        if is_word(first_word(text), "confirm") or text.lower().startswith("y"):
            self._story.cell.motion_monitor.confirmed(now_s)

    def _let_go(self, text: str, now_s: float) -> None:
        word, motion_monitor = first_word(text), self._story.cell.motion_monitor
        if is_word(word, "resume"):
            self._resumed += 1
            motion_monitor.motion_held(now_s, False)
        if is_word(word, "step") and "on" not in text.split():
            self._resumed += 1
            motion_monitor.confirm_each(now_s, False)
        if is_word(word, "dry") and "on" not in text.split():
            self._resumed += 1
            self._dry = False

    def _holds(self, key: Key) -> None:
        """A line is done that may hold moves."""
        text, resumed = self._typed.get(key, ("", 0))
        word, motion_monitor, now_s = first_word(text), self._story.cell.motion_monitor, self._story.stamp_s()
        self._let_go(text, now_s)
        if resumed != self._resumed:  # which was done first nobody knows
            return
        if is_word(word, "pause"):
            motion_monitor.motion_held(now_s, True)
        if is_word(word, "step") and "on" in text.split():
            motion_monitor.confirm_each(now_s, True)
        if is_word(word, "dry") and "on" in text.split():
            self._dry = True

    def answered(self, key: Key, text: str, status: int) -> None:
        """A line was answered."""
        if status == 0:
            self._holds(key)
        self._typed.pop(key, None)
        self._stopping.discard(key)
        if self._enabling.pop(key, None) is not None and status == 0:
            self.enabled = True
        if key in self._by_hand:
            self._by_hand[key] = status
            if status == 0:
                del self._by_hand[key]
                self._story.cell.motion_monitor.drop_permitted(self._story.stamp_s(), bool(self._by_hand))
        if key in self._resuming:
            self._resuming.discard(key)
            if status == 0:
                self._stopped = False
        if status == 0 and "Auto resumed; `auto off`" in text:
            self.enabled = True
        self._tell("Auto resumed; `auto off`" in text)

    def agreed(self, question: str) -> None:
        """A question was answered with yes."""
        self._story.cell.motion_monitor.confirmed(self._story.stamp_s())
        if "Enable the arm and continue" in question:
            self.enabled = True
        self._tell(True)

    def pressed(self, keys: str) -> None:
        """A person typed to the controller: such a line counts as theirs, also one of which they erased a part."""
        motion_monitor, now_s, line = self._story.cell.motion_monitor, self._story.stamp_s(), keys.strip()
        for end in range(1, len(line) + 1):
            motion_monitor.typed_by_person(now_s, line[:end])
        motion_monitor.confirmed(now_s)
        motion_monitor.drop_permitted(now_s)
        self._tell(True)

    def stop(self, why: str) -> None:
        """Somebody requested a stop, or the daemon reports an active fault."""
        self._stopped = True
        self._resuming.clear()
        self._received(why)

    def interrupted(self) -> None:
        """Control-C: counts as a stop until the daemon answers that there was nothing to stop."""
        self._in_doubt += 1
        self._received("control-C")

    def settled(self, stopped: str | None) -> None:
        """A control-C was answered; None: it found nothing to stop, and left no fault."""
        self._in_doubt -= 1
        if stopped is None:
            self._tell(True)
        else:
            self.stop(stopped)

    def disabled(self) -> None:
        """The daemon reports it, or an event occurred after which only another `enable` permits motion."""
        self.enabled = False
        self._tell(False)

    def held_still(self) -> None:
        """The daemon was stalled for long: earlier work may continue only with a new permission."""
        if self.enabled and not self._stopped:
            resumed = self._resumed
            self._story.loop.call_later(NOTICED_S, lambda: self._resumed != resumed or self.stop("held still"))

    def _received(self, why: str) -> None:
        self._by_hand = dict.fromkeys(self._by_hand, 1)
        self._story.cell.motion_monitor.stop_received(self._story.stamp_s(), why)
        self._tell(False)

    def _stop_over(self, key: Key) -> None:
        self._stopping.discard(key)
        self._tell(False)

    def gone(self, frontend: SocketOperator) -> None:
        """The operator has disconnected, so that nobody reads the answer to a stop."""
        self._stopping = {key for key in self._stopping if key[0] is not frontend}
        self._tell(False)

    def over(self) -> None:
        """The daemon ends, and so do the commands that were given to it."""
        self.enabled = self._dry = False
        self._enabling.clear()
        self._resuming.clear()
        self._stopping.clear()
        self._typed.clear()
        self._story.cell.motion_monitor.motion_held(self._story.stamp_s(), False)
        self._story.cell.motion_monitor.confirm_each(self._story.stamp_s(), False)
        self._tell(False)

    def _tell(self, wanted: bool) -> None:
        tries = self.allowed and (bool(self._enabling) or self._sent_off)
        self._story.cell.motion_monitor.stop_test(self._story.stamp_s(), bool(self._stopping) or tries)
        self._story.may_move(self.allowed, wanted)


def first_word(text: str) -> str:
    """The word that the daemon may take for the command, however it is quoted."""
    try:
        words = shlex.split(text, comments=True)
    except ValueError:
        words = text.split()
    return words[0].lower() if words else ""


def typed_to_controller(text: str) -> str:
    """What comes of a line that begins with `robot`: where CAL moves the arm is for the operator to say who confirms
    it, as for any other line of theirs."""
    rest = text.split()[1:]
    calibrates = len(rest) == 1 and is_word(rest[0].lower(), "cal")
    return "CAL" if calibrates else text.partition("onitor")[2].strip()


def is_word(typed: str, name: str) -> bool:
    """Whether typed text may be taken for a command: the whole word, or an abbreviation."""
    return typed == name or (len(typed) >= 3 and name.startswith(typed))


@dataclass(eq=False)
class SocketOperator:
    """One operator at the daemon's socket."""

    story: Story
    asks: bool
    may = "all"
    line: socket.socket | None = None
    question: tuple[int, str] | None = None
    heard: bytes = b""
    at_controller: bool = False
    """Whether typed text goes to the controller."""
    number: int = 0
    answered: int = 0
    interrupts: int = 0
    stops: int = 0
    """Control-Cs, and stops typed as answers, that are not answered yet."""
    withdrawn: list[Key] = field(default_factory=list)
    """Other lines that were typed as answers, withdraw the permission to move, and are not answered yet."""

    def open(self) -> None:
        """Connect if a daemon runs."""
        self.close()
        line = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            line.connect(str(self.story.folder / "facetd.sock"))
        except OSError:
            line.close()
            return
        line.setblocking(False)
        self.line = line
        self.story.loop.add_reader(line, self.hear)
        self.send({"notices": True})

    def close(self) -> None:
        """Hang up."""
        if self.line is not None:
            self.story.loop.remove_reader(self.line)
            self.line.close()
        self.line, self.question, self.heard, self.at_controller = None, None, b"", False
        self.story.words.gone(self)
        while self.interrupts > 0:  # nobody reads what came of it; where there was a stop, its fault is told all
            self._settled(None)
        self.stops, self.withdrawn = 0, []

    @property
    def waits(self) -> bool:
        """Whether a typed line is not answered yet."""
        return self.line is not None and self.answered < self.number

    def say(self, text: str) -> None:
        """Type a command."""
        self.number += 1
        if self.send({"do": text, "id": self.number, "asks": self.asks, "waits": True}):
            self.story.words.said(text, (self, self.number), self.may)

    def answer(self, text: str) -> None:
        """Type an answer, whether or not there is a question."""
        number, question = self.question or (None, "")
        if self.send({"answer": text, "id": number}):
            word = first_word(text)
            if is_word(word, "stop"):
                self.stops += 1
                self.story.words.stop("an answer")
            elif len(text.split()) == 1 and (is_word(word, "disable") or is_word(word, "abort")):
                self.withdrawn.append((self, f"{text} {self.number}"))
                self.story.words.said(text, self.withdrawn[-1], self.may)
            elif text.lower().startswith("y"):
                self.story.words.agreed(question)

    def throw(self, data: bytes) -> None:
        """Send random bytes; at the controller's own terminal they may count as keys."""
        self.send_bytes(data)
        if self.at_controller and b'"keys"' in data:
            self.story.words.pressed(json.loads(data)["keys"])

    def press(self, keys: str) -> None:
        """Press keys at the controller's own terminal, whether or not it is open."""
        if self.send({"keys": keys}):
            self.story.words.pressed(keys)

    def interrupt(self) -> None:
        """Control-C."""
        if self.send({"interrupt": True}):
            self.interrupts += 1
            self.story.words.interrupted()

    def _settled(self, stopped: str | None) -> None:
        self.interrupts -= 1
        self.story.words.settled(stopped)

    def send(self, message: dict[str, Any]) -> bool:
        """Send one message; False where no daemon is connected."""
        return self.send_bytes(json.dumps(message).encode() + b"\n")

    def send_bytes(self, data: bytes) -> bool:
        """Any bytes."""
        if self.line is None:
            return False
        try:
            self.line.send(data)
        except OSError:
            self.close()
            return False
        return True

    def hear(self) -> None:
        """Read the daemon's messages."""
        while self.line is not None:
            try:
                data = self.line.recv(1 << 16)
            except BlockingIOError:
                break
            except OSError:
                data = b""
            if not data:
                self.close()
                return
            self.heard += data
        *lines, self.heard = self.heard.split(b"\n")
        for line in lines:
            self._take(json.loads(line))

    def _take(self, message: dict[str, Any]) -> None:
        if "ask" in message:
            self.question = message["id"], message["ask"]
        elif "unasked" in message:
            self.question = None
        elif "terminal" in message:
            self.at_controller = bool(message["terminal"])
        elif "fetch" in message:
            self.send({"no_file": "there is none"})
        elif "stopped" in message:
            self.story.told(message["stopped"], AT_REST)
            if message["stopped"] == "Nothing moves.":
                self._settled(None)
            elif self.withdrawn:  # one that was typed as an answer
                self.story.words.answered(self.withdrawn.pop(0), message["stopped"], 0)
            elif self.stops:  # and so was this
                self.stops -= 1
            else:
                self._settled(message["stopped"])
        elif "done" in message:
            done = message["done"]
            self.story.told(done["text"], AT_REST if done["status"] == 0 else ())
            if "id" in message:  # what is no message has none, and says nothing of a line typed before it
                self.answered = max(self.answered, message["id"])
                self.story.words.answered((self, message["id"]), done["text"], done["status"])
        elif "notice" in message:
            self.story.told(message["notice"])
            if message["notice"].startswith(("FAULT", "STOPPED")):
                self.story.words.stop(message["notice"])


@dataclass(eq=False)
class SerialOperator:
    """An operator at the serial terminal; the daemon has its other end."""

    story: Story
    may: str
    question = None

    def __post_init__(self) -> None:
        self._master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.device = os.ttyname(self._slave)

    def say(self, text: str) -> None:
        """Type a line, possibly with more commands typed ahead in it."""
        for line in text.splitlines():
            self.story.words.said(line, (self, line), self.may)
        self.send_bytes(text.encode("latin-1", "replace") + b"\r")

    answer = say

    def interrupt(self) -> None:
        """Control-C. A terminal does not show whether there was anything to stop, so only the answer's text counts."""
        self.send_bytes(b"\x03")

    def send_bytes(self, data: bytes) -> bool:
        """Type, and wait until the bytes have arrived: a terminal takes its own time."""
        while True:
            try:
                os.write(self._master, data)
                break
            except BlockingIOError:
                self.hear()
        if self.story.alive:
            select.select([self._slave], [], [], 0.2)
        return True

    def throw(self, data: bytes) -> None:
        """Send random bytes."""
        self.send_bytes(data)

    def open(self) -> None:
        """Do nothing: a serial terminal is always connected."""

    def hear(self) -> None:
        """Take from the line what is shown. Nothing is concluded from it, because a terminal shows it when it likes:
        what is typed here counts as being done until the next stop."""
        while True:
            try:
                os.read(self._master, 1 << 16)
            except BlockingIOError:
                return

    def close(self) -> None:
        """Take the terminal away."""
        os.close(self._master)
        os.close(self._slave)


class TakesTime(ComputesHere):
    """A worker whose calculations take simulated time, in which anything may happen, but no real time."""

    async def __call__(self, function: Callable[..., Any], /, *args: Any) -> Any:
        """See Compute."""
        result = await super().__call__(function, *args)
        await asyncio.sleep(COMPUTED_S)
        return result


class AtOnce:
    """The run log's writer without a thread; it writes at once."""

    waiting = 0

    def __init__(self, name: str) -> None:
        pass

    def do(self, job: Callable[[], None]) -> None:
        """Do it."""
        job()

    def end(self, timeout_s: float) -> bool:
        """Nothing is left to do."""
        return True


class NoSyncer:
    """A syncer without a thread: whatever is written counts as being on the disk."""

    def __init__(self, every_s: float, done: object) -> None:
        pass

    def take(self, file: object) -> None:
        """It is there."""

    def hurry(self) -> None:
        """It is there."""

    def wait_until_written(self, timeout_s: float) -> bool:
        """It is."""
        return True

    def stop(self) -> None:
        """Nothing is left to do."""


class BareTable(SimulatedOperator):
    """A table without parts when the daemon starts."""

    def scatter(self, labels: Sequence[str] = (), steady: bool = False) -> None:
        """Scatter the named parts."""
        super().scatter(labels, steady)


@contextmanager
def failing_writes(fails: Callable[[int], bool], code: int = errno.ENOSPC) -> Iterator[list[Path]]:
    """Of all writes to files, syncs and renames, counted from 0, those fail of which `fails` says so; half of a line is
    written first. Gives the files whose lines were lost."""
    number, lost = itertools.count(), list[Path]()
    write, pwrite, fsync, replace = os.write, os.pwrite, os.fsync, os.replace

    def refused(handle: int) -> bool:
        return stat.S_ISREG(os.fstat(handle).st_mode) and fails(next(number))

    def failing_write(handle: int, data: bytes) -> int:
        if not refused(handle):
            return write(handle, data)
        lost.append(Path(os.readlink(f"/proc/self/fd/{handle}")))
        return write(handle, data[: len(data) // 2])

    def failing(act: Callable[..., Any], handle: int, *rest: Any) -> Any:
        if refused(handle):
            raise OSError(code, os.strerror(code))
        return act(handle, *rest)

    def failing_replace(source: str, target: str) -> None:
        if fails(next(number)):
            raise OSError(code, os.strerror(code))
        replace(source, target)

    with ExitStack() as patched:
        for name, instead in (("write", failing_write), ("pwrite", partial(failing, pwrite)),
                              ("fsync", partial(failing, fsync)), ("replace", failing_replace)):  # fmt: skip
            patched.enter_context(patch.object(os, name, instead))
        yield lost


_READ: dict[tuple[str, bytes], Any] = {}


def read_once(load: Callable[[Path], Any]) -> Callable[[Path], Any]:
    """A reader that remembers what the same bytes held: the daemon is started every few steps, on files that seldom
    change. What it cannot read is read each time."""

    def reading(path: Path) -> Any:
        key = load.__qualname__, path.read_bytes()
        if key not in _READ:
            _READ[key] = load(path)
        return _READ[key]

    return reading


class Story:
    """A daemon, its cell and its operators, from the first to the last event of a story."""

    def __init__(self, may: str = "all", holds: bool = False, parts: bool = False, prompt_at_end: bool = False) -> None:
        """may: the terminal's rights; holds: the gripper holds a part at first; parts: some are on the table."""
        base = "/dev/shm" if os.path.isdir("/dev/shm") else None
        self.folder = Path(tempfile.mkdtemp(prefix="facetd-", dir=base))
        self.loop, self.set_by_s, self._parts = SimulatedLoop(), 0.0, parts
        self.others = OthersHeard(self.loop.time, self._may_move)
        self._patches: list[Any] = [
            patch.object(time, "monotonic", self.loop.time),
            patch.object(time, "time", lambda: 1.8e9 + self.set_by_s + self.loop.time()),
            patch.object(build_room, "build", self._build),
            patch.object(journal, "write", lambda *_, **__: None),
            patch.object(moving, "POLL_S", SLICE_S),
            patch.object(runlog, "_Worker", AtOnce),
            patch.object(service, "Worker", TakesTime),
            patch.object(runlog, "Syncer", NoSyncer),
            *self.others.patches(),
            *(patch.object(service, name, read_once(getattr(service, name))) for name in READERS),
            patch.object(sections, "load_calibration", read_once(load_calibration)),
        ]
        for each in self._patches:
            each.start()
        asyncio.set_event_loop(self.loop)
        self.terminal = SerialOperator(self, may)
        self.sockets = [SocketOperator(self, asks) for asks in (True, True, False)]
        self.frontends: list[SocketOperator | SerialOperator] = [*self.sockets, self.terminal]
        _write_files(self.folder, self.terminal)
        manners = Manners(prompt_after_move="end" if prompt_at_end else "start", arm_power_after_s=2.0)
        self.cell = SimulatedCell(self.folder / "simcell.yaml", 7, manners=manners, loop=self.loop)
        assert isinstance(self.cell.server, MemoryLine)
        self.line = self.cell.server
        self.cell.motion_monitor.limit_speed(0.0, FASTEST)
        self.words, self._stamp_s = Words(self), 0.0
        self._seen, self._brought, self._counted = 0, 0, dict[int, CycleEnd]()
        self._deaf, self._clear_s = False, 0.0
        self._live: asyncio.Task[int] | None = None
        self.texts: list[str] = []
        self.start()
        if holds:
            self.close_by_pendant()
            self.sockets[0].say("holding yes")
            self.wait(0.1)

    @property
    def now_s(self) -> float:
        """The cell's time, s."""
        return self.loop.time()

    def cell_clock(self) -> float:
        """The daemon's monotonic clock for motion and looks; nobody can set it, unlike the wall clock."""
        return self.loop.time()

    def stamp_s(self) -> float:
        """The time stamp of text typed now: after everything that was typed before."""
        self._stamp_s = max(self.now_s, self._stamp_s) + MOMENT_S
        return self._stamp_s

    @property
    def alive(self) -> bool:
        """Whether a daemon runs."""
        return self._live is not None and not self._live.done()

    @property
    def context(self) -> CommandContext:
        """What the commands of the daemon that runs, or ran last, work on. For a test that looks at, or waits for, one
        moment in it; raises AssertionError before it has its devices."""
        context = self._service.context
        assert context is not None
        return context

    @property
    def at_work(self) -> bool:
        """Whether the arm would execute a move. No violation is derived from this."""
        context, machine = self._service.context, self.cell.controller.machine
        if not self.alive or context is None or self.cell.controller.question is not None:
            return False
        state = context.cycle.status()
        held = any(state[name] for name in ("fault", "stopping", "paused", "step", "dry", "pending"))
        return bool(state["enabled"]) and not held and machine.arm_power and machine.calibrated

    def start(self) -> None:
        """Start the daemon as systemd would: again, if a device was not available."""
        if self.alive:
            return
        self.others.spoilt()
        for _ in range(STARTS):
            self._service = Service(self.folder / "facetd.yaml", simulated=True)
            self._live = self.loop.create_task(self._service.run())
            while self.alive and self.sockets[0].line is None:
                self._run(0.5)
                self.sockets[0].open()
            if self.alive:
                break
            assert self._live.result() == NO_DEVICE
            self._run(5.0)
        for frontend in self.sockets[1:]:
            frontend.open()
        if not self._parts:
            self.cell.clear()

    def wait(self, seconds: float) -> None:
        """Let simulated time pass."""
        until_s = self.now_s + seconds
        while True:
            left_s = max(0.0, until_s - self.now_s)
            self._run(min(SLICE_S, left_s) if self._may_be_deaf else left_s)
            self.terminal.hear()
            self._see_the_line()
            if self.now_s >= until_s - 1e-6:
                return

    def wait_for(self, frontend: SocketOperator, seconds: float) -> None:
        """Let time pass until a frontend's lines are answered, or it asks a question, or a time limit."""
        until_s = self.now_s + seconds
        while frontend.waits and frontend.question is None and self.now_s < until_s:
            self.wait(SLICE_S)

    def _may_move(self) -> bool:
        context = self._service.context
        if context is None:
            return False
        permission = context.cycle.supervisor.permission
        return permission.granted and permission.fault is None

    def hang(self, seconds: float) -> None:
        """Stall the computer for a while."""
        self.harm()
        self.loop.sleep(seconds)
        if seconds > HELD_STILL_S:
            self.words.held_still()
        self.wait(0.0)

    def may_move(self, allowed: bool, wanted: bool) -> None:
        """Report to the motion monitor what the operators permit; wanted: somebody requested motion now."""
        if allowed != self._allowed or (allowed and wanted):
            self.cell.motion_monitor.motion_permitted(self.stamp_s(), allowed)
        self._allowed = allowed

    _allowed = False

    def told(self, text: str, at_rest: tuple[str, ...] = ()) -> None:
        """Somebody was told something; at_rest: with which words it would say that the arm is at rest."""
        if "The arm is disabled:" in text:
            self.words.disabled()
        if text.startswith(at_rest):
            self.cell.motion_monitor.rest_reported(self.now_s, text)
        self.texts = [*self.texts[-20:], text]
        self.others.told(text)

    def harm(self, act: Callable[[], object] = lambda: None) -> None:
        """Disturb line or controller: for a while a stop may not get through."""
        if not self._deaf:
            self.cell.motion_monitor.line_works(self.now_s, False)
        self._deaf, self._clear_s = True, self.now_s
        self.others.spoilt()
        act()

    def mishap(self, what: Mishap) -> None:
        """Disturb the controller."""
        with self.cell.server.controller() as controller:
            self.harm(lambda: controller.mishap(what))

    def type_beside(self, text: str) -> None:
        """Another terminal on the arm's line types a line; what it makes of what stood there half typed is its own."""
        with self.cell.server.controller() as controller:
            clean = not self._may_be_deaf and controller.question is None and self.alive
            self.harm(lambda: controller.receive(f"{text}\r".encode(), controller.now_s, by_others=True))
            self.others.typed(text, clean)

    def by_pendant(self, joint: int, degrees: float, at_rest: bool = False) -> None:
        """A person at the teach pendant turns a joint from 0 to 5, now or, at_rest, as the motion under way ends."""
        with self.cell.server.controller() as controller:
            if at_rest and not controller.machine.at_rest():
                self.loop.call_at(controller.arm.rests_s + MOMENT_S, self.by_pendant, joint, degrees)
                return
            joints = controller.machine.joints()
            joints[joint] += np.radians(degrees)
            controller.machine.drive_by_pendant(joints)

    def close_by_pendant(self) -> None:
        """A person holds a cube into the gripper where there is room for it, and closes it on that by the teach
        pendant."""
        tool = self.cell.world_from_tool()
        held_out = tool @ rigid(turn([1, 0, 0], np.pi), [0.0, 0.0, 0.0])
        corners = frames.apply(held_out, self.cell.world.shape("cube").hull.vertices)
        in_post = (within_mm(corners, POST["low_mm"], POST["high_mm"]) > 0.0).all(axis=1).any()
        if self.cell.world.held is None and not in_post:
            self.cell.world.put("cube", held_out)
            self.cell.world.close_hand(tool)
            self.cell.controller.machine.hand_closed = True

    def exchange_arm(self, joint: int, degrees: float) -> None:
        """Connect the adapter to another controller, which has just started and whose arm is elsewhere."""
        self.harm(self.line.unplug)
        with self.cell.server.controller() as controller:
            controller.mishap(Mishap.POWER_CYCLED)
        self.wait(1.0)
        self.words.disabled()
        self.by_pendant(joint, degrees)

    def move_part(self, what: str) -> None:
        """Somebody moves a part, or the one that is held slips out of the gripper."""
        world = self.cell.world
        if what == "slips":
            if world.held:
                fallen = world.open_hand(self.cell.world_from_tool())
                self._brought += fallen is not None and fallen[2] is PartPlace.BIN
                world.gap_mm = 0.0
            return
        lying = [part for part in world.parts if part.where is PartPlace.TABLE]
        if lying and what == "is pushed":
            world.nudge(lying[0].name, 12.0, -7.0, 0.3)
        elif lying:
            world.remove(lying[0].name)

    def fill_disk(self, seconds: float, every: int = 1) -> None:
        """Let one in so many writes to files fail."""
        with failing_writes(lambda number: number % every == 0):
            self.wait(seconds)

    def replace_model(self, empty: bool) -> None:
        """Another model is taken into use, which knows nothing, or the first one again."""
        context = self._service.context
        if self.alive and context is not None:
            taught = models.load(self.folder / "model.npz")
            context.trainer.model = empty_model(taught.library) if empty else taught
            context.use_model("accept", None)

    def repair(self) -> None:
        """Repair line, power and controller."""
        faults = self.cell.controller.faults
        faults.line.clear()
        faults.in_move.clear()
        faults.refusals.clear()
        faults.noise_rate = faults.split_prompt_s = 0.0
        faults.mute_answers = faults.late_answers = faults.repeated_places = 0
        for camera in ("left", "right"):
            self.cell.camera.set_fault(camera, None)
        self.line.unplugged = False
        with self.cell.server.controller() as controller:
            controller.machine.alive = True
            controller.machine.arm_power = True

    def write_config(self, **changes: Any) -> None:
        """Write another configuration; the daemon has not read it yet."""
        _write_config(self.folder, self.terminal, **changes)

    def write_places(self, **at_mm: list[float]) -> None:
        """Other places for the cube, by name, as people write them; nobody has read them yet."""
        places = {name: {"part": "cube", "side_down": 1, "point_mm": point} for name, point in at_mm.items()}
        (self.folder / "state").mkdir(exist_ok=True)
        (self.folder / "state" / "places.yaml").write_text(yaml.safe_dump({"version": 1, "places": places}))

    def hang_up(self) -> None:
        """Send SIGHUP: the daemon reads the configuration."""
        if self.alive:
            os.kill(os.getpid(), signal.SIGHUP)

    def terminate(self) -> int:
        """Send SIGTERM and wait for the daemon's end; returns its exit status."""
        if not self.alive:
            return 0
        assert self._live is not None
        os.kill(os.getpid(), signal.SIGTERM)
        self.cell.motion_monitor.stop_received(self.stamp_s(), "SIGTERM")
        self.words.over()
        began_s = self.now_s
        while self.alive and self.now_s < began_s + 3 * END_S:
            self.wait(SLICE_S)
        assert not self.alive, "it does not end"
        assert self.now_s - began_s <= END_S, f"it took {self.now_s - began_s:.1f} s to end"
        return self._live.result()

    def violations(self) -> tuple[Violation, ...]:
        """Forbidden motions of the arm, and parts that count as picked but are not in the bin."""
        return (*self.cell.violations(), *self._picked_and_not_brought(), *self.others.violations())

    def _picked_and_not_brought(self) -> tuple[Violation, ...]:
        """A line if more picks ended with `picked` than parts fell into the bin."""
        history = self.cell.controller.machine.history
        first, events = history.since(self._seen)
        self._seen = first + len(events)
        self._brought += sum(isinstance(event, DropRecord) and event.over_bin for event in events)
        context = self._service.context
        if context is not None:
            ends = context.cycle.ends
            self._counted |= {id(end): end for end in ends if end.outcome is Outcome.PICKED}
        if len(self._counted) <= self._brought:
            return ()
        text = f"{len(self._counted)} picks ended with a part picked, and {self._brought} parts fell into the bin"
        return (Violation("not in the bin", self.now_s, "pick", text),)

    def close(self) -> tuple[Violation, ...]:
        """End the story; returns all violations."""
        try:
            self.repair()
            status = self.terminate()
            for task in asyncio.all_tasks(self.loop):
                task.cancel()
            self._run(0.0)
            assert status in (0, 2), f"it ended with status {status}"
            return self.violations()
        finally:
            for frontend in self.frontends:
                frontend.close()
            for each in self._patches:
                each.stop()
            self.loop.close()
            shutil.rmtree(self.folder, ignore_errors=True)

    def _run(self, seconds: float) -> None:
        self.loop.call_later(seconds, self.loop.stop)
        self.loop.run_forever()

    @property
    def _may_be_deaf(self) -> bool:
        return self._deaf or bool(self.cell.controller.faults.in_move)

    def _see_the_line(self) -> None:
        faults, machine = self.cell.controller.faults, self.cell.controller.machine
        spoilt = faults.line or faults.noise_rate or faults.split_prompt_s or faults.repeated_places
        harmed = bool(spoilt or faults.mute_answers or faults.late_answers)
        if harmed or self.line.unplugged or not machine.alive:
            self.harm()
        elif self._deaf and self.now_s > self._clear_s + HARMED_S:
            self._deaf = False
            self.cell.motion_monitor.line_works(self.now_s, True)

    def _build(self, config: Config, on_wire: Any, record: Any) -> Hardware:
        """Build the simulated hardware as daemon/cell/build.py does, with another line and clock."""
        geometry, manners = arm_geometry(config), dialect(config)
        link = Link(
            "memory",
            manners,
            self.loop.time,
            on_wire,
            self.line.open,
        )
        kind = SimulatedOperator if self._parts else BareTable
        hand = kind(self.cell)
        cameras = ThreadedCameras(self.cell.camera, self.loop.time)
        robot = Val2Arm(link, geometry, Beliefs(self.loop.time, record))
        return Hardware(
            "simulated",
            robot,
            cameras,
            self.cell_clock,
            "memory",
            7,
            hand,
        )


def _write_config(folder: Path, terminal: SerialOperator, **pick: Any) -> None:
    keep_out = [{"name": "post", "low_mm": [v - SPARE_MM for v in POST["low_mm"]],
                 "high_mm": [v + SPARE_MM for v in POST["high_mm"]]}]  # fmt: skip
    room = _shipped_room()
    limits = {"max_speed_pct": FASTEST, "keep_out": keep_out, **room, **pick.pop("limits", {})}
    values = {
        "version": 1,
        "folders": {"state": "state", "runtime": "."},
        "files": {"model": "model.npz"},
        "simulated": {"truth": "simcell.yaml", "seed": 7},
        "pick": {"travel_pct": FASTEST, "near_pct": SLOWEST, **pick, "limits": limits},
        "console": {"tty": {"device": terminal.device, "may": terminal.may}},
        "health": {"camera_silence_s": 600},
        "log": {"keep_free_mb": 0, "sync_s": 60},
    }
    (folder / "facetd.yaml").write_bytes(yaml.dump(values, Dumper=yaml.CSafeDumper, encoding="utf-8"))


@cache
def _shipped_room() -> dict[str, list[float]]:
    """Walls and ceiling of the cell of etc/, from its configuration."""
    limits = yaml.safe_load((ETC / "facetd.yaml").read_text(encoding="utf-8"))["pick"]["limits"]
    return {name: limits[name] for name in ("room_low_mm", "room_high_mm")}


def _write_files(folder: Path, terminal: SerialOperator) -> None:
    for name, content in cell_files().items():
        (folder / name).write_bytes(content)
    _write_config(folder, terminal)


@cache
def cell_files() -> dict[str, bytes]:
    """The cell of etc/ with smaller images, a post in it, and the parts of the demo taught."""
    truth = yaml.safe_load((ETC / "simcell.yaml").read_text(encoding="utf-8"))
    believed = yaml.safe_load((ETC / "calibration.yaml").read_text(encoding="utf-8"))
    for cameras in (truth, believed):
        cameras["image_size"] = [round(PIXELS * n) for n in cameras["image_size"]]
        for camera in (cameras["left"], cameras["right"]):
            matrix = PIXELS * np.array(camera["camera_matrix"])
            matrix[:2, 2] += (PIXELS - 1) / 2
            matrix[2] = 0.0, 0.0, 1.0
            camera["camera_matrix"] = matrix.tolist()
    truth["safety"]["keep_out"] = [POST]
    files = {name: (ETC / name).read_bytes() for name in ("facets.yaml", "parts.yaml")}
    files["simcell.yaml"] = yaml.safe_dump(truth).encode()
    files["calibration.yaml"] = yaml.safe_dump(believed).encode()
    with tempfile.TemporaryDirectory() as place:
        for name, content in files.items():
            (Path(place) / name).write_bytes(content)
        files["model.npz"] = models.to_bytes(_taught(Path(place)))
    return files


def _taught(folder: Path) -> Any:
    loop = SimulatedLoop()
    cell = SimulatedCell(folder / "simcell.yaml", 7, loop=loop)
    cell.camera.open()
    rig = load_calibration(folder / "calibration.yaml").rig
    model = empty_model(load_facets(folder / "facets.yaml"))
    for label, view, facets in VIEWS:
        if label not in TAUGHT:
            continue
        cell.place_for_teaching(label, view)
        for _ in range(TRIES):
            loop.sleep(0.1)
            pair = cell.camera.grab(loop.time(), 1.0)
            groups = ModelRecogniser(model, rig).see(pair.left.pixels, pair.right.pixels).view.groups
            group = max(groups, key=lambda g: len(g.facets), default=None)
            if group is not None and len(group.facets) == len(facets):
                model = learn_view(model, group, label)
                break
    cell.stop()
    loop.close()
    return model
