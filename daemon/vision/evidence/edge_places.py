"""What both cameras show at places along the edges of a part: whether an edge is there, and whether one should be.

In: a solid at its pose, both images. Out: EdgePlaces of the left and of the right camera. An edge between equal greys
shows in no picture, so each place has the levels that the facets on its two hands have elsewhere.
"""

from dataclasses import dataclass

import numpy as np

from daemon import frames
from daemon.arrays import Array, Flags, Index
from daemon.vision.geometry import Polyhedron, hides_parallel_facet, in_sight, off_segments, onto_circles, thickness
from daemon.vision.image import LEAST_SIGMAS, StereoImages, levels_across, peaks, slopes_across
from daemon.vision.refine import LEAST_ARC_PX, ROOM_PX, THIN_PX, across

PLACES, REACH_PX = 24, 7
"""On each edge, at which is looked, and how far to either hand."""
SHORTEST_PX = 12.0
ON_PLACE_PX, CLOSE_PX, BESIDE_PX = 2.25, 1.6, (2.5, 5.5)
"""Within what of its place a slope may be the edge, where one camera counts, and where both do; and between which the
level beside it is taken."""
INNER = 0.25
"""How much an edge between two facets that are seen counts, which may be alike."""
FAINT, STEP = 0.2, 0.6
"""Of the difference of levels that is expected: the share that a slope must be to be the edge; and the share that the
step there must reach to be the edge, however it slopes."""
FEWEST = 8
"""Places by which a facet's level is known; with fewer, all of its borders say it."""
_OFFSETS_PX = np.arange(-REACH_PX, REACH_PX + 1.0)
_BETWEEN_PX = (_OFFSETS_PX[2:-1] + _OFFSETS_PX[1:-2]) / 2
"""Of the slopes between those, where there may be a peak."""
_ON_PLACE, _CLOSE = (np.abs(_BETWEEN_PX) <= near for near in (ON_PLACE_PX, CLOSE_PX))
_BESIDE = np.stack(
    [np.flatnonzero((side * _OFFSETS_PX >= BESIDE_PX[0]) & (side * _OFFSETS_PX <= BESIDE_PX[1])) for side in (-1, 1)]
)
_EITHER = np.arange(2)[:, None, None]
_TENTHS = 2.56
"""Standard deviations between the tenth and the ninetieth of hundred."""


@dataclass(frozen=True, eq=False)
class EdgePlaces:
    """What one camera shows at places along the edges of a part: length_px (E,) a place; weight (E,) of each edge;
    and of each place (E, S): visible, whether the camera should see it; there, whether an edge is near, as a worn one
    is; close, whether one as strong as expected is; expected, by how many sigmas the levels on its hands should differ:
    those of the facets, as their borders that show have them, or what lies beside the edge there; step, the share of
    that by which they do; spread, of the levels along the borders of those facets, in sigmas.
    """

    length_px: Array
    weight: Array
    visible: Flags
    there: Flags
    close: Flags
    expected: Array
    step: Array
    spread: Array


def edge_places(solid: Polyhedron, pose: Array, images: StereoImages) -> list[EdgePlaces]:
    """Measure what the left and the right camera show along the edges of a part at cyclopean_from_part (4, 4)."""
    ends, count = solid.lines[0], len(solid.corners_mm)
    shares = ((np.arange(PLACES) + 0.5) / PLACES)[:, None]
    places = _on_arcs(solid, solid.corners_mm[ends[:, :1]] * (1 - shares) + solid.corners_mm[ends[:, 1:]] * shares)
    points = frames.apply(pose, np.concatenate([solid.corners_mm, places]))
    px = np.stack([view.rectified.camera.project(points) for view in images.views])
    corners, px = px[:, :count], px[:, count:].reshape(2, -1, PLACES, 2)  # of either camera, as all that follows
    thick = thickness(corners[:, solid.ring_table])
    hands = np.where((thick >= THIN_PX[1])[:, solid.sides_of_lines], solid.sides_of_lines, -1)
    start, end = corners[:, ends[:, 0]], corners[:, ends[:, 1]]
    long = np.hypot(*np.moveaxis(end - start, 2, 0))
    visible = ((px > ROOM_PX) & (px < np.array(images.rig.image_size) - 1 - ROOM_PX)).all(3)
    walls = _walls_facing(solid, pose, images)
    shortest = np.where(solid.circles[:, 3] > 0, LEAST_ARC_PX, SHORTEST_PX)
    visible &= (((hands >= 0).any(2) | walls) & (long >= shortest))[..., None]
    if solid.arcs:
        for own, at, *edges in zip(visible, px, start, end, strict=True):
            own &= ~_beside_others(solid, own, at, *edges)
    for own, viewpoint_mm in zip(visible, images.geometry.cameras_mm, strict=True):
        own &= in_sight(solid, places.reshape(*own.shape, 3), pose, viewpoint_mm)
    levels = np.zeros((*visible.shape, len(_OFFSETS_PX)), np.float32)
    for view, own, seen, at, *edge in zip(images.views, levels, visible, px, start, end, strict=True):
        own[seen] = levels_across(view.smooth, at[seen], across(*edge)[np.nonzero(seen)[0]], _OFFSETS_PX)
    slopes = np.abs(slopes_across(levels))
    beside = levels[..., _BESIDE].mean(4)
    there = np.asarray((peaks(slopes, LEAST_SIGMAS) & _ON_PLACE).any(3))
    levelled = [_usual(*each, len(solid.facets)) for each in zip(hands, beside, visible, there, strict=True)]
    usual, spread = (np.stack(each)[_EITHER, hands] for each in zip(*levelled, strict=True))
    raised = np.linalg.norm(solid.bisectors, axis=1) > 0  # of facets that meet in a hollow either may shade the other
    known = ((hands >= 0) & raised[:, None])[:, :, None]
    before, after = np.moveaxis(np.where(known, usual[:, :, None], beside), 3, 0)
    expected = np.abs(after - before)
    if solid.parallel_behind:
        at = places.reshape(*visible.shape[1:], 3)
        for own, viewpoint in zip(
            expected, frames.apply(frames.inverse(pose), np.stack(images.geometry.cameras_mm)), strict=True
        ):
            own[hides_parallel_facet(solid, at, viewpoint)] = 0.0
    least = np.maximum(LEAST_SIGMAS, FAINT * expected)[..., None]
    close = np.asarray((peaks(slopes, least) & _CLOSE).any(3))
    step = (beside[..., 1] - beside[..., 0]) * np.sign(after - before) / np.maximum(expected, 1e-6)
    sharp = ~((thick > THIN_PX[0]) & (thick < THIN_PX[1]))
    outline = ((hands >= 0).sum(2) + walls == 1) & np.where(
        solid.sides_of_lines < 0, True, sharp[:, solid.sides_of_lines]
    ).all(2)
    spreads = np.hypot(*np.moveaxis(np.where(hands >= 0, spread, 0.0), 2, 0))[..., None]
    each = long / PLACES, np.where(outline, 1.0, INNER), visible, there, close, expected, step, spreads
    return [EdgePlaces(*own) for own in zip(*each, strict=True)]


def _beside_others(solid: Polyhedron, visible: Flags, px: Array, start: Array, end: Array) -> Flags:
    """(E, S) which places px (E, S, 2) on edges with a curved surface beyond have another visible edge, from start to
    end (E, 2) px, so near that the level beside them is not that surface's."""
    chords = np.column_stack([solid.circles, solid.beside[:, 0]]).round(1)
    straight = chords[:, 3] == 0
    chords[straight, :1] = np.arange(straight.sum())[:, None]
    found, (_, edge) = np.zeros(visible.shape, bool), np.unique(chords, axis=0, return_inverse=True)
    open_, seen = solid.beside[:, 1] < 0, visible.any(1)
    for one in np.unique(edge[open_ & seen]).tolist():
        these, others = np.flatnonzero(edge == one), seen & (edge != one)
        off_px = off_segments(px[these].reshape(-1, 1, 2), start[others], end[others])
        found[these] = (off_px.min(1, initial=np.inf) < BESIDE_PX[1]).reshape(len(these), -1)
    return found


def _on_arcs(solid: Polyhedron, places: Array) -> Array:
    """(E * S, 3) places (E, S, 3) along the edges of a solid, those on the chords of arcs on the arcs."""
    (arcs,) = np.nonzero(solid.circles[:, 3])
    places[arcs] = onto_circles(places[arcs], solid.circles[arcs, None])
    return places.reshape(-1, 3)


def _walls_facing(solid: Polyhedron, pose: Array, images: StereoImages) -> Flags:
    """(2, E) beyond which edges, arcs, the left and the right camera see a curved surface."""
    middles = frames.apply(pose, solid.corners_mm[solid.lines[0]].mean(1))
    return np.array(
        [
            ((viewpoint_mm - middles) * (solid.walls @ pose[:3, :3].T)).sum(1) > 0
            for viewpoint_mm in images.geometry.cameras_mm
        ]
    )


def _usual(hands: Index, beside: Array, visible: Flags, there: Flags, count: int) -> tuple[Array, Array]:
    """(F,) the level of each facet along its borders that show, and (F,) its spread; hands (E, 2) the facets beside
    each edge, with levels (E, S, 2)."""
    usual, spread = np.zeros(count), np.zeros(count)
    for facet in np.unique(hands[hands >= 0]).tolist():
        edge, hand = np.nonzero(hands == facet)
        level, seen = beside[edge, :, hand], visible[edge]
        firm = seen & there[edge]
        own = level[firm if firm.sum() >= FEWEST else seen]
        if len(own):
            low, usual[facet], high = np.sort(own)[(np.array([0.1, 0.5, 0.9]) * len(own)).astype(np.intp)]
            spread[facet] = (high - low) / _TENTHS
    return usual, spread
