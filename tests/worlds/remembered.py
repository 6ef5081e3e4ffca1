"""Parts learnt from exact shapes, and what their memory proposes of facets, fitted: for tests of what comes after."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from daemon.store.library import load_facets
from daemon.vision.geometry.polyhedron import Polyhedron
from daemon.vision.model import Model, empty_model, learn_solids, type_facet
from daemon.vision.recognition.fits import Hypothesis, fitted, lone_ways
from daemon.vision.recognition.recall import recalled
from daemon.vision.settings import MemorySettings

LIBRARY = load_facets()
Types = tuple[tuple[str, ...], ...]


def types_open(solid: Polyhedron) -> Types:
    """Every type that each facet may have as it was measured."""
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


def hypotheses(seen: Polyhedron, model: Model, vigilance: float | None = None) -> tuple[Hypothesis, ...]:
    """What the memory recalls of facets at a vigilance (none: the model's), or of a lone one its sizes; each fitted."""
    if len(seen.facets) == 1:
        ways = lone_ways(seen, model.metric)
    else:
        least = model.parameters.vigilance if vigilance is None else vigilance
        ways = [(one.label, one.way) for one in recalled(seen, types_open(seen), model, least)]
    return fitted(seen, model.metric, ways, model.parameters.tolerance_mm)
