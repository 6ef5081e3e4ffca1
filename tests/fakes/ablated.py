"""Models without recall or with wrong labels of recall, to measure what recall contributes to recognition."""

from __future__ import annotations

from dataclasses import replace

from daemon.store.library import load_facets
from daemon.vision.model.model import Model, empty_model, learn_solids
from daemon.vision.values import Part
from tests.fakes.drawn import obj, solid
from tests.fakes.solids import KNOWN


def without_recall(model: Model) -> Model:
    """The model without one of its nodes; drawings, views and labels as they were."""
    memory = model.artmap
    bare = replace(memory, lower=memory.lower[:0], upper=memory.upper[:0], counts=memory.counts[:0])
    return replace(model, artmap=bare)


def misled(model: Model) -> Model:
    """The model whose nodes each stand for the label after their own (`instead`); all else as it was."""
    wrong = tuple(instead(model)[label] for label in model.artmap.labels)
    return replace(model, artmap=replace(model.artmap, labels=wrong))


def instead(model: Model) -> dict[str, str]:
    """The label that misled nodes give for each: the one taught after it, the first for the last."""
    return dict(zip(model.labels, (*model.labels[1:], *model.labels[:1]), strict=True))


def by_facets(part: Part) -> bool:
    """Whether a part was named by its facets, by the reason's text; else by its edges."""
    return part.named and "facets fit" in part.recognition.reason


def four_drawn() -> Model:
    """The four parts of the rendered scenes, taught from their drawings."""
    bodies = ((label, obj(body.corners_mm, list(body.facets))) for label, body in KNOWN.items())
    return learn_solids(empty_model(load_facets()), [(label, solid(f"{label}.obj", it), label) for label, it in bodies])
