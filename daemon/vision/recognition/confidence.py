"""Confidence of a fit: what it says against all that could have fitted as well by chance, and the sizes that say it.

Something that was never taught has facets, joined as a taught part's are, of any size. A fit is evidence by how much
narrower its free sizes were measured than sizes of parts range, each to a likelihood ratio; every way in which a taught
part's facets could have lain there was one more chance. Uncertain corners fit anything: they say nothing. A view's free
sizes are what plane facets, joined as these are, leave open; corners, what binds them and how surely they were measured
give these sizes with covariance. Numbers in, a probability out; tests/bench/many_parts.py measures its reliability.
Source: Bayes factors after Laplace (Kass and Raftery 1995); number of tests as Desolneux, Moisan and Morel (2000).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from daemon import frames
from daemon.arrays import Array, Index
from daemon.vision.geometry import Polyhedron, area_vector, measure
from daemon.vision.model import FacetLibrary, MetricModel, Model, conditions, symmetries
from daemon.vision.recognition.fits import FacetHypothesis

UNTAUGHT = 0.5  # how often something never taught lies in view
REGULAR = 0.5  # how often it is as regular as the facets' types say; else its right angles are all that is regular
SPAN = np.log(8.0)  # sizes of parts are spread over a factor of eight, evenly in their logarithm
NOISE_SIGMA, NOISE_DOF = 1.1, 12.0  # corner errors over predicted ones: what they usually are, worth so many measured


def count_correspondences(observed: Polyhedron, metric: Mapping[str, MetricModel], types: Sequence[str] = ()) -> int:
    """Count in how many ways taught parts could be laid onto what is seen: the places of its rarest edge between two
    facets, or of a single facet. types: of the seen facets; only taught facets of the same types are places then."""
    places = facet_kind_counts(tuple(model.solid for model in metric.values()))
    kinds = tuple(types) or tuple(str(len(ring)) for ring in observed.facets)
    pairs = [(kinds[f], kinds[g]) for f, g in observed.seams]
    if not pairs:
        return min(len(ring) * places[kind,] for kind, ring in zip(kinds, observed.facets, strict=True))
    return min(places[pair] for pair in pairs)


@lru_cache(maxsize=4)
def facet_kind_counts(solids: tuple[Polyhedron, ...]) -> Counter[tuple[str, ...]]:
    """Count the facets of each type, and of each number of sides, that solids have together, and the pairs of them that
    share an edge."""
    found = Counter[tuple[str, ...]]()
    for solid in solids:
        pairs = {(min(pair), max(pair)) for pair in solid.beside.tolist() if min(pair) >= 0}
        for kinds in (solid.types, [str(len(ring)) for ring in solid.facets]):
            if kinds:
                found.update((kind,) for kind in kinds)
                found.update((kinds[a], kinds[b]) for f, g in pairs for a, b in ((f, g), (g, f)))
    return found


def hypothesis_probabilities(observed: Polyhedron, fits: Sequence[FacetHypothesis], model: Model) -> list[float]:
    """Probability of each of the fits, which explain every facet: against each other and against strangers, whose it is
    what is left."""
    best = min(fits, key=lambda h: h.chi2)
    untaught, noise2 = fits_by_chance(observed, best, model)
    odds = list[float]()
    for h in fits:
        as_many = len(symmetries(model.metric[h.label].solid).corners)
        odds.append(as_many * float(np.exp((best.chi2 - h.chi2) / (2 * noise2) + h.nats)))
    # What pictures show besides tells taught parts apart; something not taught may have it as well.
    untaught *= UNTAUGHT / (1 - UNTAUGHT) * float(np.exp(max(0.0, *(h.nats for h in fits))))
    total = sum(odds) + untaught
    return [weight / total for weight in odds]


def label_probabilities(observed: Polyhedron, fits: Sequence[FacetHypothesis], model: Model) -> dict[str, float]:
    """Probability of each label of the fits, in whatever pose."""
    probabilities: dict[str, float] = {}
    for h, probability in zip(fits, hypothesis_probabilities(observed, fits, model), strict=True):
        probabilities[h.label] = probabilities.get(h.label, 0.0) + probability
    return probabilities


def fits_by_chance(observed: Polyhedron, fit: FacetHypothesis, model: Model) -> tuple[float, float]:
    """Return how many fits as good as this one, which explains every facet, an untaught thing with facets so joined is
    expected to have; and the variance of corner errors over the predicted one, as these corners show it."""
    taught, tolerance_mm = model.metric[fit.label].solid, model.parameters.tolerance_mm
    turn, shift = fit.pose[:3, :3], fit.pose[:3, 3]
    there = taught.corners_mm[fit.corners]  # all that follows is in the part's frame, where its bonds are kept
    doubt = turn.T @ observed.covariance_mm2 @ turn + taught.covariance_mm2[fit.corners] + tolerance_mm**2 * np.eye(3)
    weight = np.asarray(np.linalg.inv(doubt))
    residual = (observed.corners_mm - shift) @ turn - there
    types = [taught.types[k] for k in fit.facets] if taught.types else []
    corner, following, _ = observed.steps
    range_mm = SPAN * float(np.sqrt(((there[corner] - there[following]) ** 2).sum(1).mean()))
    free, regular = (
        FreeSizes.of(there, bound, weight, residual, range_mm) for bound in bonds(taught, fit, observed, model.library)
    )
    dof = 3 * len(there) - len(free.covariance) - 6
    noise2 = (NOISE_DOF * NOISE_SIGMA**2 + free.least) / (NOISE_DOF + max(dof, 0))
    return sum(
        share * count_correspondences(observed, model.metric, kinds) * float(np.exp(-sizes.nats(noise2, range_mm)))
        for share, kinds, sizes in ((1 - REGULAR, (), free), (REGULAR, types, regular))
    ), float(noise2)


RIGHT = 0.02  # cosine, or radians off, within which an angle is meant to be right
INDEPENDENT = 0.03  # of the largest singular value: bonds that say less say nothing new


@dataclass(frozen=True, eq=False)
class FreeSizes:
    """covariance (N, N) of the free sizes, each in mm of length; chi2 of the fit with the sizes as taught, and least,
    with those that fit best."""

    covariance: Array
    chi2: float
    least: float

    @classmethod
    def of(cls, corners: Array, bound: Array, weight: Array, residual: Array, range_mm: float) -> FreeSizes:
        """corners (K, 3) mm as taught; bound (R, 3K) what binds them; weight (K, 3, 3) inverse covariance and residual
        (K, 3) mm of the measured ones; range_mm: how far sizes may be from any at all, a standard deviation."""
        count = len(corners)
        about = corners - corners.mean(0)  # far from the origin a turn is next to a shift, and would be lost
        rigid = np.concatenate([np.tile(np.eye(3), count), -frames.cross_matrices(about).reshape(3 * count, 3).T])
        rows = np.concatenate([bound, rigid])
        rows = rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-9)
        squares, ways = np.linalg.eigh(rows.T @ rows)
        # A length that grows by a millimetre moves half of the corners by half of it either way.
        free = ways[:, squares < INDEPENDENT**2 * squares[-1]] * np.sqrt(count) / 2
        number = free.shape[1]
        design = np.concatenate([free, rigid.T], 1)
        weighted = (weight @ design.reshape(count, 3, -1)).reshape(3 * count, -1)
        normal = design.T @ weighted
        normal[np.arange(number), np.arange(number)] += range_mm**-2
        spread = np.linalg.inv(normal)
        right = weighted.T @ residual.ravel()
        chi2 = float(np.einsum("ki,kij,kj->", residual, weight, residual))
        return cls(spread[:number, :number], chi2, chi2 - float(right @ spread @ right))

    def nats(self, noise2: float, range_mm: float) -> float:
        """Log likelihood ratio of the sizes as taught against any in their range, errors having noise2 times the
        predicted variance."""
        logdet = np.linalg.slogdet(2 * np.pi * noise2 * self.covariance)[1]
        return float(len(self.covariance) * np.log(range_mm) - logdet / 2 - (self.chi2 - self.least) / (2 * noise2))


def bonds(taught: Polyhedron, fit: FacetHypothesis, observed: Polyhedron, library: FacetLibrary) -> tuple[Array, Array]:
    """(R, 3K) derivatives by the corners (K, 3) of what is seen, in the frame of a taught solid, of what binds them
    whatever the sizes: plane facets, right angles in facets and between them; and (S, 3K), these and all that the
    facets' types say. fit: which facets and corners of the solid lie behind the seen ones.
    """
    of_facets, count = _bonds_of_facets(taught, library), len(fit.corners)
    own, place = [of_facets[k] for k in fit.facets], np.empty(len(taught.corners_mm), np.intp)
    numbers, firm, more = list[Index](), list[Array](), list[Array]()
    for facet, ring, bound in zip(fit.facets, observed.rings, own, strict=True):
        place[fit.corners[ring]] = ring
        numbers.append(place[taught.rings[facet]])
        firm.append(_placed(bound.firm, numbers[-1], count))
        more.append(_placed(bound.more, numbers[-1], count))
    for f, g in observed.seams:
        sizes = float(np.sqrt((own[f].area @ own[f].area) * (own[g].area @ own[g].area)))
        if abs(float(own[f].area @ own[g].area)) < RIGHT * sizes:
            row = np.zeros((1, 3 * count))
            for one, other in ((f, g), (g, f)):
                turning = _turning(taught.corners_mm[taught.rings[fit.facets[one]]], own[other].area)
                row += _placed(turning[None] / sizes, numbers[one], count)
            firm.append(row)
    return np.concatenate(firm), np.concatenate([*firm, *more])


class _FacetBonds(NamedTuple):
    """Of one facet, derivatives (R, N, 3) by its corners of what binds them whatever its sizes, and of what its type
    says besides; its area vector (3,)."""

    firm: Array
    more: Array
    area: Array


@lru_cache(maxsize=4096)
def _bonds_of_facets(solid: Polyhedron, library: FacetLibrary) -> tuple[_FacetBonds, ...]:
    """Return the constraints of every facet of a taught solid; cached."""
    found = []
    for ring, kind in zip(solid.rings, solid.types or [""] * len(solid.facets), strict=True):
        points = solid.corners_mm[ring]
        measures, area = measure(points), area_vector(points)
        a, b = conditions(measures, kind, library)
        right = ((a != 0).sum(1) == 1) & (np.abs(b - np.pi / 2) < RIGHT)
        stated = a @ measures.jacobian
        firm, more = np.concatenate([_plane(points, area), stated[right]]), stated[~right]
        found.append(_FacetBonds(firm.reshape(-1, len(ring), 3), more.reshape(-1, len(ring), 3), area))
    return tuple(found)


def _placed(rows: Array, corners: Index, count: int) -> Array:
    """(R, 3 count) rows (R, N, 3) of some corners (N,) as rows of all."""
    placed = np.zeros((len(rows), count, 3))
    placed[:, corners] = rows
    return placed.reshape(len(rows), 3 * count)


def _plane(points: Array, area: Array) -> Array:
    """(N, 3N) a facet's corners off its plane."""
    normal = area / np.sqrt(area @ area)
    x = points[1] - points[0]
    flat = np.stack([x, frames.cross_matrices(normal) @ x], 1)
    spanned = np.concatenate([np.ones((len(points), 1)), (points - points.mean(0)) @ flat], 1)
    off = np.eye(len(points)) - spanned @ np.linalg.solve(spanned.T @ spanned, spanned.T)
    return np.asarray((off[:, :, None] * normal).reshape(len(points), -1))


def _turning(points: Array, area: Array) -> Array:
    """(N, 3) derivatives of a facet's area vector along another's (3,), by the facet's corners."""
    here = np.arange(len(points))
    across = points[(here + 1) % len(points)] - points[here - 1]
    return np.asarray(across @ frames.cross_matrices(area) / 2)
