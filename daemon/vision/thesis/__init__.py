"""The thesis's own detectors and formulas, selectable beside facetd's, so that they can be compared.

Nothing on the default path calls them. docs/THESIS.md has the comparison.
"""

from daemon.vision.thesis.borders import slope_corners
from daemon.vision.thesis.corners import find_corners
from daemon.vision.thesis.depth import Converging, by_formula, converging
from daemon.vision.thesis.silhouettes import silhouette
