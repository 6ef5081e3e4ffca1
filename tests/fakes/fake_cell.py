"""A fake Workcell for tests of the pick cycle: an arm that jumps, cameras that see the truth with noise, a log in a
list.

It uses no driver but the shapes of the parts. Tests inject faults by `World.before`.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any
from unittest.mock import patch

import numpy as np

from daemon import frames
from daemon.arm.belief import Beliefs, Reading
from daemon.arm.motion import Mover
from daemon.arm.mounting import InWorld, OnHand
from daemon.arm.permission import Grant, MotionPermission
from daemon.arm.workcell import Workcell
from daemon.pick import set_down, take
from daemon.pick.cycle import PickCycle
from daemon.pick.following import CameraMount, Target, shows_in_gripper, shows_release
from daemon.pick.grippers.two_fingers import tool_rotation
from daemon.pick.looks import CapturedPair
from daemon.pick.pose_fusion import Doubt
from daemon.pick.settings import Settings
from daemon.vision.geometry.polyhedron import Polyhedron, exact
from daemon.vision.geometry.rig import Camera, StereoRig
from daemon.vision.values import Facet, FacetView, Part, Recognition, Scene
from drivers import puma560
from drivers.simcell import parts
from tests.fakes.checked_record import checked

PITCH = np.arcsin(75 / 350)
TOOL_FROM_CYCLOPEAN = frames.rigid(
    np.column_stack([[0, 1, 0], [-np.cos(PITCH), 0, np.sin(PITCH)], [np.sin(PITCH), 0, np.cos(PITCH)]]),
    np.array([-75.0, 0.0, -110.0]),
)
ON_HAND = OnHand(TOOL_FROM_CYCLOPEAN)
HEAD_DOWN = frames.rigid(tool_rotation(np.array([1.0, 0, 0]), 0.3), np.array([420.0, 0.0, 60.0]))

TABLE_MM = np.array([520.0, 0.0, -300.0])


def rig() -> StereoRig:
    """640x480, f 700 px, baseline 60 mm, parallel."""
    matrix = np.array([[700.0, 0, 319.5], [0, 700.0, 239.5], [0, 0, 1]])
    cameras = [Camera(matrix, np.zeros(5), frames.rigid(np.eye(3), np.array([x, 0.0, 0.0]))) for x in (-30.0, 30.0)]
    return StereoRig(cameras[0], cameras[1], (640, 480))


def shape_of(label: str) -> Polyhedron:
    """A part's full shape."""
    hull = parts.part_shape(label).hull
    return exact(hull.vertices, hull.faces)


NOISE = [np.random.default_rng(k).normal(100.0, 2.0, (480, 640)).astype(np.uint8) for k in range(5)]
"""Empty images; an odd number, so that no camera returns the same one twice in a row."""


@dataclass(frozen=True, eq=False)
class FakePicture:
    pixels: np.ndarray
    taken_s: float


@dataclass(frozen=True, eq=False)
class FakePair:
    left: FakePicture
    right: FakePicture
    of: Any = None
    """The world in which the image was taken."""
    held: str | None = None
    """The part in the gripper at that time."""


@dataclass(eq=False)
class World:
    """What is so. wire: every act of the arm or hand as it leaves; before(name): may raise or act before an act; fixed:
    world_from_cyclopean of cameras over the table, None: they are on the hand."""

    rng: np.random.Generator
    lying: dict[str, np.ndarray] = field(default_factory=dict)
    at: np.ndarray = field(default_factory=HEAD_DOWN.copy)
    held: str | None = None
    closed: bool = False
    binned: list[str] = field(default_factory=list)
    wire: list[tuple[str, Any]] = field(default_factory=list)
    now_s: float = 0.0
    arm_sigma_mm: float = 0.05
    corner_px: float = 0.1
    tool_from_cyclopean: np.ndarray = field(default_factory=TOOL_FROM_CYCLOPEAN.copy)
    fixed: np.ndarray | None = None
    labels: dict[str, Recognition] = field(default_factory=dict)
    slippery: int = 0
    before: Callable[[str], None] = lambda name: None
    records: list[dict[str, Any]] = field(default_factory=list)
    epipolar: float = 0.1
    reach_mm: float = 900.0
    unreached: np.ndarray | None = None
    most_seen: int = 9
    light: tuple[float, float] = (1.0, 1.0)

    def put(self, label: str, x: float, y: float, turn: float, rest: int = 0) -> None:
        """Place a part on the table."""
        lies = parts.part_shape(label).rests[rest]
        spin = frames.rigid(frames.rotation_from_vector(np.array([0, 0, turn])), np.array([x, y, -300.0]))
        self.lying[label] = spin @ lies

    def clock(self) -> float:
        self.now_s += 0.001
        return self.now_s

    def record(self, kind: str, /, **fields: Any) -> None:
        checked(kind, fields)
        self.records.append({"kind": kind, **fields})

    def said(self, kind: str) -> list[dict[str, Any]]:
        return [r for r in self.records if r["kind"] == kind]


ARM = puma560.ArmGeometry(flange_from_tool=frames.rigid(np.eye(3), np.array([0.0, 0.0, 130.0])))


def joints(world_from_tool: np.ndarray, near_rad: np.ndarray | None = None) -> np.ndarray:
    """The six joints of a righty arm with its elbow above, turned as little as may be; nan where it does not get
    there."""
    try:
        return puma560.inverse(world_from_tool, puma560.Configuration(), ARM, near_rad)
    except puma560.UnreachableError:
        return np.full(6, np.nan)


class FakeRobot:
    """Jumps. A hand closed within 15 mm of a part's middle takes it, unless it is slippery."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.beliefs = Beliefs(lambda: world.now_s, world.record)
        self.permission = MotionPermission()
        self.permission.stop_tests = 1
        self._before: np.ndarray | None = None

    controller = None
    heard_s: float | None = None
    connected = True
    aside = stopped_on_opening = False

    async def open(self) -> None:
        """There is no line."""
        self.heard_s = self.world.clock()

    close = check = open

    async def set_outputs(self, numbers: Sequence[int]) -> None:
        """Nothing is wired to it."""

    work_valves = set_outputs

    async def ask_input(self, text: str) -> str:
        return "0"

    def use_tool(self, flange_from_tool: np.ndarray) -> None:
        """Every tool's point is where this one's is."""

    def _joints(self, world_from_tool: np.ndarray) -> np.ndarray:
        """The present joints, nearest to the previous ones."""
        here = joints(world_from_tool, self._before)
        if np.isfinite(here).all():
            self._before = here
        return here

    async def where(self) -> Reading:
        self.world.before("where")
        return Reading(self.world.at.copy(), self._joints(self.world.at))

    async def wait_until_at_rest(self) -> Reading:
        return await FakeRobot.where(self)

    async def move(self, command, starts, timeout_s, then=None):
        world_from_tool = command.world_from_tool
        self.world.before("move")
        starts(Reading(self.world.at.copy(), self._joints(self.world.at)))
        self.world.wire.append(("move", world_from_tool.copy()))
        await asyncio.sleep(0)
        self.world.now_s += 0.3
        self.world.before("moving")
        jitter = self.world.rng.normal(0, self.world.arm_sigma_mm, 3)
        self.world.at = frames.perturb(world_from_tool, np.concatenate([jitter, np.zeros(3)]))
        self.world.before("moved")
        return Reading(world_from_tool.copy(), self._joints(world_from_tool))

    async def set_gripper(self, closed: bool) -> None:
        world = self.world
        world.before("hand")
        world.wire.append(("hand", closed))
        if closed:
            for label, pose in world.lying.items():
                middle = frames.apply(pose, parts.part_shape(label).hull.vertices).mean(axis=0)
                if np.linalg.norm(middle - world.at[:3, 3]) < 15.0:
                    if world.slippery > 0:
                        world.slippery -= 1
                    else:
                        world.held = label
        elif world.held is not None:
            world.binned.append(world.held)
            world.held = None
        if world.held is not None:
            world.lying.pop(world.held, None)
        world.closed = closed
        world.before("handed")

    async def at_rest(self) -> bool:
        self.world.before("at rest")
        return True

    async def test_stop(self) -> None:
        self.world.before("prove")
        self.permission.stop_tests = self.permission.stop_tests or 2

    async def stop_motion(self) -> None:
        self.world.wire.append(("abort", None))
        self.world.before("abort")

    @property
    def kinematics(self):
        return self

    def reachable(self, world_from_tool, joints_rad):
        forbidden = self.world.unreached
        if forbidden is not None and np.linalg.norm(world_from_tool[:3, 3] - forbidden) < 40.0:
            return None
        if np.linalg.norm(world_from_tool[:3, 3]) > self.world.reach_mm:
            return None
        try:
            return puma560.inverse(world_from_tool, puma560.configuration_of(joints_rad), ARM, joints_rad)
        except puma560.UnreachableError:
            return None

    def between(self, joints_rad, to_rad, share):
        return puma560.forward(joints_rad + share * (to_rad - joints_rad), ARM)

    def frames(self, joints_rad):
        return puma560.link_frames(joints_rad, ARM)

    def along(self, world_from_tool, joints_rad):
        joints = puma560.inverse_along(world_from_tool, joints_rad, ARM)
        points, forbidden = world_from_tool[:, :3, 3], self.world.unreached
        if forbidden is not None:
            joints[np.linalg.norm(points - forbidden, axis=1) < 40.0] = np.nan
        joints[np.linalg.norm(points, axis=1) > self.world.reach_mm] = np.nan
        return joints


class FakeCameras:
    """Cameras that return grey pairs with different noise: always settled, and without an edge."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.shaking = self.grabs = 0

    async def grab(self, not_before_s: float, timeout_s: float) -> FakePair:
        self.world.before("grab")
        self.world.now_s = max(self.world.now_s, not_before_s) + 0.03
        self.grabs += 1
        images = [NOISE[(2 * self.grabs + camera) % len(NOISE)] for camera in (0, 1)]
        if self.shaking > 0:
            self.shaking -= 1
            images = [image.copy() for image in images]
            for image in images:
                image[:, 200 + 10 * (self.shaking % 30) :] += 100
        if self.world.light != (1.0, 1.0):
            images = [(i * f).clip(0, 255).astype(np.uint8) for i, f in zip(images, self.world.light, strict=True)]
        left, right = (FakePicture(i, self.world.now_s) for i in images)
        return FakePair(left, right, self.world, self.world.held)

    async def expose(self, left: float, right: float) -> tuple[float, float] | None:
        self.world.before("expose")
        self.world.light = self.world.light[0] * left, self.world.light[1] * right
        return left, right


class TruthRecogniser:
    """A recogniser that reports the truth: every facet that faces the cameras, with a stereo pair's corner noise."""

    def __init__(self, world: World, labels: tuple[str, ...] = parts.TAUGHT) -> None:
        self.world, self.labels = world, labels

    def shape(self, label: str) -> Polyhedron | None:
        return shape_of(label) if label in self.labels else None

    def recognise(self, group):
        facets, pose = group.facets, np.eye(4)
        pose[:3, 3] = group.polyhedron.corners_mm.mean(0)
        unknown = Recognition("unknown", 0.0, 0.0, 0.0, None, False, "facets alone have no name here")
        return (Part(unknown, facets, pose, np.eye(6), float("nan")),)

    def candidate_poses(self, group):
        return ()

    def report(self, scene: Scene) -> dict[str, object]:
        return {"parts": [p.recognition.label for p in scene.parts]}

    def see(self, left, right, table=None, rig=None) -> Scene:
        world = self.world
        world.before("see")
        cameras = world.at @ world.tool_from_cyclopean if world.fixed is None else world.fixed
        cyclopean_from_world = frames.inverse(cameras)
        seen = [self._part(label, cyclopean_from_world @ pose) for label, pose in world.lying.items()]
        visible = tuple(p for p in seen if p is not None)
        return Scene(visible, (), FacetView((), (), (), (), 2.0))

    def _part(self, label: str, cyclopean_from_part: np.ndarray) -> Part | None:
        world, shape = self.world, shape_of(label)
        middle = cyclopean_from_part[:3, 3]
        if middle[2] < 100 or abs(middle[0] / middle[2]) > 0.4 or abs(middle[1] / middle[2]) > 0.3:
            return None
        facets = []
        for indices, normal in zip(shape.rings, shape.normals, strict=True):
            corners = frames.apply(cyclopean_from_part, shape.corners_mm[indices])
            if (cyclopean_from_part[:3, :3] @ normal) @ corners.mean(axis=0) / np.linalg.norm(
                corners.mean(axis=0)
            ) < -0.25:
                facets.append(self._facet(corners))
        if not facets:
            return None
        facets = facets[: world.most_seen]
        known = Recognition(label, 0.97, 1.0, 0.99, None, False, "truth", (label,))
        covariance = np.diag(self._pose_sigmas(float(middle[2])) ** 2)
        pose = frames.perturb(cyclopean_from_part, world.rng.normal(0, 1, 6) * self._pose_sigmas(float(middle[2])))
        return Part(world.labels.get(label, known), tuple(facets), pose, covariance, 0.2)

    def _pose_sigmas(self, z_mm: float) -> np.ndarray:
        """(6,) mm and rad: of a pose by some corners that err as _facet has it, 40 mm apart."""
        across = z_mm / 700.0 * self.world.corner_px
        away = across * z_mm / 60.0 * 1.4
        return np.array([across, across, away, away / 40.0, away / 40.0, across / 40.0]) / 2.0

    def _facet(self, corners: np.ndarray) -> Facet:
        z = corners[:, 2] / 700.0 * self.world.corner_px
        sigmas = np.column_stack([z, z, z * corners[:, 2] / 60.0 * 1.4])
        noisy = corners + self.world.rng.normal(0, 1, corners.shape) * sigmas
        covariance = np.array([np.diag(s**2) for s in sigmas])
        left, right = (camera.project(noisy) for camera in (rig().left, rig().right))
        return Facet(noisy, covariance, left, right, np.full(len(corners), self.world.epipolar), 0.1)


def truly_in_hand(target: Target, taken: CapturedPair, mount: CameraMount, doubt: Doubt) -> bool:
    """The result of a look at the gripper: the truth, because a fake cell's images are empty."""
    world: Any = getattr(taken.pictures, "of", None)
    if world is None:
        return shows_in_gripper(target, taken, mount, doubt)
    return bool(taken.pictures.held == target.label)  # type: ignore[attr-defined]


def truly_left_hand(
    target: Target, before: CapturedPair, after: CapturedPair, mount: CameraMount, doubt: Doubt
) -> bool:
    """The result of two looks, between which the gripper opened: the truth."""
    pairs: list[Any] = [before.pictures, after.pictures]
    if getattr(pairs[0], "of", None) is None:
        return shows_release(target, before, after, mount, doubt)
    return [pair.held for pair in pairs] == [target.label, None]


# Wherever a fake cell is at work; any other is looked at as it is.
for module, name, truth in (
    (take, "shows_in_gripper", truly_in_hand),
    (take, "shows_release", truly_left_hand),
    (set_down, "shows_in_gripper", truly_in_hand),
):
    patch.object(module, name, truth).start()


def build(world: World) -> Workcell:
    """The Workcell of this world."""
    cameras, mounting = (
        FakeCameras(world),
        ON_HAND if world.fixed is None else InWorld(world.fixed, HEAD_DOWN, TABLE_MM),
    )
    return Workcell(FakeRobot(world), cameras, world, world.clock, rig(), mounting, asyncio.to_thread)


def cameras_of(cell: Workcell) -> FakeCameras:
    """The cameras of a cell that `build` made."""
    assert isinstance(cell.cameras, FakeCameras)
    return cell.cameras


def permitted(mover: Mover) -> Mover:
    """A motion permission that permits motion."""
    mover.permission.grant(Grant.ALL)
    return mover


def cycle_of(world: World, settings: Settings | None = None) -> PickCycle:
    """An enabled pick cycle in this world."""
    cycle = PickCycle(build(world), settings or Settings(), TruthRecogniser(world))
    cycle.supervisor.enable()
    return cycle


def one_part(label: str = "cube", seed: int = 0) -> World:
    """A world with one part that the arm reaches well."""
    world = World(np.random.default_rng(seed))
    world.put(label, 520, 0, 0.4)
    return world
