"""Poses of taught shapes refined on the edges of both pictures, and what those edges show."""

from daemon.vision.refine.edge_adjustment import PRIOR, WORN_MM, refined_parts
from daemon.vision.refine.edge_pose import (
    clear_edge_fraction,
    count_visible_facets,
    expected_covariance,
    facets_from_edges,
    fit_by_each_camera,
    fit_by_edges,
    outline_coverage,
    refine_from_pose,
    vanished_edge_fraction,
)
from daemon.vision.refine.edge_samples import EdgeEvidence, EdgeSamples, aligned_to_edges, edge_samples_of
from daemon.vision.refine.expected_edges import (
    LEAST_ARC_PX,
    LINE_SIGMAS,
    ROOM_PX,
    SCALE,
    THIN_PX,
    EdgeObservation,
    across,
    turned,
)
from daemon.vision.refine.following import Fit, fit_to_facets
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
    "Fit",
    "RimSeen",
    "across",
    "aligned_to_edges",
    "clear_edge_fraction",
    "count_visible_facets",
    "edge_samples_of",
    "expected_covariance",
    "facets_from_edges",
    "fit_by_each_camera",
    "fit_by_edges",
    "fit_to_facets",
    "outline_coverage",
    "refine_from_pose",
    "refined_parts",
    "rims_seen",
    "turned",
    "vanished_edge_fraction",
]
