"""How well a view fits the node it called up, element by element and facet by facet (D'Souza, section 5.6, eq. 5.2).

Activation says how alike two matrices are as numbers; here only equality counts, so type numbers may lie as close
together as they like. Equality is on the grid of tests/bench/networks/coding.py.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from daemon.arrays import Array, Index
from tests.bench.networks.rotation.matrices import TaughtMatrices, as_relation, as_taught, both, occupied


@dataclass(frozen=True)
class RotationMatch:
    """difference: equation (5.2), the share of elements that do not differ, 1 for an exact match; the denominator is
    the number of all elements, empty ones included. ratio: facets matched over the facets of the view or the node,
    whichever has more."""

    difference: float
    ratio: float


def modified_match(matrix: Any, node: Any, numbering: Any | None = None) -> RotationMatch:
    """Compare a view's matrix (n, n) with one node (m, m) or (2, m, m), facet p of the view in slot numbering[p].

    numbering defaults to the view's own. Only elements between facets of the view are compared, as the thesis does. A
    facet is matched when its whole row is (the row carries its type and whom it touches).
    """
    array = np.asarray(node, dtype=np.float64)
    taught = as_taught(array[None], complement=array.ndim == 3)
    view = as_relation(matrix, taught.slots)
    slots = np.arange(len(view)) if numbering is None else np.asarray(numbering, dtype=np.int64)
    difference, ratio = matches_at(view, occupied(matrix), taught, np.zeros(1, dtype=np.int64), slots[None])
    return RotationMatch(float(difference[0]), float(ratio[0]))


def matches_at(
    view: Array, filled: Index, taught: TaughtMatrices, nodes: Index, numbering: Index
) -> tuple[Array, Array]:
    """(5.2) and the match ratio at C nodes, (C,) each, facets of the view (n, n) in slots numbering (C, n); filled:
    the facets that touch something."""
    seen = view[filled][:, filled]
    slots = numbering[:, filled]
    place = (nodes[:, None, None], slots[:, :, None], slots[:, None, :])
    lower, upper = both(taught.ends, lambda end: end[place])
    fits = lower == seen if upper is lower else (lower <= seen) & (seen <= upper)
    elements = taught.slots * taught.slots
    difference = (elements - (~fits).sum(axis=(1, 2))) / elements
    most = np.maximum(np.maximum(taught.facets[nodes], len(filled)), 1)
    ratio = fits.all(axis=2).sum(axis=1) / most
    return np.asarray(difference), np.asarray(ratio)
