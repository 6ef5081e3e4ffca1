"""Poses of taught shapes refined on the edges of both pictures, and what those edges show."""

from daemon.vision.refine.edge_pose import LaidFacet, borne_out, facets_in_view, facets_laid, fit_each, fit_edges, shown
from daemon.vision.refine.edge_samples import Borne, Stretches, settled, stretches_of
from daemon.vision.refine.expected_edges import ROOM_PX, THIN_PX, ExpectedEdges, Placements
from daemon.vision.refine.following import Fit, refit
from daemon.vision.refine.poses import SCALE, across, turned
from daemon.vision.refine.refined import best_fitted, sharpened

__all__ = [
    "ROOM_PX",
    "SCALE",
    "THIN_PX",
    "Borne",
    "ExpectedEdges",
    "Fit",
    "LaidFacet",
    "Placements",
    "Stretches",
    "across",
    "best_fitted",
    "borne_out",
    "facets_in_view",
    "facets_laid",
    "fit_each",
    "fit_edges",
    "refit",
    "settled",
    "sharpened",
    "shown",
    "stretches_of",
    "turned",
]
