"""What a part at a pose should show and neither picture has: evidence against it, whichever way it got its name.

A near twin that was never taught (a mirror image, another size, a corner cut off) has most edges where the part has
them; some of the part's own are not there. An edge between equal greys shows in no picture, so each stretch counts as
much as the levels on its two hands let one expect. In: a solid at its pose, its stretches in both pictures. Out: a
share, and how likely such a twin shows no less.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from daemon.arrays import Array, Flags, Index
from daemon.vision.geometry import Polyhedron
from daemon.vision.image import Eyes, OneEye, stretch_levels
from daemon.vision.model import Model
from daemon.vision.recognition import Recognised, without_name
from daemon.vision.refine import THIN_PX, Placements, Stretches, across, stretches_of

EXPECTED, INNER = 6.0, 0.25
"""In sigmas of the noise, the difference of levels at which an edge surely shows; how much an edge between two facets
that are seen counts, which may be alike. tests/bench/missing.py shows what others do."""
FEWEST = 3
"""Stretches by which a facet's level is known; with fewer, all of its borders say it."""
TWIN, BY_MISSING = -6.2, 75.0
"""Log odds that what fits is a near twin, where nothing is missing, and how they grow with the missing share: a
logistic regression on 282 parts named rightly in rendered looks and 73 near twins of look-alike families, taken for as
seldom as one in a hundred of what is seen. tests/bench/missing.py makes it again: -6.4 and 82, with standard errors of
.3 and 10; within these, what takes no name from a part of the rendered scenes. tests/bench/look_alikes.py shows what it
does."""
MOST_LIKELY_TWIN = 0.05
"""Likelier, and the part has no name."""


def with_all_they_show(found: Sequence[Recognised], model: Model, eyes: Eyes) -> tuple[Recognised, ...]:
    """The named ones with a confidence that counts what is missing of them; without their names where that is too
    much."""
    named = [one for one in found if one.named]
    if not named:
        return tuple(found)
    solids = [model.metric[one.label].solid for one in named]
    laid, poses = Placements.of(solids), np.stack([one.part.cyclopean_from_part for one in named])
    both = stretches_of(laid, eyes, poses, model.parameters.tolerance_mm)
    checked = dict[int, Recognised]()
    for k, (one, solid) in enumerate(zip(named, solids, strict=True)):
        share = missing_share(solid, [seen.only(k, laid) for seen in both], eyes.views)
        verdict = one.part.recognition
        twin = twin_probability(share)
        confidence = verdict.confidence * (1 - twin)
        if twin > MOST_LIKELY_TWIN:
            why = f"may be {one.label}, but {share:.0%} of what that should show is in neither picture"
            checked[id(one)] = without_name(one, why, confidence, model)
        else:
            part = replace(one.part, recognition=replace(verdict, confidence=confidence))
            checked[id(one)] = replace(one, part=part)
    return tuple(checked.get(id(one), one) for one in found)


def twin_probability(share: float) -> float:
    """How likely a part that fits, of whose edges this share is missing, is a near twin that was never taught."""
    return float(1 / (1 + np.exp(-(TWIN + BY_MISSING * share))))


def missing_share(solid: Polyhedron, seen: Sequence[Stretches], views: Sequence[OneEye]) -> float:
    """Of the edges that a part should show in both pictures, the share that is not there though the levels beside it
    differ."""
    lacking = every = 0.0
    laid = Placements.of([solid])
    for stretches, view in zip(seen, views, strict=True):
        edges = stretches.edges
        if not len(edges.start):
            continue
        weight = np.where(edges.outline, 1.0, INNER) * edges.lengths_px / stretches.visible.shape[1]
        each = weight[:, None] * stretches.visible
        expected = np.minimum(_expected(laid, stretches, view) / EXPECTED, 1.0)
        lacking += float((each * ~stretches.there * expected).sum())
        every += float(each.sum())
    return lacking / max(every, 1e-9)


def _expected(laid: Placements, stretches: Stretches, view: OneEye) -> Array:
    """(E, S) of one part laid, by how many sigmas the levels on the two hands of each stretch should differ: that of
    the facet, as its
    borders that show have it, against what lies beyond it there, or against the other facet's."""
    edges = stretches.edges
    levels = stretch_levels(view.smooth, edges.start, edges.end)
    facing = laid.thickness(edges.corners_px) >= THIN_PX[1]
    hand = _hands(laid.shapes[0], stretches, facing)
    usual = np.full(len(facing), np.nan)
    for facet in np.flatnonzero(facing).tolist():
        own, side = np.nonzero(hand == facet)
        if len(own):
            level, firm = levels[own, :, side], (stretches.there & stretches.visible)[own]
            usual[facet] = np.median(level[firm] if firm.sum() >= FEWEST else level)
    found = [np.where(hand[:, k, None] >= 0, usual[hand[:, k], None], levels[:, :, k]) for k in (0, 1)]
    return np.asarray(np.abs(found[1] - found[0]))


def _hands(solid: Polyhedron, stretches: Stretches, facing: Flags) -> Index:
    """(E, 2) the facing facet before each edge, as across() goes, and the one after it; -1 where there is none."""
    edges = stretches.edges
    normal, middle = across(edges.start, edges.end), (edges.start + edges.end) / 2
    hand = np.full((len(normal), 2), -1, np.intp)
    for facet in np.flatnonzero(facing).tolist():
        own = edges.of_ring(solid.facets[facet])[0]
        own = own[own >= 0]
        centre = edges.corners_px[solid.rings[facet]].mean(0)
        hand[own, (((centre - middle[own]) * normal[own]).sum(1) > 0).astype(np.intp)] = facet
    return hand
