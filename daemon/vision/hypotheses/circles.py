"""Circles that both cameras see, and where taught parts would be that have such a rim: a bore's, a round face's, a
rounded end's.

In: ellipses of both images, taught solids. Out: circles in space, and poses. A circle gives its centre, normal and
radius, and not the turn about its axis: every turn is a hypothesis of its own, and the part's other edges decide.
Source: rays of both cameras meet on the ellipses at equal heights; then the circle whose images lie nearest to both.
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from daemon import frames
from daemon.arrays import Array, Index
from daemon.vision.geometry import Baseline, Polyhedron, RectifiedCamera, SolidBatch, axes_in, circle_along
from daemon.vision.hypotheses.junctions import FARTHEST_MM, NEAREST_MM
from daemon.vision.hypotheses.pose_batch import PoseBatch
from daemon.vision.image import Ellipse, StereoImages
from daemon.vision.model import symmetries

ROW_PX = 3.0
"""By how much the upper and the lower ends of one circle's ellipses may differ in height."""
LEVELS = np.array([-0.8, -0.5, -0.2, 0.2, 0.5, 0.8])
"""Heights, in half heights of an ellipse, at which rays meet first."""
MOST_OFF_PX = 0.6
"""Rms of places off the images of their circle: more, and the two ellipses are no circle's."""
STEPS, SMALL = 8, 1e-4
RADII_MM = 1.0, 60.0
OF_RADIUS, RADIUS_MM = 0.06, 0.4
"""By how much the radius of a seen circle may differ from a taught one."""
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


class Circle(NamedTuple):
    """centre_mm, normal (3,), unit, and radius_mm: of a rim of a solid, its normal out of the facet that it bounds, or
    of one that is seen, its normal towards the cameras, cyclopean. outer: that a solid's rim is in the facet's outline,
    and shows from behind as well."""

    centre_mm: Array
    normal: Array
    radius_mm: float
    outer: bool = False


def circles_seen(eyes: StereoImages) -> list[Circle]:
    """The circles whose images are ellipses in both cameras, those with most places first."""
    geometry = eyes.geometry
    both = [[_InIdeal.of(one, view.eye) for one in view.ellipses] for view in eyes.views]
    found = list[tuple[float, Circle]]()
    row = ROW_PX / geometry.left.focal_px
    for left in both[0]:
        for right in both[1]:
            if max(abs(left.middle - right.middle), abs(left.half - right.half)) > row:
                continue
            near = _where_rays_meet(left, right, geometry)
            fitted = None if near is None else _nearest_to_both(near, left, right, geometry)
            if fitted is not None and RADII_MM[0] < fitted[0].radius_mm < RADII_MM[1]:
                found.append((fitted[1] / np.sqrt(len(left.places) + len(right.places)), fitted[0]))
    kept = list[Circle]()
    for _, one in sorted(found, key=lambda pair: pair[0]):
        if all(np.linalg.norm(one.centre_mm - other.centre_mm) + abs(one.radius_mm - other.radius_mm) > ONE_MM
               for other in kept):  # fmt: skip
            kept.append(one)
    return kept


class _InIdeal(NamedTuple):
    """An ellipse in ideal coordinates: its places (N, 2); conic (6,), of x x, x y, y y, x, y and 1; middle and half of
    its height."""

    places: Array
    conic: Array
    middle: float
    half: float

    @classmethod
    def of(cls, seen: Ellipse, eye: RectifiedCamera) -> "_InIdeal":
        turns = 2 * np.pi * np.arange(32) / 32
        unit = np.column_stack([np.cos(turns), np.sin(turns)])
        whole = eye.ideal(seen.centre + (unit * seen.radii) @ seen.axes)
        centre, size = whole.mean(0), np.ptp(whole, axis=0).max() / 2
        x, y = ((whole - centre) / size).T
        a, b, c, d, e, f = np.linalg.svd(np.stack([x * x, x * y, y * y, x, y, np.ones_like(x)], 1))[2][5]
        # A x^2 + (b y + d) x + (c y^2 + e y + f): x has two values between the heights where its discriminant is 0
        least, most = np.sort(np.roots([b * b - 4 * a * c, 2 * b * d - 4 * a * e, d * d - 4 * a * f]).real)
        conic = np.array([a, b, c, d, e, f])
        return cls(eye.ideal(seen.places), np.array([*conic, *centre, size]),
                   float(centre[1] + size * (least + most) / 2), float(size * (most - least) / 2))  # fmt: skip

    def sides(self, heights: Array) -> Array:
        """(2, N) where it is farthest left and right at some heights (N,); nan beyond it."""
        a, b, c, d, e, f, u, v, size = self.conic
        y = (heights - v) / size
        middle, root = -(b * y + d) / (2 * a), (b * y + d) ** 2 - 4 * a * (c * y * y + e * y + f)
        with np.errstate(invalid="ignore"):
            half = np.sqrt(root) / abs(2 * a)
        return np.asarray(u + size * np.stack([middle - half, middle + half]))


def _where_rays_meet(left: _InIdeal, right: _InIdeal, geometry: Baseline) -> Circle | None:
    """The circle through where rays of equal height meet; None where it is nowhere a part may be."""
    heights = (left.middle + right.middle) / 2 + LEVELS * min(left.half, right.half)
    one, other = (np.concatenate(seen.sides(heights)) for seen in (left, right))
    apart, y = one - other, np.tile(heights, 2)
    if not (apart * NEAREST_MM < geometry.length_mm).all() or not (apart * FARTHEST_MM > geometry.length_mm).all():
        return None
    points = geometry.points(np.stack([one, y], 1), np.stack([other, y], 1))
    centre = points.mean(0)
    normal = np.linalg.svd(points - centre)[2][2]
    return Circle(centre, normal, float(np.linalg.norm(points - centre, axis=1).mean()))


def _nearest_to_both(near: Circle, left: _InIdeal, right: _InIdeal, geometry: Baseline) -> tuple[Circle, float] | None:
    """The circle whose images lie nearest to the places of both ellipses, and the rms by which, px; None where they are
    too far."""
    turn = geometry.cyclopean_from_baseline
    rays = [np.column_stack([seen.places, np.ones(len(seen.places))]) @ turn.T for seen in (left, right)]
    steps = turn[:, :2].T
    focal_px = geometry.left.focal_px
    circle, damping = near, 1e-3

    def off_px(one: Circle) -> Array:
        found = []
        for own, eye_mm in zip(rays, geometry.eyes_mm, strict=True):
            here, *beside = (_off_mm(one, own + shift, eye_mm) for shift in (0.0, *(SMALL * steps)))
            slope = np.hypot(*((other - here) / SMALL for other in beside))
            found.append(here * focal_px / np.maximum(slope, 1e-9))
        return np.concatenate(found)

    off = off_px(circle)
    for _ in range(STEPS):
        across = axes_in(circle.normal)
        jacobian = np.stack([(off_px(_moved(circle, across, move)) - off) / SMALL for move in SMALL * np.eye(6)], 1)
        held = jacobian.T @ jacobian
        held += damping * np.diag(np.diag(held) + 1e-9)
        step = np.asarray(np.linalg.solve(held, -jacobian.T @ off), float)
        better = _moved(circle, across, step)
        after = off_px(better)
        if not np.isfinite(after).all() or after @ after > off @ off:
            damping *= 10
            continue
        still = off @ off - after @ after < 1e-3 * (off @ off)
        circle, off, damping = better, after, damping / 5
        if still:
            break
    rms = float(np.sqrt((off**2).mean()))
    if not rms < MOST_OFF_PX:
        return None
    towards = np.sign(float(circle.normal @ (geometry.middle_mm - circle.centre_mm))) or 1.0
    return circle._replace(normal=towards * circle.normal), rms


def _off_mm(circle: Circle, rays: Array, eye_mm: Array) -> Array:
    """(N,) how far outside a circle, in its plane, rays (N, 3) from an eye go through."""
    reach = float((circle.centre_mm - eye_mm) @ circle.normal) / (rays @ circle.normal)
    return np.asarray(np.linalg.norm(eye_mm + reach[:, None] * rays - circle.centre_mm, axis=1) - circle.radius_mm)


def _moved(circle: Circle, across: Array, move: Array) -> Circle:
    """A circle moved (6,): its centre, mm, its normal along axes (2, 3) across it, rad, and its radius, mm."""
    normal = circle.normal + move[3:5] @ across
    return Circle(circle.centre_mm + move[:3], normal / np.linalg.norm(normal), circle.radius_mm + float(move[5]))


@lru_cache(maxsize=4096)
def rims_of(solid: Polyhedron) -> tuple[Circle, ...]:
    """The circles that bound the facets of a solid: rims of round holes, and arcs of outlines, one for each."""
    found = list[Circle]()
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
            found.append(Circle(at, normal, radius, outer))
    return tuple(found)


def poses_from_circles(seen: Sequence[Circle], solids: SolidBatch) -> tuple[PoseBatch, Array]:
    """Taught rims laid onto circles that are seen, in every turn about their axes; and nats (G,) that speak for each
    as further circles lie where it has rims."""
    part, poses, nats = list[Index](), list[Array](), list[Array]()
    turns = frames.rigid(about_z(TURN), np.zeros(3))
    for circle in seen:
        there = frames.rigid(_axes(circle.normal), circle.centre_mm)
        for number, solid in enumerate(solids.shapes):
            for rim in rims_of(solid):
                if abs(rim.radius_mm - circle.radius_mm) < _differs_mm(rim):
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
    alike = np.count_nonzero((own[:, 2, 2] > 1 - SMALL) & (np.linalg.norm(own[:, :3, 3], axis=1) < ONE_MM))
    turns = about_z(TURN)
    return np.asarray(axes @ frames.rigid(turns[: len(turns) // alike], np.zeros(3)) @ frames.inverse(axes))


def _met(poses: Array, solid: Polyhedron, seen: Sequence[Circle]) -> Array:
    """(G,) on how many of seen circles a solid at poses (G, 4, 4) has a rim."""
    rims = rims_of(solid)
    centres = np.stack([rim.centre_mm for rim in rims]) @ poses[:, :3, :3].swapaxes(1, 2) + poses[:, None, :3, 3]
    apart = np.linalg.norm(centres[:, :, None] - np.stack([one.centre_mm for one in seen]), axis=3)
    size = np.abs(np.subtract.outer([rim.radius_mm for rim in rims], [one.radius_mm for one in seen]))
    alike = size < np.array([_differs_mm(rim) for rim in rims])[:, None]
    return np.asarray(((apart < MET_MM) & alike).any(1).sum(1), float)


def _differs_mm(rim: Circle) -> float:
    """By how much a circle's radius may differ from a taught one."""
    return OF_RADIUS * rim.radius_mm + RADIUS_MM


def about_z(step: float) -> Array:
    """(N, 3, 3) turns about the z axis, none first, a step apart all the way round."""
    return frames.rotations_from_vectors(np.outer(np.arange(0, 2 * np.pi - step / 2, step), [0.0, 0.0, 1.0]))


def _axes(normal: Array) -> Array:
    """(3, 3) a rotation whose last column is a unit normal (3,)."""
    x, y = axes_in(normal)
    return np.stack([x, y if np.cross(x, y) @ normal > 0 else -y, normal], 1)
