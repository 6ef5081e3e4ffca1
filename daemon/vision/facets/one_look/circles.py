"""Circles that both cameras see: the rims of bores, of round faces, of rounded ends.

In: ellipses of both images. Out: circles in space, with the ellipses that each was measured by. Source: rays of both
cameras meet on the ellipses at equal heights; then the circle whose images lie nearest to both.
"""

from typing import NamedTuple

import numpy as np

from daemon.arrays import Array, Flags, Index
from daemon.vision.geometry import Baseline, RectifiedCamera, basis
from daemon.vision.image import Ellipse, StereoImages, pairs_within

NEAREST_MM, FARTHEST_MM = 120.0, 1500.0
"""Range of distances, mm, at which parts may be."""
ROW_PX = 3.0
"""Largest difference, px, in height of the upper and of the lower ends of one circle's ellipses."""
LEVELS = np.array([-0.8, -0.5, -0.2, 0.2, 0.5, 0.8])
"""Heights, in half heights of an ellipse, at which rays meet first."""
MAX_OFF_PX = 0.7
"""Rms of places off the images of their circle: more, and the two ellipses are no circle's."""
STEPS, SURE = 8, 1e-9
"""Number of steps of the fit, and the term that keeps its covariance finite."""
TURNS, PLACES = 32, 48
"""Points of an ellipse by which two are compared, and places of it to which a circle is fitted."""
ROUGHLY = 0.15
"""Share by which sizes of ellipses may differ from what they are of one circle straight ahead."""
OF_RADIUS, RADIUS_MM = 0.06, 0.4
"""Largest difference of the radius of a seen circle from a taught one, as a share and in mm."""
ONE_MM = 1.0
"""Circles whose centres and radii differ by less are one."""


class MeasuredCircle(NamedTuple):
    """centre_mm, normal (3,), unit, towards the cameras, radius_mm, cyclopean; covariance (6, 6) of the centre, mm, of
    the normal along two axes across it, rad, and of the radius, mm; left, right: the ellipses it was measured by."""

    centre_mm: Array
    normal: Array
    radius_mm: float
    covariance: Array
    left: Ellipse
    right: Ellipse


def find_circles(images: StereoImages, radii_mm: Array | None = None) -> list[MeasuredCircle]:
    """The circles of about some radii (R,) mm, or of any, whose images are ellipses in both cameras, the best seen
    first."""
    geometry = images.geometry
    if (radii_mm is not None and not len(radii_mm)) or not all(view.ellipses for view in images.views):
        return []
    left, right = (_InIdeal.of(view.ellipses, view.rectified) for view in images.views)
    i, j = _could_be_one(left, right, radii_mm, geometry)
    left, right = left.chosen(i), right.chosen(j)
    near, meet = _where_rays_meet(left, right, geometry)
    left, right = left.chosen(meet), right.chosen(meet)
    fitted, rms, covariance = _nearest_to_both(near, left, right, geometry)
    count = np.array([len(one.places) + len(other.places) for one, other in zip(left.found, right.found, strict=True)])
    good = np.flatnonzero((rms < MAX_OFF_PX) & _near_a_radius(fitted.radius_mm, radii_mm, 0.0))
    kept = list[MeasuredCircle]()
    for k in good[np.argsort(rms[good] / np.sqrt(count[good]), kind="stable")]:
        centre, normal, radius = fitted.centre_mm[k], fitted.normal[k], float(fitted.radius_mm[k])
        if all(np.linalg.norm(centre - other.centre_mm) + abs(radius - other.radius_mm) > ONE_MM for other in kept):
            towards = np.sign(float(normal @ (geometry.middle_mm - centre))) or 1.0
            ellipses = left.found[k], right.found[k]
            kept.append(MeasuredCircle(centre, towards * normal, radius, covariance[k], *ellipses))
    return kept


class _InIdeal(NamedTuple):
    """N ellipses, in ideal coordinates: as they were found; points (N, TURNS, 2) all round each; middle (N, 2) and
    half of its width and height (N, 2); reach (N,) the farthest point's distance from the middle."""

    found: list[Ellipse]
    camera: RectifiedCamera
    points: Array
    middle: Array
    half: Array
    reach: Array

    @classmethod
    def of(cls, found: list[Ellipse], camera: RectifiedCamera) -> "_InIdeal":
        turns = 2 * np.pi * np.arange(TURNS) / TURNS
        unit = np.column_stack([np.cos(turns), np.sin(turns)])
        px = np.stack([seen.centre + (unit * seen.radii) @ seen.axes for seen in found])
        points = camera.ideal(px.reshape(-1, 2)).reshape(px.shape)
        least, most = points.min(1), points.max(1)
        middle = (least + most) / 2
        reach = np.linalg.norm(points - middle[:, None], axis=2).max(1)
        return cls(found, camera, points, middle, (most - least) / 2, reach)

    def chosen(self, which: Index) -> "_InIdeal":
        """Some of them."""
        return _InIdeal([self.found[k] for k in which], self.camera, *(own[which] for own in self[2:]))

    def places(self) -> Array:
        """(N, PLACES, 2) where the image shows their edges."""
        px = [one.places[np.linspace(0, len(one.places) - 1, PLACES).astype(int)] for one in self.found]
        return self.camera.ideal(np.concatenate([np.zeros((0, 2)), *px])).reshape(-1, PLACES, 2)

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


def _could_be_one(left: _InIdeal, right: _InIdeal, radii_mm: Array | None, geometry: Baseline) -> tuple[Index, Index]:
    """Return which two ellipses could be of one circle: equally high, about as large, where a part may be, and there
    about as large as a taught rim."""
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


def _near_a_radius(radius_mm: Array, radii_mm: Array | None, share: Array | float) -> Flags:
    """(N,) which circles' radii (N,) could be one of some (R,), where they are wrong by a share (N,) of themselves."""
    if radii_mm is None:
        return np.ones(len(radius_mm), bool)
    apart = np.abs(np.subtract.outer(radius_mm, radii_mm)) - differs_mm(radii_mm)
    return np.asarray((apart < np.reshape(share * radius_mm, (-1, 1))).any(1))


class _Circles(NamedTuple):
    """N circles as MeasuredCircle has one: centre_mm, normal (N, 3), radius_mm (N,)."""

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


def _nearest_to_both(
    near: _Circles, left: _InIdeal, right: _InIdeal, geometry: Baseline
) -> tuple[_Circles, Array, Array]:
    """The circles whose images lie nearest to the places of both ellipses, the rms (N,) by which, px, and their
    covariance (N, 6, 6) as MeasuredCircle has it."""
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
    rms = np.sqrt((off**2).mean(1))
    covariance = np.linalg.inv(rows.swapaxes(1, 2) @ rows + SURE * np.eye(6)) * (rms**2)[:, None, None]
    return circles, rms, covariance


def _off_px(circles: _Circles, rays: Array, geometry: Baseline) -> tuple[Array, Array]:
    """(N, M) how far outside a circle's image the M places of both ellipses lie, px, rays (N, 2, PLACES, 3); and
    (N, M, 6) how that changes as _moved moves the circle."""
    images, steps = np.stack(geometry.cameras_mm), geometry.cyclopean_from_baseline[:, :2]
    normal = circles.normal[:, None, None]
    facing = (rays * normal).sum(3)
    from_camera = circles.centre_mm[:, None] - images
    reach = (from_camera @ circles.normal[..., None]) / facing
    outward = reach[..., None] * rays - from_camera[:, :, None]
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


def differs_mm(radius_mm: Array | float) -> Array:
    """Return by how many mm a circle's radius may differ from a taught one."""
    return np.asarray(OF_RADIUS * radius_mm + RADIUS_MM)
