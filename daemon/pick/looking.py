"""One look: a stereo pair taken once the arm has settled, and what is seen in it. Nothing here moves the arm."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from daemon import frames
from daemon.arm import Pictures, Reading, SettledPair, Settling, Workcell, settled_pair
from daemon.arrays import Array
from daemon.vision.facets import Table
from daemon.vision.geometry import Polyhedron, StereoRig
from daemon.vision.health import (
    Clue,
    Finding,
    clue_of,
    drift,
    examine,
    exposure_factors,
    health_fields,
    misleading,
    sharpness,
)
from daemon.vision.image import VisionError
from daemon.vision.registration import Fit
from daemon.vision.values import FacetView, Scene


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


@dataclass(frozen=True, eq=False)
class Expected:
    """The one part that a look should show: its name, how sure that is, its shape; fit: both images and
    world_from_cyclopean (4, 4) in, its pose, or None, out."""

    label: str
    confidence: float
    shape: Polyhedron
    fit: Callable[[NDArray[np.uint8], NDArray[np.uint8], Array], Fit | None]


LEAST_CHANGE = 1.05
"""A change of exposure by less than that factor is none: the cameras are at their end, or count in coarser steps."""
ONLY_TRACKED = Scene((), (), FacetView((), (), (), (), np.nan), ("only what was expected was looked for",))


@dataclass(frozen=True, eq=False)
class Look:
    """What one look saw. tracked: the pose of the part that was expected, where that was found and nothing else was
    looked for (the scene is empty then); taken_s: when, on the cell's clock; settled_s: from the arm's rest to the
    first pair known to be still; seconds: from the arm's rest to the answer; from_light_s: from mid-exposure to the
    answer; epipolar_px: median distance of corners from their lines; table: where it was taken to be; health: what
    there is to say of the images themselves; clue: what it hints at of the calibration."""

    scene: Scene
    pictures: Pictures
    reading: Reading
    world_from_cyclopean: Array
    taken_s: float
    settled_s: float
    seconds: float
    from_light_s: float
    epipolar_px: float
    clue: Clue
    table: Table | None = None
    health: tuple[Finding, ...] = ()
    tracked: Fit | None = None


def epipolar_px(scene: Scene) -> float:
    """Median distance of the matched corners from their epipolar lines; nan where nothing was matched."""
    rows = [f.epipolar_px[np.isfinite(f.epipolar_px)] for p in scene.parts for f in p.facets]
    return float(np.median(np.abs(np.concatenate(rows)))) if any(map(len, rows)) else float("nan")


async def take_look(
    cell: Workcell,
    recogniser: Recogniser,
    reading: Reading,
    rest_s: float,
    settling: Settling,
    table_z_mm: float | None,
    expected: Expected | None = None,
) -> Look:
    """Wait until the images are still, then see. reading: where the arm is; rest_s: since when, on the cell's clock;
    table_z_mm: the table's height in the world, None where what lies in it counts, too; expected: the part that should
    be there; where that is found, nothing else is looked for. Raises VisionError on images
    that mislead (frozen, covered, swapped, half), besides what settled_pair and see raise."""
    pair = await settled_pair(cell, rest_s, settling)
    pictures = pair.pictures
    world_from_cyclopean = reading.world_from_tool @ cell.tool_from_cyclopean
    table = None
    if table_z_mm is not None:
        table = Table(world_from_cyclopean[2, :3], table_z_mm - float(world_from_cyclopean[2, 3]))
    images = pictures.left.pixels, pictures.right.pixels

    def see() -> tuple[Scene, tuple[Finding, ...], Fit | None, Clue]:
        health = _health(cell, pair)
        tracked = None if expected is None else expected.fit(*images, world_from_cyclopean)
        scene = recogniser.see(*images, table) if tracked is None else ONLY_TRACKED
        if tracked is None:
            health = (*health, *sharpness(images), *drift(scene))
        return scene, health, tracked, clue_of(scene, cell.rig, recogniser.shape)

    scene, health, tracked, clue = await asyncio.to_thread(see)
    now_s = cell.clock()
    return Look(
        scene=scene,
        pictures=pictures,
        reading=reading,
        world_from_cyclopean=world_from_cyclopean,
        taken_s=pictures.left.taken_s,
        settled_s=pair.seconds,
        seconds=now_s - rest_s,
        from_light_s=now_s - pictures.left.taken_s,
        epipolar_px=epipolar_px(scene),
        clue=clue,
        table=table,
        health=health,
        tracked=tracked,
    )


async def relight(cell: Workcell, look: Look) -> str | None:
    """Set both eyes' exposure by what a whole look saw, where its light was wrong: what was done, or None.

    Looks from before stay true: exposure changes levels, not places.
    """
    wanted = exposure_factors((look.pictures.left.pixels, look.pictures.right.pixels), look.scene.parts)
    took = None if wanted is None else await cell.eyes.expose(*wanted)
    if took is None or max(abs(np.log(factor)) for factor in took) < np.log(LEAST_CHANGE):
        return None
    return "exposure x {:.2f} left, x {:.2f} right".format(*took)


async def whole_look(recogniser: Recogniser, look: Look) -> Look:
    """The same look with everything in view looked for."""
    if look.tracked is None:
        return look
    images = look.pictures.left.pixels, look.pictures.right.pixels
    scene = await asyncio.to_thread(recogniser.see, *images, look.table)
    return replace(look, scene=scene, tracked=None, epipolar_px=epipolar_px(scene))


def _health(cell: Workcell, pair: SettledPair) -> tuple[Finding, ...]:
    """How well the pair itself is, but for its sharpness, which an expected part's edges prove when they are found.
    Raises VisionError where it misleads."""
    earlier, images = ((p.left.pixels, p.right.pixels) for p in (pair.before, pair.pictures))
    shown_again = images[0] is earlier[0]  # a recorded pair held still, not a camera that repeats itself
    health = examine(images, None if shown_again else earlier, cell.rig, sharp=False)
    wrong = misleading(health)
    if wrong:
        raise VisionError("; ".join(wrong))
    return health


def log_look(
    cell: Workcell,
    recogniser: Recogniser,
    look: Look,
    *,
    cycle: int,
    stop: int,
    purpose: str,
    expected: Expected | None = None,
) -> None:
    """Write a look to the run log, with both images and what it hints at of the calibration."""
    scene = recogniser.report(look.scene)
    if look.tracked is not None and expected is not None:
        scene |= {"parts": [tracked_json(expected, look.tracked, cell.rig)]}
    cell.log.record(
        "look",
        cycle=cycle,
        stop=stop,
        purpose=purpose,
        images={"left": look.pictures.left.pixels, "right": look.pictures.right.pixels},
        scene=scene,
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
            **health_fields(look.clue),
            **{f"{f.name}_{f.eye}": f.value for f in look.health},
            "findings": {f"{f.name} {f.eye}": str(f) for f in look.health if not f.good},
        },
        where=look.reading.world_from_tool,
        world_from_cyclopean=look.world_from_cyclopean,
        whole=look.tracked is None,
        table=None if look.table is None else {"up": look.table.up, "level_mm": look.table.level_mm},
    )


def tracked_json(expected: Expected, fit: Fit, rig: StereoRig) -> dict[str, object]:
    """A part that was found again by its edges as report.part_json has one, for whoever draws it: the facets of its
    shape that face the cameras, as they must lie."""
    corners = frames.apply(fit.cyclopean_from_part, expected.shape.corners_mm)
    towards = expected.shape.facing(fit.cyclopean_from_part) > 0.0
    return {
        "label": expected.label,
        "confidence": expected.confidence,
        "reason": "its edges lie where they should",
        "cyclopean_from_part": fit.cyclopean_from_part,
        "covariance": fit.covariance,
        "residual_mm": fit.residual_mm,
        "facets": [
            {
                "type": f"polygon{len(ring)}",
                "corners_mm": corners[ring],
                "left_px": rig.left.project(corners[ring]),
                "right_px": rig.right.project(corners[ring]),
            }
            for ring, faces in zip(expected.shape.rings, towards, strict=True)
            if faces
        ],
    }
