"""Parts of the simulated cell: on the table, in the gripper, in the bin; what the gripper does to them.

Poses only; the caller passes the pose of the tool.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from itertools import count
from threading import RLock

import numpy as np

from drivers.arrays import Array
from drivers.rigid import apply, inverse, rigid, turn
from drivers.simcell.gripper import Grip, close_on, reaches, strikes
from drivers.simcell.parts import PartShape, part_shape
from drivers.simcell.suction import cup_strikes, holds, suck
from drivers.simcell.truth import SuctionTruth, Truth

FLOOR_BELOW_TABLE_MM = 700.0
GRIPPER_REACH_MM = 130.0
LIFTED_MM = 1.0
"""Lower than this a part still leans on the table."""
GAP_MM = 30.0
"""Least distance of scattered parts where there is space for it."""
EQUAL_MM = 0.01
"""Centres of mass of poses that look the same are as high as each other, but for rounding."""
TOUCH_MM = 0.1
"""Parts that touch one another by no more than rounding do not overlap."""


class PartPlace(Enum):
    """Where a part is."""

    TABLE = "table"
    STAND = "stand"
    HAND = "hand"
    BIN = "bin"
    FLOOR = "floor"


@dataclass(frozen=True, eq=False)
class PlacedPart:
    """One part: name in this cell, label, shape, place. For a part in the gripper, pose is tool_from_part."""

    name: str
    label: str
    shape: PartShape
    where: PartPlace
    pose: Array

    def world_from_part(self, world_from_tool: Array) -> Array:
        """(4, 4) mm."""
        return world_from_tool @ self.pose if self.where is PartPlace.HAND else self.pose


@dataclass(frozen=True, eq=False)
class Closing:
    """One closing of the gripper: the part in it, with its pose before, and the grip; None where there was no part."""

    part: PlacedPart | None
    grip: Grip | None

    @property
    def held(self) -> bool:
        return self.grip is not None and self.grip.held


class World:
    """The parts of the cell. Thread-safe."""

    def __init__(self, truth: Truth, on_held: Callable[[PlacedPart | None], None] = lambda held: None) -> None:
        """on_held: called with the part in the gripper, or None, at each change."""
        self._truth, self._on_held = truth, on_held
        self._held: PlacedPart | None = None
        """The last argument of on_held."""
        self._lock = RLock()
        self._parts: dict[str, PlacedPart] = {}
        self._drawn: dict[str, PartShape] = {}
        self._count = 0
        self.changes = 0
        self.gap_mm = truth.gripper.opening_mm
        self.closings: list[Closing] = []
        self.strikes: list[str] = []

    @property
    def parts(self) -> tuple[PlacedPart, ...]:
        """All parts, in the order of their creation."""
        with self._lock:
            return tuple(self._parts.values())

    @property
    def held(self) -> PlacedPart | None:
        return next((part for part in self.parts if part.where is PartPlace.HAND), None)

    def mount(self, truth: Truth) -> None:
        """Go on with another gripper, open. What the one before held goes with it."""
        with self._lock:
            self._truth, self.gap_mm = truth, truth.gripper.opening_mm
            if self.held is not None:
                del self._parts[self.held.name]
            self._changed()

    def clear(self) -> None:
        with self._lock:
            self._parts.clear()
            self._changed()

    def draw(self, shapes: Sequence[PartShape]) -> None:
        """Add shapes from drawings, which override built-in ones of the same label; parts on the table stay."""
        with self._lock:
            self._drawn = {shape.label: shape for shape in shapes}

    def drawn(self, label: str) -> bool:
        return label in self._drawn

    def shape(self, label: str) -> PartShape:
        """The shape of a label. Raises KeyError."""
        with self._lock:
            return self._drawn.get(label) or part_shape(label)

    def put(self, label: str, world_from_part: Array, where: PartPlace = PartPlace.TABLE) -> PlacedPart:
        """Add a new part. Raises KeyError for a label without a shape."""
        with self._lock:
            self._count += 1
            part = PlacedPart(f"{label}-{self._count}", label, self.shape(label), where, world_from_part)
            self._set(part)
            return part

    def stand(self, label: str, rest: int, x_mm: float, y_mm: float, turn_rad: float) -> PlacedPart:
        """Add a new part on the table, on its rest-th stable face, turned about the vertical."""
        foot = rigid(turn([0, 0, 1], turn_rad), [x_mm, y_mm, self._truth.table.height_mm])
        return self.put(label, foot @ self.shape(label).rests[rest])

    def scatter(self, labels: Sequence[str], rng: np.random.Generator, steady: bool = False) -> None:
        """Scatter new parts over the table: on random stable faces (steady: on those that leave the centre of mass
        lowest), at least GAP_MM apart, or as far as there is space."""
        reaches_mm = [_reach_mm(self.shape(label)) for label in labels]
        tries = (self._free_spots(reaches_mm, rng, gap_mm) for gap_mm in count(GAP_MM, -5.0))
        spots = next(spots for spots in tries if spots is not None)
        for label, (x, y) in zip(labels, spots, strict=True):
            shape = self.shape(label)
            rests = lowest_rests(shape) if steady else range(len(shape.rests))
            rest = rests[int(rng.integers(len(rests)))]
            self.stand(label, rest, x, y, rng.uniform(-np.pi, np.pi))

    def nudge(self, name: str, x_mm: float, y_mm: float, turn_rad: float = 0.0) -> None:
        """Shift a part along the table and turn it about the vertical through its centre of mass."""
        with self._lock:
            part = self._parts[name]
            centre = apply(part.pose, part.shape.centre_of_mass)
            about = rigid(turn([0, 0, 1], turn_rad), centre + np.array([x_mm, y_mm, 0.0])) @ rigid(np.eye(3), -centre)
            self._set(replace(part, pose=about @ part.pose))

    def bring_back(self, parts: Sequence[PlacedPart]) -> None:
        """Put earlier parts back in their places."""
        with self._lock:
            for part in parts:
                self._set(part)

    def remove(self, name: str) -> None:
        with self._lock:
            del self._parts[name]
            self._changed()

    def close_hand(self, world_from_tool: Array, path: Sequence[Array] = ()) -> None:
        """Close the jaws, or switch the vacuum on, at a pose; the result is the last of `closings`.

        path: poses (4, 4) through which the open gripper came, checked for collisions.
        """
        with self._lock:
            self._record_strikes([*path, world_from_tool])
            if self._truth.suction is not None:
                self._operate_cup(world_from_tool, self._truth.suction)
                return
            tool_from_world = inverse(world_from_tool)
            near = [
                part
                for part in self._reachable()
                if reaches(part.shape, tool_from_world @ part.pose, self._truth.gripper)
            ]
            if self.held:
                return
            closing = Closing(near[0], self._close_on(near, world_from_tool)) if near else Closing(None, None)
            self.closings.append(closing)
            self.gap_mm = closing.grip.width_mm if closing.grip else 0.0

    def why_lost(self, world_from_tool: Array) -> str:
        """Why the vacuum loses the lifted part with the tool there; empty where it holds it, or nothing is lifted."""
        with self._lock:
            held, cup = self.held, self._truth.suction
            if held is None or cup is None:
                return ""
            lowest = float(apply(world_from_tool @ held.pose, held.shape.hull.vertices)[:, 2].min())
            if lowest < self._truth.table.height_mm + LIFTED_MM:
                return ""
            return holds(held.shape, held.pose, -world_from_tool[2, :3], cup)

    def lose(self, world_from_tool: Array) -> tuple[str, float, PartPlace] | None:
        """Drop the held part although the gripper was not opened. Returns what open_hand returns."""
        with self._lock:
            return self._drop(self.held, world_from_tool) if self.held else None

    def open_hand(self, world_from_tool: Array) -> tuple[str, float, PartPlace] | None:
        """Open the jaws, or blow off, and drop the held part. Returns its label, its height above the table, its new
        place."""
        with self._lock:
            self.gap_mm = self._truth.gripper.opening_mm
            return self._drop(self.held, world_from_tool) if self.held else None

    def _reachable(self) -> list[PlacedPart]:
        """Parts that the gripper may meet: on the table or the stand."""
        return [part for part in self.parts if part.where in (PartPlace.TABLE, PartPlace.STAND)]

    def _set(self, part: PlacedPart) -> None:
        self._parts[part.name] = part
        self._changed()

    def _changed(self) -> None:
        self.changes += 1
        if self.held is not self._held:
            self._held = self.held
            self._on_held(self._held)

    def _operate_cup(self, world_from_tool: Array, cup: SuctionTruth) -> None:
        if self.held:
            return
        tool_from_world = inverse(world_from_tool)
        near = [p for p in self._reachable() if np.linalg.norm((tool_from_world @ p.pose)[:3, 3]) < GRIPPER_REACH_MM]
        touched = [(p, grip) for p in near if (grip := suck(p.shape, tool_from_world @ p.pose, cup)) is not None]
        part, grip = touched[0] if touched else (None, None)
        if grip is not None and len(touched) > 1:
            grip = replace(grip, held=False, why="more than one part at the lip")
        self.closings.append(Closing(part, grip))
        if part is not None and grip is not None and grip.held:
            self._set(replace(part, where=PartPlace.HAND, pose=grip.tool_from_part))

    def _close_on(self, near: Sequence[PlacedPart], world_from_tool: Array) -> Grip:
        part, tool_from_world = near[0], inverse(world_from_tool)
        tool_from_part = tool_from_world @ part.pose
        if len(near) > 1:
            return Grip(False, "more than one part between the jaws", tool_from_part, tool_from_part)
        grip = close_on(part.shape, tool_from_part, tool_from_world[:3, 2], self._truth.gripper)
        if grip.held:
            self._set(replace(part, where=PartPlace.HAND, pose=grip.tool_from_part))
        elif grip.shift_mm and part.where is PartPlace.TABLE:
            push = world_from_tool[:3, 1] * grip.shift_mm
            self.nudge(part.name, push[0], push[1])
        return grip

    def _drop(self, part: PlacedPart, world_from_tool: Array) -> tuple[str, float, PartPlace]:
        pose = world_from_tool @ part.pose
        x, y, _ = apply(pose, part.shape.centre_of_mass)
        table, bin_ = self._truth.table, self._truth.bin
        if np.all(np.abs(np.array([x, y]) - bin_.centre_mm) <= np.array(bin_.size_mm) / 2):
            where = PartPlace.BIN
        elif np.all(np.abs(np.array([x, y]) - table.centre_mm) <= table.half_size_mm):
            where = PartPlace.TABLE
        else:
            where = PartPlace.FLOOR
        landed = settle(part.shape, pose, table.height_mm)
        if where is PartPlace.FLOOR:
            landed[2, 3] -= FLOOR_BELOW_TABLE_MM
        self._set(replace(part, where=where, pose=landed))
        if where is PartPlace.TABLE:
            self._push_apart(part.name)
        return part.label, float(apply(pose, part.shape.hull.vertices)[:, 2].min()) - table.height_mm, where

    def _push_apart(self, name: str) -> None:
        """Move a part that fell on others away from the nearest until it is free."""
        for _ in range(100):
            part = self._parts[name]
            here = part.pose[:2, 3]
            others = [p for p in self._parts.values() if p.name != name and p.where is PartPlace.TABLE]
            near = [p for p in others if _overlap(p, part)]
            if not near:
                return
            away = here - near[0].pose[:2, 3]
            away = away / np.linalg.norm(away) if np.linalg.norm(away) > 1e-6 else np.array([1.0, 0.0])
            self.nudge(name, *(5.0 * away))

    def _record_strikes(self, path: Sequence[Array]) -> None:
        gripper, cup = self._truth.gripper, self._truth.suction
        outer, tip = gripper.opening_mm / 2 + gripper.finger_thickness_mm, gripper.tip_mm
        if cup is not None:
            outer, tip = cup.radius_mm, -cup.lip_mm
        tips = np.array([[0.0, side * outer, tip] for side in (-1, 1)])
        if min(apply(pose, tips)[:, 2].min() for pose in path) < self._truth.table.height_mm:
            self.strikes.append("the gripper runs into the table")
        for part in self._reachable():
            if any(self._strikes(part, pose) for pose in path):
                self.strikes.append(f"{part.name}: the gripper or the palm runs into it")

    def _strikes(self, part: PlacedPart, world_from_tool: Array) -> bool:
        tool_from_part = inverse(world_from_tool) @ part.pose
        near = np.linalg.norm(tool_from_part[:3, 3]) < GRIPPER_REACH_MM + _reach_mm(part.shape)
        if not near:
            return False
        if self._truth.suction is not None:
            return cup_strikes(part.shape, tool_from_part, self._truth.suction)
        return strikes(part.shape, tool_from_part, self._truth.gripper)

    def _free_spots(self, reaches_mm: Sequence[float], rng: np.random.Generator, gap_mm: float) -> list[Array] | None:
        taken = [(part.pose[:2, 3], _reach_mm(part.shape)) for part in self._reachable()]
        spots: list[Array] = []
        table = self._truth.table
        for reach in reaches_mm:
            for _ in range(200):
                angle, radius = rng.uniform(-np.pi, np.pi), table.scatter_radius_mm * np.sqrt(rng.uniform())
                spot = np.array(table.centre_mm) + radius * np.array([np.cos(angle), np.sin(angle)])
                if all(np.linalg.norm(spot - other) > reach + size + gap_mm for other, size in taken):
                    break
            else:
                return None
            taken.append((spot, reach))
            spots.append(spot)
        return spots


def settle(shape: PartShape, world_from_part: Array, height_mm: float) -> Array:
    """The pose (4, 4) of a dropped part: on the stable face that points down most, with its centre of mass where it
    was."""
    turned_down = [rest[:3, :3].T @ np.array([0.0, 0.0, -1.0]) for rest in shape.rests]
    steepness = [-(world_from_part[:3, :3] @ down)[2] for down in turned_down]
    rest = shape.rests[int(np.argmax(steepness))]
    world_from_rest = world_from_part[:3, :3] @ rest[:3, :3].T
    heading = np.arctan2(world_from_rest[1, 0] - world_from_rest[0, 1], world_from_rest[0, 0] + world_from_rest[1, 1])
    x, y, _ = apply(world_from_part, shape.centre_of_mass)
    return rigid(turn([0, 0, 1], heading), [x, y, height_mm]) @ rest


def lowest_rests(shape: PartShape) -> list[int]:
    """The numbers of the stable poses that leave the centre of mass lowest."""
    heights = [float(apply(rest, shape.centre_of_mass)[2]) for rest in shape.rests]
    return [k for k, height_mm in enumerate(heights) if height_mm < min(heights) + EQUAL_MM]


def _reach_mm(shape: PartShape) -> float:
    """Radius of the vertical cylinder about the centre of mass that contains the part in any pose."""
    return float(np.linalg.norm(shape.hull.vertices - shape.centre_of_mass, axis=1).max())


def _overlap(one: PlacedPart, other: PlacedPart) -> bool:
    """Whether two parts on the table overlap from above, as their hulls: no edge of either has them on its two sides.
    Source: Gottschalk, Lin, Manocha, OBBTree, SIGGRAPH 1996 (separating axes)."""
    points = [apply(part.pose, part.shape.hull.vertices)[:, :2] for part in (one, other)]
    faces = [(at, list(face)) for part, at in zip((one, other), points, strict=True) for face in part.shape.hull.faces]
    edges = np.concatenate([at[face] - np.roll(at[face], -1, axis=0) for at, face in faces])
    edges = edges[np.linalg.norm(edges, axis=1) > TOUCH_MM]
    across = np.column_stack([-edges[:, 1], edges[:, 0]]) / np.linalg.norm(edges, axis=1)[:, None]
    a, b = (at @ across.T for at in points)
    return bool(((a.max(axis=0) > b.min(axis=0) + TOUCH_MM) & (b.max(axis=0) > a.min(axis=0) + TOUCH_MM)).all())
