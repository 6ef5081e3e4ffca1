"""One look: a stereo pair taken once the arm has settled, and what is seen in it. Nothing here moves the arm.

That the arm has settled is told by the images themselves: two pairs, one after the other, that show the same.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from daemon.arm.workcell import Array, Pictures, Reading, Workcell
from daemon.calibration.clues import clue_of
from daemon.calibration.drift_watch import health_fields
from daemon.errors import FacetdError
from daemon.vision.facets.table import Table
from daemon.vision.geometry.polyhedron import Polyhedron
from daemon.vision.health.examine import Finding, drift, examine, misleading, sharpness
from daemon.vision.image.grey import VisionError
from daemon.vision.values import Scene

BLOCK_PX = 8
"""Side of the blocks whose means are compared: noise averages out in one, an edge still shows."""


class NotSettledError(FacetdError):
    """The images still differ when the time is up: the arm shakes, a part moves, or the light flickers."""


class Recogniser(Protocol):
    """What turns images into parts: the recogniser with its model (daemon/teaching/trainer.py), or a test's own."""

    def see(self, left: NDArray[np.uint8], right: NDArray[np.uint8], table: Table | None) -> Scene:
        """Parts in a stereo pair, in the cyclopean frame; table: where it is. May take a while; called in a thread."""

    def shape(self, label: str) -> Polyhedron | None:
        """The taught part's corners and facets, or None where there is no such part."""

    def report(self, scene: Scene) -> dict[str, object]:
        """The scene as JSON values, for the run log."""

    @property
    def labels(self) -> tuple[str, ...]:
        """What was taught."""


@dataclass(frozen=True)
class Settling:
    """still_noise: how many times its own noise a block may change; floor_grey: what a change may always be, and
    most_noise_grey: what can still be noise (all of the image may move), grey levels; timeout_s: when to give up."""

    still_noise: float = 6.0
    floor_grey: float = 1.5
    most_noise_grey: float = 2.0
    timeout_s: float = 5.0


@dataclass(frozen=True, eq=False)
class Look:
    """What one look saw. taken_s: when, on the cell's clock; settled_s: from the arm's rest to the first pair known to
    be still; seconds: from the arm's rest to the answer; from_light_s: from mid-exposure to the answer; epipolar_px:
    median distance of corners from their lines; table: where it was taken to be; health: what there is to say of the
    images themselves; whole: whether everything in view was looked for, or only what was expected."""

    scene: Scene
    pictures: Pictures
    reading: Reading
    world_from_cyclopean: Array
    taken_s: float
    settled_s: float
    seconds: float
    from_light_s: float
    epipolar_px: float
    table: Table | None = None
    health: tuple[Finding, ...] = ()
    whole: bool = True


Expect = Callable[[NDArray[np.uint8], NDArray[np.uint8], Array], Scene | None]
"""Looks for one thing only: both images and world_from_cyclopean (4, 4) in, the scene with it, or None, out."""


def block_means(image: NDArray[np.uint8]) -> Array:
    """(H, W) grey -> (H // 8, W // 8) means of 8x8 px blocks."""
    rows, columns = (n // BLOCK_PX for n in image.shape)
    cut = image[: rows * BLOCK_PX, : columns * BLOCK_PX].astype(np.float32)
    return np.asarray(cv2.resize(cut, (columns, rows), interpolation=cv2.INTER_AREA), float)


def change(before: NDArray[np.uint8], after: NDArray[np.uint8]) -> tuple[float, float]:
    """(largest, typical) change of a block between two images, grey levels: the 99.8 % quantile, and the robust noise.

    A common change of brightness (lamps) is taken out first.
    """
    difference = block_means(after) - block_means(before)
    difference = np.abs(difference - np.median(difference))
    return float(np.quantile(difference, 0.998)), float(1.4826 * np.median(difference))


def still(before: Pictures, after: Pictures, settling: Settling) -> bool:
    """Whether two pairs show the same scene from the same place."""
    for a, b in ((before.left, after.left), (before.right, after.right)):
        largest, typical = change(a.pixels, b.pixels)
        noise = min(typical, settling.most_noise_grey)
        if largest > max(settling.floor_grey, settling.still_noise * noise):
            return False
    return True


def epipolar_px(scene: Scene) -> float:
    """Median distance of the matched corners from their epipolar lines; nan where nothing was matched."""
    rows = [f.epipolar_px[np.isfinite(f.epipolar_px)] for p in scene.parts for f in p.facets]
    return float(np.median(np.abs(np.concatenate(rows)))) if any(map(len, rows)) else float("nan")


async def settled_pair(cell: Workcell, rest_s: float, settling: Settling) -> tuple[Pictures, float]:
    """A pair that agrees with the one before it, and seconds from rest_s to it. Raises NotSettledError, or the
    camera's error."""
    _, pictures, settled_s = await _agreeing_pairs(cell, rest_s, settling)
    return pictures, settled_s


async def _agreeing_pairs(cell: Workcell, rest_s: float, settling: Settling) -> tuple[Pictures, Pictures, float]:
    """settled_pair's, and the pair before it."""
    before = await cell.eyes.grab(rest_s, settling.timeout_s)
    while True:
        after = await cell.eyes.grab(max(before.left.taken_s, before.right.taken_s), settling.timeout_s)
        if still(before, after, settling):
            return before, after, max(0.0, before.left.taken_s - rest_s)
        if cell.clock() - rest_s > settling.timeout_s:
            raise NotSettledError(f"the images still change {settling.timeout_s:g} s after the arm came to rest")
        before = after


async def take_look(
    cell: Workcell,
    sight: Recogniser,
    reading: Reading,
    rest_s: float,
    settling: Settling,
    table_z_mm: float | None,
    expect: Expect | None = None,
) -> Look:
    """Wait until the images are still, then see. reading: where the arm is; rest_s: since when, on the cell's clock;
    table_z_mm: the table's height in the world, None where what lies in it counts, too; expect: looks for one thing
    that should be there, and where it finds that, nothing else is looked for. Raises VisionError on images
    that mislead (frozen, covered, swapped, half), besides what settled_pair and see raise."""
    before, pictures, settled_s = await _agreeing_pairs(cell, rest_s, settling)
    world_from_cyclopean = reading.world_from_tool @ cell.tool_from_cyclopean
    table = None
    if table_z_mm is not None:
        table = Table(world_from_cyclopean[2, :3], table_z_mm - float(world_from_cyclopean[2, 3]))
    images = pictures.left.pixels, pictures.right.pixels

    def see() -> tuple[Scene, tuple[Finding, ...], bool]:
        health = _health(cell, before, pictures)
        expected = None if expect is None else expect(*images, world_from_cyclopean)
        if expected is not None:
            return expected, health, False
        scene = sight.see(*images, table)
        return scene, (*health, *sharpness(images), *drift(scene)), True

    scene, health, whole = await asyncio.to_thread(see)
    now_s = cell.clock()
    return Look(
        scene=scene,
        pictures=pictures,
        reading=reading,
        world_from_cyclopean=world_from_cyclopean,
        taken_s=pictures.left.taken_s,
        settled_s=settled_s,
        seconds=now_s - rest_s,
        from_light_s=now_s - pictures.left.taken_s,
        epipolar_px=epipolar_px(scene),
        table=table,
        health=health,
        whole=whole,
    )


async def whole_look(sight: Recogniser, look: Look) -> Look:
    """The same look with everything in view looked for."""
    if look.whole:
        return look
    images = look.pictures.left.pixels, look.pictures.right.pixels
    scene = await asyncio.to_thread(sight.see, *images, look.table)
    return replace(look, scene=scene, whole=True, epipolar_px=epipolar_px(scene))


def _health(cell: Workcell, before: Pictures, now: Pictures) -> tuple[Finding, ...]:
    """How well the pair itself is, but for its sharpness, which an expected part's edges prove when they are found.
    Raises VisionError where it misleads."""
    earlier, images = ((p.left.pixels, p.right.pixels) for p in (before, now))
    shown_again = now.left.pixels is before.left.pixels  # a recorded pair held still, not a camera that repeats itself
    health = examine(images, None if shown_again else earlier, cell.rig, sharp=False)
    wrong = misleading(health)
    if wrong:
        raise VisionError("; ".join(wrong))
    return health


def log_look(cell: Workcell, sight: Recogniser, look: Look, *, cycle: int, stop: int, purpose: str) -> None:
    """Write a look to the run log, with both images and what it hints at of the calibration."""

    def taught(label: str) -> Array | None:
        shape = sight.shape(label)
        return None if shape is None else shape.corners_mm

    hints = health_fields(clue_of(look.scene, cell.rig, taught, ""))
    cell.log.record(
        "look",
        cycle=cycle,
        stop=stop,
        purpose=purpose,
        images={"left": look.pictures.left.pixels, "right": look.pictures.right.pixels},
        scene=sight.report(look.scene),
        seconds={
            **look.scene.seconds,
            "settled": look.settled_s,
            "from_light": look.from_light_s,
            "total": look.seconds,
        },
        health={
            "skew_ms": (look.pictures.right.taken_s - look.pictures.left.taken_s) * 1000.0,
            "epipolar_px": look.epipolar_px,
            "noise": look.scene.view.noise_sigma,
            **hints,
            **_health_fields(look.health),
        },
        where=look.reading.world_from_tool,
        world_from_cyclopean=look.world_from_cyclopean,
        whole=look.whole,
        table=None if look.table is None else {"up": look.table.up, "level_mm": look.table.level_mm},
    )


def _health_fields(health: tuple[Finding, ...]) -> dict[str, object]:
    """Every measure as `name_eye`, and in words what is not in order."""
    return {f"{f.name}_{f.eye}": f.value for f in health} | {
        "findings": {f"{f.name} {f.eye}": str(f) for f in health if not f.good}
    }
