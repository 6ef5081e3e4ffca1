"""The whole daemon on simulated time with an arm that jumps and cameras that see noise: years of it in minutes.

The service is daemon/service.py, with its log, quota, watchdog, socket and pick cycle; arm, cameras and recogniser are
tests/fakes/fake_cell.py's. Tests set the wall clock.
"""

from __future__ import annotations

import asyncio
import datetime as dates
import gc
import json
import os
import shutil
import time
from collections.abc import Callable, Coroutine, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar
from unittest.mock import patch

import numpy as np
import yaml

from daemon import service
from daemon.arm.belief import Beliefs
from daemon.arm.collision_shapes import ARM_LINKS
from daemon.cell import build as build_room
from daemon.cell.hardware import Hardware
from daemon.config import Config
from daemon.console import context
from daemon.maintenance import journal
from daemon.service import Service
from daemon.store import runlog
from daemon.vision.values import Facet, Scene
from tests.fakes.computing import ComputesHere
from tests.fakes.fake_cell import FakeCameras, FakePair, FakePicture, FakeRobot, TruthRecogniser, World
from tests.fakes.simulated_time import SimulatedLoop

ETC = Path(__file__).resolve().parents[2] / "etc"
CONFIG = """version: 1
folders: {state: state, runtime: .}
cameras: {left: /dev/left, right: /dev/right}
arm: {port: /dev/arm}
log: {quota_mb: 20, keep_free_mb: 0, roll_mb: 2, sync_s: 60}
"""
SMALL = 8
"""The images' scale factor: the log must be filled by many looks, not by large ones."""
T = TypeVar("T")


@dataclass(eq=False)
class TimedWorld(World):
    """A world whose clock also runs while nothing acts."""

    time_s: Callable[[], float] = lambda: 0.0

    def clock(self) -> float:
        """World's clock, or simulated time if that is later."""
        self.now_s = max(self.now_s + 1e-6, self.time_s())
        return self.now_s


class Robot(FakeRobot):
    """A fake robot with the further members that service and watchdog use."""

    links = ARM_LINKS


class LightCameras(FakeCameras):
    """Fake cameras with the further members that service and watchdog use."""

    alone = None
    heard_s: float | None = None

    async def open(self) -> None:
        """They are there."""

    close = open

    async def grab(self, not_before_s: float, timeout_s: float) -> FakePair:
        """A small pair, taken now."""
        pair = await super().grab(not_before_s, timeout_s)
        self.heard_s = self.world.now_s
        cameras = (pair.left, pair.right)
        small = [FakePicture(camera.pixels[::SMALL, ::SMALL].copy(), camera.taken_s) for camera in cameras]
        return replace(pair, left=small[0], right=small[1])

    async def use(self, alone: str | None) -> None:
        """Do nothing: both cameras always work."""

    def step(self) -> bool:
        """False: the cameras are not recorded."""
        return False

    def describe(self) -> str:
        """A name for people."""
        return "made-up cameras"


class Sees(TruthRecogniser):
    """Without a scene in the log."""

    def _facet(self, corners: np.ndarray) -> Facet:
        facet = super()._facet(corners)
        return replace(facet, left_px=facet.left_px / SMALL, right_px=facet.right_px / SMALL)

    def report(self, scene: Scene) -> dict[str, object]:
        """Nothing of it."""
        return {"parts": []}


@dataclass(frozen=True)
class Held:
    """The resources of a process and the files of a folder; none may grow with the work done."""

    resident_mib: float
    objects: int
    handles: int
    threads: int
    tasks: int
    files: int
    disk_mb: float

    @classmethod
    def now(cls, folder: Path, tasks: int) -> Held:
        """By this process."""
        gc.collect()
        said = dict(line.split(":", 1) for line in Path("/proc/self/status").read_text().splitlines())
        files = [path.lstat() for path in folder.rglob("*") if path.is_file()]
        return cls(
            int(said["VmRSS"].split()[0]) / 1024,
            len(gc.get_objects()),
            len(os.listdir("/proc/self/fd")) - 1,
            int(said["Threads"]),
            tasks,
            len(files),
            sum(file.st_blocks for file in files) * 512 / 1e6,
        )


class Wall(dates.datetime):
    """A `datetime` whose `now` uses the wall clock that tests set."""

    @classmethod
    def now(cls, tz: dates.tzinfo | None = None) -> Any:
        """As datetime's."""
        return dates.datetime.fromtimestamp(time.time(), tz)


@dataclass
class LightDaemon:
    """One daemon after the other in a folder with a short path (a socket lies in it). began_s: the clock on the wall
    at the beginning, s since 1970."""

    folder: Path
    began_s: float = 1.8e9
    set_by_s: float = 0.0
    config: str = CONFIG
    told: list[tuple[str, str]] = field(default_factory=list)
    """The journal's messages: kind and text."""

    def __post_init__(self) -> None:
        self.folder.mkdir(parents=True, exist_ok=True)
        for name in ("facets.yaml", "parts.yaml"):
            shutil.copy(ETC / name, self.folder)
        (self.folder / "calibration.yaml").write_text(_small_calibration(), encoding="utf-8")
        (self.folder / "facetd.yaml").write_text(self.config, encoding="utf-8")
        self.loop = SimulatedLoop()
        self.world = TimedWorld(np.random.default_rng(1), time_s=self.loop.time)
        self.service: Service | None = None
        self._live: asyncio.Task[int] | None = None

    @property
    def runs(self) -> Path:
        """The folder of its runs."""
        return self.folder / "state" / "runs"

    @property
    def now_s(self) -> float:
        """The wall clock, s since 1970."""
        return self.began_s + self.set_by_s + self.loop.time()

    def run(self, work: Coroutine[Any, Any, T]) -> T:
        """Run a coroutine in simulated time."""
        return self.loop.run_until_complete(work)

    async def start(self) -> None:
        """Start a daemon, and wait until it is ready. Raises RuntimeError where it ends first."""
        self.world.closed, self.world.held = False, None
        self.service = Service(self.folder / "facetd.yaml")
        self._live = self.loop.create_task(self.service.run())
        while not self.service._ready:
            if self._live.done():
                raise RuntimeError(f"it ended with {self._live.result()}: {self.told[-1:]}")
            await asyncio.sleep(0.01)
        assert self.service.context is not None
        self.service.context.cycle.use(Sees(self.world))

    async def stop(self) -> int:
        """Stop the daemon as SIGTERM does; returns the exit status."""
        assert self.service is not None
        assert self._live is not None
        self.service.end("signal SIGTERM")
        return await self._live

    async def do(self, text: str, timeout_s: float = 3600.0) -> dict[str, Any]:
        """Send one command to the socket, as an operator who disconnects afterwards."""
        reader, writer = await asyncio.open_unix_connection(self.folder / "facetd.sock")
        writer.write(json.dumps({"do": text, "door": "bench"}).encode() + b"\n")
        async with asyncio.timeout(timeout_s):
            while "done" not in (message := json.loads(await reader.readline())):
                continue
        writer.close()
        await writer.wait_closed()
        done: dict[str, Any] = message["done"]
        return done

    def held(self) -> Held:
        """The resources that the process holds now."""
        return Held.now(self.folder, len(asyncio.all_tasks(self.loop)))

    def _build(self, config: Config, on_wire: Any, record: Any) -> Hardware:
        robot: Any = Robot(self.world)
        robot.beliefs = Beliefs(self.world.clock, record)
        cameras: Any = LightCameras(self.world)
        robot.on_wire = on_wire
        return Hardware("real", robot, cameras, self.world.clock, "/dev/arm")


def _small_calibration() -> str:
    """The calibration of etc/, for the small images."""
    cameras = yaml.safe_load((ETC / "calibration.yaml").read_text(encoding="utf-8"))
    del cameras["quality"]["method"]
    cameras["image_size"] = [n // SMALL for n in cameras["image_size"]]
    for camera in (cameras["left"], cameras["right"]):
        matrix = np.array(camera["camera_matrix"]) / SMALL
        matrix[2] = 0.0, 0.0, 1.0
        camera["camera_matrix"] = matrix.tolist()
    return yaml.safe_dump(cameras)


@contextmanager
def light_daemon(folder: Path, began_s: float = 1.8e9, config: str = CONFIG) -> Iterator[LightDaemon]:
    """Context: a LightDaemon; all modules of this process use its clocks meanwhile."""
    daemon = LightDaemon(folder, began_s, config=config)
    patches: list[Any] = [
        patch.object(time, "monotonic", daemon.loop.time),
        patch.object(time, "time", lambda: daemon.now_s),
        patch.object(build_room, "build", daemon._build),
        patch.object(service, "Worker", ComputesHere),
        patch.object(journal, "write", lambda kind, text, *_, **__: daemon.told.append((kind, text))),
        *(patch.object(module, "datetime", Wall) for module in (service, context, runlog)),
    ]
    for each in patches:
        each.start()
    try:
        yield daemon
    finally:
        for task in asyncio.all_tasks(daemon.loop):
            task.cancel()
        daemon.loop.run_until_complete(asyncio.sleep(0))
        for each in patches:
            each.stop()
        daemon.loop.close()
