"""Which taught part could be where: from 3-D junctions, single facets, the support plane; ranked by segments."""

from daemon.vision.hypotheses.circles import rims_of, turns_about_axis
from daemon.vision.hypotheses.directional_edge_map import edge_distances, in_sizes, self_similarity
from daemon.vision.hypotheses.junctions import indistinguishable_turns
from daemon.vision.hypotheses.pose_batch import COVERED, PoseBatch, pixels
from daemon.vision.hypotheses.resting_poses import (
    SupportPlane,
    lies_on_support,
    snapped_poses,
    snapped_where_it_lies,
)
from daemon.vision.hypotheses.search import (
    FEWEST_IN_VIEW,
    SEARCHED,
    EdgeHypothesis,
    Search,
    hypotheses_from_facets,
    hypotheses_from_junctions,
    hypotheses_on_support,
    perturbed_poses,
    prepare,
)
