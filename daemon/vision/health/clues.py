"""What a look hints at of the calibration: corners off their epipolar lines, edges of known parts too long or short.

Pure. What the hints of many looks mean is daemon/calibration/drift.py's.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from daemon import frames
from daemon.arrays import Array, Index
from daemon.vision.geometry import Polyhedron, StereoRig
from daemon.vision.values import FacetView, Part, Scene

AXES = ("pitched", "rolled", "turned in")
"""About the right camera's x, z and y axes: what `turn` counts, in this order."""
MIN_VOTES = 6
VOTE_SIGMA_PX = 0.25
CLEAR_LEAD = 1.5
"""Least number of corners of either camera that agree on an offset, sigma, px, of their agreement, and least ratio of
their votes to those of the next offset."""
SAME_PX = 1.5
"""Corners of one camera this near are one: several outlines go through it."""
REACH_PX, NAMED_PX = 8.0, 4.0
"""How far off their epipolar lines corners are still paired, and how far off the cameras can be that surely name a
part: of 32 rendered looks with the right camera turned up, 29 named their part 2.4 px off, 7 at 3.7 px, none at 6.1."""
DEPTHS_MM = (120.0, 1500.0)
CORNER_SIGMA_PX = 0.1
LENGTH_SIGMA = 0.004
"""What a corner, and an edge length as a share of itself, are taken to be worth; how far that is wrong is learnt."""

ShapeOf = Callable[[str], Polyhedron | None]
NAMES = ("pitch", "roll", "vergence")
"""Names of AXES in the fields <name>_deg and <name>_sigma_deg of a look's health."""

SURE = 0.9
"""Confidence below which a part's edges are not taken for known lengths."""
NEAR_MM = 6.0
SHORTEST_MM = 15.0


@dataclass(frozen=True, eq=False)
class Clue:
    """What one look says: turn (3,) rad as in AXES and its sigma (3,) rad, infinite where it says nothing; at: when."""

    turn: Array
    sigma: Array
    at: str


def clue_of(scene: Scene, rig: StereoRig, shape_of: ShapeOf) -> Clue:
    """Return what one look says of the rig: all corners of all outlines of both cameras, named or not, and the edges of
    sure parts."""
    sure = [p for p in scene.parts if p.recognition.label != "unknown" and p.recognition.confidence >= SURE]
    corners = _corners(scene.view, "left"), _corners(scene.view, "right")
    left, right = same_height(rig, *corners, NAMED_PX if sure else REACH_PX)
    return clue(rig, left, right, [edge for part in sure for edge in _edges(part, shape_of)], "")


def health_fields(clue: Clue) -> dict[str, float]:
    """A clue as fields of a look's health in the run log; what the look says nothing of is left out."""
    fields: dict[str, float] = {}
    for name, turn, sigma in zip(NAMES, clue.turn, clue.sigma, strict=True):
        if np.isfinite(sigma):
            fields |= {f"{name}_deg": float(np.degrees(turn)), f"{name}_sigma_deg": float(np.degrees(sigma))}
    return fields


def _corners(view: FacetView, camera: Literal["left", "right"]) -> Array:
    """(N, 2) px: the corners of every outline of one camera, used or refused. After a knock most are refused."""
    used = view.polygons_left if camera == "left" else view.polygons_right
    found = [p.corners_px for p in used] + [r.corners_px for r in view.rejected if r.camera == camera]
    return _each_once(np.concatenate(found)) if found else np.zeros((0, 2))


def _each_once(corners: Array) -> Array:
    """Keep the first of corners (N, 2) that are one."""
    near = np.linalg.norm(corners[:, None] - corners, axis=2) < SAME_PX
    return np.asarray(corners[near.argmax(1) == np.arange(len(corners))])


def _edges(part: Part, shape_of: ShapeOf) -> list[tuple[float, float, float]]:
    """(length found, length taught, depth) of each edge of which both corners are met by taught ones, mm."""
    shape = shape_of(part.recognition.label)
    if shape is None:
        return []
    placed = frames.apply(part.cyclopean_from_part, shape.corners_mm)
    found = []
    for facet in part.facets:
        seen = facet.corners_mm
        gaps = np.linalg.norm(seen[:, None] - placed[None], axis=2)
        nearest, near = gaps.argmin(axis=1), gaps.min(axis=1) < NEAR_MM
        for k in range(len(seen)):
            n = (k + 1) % len(seen)
            taught = float(np.linalg.norm(placed[nearest[k]] - placed[nearest[n]]))
            if near[k] and near[n] and taught > SHORTEST_MM:
                found.append((float(np.linalg.norm(seen[k] - seen[n])), taught, float(seen[[k, n], 2].mean())))
    return found


def clue(rig: StereoRig, left_px: Array, right_px: Array, edges: Sequence[tuple[float, float, float]], at: str) -> Clue:
    """Estimate the right camera's pose from one look.

    left_px, right_px: (N, 2) matched corners, px. edges: (length found, length known, depth) of each known edge, mm.
    Pitch and roll need 4 corners spread over the image, turning in needs an edge.
    """
    turn, sigma = np.zeros(3), np.full(3, np.inf)
    if len(left_px) >= 4:
        turn[:2], sigma[:2] = _pitch_and_roll(rig, left_px, right_px)
    if edges:
        found, known, depth = np.array(edges, float).T
        # Lengths scale with depth, and depth with disparity: dZ / Z = Z / B * angle.
        angles = (found / known - 1.0) * rig.baseline_mm / depth
        turn[2] = float(np.median(angles))
        sigma[2] = LENGTH_SIGMA * float(np.median(rig.baseline_mm / depth)) / np.sqrt(len(edges))
    return Clue(turn, sigma, at)


def same_height(rig: StereoRig, left_px: Array, right_px: Array, most_px: float = REACH_PX) -> tuple[Array, Array]:
    """Corners of both cameras that agree on one offset from their epipolar lines: (N, 2) left and right px, empty where
    no offset stands out, or one larger than most_px.

    left_px (P, 2), right_px (Q, 2): all corners found, in any order. A recogniser pairs corners by their epipolar
    lines, so that after a knock it pairs none, or the wrong ones; here every pair at a possible depth votes for its
    offset, and the true ones vote alike. Of the pairs of one corner only one is true: it has one vote for an offset,
    whatever lies in a row with it, as the dots of a print or the weave of a table do.
    """
    if min(len(left_px), len(right_px)) < MIN_VOTES:
        return np.zeros((0, 2)), np.zeros((0, 2))
    i, j = (k.ravel() for k in np.indices((len(left_px), len(right_px))))
    lines, rays = _lines_and_rays(rig, left_px, right_px)
    gaps = np.einsum("ni,ni->n", lines[i], rays[j]) * rig.right.matrix[0, 0]
    depth_mm = rig.baseline_mm / np.maximum(_disparity(rig, left_px, right_px, i, j), 1e-9)
    likely = (np.abs(gaps) < REACH_PX) & (depth_mm > DEPTHS_MM[0]) & (depth_mm < DEPTHS_MM[1])
    i, j, gaps = i[likely], j[likely], gaps[likely]
    if len(gaps) < MIN_VOTES:
        return np.zeros((0, 2)), np.zeros((0, 2))
    offsets = np.arange(-REACH_PX, REACH_PX, 0.1)
    nearness = np.exp(-0.5 * ((offsets[:, None] - gaps[None]) / VOTE_SIGMA_PX) ** 2)
    votes = np.minimum(_of_each(nearness, i), _of_each(nearness, j))
    best = offsets[int(np.argmax(votes))]
    rival = float(votes[np.abs(offsets - best) > 4 * VOTE_SIGMA_PX].max())
    near = np.abs(gaps - best) < 3 * VOTE_SIGMA_PX
    corners = min(len(np.unique(i[near])), len(np.unique(j[near])))
    if abs(best) > most_px or corners < MIN_VOTES or float(votes.max()) < CLEAR_LEAD * rival:
        return np.zeros((0, 2)), np.zeros((0, 2))
    return left_px[i[near]], right_px[j[near]]


def _of_each(nearness: Array, corner: Index) -> Array:
    """(O,) votes for each offset: of the pairs (O, N) of one corner (N,) the one that is nearest to it."""
    order = np.argsort(corner, kind="stable")
    begins = np.flatnonzero(np.diff(corner[order], prepend=-1))
    return np.asarray(np.maximum.reduceat(nearness[:, order], begins, axis=1).sum(1))


def _disparity(rig: StereoRig, left_px: Array, right_px: Array, i: Index, j: Index) -> Array:
    """Baseline over depth of each pair, from the angles of both rays in the plane of the baseline and the view."""
    slopes = []
    for camera, px in ((rig.left, left_px), (rig.right, right_px)):
        rays = np.column_stack([camera.normalised(px), np.ones(len(px))]) @ camera.cyclopean_from_camera[:3, :3].T
        slopes.append(rays[:, 0] / rays[:, 2])
    difference: Array = slopes[0][i] - slopes[1][j]
    return difference


def _lines_and_rays(rig: StereoRig, left_px: Array, right_px: Array) -> tuple[Array, Array]:
    """(P, 3) epipolar lines of the left points in the right camera's plane z = 1, unit normals; (Q, 3) the right
    rays."""
    right_from_left = frames.inverse(rig.right.cyclopean_from_camera) @ rig.left.cyclopean_from_camera
    cross = frames.cross_matrices(right_from_left[:3, 3])
    lines = np.column_stack([rig.left.normalised(left_px), np.ones(len(left_px))]) @ (cross @ right_from_left[:3, :3]).T
    lines /= np.linalg.norm(lines[:, :2], axis=1, keepdims=True)
    # The normal's own sense is free: with its y made positive, an offset means the same for every line.
    lines *= np.where(lines[:, 1:2] < 0, -1.0, 1.0)
    return lines, np.column_stack([rig.right.normalised(right_px), np.ones(len(right_px))])


def _pitch_and_roll(rig: StereoRig, left_px: Array, right_px: Array) -> tuple[Array, Array]:
    """The right camera's turn (2,) rad about its x and z, by least squares on epipolar distances, and its sigma."""
    lines, rays = _lines_and_rays(rig, left_px, right_px)
    gaps = np.einsum("ni,ni->n", lines, rays)
    # A camera that turns by w moves a ray to ray - w x ray; along the line's normal that shows as -(w x ray) . line.
    turned = np.cross(rays[:, None, :], np.array([[1.0, 0, 0], [0, 0, 1.0]])[None])
    slopes = np.einsum("nki,ni->nk", turned - turned[..., 2:] * rays[:, None, :], lines)
    covariance = np.linalg.pinv(slopes.T @ slopes, rcond=1e-9)
    sigma = np.sqrt(np.diag(covariance)) * CORNER_SIGMA_PX * np.sqrt(2) / rig.right.matrix[0, 0]
    return covariance @ slopes.T @ gaps, np.where(sigma > 0, sigma, np.inf)
