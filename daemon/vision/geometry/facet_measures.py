"""What a facet's corners say in plane geometry: side lengths, interior angles, and how sure they are.

In: corners in any Cartesian frame, mm. Out: numbers with covariance. What they are called is facet_types.py's business.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from daemon.arrays import Array

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
    area: Array = _cross(spokes[:-1], spokes[1:]).sum(0) / 2
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
    n = len(corners)
    here = np.arange(n)
    after, before = (here + 1) % n, here - 1
    normal = newell_normal(corners)
    ahead, behind = corners[after] - corners, corners[before] - corners
    sides = np.maximum(np.sqrt((ahead * ahead).sum(1)), 1e-9)
    behind_length = sides[before]
    angles = np.arctan2(_cross(ahead, behind) @ normal, (ahead * behind).sum(1)) % (2 * np.pi)
    by_ahead = -_cross(normal[None], ahead) / (sides**2)[:, None]
    by_behind = _cross(normal[None], behind) / (behind_length**2)[:, None]
    along = ahead / (sides**2)[:, None]
    jacobian = np.zeros((2 * n, n, 3))
    jacobian[here, after] = by_ahead
    jacobian[here, before] = by_behind
    jacobian[here, here] = -by_ahead - by_behind
    jacobian[n + here, after] = along
    jacobian[n + here, here] = -along
    return Measures(angles, sides, jacobian.reshape(2 * n, 3 * n))


def _cross(a: Array, b: Array) -> Array:
    """Row-wise vector product; numpy's own is several times slower on a handful of rows."""
    return a[:, _NEXT] * b[:, _LAST] - a[:, _LAST] * b[:, _NEXT]
