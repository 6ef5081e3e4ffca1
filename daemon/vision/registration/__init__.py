"""A part that is known, or suspected, laid onto both images: its pose from edges; proof or refusal."""

from daemon.vision.registration.beside import all_explained, beside
from daemon.vision.registration.by_segments import named_by_segments
from daemon.vision.registration.corner_pose import Fit, refit
from daemon.vision.registration.edge_pose import borne_out, fit_each, fit_edges, shown
from daemon.vision.registration.guessing import made_ready
from daemon.vision.registration.missing import with_all_they_show
from daemon.vision.registration.on_table import rested
from daemon.vision.registration.sharpen import sharpened

__all__ = [
    "Fit",
    "all_explained",
    "beside",
    "borne_out",
    "fit_each",
    "fit_edges",
    "made_ready",
    "named_by_segments",
    "refit",
    "rested",
    "sharpened",
    "shown",
    "with_all_they_show",
]
