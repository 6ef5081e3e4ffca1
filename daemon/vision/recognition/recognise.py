"""Groups of facets -> named parts with poses. Right, or silent with the reason.

Pattern first (which taught parts have these facets so joined), then metric: lengths and dihedral angles by rigid fit.
In: a FacetView and a Model. Out: Parts. Seeing facets, learning and files are elsewhere.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from daemon.vision.facets.weld import weld
from daemon.vision.geometry.facet_measures import newell_normal
from daemon.vision.geometry.polyhedron import Polyhedron
from daemon.vision.model.facet_types import LARGEST_NUMBER, FacetLibrary, type_number
from daemon.vision.model.model import Model
from daemon.vision.model.patterns import Answer, by_label, recall, typed
from daemon.vision.model.regularise import regularise
from daemon.vision.recognition.confidence import probability
from daemon.vision.recognition.hypotheses import Hypothesis, equivalents, hypotheses, without_one_corner
from daemon.vision.recognition.posterior import most_likely_corners
from daemon.vision.values import Facet, FacetView, Group, Part, Recognition

Array = NDArray[np.float64]
LEAST_TAIL = 1e-4  # a right hypothesis may fit so badly only this rarely
FARTHEST_MM = 2.5  # rms; a fit no closer than this proves nothing, however unsure the corners are
SUSPECT_MM = 8.0  # rms; how badly a facet may have been measured of which a part is suspected
LEAST_TAIL_ASTRAY = 1e-2  # the same where one corner was left out: what remains must fit well
LEAST_PROBABILITY = 0.9  # below it a part is not named
EPIPOLAR_PX = 0.25  # a corner farther off its epipolar line than this is less sure than predicted
HOLLOW_MM = 2.0  # how far in front of a neighbour's plane a facet's middle lies that meets it in a hollow edge
UNKNOWN = "unknown"


def recognise(view: FacetView, model: Model) -> tuple[Part, ...]:
    """Name and locate every group of facets, nearest first. Groups that fit nothing taught come back as `unknown`."""
    found = [(group, _parts_of(group, model)) for group in view.groups if group.facets]
    for one, other in combinations(found, 2):
        whole = _as_one(one, other, model) if all(any(f is known for known in found) for f in (one, other)) else None
        if whole is not None:
            found = [f for f in found if f is not one and f is not other] + [whole]
    parts = [part for _, own in found for part in own]
    return tuple(sorted(parts, key=lambda p: float(np.linalg.norm(p.cyclopean_from_part[:3, 3]))))


Named = tuple[Group, tuple[Part, ...]]


def _as_one(one: Named, other: Named, model: Model) -> Named | None:
    """Two groups without a name, or with the same one, that share an edge after all and have a name together; None
    where they do not."""
    names = [{p.recognition.label for p in parts} for _, parts in (one, other)]
    if names[0] != names[1] or len(names[0]) > 1:
        return None
    whole = weld(one[0].facets + other[0].facets)
    if not whole.touching[: len(one[0].facets), len(one[0].facets) :].any():
        return None
    part = recognise_group(whole, model)
    return (whole, (part,)) if part.recognition.label != UNKNOWN else None


def _parts_of(group: Group, model: Model) -> tuple[Part, ...]:
    """The group as one part; where that has no name but all its facets except a doubtful one have, those two apart.

    A shadow or a neighbour's corner seen as a facet must not hide the part it lies beside. Doubtful is a facet that is
    irregular, or that meets its neighbours in a hollow edge, as the table does.
    """
    whole = recognise_group(group, model)
    if whole.recognition.label != UNKNOWN or len(group.facets) < 3:
        return (whole,)
    for index, facet in enumerate(whole.facets):
        if facet.type_number <= LARGEST_NUMBER and not _hollow(whole.facets, group.touching[index], facet):
            continue
        rest = [k for k in range(len(group.facets)) if k != index]
        part = recognise_group(group.only(rest), model)
        if part.recognition.label != UNKNOWN:
            return part, recognise_group(group.only([index]), model)
    return (whole,)


def _hollow(facets: tuple[Facet, ...], touching: NDArray[np.bool_], facet: Facet) -> bool:
    """Whether a facet lies in front of every neighbour's plane: its middle is outside the solid they bound."""
    beside = [facets[k] for k in np.nonzero(touching)[0]]
    middle = facet.corners_mm.mean(0)
    return all(float(newell_normal(g.corners_mm) @ (middle - g.corners_mm.mean(0))) > HOLLOW_MM for g in beside)


def suspicions(facet: Facet, model: Model) -> tuple[Hypothesis, ...]:
    """Every taught part and pose that a facet may belong to, measured well or not; the nearest first."""
    seen = _typed(weld([facet]), model)
    found = hypotheses(seen.polyhedron, model.metric, model.parameters.tolerance_mm)
    return tuple(sorted((h for h in found if h.rms_mm < SUSPECT_MM), key=lambda h: h.rms_mm))


def recognise_group(group: Group, model: Model) -> Part:
    """Name and locate one group of facets."""
    seen = _typed(group, model)
    answers = _answers(seen, model)
    fits = _fits(seen, model, answers)
    best = _best_by_label(fits)
    verdict = _verdict(seen, best, answers)
    if verdict.label == UNKNOWN:
        return _unknown_part(seen, model, verdict)
    winner = next(h for h in best if h.label == verdict.label)
    taught = model.metric[winner.label].solid
    facets = _as_taught(seen, winner, taught, model.library)
    if any(f.type != g.type for f, g in zip(facets, seen.facets, strict=True)):
        verdict = _with_pattern(verdict, facets, seen.touching, model)
    fitted = most_likely_corners(seen.polyhedron, taught, winner, model.parameters.tolerance_mm)
    return Part(
        verdict,
        facets,
        winner.pose,
        winner.covariance,
        winner.rms_mm,
        tuple(fitted[list(ring)] for ring in seen.polyhedron.facets),
        equivalents(winner, fits),
    )


def _typed(group: Group, model: Model) -> Group:
    """The group with its facets typed, their corners as sure as their epipolar lines allow."""
    return replace(group, facets=tuple(typed(_doubted(f), model.library) for f in group.facets))


def _doubted(facet: Facet) -> Facet:
    """The facet, its corners off their epipolar lines less sure: there one eye saw something else."""
    excess = np.maximum(np.abs(facet.epipolar_px) / EPIPOLAR_PX, 1.0) ** 2
    return replace(facet, covariance_mm2=facet.covariance_mm2 * excess[:, None, None])


def _answers(seen: Group, model: Model) -> tuple[Answer, ...]:
    """What the ARTMAP nodes say, best label first; nothing for a lone facet, which has no relations."""
    if model.rotation is None or not seen.touching.any():
        return ()
    numbers = np.array([f.type_number for f in seen.facets])
    return by_label(recall(model.rotation, numbers, seen.touching), model.node_labels)


def _fits(seen: Group, model: Model, answers: tuple[Answer, ...]) -> tuple[Hypothesis, ...]:
    """Metric hypotheses of the labels whose pattern answers; of all labels where none of those fits."""
    tolerance = model.parameters.tolerance_mm
    named = [a.label for a in answers if a.modified >= model.parameters.vigilance]
    first = hypotheses(seen.polyhedron, {n: model.metric[n] for n in named}, tolerance)
    if any(_stands(h, seen) for h in first):
        return first
    rest = hypotheses(seen.polyhedron, {n: m for n, m in model.metric.items() if n not in named}, tolerance)
    found = tuple(sorted(first + rest, key=lambda h: (-h.explained, h.chi2)))
    whole = tuple(h for h in found if h.explained == len(seen.facets))
    if len(seen.facets) < 2 or any(_stands(h, seen) for h in whole):
        return found
    again = without_one_corner(seen.polyhedron, model.metric, whole, tolerance)
    return (*(h for h in again if h.tail > LEAST_TAIL_ASTRAY and _stands(h, seen)), *found)


def _stands(hypothesis: Hypothesis, seen: Group) -> bool:
    """Whether a hypothesis explains every facet, as well as a right one would, and closely enough to mean anything."""
    whole = hypothesis.explained == len(seen.facets)
    return whole and hypothesis.tail > LEAST_TAIL and hypothesis.rms_mm < FARTHEST_MM


def _best_by_label(fits: tuple[Hypothesis, ...]) -> tuple[Hypothesis, ...]:
    best: dict[str, Hypothesis] = {}
    for h in fits:
        best.setdefault(h.label, h)
    return tuple(best.values())


def _verdict(seen: Group, best: tuple[Hypothesis, ...], answers: tuple[Answer, ...]) -> Recognition:
    """Name, or say why not."""
    standing = tuple(sorted((h for h in best if _stands(h, seen)), key=lambda h: -h.tail))
    ranking = list(dict.fromkeys([h.label for h in standing] + [a.label for a in answers] + [h.label for h in best]))
    activation = {a.label: a for a in answers}
    if not standing:
        return _silent(ranking, 1.0 if not best else 1.0 - max(h.tail for h in best), False, _why_not(seen, best))
    labels = tuple(h.label for h in standing)
    first = standing[0]
    chance = probability(seen.polyhedron, standing, first.label)
    if len(seen.facets) == 1:
        why = f"a single {seen.facets[0].type} is no proof: it fits {' and '.join(labels)}"
        return replace(_silent(ranking, 1 - chance, True, why), candidates=labels)
    if chance < LEAST_PROBABILITY:
        why = f"fits {' and '.join(labels)} at {chance:.0%} for the first"
        return replace(_silent(ranking, 1 - chance, True, why), candidates=labels)
    answer = activation.get(first.label)
    runner_up = next((name for name in ranking if name != first.label), None)
    why = f"{len(seen.facets)} facets fit to {first.rms_mm:.2f} mm rms, chi-square {first.chi2:.1f} of {first.dof}"
    return Recognition(
        first.label,
        chance,
        answer.match_ratio if answer else 0.0,
        answer.activation if answer else 0.0,
        runner_up,
        False,
        why,
        labels,
    )


def _silent(ranking: list[str], confidence: float, ambiguous: bool, why: str) -> Recognition:
    return Recognition(UNKNOWN, confidence, 0.0, 0.0, ranking[0] if ranking else None, ambiguous, why)


def _why_not(seen: Group, best: tuple[Hypothesis, ...]) -> str:
    shapes = ", ".join(sorted(f.type for f in seen.facets))
    if not best:
        return f"nothing taught has facets like these ({shapes})"
    near = min(best, key=lambda h: (-h.explained, h.chi2))
    if near.explained < len(seen.facets):
        return f"{shapes}: only {near.explained} of {len(seen.facets)} facets could belong to {near.label}"
    return f"{shapes}: {near.label} is off by {near.rms_mm:.1f} mm rms, chi-square {near.chi2:.0f} of {near.dof}"


def _as_taught(seen: Group, winner: Hypothesis, taught: Polyhedron, library: FacetLibrary) -> tuple[Facet, ...]:
    """The facets with the taught types: which of the types a facet may have it is, lengths and angles have settled."""
    return tuple(
        replace(facet, type=taught.types[g], type_number=type_number(taught.types[g], library))
        for facet, g in zip(seen.facets, winner.facets, strict=True)
    )


def _with_pattern(
    verdict: Recognition, facets: tuple[Facet, ...], touching: NDArray[np.bool_], model: Model
) -> Recognition:
    """Activation and match ratio of the named label's best node, with the types as they were settled."""
    if model.rotation is None or not touching.any():
        return verdict
    answers = by_label(recall(model.rotation, np.array([f.type_number for f in facets]), touching), model.node_labels)
    own = next(a for a in answers if a.label == verdict.label)
    return replace(verdict, match_ratio=own.match_ratio, activation=own.activation)


def _unknown_part(seen: Group, model: Model, verdict: Recognition) -> Part:
    """An unnamed part sits at its corners' centroid, with the camera's axes; its corners as regular as their types."""
    corners = regularise(seen.polyhedron, model.library).corners_mm
    pose = np.eye(4)
    pose[:3, 3] = corners.mean(0)
    covariance = np.diag([0.0, 0.0, 0.0, np.pi**2, np.pi**2, np.pi**2])
    covariance[:3, :3] = seen.polyhedron.covariance_mm2.sum(0) / len(corners) ** 2
    fitted = tuple(corners[list(ring)] for ring in seen.polyhedron.facets)
    return Part(verdict, seen.facets, pose, covariance, float("nan"), fitted, pose[None])
