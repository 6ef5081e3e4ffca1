"""What a facet's corners say: their plane, side lengths, interior angles, and how sure these are.

In: corners in any Cartesian frame, mm. Out: numbers with covariance. What they are called is facet_types.py's business.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from daemon.arrays import Array
from daemon.vision.geometry.polygon import Rings, rings

CHORD_MM = 0.6
"""Distance, mm, of the chords of an arc from it, half inside and half outside: an arc of 10 mm and more then has chords
long enough for a look (12 px). On 19 rendered looks at parts with rounded ends 12 were named right with this value, 8
with 0.3 and 2 with larger ones."""
_NEXT, _LAST = np.array([1, 2, 0]), np.array([2, 0, 1])


@dataclass(frozen=True, eq=False)
class Measures:
    """angles (N,) rad, interior, at each corner, in (0, 2 pi); sides (N,) mm, side i runs from corner i to i + 1.

    jacobian (2N, 3N): of [angles, log sides] by the corners' coordinates (corner by corner, x y z).
    """

    angles: Array
    sides: Array
    jacobian: Array

    @property
    def values(self) -> Array:
        """(2N,) [angles, log sides]."""
        return np.concatenate([self.angles, np.log(self.sides)])

    def covariance(self, corner_covariance: Array) -> Array:
        """(2N, 2N) of `values`, from (N, 3, 3) mm^2 of independent corners."""
        n = len(self.sides)
        blocks = self.jacobian.reshape(2 * n, n, 3)
        weighted = np.matmul(blocks.transpose(1, 0, 2), corner_covariance)
        return np.asarray(weighted.transpose(1, 0, 2).reshape(2 * n, 3 * n) @ self.jacobian.T)


def area_vector(corners: Array) -> Array:
    """(3,) mm^2: the area of a nearly plane polygon (N, 3), along its normal by the right-hand rule of its order."""
    spokes = corners[1:] - corners[0]
    area: Array = cross(spokes[:-1], spokes[1:]).sum(0) / 2
    return area


def newell_normal(corners: Array) -> Array:
    """Unit normal (3,) of a nearly plane polygon (N, 3), by the right-hand rule of its order; zero when degenerate."""
    normal = area_vector(corners)
    length = float(np.sqrt(normal @ normal))
    return normal / length if length > 0 else normal


def measure(corners: Array) -> Measures:
    """Angles, sides and their derivatives for (N, 3) corners, mm, anticlockwise about their normal; N >= 3.

    Source: D'Souza, section 4.4.1 (angles from the scalar product), made signed so that reflex corners count, with
    first-order error propagation in the facet's plane.
    """
    return measure_each([corners])[0]


def measure_each(facets: Sequence[Array]) -> list[Measures]:
    """Measure many facets' corners (N, 3), side by side, as `measure` does one."""
    if not facets:
        return []
    shape = rings(facets)
    corners, after = shape.corners, shape.next
    spokes = corners - corners[shape.first].repeat(shape.count, 0)
    area = shape.sums(cross(spokes, spokes[after]))
    normal = (area / np.maximum(np.sqrt((area * area).sum(1, keepdims=True)), 1e-12)).repeat(shape.count, 0)
    ahead = corners[after] - corners
    behind = -ahead[shape.before]
    sides = np.maximum(np.sqrt((ahead * ahead).sum(1)), 1e-9)
    squares = (sides**2)[:, None]
    angles = np.arctan2((cross(ahead, behind) * normal).sum(1), (ahead * behind).sum(1)) % (2 * np.pi)
    by_ahead, by_behind = -cross(normal, ahead) / squares, cross(normal, behind) / squares[shape.before]
    moves = np.stack([by_ahead, by_behind, -by_ahead - by_behind, ahead / squares], 1)
    return [_measures(*own) for own in zip(*(shape.split(each) for each in (angles, sides, moves)), strict=True)]


def _measures(angles: Array, sides: Array, moves: Array) -> Measures:
    """moves (N, 4, 3): how an angle changes with the corner after it, the one before it and its own, and how the
    logarithm of the side that begins there does with the one after it."""
    n = len(angles)
    here = np.arange(n)
    after = here + 1 - n  # counted from the last
    jacobian = np.zeros((2 * n, n, 3))
    jacobian[here, after], jacobian[here, here - 1], jacobian[here, here] = moves[:, 0], moves[:, 1], moves[:, 2]
    jacobian[n + here, after], jacobian[n + here, here] = moves[:, 3], -moves[:, 3]
    return Measures(angles, sides, jacobian.reshape(2 * n, 3 * n))


def cross(a: Array, b: Array) -> Array:
    """Row-wise vector product; numpy's own is several times slower on a handful of rows."""
    return a[:, _NEXT] * b[:, _LAST] - a[:, _LAST] * b[:, _NEXT]


def fit_plane(points: Array) -> tuple[Array, float]:
    """Least-squares plane n . p = d of (N, 3) points: unit normal n towards the cameras (n_z <= 0), and d."""
    centre = points.mean(0)
    normal = np.linalg.svd(points - centre)[2][2]
    if normal @ centre > 0:
        normal = -normal
    return normal, float(normal @ centre)


def axes_in(normal: Array) -> Array:
    """(2, 3) unit axes, at right angles to each other, in a plane with a normal (3,) of any length."""
    return np.asarray(np.linalg.svd(normal[None])[2][1:])


def basis(x: Array, to: Array) -> Array:
    """(N, 3, 3) rotations whose columns are unit x (N, 3), the rest of `to` (N, 3) at right angles to it, and their
    cross product."""
    y = to - (x * to).sum(1, keepdims=True) * x
    y = y / np.maximum(np.linalg.norm(y, axis=1, keepdims=True), 1e-12)
    return np.stack([x, y, np.cross(x, y)], 2)


def apart2(one: Array, other: Array) -> Array:
    """(..., N, K) squares of the distances of points (..., N, 3) from each of others (..., K, 3)."""
    return np.asarray(sum((one[..., :, None, k] - other[..., None, :, k]) ** 2 for k in range(3)))


def fit_circle(points: Array) -> tuple[Array, float, float]:
    """Algebraic least-squares circle through (K, 2) points: centre, radius, and how far the worst point lies off it."""
    terms = np.column_stack([2 * points, np.ones(len(points))])
    solution = np.linalg.lstsq(terms, (points**2).sum(1), rcond=None)[0]
    centre = solution[:2]
    radius = float(np.sqrt(max(float(solution[2] + centre @ centre), 0.0)))
    return centre, radius, float(np.abs(np.linalg.norm(points - centre, axis=1) - radius).max())


def circle_along(points: Array, axis: Array) -> tuple[Array, float, float]:
    """The circle through (K, 3) points as they are seen along an axis (3,): a point of the circle's axis, radius, and
    how far the worst point lies off it."""
    across = axes_in(axis)
    centre, radius, off = fit_circle(points @ across.T)
    return centre @ across, radius, off


def chord_turns(radius_mm: float, sweep_rad: float, closed: bool) -> tuple[Array, float]:
    """Return where the chords that an arc is cut into meet: the shares (N,) of its sweep, without its ends where it is
    open, and at how many radii from its centre. They lie as far inside the arc at their middles as outside at their
    ends; round a whole circle there are four, or a multiple, so that turns of a part onto itself stay such."""
    step = 2 * np.arccos(max(1 - CHORD_MM / radius_mm, 0.5))
    count = max(int(np.ceil(abs(sweep_rad) / step)), 1)
    count = 4 * int(np.ceil(count / 4)) if closed else count
    shares = (np.arange(count) if closed else np.arange(1, count)) / count
    return shares, float(2 / (1 + np.cos(sweep_rad / count / 2)))


def onto_circles(points: Array, circles: Array) -> Array:
    """(..., 3) points (..., 3) in the planes of circles (..., 4), centre and radius, moved onto them along a radius."""
    from_centre = points - circles[..., :3]
    size = circles[..., 3:] / np.linalg.norm(from_centre, axis=-1, keepdims=True)
    return np.asarray(circles[..., :3] + size * from_centre)


def weighted_plane(points: Array, covariance: Array) -> tuple[Array, float, Array]:
    """Plane n . p = d with each corner weighted by how well it is known along the normal, and residuals in sigmas (N,).

    points (N, 3) mm, covariance (N, 3, 3) mm^2.
    """
    normal, d = fit_plane(points)
    for _ in range(2):
        sigma = np.sqrt(np.maximum(covariance @ normal @ normal, 1e-8))
        weight = 1 / sigma**2
        centre = (weight @ points) / weight.sum()
        normal = np.linalg.svd((points - centre) / sigma[:, None])[2][2]
        if normal @ centre > 0:
            normal = -normal
        d = float(normal @ centre)
    return normal, d, (points @ normal - d) / sigma


def planarity(points: Array) -> float:
    """Rms distance, mm, of the corners (N, 3) from their best plane."""
    return planarities(rings([points]))[0]


def planarities(shape: Rings) -> list[float]:
    """Return the planarity of many polygons in space, as `planarity` does of one."""
    count = shape.count[:, None]
    centred = shape.corners - np.repeat(shape.sums(shape.corners) / count, shape.count, axis=0)
    scatter = shape.sums(centred[:, :, None] * centred[:, None]) / count[:, None]
    least: list[float] = np.sqrt(np.maximum(np.linalg.eigvalsh(scatter)[:, 0], 0.0)).tolist()
    return least
