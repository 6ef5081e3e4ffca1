"""What was taught: facet types, relation matrix, views, the part merged from them. Values; no image."""

from daemon.vision.model.aspect_sets import aspects, spread
from daemon.vision.model.correspond import Correspondence, correspondences, correspondences_from
from daemon.vision.model.facet_types import (
    LARGEST_NUMBER,
    FacetLibrary,
    FacetType,
    Value,
    conditions,
    type_facet,
    type_number,
    types_of_each,
    with_types_of_arcs,
)
from daemon.vision.model.merge import MetricModel, fit_shared, merge_views
from daemon.vision.model.model import (
    Model,
    TaughtView,
    TeachError,
    empty_model,
    learn_solid,
    learn_solids,
    learn_view,
    relearnt,
)
from daemon.vision.model.relations import FEATURES, MATRIX_SIZE, relational_view, types_of
from daemon.vision.model.ring_names import facet_name, facets_counted
from daemon.vision.model.symmetry import (
    EXACT_MM,
    Axis,
    axis_of_revolution,
    facet_turns,
    in_batches,
    mirror_images,
    symmetries,
    turns_but_for_holes,
    turns_onto_themselves,
)
