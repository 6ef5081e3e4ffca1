"""The most a view can gain at a node whatever its numbering: which nodes need not be looked into.

A sum of min(x, u) - max(0, x - v) over any pairing of view elements x with node elements [u, v] is greatest when all
are in falling order; and off-diagonal elements stay off the diagonal under any numbering.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from operator import itemgetter

import numpy as np
from numpy.typing import NDArray

from daemon.arrays import Array
from tests.bench.networks.rotation.gains import element_gain
from tests.bench.networks.rotation.matrices import Ends, TaughtMatrices, both

# Nodes whose bound is worked out together, to stay in cache.
PIECE = 2048


@dataclass(frozen=True, eq=False)
class Ceilings:
    """Each node's elements in falling order: off (m * m - m, J) each end off the diagonal, own (m, J) on it. base (J,):
    the overlap of an empty view."""

    off: Ends
    own: Ends
    base: Array
    complement: bool

    @classmethod
    def of(cls, taught: TaughtMatrices, base: Array) -> Ceilings:
        diagonal = np.eye(taught.slots, dtype=bool)
        off, own = (both(taught.ends, partial(_falling, where=where)) for where in (~diagonal, diagonal))
        return cls(off, own, base, taught.complement)

    def overlap(self, view: Array) -> Array:
        """An upper bound on |I ^ w| of the stripped view (k, k) with each node, (J,)."""
        diagonal, bound = np.eye(len(view), dtype=bool), self.base.copy()
        for ends, elements in ((self.off, view[~diagonal]), (self.own, view[diagonal])):
            seen = np.sort(elements[elements > 0.0])[::-1, None]
            for start in range(0, len(bound) if len(seen) else 0, PIECE):
                piece = slice(start, start + PIECE)
                best = both(ends, itemgetter((slice(len(seen)), piece)))
                bound[piece] += element_gain(seen, best, self.complement).sum(axis=0)
        return bound


def _falling(matrices: Array, where: NDArray[np.bool_]) -> Array:
    """(J, m, m) -> the elements of each matrix at `where`, in falling order, (count, J)."""
    return np.ascontiguousarray(np.sort(matrices[:, where], axis=1)[:, ::-1].T)
