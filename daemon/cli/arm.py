"""Commands `facetctl arm identify PORT` and `facetctl arm replay TRANSCRIPT`: first contact with a controller."""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import shutil
import signal
import sys
from functools import partial
from pathlib import Path
from typing import Any

import yaml

from daemon.calibration.arm_from_readings import NoArmError
from daemon.cell.identified_arm import arm_file, arm_of, page
from daemon.cell.identify import (
    BAUDS,
    EXPECTED,
    Consult,
    ContactFindings,
    Person,
    identify,
    read_transcript,
    replay,
    serial_port,
)
from daemon.console.phrases import is_no, is_yes
from daemon.console.stop_words import ends_in_stop, means_stop
from daemon.console.text_layout import fold
from daemon.errors import DONE, NOT_DONE, NOT_UNDERSTOOD
from daemon.frontends.keyboard import unread_input
from daemon.quantities import decimal, whole
from daemon.store.files import write_atomically
from daemon.store.outside import FileError, read_file

TRANSCRIPT = "transcript.jsonl"
LONGEST_MM = 2000.0
LARGEST_TRANSCRIPT = 50_000_000


def register(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add `arm` to facetctl."""
    arm = subparsers.add_parser("arm", help="first contact with an arm's controller: identify, replay")
    jobs = arm.add_subparsers(dest="job", required=True, metavar="JOB")
    meet = jobs.add_parser("identify", help="identify a controller's dialect and its arm; writes arm.yaml")
    meet.add_argument("port", metavar="PORT", help="the serial port, best by its name under /dev/serial/by-id")
    meet.add_argument("--baud", type=whole, help="the line's speed (default: the usual ones, 9600 first)")
    meet.add_argument("--out", type=Path, default=Path(), metavar="DIR", help="where the files go (default: here)")
    meet.add_argument("--lengths", type=_lengths, metavar="A2,A3,D3,D4",
                      help="link lengths of an arm unknown to facetd, mm, from its maker's drawing")  # fmt: skip
    meet.add_argument("--pendant", action="store_true",
                      help="more WHEREs, at positions to which you bring the arm: they give exact lengths")  # fmt: skip
    meet.set_defaults(run=_identify)
    replay = jobs.add_parser("replay", help="compare today's driver with a recorded first contact")
    replay.add_argument("transcript", type=Path, metavar="TRANSCRIPT", help="transcript.jsonl of a first contact")
    replay.set_defaults(run=_replay)


def _lengths(text: str) -> tuple[float, float, float, float]:
    with contextlib.suppress(ValueError):
        a2, a3, d3, d4 = (decimal(one) for one in text.split(","))
        if min(a2, d4) > 0.0 and min(a3, d3) >= 0.0 and all(one < LONGEST_MM for one in (a2, a3, d3, d4)):
            return a2, a3, d3, d4
    raise argparse.ArgumentTypeError(f"{text}: expected four lengths in mm, as in 650,0,190,600")


def _identify(args: argparse.Namespace) -> int:
    transcript = args.out / TRANSCRIPT
    try:
        args.out.mkdir(parents=True, exist_ok=True)
        with transcript.open("x", encoding="utf-8") as file:
            found = asyncio.run(_identify_controller(args.port, args.baud, args.pendant, file))
    except FileExistsError:
        return _failed(f"{transcript} exists already; name another folder with --out", NOT_UNDERSTOOD)
    except OSError as error:
        return _failed(f"{args.out}: {error.strerror}", NOT_UNDERSTOOD)
    except EXPECTED as error:
        return _failed(f"{error}\nThe transcript is {transcript}", NOT_DONE)
    return _write_files(found, args.out, args.lengths)


def _write_files(found: ContactFindings, folder: Path, typed_mm: tuple[float, float, float, float] | None) -> int:
    """Write arm.yaml and arm.txt; without readings, or where no arm fits them, with the dialect only."""
    arm = None
    try:
        arm = arm_of(found, typed_mm) if len(found.readings) > 1 else None
    except NoArmError as error:
        print(f"facetctl: {error}", file=sys.stderr)
    text = yaml.safe_dump(arm_file(found, arm), sort_keys=False, default_flow_style=None, width=110)
    write_atomically(folder / "arm.yaml", text.encode())
    text = page(found, arm)
    (folder / "arm.txt").write_text(text, encoding="utf-8")
    _tell(text)
    _tell(
        f"{folder / 'arm.txt'}: this page. {folder / 'arm.yaml'}: name it in facetd.yaml as arm.file. "
        f"{folder / TRANSCRIPT}: every byte."
    )
    return DONE if arm is not None else NOT_DONE


async def _identify_controller(port: str, baud: int | None, pendant: bool, file: Any) -> ContactFindings:
    loop, wants_stop = asyncio.get_running_loop(), asyncio.Event()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        loop.add_signal_handler(number, wants_stop.set)

    def write(record: dict[str, Any]) -> None:
        print(json.dumps(record), file=file, flush=True)

    person = Person(_tell, partial(ask_person, wants_stop=wants_stop), wants_stop)
    _watch_for_stop(wants_stop)
    print("Control-C or `stop` stops the arm at any moment.", flush=True)
    bauds = BAUDS if baud is None else (baud,)
    return await identify(port, serial_port, person, write, bauds, pendant)


def _tell(text: str, end: str = "\n") -> None:
    """Print a text, wrapped to the terminal's width."""
    lines = fold(text, shutil.get_terminal_size().columns - 1) if sys.stdout.isatty() else [text]
    print("\n".join(lines), end=end, flush=True)


async def ask_person(consult: Consult, wants_stop: asyncio.Event) -> str:
    """The person's answer, `yes` or `no` where the question wants one; empty at the end of input and after a stop."""
    question = consult.text
    while True:
        *before, begun = unread_input().decode("utf-8", "replace").split("\n")
        _tell(question, " ")
        line = "" if any(map(means_stop, before)) else await _typed(wants_stop)
        if any(map(means_stop, before)) or ends_in_stop([begun], line):
            wants_stop.set()
        word = line.strip()
        if wants_stop.is_set():
            return ""
        if consult.about == "power-up" or not line:
            return word
        if is_yes(word) or is_no(word):
            return "yes" if is_yes(word) else "no"
        question = f"`{word}` is not an answer. Answer yes or no."


async def _typed(wants_stop: asyncio.Event) -> str:
    """Wait for a line typed at this terminal; empty at its end."""
    loop = asyncio.get_running_loop()
    typed: asyncio.Future[str] = loop.create_future()
    loop.add_reader(sys.stdin.fileno(), _read_line, wants_stop, typed)
    try:
        return await typed
    finally:
        with contextlib.suppress(ValueError):
            loop.remove_reader(sys.stdin.fileno())
            _watch_for_stop(wants_stop)


def _watch_for_stop(wants_stop: asyncio.Event) -> None:
    """Read lines between questions: one may be a stop."""
    if sys.stdin.isatty():
        asyncio.get_running_loop().add_reader(sys.stdin.fileno(), _read_line, wants_stop, None)


def _read_line(wants_stop: asyncio.Event, typed: asyncio.Future[str] | None) -> None:
    line = ""
    with contextlib.suppress(OSError):  # the terminal was closed
        line = sys.stdin.readline()
    if means_stop(line):
        wants_stop.set()
    if typed is not None and not typed.done():
        typed.set_result(line)
    elif not line:
        asyncio.get_running_loop().remove_reader(sys.stdin.fileno())


def _replay(args: argparse.Namespace) -> int:
    try:
        text = read_file(args.transcript, LARGEST_TRANSCRIPT).decode()
        complete, _, torn = text.rpartition("\n")
        differences = list(replay(read_transcript(complete.splitlines())))
    except FileError as error:
        return _failed(str(error), NOT_UNDERSTOOD)
    except ValueError as error:
        return _failed(f"{args.transcript}: {error}", NOT_UNDERSTOOD)
    if torn:
        print("the last line of the transcript is incomplete and was left out")
    print("\n".join(differences) or "today's driver sends the same, byte for byte")
    return NOT_DONE if differences else DONE


def _failed(text: str, status: int) -> int:
    print(f"facetctl: {text}", file=sys.stderr)
    return status
