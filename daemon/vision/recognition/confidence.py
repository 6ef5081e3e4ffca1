"""How far a fit is believed: what it says against all that could have fitted as well by chance.

Something that was never taught has facets, joined as a taught part's are, of any size. A fit is evidence by how much
narrower its free sizes were measured than sizes of parts range, each to a likelihood ratio; and every way in which a
taught part's facets could have lain there was one more chance. Corners of which one is unsure fit anything: they say
nothing. Numbers in, a probability out; its reliability is measured in tests/bench/many_parts.py.
Source: Bayes factors after Laplace (Kass and Raftery 1995); number of tests as Desolneux, Moisan and Morel (2000).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from functools import lru_cache

import numpy as np

from daemon import frames
from daemon.vision.geometry import Polyhedron
from daemon.vision.model import MetricModel, Model, symmetries
from daemon.vision.recognition.fits import Hypothesis
from daemon.vision.recognition.free_sizes import FreeSizes, bonds

STRANGER = 0.5  # how often something never taught lies in view
REGULAR = 0.5  # how often it is as regular as the facets' types say; else its right angles are all that is regular
SPAN = np.log(8.0)  # sizes of parts are spread over a factor of eight, evenly in their logarithm
NOISE_SIGMA, NOISE_DOF = 1.1, 12.0  # corner errors over predicted ones: what they usually are, worth so many measured


def ways_tried(seen: Polyhedron, metric: Mapping[str, MetricModel], types: Sequence[str] = ()) -> int:
    """In how many ways taught parts could be laid onto what is seen: the places of its rarest edge between two facets,
    or of a lone facet. types: of the seen facets; only taught facets of the same types are places then.
    """
    places = [_places(known.solid, bool(types)) for known in metric.values()]
    kinds = tuple(types) or tuple(str(len(ring)) for ring in seen.facets)
    pairs = [(kinds[f], kinds[g]) for f, g in seen.seams]
    if not pairs:
        return min(len(ring) * sum(p[kind,] for p in places) for kind, ring in zip(kinds, seen.facets, strict=True))
    return min(sum(p[pair] for p in places) for pair in pairs)


@lru_cache(maxsize=1024)
def _places(solid: Polyhedron, typed: bool) -> Counter[tuple[str, ...]]:
    """How many facets of each type, or number of sides, a taught part has, and how many pairs of them share an edge."""
    kinds = solid.types if typed else [str(len(ring)) for ring in solid.facets]
    pairs = [(kinds[a], kinds[b]) for f, g in solid.seams for a, b in ((f, g), (g, f))]
    return Counter([*((kind,) for kind in kinds), *pairs])


def weighed(seen: Polyhedron, fits: Sequence[Hypothesis], model: Model) -> list[float]:
    """Probability of each of the fits, which explain every facet: against each other and against strangers, whose it is
    what is left."""
    best = min(fits, key=lambda h: h.chi2)
    stranger, noise2 = by_chance(seen, best, model)
    odds = list[float]()
    for h in fits:
        as_many = len(symmetries(model.metric[h.label].solid)[0])
        odds.append(as_many * float(np.exp((best.chi2 - h.chi2) / (2 * noise2))))
    stranger *= STRANGER / (1 - STRANGER)
    total = sum(odds) + stranger
    return [weight / total for weight in odds]


def probability(seen: Polyhedron, fits: Sequence[Hypothesis], model: Model) -> dict[str, float]:
    """Probability of each label of the fits, in whatever pose."""
    chances: dict[str, float] = {}
    for h, chance in zip(fits, weighed(seen, fits, model), strict=True):
        chances[h.label] = chances.get(h.label, 0.0) + chance
    return chances


def by_chance(seen: Polyhedron, fit: Hypothesis, model: Model) -> tuple[float, float]:
    """How many fits as good as this one, which explains every facet, a stranger whose facets are so joined is to be
    expected to have; and the variance of corner errors over the predicted one, as these corners show it.
    """
    taught, tolerance_mm = model.metric[fit.label].solid, model.parameters.tolerance_mm
    turn = fit.pose[:3, :3]
    there = frames.apply(fit.pose, taught.corners_mm[fit.corners])
    doubt = seen.covariance_mm2 + turn @ taught.covariance_mm2[fit.corners] @ turn.T + tolerance_mm**2 * np.eye(3)
    weight = np.asarray(np.linalg.inv(doubt))
    residual = seen.corners_mm - there
    types = [taught.types[k] for k in fit.facets] if taught.types else [""] * len(fit.facets)
    corner, following, _ = seen.steps
    range_mm = SPAN * float(np.sqrt(((there[corner] - there[following]) ** 2).sum(1).mean()))
    free, regular = (
        FreeSizes.of(there, bound, weight, residual, range_mm) for bound in bonds(there, seen, types, model.library)
    )
    dof = 3 * len(there) - len(free.covariance) - 6
    noise2 = (NOISE_DOF * NOISE_SIGMA**2 + free.least) / (NOISE_DOF + max(dof, 0))
    return sum(
        share * ways_tried(seen, model.metric, kinds) * float(np.exp(-sizes.nats(noise2, range_mm)))
        for share, kinds, sizes in ((1 - REGULAR, (), free), (REGULAR, types if taught.types else (), regular))
    ), float(noise2)
