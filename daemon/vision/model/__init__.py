"""What was taught: facet types, relation matrix, views, the part merged from them. Values; no image."""

from daemon.vision.model.correspond import Correspondence, correspondences, spread_from, symmetries
from daemon.vision.model.facet_types import (
    LARGEST_NUMBER,
    FacetLibrary,
    FacetType,
    Value,
    conditions,
    type_facet,
    type_number,
)
from daemon.vision.model.merge import TOLERANCE_MM, MetricModel, fit_shared, merge_views
from daemon.vision.model.model import (
    Model,
    Parameters,
    TaughtView,
    TeachError,
    empty_model,
    learn_pattern,
    learn_view,
)
from daemon.vision.model.patterns import Answer, by_label, recall, typed
from daemon.vision.model.regularise import regularise
from daemon.vision.model.relation_matrix import MATRIX_SIZE

__all__ = [
    "LARGEST_NUMBER",
    "MATRIX_SIZE",
    "TOLERANCE_MM",
    "Answer",
    "Correspondence",
    "FacetLibrary",
    "FacetType",
    "MetricModel",
    "Model",
    "Parameters",
    "TaughtView",
    "TeachError",
    "Value",
    "by_label",
    "conditions",
    "correspondences",
    "empty_model",
    "fit_shared",
    "learn_pattern",
    "learn_view",
    "merge_views",
    "recall",
    "regularise",
    "spread_from",
    "symmetries",
    "type_facet",
    "type_number",
    "typed",
]
