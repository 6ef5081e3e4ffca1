"""Which edges each camera should see with known parts at known poses, and their sub-pixel lines as both images have
them. Edges that may lie farther off are searched for in edge_pose.py.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from daemon import frames
from daemon.arrays import Array, Flags, Index
from daemon.vision.geometry import Camera, SolidBatch, in_sight, onto_circles, outward, sides_of, thickness
from daemon.vision.image import MODEL_PX, Sides, StereoImages, fit_sides, line_beside

THIN_PX = (-3.0, 6.0)
"""A facet this thin in the image (negative: just turned away) has edges that may be taken for one another."""
WALL_PX = 40.0
"""A curved surface beyond an arc counts as a facet so thick, times the cosine at which the camera sees it there."""
ROOM_PX, LEAST_LENGTH_PX, LEAST_ARC_PX = 6.0, 12.0, 7.0
"""How far inside the image an edge must be, and how much of it, to be measured; of an arc, which goes on beyond both
ends of its chord, less is enough."""
ON_PLACE, LEAST_DOUBT_PX = 2.3, 0.3
"""An edge is on its place within so many times what the shape leaves open, which is this at least."""
STEEPEST = 3.0
"""How steeply an arc may leave its chord, where the camera sees it nearly edge-on, for its ends to count in full."""
SCALE = np.array([1.0, 1.0, 1.0, 0.03, 0.03, 0.03])
"""Turns are weighed at a lever of some 30 mm, so that mm and rad compare."""

LINE_SIGMAS, LINE_TAIL = 2.0, 3.0
"""How much farther off a line is than its fit says, as its profiles share their neighbours' shading: its errors are
Student's t of so many degrees of freedom (python -m tests.bench.line_errors: 1.8 on drawn parts; of the rendered ones,
whose edges are broken, 2 lays the corners best)."""
RAGGED_PX = 9.0
"""What the place of an edge that only noise blurs is known to, times its evidence, is half of this. An edge between two
faces that is known worse has print beside it, whose strokes pull all of a stretch aside: it is so much less to be
trusted (set on recorded looks at printed prisms)."""
LEAST_EVIDENCE, LEAST_SUPPORT = 6.0, 0.5
"""What an edge must show to be there: step over its noise, and share of its length."""


def corners_in(cameras: Sequence[Camera], cyclopean_from_part: Array, corners_mm: Array) -> tuple[Array, Array]:
    """Project corners (..., K, 3) of parts at poses (..., 4, 4) into each of C cameras: (C, N, 2) px, those of one part
    after the other's, and their derivative (C, N, 2, 6) by a motion of the pose."""
    levers = corners_mm @ np.swapaxes(cyclopean_from_part[..., :3, :3], -1, -2)
    points = levers + cyclopean_from_part[..., None, :3, 3]
    px, slope = (np.stack(each) for each in zip(*(one.project_with_slope(points) for one in cameras), strict=True))
    return px, slope @ frames.point_motion(levers.reshape(-1, 3))


def moved(poses: Array, motions: Array) -> Array:
    """Poses (P, 4, 4), each by its motion (P, 6)."""
    found = poses.copy()
    found[:, :3, :3] = frames.rotations_from_vectors(motions[:, 3:]) @ poses[:, :3, :3]
    found[:, :3, 3] += motions[:, :3]
    return found


def turned(poses: Array, turns: Array, points: Array) -> Array:
    """Poses (P, 4, 4), each turned (P, 3, 3) about a point (P, 3) of the frame they lead to."""
    found = poses.copy()
    found[:, :3, :3] = turns @ poses[:, :3, :3]
    found[:, :3, 3] = points + (turns @ (poses[:, :3, 3] - points)[..., None])[..., 0]
    return found


def across(start: Array, end: Array) -> Array:
    """(E, 2) unit vectors across edges start -> end, (E, 2) each."""
    chord = start - end
    return outward(chord, np.maximum(np.hypot(chord[:, 0], chord[:, 1]), 1e-6))


def off_places(start: Array, end: Array, found_start: Array, found_end: Array) -> Array:
    """(E, 2) px how far the ends of edges found are from the ends expected, across the expected edge; each (E, 2)."""
    normal = across(start, end)
    return np.stack([((found_start - start) * normal).sum(1), ((found_end - end) * normal).sum(1)], 1)


@dataclass(frozen=True, eq=False)
class ExpectedEdges:
    """Edges one camera should see with parts at their poses, placement after placement: owner (E,), the placement of
    each; ends (E, 2), its corners' numbers; start, end (E, 2) px; jacobian (E, 2, 6), how far each end moves across its
    edge with the pose (nothing by what moves along an arc), and by_corner (E, 2, 2, 3), with either corner of the edge;
    outline (E,): which belong to one facing facet only, and show in any light; sharp (E,): which cannot be taken for
    another; px_per_mm (E,); doubt_px (E,): what the shape leaves open; corners_px (K, 2), all corners; outward (E, 3),
    cyclopean: Polyhedron.bisectors; bow (E, 3): how far across the edge, px, the arc that it is a chord of lies at its
    start, middle and end; 0 where it is straight.
    """

    owner: Index
    ends: Index
    start: Array
    end: Array
    jacobian: Array
    by_corner: Array
    outline: Flags
    sharp: Flags
    px_per_mm: Array
    doubt_px: Array
    corners_px: Array
    outward: Array
    bow: Array

    @property
    def line_off(self) -> Array:
        """(E, 2) how far off its ends the line is measured that lies along the arc, px."""
        return line_beside(self.bow, self.lengths_px)

    @property
    def lengths_px(self) -> Array:
        """(E,) px."""
        return np.asarray(np.linalg.norm(self.end - self.start, axis=1))

    def of_ring(self, ring: Sequence[int]) -> tuple[Index, Flags]:
        """Return which edge each side of a facet is, -1 where none is expected, and which of them run the other way
        there."""
        at = {(a, b): k for k, (a, b) in enumerate(self.ends.tolist())}
        pairs = list(sides_of(ring))
        which = np.array([at.get(pair, at.get(pair[::-1], -1)) for pair in pairs], np.intp)
        return which, np.array([pair not in at and pair[::-1] in at for pair in pairs], bool)

    def between(self, first: Array, last: Array) -> ExpectedEdges:
        """Return each edge between two shares (E,) of the way from its first corner to its second, as far as it is in
        the picture; a share of a straight one, or all of an arc's chord."""
        a, b = self.corners_px[self.ends].swapaxes(0, 1)
        way = (b - a) / np.maximum(((b - a) ** 2).sum(1), 1e-9)[:, None]
        at = np.stack([((own - a) * way).sum(1) for own in (self.start, self.end)], 1)
        begin = np.maximum(at[:, 0], first)
        there = np.stack([begin, np.maximum(np.minimum(at[:, 1], last), begin)], 1)
        share = (there - at[:, :1]) / np.maximum(at[:, 1:] - at[:, :1], 1e-9)

        def moved_to(ends: Array) -> Array:
            wide = share.reshape(*share.shape, *([1] * (ends.ndim - 2)))
            return np.asarray((1 - wide) * ends[:, :1] + wide * ends[:, 1:])

        start, end = moved_to(np.stack([self.start, self.end], 1)).swapaxes(0, 1)
        jacobian, by_corner = moved_to(self.jacobian), moved_to(self.by_corner)
        return replace(self, start=start, end=end, jacobian=jacobian, by_corner=by_corner)

    def chosen(self, which: Index) -> ExpectedEdges:
        """Return some of the edges, of the same placements."""
        return replace(self.only(which, slice(0, None)), owner=self.owner[which])

    def only(self, own: Index, corners: slice) -> ExpectedEdges:
        """Return what was found of one placement's edges."""
        return ExpectedEdges(
            np.zeros(len(own), np.intp), self.ends[own] - corners.start, self.start[own], self.end[own],
            self.jacobian[own], self.by_corner[own], self.outline[own], self.sharp[own], self.px_per_mm[own],
            self.doubt_px[own], self.corners_px[corners], self.outward[own], self.bow[own],
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class EdgeObservation:
    """Edges of one camera as found: off (E, 2) px from their places, across them, with covariance doubt (E, 2, 2);
    there (E,): which show at all; sides: as measured, None where they were only searched for.
    """

    edges: ExpectedEdges
    off: Array
    doubt: Array
    there: Flags
    sides: Sides | None = None

    @property
    def on_place(self) -> Flags:
        """(E,) which edges show where they should."""
        near = np.abs(self.off).max(axis=1, initial=0.0) < ON_PLACE * np.maximum(self.edges.doubt_px, LEAST_DOUBT_PX)
        return np.asarray(self.there & near)

    @property
    def line_doubt(self) -> Array:
        """(E, 2, 2) px^2 covariance of both ends of each line that was measured, whatever the shape leaves open."""
        assert self.sides is not None
        known_px = np.sqrt(np.trace(self.sides.covariance, axis1=1, axis2=2) / 2)
        ragged = np.where(self.edges.outline, 1.0, np.maximum(known_px * self.sides.evidence / RAGGED_PX, 1.0))
        return np.asarray((LINE_SIGMAS * ragged[:, None, None]) ** 2 * self.sides.covariance + MODEL_PX**2 * np.eye(2))

    def only(self, placement: int, solids: SolidBatch) -> EdgeObservation:
        """Return what was found of one placement's edges."""
        if len(solids.shapes) == 1:
            return self
        own = np.flatnonzero(self.edges.owner == placement)
        edges = self.edges.only(own, solids.corners_of(placement))
        sides = None if self.sides is None else self.sides.chosen(own)
        return EdgeObservation(edges, self.off[own], self.doubt[own], self.there[own], sides)


def project_edges(
    solids: SolidBatch,
    images: StereoImages,
    poses: Array,
    wanted: Flags,
    tolerance_mm: float,
    thin_px: tuple[float, float] = THIN_PX,
) -> tuple[ExpectedEdges, ExpectedEdges]:
    """The edges of the facets that look at the left and the right camera, as far as they are inside its image, of the
    wanted (P,) of the placements at poses (P, 4, 4). thin_px: between which the edges of a facet may be taken for one
    another."""
    px, slope = corners_in([view.rectified.camera for view in images.views], poses, solids.corners_mm)
    begins = solids.first_corners[:, None, None]
    thick = np.full((2, len(poses), solids.rings.shape[1] + 1), -np.inf)
    thick[..., :-1] = thickness(px[:, solids.rings + begins])
    thick_px = thick[:, np.arange(len(poses))[:, None, None], solids.beside]
    owner, edge = np.nonzero(solids.walls.any(2))
    if len(owner):
        chords = solids.corners_mm[owner[:, None], solids.ends[owner, edge]]
        turned_in = poses[owner, :3, :3] @ np.stack([solids.walls[owner, edge], chords.mean(1)], 2)
        for own, viewpoint_mm in zip(thick_px, images.geometry.cameras_mm, strict=True):
            ray = viewpoint_mm - poses[owner, :3, 3] - turned_in[..., 1]
            own[owner, edge, 1] = WALL_PX * (turned_in[..., 0] * ray).sum(1) / np.linalg.norm(ray, axis=1)
    facing = (thick_px >= thin_px[1]).sum(3)
    clear = np.asarray(~((thick_px > thin_px[0]) & (thick_px < thin_px[1])).any(3))
    camera, owner, edge = np.nonzero((facing > 0) & wanted[:, None])  # the left camera's first
    ends = (solids.ends + begins)[owner, edge]
    start, end = px[camera, ends[:, 0]], px[camera, ends[:, 1]]
    first, last = shares_inside(start, end, images.rig.image_size)
    least = np.where(solids.circles[owner, edge, 3] > 0, LEAST_ARC_PX, LEAST_LENGTH_PX)
    keep = (last - first) * np.hypot(*(end - start).T) >= least
    camera, owner, edge, ends, start, end = (each[keep] for each in (camera, owner, edge, ends, start, end))
    first, last, way = first[keep, None], last[keep, None], end - start
    normal = across(start, end)[:, None]
    share = np.concatenate([first, last], 1)
    sharp = clear[camera, owner, edge]
    depth_mm = (poses[:, 2, :3] * solids.middles_mm).sum(1) + poses[:, 2, 3]
    px_per_mm = np.array([view.rectified.focal_px for view in images.views])[camera] / depth_mm[owner]
    outline = (facing[camera, owner, edge] == 1) & sharp
    bisectors = (poses[owner, :3, :3] @ solids.bisectors[owner, edge][..., None])[..., 0]
    start, end = start + first * way, start + last * way
    bow, normals = np.zeros((len(owner), 3)), np.repeat(normal, 2, 1)
    circles = solids.circles[owner, edge]
    (arcs,) = np.nonzero(circles[:, 3])
    if len(arcs):
        on_arcs = _on_arcs(solids.corners_mm.reshape(-1, 3)[ends[arcs]], circles[arcs], share[arcs])
        of_arcs = poses[owner[arcs]]
        cyclopean = on_arcs @ of_arcs[:, :3, :3].swapaxes(1, 2) + of_arcs[:, None, :3, 3]
        seen = [view.rectified.camera.project(cyclopean.reshape(-1, 3)).reshape(-1, 3, 2) for view in images.views]
        on_image = np.where(camera[arcs, None, None] == 0, *seen)
        bow[arcs] = ((on_image - start[arcs, None]) * normal[arcs]).sum(2)
        tangents = _tangents(on_arcs, circles[arcs]) @ of_arcs[:, :3, :3].swapaxes(1, 2)
        of_ends = np.stack([1 - share[arcs], share[arcs]], 2)
        slopes = slope[camera[arcs, None], ends[arcs], :, :3]
        normals[arcs] -= _climb(np.einsum("anc,acij,anj->ani", of_ends, slopes, tangents), start[arcs], end[arcs])
    moves = np.einsum("eni,ecij->encj", normals, slope[camera[:, None], ends])  # across either end, by either corner
    by_corner = np.stack([1 - share, share], 2)[..., None] * moves
    jacobian = by_corner.sum(2)

    def of_camera(own: slice, corners_px: Array) -> ExpectedEdges:
        return ExpectedEdges(
            owner[own], ends[own], start[own], end[own], jacobian[own], by_corner[own, ..., :3], outline[own],
            sharp[own], px_per_mm[own], tolerance_mm * px_per_mm[own], corners_px, bisectors[own], bow[own],
        )  # fmt: skip

    of_left = int(np.count_nonzero(camera == 0))
    return of_camera(slice(of_left), px[0]), of_camera(slice(of_left, None), px[1])


def visible_stretches(solids: SolidBatch, edges: ExpectedEdges, poses: Array, viewpoint_mm: Array, count: int) -> Flags:
    """(E, S) which of so many stretches of each edge the part itself does not hide from a viewpoint_mm (3,)."""
    seen = np.ones((len(edges.start), count), bool)
    shares, corners_mm = (np.arange(count) + 0.5) / count, solids.corners_mm.reshape(-1, 3)
    for k, solid in enumerate(solids.shapes):
        own = np.flatnonzero(edges.owner == k)
        if len(own):
            a, b = (corners_mm[edges.ends[own, end]] for end in (0, 1))
            places = a[:, None] + shares[None, :, None] * (b - a)[:, None]
            seen[own] = in_sight(solid, places, poses[k], viewpoint_mm)
    return seen


def longest_runs(there: Flags) -> tuple[Index, Index]:
    """(E,) first and (E,) one past the last of the longest run of true ones in each row of there (E, S); equal where
    there is none."""
    run = longest = last = np.zeros(len(there), np.intp)
    for k, here in enumerate(there.T):
        run = (run + 1) * here
        last = np.where(run > longest, k + 1, last)
        longest = np.maximum(run, longest)
    return last - longest, last


def _on_arcs(chords: Array, circles: Array, share: Array) -> Array:
    """(A, 3, 3) places on the arcs of circles (A, 4) that lie beyond chords (A, 2, 3), at the shares (A, 2) of these
    where they begin and end, and midway."""
    at = np.stack([share[:, 0], share.mean(1), share[:, 1]], 1)[..., None]
    return onto_circles(chords[:, :1] + at * (chords[:, 1:] - chords[:, :1]), circles[:, None])


def _tangents(on_arcs: Array, circles: Array) -> Array:
    """(A, 2, 3) directions in which circles (A, 4) run where their arcs begin and end, of (A, 3, 3) places on these."""
    spokes = on_arcs[:, [0, 2]] - circles[:, None, :3]
    return np.cross(np.cross(spokes[:, 0], spokes[:, 1])[:, None], spokes)


def _climb(tangents_px: Array, start: Array, end: Array) -> Array:
    """(A, 2, 2) how steeply arcs that run so at either end, (A, 2, 2) px, leave their chords start -> end, (A, 2) each,
    times the unit vector along these: what moves along an arc does not move it."""
    way = (end - start) / np.maximum(np.linalg.norm(end - start, axis=1), 1e-6)[:, None]
    along = (tangents_px * way[:, None]).sum(2)
    rise = (tangents_px * across(start, end)[:, None]).sum(2)
    steep = np.clip(rise / np.where(along == 0.0, 1e-9, along), -STEEPEST, STEEPEST)
    return np.asarray(steep[..., None] * way[:, None])


def shares_inside(start: Array, end: Array, size: tuple[int, int]) -> tuple[Array, Array]:
    """Shares (E,), (E,) of the way start -> end between which each edge is inside an image (width, height) (Liang and
    Barsky); the second is not above the first where none of it is."""
    way, limit = (end - start).T, np.array([size]).T - 1 - ROOM_PX
    speed, room = np.concatenate([-way, way]), np.concatenate([start.T - ROOM_PX, limit - start.T])  # to each border
    along = np.abs(speed) <= 1e-9
    at = room / np.where(along, 1.0, speed)
    first, last = np.where(~along & (speed < 0), at, 0.0), np.where(~along & (speed > 0), at, 1.0)
    outside = (along & (room < 0)).any(0)
    return first.max(0, initial=0.0), np.where(outside, -1.0, last.min(0, initial=1.0))


def measure_edges(
    both: Sequence[ExpectedEdges], images: StereoImages, *, on_place: bool = False
) -> list[EdgeObservation]:
    """Each edge's sub-pixel line, in both cameras. on_place: they are expected to half a px."""
    counts = [len(edges.start) for edges in both]
    if not any(counts):
        return [nothing_found(edges) for edges in both]
    start, end = (np.concatenate([getattr(edges, name) for edges in both]) for name in ("start", "end"))
    exposures = [(view.exposure, count) for view, count in zip(images.views, counts, strict=True) if count]
    own = [(each := np.bincount(edges.owner))[each > 0] for edges in both]
    blurs = [view.blur_px for view in images.views]
    known = np.repeat([b for b in blurs if b], [len(o) for o in own]) if on_place and all(blurs) else None
    sides = fit_sides(exposures, start, end, np.concatenate(own), known)
    found, every = [], np.arange(len(start))
    for edges, which in zip(both, (every[: counts[0]], every[counts[0] :]), strict=True):
        seen = sides.chosen(which)
        doubt = seen.covariance + edges.doubt_px[:, None, None] ** 2 * np.eye(2)
        there = (seen.evidence > LEAST_EVIDENCE) & (seen.support > LEAST_SUPPORT)
        off = off_places(edges.start, edges.end, seen.start, seen.end) - edges.line_off
        found.append(EdgeObservation(edges, off, doubt, there, seen))
    return found


def nothing_found(edges: ExpectedEdges) -> EdgeObservation:
    """Return the result for edges of which none is in view."""
    return EdgeObservation(edges, np.zeros((0, 2)), np.zeros((0, 2, 2)), np.zeros(0, bool))
