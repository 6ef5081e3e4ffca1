"""Parts named by their straight edges, where no outline closes: printed faces, patterned tables, worn and shining edges.

Corners in space say which taught parts could be there, and where; the segments of both images say how much speaks for
each; the best are laid onto the grey levels. A name needs most of the edges that the part must show, in both eyes, far
more of them than chance would give in this very picture, print that lies on its faces, and no other taught part that
explains the same place nearly as well.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from daemon import frames
from daemon.vision.facets import weld
from daemon.vision.geometry import Polyhedron, Shape
from daemon.vision.image import Eyes, segment_corners
from daemon.vision.model import Model
from daemon.vision.recognition import Recognised, typed_as
from daemon.vision.registration.corner_pose import Fit
from daemon.vision.registration.different import Guesses, different
from daemon.vision.registration.directed import directed_map, evidence
from daemon.vision.registration.edge_pose import (
    Located,
    confirmed_facets,
    facets_in_view,
    facets_laid,
    fit_of,
    locate,
    shown,
)
from daemon.vision.registration.faces import likeness
from daemon.vision.registration.measured import measured_facet, silhouette
from daemon.vision.registration.space_corners import guesses_from_space, meet
from daemon.vision.values import Part, Recognition

MOST, REACH_MM = 10, 2.5
"""Poses laid onto the images, and how far off they may be."""
LEAST_NATS = 180.0
"""Evidence against chance; e to the so many-th, with what neighbouring places along an edge have in common."""
LEAST_OUTLINE, LEAST_SHOWN, SHOWN_MM = 0.65, 0.78, 0.8
PROVED, SHARE = 1.03, 0.5
"""What the share of edges that are clearly on their place and SHARE of the share of evidence come to at least: of 125
rendered parts of all kinds 115 are above, of 149 strangers none that passes the other tests."""
LEAST_LIKENESS = 0.6
RIVAL = 0.9
"""Another part with so much of the evidence on the same place leaves the name open."""
OVERLAP = 0.2
PATTERNED = 100
BY_EDGES = 0.9


@dataclass(frozen=True, eq=False)
class Seen:
    """A taught part where both images bear it out: nats of evidence, what it covers in the left eye."""

    label: str
    solid: Polyhedron
    located: Located
    fit: Fit
    nats: float
    share: float
    covers: Shape


def patterned(eyes: Eyes) -> bool:
    """Whether so many straight edges show that faint ones say nothing."""
    return max(len(view.segments.start) for view in eyes.views) > PATTERNED


def named_by_segments(eyes: Eyes, model: Model) -> list[Recognised]:
    """The taught parts that the straight edges of both images prove."""
    found, covered = list[Recognised](), list[Shape]()
    seen = sorted(seen_by_segments(eyes, model), key=lambda s: -s.nats)
    for one in seen:
        if any(_overlap(one.covers, shape) for shape in covered):
            continue
        covered.append(one.covers)
        rivals = [o for o in seen if o.label != one.label and _overlap(o.covers, one.covers)]
        if all(o.nats < RIVAL * one.nats for o in rivals):
            found.append(_recognised(one, rivals[0].label if rivals else None, eyes, model))
    return found


def seen_by_segments(eyes: Eyes, model: Model) -> Iterator[Seen]:
    """Every taught part, at each place that looks different, that the straight edges of both images prove."""
    corners = meet(segment_corners(eyes.left.segments), segment_corners(eyes.right.segments), eyes.geometry)
    maps = directed_map(eyes.left.segments, eyes.left.grey.shape), directed_map(eyes.right.segments, eyes.right.grey.shape)
    likely = []
    for guess in guesses_from_space(corners, eyes.geometry, model):
        solid = model.metric[guess.label].solid
        nats, _ = evidence(solid, guess.poses, eyes.geometry, maps)
        good = nats > LEAST_NATS / 3
        likely.append(Guesses(guess.label, solid, guess.poses[good], -nats[good]))
    kept = different(likely, eyes, MOST)
    solids = [model.metric[label].solid for label, _ in kept]
    located = locate(solids, eyes, np.array([pose for _, pose in kept]), REACH_MM, model.parameters.tolerance_mm)
    for (label, _), solid, at in zip(kept, solids, located, strict=True):
        fit = None if at is None else fit_of(at, LEAST_OUTLINE)
        if at is None or fit is None:
            continue
        pose = fit.cyclopean_from_part
        nats, most = (float(each[0]) for each in evidence(solid, pose[None], eyes.geometry, maps))
        if nats < LEAST_NATS or facets_in_view(solid, eyes, pose) < 2:
            continue
        if confirmed_facets(solid, at, eyes)[1] + SHARE * nats / most < PROVED:
            continue
        alike = likeness(solid, pose, eyes)
        if (alike is None or alike >= LEAST_LIKENESS) and shown(solid, eyes, pose, SHOWN_MM) >= LEAST_SHOWN:
            yield Seen(label, solid, at, fit, nats, nats / most, silhouette(solid, pose, eyes))


def _overlap(one: Shape, other: Shape) -> bool:
    return one.covers(other) > OVERLAP


def _recognised(seen: Seen, runner_up: str | None, eyes: Eyes, model: Model) -> Recognised:
    """The part with the facets that both eyes have in view, measured where its sides show."""
    laid = facets_laid(seen.solid, seen.located, eyes)
    facets = typed_as(
        [measured_facet(f, eyes.geometry) for f in laid], (seen.solid.types[f.index] for f in laid), model.library
    )
    pose = seen.fit.cyclopean_from_part
    corners = frames.apply(pose, seen.solid.corners_mm)
    fitted = tuple(corners[seen.solid.rings[f.index]] for f in laid)
    why = f"{100 * seen.share:.0f} % of its edges show as straight lines in both eyes"
    name = Recognition(seen.label, BY_EDGES, 0.0, 0.0, runner_up, False, why, (seen.label,))
    part = Part(name, facets, pose, seen.fit.covariance, seen.fit.residual_mm, fitted, pose[None])
    return Recognised(weld(list(facets)), part)
