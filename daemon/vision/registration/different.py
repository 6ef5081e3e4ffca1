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

CELL_MM, CELL_TURN = 8.0, 0.4
"""Guesses whose middles and axes round to the same in these are one bundle."""
_BUNDLE = np.random.default_rng(2).integers(1, 2**40, 9)


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


def thinned(one: Guesses) -> Guesses:
    """The likeliest of every bundle of guesses at much the same pose."""
    middle_mm = one.poses[:, :3, :3] @ one.solid.corners_mm.mean(0) + one.poses[:, :3, 3]
    cells = np.concatenate([middle_mm / CELL_MM, one.poses[:, :3, :2].reshape(-1, 6) / CELL_TURN], 1)
    bundle = np.rint(cells).astype(np.int64) @ _BUNDLE
    order = np.argsort(one.against, kind="stable")
    kept = order[np.unique(bundle[order], return_index=True)[1]]
    return Guesses(one.label, one.solid, one.poses[kept], one.against[kept])


def different(guesses: Sequence[Guesses], eyes: Eyes) -> Iterator[Different]:
    """Those inside both images, the likeliest first, none of which looks like an earlier one."""
    likely = [alike for one in guesses for alike in _alike(one)]
    if not likely:
        return
    against = np.concatenate([a.against for a in likely])  # infinite once looked at, or like one that was
    middle_mm = np.concatenate([a.corners_mm.mean(1) for a in likely])
    first = np.cumsum([0, *(len(a.against) for a in likely)])
    while True:
        best = int(against.argmin())
        worst = float(against[best])
        if worst == np.inf:
            return
        against[best] = np.inf
        k = int(np.searchsorted(first, best, "right")) - 1
        corners_mm = likely[k].corners_mm[best - first[k]]
        if _inside(corners_mm, eyes):
            yield Different(likely[k].label, likely[k].poses[best - first[k]], worst)
            near = np.flatnonzero((((middle_mm - middle_mm[best]) ** 2).sum(1) < SAME_MM**2) & (against < np.inf))
            for m in np.unique(np.searchsorted(first, near, "right") - 1).tolist():
                own = near[(near >= first[m]) & (near < first[m + 1])]
                against[own[_same_place(likely[m].corners_mm[own - first[m]], corners_mm)]] = np.inf


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
    if many.shape[1:] != one.shape:
        return np.zeros(len(many), bool)
    apart2 = ((many[:, :, None] - one) ** 2).sum(3)
    return np.asarray(apart2.min(2).max(1) < SAME_MM**2)
