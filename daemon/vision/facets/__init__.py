"""Two sets of outlines -> facets in space, grouped, corners welded once; several looks fused. Nothing is named."""

from daemon.vision.facets.arc_rings import round_facets
from daemon.vision.facets.candidates import triangulate
from daemon.vision.facets.circles import FARTHEST_MM, NEAREST_MM, MeasuredCircle, differs_mm, find_circles
from daemon.vision.facets.fusing import FusedLooks, LookFacets, fuse, group_of, only
from daemon.vision.facets.grouping import connected, merge_vertices
from daemon.vision.facets.looks_adjustment import shared_motion
from daemon.vision.facets.reconstruct import facets_of_images, find_facets, with_single_camera_outlines
from daemon.vision.facets.table_estimation import estimate_table
from daemon.vision.facets.table_plane import TablePlane, table_at, table_of, without_table
