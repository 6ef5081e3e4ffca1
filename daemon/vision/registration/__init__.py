"""A part that is known, or suspected, laid onto both images: its pose from edges; proof or refusal."""

from daemon.vision.registration.corner_pose import Fit, poses_that_fit, refit
from daemon.vision.registration.edge_pose import fit_edges, shown
from daemon.vision.registration.sharpen import sharpened
from daemon.vision.registration.verify import verify

__all__ = [
    "Fit",
    "fit_edges",
    "poses_that_fit",
    "refit",
    "sharpened",
    "shown",
    "verify",
]
