"""Groups of facets -> named parts with poses. Right, or silent with the reason.

The memory proposes (which taught views have facets so related), then a rigid fit measures what it proposed, and nothing
else. In: groups and a Model. Out: each group with its Part. Seeing facets, learning and files are elsewhere.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import NamedTuple

import numpy as np

from daemon.arrays import Array, Flags
from daemon.vision.facets import merge_vertices
from daemon.vision.geometry import newell_normal
from daemon.vision.model import LARGEST_NUMBER, FacetLibrary, Model, type_number, types_of
from daemon.vision.recognition.confidence import hypothesis_probabilities, label_probabilities
from daemon.vision.recognition.fits import (
    FacetHypothesis,
    PoseEvidence,
    Recalled,
    add_evidence,
    equivalents,
    fit_candidates,
    most_likely_corners,
    recall_views,
    single_facet_candidates,
)
from daemon.vision.values import UNKNOWN, Facet, Group, Part, Recognition

MIN_TAIL = 1e-4  # a right hypothesis may fit so badly only this rarely
FARTHEST_MM = 2.5  # rms; a fit no closer than this proves nothing, however unsure the corners are
MIN_PROBABILITY = 0.9  # below it a part is not named
EPIPOLAR_PX = 0.25  # a corner farther off its epipolar line than this is less sure than predicted
HOLLOW_MM = 2.0  # how far in front of a neighbour's plane a facet's middle lies that meets it in a hollow edge


@dataclass(frozen=True, eq=False)
class Recognised:
    """A group as it was measured, and what it was taken for."""

    group: Group
    part: Part

    @property
    def label(self) -> str:
        """The part's name, or `unknown`."""
        return self.part.recognition.label

    @property
    def named(self) -> bool:
        """Whether it was taken for a taught part."""
        return self.part.named


@dataclass(frozen=True, eq=False)
class CandidatePose:
    """One way in which a group of facets may be a taught part, of those that turns of the part take onto each other
    one: pose (4, 4) group_from_part with covariance (6, 6); facets: the taught one behind each seen one; probability:
    what recognition gives it against the others and against something that was not taught."""

    label: str
    pose: Array
    covariance: Array
    facets: tuple[int, ...]
    probability: float


def recognise_groups(
    groups: Iterable[Group], model: Model, evidence: PoseEvidence | None = None
) -> tuple[Recognised, ...]:
    """Name and locate every group of facets, nearest first. Groups that fit nothing taught come back as `unknown`.

    seen: what pictures speak for a label at a pose besides facets.
    """
    return merge_adjacent(
        [one for group in groups if group.facets for one in _recognise_or_split(group, model, evidence)],
        model,
        evidence,
    )


def merge_adjacent(
    recognised: Sequence[Recognised], model: Model, evidence: PoseEvidence | None = None
) -> tuple[Recognised, ...]:
    """Merge recognised groups that share an edge after all and have a name together; return all, nearest first."""
    parts = list(recognised)
    for one, other in combinations(recognised, 2):
        if one in parts and other in parts and one.label == other.label:
            whole, count = merge_vertices(one.group.facets + other.group.facets), len(one.group.facets)
            if whole.touching[:count, count:].any() and (found := recognise_group(whole, model, evidence)).named:
                parts = [p for p in parts if p not in (one, other)] + [found]
    return tuple(sorted(parts, key=lambda r: float(np.linalg.norm(r.part.cyclopean_from_part[:3, 3]))))


def recognise_group(group: Group, model: Model, evidence: PoseEvidence | None = None) -> Recognised:
    """Recognise one group; return it with its part."""
    return Recognised(group, recognise_part(group, model, evidence))


def _recognise_or_split(group: Group, model: Model, evidence: PoseEvidence | None) -> tuple[Recognised, ...]:
    """Recognise the group as one part; if that has no name but all facets except a doubtful one have, return those two
    apart.

    A shadow or a neighbour's corner seen as a facet must not hide the part it lies beside. Doubtful is a facet that is
    irregular, or that meets its neighbours in a hollow edge, as the table does.
    """
    whole = recognise_group(group, model, evidence)
    if whole.named or len(group.facets) < 3:
        return (whole,)
    for index, facet in enumerate(whole.part.facets):
        if facet.type_number <= LARGEST_NUMBER and not _hollow(whole.part.facets, group.touching[index], facet):
            continue
        rest = recognise_group(group.only([k for k in range(len(group.facets)) if k != index]), model, evidence)
        if rest.named:
            return rest, recognise_group(group.only([index]), model, evidence)
    return (whole,)


def _hollow(facets: tuple[Facet, ...], touching: Flags, facet: Facet) -> bool:
    """Whether a facet lies in front of every neighbour's plane: its middle is outside the solid they bound."""
    beside = [facets[k] for k in np.nonzero(touching)[0]]
    middle = facet.corners_mm.mean(0)
    return all(float(newell_normal(g.corners_mm) @ (middle - g.corners_mm.mean(0))) > HOLLOW_MM for g in beside)


def without_name(named: Recognised, reason: str, confidence: float, model: Model) -> Recognised:
    """Remove the name of a recognised group, of which one may no longer have more than this confidence."""
    verdict = _unnamed((named.label,), 1 - confidence, reason, (named.label,))
    return replace(named, part=_unknown_part(_typed(named.group, model).group, verdict))


def candidate_poses(group: Group, model: Model) -> tuple[CandidatePose, ...]:
    """Return all (part, pose) hypotheses consistent with a group's facets, most probable first; the probability missing
    from 1 is that of an untaught part."""
    typed = _typed(group, model)
    fits = [h for h in _recall_and_fit(typed, model)[1] if _is_consistent(h, typed.group)]
    probabilities = hypothesis_probabilities(typed.group.polyhedron, fits, model) if fits else []
    found = [
        CandidatePose(h.label, h.pose, h.covariance, h.facets, p) for h, p in zip(fits, probabilities, strict=True)
    ]
    return tuple(sorted(found, key=lambda one: -one.probability))


def recognise_part(group: Group, model: Model, evidence: PoseEvidence | None = None) -> Part:
    """Name and locate one group of facets."""
    typed = _typed(group, model)
    seen = typed.group
    proposed, fits = _recall_and_fit(typed, model)
    fits = add_evidence(fits, evidence, model.metric)
    best = tuple(next(h for h in fits if h.label == label) for label in dict.fromkeys(h.label for h in fits))
    consistent = [h for h in fits if _is_consistent(h, seen)]
    probabilities = label_probabilities(seen.polyhedron, consistent, model) if consistent else {}
    verdict = _verdict(seen, best, proposed, probabilities, model)
    if verdict.label == UNKNOWN:
        return _unknown_part(seen, verdict)
    winner = next(h for h in best if h.label == verdict.label)
    taught = model.metric[winner.label].solid
    facets = typed_as(seen.facets, (taught.types[g] for g in winner.facets), model.library)
    fitted = most_likely_corners(seen.polyhedron, taught, winner, model.parameters.tolerance_mm)
    return Part(
        verdict,
        facets,
        winner.pose,
        winner.covariance,
        winner.rms_mm,
        tuple(fitted[list(ring)] for ring in seen.polyhedron.facets),
        equivalents(winner, fits, taught),
    )


class _Typed(NamedTuple):
    """A group with its facets typed, and every type that each may have."""

    group: Group
    types: tuple[tuple[str, ...], ...]


def _typed(group: Group, model: Model) -> _Typed:
    """The group with its facets typed, their corners as sure as their epipolar lines allow."""
    facets = tuple(map(_with_epipolar_doubt, group.facets))
    types = types_of(facets, model.library)
    return _Typed(replace(group, facets=typed_as(facets, (names[0] for names in types), model.library)), types)


def _with_epipolar_doubt(facet: Facet) -> Facet:
    """Enlarge the covariance of corners that are off their epipolar lines: there one camera saw something else."""
    excess = np.maximum(np.abs(facet.epipolar_px) / EPIPOLAR_PX, 1.0) ** 2
    return replace(facet, covariance_mm2=facet.covariance_mm2 * excess[:, None, None])


def _recall_and_fit(typed: _Typed, model: Model) -> tuple[tuple[Recalled, ...], tuple[FacetHypothesis, ...]]:
    """Recall taught views for this group and fit each, at vigilance 1 first; if none agrees within the errors, at the
    model's own vigilance."""
    solid, tolerance = typed.group.polyhedron, model.parameters.tolerance_mm
    if len(typed.group.facets) == 1:
        return (), fit_candidates(solid, model.metric, single_facet_candidates(solid, model.metric), tolerance)
    proposed, hypotheses = tuple[Recalled, ...](), tuple[FacetHypothesis, ...]()
    for vigilance in (1.0, model.parameters.vigilance):
        proposed = recall_views(solid, typed.types, model, vigilance)
        hypotheses = fit_candidates(
            solid, model.metric, [(one.label, one.correspondence) for one in proposed], tolerance
        )
        if any(_is_consistent(h, typed.group) for h in hypotheses):
            return proposed, hypotheses
    return proposed, hypotheses


def _is_consistent(hypothesis: FacetHypothesis, group: Group) -> bool:
    """Whether a hypothesis explains every facet, as well as a right one would, and closely enough to mean anything."""
    whole = hypothesis.explained == len(group.facets)
    return whole and hypothesis.tail > MIN_TAIL and hypothesis.rms_mm < FARTHEST_MM


def _verdict(
    group: Group,
    best: tuple[FacetHypothesis, ...],
    proposed: Sequence[Recalled],
    probabilities: Mapping[str, float],
    model: Model,
) -> Recognition:
    """Name, or say why not. chances: the probability of each label that fits."""
    consistent = tuple(sorted((h for h in best if _is_consistent(h, group)), key=lambda h: -probabilities[h.label]))
    ranking = list(
        dict.fromkeys([h.label for h in consistent] + [one.label for one in proposed] + [h.label for h in best])
    )
    if not consistent:
        return _unnamed(ranking, 1.0 if not best else 1.0 - max(h.tail for h in best), _reason_unnamed(group, best))
    labels = tuple(h.label for h in consistent)
    first = consistent[0]
    chance = probabilities[first.label]
    if len(group.facets) == 1:
        reason = f"one facet ({group.facets[0].type}) is not enough: it fits {' and '.join(labels)}"
        return _unnamed(ranking, 1 - chance, reason, labels)
    if chance < MIN_PROBABILITY:
        reason = f"fits {' and '.join(labels)} ({chance:.0%} for the first)"
        return _unnamed(ranking, 1 - chance, reason, labels)
    answer = next(
        one
        for one in proposed
        if one.label == first.label and np.array_equal(one.correspondence.corners, first.corners)
    )
    runner_up = next((name for name in ranking if name != first.label), None)
    reason = (
        f"recalled {model.view_behind(answer.node)} (node {answer.node + 1}) at ratio {answer.ratio:.2f}; "
        f"{len(group.facets)} facets fit to {first.rms_mm:.2f} mm rms, chi-square {first.chi2:.1f} of {first.dof}"
    )
    return Recognition(first.label, chance, answer.ratio, answer.activation, runner_up, False, reason, labels)


def _unnamed(ranking: Sequence[str], confidence: float, reason: str, candidates: tuple[str, ...] = ()) -> Recognition:
    """Return the verdict without a name; candidates: what explains it as well as each other."""
    runner_up = ranking[0] if ranking else None
    return Recognition(UNKNOWN, confidence, 0.0, 0.0, runner_up, bool(candidates), reason, candidates)


def _reason_unnamed(group: Group, best: tuple[FacetHypothesis, ...]) -> str:
    shapes = ", ".join(sorted(f.type for f in group.facets))
    if not best:
        return f"nothing taught has facets like these ({shapes})"
    near = min(best, key=lambda h: (-h.explained, h.chi2))
    if near.explained < len(group.facets):
        return f"{shapes}: only {near.explained} of {len(group.facets)} facets could belong to {near.label}"
    return f"{shapes}: {near.label} is off by {near.rms_mm:.1f} mm rms, chi-square {near.chi2:.0f} of {near.dof}"


def typed_as(facets: Iterable[Facet], kinds: Iterable[str], library: FacetLibrary) -> tuple[Facet, ...]:
    """Return the facets with the taught types: lengths and angles have decided which of its possible types each has."""
    return tuple(
        replace(facet, type=kind, type_number=type_number(kind, library))
        for facet, kind in zip(facets, kinds, strict=True)
    )


def _unknown_part(group: Group, verdict: Recognition) -> Part:
    """Return an unnamed part at its corners' centroid, with the camera's axes; its corners as measured."""
    corners = group.polyhedron.corners_mm
    pose = np.eye(4)
    pose[:3, 3] = corners.mean(0)
    covariance = np.diag([0.0, 0.0, 0.0, np.pi**2, np.pi**2, np.pi**2])
    covariance[:3, :3] = group.polyhedron.covariance_mm2.sum(0) / len(corners) ** 2
    fitted = tuple(corners[list(ring)] for ring in group.polyhedron.facets)
    return Part(verdict, group.facets, pose, covariance, float("nan"), fitted, pose[None])
