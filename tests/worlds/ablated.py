"""A model without its recall, or with one that is wrong: what a look then names shows what recall is worth.

The two functions that take a Model are all that knows how it keeps what it recalls by.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from daemon.art import FuzzyARTMAP
from daemon.store.library import load_facets
from daemon.teaching.aspects import learn_solid
from daemon.vision.geometry.rig import StereoRig
from daemon.vision.model.model import Model, empty_model
from daemon.vision.values import Part
from tests.worlds.drawn import obj, solid
from tests.worlds.solids import KNOWN


def without_recall(model: Model) -> Model:
    """The model without one of its nodes; drawings, views and labels as they were."""
    return replace(model, artmap=None)


def misled(model: Model) -> Model:
    """The model whose nodes each stand for the label after their own (`instead`); all else as it was."""
    if model.artmap is None:
        return model
    p, state, labels = model.parameters, model.artmap.state(), model.artmap.classes
    order = [labels.index(wrong) for wrong in instead(model).values()]
    counts = np.zeros_like(state["map_counts"])
    counts[:, order] = state["map_counts"][:, [labels.index(right) for right in instead(model)]]
    fresh = FuzzyARTMAP(p.rho, p.alpha, p.beta, complement=p.complement)
    return replace(model, artmap=fresh.restore({**state, "map_counts": counts}, labels))


def instead(model: Model) -> dict[str, str]:
    """The label that misled nodes give for each: the one taught after it, the first for the last."""
    return dict(zip(model.labels, (*model.labels[1:], *model.labels[:1]), strict=True))


def by_facets(part: Part) -> bool:
    """Whether a named part has its name of its facets, as the reason says it; else it has it of its edges."""
    return part.named and "facets fit" in part.recognition.reason


def four_drawn(rig: StereoRig) -> Model:
    """The four parts of the rendered scenes, taught from their drawings."""
    model = empty_model(load_facets())
    for label, body in KNOWN.items():
        model = learn_solid(model, solid(f"{label}.obj", obj(body.corners_mm, list(body.facets))), rig, label)
    return model
