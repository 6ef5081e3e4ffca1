"""Two sets of outlines -> facets in space, grouped, corners welded once. Nothing is named."""

from daemon.vision.facets.candidates import corner_covariance
from daemon.vision.facets.reconstruct import facets_seen, facets_step_by_step, find_facets
from daemon.vision.facets.table import Table, without_table
from daemon.vision.facets.weld import weld

__all__ = [
    "Table",
    "corner_covariance",
    "facets_seen",
    "facets_step_by_step",
    "find_facets",
    "weld",
    "without_table",
]
