"""A taught part registered on both images at a hypothetical pose, and what its edges show there.

In: hypotheses. Out: parts where their edges lie, with the evidence for each. Whether one of them is there is
by_edges.py's.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from daemon import frames
from daemon.arrays import Array, Flags
from daemon.vision.evidence.edge_places import edge_places
from daemon.vision.evidence.occlusion import hidden_of
from daemon.vision.facets import merge_vertices, triangulate
from daemon.vision.geometry import PlanarShape, Polyhedron, SolidBatch
from daemon.vision.hypotheses import COVERED, EdgeHypothesis, Search, lies_on_support
from daemon.vision.image import StereoImages
from daemon.vision.model import Model
from daemon.vision.recognition import Recognised, typed_as
from daemon.vision.refine import (
    EdgeEvidence,
    EdgeObservation,
    EdgeSamples,
    Fit,
    aligned_to_edges,
    edge_samples_of,
    facets_from_edges,
    refine_from_pose,
)
from daemon.vision.values import Facet, Part, Recognition

BY_NATS, BY_WHOLE, ELSE = 0.168, 12.7, -2.7
"""What a part's log odds are made of, before all guesses that were made share them: nats of evidence; the cube of its
share of what there could be; and what is left. A logistic regression on parts laid in 235 rendered and photographed
looks with their own part taught and without it, 64 parts taught in some; what is left has since grown by .3, when two
terms were taken out that gave right parts as much and more."""
ON_TABLE = {True: 4.0, False: -3.0, None: 0.0}
"""What it adds to them that a part lies on the table that both cameras see, or does not; None: nobody knows. Of guesses
in those looks that were worth -2 and more without it, 288 of 295 true ones lay on it and none of 33 false ones."""


@dataclass(frozen=True, eq=False)
class RegisteredPart:
    """A taught part laid onto both images at a pose (4, 4) cyclopean_from_part: what its edges show there; nats of
    evidence and their fraction of what there could be; left_px (K, 2): its corners in the left camera; tested: of how
    many poses at one guess it is the best; rests: whether it lies on the table, where that is seen."""

    search: Search
    label: str
    solid: Polyhedron
    pose: Array
    seen: tuple[EdgeSamples, EdgeSamples]
    evidence: EdgeEvidence
    left_px: Array
    tested: float = 1.0
    rests: bool | None = None

    @cached_property
    def covers(self) -> PlanarShape:
        """The shape that it covers in the left camera."""
        return PlanarShape.hull(self.left_px)

    @property
    def odds(self) -> float:
        """Log odds of its being there by its edges alone, before all guesses that were made share them."""
        by_edges = BY_NATS * self.evidence.nats + BY_WHOLE * max(self.evidence.fraction, 0.0) ** 3 + ELSE
        return by_edges - float(np.log(self.tested)) + ON_TABLE[self.rests]

    @cached_property
    def measured(self) -> MeasuredPart:
        """The part where its edges have it, measured once."""
        return measure_at(self.solid, self.pose, self.search.images, self.search.model, self.seen)

    def without_hidden(self) -> RegisteredPart:
        """Return the same without the stretches of its edges that something nearer hides."""
        images = self.search.images
        hidden = hidden_of(self.solid, self.pose, images, edge_places(self.solid, self.pose, images))
        if not any(one.any() for one in hidden):
            return self
        left, right = (_but_for(seen, self.solid, one) for seen, one in zip(self.seen, hidden, strict=True))
        return replace(self, seen=(left, right), evidence=EdgeEvidence.of((left, right)))

    def overlaps(self, other: RegisteredPart) -> bool:
        """Whether both cannot be there."""
        return self.covers.covers(other.covers) > COVERED


def _but_for(seen: EdgeSamples, solid: Polyhedron, hidden: Flags) -> EdgeSamples:
    """Return what edges show without what is hidden (L, S) along those of a solid, as EdgePlaces has them."""
    which = np.array([solid.line_numbers[a, b] for a, b in seen.edges.ends.tolist()], np.intp)
    stretches = seen.visible.shape[1]
    own = hidden[which].reshape(len(which), stretches, hidden.shape[1] // stretches).mean(2) > 0.5
    return replace(seen, visible=seen.visible & ~own)


def register_near(search: Search, hypotheses: Sequence[EdgeHypothesis]) -> Iterator[RegisteredPart]:
    """Move each hypothesis to where both images have its edges, and register it there."""
    if not hypotheses:
        return
    batch = SolidBatch.of([search.model.metric[one.label].solid for one in hypotheses])
    tolerance = search.model.parameters.tolerance_mm
    poses = aligned_to_edges(batch, search.images, np.stack([one.pose for one in hypotheses]), tolerance)
    yield from register_at(search, [one._replace(pose=pose) for one, pose in zip(hypotheses, poses, strict=True)])


def register_at(search: Search, hypotheses: Sequence[EdgeHypothesis]) -> Iterator[RegisteredPart]:
    """Sample both images along the edges of each hypothesis at its own pose."""
    images, model, ground = search.images, search.model, search.ground
    solids, poses = [model.metric[one.label].solid for one in hypotheses], np.stack([one.pose for one in hypotheses])
    batch, tolerance = SolidBatch.of(solids), model.parameters.tolerance_mm
    seen = edge_samples_of(batch, images, poses, tolerance)
    corners = batch.corners_mm @ poses[:, :3, :3].swapaxes(1, 2) + poses[:, None, :3, 3]
    left_px = images.left.rectified.camera.project(corners).reshape(*corners.shape[:2], 2)
    for k, (one, solid, pose) in enumerate(zip(hypotheses, solids, poses, strict=True)):
        own = seen[0].only(k, batch), seen[1].only(k, batch)
        rests = None if ground is None else lies_on_support(ground, solid, pose)
        yield RegisteredPart(search, one.label, solid, pose, own, EdgeEvidence.of(own), left_px[k], one.tested, rests)


class MeasuredPart(NamedTuple):
    """Where its edges have a part; its facets that both cameras have in view, by their numbers, and as they were
    measured there; and the edges that either camera observed."""

    fit: Fit
    numbers: list[int]
    facets: tuple[Facet, ...]
    edges: tuple[EdgeObservation, EdgeObservation]


def measure_at(
    solid: Polyhedron, pose: Array, images: StereoImages, model: Model, samples: Sequence[EdgeSamples] = ()
) -> MeasuredPart:
    """A part measured that is near a pose (4, 4) cyclopean_from_part; samples: what stretches show at the pose, where
    that was asked already."""
    fit, observed = refine_from_pose(solid, images, pose, model.parameters.tolerance_mm, samples)
    outlined = facets_from_edges(solid, observed)
    facets, numbers = triangulate([(left, right) for left, right in outlined.values()], images.geometry), list(outlined)
    return MeasuredPart(fit, numbers, typed_as(facets, (solid.types[k] for k in numbers), model.library), observed)


def recognised_at(
    solid: Polyhedron, measured: MeasuredPart, name: Recognition, pose: Array, covariance: Array, equivalents: Array
) -> Recognised:
    """A measured part with its name, at a pose (4, 4) with covariance (6, 6) and its equivalents (E, 4, 4)."""
    corners = frames.apply(pose, solid.corners_mm)
    fitted = tuple(corners[solid.rings[k]] for k in measured.numbers)
    part = Part(name, measured.facets, pose, covariance, measured.fit.residual_mm, fitted, equivalents)
    return Recognised(merge_vertices(list(measured.facets)), part)
