"""How facets hang together: shared corners, shared edges, and the interfacet relation matrix.

In: a group of facets with corners in mm. Out: the welded outline of what is seen, and the matrix that ART is fed.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from daemon.vision.geometry.polyhedron import Polyhedron
from daemon.vision.values import Facet

Array = NDArray[np.float64]
MATRIX_SIZE = 6  # rows and columns, as in section 4.4.3; grows where a view shows more facets
WELD_PX = 6.0  # how far the two sightings of one corner may lie apart in an image


def weld(facets: tuple[Facet, ...]) -> Polyhedron:
    """Unite the corners that neighbouring facets of one group have in common.

    Two facets share the pair of opposite edges that lies closest in both images, where depth agrees as well.
    A united corner is the weighted mean; its covariance stays that of one facet, because both facets measure the same
    edges in the same pixels, and grows by how far the two sightings lie apart.
    """
    first = np.cumsum([0, *(len(f.corners_mm) for f in facets)])
    points = np.concatenate([f.corners_mm for f in facets])
    covariance = np.concatenate([f.covariance_mm2 for f in facets])
    parent = list(range(len(points)))
    for i, j in combinations(range(len(facets)), 2):
        for a, b in _common_edge(facets[i], facets[j]):
            _unite(parent, int(first[i]) + a, int(first[j]) + b)
    roots = [_root(parent, k) for k in range(len(points))]
    order = {root: n for n, root in enumerate(dict.fromkeys(roots))}
    owner = np.array([order[r] for r in roots])
    corners, spread = _means(points, covariance, owner, len(order))
    rings = tuple(tuple(int(k) for k in owner[first[f] : first[f + 1]]) for f in range(len(facets)))
    return Polyhedron(corners, rings, spread, tuple(f.type for f in facets))


def relation_matrix(numbers: Array, touching: NDArray[np.bool_], size: int = MATRIX_SIZE) -> Array:
    """(m, m) with the type number of facet i in row i, column j, where i and j touch; m = max(size, facets).

    numbers (n,) type numbers; touching (n, n). Rows and columns of absent facets stay 0, and so does the diagonal.
    Source: D'Souza, section 4.4.3: column j lists what facet j is joined to.
    """
    n = len(numbers)
    m = max(size, n)
    matrix = np.zeros((m, m))
    matrix[:n, :n] = np.where(touching & ~np.eye(n, dtype=bool), numbers[:, None], 0.0)
    return matrix


def _common_edge(one: Facet, other: Facet) -> tuple[tuple[int, int], ...]:
    """Corner pairs of the opposite edges that lie closest in both images; nothing where the images disagree.

    Both images together fix depth as well: what coincides in both coincides in space.
    """
    apart_px = np.maximum(_edge_distances(one.left_px, other.left_px), _edge_distances(one.right_px, other.right_px))
    i, j = divmod(int(np.argmin(apart_px)), len(other.corners_mm))
    shortest = min(_shortest_side(one.left_px), _shortest_side(other.left_px))
    if apart_px[i, j] > min(WELD_PX, shortest / 3):
        return ()
    return (i, (j + 1) % len(other.corners_mm)), ((i + 1) % len(one.corners_mm), j)


def _edge_distances(a: Array, b: Array) -> Array:
    """(N, M): how far edge i -> i + 1 of a is from edge j + 1 -> j of b, by its worse end."""
    apart = np.sqrt(((a[:, None, :] - b[None, :, :]) ** 2).sum(2))
    n, m = apart.shape
    return np.asarray(np.maximum(apart[:, (np.arange(m) + 1) % m], apart[(np.arange(n) + 1) % n, :]))


def _shortest_side(corners: Array) -> float:
    return float(np.sqrt(((corners - np.roll(corners, 1, axis=0)) ** 2).sum(1).min()))


def _means(points: Array, covariance: Array, owner: NDArray[np.intp], count: int) -> tuple[Array, Array]:
    information = np.linalg.inv(covariance + 1e-9 * np.eye(3))
    total, weighted, shares = np.zeros((count, 3, 3)), np.zeros((count, 3)), np.zeros(count)
    np.add.at(total, owner, information)
    np.add.at(weighted, owner, (information @ points[..., None])[..., 0])
    np.add.at(shares, owner, 1.0)
    spread = np.linalg.inv(total)
    means = (spread @ weighted[..., None])[..., 0]
    off = points - means[owner]
    scatter = np.zeros((count, 3, 3))
    np.add.at(scatter, owner, off[:, :, None] * off[:, None, :])
    return means, spread * shares[:, None, None] + scatter / shares[:, None, None]


def _root(parent: list[int], k: int) -> int:
    while parent[k] != k:
        k = parent[k]
    return k


def _unite(parent: list[int], a: int, b: int) -> None:
    parent[max(_root(parent, a), _root(parent, b))] = min(_root(parent, a), _root(parent, b))
