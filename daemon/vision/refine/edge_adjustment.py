"""Pose and corners of named parts estimated together from the edges of both cameras, at the pose that the images
support best.

A real part is not quite the taught one. Where a corner is off, both cameras see it off in the same place, and so do
both edges that meet there; a fit that takes each edge for its own error would read it as another distance. So each
corner may leave its place on the part, once for all edges of both cameras. And where edges are broken or worn, all of
them draw back into the part, away from both cameras: unasked, that is read as a part that is smaller, and farther away.

A part taught from one side is known by half. Turned by one of its symmetries, a face in view, or the edge that it
covers another with, may be taught or unknown: a taught edge holds the pose, while a thin face beyond an unknown edge
would be taken for that edge's other side. Of poses that fit as well, the one with most support is kept.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from daemon import frames
from daemon.arrays import Array
from daemon.vision.geometry import LeastSquaresFit, Polyhedron, SolidBatch, excess_of, solve, whitener
from daemon.vision.image import StereoImages
from daemon.vision.model import Model
from daemon.vision.refine.expected_edges import EdgeObservation, measure_edges, project_edges
from daemon.vision.refine.rim_samples import RimPlace, rim_places
from daemon.vision.values import Part

# Set on the rendered scenes: tests/bench/recognise.py shows what they do to corners.
OF_TOLERANCE = 0.35
"""How far off its taught place a corner lies, as a share of what naming allows for it."""
WORN_MM, SELDOM = 0.2, 0.3
"""How far the edges of a worn part draw back, a half normal's scale; the odds that a part is worn, before it is seen.
Set on scenes whose parts have edges broken by .2 to .8 mm, and on those where they are sharp."""
PASSES = 6
CONTRADICTED, ASTRAY_PASSES, MOST_ASTRAY_PX = 1.05, 5, 0.6
"""Of what lines are doubted by, how much they may contradict each other and be taken as measured; how often else is
asked how far they are astray, and the farthest: on a real cube whose picture no lens model bends quite right .3 px."""
PRIOR = np.diag([5.0**-2] * 3 + [np.radians(3.0) ** -2] * 3)
"""How near the part is to where it was measured: what no edge says moves no farther. It damps the fit, and is no
measurement: each look would count it anew, and a turn that none of them sees would seem to be known."""
UNMEASURED = np.diag([1000.0**-2] * 3 + [3 * np.pi**-2] * 3)
"""Information of what no edge measures: a part is within a metre, and may have any turn."""


@dataclass(frozen=True, eq=False)
class AdjustedPose:
    """pose (4, 4) cyclopean_from_part with its covariance (6, 6) as daemon/frames.py has it; corners_mm (K, 3), all of
    the part's where they most likely are, cyclopean; motion (6,) from the pose the edges were measured at.
    """

    pose: Array
    covariance: Array
    corners_mm: Array
    motion: Array


def adjust_pose(
    shape: Polyhedron,
    pose: Array,
    observed: Sequence[EdgeObservation],
    tolerance_mm: float,
    anchor: tuple[Array, Array] | None = None,
    rims: Sequence[RimPlace] = (),
) -> AdjustedPose:
    """The pose and the corners that the edges measured in both cameras, at a pose (4, 4), and rims of holes say
    together.

    anchor: a pose (4, 4) and the information (6, 6) with which other evidence than these lines holds the part there;
    without it the part is near to where the lines were measured.
    Source: bundle adjustment of lines (least squares over pose, corners and wear, the corners held by what was taught).
    Where lines of a part that is anchored contradict each other by more than each is doubted, all
    of them are astray by as much more as makes them agree (Paule and Mandel 1982): else the surest few have their way.
    """
    count, turn = len(shape.corners_mm), pose[:3, :3]
    size = 7 + 3 * count
    loose = (OF_TOLERANCE * tolerance_mm) ** 2 * np.eye(3)
    held, towards = np.zeros((size, size)), np.zeros(size)
    held[:6, :6] = PRIOR
    if anchor is not None:
        held[:6, :6] += anchor[1]
        towards[:6] = anchor[1] @ frames.difference(anchor[0], pose)
    held[-1, -1] = WORN_MM**-2
    corner = np.arange(count)
    held[6:-1, 6:-1].reshape(count, 3, count, 3)[corner, :, corner] = np.linalg.inv(
        turn @ shape.covariance_mm2 @ turn.T + loose
    )
    rows, off, doubts, usable = [], [], [], []
    for seen in observed:
        if seen.sides is None:
            continue
        edges = len(seen.off)
        jacobian = np.zeros((edges, 2, size))
        jacobian[:, :, :6] = seen.edges.jacobian
        each = np.arange(edges)[:, None]
        jacobian[:, :, 6:-1].reshape(edges, 2, count, 3)[each, :, seen.edges.ends] = seen.edges.by_corner.swapaxes(1, 2)
        jacobian[..., -1:] = -seen.edges.jacobian[..., :3] @ seen.edges.outward[..., None]
        rows.append(jacobian)
        off.append(seen.off)
        doubts.append(seen.line_doubt)
        usable.append(seen.there & seen.edges.sharp)
    if rims:
        of_rims = np.zeros((len(rims), 2, size))
        of_rims[:, :, :6] = [rim.jacobian for rim in rims]
        rows.append(of_rims)
        off.append(np.array([rim.off_px for rim in rims]))
        doubts.append(np.array([rim.sigma_px**2 * np.eye(2) for rim in rims]))
        usable.append(np.ones(len(rims), bool))
    design, wanted, doubt = (np.concatenate(each) for each in (rows, off, doubts))
    use = np.concatenate(usable)[None].astype(float)
    found = _solved(design, wanted, doubt, use, held, towards)
    trust = found.trust
    if anchor is not None and found.excess[0] > CONTRADICTED:
        variance = np.trace(doubt, axis1=1, axis2=2) / 2
        astray_px2, usual_px2 = 0.0, float(trust.sum() / max(float((trust[0] / variance).sum()), 1e-9))  # harmonic mean
        for _ in range(ASTRAY_PASSES):
            astray_px2 = min(max(found.excess[0] * (usual_px2 + astray_px2) - usual_px2, 0.0), MOST_ASTRAY_PX**2)
            found = _solved(design, wanted, doubt + astray_px2 * np.eye(2), trust, held, towards, passes=1)
    solution, hessian = found.unknowns[0], found.held[0]
    hessian[:6, :6] += UNMEASURED - held[:6, :6]  # an anchor is made of the same grey levels: it says where alone
    spread = np.linalg.inv(hessian)
    followed = float(np.trace(spread @ found.information[0]))  # of the lines, what all unknowns follow, corners too
    spread *= max(float(excess_of(found.miss, found.trust, 2, followed)[0]), 1.0)
    worn_mm, sigma2_mm2 = wear_of(float(solution[-1]), float(spread[-1, -1]))
    with_wear = spread[:, -1] / spread[-1, -1]
    solution = solution + with_wear * (worn_mm - solution[-1])
    spread = spread + np.outer(with_wear, with_wear) * (sigma2_mm2 - spread[-1, -1])
    moved = frames.perturb(pose, solution[:6])
    corners = frames.apply(moved, shape.corners_mm) + solution[6:-1].reshape(-1, 3)
    # The pose is meant as the one that lays the taught corners best onto where this part's own are.
    slopes = frames.point_motion(shape.corners_mm @ pose[:3, :3].T).reshape(-1, 6)
    as_made = np.hstack([np.eye(6), np.linalg.pinv(slopes)])
    return AdjustedPose(moved, np.asarray(as_made @ spread[:-1, :-1] @ as_made.T, float), corners, solution[:6])


def _solved(
    design: Array, off: Array, doubt: Array, use: Array, held: Array, towards: Array, passes: int = PASSES
) -> LeastSquaresFit:
    """The most likely motion, corners and wear (N,), held (N, N) towards something (N,) by all else, of lines whose
    ends move with them as design (E, 2, N) says, are off (E, 2) px, with covariance doubt (E, 2, 2). No edge grows."""
    whiten = whitener(doubt)
    rows, far = (whiten @ design)[None], (whiten @ off[..., None])[None, ..., 0]
    return solve(rows, far, use, held, towards, passes=passes, spare=6, grows=False)


def wear_of(found_mm: float, variance_mm2: float) -> tuple[float, float]:
    """Return how far a part's edges have drawn back, and its variance, where a fit that takes it for worn says
    found_mm.

    Most parts are not worn, and no edge grows: what is said is the mean over both cases. Source: Savage and Dickey's
    ratio of the densities at nought (Dickey 1971).
    """
    if found_mm <= 0:
        return 0.0, 0.0
    sigmas = found_mm / math.sqrt(variance_mm2)
    peak = math.exp(min(sigmas, 30.0) ** 2 / 2) * (1 + math.erf(sigmas / math.sqrt(2)))
    odds = SELDOM * peak * math.sqrt(variance_mm2) / WORN_MM
    share = odds / (1 + odds)
    return share * found_mm, share * variance_mm2 + share * (1 - share) * found_mm**2


ROUNDS, SMALL_MM = 3, 0.15
"""How often edges are measured, and a motion of the part after which another time would change nothing."""
FEWEST_EDGES = 6
"""Edges in both cameras together that hold a pose."""
LEVER_MM = 30.0


def refined_parts(
    parts: Sequence[Part], model: Model, images: StereoImages, by_edges: Sequence[Part] = ()
) -> tuple[Part, ...]:
    """The parts, the named ones where the edges in both images have them; those that edges named lie there already."""
    better, tolerance = list(parts), model.parameters.tolerance_mm
    named = {
        k: model.metric[part.recognition.label].solid
        for k, part in enumerate(parts)
        if part.named and not any(part is other for other in by_edges)
    }
    near = {k: _turned(parts[k], most_in_view(solid, parts[k].equivalents, images)) for k, solid in named.items()}
    poses = [part.cyclopean_from_part for part in near.values()]
    for (k, part), one in zip(near.items(), _adjusted(list(named.values()), poses, images, tolerance), strict=True):
        if one is not None:
            better[k] = _moved(part, named[k], one)
    return tuple(better)


def _turned(part: Part, which: int) -> Part:
    """The part at another of its equivalent poses."""
    if which == 0:
        return part
    pose = part.equivalents[which]
    moved = np.eye(6)
    moved[:3] = frames.point_motion((pose - part.cyclopean_from_part)[None, :3, 3])[0]
    equivalents = np.concatenate([pose[None], np.delete(part.equivalents, which, 0)])
    covariance = moved @ part.covariance @ moved.T
    return replace(part, cyclopean_from_part=pose, covariance=covariance, equivalents=equivalents)


def _adjusted(
    shapes: list[Polyhedron], near: list[Array], images: StereoImages, tolerance_mm: float
) -> list[AdjustedPose | None]:
    """Each shape where its edges are near its pose (4, 4); None where too few of them show.

    Most poses are good to a fraction of a px: the rough fit of a line is left to those that moved.
    """
    found: list[AdjustedPose | None] = [None] * len(shapes)
    if not shapes:
        return found
    solids, poses, open_ = SolidBatch.of(shapes), np.stack(near), np.ones(len(shapes), bool)
    for turn in range(ROUNDS):
        both = measure_edges(project_edges(solids, images, poses, open_, tolerance_mm), images, on_place=turn == 0)
        for k in np.flatnonzero(open_).tolist():
            observed = [seen.only(k, solids) for seen in both]
            open_[k] = sum(int((seen.there & seen.edges.sharp).sum()) for seen in observed) >= FEWEST_EDGES
            if open_[k]:
                rims = rim_places(shapes[k], poses[k], images, tolerance_mm) if shapes[k].holes else []
                found[k] = one = adjust_pose(shapes[k], poses[k], observed, tolerance_mm, rims=rims)
                open_[k] = np.linalg.norm(one.motion * ([1.0] * 3 + [LEVER_MM] * 3)) > SMALL_MM
                poses[k] = one.pose
        if not open_.any():
            break
    return found


def _moved(part: Part, shape: Polyhedron, found: AdjustedPose) -> Part:
    """The part at another pose, its fitted corners and the poses that fit as well with it."""
    before = frames.apply(part.cyclopean_from_part, shape.corners_mm)
    nearest = [np.linalg.norm(ring[:, None] - before, axis=2).argmin(1) for ring in part.fitted_mm]
    return part.at_pose(found.pose, found.covariance, tuple(found.corners_mm[ring] for ring in nearest))


MORE = 1.02
"""So many times the area in view a pose must show of what was taught to be thought better unasked."""


def most_in_view(solid: Polyhedron, poses: Array, images: StereoImages) -> int:
    """Return which of the poses (P, 4, 4) cyclopean_from_part has most of what was taught in view; the first where none
    has notably more."""
    if len(poses) < 2:
        return 0
    areas = _in_view_px2(solid, poses, images)
    most = int(np.argmax(areas))
    return most if most and areas[most] > MORE * areas[0] else 0


def _in_view_px2(solid: Polyhedron, poses: Array, images: StereoImages) -> Array:
    """(P,) area of the facets that face each camera, px2, both together, at poses (P, 4, 4)."""
    here, after, first = solid.steps
    corners = solid.corners_mm @ poses[:, :3, :3].transpose(0, 2, 1) + poses[:, None, :3, 3]
    total = np.zeros(len(poses))
    for view in images.views:
        px = view.rectified.camera.project(corners.reshape(-1, 3)).reshape(*corners.shape[:2], 2)
        (x, y), (u, v) = (px[:, which].transpose(2, 0, 1) for which in (here, after))
        total += np.maximum(-np.add.reduceat(x * v - y * u, first, axis=1), 0.0).sum(1) / 2
    return total
