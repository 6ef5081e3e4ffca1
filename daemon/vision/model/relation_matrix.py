"""The interfacet relation matrix, which ART is fed: which facets of a view are joined to which.

In: type numbers and who touches whom. Out: the matrix.
"""

from __future__ import annotations

import numpy as np

from daemon.arrays import Array, Flags

MATRIX_SIZE = 6  # rows and columns, as in section 4.4.3; grows where a view shows more facets


def relation_matrix(numbers: Array, touching: Flags, size: int = MATRIX_SIZE) -> Array:
    """(m, m) with the type number of facet i in row i, column j, where i and j touch; m = max(size, facets).

    numbers (n,) type numbers; touching (n, n). Rows and columns of absent facets stay 0, and so does the diagonal.
    Source: D'Souza, section 4.4.3: column j lists what facet j is joined to.
    """
    n = len(numbers)
    m = max(size, n)
    matrix = np.zeros((m, m))
    matrix[:n, :n] = np.where(touching & ~np.eye(n, dtype=bool), numbers[:, None], 0.0)
    return matrix
