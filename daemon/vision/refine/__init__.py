"""Poses of taught shapes refined on the edges of both pictures, and what those edges show."""

from daemon.vision.refine.edge_adjustment import PRIOR, WORN_MM, refined_parts
from daemon.vision.refine.edge_pose import (
    LaidFacet,
    edge_support,
    edges_vanished,
    facets_laid,
    facets_shown,
    fit_at,
    fit_each,
    fit_edges,
    refined_pose,
    shown,
)
from daemon.vision.refine.edge_samples import EdgeEvidence, EdgeSamples, aligned_to_edges, edge_samples_of
from daemon.vision.refine.expected_edges import (
    LEAST_ARC_PX,
    LINE_SIGMAS,
    ROOM_PX,
    SCALE,
    THIN_PX,
    EdgeObservation,
    ExpectedEdges,
    across,
    turned,
)
from daemon.vision.refine.following import Fit, refit
from daemon.vision.refine.rim_samples import RimSeen, rims_seen

__all__ = [
    "LEAST_ARC_PX",
    "LINE_SIGMAS",
    "PRIOR",
    "ROOM_PX",
    "SCALE",
    "THIN_PX",
    "WORN_MM",
    "EdgeEvidence",
    "EdgeObservation",
    "EdgeSamples",
    "ExpectedEdges",
    "Fit",
    "LaidFacet",
    "RimSeen",
    "across",
    "aligned_to_edges",
    "edge_samples_of",
    "edge_support",
    "edges_vanished",
    "facets_laid",
    "facets_shown",
    "fit_at",
    "fit_each",
    "fit_edges",
    "refined_parts",
    "refined_pose",
    "refit",
    "rims_seen",
    "shown",
    "turned",
]
