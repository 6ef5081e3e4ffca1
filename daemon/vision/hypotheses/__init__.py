"""Which taught part could be where: from 3-D junctions, single facets, the support plane; ranked by segments."""

from daemon.vision.hypotheses.edge_distance_map import directed_map, elsewhere, in_sizes, other_sizes
from daemon.vision.hypotheses.junctions import lookalikes
from daemon.vision.hypotheses.pose_batch import COVERED, hull, pixels, silhouette
from daemon.vision.hypotheses.search import (
    FEWEST_IN_VIEW,
    SEARCHED,
    Likely,
    Search,
    guessed_by_facets,
    guessed_in_space,
    guessed_on_table,
    nearby,
    prepare,
)
from daemon.vision.hypotheses.support_plane import Ground, flat_on, rested, rests_on

__all__ = [
    "COVERED",
    "FEWEST_IN_VIEW",
    "SEARCHED",
    "Ground",
    "Likely",
    "Search",
    "directed_map",
    "elsewhere",
    "flat_on",
    "guessed_by_facets",
    "guessed_in_space",
    "guessed_on_table",
    "hull",
    "in_sizes",
    "lookalikes",
    "nearby",
    "other_sizes",
    "pixels",
    "prepare",
    "rested",
    "rests_on",
    "silhouette",
]
