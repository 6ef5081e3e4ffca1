"""Facets in space: of one look (one_look), of several together (many_looks), and what both need: groups, the table."""

from daemon.vision.facets.grouping import connected, merge_vertices
from daemon.vision.facets.many_looks.fusing import FusedLooks, LookFacets, fuse, group_of
from daemon.vision.facets.many_looks.looks_adjustment import shared_motion
from daemon.vision.facets.one_look.arc_rings import round_facets
from daemon.vision.facets.one_look.candidates import triangulate
from daemon.vision.facets.one_look.circles import FARTHEST_MM, NEAREST_MM, MeasuredCircle, differs_mm, find_circles
from daemon.vision.facets.one_look.reconstruct import facets_of_images, find_facets, with_single_camera_outlines
from daemon.vision.facets.one_look.table_estimation import estimate_table
from daemon.vision.facets.table_plane import TablePlane, table_at, table_of, without_table
