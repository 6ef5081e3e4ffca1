"""Observed parts in the world frame: which are the same part, their order, which a new look should show again.

Pure. find.py chooses among them; following.py follows one part.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from daemon import frames
from daemon.arrays import Array
from daemon.pick.looks import Look
from daemon.vision.geometry import FACING, newell_normal
from daemon.vision.values import Facet, Part, Recognition

SAME_PLACE_MM = 30.0
"""Objects nearer to each other than this, in two looks, are the same."""
NEIGHBOUR_MM, RIM_PX = 100.0, 30.0
"""How near an object must be to a part to obstruct the fingers; how far inside an image a part must be to be
missing."""


def apart_mm(a: Array, b: Array) -> float:
    """Distance of two points (3,)."""
    return float(np.linalg.norm(a - b))


def same_place(a: Array, b: Array, within_mm: float = SAME_PLACE_MM) -> bool:
    """Whether two positions (3,), mm, are of the same object."""
    return apart_mm(a, b) < within_mm


@dataclass(frozen=True, eq=False)
class ObservedPart:
    """A part as one look shows it, in the world frame."""

    part: Part
    look: Look

    @property
    def recognition(self) -> Recognition:
        """What it was taken for, how surely and why."""
        return self.part.recognition

    @property
    def label(self) -> str:
        return self.recognition.label

    @property
    def named(self) -> bool:
        """Whether it was recognised as one taught part."""
        return self.part.named and not self.recognition.ambiguous

    @property
    def world_from_part(self) -> Array:
        """(4, 4) mm."""
        return self.look.world_from_cyclopean @ self.part.cyclopean_from_part

    @property
    def facets(self) -> tuple[Facet, ...]:
        """As measured, in the look's cyclopean frame."""
        return self.part.facets

    @property
    def lone(self) -> bool:
        """Whether it is a single facet without a name: perhaps none at all."""
        return not self.named and len(self.facets) == 1

    @property
    def centre(self) -> Array:
        """(3,) world, mm: mean of the seen corners."""
        return np.asarray(self.corners.mean(axis=0))

    @property
    def corners(self) -> Array:
        """(N, 3) world, mm: the seen corners."""
        return frames.apply(self.look.world_from_cyclopean, np.concatenate([f.corners_mm for f in self.facets]))


@dataclass(frozen=True, eq=False)
class Facing:
    """A facet in the world: its centre (3,) mm and outward unit normal (3,)."""

    centre: Array
    normal: Array


def facings(part: ObservedPart) -> list[Facing]:
    """The facets a look saw of a part."""
    turn = part.look.world_from_cyclopean
    found = []
    for facet in part.facets:
        corners = frames.apply(turn, facet.corners_mm)
        found.append(Facing(corners.mean(axis=0), newell_normal(corners)))
    return found


def is_facet_of(other: ObservedPart, part: ObservedPart) -> bool:
    """Whether an observed object is a facet of a named part, measured inaccurately: a single unnamed facet whose centre
    is within the part's radius. Otherwise it would obstruct every grasp."""
    reach = float(np.linalg.norm(part.corners - part.centre, axis=1).max())
    return other.lone and same_place(other.centre, part.centre, reach)


def visible_share(seen: Sequence[Facing], viewpoint: Array) -> float:
    """How well the facets separated before would show from the viewpoint (3,), world: 0 to 1, their mean."""
    if not seen:
        return 0.0
    rays = [viewpoint - f.centre for f in seen]
    cosines = [float(f.normal @ ray) / float(np.linalg.norm(ray)) for f, ray in zip(seen, rays, strict=True)]
    return float(np.mean(np.sqrt(np.clip((np.array(cosines) - FACING) / (1 - FACING), 0, 1))))


def seen_parts(look: Look) -> list[ObservedPart]:
    """The look's parts in the world."""
    return [ObservedPart(part, look) for part in look.scene.parts if part.facets]


def in_both_images(look: Look, point: Array) -> bool:
    """Whether a point (3,), world, is at least RIM_PX inside both images of a look."""
    middle, rig = frames.apply(frames.inverse(look.world_from_cyclopean), point[None]), look.taken.rig
    px = np.concatenate([camera.project(middle) for camera in (rig.left, rig.right)])
    return bool(np.all((px > RIM_PX) & (px < np.array(rig.image_size) - RIM_PX)))


def count_seen_again(before: Look, now: Look) -> tuple[int, int]:
    """Of the parts of one look that lie within both images of the next, how many that one shows where they lay, and how
    many it does not."""
    here = [part.centre for part in seen_parts(now)]
    due = [part.centre for part in seen_parts(before) if in_both_images(now, part.centre)]
    again = sum(any(same_place(old, new) for new in here) for old in due)
    return again, len(due) - again


def missing_parts(before: Sequence[ObservedPart], look: Look, around: Array) -> list[ObservedPart]:
    """The lone facets within NEIGHBOUR_MM of a point (3,) world that a look with their middle in both images does not
    show again."""
    now = seen_parts(look)

    def missing(old: ObservedPart) -> bool:
        in_view = same_place(old.centre, around, NEIGHBOUR_MM) and in_both_images(look, old.centre)
        return in_view and not any(same_place(old.centre, new.centre) for new in now)

    return [old for old in before if old.lone and missing(old)]


def in_pick_order(parts: Sequence[ObservedPart], order: str) -> list[ObservedPart]:
    """Nearest to the cameras first, or surest first; parts with one name before the others."""

    def rank(part: ObservedPart) -> tuple[bool, float]:
        away = apart_mm(part.centre, part.look.world_from_cyclopean[:3, 3])
        return not part.named, away if order == "nearest" else -part.recognition.confidence

    return sorted(parts, key=rank)
