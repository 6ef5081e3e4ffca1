"""Models learnt from exact shapes, and the fitted hypotheses that they recall for facets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from daemon.store.library import load_facets
from daemon.vision.geometry.polyhedron import Polyhedron
from daemon.vision.model import Model, empty_model, learn_solids, learn_view, type_facet
from daemon.vision.recognition.fits import FacetHypothesis, fit_candidates, recall_views, single_facet_candidates
from daemon.vision.settings import MemorySettings
from tests.fakes.solids import CUBE, PENTAGONAL, PYRAMID, TRIANGULAR, Body, pose, view_of

LIBRARY = load_facets()
Types = tuple[tuple[str, ...], ...]
SIX_VIEWS = (
    ("cube", CUBE, (1.0, 0.1, 0.8)),
    ("pyramid", PYRAMID, (0.05, 0.03, 1.0)),
    ("pyramid", PYRAMID, (0.6, 0.5, -0.5)),
    ("triangular_prism", TRIANGULAR, (0.7, 0.05, 0.5)),
    ("pentagonal_prism", PENTAGONAL, (0.25, 0.76, 0.5)),
    ("pentagonal_prism", PENTAGONAL, (0.81, 0.59, 0.05)),
)
"""The thesis's six characteristic views: the part and the direction it is seen from."""


def types_open(solid: Polyhedron) -> Types:
    """All types that each facet may have within its measurement errors."""
    return tuple(
        tuple(kind.name for kind in type_facet(solid.corners_mm[ring], solid.covariance_mm2[ring], LIBRARY))
        for ring in solid.rings
    )


def remembered(parts: Mapping[str, Polyhedron], parameters: MemorySettings | None = None) -> Model:
    """A model that learnt these shapes, which it types where they are not."""
    typed = {
        label: one if one.types else replace(one, types=tuple(names[0] for names in types_open(one)))
        for label, one in parts.items()
    }
    return learn_solids(empty_model(LIBRARY, parameters), [(label, one, "") for label, one in typed.items()])


def hypotheses(seen: Polyhedron, model: Model, vigilance: float | None = None) -> tuple[FacetHypothesis, ...]:
    """What the memory recalls of facets at a vigilance (none: the model's), or of a lone one its sizes; each fitted."""
    if len(seen.facets) == 1:
        ways = single_facet_candidates(seen, model.metric)
    else:
        least = model.parameters.vigilance if vigilance is None else vigilance
        ways = [(one.label, one.correspondence) for one in recall_views(seen, types_open(seen), model, least)]
    return fit_candidates(seen, model.metric, ways, model.parameters.tolerance_mm)


def shown(views: Sequence[tuple[str, Body, tuple[float, float, float]]]) -> Model:
    """A model that was taught views of parts, each from a direction, with realistic corner noise."""
    rng, model = np.random.default_rng(3), empty_model(LIBRARY)
    for label, body, direction in views:
        model = learn_view(model, view_of(body, pose(np.array(direction), 0.3), rng, 0.6), label)
    return model
