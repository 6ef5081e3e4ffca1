"""What a part laid onto both images measures: its facets, and what it covers."""

from __future__ import annotations

import cv2
import numpy as np

from daemon import frames
from daemon.arrays import Array
from daemon.vision.facets import triangulated_covariance
from daemon.vision.geometry import Baseline, Polyhedron, Shape, planarity
from daemon.vision.image import Eyes
from daemon.vision.registration.edge_pose import LaidFacet
from daemon.vision.registration.posed import pixels
from daemon.vision.values import Facet


def measured_facet(seen: LaidFacet, geometry: Baseline) -> Facet:
    """The facet triangulated from its corners in both eyes."""
    (left, left_doubt), (right, right_doubt) = seen.left, seen.right
    ideal = geometry.left.ideal(left), geometry.right.ideal(right)
    corners = geometry.points(*ideal)
    off = np.abs(ideal[0][:, 1] - ideal[1][:, 1]) * geometry.left.focal_px
    covariance = triangulated_covariance(geometry, *ideal, left_doubt, right_doubt)
    return Facet(corners, covariance, left, right, off, planarity(corners))


def silhouette(solid: Polyhedron, pose: Array, eyes: Eyes) -> Shape:
    """What a part at cyclopean_from_part (4, 4) covers in the left eye."""
    return hull(pixels(frames.apply(pose, solid.corners_mm), eyes.geometry)[0])


def hull(corners_px: Array) -> Shape:
    """What a part covers whose corners are seen at (K, 2) px."""
    return Shape.of(cv2.convexHull(corners_px.astype(np.float32))[:, 0].astype(float))
