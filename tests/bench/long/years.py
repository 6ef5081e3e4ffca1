"""Years of a daemon: does anything grow, is anything lost but what is told?

usage: python -m tests.bench.long.years [--folder DIR] [PART=COUNT ...]

year     (365) days of the whole daemon, its watch, log, quota and frontends on simulated time, with four picks each, a
         restart every week, and a clock that is set a day back, a year forward and back again, by a leap second, by
         summer time and past 2038-01-19, where 32 bits of seconds end
starts   (100,000) starts and stops of the whole daemon
clients  (100,000) connections to its socket: questions, half lines, silence, listeners, stops, all that is too long
cameras  (10,000) openings of a stereo camera whose devices fail in every way they can

Arm, cameras and the video devices are made up; the rest is the daemon's own. With --folder it goes on where it was
ended. Prints what is held (memory, objects, handles, threads, tasks, files) now and then; exit 1 where it grows, or
something is lost and was not told.
"""

from __future__ import annotations

import argparse
import asyncio
import errno
import itertools
import json
import os
import random
import shutil
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Any
from unittest.mock import patch

from daemon.maintenance import watchdog
from daemon.review.week import write_week
from daemon.store.files import being_written
from daemon.store.outside import FileError
from daemon.store.runs import check_wire, list_runs, read_run
from drivers.camera import v4l2
from drivers.camera.pair import CameraError
from drivers.camera.settings import CameraSettings
from drivers.camera.v4l2_stereo import V4L2StereoCamera
from tests.fakes.light_daemon import CONFIG, Held, LightDaemon, light_daemon
from tests.fakes.pretend_video import PretendDevice, PretendSystem, whole_frames

BEGIN_S = datetime(2037, 6, 1, tzinfo=UTC).timestamp()
DAY_S, HOUR_S, WEEK = 86_400.0, 3600.0, 7
TICK_S = 20.0
"""Of the watch, which looks every half second otherwise."""
SHIFT = (7, 10, 13, 18)
"""The hours in which there is something to pick."""
CLOCK = {30: -DAY_S, 60: -1.0, 100: 365 * DAY_S, 101: -365 * DAY_S, 150: 5.0, 200: -HOUR_S}
"""On which day the clock on the wall is set, and by how much; -1: a leap second."""
CELL_TZ = "Europe/Berlin"
FEW_RUNS = CONFIG.replace("quota_mb: 20", "quota_mb: 1")
EVERY = {"year": WEEK, "starts": 1000, "clients": 1000, "cameras": 500}
"""After how many of each it is looked what is held."""
MOST = {"resident_mib": 8.0, "objects": 400, "handles": 0, "threads": 0, "tasks": 0}
"""What the second half may hold more than the first, by the least of each: memory in use is never quite the same."""
MOST_MB = 25.0
"""On the disk: the quota, and the run that is being written."""

Progress = dict[str, Any]


class LostError(AssertionError):
    """Something is gone that nobody was told of, or grows."""


def year(folder: Path, done: int, count: int, progress: Progress) -> Iterator[tuple[int, Held]]:
    """Days of one daemon; gives how many are over, and what it held at the end of each."""
    os.environ["TZ"] = CELL_TZ
    time.tzset()
    with (
        patch.object(watchdog, "TICK_S", TICK_S),
        light_daemon(folder, BEGIN_S + done * DAY_S + progress.get("set_by_s", 0.0)) as daemon,
    ):
        cut_off, made = _where_it_was_ended(daemon, progress)
        daemon.run(daemon.start())
        for day in range(done, count):
            daemon.run(_day(daemon, day))
            if day % WEEK == WEEK - 1:
                daemon.run(_restart(daemon))
            jumped = sum(text.startswith("the clock was set") for _, text in daemon.told)
            if jumped != (abs(CLOCK.get(day, 0.0)) > watchdog.CLOCK_JUMP_S):
                raise LostError(f"day {day}: {jumped} jumps of the clock were told")
            _keep_books(daemon, made, cut_off)
            progress["set_by_s"] = progress.get("set_by_s", 0.0) + CLOCK.get(day, 0.0)
            yield day + 1, daemon.held()
        daemon.run(daemon.stop())
        write_week(daemon.runs, list_runs(daemon.runs)[-1], folder / "week.html")
        picked = sum(r.get("outcome") == "picked" for f in list_runs(daemon.runs) for r in read_run(f).records)
        if not picked:
            raise LostError("nothing was picked")


async def _day(daemon: LightDaemon, day: int) -> None:
    began_s = daemon.loop.time()
    for hour in range(24):
        if hour == 12:
            daemon.set_by_s += CLOCK.get(day, 0.0)
        if hour in SHIFT:
            daemon.world.put("cube", 520, 0, 0.4)
            for text in ("resume", "holding no", "enable", "auto on 1", "auto wait", "status"):
                await daemon.do(text)
        await asyncio.sleep(max(0.0, began_s + (hour + 1) * HOUR_S - daemon.loop.time()))
    daemon.world.wire.clear()  # the made-up arm remembers all it did: 14 kB a day


async def _restart(daemon: LightDaemon) -> None:
    assert (await daemon.do("reload"))["status"] == 0
    assert await daemon.stop() == 0
    await daemon.start()


def _where_it_was_ended(daemon: LightDaemon, progress: Progress) -> tuple[frozenset[str], list[str]]:
    """The runs that are there, and those of them in the books: what went after these were kept was told to a process
    that is no more."""
    there = frozenset(folder.name for folder in list_runs(daemon.runs))
    progress["made"] = [name for name in progress.get("made", []) if name in there]
    return there, progress["made"]


def _keep_books(daemon: LightDaemon, made: list[str], cut_off: frozenset[str] = frozenset()) -> None:
    """Every run that was begun is there, whole, in the order in which they were made, or it was told that it went.
    cut_off: those of before this process, which somebody may have ended in their midst. Raises LostError."""
    told = "\n".join(text for _, text in daemon.told)
    daemon.told.clear()
    there = list_runs(daemon.runs)
    gone = [name for name in made if not (daemon.runs / name).exists()]
    if untold := [name for name in gone if name not in told]:
        raise LostError(f"gone, and not told: {', '.join(untold)}")
    names = [folder.name for folder in there]
    kept = [name for name in made if name not in gone]
    if names[: len(kept)] != kept:
        raise LostError(f"runs are not in the order in which they were made: {names}, {kept}")
    for folder in [f for f in there[max(len(kept) - 1, 0) :] if f.name not in cut_off]:
        run, going = read_run(folder), being_written(folder / "run.jsonl")
        numbers = [record["seq"] for record in run.records]
        problems = [*run.skipped, *check_wire(folder)]
        if problems or numbers != list(range(len(numbers))):
            raise LostError(f"{folder.name}: {problems or 'a line is missing'}")
        if not going and run.records[-1]["kind"] != "run_end":
            raise LostError(f"{folder.name}: has no end")
    made[:] = names


def starts(folder: Path, done: int, count: int, progress: Progress) -> Iterator[tuple[int, Held]]:
    """Starts and stops; gives how many, and what is held in between."""
    with light_daemon(folder, BEGIN_S + done, FEW_RUNS) as daemon:
        cut_off, made = _where_it_was_ended(daemon, progress)
        for number in range(done, count):
            daemon.run(daemon.start())
            daemon.run(daemon.do("status"))
            if daemon.run(daemon.stop()) != 0:
                raise LostError(f"start {number}: {daemon.told[-1:]}")
            if (number + 1) % EVERY["starts"] == 0 or number + 1 == count:
                _keep_books(daemon, made, cut_off)
                yield number + 1, daemon.held()


def clients(folder: Path, done: int, count: int, _: Progress) -> Iterator[tuple[int, Held]]:
    """Connections to the socket of one daemon, each of a kind; gives how many, and what it holds once they are gone."""
    chance = random.Random(done)
    with light_daemon(folder, BEGIN_S, FEW_RUNS) as daemon:
        daemon.run(daemon.start())
        for number in range(done, count):
            daemon.run(_client(daemon.folder / "facetd.sock", chance))
            if (number + 1) % EVERY["clients"] == 0 or number + 1 == count:
                daemon.run(asyncio.sleep(1200.0))
                answer = daemon.run(daemon.do("status"))
                if answer["status"] != 0:
                    raise LostError(f"after {number + 1} connections: {answer['text']}")
                yield number + 1, daemon.held()
        daemon.run(daemon.stop())


ODD = (
    b'{"do": "status"}\n',
    b'{"do": "sta',
    b"",
    b"[" * 60_000 + b"\n",
    b"\xff\xfe\n",
    b"x" * 70_000,
    b'{"notices": true}\n',
    b'{"do": "auto wait"}\n',
    b'{"interrupt": true}\n',
    b'{"do": "stop"}\n',
    b'{"complete": "sta"}\n',
    b'{"do": "help", "asks": true, "size": [20, 3]}\n',
    b'{"do": "reload"}\n',
    b'{"answer": "y"}\n' * 50,
    b'{"notices": true}\n{"do": "status"}\n{"do": "views"}\n',
)


async def _client(path: Path, chance: random.Random) -> None:
    """Somebody who says something odd, hears what comes at once or does not, and hangs up or waits to be hung up."""
    reader, writer = await asyncio.open_unix_connection(path)
    try:
        writer.write(chance.choice(ODD))
        if chance.random() < 0.7:
            async with asyncio.timeout(chance.choice((0.1, 1.0, 700.0)) if chance.random() < 0.05 else 0.1):
                await reader.read(1 << 16)
    except (TimeoutError, ConnectionError):
        pass
    finally:
        writer.close()


def cameras(folder: Path, done: int, count: int, _: Progress) -> Iterator[tuple[int, Held]]:
    """Openings of a stereo camera: after each the devices fail in one way, are let go, and found again."""
    folder.mkdir(parents=True, exist_ok=True)
    devices = {f"/dev/video{k}": PretendDevice(name) for k, name in enumerate(("left", "right"))}
    system: Any = PretendSystem(devices)
    settings = CameraSettings("left", "right", 8, 4, fps=10.0)
    cameras = V4L2StereoCamera(settings, system.clock, system)
    harms = itertools.cycle(_harms(system, devices))
    opened = Counter[str]()
    for number in range(done, count):
        whole_frames(system, 5)
        cameras.grab(system.now_s, 2.0)
        opened["pairs"] += 1
        mend = next(harms)()
        try:
            cameras.grab(system.now_s, 0.3)
            cameras.close()
        except CameraError:
            opened["failures"] += 1
        if held := [device.card for device in devices.values() if device.opened]:
            raise LostError(f"opening {number}: {held} not let go")
        mend()
        if (number + 1) % EVERY["cameras"] == 0 or number + 1 == count:
            yield number + 1, Held.now(folder, 0)
    if not opened["failures"]:
        raise LostError("no device failed")


def _harms(system: PretendSystem, devices: dict[str, PretendDevice]) -> list[Callable[[], Callable[[], None]]]:
    """Each harms a device, and gives what mends it."""
    first, right = next(iter(devices)), devices["/dev/video1"]

    def nothing() -> Callable[[], None]:
        return lambda: None

    def unplugged() -> Callable[[], None]:
        gone = devices.pop(first)

        def plug_in() -> None:
            devices[first] = gone

        return plug_in

    def silent() -> Callable[[], None]:
        right.schedule.clear()
        return lambda: None

    def halves() -> Callable[[], None]:
        whole_frames(system, 5)
        for frame in right.schedule:
            frame.data = bytes(16)
        return lambda: None

    def fails(request: int, number: int) -> Callable[[], Callable[[], None]]:
        def fail() -> Callable[[], None]:
            right.fails[request] = number
            return right.fails.clear

        return fail

    return [nothing, unplugged, silent, halves, fails(v4l2.DQBUF, errno.EIO), fails(v4l2.QBUF, errno.ENODEV)]


PARTS: dict[str, Callable[[Path, int, int, Progress], Iterator[tuple[int, Held]]]] = {
    "year": year,
    "starts": starts,
    "clients": clients,
    "cameras": cameras,
}
COUNTS = {"year": 365, "starts": 100_000, "clients": 100_000, "cameras": 10_000}


def grown(rows: list[dict[str, float]]) -> list[str]:
    """What the second half of the rows held more than the first, beyond what it may."""
    early, late = rows[len(rows) // 4 : len(rows) // 2], rows[len(rows) // 2 :]
    if not early:
        return []
    found = []
    for name, most in MOST.items():
        more = min(row[name] for row in late) - min(row[name] for row in early)
        if more > most:
            found.append(f"{name} grew by {more:g}")
    if (most_mb := max(row["disk_mb"] for row in rows)) > MOST_MB:
        found.append(f"{most_mb:.1f} MB lay on the disk")
    return found


def live(part: str, folder: Path, count: int) -> list[str]:
    """Live through one part, from where it was left; what was found wrong."""
    kept = folder / f"{part}.json"
    state: Progress = json.loads(kept.read_text()) if kept.exists() else {"done": 0, "progress": {}, "seconds": 0.0}
    rows: list[dict[str, float]] = []
    began_s, spent_s = time.process_time(), state["seconds"]
    print(f"{part:>8}{'MiB':>8}{'objects':>9}{'handles':>9}{'threads':>9}{'tasks':>7}{'files':>7}{'MB':>7}{'CPU s':>9}")
    try:
        for done, held in PARTS[part](folder / part, state["done"], count, state["progress"]):
            state |= {"done": done, "seconds": spent_s + time.process_time() - began_s}
            kept.write_text(json.dumps(state))
            if done % EVERY[part] == 0 or done == count:
                rows.append(asdict(held))
                print(f"{done:>8}{held.resident_mib:>8.1f}{held.objects:>9}{held.handles:>9}{held.threads:>9}{held.tasks:>7}"
                      f"{held.files:>7}{held.disk_mb:>7.1f}{state['seconds']:>9.0f}", flush=True)  # fmt: skip
    except (LostError, FileError) as error:
        return [f"{part}: {error}"]
    return [f"{part}: {text}" for text in grown(rows)]


def main() -> int:
    """Live and print."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench.long.years")
    parser.add_argument("--folder", type=Path, help="where it goes on, and is kept; a short path")
    parser.add_argument("counts", nargs="*", metavar="PART=COUNT")
    args = parser.parse_args()
    counts = {part: int(count) for part, _, count in (word.partition("=") for word in args.counts)} or COUNTS
    folder = args.folder or Path(tempfile.mkdtemp(prefix="facetd-years-"))
    folder.mkdir(parents=True, exist_ok=True)
    found = [text for part, count in counts.items() for text in live(part, folder, count)]
    print("\n".join(found) or "nothing grew, nothing was lost but what was told")
    if args.folder is None:
        shutil.rmtree(folder, ignore_errors=True)
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main())
