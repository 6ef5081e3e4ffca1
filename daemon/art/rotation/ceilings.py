"""The most a view can gain at a node whatever its numbering: which nodes need not be looked into.

A sum of min(x, u) - max(0, x - v) over any pairing of view elements x with node elements [u, v] is greatest when all
are in falling order; and off-diagonal elements stay off the diagonal under any numbering.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daemon.art.rotation.gains import element_gain
from daemon.art.rotation.matrices import TaughtMatrices

Array = NDArray[np.float64]

# Nodes whose bound is worked out together, to stay in cache.
PIECE = 2048


@dataclass(frozen=True, eq=False)
class Ceilings:
    """Each node's elements in falling order: lower, upper (m * m - m, J) off the diagonal, own_lower, own_upper (m, J)
    on it; upper is lower where nodes have learnt one view each. base (J,): the overlap of an empty view."""

    lower: Array
    upper: Array
    own_lower: Array
    own_upper: Array
    base: Array
    complement: bool

    @classmethod
    def of(cls, taught: TaughtMatrices, base: Array) -> Ceilings:
        lower, own_lower = _sorted_elements(taught.lower)
        upper, own_upper = (lower, own_lower)
        if taught.upper is not taught.lower:
            upper, own_upper = _sorted_elements(taught.upper)
        return cls(lower, upper, own_lower, own_upper, base, taught.complement)

    def overlap(self, view: Array) -> Array:
        """An upper bound on |I ^ w| of the stripped view (k, k) with each node, (J,)."""
        off = np.sort(view[~np.eye(len(view), dtype=bool)])[::-1]
        off, own = off[off > 0.0], np.sort(view.diagonal()[view.diagonal() > 0.0])[::-1]
        bound = self.base.copy()
        for start in range(0, len(bound), PIECE):
            piece = slice(start, start + PIECE)
            bound[piece] += self._gain(off, self.lower[: len(off), piece], self.upper[: len(off), piece])
            if len(own):
                bound[piece] += self._gain(own, self.own_lower[: len(own), piece], self.own_upper[: len(own), piece])
        return bound

    def _gain(self, elements: Array, lower: Array, upper: Array) -> Array:
        same = lower if self.upper is self.lower else upper
        return np.asarray(element_gain(elements[:, None], lower, same, self.complement).sum(axis=0))


def _sorted_elements(matrices: Array) -> tuple[Array, Array]:
    """(J, m, m) -> off-diagonal (m * m - m, J) and diagonal (m, J), each in falling order."""
    diagonal = np.eye(matrices.shape[1], dtype=bool)
    off, own = np.sort(matrices[:, ~diagonal], axis=1), np.sort(matrices[:, diagonal], axis=1)
    return np.ascontiguousarray(off[:, ::-1].T), np.ascontiguousarray(own[:, ::-1].T)
