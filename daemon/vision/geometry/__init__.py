"""Cameras, rays, planes, polygons, rigid fits, as arrays. No pixel is read, nothing has a name."""

from daemon.vision.geometry.chisquare import chi_square_limit, chi_square_tail
from daemon.vision.geometry.facet_measures import Measures, area_vector, measure, newell_normal
from daemon.vision.geometry.planes import (
    apart2,
    axes_in,
    basis,
    fit_circle,
    fit_plane,
    planarities,
    planarity,
    weighted_plane,
)
from daemon.vision.geometry.polygon import (
    PlanarShape,
    Point,
    border_loops,
    drop_side,
    inside,
    is_simple,
    outward,
    sides_of,
    tidy,
)
from daemon.vision.geometry.polygon_batch import Rings, areas, convex, different, met, rings
from daemon.vision.geometry.polyhedron import Hole, Polyhedron, exact, united, with_rings
from daemon.vision.geometry.rectified import Baseline, RectifiedCamera, baseline, disparity
from daemon.vision.geometry.rig import Camera, StereoRig, corner_covariance, moved_rig
from daemon.vision.geometry.rigid_fit import Fits, fit_poses, rough_fit
from daemon.vision.geometry.robust_least_squares import LeastSquaresFit, robust_weight, solve, whitener
from daemon.vision.geometry.solid_batch import SolidBatch, thickness
from daemon.vision.geometry.visibility import FACING, hidden, visible_from

__all__ = [
    "FACING",
    "Baseline",
    "Camera",
    "Fits",
    "Hole",
    "LeastSquaresFit",
    "Measures",
    "PlanarShape",
    "Point",
    "Polyhedron",
    "RectifiedCamera",
    "Rings",
    "SolidBatch",
    "StereoRig",
    "apart2",
    "area_vector",
    "areas",
    "axes_in",
    "baseline",
    "basis",
    "border_loops",
    "chi_square_limit",
    "chi_square_tail",
    "convex",
    "corner_covariance",
    "different",
    "disparity",
    "drop_side",
    "exact",
    "fit_circle",
    "fit_plane",
    "fit_poses",
    "hidden",
    "inside",
    "is_simple",
    "measure",
    "met",
    "moved_rig",
    "newell_normal",
    "outward",
    "planarities",
    "planarity",
    "rings",
    "robust_weight",
    "rough_fit",
    "sides_of",
    "solve",
    "thickness",
    "tidy",
    "united",
    "visible_from",
    "weighted_plane",
    "whitener",
    "with_rings",
]
