"""Stretch by stretch, how the grey levels change across every edge that parts at their poses should show: where poses
are better, and how much more speaks for each than chance would give beside these very edges.

In: cameras, taught solids at near poses. Out: poses and evidence. Print or wear beside an edge pulls some of its
stretches aside; as one line they would be lost. Source: moving edges (Bouthemy 1989) for the pose; for the evidence an
a contrario count (Desolneux, Moisan and Morel 2000) whose chance is taken on the parallels of each edge.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from daemon.arrays import Array, Flags, Index
from daemon.vision.geometry import SolidBatch, robust_weight, solve
from daemon.vision.image import LEAST_SIGMAS, StereoImages, peak_places, peaks, ranks, stretch_slopes
from daemon.vision.refine.expected_edges import THIN_PX, ExpectedEdges, moved, project_edges, visible_stretches

REACH_PX = 8
"""How far across its edge each stretch is looked at."""
ROUNDS_PX = (4.0, 3.0, 2.0, 1.2, 0.8), (1.5, 1.0, 0.8)
"""How near what is expected slopes count, round by round; between those the images are read anew."""
PULLED = 1.34
"""So many of those away, a slope pulls a quarter."""
ON_PLACE_PX, NEAR_PX, BESIDE_PX = 1.25, 2.25, 3.0
"""Within this an edge shows where it should; within this a worn one; beyond this, what shows is chance."""
SPACING_PX, INNER = 3.75, 0.5
"""An edge so long weighs one, a longer one as the root of its length: what lies along all of it is one chance. An edge
between two faces that are seen weighs so much of that: often they are alike."""
MOST_SURPRISE = 2.5
"""Of an edge, on average: more, and it is merely strong."""
WIDTH_PX, OTHERS = 3.0, 0.5
"""How wide the place of an edge is; slopes as strong that are thought beside it more than were seen."""
SHOWS = 1.5
"""Of mean surprise, which is 1 by chance: from here on an edge is said to show."""
PRIOR_MM, PRIOR_RAD = 4.0, 0.06


_OFF = np.abs(np.arange(1 - REACH_PX, REACH_PX))


@dataclass(frozen=True, eq=False)
class EdgeSamples:
    """What the stretches of E expected edges show: sigmas (E, S, C) of the slope at C offsets across; surprise (E, S),
    minus the log of the chance that a slope as strong as the one on the edge's place were there, 0 where none is; there
    (E, S): where one is near, as on a worn edge; visible (E, S): which stretches the part itself does not hide."""

    edges: ExpectedEdges
    sigmas: NDArray[np.float32]
    surprise: Array
    there: Flags
    visible: Flags

    @property
    def shows(self) -> Flags:
        """(E,) which edges show, more than by chance."""
        return np.asarray(self._mean_surprise(self.visible) > SHOWS)

    @property
    def weight(self) -> Array:
        """(E,) how much what each edge shows counts."""
        px = self.edges.lengths_px * self.visible.mean(1)
        return np.asarray(np.sqrt(px / SPACING_PX) * np.where(self.edges.outline, 1.0, INNER))

    @property
    def nats(self) -> Array:
        """(E,) evidence of each edge against chance."""
        return self.nats_of(np.ones_like(self.visible))

    def nats_of(self, which: Flags) -> Array:
        """(E,) evidence of some of the stretches (E, S) of each edge against chance, those that are visible."""
        some = which & self.visible
        fraction = some.sum(1) / np.maximum(self.visible.sum(1), 1)
        return np.asarray(self.weight * fraction * (np.minimum(self._mean_surprise(some), MOST_SURPRISE) - 1))

    def _mean_surprise(self, which: Flags) -> Array:
        """(E,) over some of the stretches (E, S)."""
        return np.asarray((self.surprise * which).sum(1) / np.maximum(which.sum(1), 1))

    def information(self, sigma_px: float) -> Array:
        """(6, 6) of the pose, in edges of which either end is off by sigma_px, as far as they show."""
        showing = np.minimum(self.surprise.mean(1), MOST_SURPRISE) / MOST_SURPRISE
        trust = self.edges.sharp * showing * np.where(self.edges.outline, 1.0, INNER)
        rows = self.edges.jacobian.reshape(-1, 6)
        return np.asarray((rows * np.repeat(trust, 2)[:, None]).T @ rows / sigma_px**2)

    def only(self, placement: int, solids: SolidBatch) -> EdgeSamples:
        """Return the samples of one placement."""
        if len(solids.shapes) == 1:
            return self
        own = np.flatnonzero(self.edges.owner == placement)
        edges = self.edges.only(own, solids.corners_of(placement))
        return EdgeSamples(edges, self.sigmas[own], self.surprise[own], self.there[own], self.visible[own])


class EdgeEvidence(NamedTuple):
    """What grey levels say of a part at a pose: nats of evidence against chance, and the fraction of the most
    that there could be."""

    nats: float
    fraction: float

    @classmethod
    def of(cls, both: Sequence[EdgeSamples], own: Sequence[Flags] | None = None) -> EdgeEvidence:
        """Make it from the stretches of both cameras along the edges of one placement, or along some of them, (E,) in
        either camera."""
        which = own or [np.ones(len(seen.surprise), bool) for seen in both]
        nats = sum(float(seen.nats[one].sum()) for seen, one in zip(both, which, strict=True))
        most = sum(float(seen.weight[one].sum()) for seen, one in zip(both, which, strict=True)) * (MOST_SURPRISE - 1)
        return cls(nats, nats / max(most, 1e-9))


def edge_samples_of(
    solids: SolidBatch, images: StereoImages, poses: Array, tolerance_mm: float, thin_px: tuple[float, float] = THIN_PX
) -> list[EdgeSamples]:
    """Measure what each camera shows along the edges of parts at poses (P, 4, 4) cyclopean_from_part; thin_px: as for
    expected."""
    both, sigmas = _slopes(solids, images, poses, tolerance_mm, thin_px)
    size = np.abs(sigmas)
    edge = np.where(peaks(size, LEAST_SIGMAS), size[..., 1:-1], np.float32(0))
    own = edge[..., _OFF <= ON_PLACE_PX].max(2)
    near = edge[..., _OFF <= NEAR_PX].max(2)
    beside = edge[..., _OFF > BESIDE_PX]
    many = (beside[:, None] >= own[..., None, None]).sum((2, 3)) + OTHERS
    places = beside.shape[1] * beside.shape[2]
    surprise = -np.log(np.where(own > 0, np.minimum(many * (WIDTH_PX / places), 1.0), 1.0))
    found, first = [], 0
    for edges, viewpoint_mm in zip(both, images.geometry.cameras_mm, strict=True):
        here = slice(first, first := first + len(edges.start))
        visible = visible_stretches(solids, edges, poses, viewpoint_mm, sigmas.shape[1])
        found.append(EdgeSamples(edges, sigmas[here], surprise[here], near[here] > 0, visible))
    return found


def _slopes(
    solids: SolidBatch, images: StereoImages, poses: Array, tolerance_mm: float, thin_px: tuple[float, float] = THIN_PX
) -> tuple[tuple[ExpectedEdges, ExpectedEdges], NDArray[np.float32]]:
    """The left and the right camera's expected edges, and the sigmas (E, S, C) of the slopes across their stretches,
    the left one's first."""
    both = project_edges(solids, images, poses, np.ones(len(poses), bool), tolerance_mm, thin_px)
    start, end, bow = (np.concatenate([getattr(edges, name) for edges in both]) for name in ("start", "end", "bow"))
    smooth = [(view.smooth, len(edges.start)) for view, edges in zip(images.views, both, strict=True)]
    # Outwards as across() has it, and back in the order of the edges.
    return both, stretch_slopes(smooth, end, start, REACH_PX, bow[:, ::-1])[:, ::-1]


def aligned_to_edges(solids: SolidBatch, images: StereoImages, poses: Array, tolerance_mm: float) -> Array:
    """The poses (P, 4, 4) moved to where the stretches of both cameras have the edges."""
    for rounds in ROUNDS_PX:
        poses = _moved(solids, images, poses, tolerance_mm, rounds)
    return poses


def _moved(
    solids: SolidBatch, images: StereoImages, poses: Array, tolerance_mm: float, rounds_px: Sequence[float]
) -> Array:
    count = len(poses)
    both, slopes = _slopes(solids, images, poses, tolerance_mm)
    if not len(slopes):
        return poses
    stretches = slopes.shape[1]
    jacobian = np.concatenate([edges.jacobian for edges in both])
    at = ((np.arange(stretches) + 0.5) / stretches)[None, :, None]
    rows = ((1 - at) * jacobian[:, None, 0] + at * jacobian[:, None, 1]).reshape(-1, 6)
    weight = np.concatenate([edges.lengths_px * edges.sharp for edges in both]) / (15.0 * stretches)
    own = np.concatenate([edges.owner for edges in both]).repeat(stretches)
    place = own, ranks(own)  # side by side, what has fewer stretches filled up with some that weigh nothing
    every = rows, np.abs(slopes).reshape(-1, 2 * REACH_PX + 1), weight.repeat(stretches)
    row, size, each = (_side_by_side(one, place, count) for one in every)
    prior = np.diag([PRIOR_MM**-2.0] * 3 + [PRIOR_RAD**-2.0] * 3)
    offsets = np.arange(-REACH_PX, REACH_PX + 1, dtype=np.float32)
    size = np.where(size >= LEAST_SIGMAS, np.sqrt(size), np.float32(0))
    motion, here = np.zeros((count, 6)), np.zeros(each.shape)
    for near in rounds_px:
        likely = size * np.exp(-0.5 * ((offsets - here[..., None].astype(np.float32)) / near) ** 2)
        best = likely.argmax(2).clip(1, len(offsets) - 2)
        top, between = peak_places(size, best)
        found = offsets[best] + between
        use, outlier = each * (top > 0), PULLED * near
        trust = use * robust_weight((found - here) ** 2, outlier)
        motion = solve(row[:, :, None], found[..., None], use, prior, outlier=outlier, passes=2, trust=trust).unknowns
        here = (row @ motion[..., None])[..., 0]
    return moved(poses, motion)


def _side_by_side(values: NDArray[Any], place: tuple[Index, Index], count: int) -> NDArray[Any]:
    """(P, M, ...) values (N, ...), each at the place (N,), (N,) of its own; nought where there is none."""
    found = np.zeros((count, place[1].max() + 1, *values.shape[1:]), values.dtype)
    found[place] = values
    return found
