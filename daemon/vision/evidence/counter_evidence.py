"""What speaks against a named part, whichever way it got its name: edges it should show that neither picture has, edges
inside it that lie off its faces, and a near-duplicate that fits better.

A near-duplicate that was never taught (a mirror image, another size, a corner cut off) has most edges where the part
has them; some of the part's own are not there. An edge between equal greys shows in no picture, so each place on an
edge counts as much as the levels on its two hands let one expect. Where both cameras miss the same place it is no
accident of one of them: such places count once more. Print beside an edge makes it fade here and there, a part that is
not there makes it end: only what is missing up to a corner counts so. In: named parts, both images. Out: their
confidence, or no name. Which solids are nearly the part is near_duplicates.py's.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from daemon.arrays import Array, Flags
from daemon.vision.evidence.by_rounding import any_rounded, resolved_by_rounding
from daemon.vision.evidence.competing import lead_by_own_edges
from daemon.vision.evidence.edge_places import STEP, EdgePlaces, edge_places
from daemon.vision.evidence.hole_rims import other_hole_nats
from daemon.vision.evidence.near_duplicates import near_duplicates
from daemon.vision.evidence.occlusion import hidden_of
from daemon.vision.evidence.off_faces import off_faces_px
from daemon.vision.geometry import Polyhedron, SolidBatch
from daemon.vision.image import StereoImages
from daemon.vision.model import Model
from daemon.vision.recognition import Recognised, without_name
from daemon.vision.refine import edge_samples_of
from daemon.vision.settings import TOLERANCE_MM

EXPECTED = 6.0
"""In sigmas of the noise, the difference of levels at which an edge surely shows."""
CLEARLY, SPREADS = 8.0, 2.0
"""Where both cameras count: the difference of levels, in sigmas and in spreads of the levels along the facets' borders
(print makes them differ)."""
AT_END = 3
"""Of its places, how many beside a corner may be there though the edge ends before it."""
MISSING_PX, OFF_PX = 2.0, 5.0
"""Lengths from where on evidence grows as their logarithm: what is beside a missing place is missing too."""
BY_OUTLINE_PX = (0.0, 0.0)
"""Near-duplicates differ by thin facets, which change the outline by what they stick out: none is too thin here. The
near-duplicates of right names in the tuned-on looks then lead by 4.1 nats at most instead of 12."""
RIVAL_NATS = 10.0
"""What a near-duplicate's lead is counted in."""
DUPLICATE, BY_MISSING, BY_BOTH, BY_OFF, BY_RIVAL = -7.45, 0.57, 1.59, 2.24, 7.95
"""Log odds that what fits is a near-duplicate, where nothing speaks against the part, and how they grow with the per
cent missing, with the length both cameras miss, with the length off its faces, and with each RIVAL_NATS for a
near-duplicate: a logistic regression on 281 parts named rightly in rendered looks and 71 near-duplicates of look-alike
families, taken for as seldom as three in 200 of what is seen. tests/bench/missing.py makes it again;
tests/bench/look_alikes.py shows what it does."""
_WEIGHTS = BY_MISSING, BY_BOTH, BY_OFF, BY_RIVAL
MOST_LIKELY_DUPLICATE = 0.05
"""Likelier, and the part has no name, which is to be right in 95 of 100. From .03 to .055 four of the right names in
the table are lost at most, none of the shared scenes, and the same strangers are left."""
OTHER_HOLE = 3.0
"""Nats by which the rim of a hole must speak for another size of it for a part to have no name. Of 34 holes of machined
parts and 5 bores of tests/bench/arcs.py, rightly named, none had more than .4; of nine rims of bores 5 % off seven had
5 and more (seeds 1 and 3; 601 to 606 and 801 to 803)."""


@dataclass(frozen=True)
class CounterEvidence:
    """What speaks against a part: missing, the share of its edges that is not there though the levels beside it differ;
    both_px, of these what both cameras miss, px over both; off_px, edges inside it that lie off its faces; rival, nats
    by which a near-duplicate that nobody taught fits better, and how that differs, in words."""

    missing: float
    both_px: float
    off_px: float
    rival: float
    difference: str = ""

    @property
    def terms(self) -> tuple[float, float, float, float]:
        """Return the terms that the log odds of a near-duplicate grow with."""
        lengths = float(np.log1p(self.both_px / MISSING_PX)), float(np.log1p(self.off_px / OFF_PX))
        return 100 * self.missing, *lengths, self.rival / RIVAL_NATS

    @property
    def duplicate(self) -> float:
        """Return the probability that what fits is a near-duplicate that was never taught."""
        return float(1 / (1 + np.exp(-DUPLICATE - np.dot(_WEIGHTS, self.terms))))

    def __str__(self) -> str:
        missing, both, off, rival = np.multiply(_WEIGHTS, self.terms)
        if rival > max(missing + both, off):
            return f"a similar part ({self.difference}) fits better"
        if off > missing + both:
            return f"edges of {self.off_px:.0f} px inside it lie in front of or behind its faces"
        return f"{self.missing:.0%} of the edges that it should show are in neither picture"


def verified_names(found: Sequence[Recognised], model: Model, images: StereoImages) -> tuple[Recognised, ...]:
    """The named ones with a confidence that counts what speaks against them; without their names where that is too
    much."""
    return tuple(_checked(one, model, images) if one.named else one for one in found)


def _checked(found: Recognised, model: Model, images: StereoImages) -> Recognised:
    one = resolved_by_rounding(found, model, images) if any_rounded(model) else found
    if not one.named:
        return one
    verdict, solid, pose = one.part.recognition, model.metric[one.label].solid, one.part.cyclopean_from_part
    by_holes = other_hole_nats(solid, pose, images, model.parameters.tolerance_mm)
    if by_holes >= OTHER_HOLE:
        confidence = verdict.confidence / (1 + float(np.exp(by_holes)))
        return without_name(one, f"may be {one.label}, but a hole in it has another size", confidence, model)
    against = counter_evidence_of(solid, pose, images)
    duplicate = against.duplicate
    confidence = verdict.confidence * (1 - duplicate)
    if duplicate > MOST_LIKELY_DUPLICATE:
        return without_name(one, f"may be {one.label}, but {against}", confidence, model)
    return replace(one, part=replace(one.part, recognition=replace(verdict, confidence=confidence)))


def counter_evidence_of(solid: Polyhedron, pose: Array, images: StereoImages) -> CounterEvidence:
    """The evidence against a part at cyclopean_from_part (4, 4). If it would take the part's name, nearer objects are
    included: they hide edges, and have some of their own."""
    both, off_px = edge_places(solid, pose, images), off_faces_px(solid, pose, images)
    found = _weighed(solid, pose, images, both, off_px)
    if found.duplicate < MOST_LIKELY_DUPLICATE:
        return found
    hidden = hidden_of(solid, pose, images, both)
    if not any(hides.any() for hides in hidden):
        return found
    both = [replace(seen, visible=seen.visible & ~hides) for seen, hides in zip(both, hidden, strict=True)]
    return _weighed(solid, pose, images, both, 0.0)


def _weighed(
    solid: Polyhedron, pose: Array, images: StereoImages, both: Sequence[EdgePlaces], off_px: float
) -> CounterEvidence:
    rival = duplicate_lead(solid, pose, images, both)
    return CounterEvidence(missing_share(both), missing_in_both_px(both), off_px, *rival)


def missing_share(both: Sequence[EdgePlaces]) -> float:
    """Fraction of the edges expected in both images that are missing although the grey levels beside them differ."""
    lacking = every = 0.0
    for seen in both:
        each = (seen.weight * seen.length_px)[:, None] * seen.visible
        lacking += float((each * ~seen.there * np.minimum(seen.expected / EXPECTED, 1.0)).sum())
        every += float(each.sum())
    return lacking / max(every, 1e-9)


def missing_in_both_px(both: Sequence[EdgePlaces]) -> float:
    """Length of edge, px over both pictures, that neither camera has up to a corner and that one at least should see
    clearly."""
    missing, found = [], []
    for seen in both:
        shows = seen.close | (seen.step >= STEP)
        clear = (seen.expected >= CLEARLY) & (seen.expected >= SPREADS * seen.spread)
        missing.append(seen.visible & clear & ~shows)
        found.append(seen.visible & shows)
    lost = [each & ~found[0] & ~found[1] for each in missing]
    return float(
        sum(
            (seen.length_px[:, None] * _ending(each)).sum() for seen, each in zip(both, lost, strict=True) if each.any()
        )
    )


def _ending(missing: Flags) -> Flags:
    """(E, S) which of missing places belong to a row of such that reaches to AT_END places from an end of the edge."""
    broken: Flags = np.pad(~missing, ((0, 0), (1, 1)), constant_values=True)
    place = np.arange(broken.shape[1])
    before = np.maximum.accumulate(np.where(broken, place, 0), 1)[:, 1:-1]
    after = np.minimum.accumulate(np.where(broken, place, place[-1])[:, ::-1], 1)[:, ::-1][:, 1:-1]
    return np.asarray(missing & ((before <= AT_END) | (after >= place[-1] - AT_END)))


class DuplicateLead(NamedTuple):
    """By how many nats a near-duplicate fits better than a part, 0 where none does; how it differs, in words."""

    nats: float = 0.0
    difference: str = ""


def duplicate_lead(solid: Polyhedron, pose: Array, images: StereoImages, both: Sequence[EdgePlaces]) -> DuplicateLead:
    """Return by how much the edges that only a near-duplicate has speak more for it than those that only the part has
    speak for that, at cyclopean_from_part (4, 4), whichever near-duplicate is ahead; both: what both images show along
    its edges."""
    others = near_duplicates(solid, pose, images, both)
    if not others:
        return DuplicateLead()
    solids = SolidBatch.of([solid, *(one.solid for one in others)])
    poses = pose[None].repeat(len(others) + 1, 0)
    samples = edge_samples_of(solids, images, poses, TOLERANCE_MM, BY_OUTLINE_PX)
    own, *theirs = ([seen.only(k, solids) for seen in samples] for k in range(len(others) + 1))
    ahead = [lead_by_own_edges(seen, own) for seen in theirs]
    best = int(np.argmax(ahead))
    return DuplicateLead(ahead[best], others[best].difference) if ahead[best] > 0 else DuplicateLead()
