"""Simulated stereo camera: exposure times, sensor noise, camera faults.

The cell provides the scene at a moment (`scene_at`), render.py its radiance.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import ceil, floor
from threading import Lock
from typing import Literal

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from drivers.arrays import Array
from drivers.camera.pair import CameraError, CameraName, Frame, StereoPair
from drivers.rigid import angle_of, apply
from drivers.simcell.light import CellLight
from drivers.simcell.optics import Array32, turned
from drivers.simcell.render import PixelRays, RenderedSolid, radiance
from drivers.simcell.truth import Truth

SIDES = ("left", "right")
BLACK_LEVEL = 4.0
CameraFault = Literal["away", "frozen", "stale", "half", "auto_exposure", "autofocus", "rolling"]
"""Fault of a camera: no frame, always its last one, its last radiance with fresh noise, half of each; exposure that
follows the scene whatever is set, focus that hunts, rows that are exposed one after the other over a frame's period."""
AUTO_LEVEL = 90.0
"""Mean grey level that automatic exposure keeps."""
HUNTING_PX, HUNTING_FRAMES = 1.5, 6
"""Most blur of a focus that hunts, and its period."""
STILL_MM, STILL_RAD = 0.01, 2e-5
BLUR_STEPS, ROLLING_BANDS = 6, 12
SHORTEST, LONGEST = 1 / 64, 64.0
"""Limits of the exposure, relative to the truth's; it changes the grey level, not the motion blur."""


@dataclass(frozen=True, eq=False)
class SimulatedScene:
    """The scene at a moment: pose of the cameras, solids, and a state that changes when these move.

    gripper: solids that are visible but cast no shadow. covered: a plain cloth hides the table's pattern.
    """

    world_from_cyclopean: Array
    solids: tuple[RenderedSolid, ...]
    state: object
    gripper: tuple[RenderedSolid, ...] = ()
    covered: bool = False


class SimulatedPair:
    """A StereoCamera (drivers/camera/pair.py) whose frames come at the sensor's rate on the given clock.

    time_scale: cell seconds a clock second, for frame rate and exposure.
    """

    def __init__(
        self,
        truth: Truth,
        scene_at: Callable[[float], SimulatedScene],
        rng: np.random.Generator,
        time_scale: float = 1.0,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
        table_pattern: np.random.Generator | None = None,
    ) -> None:
        """table_pattern: random generator of the table's pattern; None: a plain table."""
        self._truth, self._scene_at, self._rng = truth, scene_at, rng
        self._clock, self._sleep = clock, sleep
        self._period_s = 1.0 / (truth.sensor.frame_rate_hz * time_scale)
        self._exposure_s = min(truth.sensor.exposure_s / time_scale, 0.9 * self._period_s)
        self._skew_s = truth.sensor.skew_s / time_scale
        self._started_s = clock()
        self._lenses = {"left": truth.left.lens(), "right": truth.right.lens()}
        self._rays: dict[str, PixelRays] = {}
        self._cell_light = CellLight(truth.table, truth.lighting, table_pattern)
        self._lit_for: object = None
        self._seen: dict[str, tuple[object, Array32]] = {}
        self._vignette = _vignette(truth)
        self._covered: set[str] = set()
        self._exposure_factors = dict.fromkeys(SIDES, 1.0)
        self._alone: CameraName | None = None
        self._faults: dict[str, CameraFault] = {}
        self._shown: dict[str, NDArray[np.uint8]] = {}
        self._lit: dict[str, Array32] = {}
        self._unplugged = False
        self._is_open = False
        self._lock = Lock()

    def open(self) -> None:
        """Open the cameras. Raises CameraError while they are unplugged."""
        if self._unplugged:
            raise CameraError("simulated pair: unplugged; plug it in again")
        self._is_open = True

    def close(self) -> None:
        self._is_open = False

    def describe(self) -> str:
        width, height = self._truth.image_size
        rate = self._truth.sensor.frame_rate_hz
        return f"simulated pair, {width}x{height} grey, {rate:g} frames/s of the cell's time"

    def grab(self, not_before_s: float, timeout_s: float) -> StereoPair:
        """The newest pair exposed entirely after not_before_s, if necessary after a wait.

        Raises CameraError where the wait would exceed timeout_s, or the pair is closed or unplugged.
        """
        if not self._is_open:
            raise CameraError("simulated pair: not open")
        now = self._clock()
        lead, tail = self._exposure_s / 2, self._exposure_s / 2 + self._skew_s
        newest = floor((now - tail - self._started_s) / self._period_s)
        first = ceil((not_before_s + lead - self._started_s) / self._period_s)
        number = max(newest, first, 0)
        middle_s = self._started_s + number * self._period_s
        used = SIDES if self._alone is None else (self._alone,)
        away = [side for side in used if self._faults.get(side) == "away"]
        if self._unplugged or away or middle_s + tail - now > timeout_s:
            self._sleep(max(timeout_s, 0.0))
            cause = "unplugged" if self._unplugged else f"{away[0]} camera unplugged" if away else "no pair that late"
            raise CameraError(f"simulated pair: no frame within {timeout_s:.2f} s ({cause})")
        if middle_s + tail > now:
            self._sleep(middle_s + tail - now)
        with self._lock:
            if self._alone is not None:
                only = self._frame(self._alone, middle_s, number)
                return StereoPair(only, only)
            left = self._frame("left", middle_s, number)
            right = self._frame("right", middle_s + self._skew_s, number)
        return StereoPair(left, right)

    def use(self, alone: CameraName | None) -> None:
        self._alone = alone

    def expose(self, left: float, right: float) -> tuple[float, float]:
        """Multiply the exposures by factors from the next frame on, within the limits. Returns the accepted factors."""
        with self._lock:
            before = dict(self._exposure_factors)
            for side, factor in zip(SIDES, (left, right), strict=True):
                self._exposure_factors[side] = float(np.clip(before[side] * factor, SHORTEST, LONGEST))
            return self._exposure_factors["left"] / before["left"], self._exposure_factors["right"] / before["right"]

    def cover(self, side: str, covered: bool = True) -> None:
        """Put the lens cap on one camera, or take it off."""
        (self._covered.add if covered else self._covered.discard)(side)

    def displace(self, side: str, rotation_vector_deg: ArrayLike) -> None:
        """Rotate one camera about its optical centre: (3,) degrees about its own x (pitch), y (yaw), z (roll)."""
        with self._lock:
            self._lenses[side] = turned(self._lenses[side], rotation_vector_deg)
            self._rays.pop(side, None)
            self._seen.pop(side, None)

    def set_fault(self, side: str, fault: CameraFault | None) -> None:
        """Give a camera a fault from the next frame on, or none."""
        with self._lock:
            self._faults.pop(side, None)
            if fault is not None:
                self._faults[side] = fault

    def unplug(self, unplugged: bool = True) -> None:
        self._unplugged = unplugged

    def _frame(self, side: str, middle_s: float, number: int) -> Frame:
        covered = side in self._covered
        light = np.zeros_like(self._vignette) if covered else self._mean_radiance(side, middle_s)
        light = self._lit[side] = self._lit.get(side, light) if self._faults.get(side) == "stale" else light
        fault = self._faults.get(side)
        gain = getattr(self._truth.sensor, f"gain_{side}") * self._exposure_factors[side]
        if fault == "auto_exposure":
            gain = AUTO_LEVEL / max(float(light.mean()), 1.0)
        elif fault == "autofocus":
            blur_px = 0.01 + HUNTING_PX * abs(np.sin(np.pi * number / HUNTING_FRAMES))
            light = np.asarray(cv2.GaussianBlur(light, (0, 0), blur_px), np.float32)
        pixels = self._expose(light, gain)
        if fault == "frozen":
            pixels = self._shown.get(side, pixels).copy()
        elif fault == "half":
            pixels[len(pixels) // 2 :] = pixels[len(pixels) // 2]
        self._shown[side] = pixels
        pixels.setflags(write=False)
        return Frame(pixels, middle_s, number)

    def _mean_radiance(self, side: str, middle_s: float) -> Array32:
        """The mean radiance over the exposure; one image where the arm is at rest."""
        if self._faults.get(side) == "rolling":
            return self._row_by_row(side, middle_s)
        half = self._exposure_s / 2
        scenes = [self._scene_at(middle_s - half), self._scene_at(middle_s + half)]
        if _moving(scenes):
            steps = np.linspace(-half, half, BLUR_STEPS)
            seen = [self._radiance(side, self._scene_at(middle_s + step)) for step in steps]
            return np.asarray(np.mean(seen, axis=0), np.float32)
        return self._radiance(side, scenes[0])

    def _row_by_row(self, side: str, middle_s: float) -> Array32:
        """The radiance of a rolling shutter: bands of rows, each at its own moment within the frame's period."""
        moments = middle_s + self._period_s * (np.arange(ROLLING_BANDS) + 0.5 - ROLLING_BANDS / 2) / ROLLING_BANDS
        seen = [np.array_split(self._radiance(side, self._scene_at(at)), ROLLING_BANDS) for at in moments]
        return np.concatenate([bands[k] for k, bands in enumerate(seen)])

    def _radiance(self, side: str, scene: SimulatedScene) -> Array32:
        """The radiance of one camera's image, computed again only after a motion."""
        key = _key(scene)
        seen = self._seen.get(side)
        if seen is not None and seen[0] == key:
            return seen[1]
        if side not in self._rays:
            self._rays[side] = PixelRays(self._lenses[side], *self._truth.image_size)
        if scene.state != self._lit_for:
            bodies = [apply(body.world_from_solid, body.solid.vertices) for body in scene.solids]
            self._cell_light.cast(bodies, scene.covered)
            self._lit_for = scene.state
        solids = (*scene.solids, *scene.gripper)
        light = radiance(self._rays[side], scene.world_from_cyclopean, solids, self._cell_light)
        self._seen[side] = key, light
        return light

    def _expose(self, light: Array32, gain: float) -> NDArray[np.uint8]:
        sensor = self._truth.sensor
        soft = cv2.GaussianBlur(light, (0, 0), sensor.blur_px, borderType=cv2.BORDER_REPLICATE)
        level = soft * self._vignette * np.float32(gain) + np.float32(BLACK_LEVEL)
        sigma = np.sqrt(np.float32(sensor.read_noise**2) + np.float32(sensor.photon_noise) * level)
        noisy = level + sigma * self._rng.standard_normal(level.shape, dtype=np.float32)
        return np.asarray(np.clip(np.round(noisy), 0, 255), np.uint8)


def _moving(scenes: Sequence[SimulatedScene]) -> bool:
    first, last = (scene.world_from_cyclopean for scene in scenes)
    shift = float(np.linalg.norm(first[:3, 3] - last[:3, 3]))
    return shift > STILL_MM or angle_of(first[:3, :3].T @ last[:3, :3]) > STILL_RAD


def _key(scene: SimulatedScene) -> object:
    """A key that is equal for scenes with identical images."""
    gripper = [part.tobytes() for body in scene.gripper for part in (body.world_from_solid, body.solid.vertices)]
    return scene.world_from_cyclopean.tobytes(), scene.state, gripper


def _vignette(truth: Truth) -> Array32:
    """(H, W) share of light that reaches each pixel: 1 in the middle, less by sensor.vignette in the corners."""
    width, height = truth.image_size
    v, u = np.mgrid[0:height, 0:width].astype(np.float32)
    squared = (u - (width - 1) / 2) ** 2 + (v - (height - 1) / 2) ** 2
    return np.asarray(1 - np.float32(truth.sensor.vignette) * squared / squared.max())
