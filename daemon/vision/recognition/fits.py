"""Ways in which a seen solid may be a taught part: recalled, fitted, weighed by chi-square, the corners estimated.

Recall proposes: the memory answers with taught views, numbered so that they fit, and only what a node answers for is
measured. A view of which no node knows all is asked for by its pairs of facets, as where one taught view showed some of
it and another the rest. In: what is seen with the types that its facets may have, the taught metric models. Out: ways,
hypotheses, best first, and for a fitted pose the likeliest corners in the cyclopean frame: measured and taught ones,
weighed by their errors. Which hypothesis is believed is decided in group_recognition.py.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from daemon import frames
from daemon.arrays import Array, Index
from daemon.art import RelationalView
from daemon.vision.geometry import Polyhedron, chi_square_tail, fit_poses, rough_fit
from daemon.vision.model import (
    EXACT_MM,
    Correspondence,
    MetricModel,
    Model,
    correspondences,
    correspondences_from,
    relational_view,
    symmetries,
    turns_onto_themselves,
)

LabelledCorrespondence = tuple[str, Correspondence]
PoseEvidence = Callable[[Polyhedron, Array], float]
"""Nats by which pictures speak for the holes of a part at a pose (4, 4) cyclopean_from_part."""
SIGMA_SCALE = 1.3  # how much larger than predicted the corner errors may be, taken together
CLOSE_MM, ROUGH_MM = 1.0, 4.0  # an unweighted fit may be this bad where the weighted one is good: depth is what errs
SURE = 3.0  # how many predicted errors a distance may be off
SPREAD = 2.5  # by how many times as much two corners of such a fit may be farther apart than taught
EQUAL_CHI2 = 9.0  # poses of one label this close in chi-square are equally good
MAX_NEAR = 150
"""Places of a facet that may have been measured badly."""
MAX_RECALLED = 96
"""Nodes under a numbering that are followed, of each question; and places of a lone facet."""


@dataclass(frozen=True, eq=False)
class Recalled:
    """A taught view that the memory answers with: node, the label it stands for, match (1: all agrees within errors),
    activation, ratio of the facets it explains to those of the view or the node, whichever has more; way: which facet
    and corner of the part lies behind each seen one."""

    label: str
    node: int
    match: float
    activation: float
    ratio: float
    correspondence: Correspondence


def recall_views(
    observed: Polyhedron, types: Sequence[Sequence[str]], model: Model, vigilance: float
) -> tuple[Recalled, ...]:
    """Return every correspondence by which connected facets may be a taught part, as far as a node's match reaches the
    vigilance, one of those that a turn of the part takes onto each other; those that explain most facets first, then
    the best match. types: those each facet may have. Nothing for a lone facet, which has no relations."""
    if len(observed.facets) < 2 or not observed.seams:
        return ()
    view = relational_view(observed, types, model.library, model.parameters.tolerance_mm)
    found = _recall_members(observed, view, range(len(observed.facets)), model, vigilance)
    if not found and len(observed.facets) > 2:
        pairs = (_recall_members(observed, view.only(seam), seam, model, vigilance) for seam in observed.seams)
        found = {key: correspondence for one in pairs for key, correspondence in one.items()}
    most = max((one.correspondence.explained for one in found.values()), default=0)
    best = (one for one in found.values() if one.correspondence.explained == most)
    return tuple(sorted(best, key=lambda one: (-one.match, -one.activation)))


def _recall_members(
    observed: Polyhedron, view: RelationalView, members: Sequence[int], model: Model, vigilance: float
) -> dict[tuple[str, tuple[int, ...]], Recalled]:
    """Recall taught views by some of the facets (a view of them alone), each correspondence once."""
    answer = model.artmap.recall(view, vigilance, MAX_RECALLED)
    if not len(answer.node):
        return {}
    labels, facets = model.artmap.node_labels, model.facet_in_slot
    found, every = dict[tuple[str, tuple[int, ...]], Recalled](), set[str]()
    for node, slots, match, activation, ratio in zip(*answer, strict=True):
        label, own = labels[node], facets[node, slots].tolist()
        if -1 in own or label not in model.metric:
            continue
        solid = model.metric[label].solid
        if solid.holes:  # the memory knows facets and no holes: which of the places alike it is, these tell
            ways = () if label in every else correspondences(observed, solid)
            every.add(label)
        else:
            ways = _extend_pair(observed, solid, dict(zip(members, own, strict=True)))
        for way in ways:
            key = label, _canonical_corners(way, solid)
            if key not in found:
                share = float(ratio) * way.explained / len(members)
                found[key] = Recalled(label, int(node), float(match), float(activation), min(share, 1.0), way)
    return found


def _extend_pair(observed: Polyhedron, solid: Polyhedron, onto: dict[int, int]) -> tuple[Correspondence, ...]:
    """Lay seen facets edge to edge onto a solid, from the first two on that are said to lie on facets of it: the rest
    follows from these. Relations in pairs do not tell which way round facets meet, as at corners of a box."""
    first, second = next((f, g) for f, g in observed.seams if f in onto and g in onto)
    if max(onto.values()) >= len(solid.facets):
        return ()
    edges = [place for (f, place), (g, _) in observed.across.items() if (f, g) == (first, second)]
    there = [place for (f, place), (g, _) in solid.across.items() if (f, g) == (onto[first], onto[second])]
    sides = len(observed.facets[first])
    if len(solid.facets[onto[first]]) != sides:
        return ()
    places = [(first, (onto[first], (place - edges[0]) % sides)) for place in there]
    return correspondences_from(observed, solid, places)


def _canonical_corners(correspondence: Correspondence, solid: Polyhedron) -> tuple[int, ...]:
    """Return the corners of the correspondence, of all that a turn of the solid takes onto it the first."""
    turned = symmetries(solid).corners[:, correspondence.corners]
    turned[:, correspondence.corners < 0] = -1
    return tuple(min(turned.tolist()))


@dataclass(frozen=True, eq=False)
class FacetHypothesis:
    """The seen facets are those of `label`, in this pose.

    facets: the taught facet behind each seen one, or -1; corners (K,): the taught corner behind each seen one, or -1.
    tail: probability that a right hypothesis fits this badly or worse. rms_mm: distance of matched corners. nats: how
    much more the pictures speak for it than its facets do.
    """

    label: str
    facets: tuple[int, ...]
    corners: Index
    pose: Array
    covariance: Array
    chi2: float
    dof: int
    rms_mm: float
    nats: float = 0.0

    @property
    def explained(self) -> int:
        """The number of seen facets that have a taught counterpart."""
        return len(self.facets) - self.facets.count(-1)

    @property
    def score(self) -> float:
        """Chi-square, less what the pictures speak for it besides."""
        return self.chi2 - 2 * self.nats

    @property
    def tail(self) -> float:
        """Probability of a chi-square this large when the hypothesis is right."""
        return chi_square_tail(self.chi2 / SIGMA_SCALE**2, self.dof)


def fit_candidates(
    observed: Polyhedron,
    metric: Mapping[str, MetricModel],
    candidates: Sequence[LabelledCorrespondence],
    tolerance_mm: float,
) -> tuple[FacetHypothesis, ...]:
    """Fit the candidates that an unweighted fit does not rule out, each in its best pose: most facets explained first,
    then the smallest chi-square. Where all are ruled out, the nearest."""
    if not candidates:
        return ()
    observed_mm, covariance = observed.corners_mm, observed.covariance_mm2
    onto = [(metric[label].solid, correspondence.corners) for label, correspondence in candidates]
    corners, spread = (
        np.stack([getattr(solid, name)[own] for solid, own in onto]) for name in ("corners_mm", "covariance_mm2")
    )
    used = np.stack([own >= 0 for _, own in onto])
    rotation, shift, rms = rough_fit(observed_mm, covariance, corners, used)
    unsure = SURE * float(np.sqrt(observed.covariance_mm2.reshape(-1, 9)[:, ::4].sum(1).mean()))
    near = np.flatnonzero(rms <= max(ROUGH_MM, unsure)).tolist() or [int(rms.argmin())]
    start = rotation[near], shift[near]
    fits = fit_poses(observed_mm, covariance, corners[near], spread[near], used[near], tolerance_mm, start)
    found = [
        FacetHypothesis(
            label, correspondence.facets, correspondence.corners, fits.poses[i], fits.covariance[i],
            float(fits.chi2[i]), int(fits.dof[i]), float(fits.rms_mm[i]),
        )
        for i, (label, correspondence) in enumerate(candidates[k] for k in near)
    ]  # fmt: skip
    return tuple(sorted(found, key=lambda h: (-h.explained, h.chi2)))


def add_evidence(
    fits: tuple[FacetHypothesis, ...], evidence: PoseEvidence | None, metric: Mapping[str, MetricModel]
) -> tuple[FacetHypothesis, ...]:
    """Add to each hypothesis of a part with holes the nats by which the pictures speak for these; sorted as by
    fit_candidates."""
    solids = [metric[one.label].solid for one in fits]
    if evidence is None or not any(solid.holes for solid in solids):
        return fits
    found = [replace(one, nats=evidence(solid, one.pose)) for one, solid in zip(fits, solids, strict=True)]
    return tuple(sorted(found, key=lambda h: (-h.explained, h.score)))


def single_facet_candidates(observed: Polyhedron, metric: Mapping[str, MetricModel]) -> list[LabelledCorrespondence]:
    """Return taught facets, in turns, that a single seen one may be by the distances between its corners: those near,
    or where there is none those that are not far, the nearest MAX_RECALLED."""
    labels, found = tuple(metric), list[LabelledCorrespondence]()
    for part, facet, turn in _near_places(observed, metric, (CLOSE_MM, ROUGH_MM), MAX_RECALLED).which.tolist():
        ring, corners = metric[labels[part]].solid.facets[facet], np.empty(len(observed.corners_mm), np.intp)
        corners[observed.rings[0]] = ring[turn:] + ring[:turn]
        found.append((labels[part], Correspondence((facet,), corners)))
    return found


def facet_poses(observed: Polyhedron, metric: Mapping[str, MetricModel], rms_mm: float) -> tuple[Index, Array]:
    """Return the taught facets in turns whose corners come this near to those of a single seen one, MAX_NEAR at most,
    the nearest first: the numbers (N,) of the parts, and their poses (N, 4, 4)."""
    places, ring = _near_places(observed, metric, (rms_mm,), MAX_NEAR), observed.rings[0]
    used = np.ones(places.corners_mm.shape[:2], bool)
    rotation, shift, rms = rough_fit(observed.corners_mm[ring], observed.covariance_mm2[ring], places.corners_mm, used)
    best = np.argsort(rms, kind="stable")
    best = best[rms[best] < rms_mm]
    return places.which[best, 0], frames.rigid(rotation[best], shift[best])


class _Places(NamedTuple):
    """Facets that have as many sides as each other: which (N, 3), the number of the part, its facet, and by how many
    corners that is turned; its corners_mm (N, sides, 3) from there on, and the distances (N, pairs) between them."""

    which: Index
    corners_mm: Array
    spans_mm: Array


def _near_places(
    observed: Polyhedron, metric: Mapping[str, MetricModel], reaches_mm: Sequence[float], most: int
) -> _Places:
    """Taught facets, in turns, with as many sides as a single seen one, whose corners' distances from each other differ
    from the seen ones, beyond measuring errors, by less than the first of some reaches that any is within; the nearest,
    at most so many."""
    ring = observed.rings[0]
    places = facet_placements(tuple(model.solid for model in metric.values())).get(len(ring))
    if places is None:
        return _Places(np.zeros((0, 3), np.intp), *np.zeros((2, 0, len(ring), 3)))
    one, other = _pairs(len(ring))
    corners = observed.corners_mm[ring]
    variance = observed.covariance_mm2[ring].reshape(-1, 9)[:, ::4].sum(1)
    wanted = np.sqrt(((corners[one] - corners[other]) ** 2).sum(1))
    off = (np.abs(places.spans_mm - wanted) - SURE * np.sqrt(variance[one] + variance[other])).max(1)
    near = next((n for reach in reaches_mm if len(n := np.flatnonzero(off < SPREAD * reach))), np.zeros(0, np.intp))
    if len(near) > most:
        near = near[np.argpartition(off[near], most)[:most]]
    return _Places(places.which[near], places.corners_mm[near], places.spans_mm[near])


@lru_cache(maxsize=4)
def facet_placements(solids: tuple[Polyhedron, ...]) -> dict[int, _Places]:
    """Return by number of sides every facet of solids in each turn, one of those that turns of its solid take onto each
    other; cached for all that is taught."""
    found: dict[int, list[tuple[Index, Array]]] = {}
    for number, (solid, turns) in enumerate(zip(solids, turns_onto_themselves(solids, EXACT_MM), strict=True)):
        here, after, first = solid.steps
        sides = np.diff(first, append=len(here))
        facet = np.repeat(np.arange(len(first)), sides)
        codes = turns.corners[:, here] * len(solid.corners_mm) + turns.corners[:, after]
        own = np.flatnonzero(codes.argmin(0) == 0)
        for count in np.unique(sides).tolist():
            flags = own[sides[facet[own]] == count]
            begin = first[facet[flags]]
            turn = flags - begin
            corners = solid.corners_mm[here[begin[:, None] + (turn[:, None] + np.arange(count)) % count]]
            which = np.stack([np.full(len(flags), number), facet[flags], turn], 1)
            found.setdefault(count, []).append((which, corners))
    places = dict[int, _Places]()
    for count, each in found.items():
        corners = np.concatenate([corners for _, corners in each])
        one, other = _pairs(count)
        spans = np.sqrt(((corners[:, one] - corners[:, other]) ** 2).sum(2))
        places[count] = _Places(np.concatenate([which for which, _ in each]), corners, spans)
    return places


@lru_cache(maxsize=64)
def _pairs(count: int) -> tuple[Index, Index]:
    """Every two of so many."""
    return np.triu_indices(count, 1)


def equivalents(best: FacetHypothesis, others: tuple[FacetHypothesis, ...], taught: Polyhedron) -> Array:
    """Return (E, 4, 4) the poses of the same part that fit as well, the best first: as many as it has symmetries."""
    same = [
        h.pose
        for h in others
        if h is not best
        and h.label == best.label
        and h.explained == best.explained
        and h.score < best.score + EQUAL_CHI2
    ]
    return (np.stack([best.pose, *same])[:, None] @ symmetries(taught).motions).reshape(-1, 4, 4)


def most_likely_corners(observed: Polyhedron, taught: Polyhedron, fit: FacetHypothesis, tolerance_mm: float) -> Array:
    """(K, 3) mm: each measured corner drawn towards where the fitted model has it.

    A corner without a counterpart stays where it was measured.
    """
    matched = np.nonzero(fit.corners >= 0)[0]
    turn, shift = fit.pose[:3, :3], fit.pose[:3, 3]
    there = fit.corners[matched]
    expected = taught.corners_mm[there] @ turn.T + shift
    doubt = turn @ taught.covariance_mm2[there] @ turn.T + tolerance_mm**2 * np.eye(3)
    gain = doubt @ np.linalg.inv(doubt + observed.covariance_mm2[matched])
    corners = observed.corners_mm.copy()
    corners[matched] = expected + (gain @ (observed.corners_mm[matched] - expected)[..., None])[..., 0]
    return corners
