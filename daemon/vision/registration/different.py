"""Of many poses of taught parts the likeliest that would look different from each other."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from daemon.arrays import Array
from daemon.vision.geometry import Baseline, Polyhedron
from daemon.vision.image import Eyes
from daemon.vision.registration.directed import in_view

Flags = NDArray[np.bool_]
ROOM_PX = 12
SAME_MM = 2.0  # poses that put every corner this near to the same place look the same


@dataclass(frozen=True, eq=False)
class Guesses:
    """A part, its solid, poses (G, 4, 4) cyclopean_from_part, and what speaks against each (G,), in any one unit."""

    label: str
    solid: Polyhedron
    poses: Array
    against: Array


@dataclass(frozen=True, eq=False)
class _Alike:
    """Poses (G, 4, 4) of a part in which the same of its corners show, corners_mm (G, N, 3)."""

    label: str
    poses: Array
    corners_mm: Array
    against: Array


class Different(NamedTuple):
    """A part, its pose (4, 4), and what speaks against it."""

    label: str
    pose: Array
    against: float


def different(guesses: Sequence[Guesses], eyes: Eyes) -> Iterator[Different]:
    """Those inside both images, the likeliest first, none of which looks like an earlier one."""
    likely = [alike for one in guesses for alike in _alike(one)]
    against = [a.against.copy() for a in likely]  # infinite once looked at, or like one that was
    while any(np.isfinite(each).any() for each in against):
        k = int(np.argmin([each.min(initial=np.inf) for each in against]))
        best = int(np.argmin(against[k]))
        worst = float(against[k][best])
        against[k][best] = np.inf
        corners_mm = likely[k].corners_mm[best]
        if _inside(corners_mm, eyes):
            yield Different(likely[k].label, likely[k].poses[best], worst)
            for other, each in zip(likely, against, strict=True):
                each[_same_place(other.corners_mm, corners_mm)] = np.inf


def _alike(one: Guesses) -> list[_Alike]:
    """Poses sorted by which facets show."""
    found = []
    seen, which = np.unique(in_view(one.solid, one.poses), axis=0, return_inverse=True)
    for k, shown in enumerate(seen):
        own = np.flatnonzero(which.ravel() == k)
        corners = sorted({c for f in np.flatnonzero(shown).tolist() for c in one.solid.facets[f]})
        moved = one.solid.corners_mm[corners] @ one.poses[own, :3, :3].transpose(0, 2, 1) + one.poses[own, None, :3, 3]
        found.append(_Alike(one.label, one.poses[own], moved, one.against[own]))
    return found


def _inside(points: Array, eyes: Eyes) -> bool:
    for px in pixels(points, eyes.geometry):
        if px.min() < ROOM_PX or (px > np.array(eyes.rig.image_size) - 1 - ROOM_PX).any():
            return False
    return True


def pixels(points: Array, geometry: Baseline) -> tuple[Array, Array]:
    """Where either eye sees points (N, 3) mm cyclopean: (N, 2) px each."""
    left, right = geometry.project(points)
    return geometry.left.pixels(left), geometry.right.pixels(right)


def _same_place(many: Array, one: Array) -> Flags:
    """(G,) which sets of corners (G, N, 3) mm are where others (M, 3) are."""
    same = np.zeros(len(many), bool)
    if many.shape[1:] == one.shape:
        first = ((many[:, 0, None] - one) ** 2).sum(2).min(1) < SAME_MM**2  # most are elsewhere by one corner already
        apart2 = ((many[first][:, :, None] - one) ** 2).sum(3)
        same[first] = apart2.min(2).max(1) < SAME_MM**2
    return same
