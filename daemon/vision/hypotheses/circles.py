"""Where taught parts would be whose rims are circles that both cameras see: a bore's, a round face's, a rounded end's.

In: circles in space, taught solids. Out: poses. A circle gives its centre, normal and radius, and not the turn about
its axis: every turn is a hypothesis of its own, and the part's other edges decide.
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from daemon import frames
from daemon.arrays import Array, Index
from daemon.vision.facets import MeasuredCircle, differs_mm
from daemon.vision.geometry import Polyhedron, SolidBatch, axes_in, circle_along
from daemon.vision.hypotheses.pose_batch import PoseBatch
from daemon.vision.model import symmetries

WITHIN_RIM = 1.1
"""By so many radii of its widest rim a solid may reach from the axis of that and look nearly alike in every turn."""
ON_CIRCLE_MM = 0.05
FEWEST_ROUND = 7
TURN = np.radians(5.0)
"""Between the turns about a circle's axis that are tried: 2 mm at 24 mm from it either way, which edges draw back."""
MOST_POSES = 8000
FOR_EACH, MET_MM = 15.0, 2.5
"""Nats by which a circle speaks for a pose that has a rim there, and how near: a turn that is off by half a step has
the rims of a bolt circle of 30 mm 1.3 mm off."""
ONE_MM = 1.0


class Rim(NamedTuple):
    """A rim of a solid: centre_mm, normal (3,), unit, out of the facet that it bounds, and radius_mm; outer: that it is
    in the facet's outline, and shows from behind as well."""

    centre_mm: Array
    normal: Array
    radius_mm: float
    outer: bool


@lru_cache(maxsize=4096)
def rims_of(solid: Polyhedron) -> tuple[Rim, ...]:
    """The circles that bound the facets of a solid: rims of round holes, and arcs of outlines, one for each."""
    found = list[Rim]()
    holes = ((hole.facet, hole.ring_mm, False) for hole in solid.holes)
    arcs = ((arc.facet, arc.points_mm, True) for arc in solid.arcs)
    for facet, points, outer in (*holes, *arcs):
        normal = solid.normals[facet]
        on_axis, radius, off = circle_along(points, normal)
        at = on_axis + float((points @ normal).mean()) * normal
        if (
            off < ON_CIRCLE_MM
            and len(points) >= FEWEST_ROUND
            and not any(
                np.linalg.norm(at - other.centre_mm) + abs(radius - other.radius_mm) < ONE_MM / 10
                and normal @ other.normal > 0
                for other in found
            )
        ):
            found.append(Rim(at, normal, radius, outer))
    return tuple(found)


@lru_cache(maxsize=4)
def taught_radii(shapes: tuple[Polyhedron, ...]) -> Array:
    """(R,) mm, each once, of the rims of solids."""
    return np.unique([round(rim.radius_mm, 3) for solid in shapes for rim in rims_of(solid)])


def poses_from_circles(seen: Sequence[MeasuredCircle], solids: SolidBatch) -> tuple[PoseBatch, Array]:
    """Taught rims laid onto circles that are seen, in every turn about their axes; and nats (G,) that speak for each
    as further circles lie where it has rims."""
    part, poses, nats = list[Index](), list[Array](), list[Array]()
    turns = frames.rigid(about_z(TURN), np.zeros(3))
    for circle in seen:
        there = frames.rigid(_axes(circle.normal), circle.centre_mm)
        for number, solid in enumerate(solids.shapes):
            for rim in rims_of(solid):
                if abs(rim.radius_mm - circle.radius_mm) < differs_mm(rim.radius_mm):
                    for normal in (rim.normal, -rim.normal)[: 1 + rim.outer]:
                        from_rim = frames.inverse(frames.rigid(_axes(normal), rim.centre_mm))
                        poses.append(there @ turns @ from_rim)
                        part.append(np.full(len(turns), number))
                        nats.append(FOR_EACH * (_met(poses[-1], solid, seen) - 1))
        if len(poses) * len(turns) > MOST_POSES:
            break
    if not poses:
        return PoseBatch(solids, np.zeros(0, np.intp), np.zeros((0, 4, 4))), np.zeros(0)
    return PoseBatch(solids, np.concatenate(part), np.concatenate(poses)), np.concatenate(nats)


@lru_cache(maxsize=1024)
def turns_about_axis(solid: Polyhedron) -> Array:
    """(T, 4, 4) motions that turn a solid about the axis of its widest rim, TURN apart, none first, up to one of its
    symmetries; none alone of a solid that reaches out of that rim: its other turns look different."""
    widest = max(rims_of(solid), key=lambda rim: rim.radius_mm, default=None)
    if widest is None:
        return np.eye(4)[None]
    axes = frames.rigid(_axes(widest.normal), widest.centre_mm)
    from_axis = frames.apply(frames.inverse(axes), solid.corners_mm)
    if np.hypot(*from_axis[:, :2].T).max() > WITHIN_RIM * widest.radius_mm:
        return np.eye(4)[None]
    own = frames.inverse(axes) @ symmetries(solid).motions @ axes
    alike = np.count_nonzero((own[:, 2, 2] > 1 - 1e-4) & (np.linalg.norm(own[:, :3, 3], axis=1) < ONE_MM))
    turns = about_z(TURN)
    return np.asarray(axes @ frames.rigid(turns[: len(turns) // alike], np.zeros(3)) @ frames.inverse(axes))


def _met(poses: Array, solid: Polyhedron, seen: Sequence[MeasuredCircle]) -> Array:
    """(G,) on how many of seen circles a solid at poses (G, 4, 4) has a rim."""
    rims = rims_of(solid)
    radii, sizes = (np.array([one.radius_mm for one in every]) for every in (rims, seen))
    rim, circle = np.nonzero(np.abs(np.subtract.outer(radii, sizes)) < differs_mm(radii)[:, None])
    centres = np.stack([one.centre_mm for one in rims])[rim] @ poses[:, :3, :3].swapaxes(1, 2) + poses[:, None, :3, 3]
    apart2 = ((centres - np.stack([one.centre_mm for one in seen])[circle]) ** 2).sum(2)
    pose, met = np.nonzero(apart2 < MET_MM**2)
    both = np.unique(pose * len(seen) + circle[met])
    return np.bincount(both // len(seen), minlength=len(poses)).astype(float)


def about_z(step: float) -> Array:
    """(N, 3, 3) turns about the z axis, none first, a step apart all the way round."""
    return frames.rotations_from_vectors(np.outer(np.arange(0, 2 * np.pi - step / 2, step), [0.0, 0.0, 1.0]))


def _axes(normal: Array) -> Array:
    """(3, 3) a rotation whose last column is a unit normal (3,)."""
    x, y = axes_in(normal)
    return np.stack([x, y if np.cross(x, y) @ normal > 0 else -y, normal], 1)
