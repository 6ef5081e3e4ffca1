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
from daemon.arrays import Array, Flags, Index
from daemon.vision.geometry import Baseline, Polyhedron, RectifiedCamera, SolidBatch, axes_in, basis, circle_along
from daemon.vision.hypotheses.junctions import FARTHEST_MM, NEAREST_MM
from daemon.vision.hypotheses.pose_batch import PoseBatch
from daemon.vision.image import Ellipse, StereoImages, pairs_within
from daemon.vision.model import symmetries

ROW_PX = 3.0
"""By how much the upper and the lower ends of one circle's ellipses may differ in height."""
LEVELS = np.array([-0.8, -0.5, -0.2, 0.2, 0.5, 0.8])
"""Heights, in half heights of an ellipse, at which rays meet first."""
MOST_OFF_PX = 0.7
"""Rms of places off the images of their circle: more, and the two ellipses are no circle's."""
STEPS = 8
TURNS, PLACES = 32, 48
"""Points of an ellipse by which two are compared, and places of it to which a circle is fitted."""
ROUGHLY = 0.15
"""Share by which sizes of ellipses may differ from what they are of one circle straight ahead."""
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


def circles_seen(eyes: StereoImages, radii_mm: Array) -> list[Circle]:
    """The circles of about some radii (R,) mm whose images are ellipses in both cameras, the best seen first."""
    geometry = eyes.geometry
    if not len(radii_mm) or not all(view.ellipses for view in eyes.views):
        return []
    left, right = (_InIdeal.of(view.ellipses, view.eye) for view in eyes.views)
    i, j = _could_be_one(left, right, radii_mm, geometry)
    left, right = left.chosen(i), right.chosen(j)
    near, meet = _where_rays_meet(left, right, geometry)
    left, right = left.chosen(meet), right.chosen(meet)
    fitted, rms = _nearest_to_both(near, left, right, geometry)
    count = np.array([len(one.places) + len(other.places) for one, other in zip(left.found, right.found, strict=True)])
    good = np.flatnonzero((rms < MOST_OFF_PX) & _near_a_radius(fitted.radius_mm, radii_mm, 0.0))
    kept = list[Circle]()
    for k in good[np.argsort(rms[good] / np.sqrt(count[good]), kind="stable")]:
        centre, normal, radius = fitted.centre_mm[k], fitted.normal[k], float(fitted.radius_mm[k])
        if all(np.linalg.norm(centre - other.centre_mm) + abs(radius - other.radius_mm) > ONE_MM for other in kept):
            towards = np.sign(float(normal @ (geometry.middle_mm - centre))) or 1.0
            kept.append(Circle(centre, towards * normal, radius))
    return kept


class _InIdeal(NamedTuple):
    """N ellipses, in ideal coordinates: as they were found; points (N, TURNS, 2) all round each; middle (N, 2) and
    half of its width and height (N, 2); reach (N,) the farthest point's distance from the middle."""

    found: list[Ellipse]
    eye: RectifiedCamera
    points: Array
    middle: Array
    half: Array
    reach: Array

    @classmethod
    def of(cls, found: list[Ellipse], eye: RectifiedCamera) -> "_InIdeal":
        turns = 2 * np.pi * np.arange(TURNS) / TURNS
        unit = np.column_stack([np.cos(turns), np.sin(turns)])
        px = np.stack([seen.centre + (unit * seen.radii) @ seen.axes for seen in found])
        points = eye.ideal(px.reshape(-1, 2)).reshape(px.shape)
        least, most = points.min(1), points.max(1)
        middle = (least + most) / 2
        reach = np.linalg.norm(points - middle[:, None], axis=2).max(1)
        return cls(found, eye, points, middle, (most - least) / 2, reach)

    def chosen(self, which: Index) -> "_InIdeal":
        """Some of them."""
        return _InIdeal([self.found[k] for k in which], self.eye, *(own[which] for own in self[2:]))

    def places(self) -> Array:
        """(N, PLACES, 2) where the image shows their edges."""
        px = [one.places[np.linspace(0, len(one.places) - 1, PLACES).astype(int)] for one in self.found]
        return self.eye.ideal(np.concatenate([np.zeros((0, 2)), *px])).reshape(-1, PLACES, 2)

    def sides(self, heights: Array) -> Array:
        """(N, 2, H) where each is farthest left and right at some heights (N, H); nan beyond it."""
        x, y = ((self.points - self.middle[:, None]) / self.reach[:, None, None]).transpose(2, 0, 1)
        conics = np.linalg.svd(np.stack([x * x, x * y, y * y, x, y, np.ones_like(x)], 2))[2][:, 5]
        a, b, c, d, e, f = conics.T[:, :, None]
        y = (heights - self.middle[:, 1:]) / self.reach[:, None]
        # A x^2 + (b y + d) x + (c y^2 + e y + f): x has two values where its discriminant is positive
        middle, root = -(b * y + d) / (2 * a), (b * y + d) ** 2 - 4 * a * (c * y * y + e * y + f)
        with np.errstate(invalid="ignore"):
            half = np.sqrt(root) / abs(2 * a)
        ways = np.stack([middle - half, middle + half], 1) * self.reach[:, None, None]
        return np.asarray(self.middle[:, :1, None] + ways)


def _could_be_one(left: _InIdeal, right: _InIdeal, radii_mm: Array, geometry: Baseline) -> tuple[Index, Index]:
    """Which two ellipses could be of one circle: equally high, about as large, where a part may be, and there about as
    large as a taught rim."""
    row = ROW_PX / geometry.left.focal_px
    i, j = pairs_within(left.middle[:, 1], right.middle[:, 1], row)
    apart = left.middle[i, 0] - right.middle[j, 0]
    good = np.abs(left.half[i, 1] - right.half[j, 1]) < row
    good &= (apart * NEAREST_MM < geometry.length_mm) & (apart * FARTHEST_MM > geometry.length_mm)
    i, j, apart = i[good], j[good], apart[good]
    sizes = np.stack([left.reach[i], right.reach[j]])
    good = np.ptp(sizes, axis=0) < ROUGHLY * sizes.max(0) + row
    good &= _near_a_radius(sizes.mean(0) * geometry.length_mm / apart, radii_mm, ROUGHLY + row / apart)
    return i[good], j[good]


def _near_a_radius(radius_mm: Array, radii_mm: Array, share: Array | float) -> Flags:
    """(N,) which circles' radii (N,) could be one of some (R,), where they are wrong by a share (N,) of themselves."""
    apart = np.abs(np.subtract.outer(radius_mm, radii_mm)) - _differs_mm(radii_mm)
    return np.asarray((apart < np.reshape(share * radius_mm, (-1, 1))).any(1))


class _Circles(NamedTuple):
    """N circles as Circle has one: centre_mm, normal (N, 3), radius_mm (N,)."""

    centre_mm: Array
    normal: Array
    radius_mm: Array


def _where_rays_meet(left: _InIdeal, right: _InIdeal, geometry: Baseline) -> tuple[_Circles, Index]:
    """The circles through where rays of equal height meet; and of which pairs, those that meet nowhere a part may be
    left out."""
    middle = (left.middle[:, 1:] + right.middle[:, 1:]) / 2
    heights = middle + LEVELS * np.minimum(left.half[:, 1:], right.half[:, 1:])
    one, other = (seen.sides(heights).reshape(-1, 2 * len(LEVELS)) for seen in (left, right))
    apart, y = one - other, np.tile(heights, 2)
    near = (apart * NEAREST_MM < geometry.length_mm) & (apart * FARTHEST_MM > geometry.length_mm)
    meet = np.flatnonzero(near.all(1))
    one, other, y = one[meet], other[meet], y[meet]
    ideal = (np.stack([seen, y], 2).reshape(-1, 2) for seen in (one, other))
    points = geometry.points(*ideal).reshape(*y.shape, 3)
    centre = points.mean(1)
    from_centre = points - centre[:, None]
    normal = np.linalg.eigh(from_centre.swapaxes(1, 2) @ from_centre)[1][:, :, 0]
    return _Circles(centre, normal, np.linalg.norm(from_centre, axis=2).mean(1)), meet


def _nearest_to_both(near: _Circles, left: _InIdeal, right: _InIdeal, geometry: Baseline) -> tuple[_Circles, Array]:
    """The circles whose images lie nearest to the places of both ellipses, and the rms (N,) by which, px."""
    places = np.stack([left.places(), right.places()], 1)
    turn = geometry.cyclopean_from_baseline
    rays = places @ turn[:, :2].T + turn[:, 2]
    circles, damping = near, np.full(len(rays), 1e-3)
    off, rows = _off_px(circles, rays, geometry)
    for _ in range(STEPS):
        held = rows.swapaxes(1, 2) @ rows
        held += damping[:, None, None] * np.eye(6) * (held + 1e-9)
        moves = -np.asarray(np.linalg.solve(held, rows.swapaxes(1, 2) @ off[..., None])[..., 0], float)
        moved = _moved(circles, moves)
        after, then = _off_px(moved, rays, geometry)
        better = (after**2).sum(1) <= (off**2).sum(1)
        for old, new in zip((*circles, off, rows), (*moved, after, then), strict=True):
            old[better] = new[better]
        damping = np.where(better, damping / 5, damping * 10)
    return circles, np.sqrt((off**2).mean(1))


def _off_px(circles: _Circles, rays: Array, geometry: Baseline) -> tuple[Array, Array]:
    """(N, M) how far outside a circle's image the M places of both ellipses lie, px, rays (N, 2, PLACES, 3); and
    (N, M, 6) how that changes as _moved moves the circle."""
    eyes, steps = np.stack(geometry.eyes_mm), geometry.cyclopean_from_baseline[:, :2]
    normal = circles.normal[:, None, None]
    facing = (rays * normal).sum(3)
    from_eye = circles.centre_mm[:, None] - eyes
    reach = (from_eye @ circles.normal[..., None]) / facing
    outward = reach[..., None] * rays - from_eye[:, :, None]
    away = np.maximum(np.linalg.norm(outward, axis=3), 1e-9)
    unit = outward / away[..., None]
    tilt = (unit * rays).sum(3) / facing
    slope = reach * np.linalg.norm(unit @ steps - tilt[..., None] * (normal @ steps), axis=3)
    px = geometry.left.focal_px / np.maximum(np.abs(slope), 1e-9)
    across = _across(circles.normal)
    rows = [tilt[..., None] * normal - unit, -tilt[..., None] * (outward @ across[:, None]), -np.ones((*tilt.shape, 1))]
    jacobian = np.concatenate(rows, 3) * px[..., None]
    off = (away - circles.radius_mm[:, None, None]) * px
    return off.reshape(-1, 2 * PLACES), jacobian.reshape(-1, 2 * PLACES, 6)


def _moved(circles: _Circles, moves: Array) -> _Circles:
    """Circles moved (N, 6): their centres, mm, their normals along two axes across them, rad, and their radii, mm."""
    normal = circles.normal + (_across(circles.normal) @ moves[:, 3:5, None])[..., 0]
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return _Circles(circles.centre_mm + moves[:, :3], normal, circles.radius_mm + moves[:, 5])


def _across(normal: Array) -> Array:
    """(N, 3, 2) two unit axes, in columns, across unit normals (N, 3)."""
    return basis(normal, np.eye(3)[np.abs(normal).argmin(1)])[:, :, 1:]


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


@lru_cache(maxsize=4)
def taught_radii(shapes: tuple[Polyhedron, ...]) -> Array:
    """(R,) mm, each once, of the rims of solids."""
    return np.unique([round(rim.radius_mm, 3) for solid in shapes for rim in rims_of(solid)])


def poses_from_circles(seen: Sequence[Circle], solids: SolidBatch) -> tuple[PoseBatch, Array]:
    """Taught rims laid onto circles that are seen, in every turn about their axes; and nats (G,) that speak for each
    as further circles lie where it has rims."""
    part, poses, nats = list[Index](), list[Array](), list[Array]()
    turns = frames.rigid(about_z(TURN), np.zeros(3))
    for circle in seen:
        there = frames.rigid(_axes(circle.normal), circle.centre_mm)
        for number, solid in enumerate(solids.shapes):
            for rim in rims_of(solid):
                if abs(rim.radius_mm - circle.radius_mm) < _differs_mm(rim.radius_mm):
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


def _met(poses: Array, solid: Polyhedron, seen: Sequence[Circle]) -> Array:
    """(G,) on how many of seen circles a solid at poses (G, 4, 4) has a rim."""
    rims = rims_of(solid)
    radii, sizes = (np.array([one.radius_mm for one in every]) for every in (rims, seen))
    rim, circle = np.nonzero(np.abs(np.subtract.outer(radii, sizes)) < _differs_mm(radii)[:, None])
    centres = np.stack([one.centre_mm for one in rims])[rim] @ poses[:, :3, :3].swapaxes(1, 2) + poses[:, None, :3, 3]
    apart2 = ((centres - np.stack([one.centre_mm for one in seen])[circle]) ** 2).sum(2)
    pose, met = np.nonzero(apart2 < MET_MM**2)
    both = np.unique(pose * len(seen) + circle[met])
    return np.bincount(both // len(seen), minlength=len(poses)).astype(float)


def _differs_mm(radius_mm: Array | float) -> Array:
    """By how much a circle's radius may differ from a taught one."""
    return np.asarray(OF_RADIUS * radius_mm + RADIUS_MM)


def about_z(step: float) -> Array:
    """(N, 3, 3) turns about the z axis, none first, a step apart all the way round."""
    return frames.rotations_from_vectors(np.outer(np.arange(0, 2 * np.pi - step / 2, step), [0.0, 0.0, 1.0]))


def _axes(normal: Array) -> Array:
    """(3, 3) a rotation whose last column is a unit normal (3,)."""
    x, y = axes_in(normal)
    return np.stack([x, y if np.cross(x, y) @ normal > 0 else -y, normal], 1)
