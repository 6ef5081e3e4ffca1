"""One look: a stereo pair taken once the arm has settled, and what is seen in it. Nothing here moves the arm."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from daemon import frames
from daemon.arm import InWorld, Pictures, Reading, Settling, Workcell, settled_pair
from daemon.arrays import Array
from daemon.compute.calls import ByReference, Compute
from daemon.events.codes import BY_MEASURE
from daemon.pick.moved_pair import MovedPair, Places, clue_with_arm_errors, with_arm_errors
from daemon.pick.pose_fusion import Doubt
from daemon.pick.recogniser import PartRecogniser
from daemon.vision.facets import TablePlane, table_at
from daemon.vision.geometry import Polyhedron, StereoRig, moved_rig
from daemon.vision.health import (
    Clue,
    Finding,
    cause_of_nothing,
    clue_of,
    drift,
    examine,
    exposure_factors,
    health_fields,
    misleading,
    sharpness,
)
from daemon.vision.image import StereoImages, VisionError, open_stereo
from daemon.vision.refine import Fit
from daemon.vision.values import FacetView, Scene


class MisleadingImagesError(VisionError):
    """A pair that does not show the scene. findings: the measures beyond their limits, at least one."""

    def __init__(self, findings: Sequence[Finding]) -> None:
        super().__init__("; ".join(map(str, findings)))
        self._measures = tuple(findings)
        self.findings = tuple(f"{finding.name} {finding.camera}" for finding in findings)
        self.code = BY_MEASURE[findings[0].name]

    def __reduce__(self) -> tuple[type, tuple[object]]:
        """For transfer from a worker process."""
        return type(self), (self._measures,)


@dataclass(frozen=True, eq=False)
class CapturedPair(ByReference):
    """A pair of still images, and the pair before it; reading: the arm's position after it; settled_s: from the arm's
    rest to the first still pair; rig and world_from_cyclopean: of this pair; moved: viewpoints of a single camera, None
    where both images are simultaneous; pivot: of fixed cameras (see InWorld), None for cameras on the gripper."""

    before: Pictures
    pictures: Pictures
    reading: Reading
    settled_s: float
    rig: StereoRig
    world_from_cyclopean: Array
    moved: Places | None = None
    pivot: Array | None = None

    @property
    def images(self) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        """Left and right."""
        return self.pictures.left.pixels, self.pictures.right.pixels

    @property
    def stereo(self) -> StereoImages:
        """Both images, prepared for edge detection."""
        return open_stereo(*self.images, self.rig)


@dataclass(frozen=True, eq=False)
class Expected:
    """The part that a look should show: its name with confidence, and its shape; fit: computes its pose in a pair, or
    None."""

    label: str
    confidence: float
    shape: Polyhedron
    fit: Callable[[CapturedPair], Fit | None]


LEAST_CHANGE = 1.05
"""A smaller change of exposure counts as none: the cameras are at their limit, or have coarser steps."""
ONLY_TRACKED = Scene((), (), FacetView((), (), (), (), np.nan), ("only what was expected was looked for",))


@dataclass(frozen=True, eq=False)
class Look(ByReference):
    """What one look saw in a pair. tracked: the pose of the part that was expected, where that was found and nothing
    else was looked for (the scene is empty then); taken_s: when the older picture was taken, on the cell's clock;
    seconds: from the arm's rest to the answer; from_light_s: from mid-exposure to the answer; epipolar_px: median
    distance of corners from their lines; table: where it was taken to be; health: what there is to say of the images
    themselves; clue: what it hints at of the calibration."""

    scene: Scene
    taken: CapturedPair
    taken_s: float
    seconds: float
    from_light_s: float
    epipolar_px: float
    clue: Clue
    table: TablePlane | None = None
    health: tuple[Finding, ...] = ()
    tracked: Fit | None = None

    @property
    def pictures(self) -> Pictures:
        return self.taken.pictures

    @property
    def reading(self) -> Reading:
        """The arm's position after it."""
        return self.taken.reading

    @property
    def world_from_cyclopean(self) -> Array:
        """(4, 4) mm, of this pair."""
        return self.taken.world_from_cyclopean

    @property
    def viewpoints(self) -> tuple[Array, Array]:
        """(3,) world mm: positions of the left and the right camera."""
        left, right = (
            self.world_from_cyclopean @ camera.cyclopean_from_camera
            for camera in (self.taken.rig.left, self.taken.rig.right)
        )
        return left[:3, 3], right[:3, 3]


def epipolar_px(scene: Scene) -> float:
    """Median distance of the matched corners from their epipolar lines; nan where nothing was matched."""
    rows = [f.epipolar_px[np.isfinite(f.epipolar_px)] for p in scene.parts for f in p.facets]
    return float(np.median(np.abs(np.concatenate(rows)))) if any(map(len, rows)) else float("nan")


async def capture_pair(cell: Workcell, reading: Reading, rest_s: float, settling: Settling) -> CapturedPair:
    """Capture a pair once the images are still. reading: the arm's position; rest_s: time from which it is at rest, on
    the cell's clock. Raises the errors of settled_pair."""
    pair = await settled_pair(cell, rest_s, settling)
    world_from_cyclopean = cell.mounting.world_from_cyclopean_at(reading.world_from_tool)
    pivot = cell.mounting.pivot if isinstance(cell.mounting, InWorld) else None
    return CapturedPair(pair.before, pair.pictures, reading, pair.seconds, cell.rig, world_from_cyclopean, pivot=pivot)


def moved_pair_of(cell: Workcell, first: CapturedPair, second: CapturedPair, doubt: Doubt) -> CapturedPair:
    """The pair of two pictures of a cell's one camera. Raises ValueError where the arm did not move between them."""
    assert cell.alone is not None
    from_cameras = [taken.world_from_cyclopean @ cell.rig.left.cyclopean_from_camera for taken in (first, second)]
    rig, world_from_cyclopean = moved_rig(cell.rig.left, cell.rig.image_size, (from_cameras[0], from_cameras[1]))
    rightwards = float((from_cameras[1] - from_cameras[0])[:3, 3] @ from_cameras[0][:3, 0]) > 0
    before, pictures = (
        MovedPair(*((a.left, b.left) if rightwards else (b.left, a.left)))
        for a, b in ((first.before, second.before), (first.pictures, second.pictures))
    )
    left, right = (camera.cyclopean_from_camera for camera in (rig.left, rig.right))
    places = Places(cell.alone, left, right, doubt.arm_mm, doubt.arm_deg)
    return CapturedPair(
        before, pictures, second.reading, max(first.settled_s, second.settled_s), rig, world_from_cyclopean, places
    )


def observe(
    recogniser: PartRecogniser, taken: CapturedPair, table: TablePlane | None, expected: Expected | None
) -> tuple[Scene, tuple[Finding, ...], Fit | None, Clue]:
    """Compute scene, health, tracked pose and clue of a pair (see Look); arguments and errors as those of take_look.
    Takes up to a second: for a Compute."""
    health = pair_health(taken)
    tracked = None if expected is None else expected.fit(taken)
    scene = _seen(recogniser, taken, table) if tracked is None else ONLY_TRACKED
    if tracked is None:
        health = (*health, *sharpness(taken.images), *(() if taken.moved else drift(scene)))  # the arm errs, too
    clue = clue_of(scene, taken.rig, recogniser.shape)
    if taken.moved is not None:
        clue = clue_with_arm_errors(clue, taken.moved.arm)
    return scene, health, tracked, clue


async def take_look(
    cell: Workcell,
    recogniser: PartRecogniser,
    taken: CapturedPair,
    rest_s: float,
    table_z_mm: float | None,
    expected: Expected | None = None,
) -> Look:
    """See what is in a pair. rest_s: since when the arm was at rest for it; table_z_mm: the table's height in the
    world, None where what lies in it counts, too; expected: the part that should be there; where that is found, nothing
    else is looked for. Raises VisionError on images that mislead (frozen, covered, swapped, half), besides what see
    raises, and ComputeError."""
    table = None if table_z_mm is None else table_at(table_z_mm, taken.world_from_cyclopean)
    scene, health, tracked, clue = await cell.compute(observe, recogniser, taken, table, expected)
    now_s = cell.clock()
    taken_s = min(taken.pictures.left.taken_s, taken.pictures.right.taken_s)
    return Look(
        scene=scene,
        taken=taken,
        taken_s=taken_s,
        seconds=now_s - rest_s,
        from_light_s=now_s - taken_s,
        epipolar_px=epipolar_px(scene),
        clue=clue,
        table=table,
        health=health,
        tracked=tracked,
    )


def _seen(recogniser: PartRecogniser, taken: CapturedPair, table: TablePlane | None) -> Scene:
    scene = recogniser.see(*taken.images, table, taken.rig)
    return scene if taken.moved is None else with_arm_errors(scene, taken.rig, taken.moved.arm)


async def adjust_exposure(cell: Workcell, look: Look) -> str | None:
    """Correct both cameras' exposure from a whole look. Returns the change as text, or None.

    Earlier looks stay valid: exposure changes brightness, not positions.
    """
    wanted = exposure_factors(look.taken.images, look.scene.parts)
    if wanted is not None and cell.alone is not None:  # one camera took both
        wanted = (float(np.sqrt(wanted[0] * wanted[1])),) * 2
    took = None if wanted is None else await cell.cameras.expose(*wanted)
    if took is None or max(abs(np.log(factor)) for factor in took) < np.log(LEAST_CHANGE):
        return None
    return "exposure x {:.2f} left, x {:.2f} right".format(*took)


async def whole_look(compute: Compute, recogniser: PartRecogniser, look: Look) -> Look:
    """The same look, with all parts in view recognised."""
    if look.tracked is None:
        return look
    scene = await compute(_seen, recogniser, look.taken, look.table)
    return replace(look, scene=scene, tracked=None, epipolar_px=epipolar_px(scene))


def pair_health(taken: CapturedPair) -> tuple[Finding, ...]:
    """Image health of a pair, without its sharpness, which the edges of an expected part prove. Raises
    MisleadingImagesError."""
    earlier, images = (taken.before.left.pixels, taken.before.right.pixels), taken.images
    shown_again = images[0] is earlier[0]  # a recorded pair held still, not a camera that repeats itself
    health = examine(images, None if shown_again else earlier, taken.rig, sharp=False)
    wrong = misleading(health)
    if wrong:
        raise MisleadingImagesError(wrong)
    return health


def log_look(
    cell: Workcell,
    recogniser: PartRecogniser,
    look: Look,
    *,
    cycle: int,
    stop: int,
    purpose: str,
    expected: Expected | None = None,
) -> None:
    """Write a look to the run log, with both images and its clue on the calibration."""
    scene = recogniser.report(look.scene)
    if not look.scene.parts and recogniser.labels:
        nothing = cause_of_nothing(look.taken.images)
        scene |= {"unmatched": list(look.scene.view.outlines), "nothing": nothing}
    if look.tracked is not None and expected is not None:
        scene |= {"parts": [tracked_json(expected, look.tracked, look.taken.rig)]}
    cell.log.record(
        "look",
        cycle=cycle,
        stop=stop,
        purpose=purpose,
        images={"left": look.pictures.left.pixels, "right": look.pictures.right.pixels},
        scene=scene,
        seconds={
            **look.scene.seconds,
            "settled": look.taken.settled_s,
            "from_light": look.from_light_s,
            "total": look.seconds,
        },
        health={
            "skew_ms": (look.pictures.right.taken_s - look.pictures.left.taken_s) * 1000.0,
            "epipolar_px": look.epipolar_px,
            "noise": look.scene.view.noise_sigma,
            **health_fields(look.clue),
            **{f"{f.name}_{f.camera}": f.value for f in look.health},
            "findings": {f"{f.name} {f.camera}": str(f) for f in look.health if not f.good},
        },
        where=look.reading.world_from_tool,
        world_from_cyclopean=look.world_from_cyclopean,
        whole=look.tracked is None,
        table=None if look.table is None else look.table.json(),
        **({} if look.taken.moved is None else {"moved": look.taken.moved.json()}),
    )


def tracked_json(expected: Expected, fit: Fit, rig: StereoRig) -> dict[str, object]:
    """JSON of a part tracked by its edges, as by report.part_json, for drawing: the facets of its shape that face the
    cameras, at its pose."""
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
