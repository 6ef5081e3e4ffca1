"""One image -> straight-sided outlines and sub-pixel corners. Nothing is compared with the other camera here.

stereo_images.py keeps the two together: what a look prepares once, and everything that runs over it takes.
"""

from daemon.vision.image.edge_lines import (
    LEAST_SIGMAS,
    Sides,
    edge_sigmas,
    find_sides,
    fit_sides,
    levels_across,
    line_beside,
    peak_places,
    peaks,
    probe_sides,
    slopes_across,
    stretch_slopes,
)
from daemon.vision.image.ellipses import STEP_PX, Ellipse, rim_slopes, sweep_of
from daemon.vision.image.grey import BLOCK_PX, SATURATED, Grey, VisionError, as_grey, block_means
from daemon.vision.image.outlines import MODEL_PX, Fitted, Outline, met_covariance
from daemon.vision.image.regions import SMOOTHING_PX, RoughPolygon, Scale
from daemon.vision.image.segments import (
    SegmentCorners,
    Segments,
    find_segments,
    join_segments,
    pairs_within,
    ranks,
    runs,
    segment_corners,
)
from daemon.vision.image.stereo_images import CameraImage, StereoImages, fitted_outlines, open_stereo, outlines_near
