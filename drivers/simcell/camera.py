"""The simulated stereo camera: when frames are exposed, what the sensor makes of the light, and what can go wrong.

What is to be seen at a moment comes from the cell (`scene_at`); how light falls from render.py.
"""

from __future__ import annotations

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
from drivers.camera.pair import CameraError, EyeName, Frame, StereoPair
from drivers.simcell.light import CellLight
from drivers.simcell.optics import Array32, turned
from drivers.simcell.render import RenderedSolid, Retina, radiance
from drivers.simcell.rigid import angle_of, apply
from drivers.simcell.truth import Truth

EYES = ("left", "right")
BLACK_LEVEL = 4.0
Ailment = Literal["away", "frozen", "stale", "half"]
"""How an eye fails: it gives no frame, its last one for ever, what it saw last under fresh noise, or half of each."""
STILL_MM, STILL_RAD = 0.01, 2e-5
BLUR_STEPS = 6
SHORTEST, LONGEST = 1 / 64, 64.0
"""How long the shutter may be open, over what the truth's levels are given for; motion blur stays the truth's."""


@dataclass(frozen=True, eq=False)
class SimulatedScene:
    """What there is to see at a moment: where the cameras are, the things, and a mark that changes when those move.

    hand: what hangs from the arm beside the cameras; it is seen, but casts no shadow. covered: a plain cloth lies over
    the table's pattern.
    """

    world_from_cyclopean: Array
    things: tuple[RenderedSolid, ...]
    state: object
    hand: tuple[RenderedSolid, ...] = ()
    covered: bool = False


class SimulatedPair:
    """A stereo pair that honours drivers/camera/pair.py. Frames come at the sensor's rate on the given clock.

    time_scale: how much faster than the clock the cell lives; frame rate and exposure go with it.
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
        """table_pattern: what the table's pattern is drawn from; None: it is plain."""
        self._truth, self._scene_at, self._rng = truth, scene_at, rng
        self._clock, self._sleep = clock, sleep
        self._period_s = 1.0 / (truth.sensor.frame_rate_hz * time_scale)
        self._exposure_s = min(truth.sensor.exposure_s / time_scale, 0.9 * self._period_s)
        self._skew_s = truth.sensor.skew_s / time_scale
        self._started_s = clock()
        self._eyes = {"left": truth.left.eye(), "right": truth.right.eye()}
        self._retinas: dict[str, Retina] = {}
        self._light_of_cell = CellLight(truth.table, truth.lighting, table_pattern)
        self._lit_for: object = None
        self._seen: dict[str, tuple[object, Array32]] = {}
        self._vignette = _vignette(truth)
        self._covered: set[str] = set()
        self._opened = dict.fromkeys(EYES, 1.0)
        self._alone: EyeName | None = None
        self._ails: dict[str, Ailment] = {}
        self._shown: dict[str, NDArray[np.uint8]] = {}
        self._lit: dict[str, Array32] = {}
        self._unplugged = False
        self._is_open = False
        self._lock = Lock()

    def open(self) -> None:
        """Claim the cameras. Raises CameraError while they are unplugged."""
        if self._unplugged:
            raise CameraError("simulated pair: unplugged; plug it in again")
        self._is_open = True

    def close(self) -> None:
        """Release the cameras."""
        self._is_open = False

    def describe(self) -> str:
        """One line for people."""
        width, height = self._truth.image_size
        rate = self._truth.sensor.frame_rate_hz
        return f"simulated pair, {width}x{height} grey, {rate:g} frames/s of the cell's time"

    def grab(self, not_before_s: float, timeout_s: float) -> StereoPair:
        """The newest pair exposed wholly after not_before_s; waits for one where there is none yet.

        Raises CameraError where that would take longer than timeout_s, or the pair is closed or unplugged.
        """
        if not self._is_open:
            raise CameraError("simulated pair: not open")
        now = self._clock()
        lead, tail = self._exposure_s / 2, self._exposure_s / 2 + self._skew_s
        newest = floor((now - tail - self._started_s) / self._period_s)
        first = ceil((not_before_s + lead - self._started_s) / self._period_s)
        number = max(newest, first, 0)
        middle_s = self._started_s + number * self._period_s
        used = EYES if self._alone is None else (self._alone,)
        away = [eye for eye in used if self._ails.get(eye) == "away"]
        if self._unplugged or away or middle_s + tail - now > timeout_s:
            self._sleep(max(timeout_s, 0.0))
            cause = "unplugged" if self._unplugged else f"{away[0]} eye unplugged" if away else "no pair that late"
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

    def use(self, alone: EyeName | None) -> None:
        """See StereoCamera."""
        self._alone = alone

    def expose(self, left: float, right: float) -> tuple[float, float]:
        """Open the shutters so many times as long from the next frame on, within what such a sensor can."""
        with self._lock:
            before = dict(self._opened)
            for eye, factor in zip(EYES, (left, right), strict=True):
                self._opened[eye] = float(np.clip(before[eye] * factor, SHORTEST, LONGEST))
            return self._opened["left"] / before["left"], self._opened["right"] / before["right"]

    def cover(self, eye: str, covered: bool = True) -> None:
        """Put the lens cap on one eye, or take it off."""
        (self._covered.add if covered else self._covered.discard)(eye)

    def knock(self, eye: str, rotation_vector_deg: ArrayLike) -> None:
        """Turn one eye about its optical centre, for good: (3,) degrees about its own x (pitch), y (yaw), z (roll)."""
        with self._lock:
            self._eyes[eye] = turned(self._eyes[eye], rotation_vector_deg)
            self._retinas.pop(eye, None)
            self._seen.pop(eye, None)

    def ail(self, eye: str, how: Ailment | None) -> None:
        """Let an eye fail from the next frame on, or be well again."""
        with self._lock:
            self._ails.pop(eye, None)
            if how is not None:
                self._ails[eye] = how

    def unplug(self, unplugged: bool = True) -> None:
        """Pull the cable, or put it back."""
        self._unplugged = unplugged

    def _frame(self, eye: str, middle_s: float, number: int) -> Frame:
        light = np.full(self._vignette.shape, 0.0, np.float32) if eye in self._covered else self._light(eye, middle_s)
        light = self._lit[eye] = self._lit.get(eye, light) if self._ails.get(eye) == "stale" else light
        pixels = self._expose(light, getattr(self._truth.sensor, f"gain_{eye}") * self._opened[eye])
        how = self._ails.get(eye)
        if how == "frozen":
            pixels = self._shown.get(eye, pixels).copy()
        elif how == "half":
            pixels[len(pixels) // 2 :] = pixels[len(pixels) // 2]
        self._shown[eye] = pixels
        pixels.setflags(write=False)
        return Frame(pixels, middle_s, number)

    def _light(self, eye: str, middle_s: float) -> Array32:
        """The mean light over the exposure; one picture where the arm stands still."""
        half = self._exposure_s / 2
        scenes = [self._scene_at(middle_s - half), self._scene_at(middle_s + half)]
        if _moves(scenes):
            steps = np.linspace(-half, half, BLUR_STEPS)
            seen = [self._see(eye, self._scene_at(middle_s + step)) for step in steps]
            return np.asarray(np.mean(seen, axis=0), np.float32)
        return self._see(eye, scenes[0])

    def _see(self, eye: str, scene: SimulatedScene) -> Array32:
        """The light that reaches an eye; worked out anew only where something moved since that eye saw last."""
        mark = _mark(scene)
        seen = self._seen.get(eye)
        if seen is not None and seen[0] == mark:
            return seen[1]
        if eye not in self._retinas:
            self._retinas[eye] = Retina(self._eyes[eye], *self._truth.image_size)
        if scene.state != self._lit_for:
            bodies = [apply(thing.world_from_solid, thing.solid.vertices) for thing in scene.things]
            self._light_of_cell.cast(bodies, scene.covered)
            self._lit_for = scene.state
        things = (*scene.things, *scene.hand)
        light = radiance(self._retinas[eye], scene.world_from_cyclopean, things, self._light_of_cell)
        self._seen[eye] = mark, light
        return light

    def _expose(self, light: Array32, gain: float) -> NDArray[np.uint8]:
        sensor = self._truth.sensor
        soft = cv2.GaussianBlur(light, (0, 0), sensor.blur_px, borderType=cv2.BORDER_REPLICATE)
        level = soft * self._vignette * np.float32(gain) + np.float32(BLACK_LEVEL)
        sigma = np.sqrt(np.float32(sensor.read_noise**2) + np.float32(sensor.photon_noise) * level)
        noisy = level + sigma * self._rng.standard_normal(level.shape, dtype=np.float32)
        return np.asarray(np.clip(np.round(noisy), 0, 255), np.uint8)


def _moves(scenes: Sequence[SimulatedScene]) -> bool:
    first, last = (scene.world_from_cyclopean for scene in scenes)
    shift = float(np.linalg.norm(first[:3, 3] - last[:3, 3]))
    return shift > STILL_MM or angle_of(first[:3, :3].T @ last[:3, :3]) > STILL_RAD


def _mark(scene: SimulatedScene) -> object:
    """Equal for two scenes that look the same to the last bit."""
    hand = [part.tobytes() for thing in scene.hand for part in (thing.world_from_solid, thing.solid.vertices)]
    return scene.world_from_cyclopean.tobytes(), scene.state, hand


def _vignette(truth: Truth) -> Array32:
    """(H, W) share of light that reaches each pixel: 1 in the middle, less by sensor.vignette in the corners."""
    width, height = truth.image_size
    v, u = np.mgrid[0:height, 0:width].astype(np.float32)
    squared = (u - (width - 1) / 2) ** 2 + (v - (height - 1) / 2) ** 2
    shade: Array32 = 1 - np.float32(truth.sensor.vignette) * squared / squared.max()
    return shade
