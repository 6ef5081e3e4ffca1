"""Edges that both cameras see where a part should be and that lie on none of its faces: evidence that it is not there.

Print lies on a face: the place in the other image to which the face's plane maps it shows the same edge. An edge that
is not there but a few pixels along the epipolar line lies before or behind that face, as the edges of a cap do where a
pit is claimed, or of a mirror image. In: a solid at its pose, both images. Out: how long such edges are.
Source: plane-induced homography (Hartley and Zisserman, section 13.1).
"""

from itertools import chain
from typing import NamedTuple

import cv2
import numpy as np

from daemon import frames
from daemon.arrays import Array, Flags, Index
from daemon.vision.geometry import Polyhedron, in_sight
from daemon.vision.image import CameraImage, StereoImages, find_segments, levels_across, runs, slopes_across
from daemon.vision.refine import across

LEAST_FACING = 0.3
"""Cosine to either camera below which a face is too oblique to compare."""
BORDER_PX = 4.0
"""How near to the border of a face, in either image, an edge may be the border."""
PIECE_PX, SCALE, STRONG = 9.0, 2, 30.0
"""How long the pieces are in which segments are compared; how many px wide those of the maps of faces are; and how
strong the slope of a piece is, in sigmas."""
FAINT, FEWEST = 12.0, 12
"""Sigmas of the gradient, and pixels of the map at least that show as much, where any such segment lies on faces."""
REACH_PX, NEAR_PX, ACROSS = 10, 2.0, 0.35
"""How far along the normal of an edge the other image is searched; within what it is on the face; and how many of the
px that it would move along the epipolar line go that way at least: what runs along that line has no depth."""
MUCH_LESS, AS_STRONG = 0.5, 0.6
"""Of the slope in one image, less than what the other shows where the face has the edge, and more than what it shows
elsewhere, where the edge is off the face."""
_OFFSETS_PX = np.arange(-REACH_PX - 0.5, REACH_PX + 1.0)


def off_faces_px(solid: Polyhedron, pose: Array, images: StereoImages) -> float:
    """Length, px over both images, of edges within a part at cyclopean_from_part (4, 4) that are off its faces."""
    facing = (
        np.min([solid.facing(pose, viewpoint_mm) for viewpoint_mm in images.geometry.cameras_mm], axis=0) > LEAST_FACING
    )
    if not facing.any():
        return 0.0
    maps = list[_FaceMap]()
    for view, viewpoint_mm in zip(images.views, images.geometry.cameras_mm, strict=True):
        maps.append(_face_map(solid, pose, view, viewpoint_mm))
        if _blank(view, maps[-1], facing):
            return 0.0
    return sum(_off_in(solid, pose, images, facing, maps, one) for one in (0, 1))


class _FaceMap(NamedTuple):
    """Which face (h, w) a camera sees at pixels of SCALE, the first of them at low (2,); -1 where none or a border."""

    face: Index
    low: Index

    def at(self, px: Array) -> Index:
        """(N,) faces at places (N, 2) px of the whole image."""
        column, row = np.rint((px - (SCALE - 1) / 2) / SCALE - self.low).astype(np.intp).T
        height, width = self.face.shape
        inside = (column >= 0) & (row >= 0) & (column < width) & (row < height)
        found = np.full(len(px), -1, np.intp)
        found[inside] = self.face[row[inside], column[inside]]
        return found


def _face_map(solid: Polyhedron, pose: Array, view: CameraImage, viewpoint_mm: Array) -> _FaceMap:
    """The faces painted the farthest first, without what shows through their holes, and their borders over them."""
    points = frames.apply(pose, solid.corners_mm)

    def on_map(points_mm: Array) -> Array:
        return (view.rectified.camera.project(points_mm) - (SCALE - 1) / 2) / SCALE

    at = on_map(points)
    most = np.array(view.grey.shape[::-1]) // SCALE - 1
    low, high = (np.clip(np.rint(side).astype(np.intp), 0, most) for side in (at.min(0), at.max(0)))
    painted = np.full((high - low + 1)[::-1], -1, np.int32)
    shown = np.flatnonzero(solid.facing(pose, viewpoint_mm) > 0)
    away = [np.linalg.norm(points[solid.rings[k]].mean(0) - viewpoint_mm) for k in shown.tolist()]
    rings = [np.rint(at[solid.rings[k]] - low).astype(np.int32) for k in shown.tolist()]
    rims = [
        [
            np.rint(on_map(frames.apply(pose, hole.ring_mm)) - low).astype(np.int32)
            for hole in solid.holes
            if hole.facet == k
        ]
        for k in shown.tolist()
    ]
    for place in np.argsort(away)[::-1].tolist():
        cv2.fillPoly(painted, [rings[place]], int(shown[place]))
        cv2.fillPoly(painted, rims[place], -1)
    cv2.polylines(painted, [*rings, *chain(*rims)], True, -1, 2 * round(BORDER_PX / SCALE) + 1)
    return _FaceMap(painted.astype(np.intp), low)


def _blank(view: CameraImage, seen: _FaceMap, facing: Flags) -> bool:
    """Whether a camera sees no edge of any length on the faces."""
    (left, top), (height, width) = seen.low.tolist(), seen.face.shape
    scale = view.scale(SCALE)
    strong = scale.strength[top : top + height, left : left + width] > FAINT * scale.sigma
    return int((strong & np.append(facing, False)[seen.face]).sum()) < FEWEST


def _off_in(
    solid: Polyhedron, pose: Array, images: StereoImages, facing: Flags, maps: list[_FaceMap], one: int
) -> float:
    """Length, px, of the edges that one image shows and the other has off the faces."""
    view, other, geometry = images.views[one], images.views[1 - one], images.geometry
    at, way, length_px = _pieces(view, maps[one], facing)
    face = maps[one].at(at)
    places = [_on_plane(solid, pose, view, face, at + step * way) for step in (-PIECE_PX / 2, 0.0, PIECE_PX / 2)]
    start, there, end = (geometry.project(points)[1 - one] for points in places)
    aside = np.add(there, [1 / other.rectified.focal_px, 0.0])
    px, begins, ends, moved = (other.rectified.pixels(ideal) for ideal in (there, start, end, aside))
    normal, theirs = across(at, at + way), across(begins, ends)
    seen = (maps[1 - one].at(px) == face) & (np.abs(((moved - px) * theirs).sum(1)) > ACROSS)
    seen &= ((px > REACH_PX) & (px < np.array(other.grey.shape[::-1]) - 1 - REACH_PX)).all(1)
    seen &= in_sight(solid, frames.apply(frames.inverse(pose), places[1]), pose, geometry.cameras_mm[one])
    mine = slopes_across(levels_across(view.smooth, at[seen], normal[seen], _OFFSETS_PX[REACH_PX - 1 : -REACH_PX + 1]))
    found = slopes_across(levels_across(other.smooth, px[seen], theirs[seen], _OFFSETS_PX))
    slope = np.take_along_axis(mine, np.abs(mine).argmax(1)[:, None], 1)
    strong = np.abs(slope[:, 0])
    alike, off_px = found * np.sign(slope), np.abs(np.arange(-REACH_PX, REACH_PX + 1))
    missing = alike[:, off_px <= NEAR_PX].max(1) < MUCH_LESS * strong
    elsewhere = alike[:, off_px > NEAR_PX + 0.5].max(1) > AS_STRONG * strong
    return float(length_px[seen][(strong > STRONG) & missing & elsewhere].sum())


def _pieces(view: CameraImage, seen: _FaceMap, facing: Flags) -> tuple[Array, Array, Array]:
    """Straight segments on faces that look at both cameras, in pieces: their middles (N, 2) px, unit ways (N, 2) and
    lengths (N,) px."""
    low, high = SCALE * seen.low, SCALE * (seen.low + seen.face.shape[::-1])
    found = find_segments(view.grey[low[1] : high[1], low[0] : high[0]])
    lengths = found.lengths_px
    of, number = runs(
        np.zeros(len(lengths), np.intp), count := np.maximum(np.rint(lengths / PIECE_PX), 1).astype(np.intp)
    )
    way = (found.end - found.start)[of]
    at = found.start[of] + low + ((number + 0.5) / count[of])[:, None] * way
    keep = np.append(facing, False)[seen.at(at)]
    return at[keep], (way / lengths[of, None])[keep], (lengths / count)[of][keep]


def _on_plane(solid: Polyhedron, pose: Array, view: CameraImage, face: Index, px: Array) -> Array:
    """(N, 3) mm, cyclopean: where the sights of pixels (N, 2) meet the planes of faces (N,)."""
    camera = view.rectified.camera
    turn, centre = camera.cyclopean_from_camera[:3, :3], camera.cyclopean_from_camera[:3, 3]
    ray = np.concatenate([camera.normalised(px), np.ones((len(px), 1))], 1) @ turn.T
    normal = (solid.normals @ pose[:3, :3].T)[face]
    middle = frames.apply(pose, solid.centres_mm)[face]
    reach = ((middle - centre) * normal).sum(1) / (ray * normal).sum(1)
    return np.asarray(centre + reach[:, None] * ray)
