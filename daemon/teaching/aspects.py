"""A part taught from its drawing: the views its solid shows from all round, learnt as if they had been shown. Pure.

Files are mesh.py's, the solid is solid_from_mesh.py's; what cameras would measure is sufficiency.py.
"""

from __future__ import annotations

from collections import deque
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from daemon.arrays import Array
from daemon.teaching.sufficiency import imagined_group, spread
from daemon.vision.geometry import Polyhedron, StereoRig, visible_from
from daemon.vision.model import MATRIX_SIZE, MetricModel, Model, TeachError, learn_pattern, merge_views
from daemon.vision.values import Group

Pattern = tuple[tuple[str, tuple[str, ...]], ...]
DIRECTIONS = 400
OBLIQUE = 0.15  # cosine below which a facet is not seen: less than what a look can be trusted with, as parts turn


def aspects(solid: Polyhedron, rig: StereoRig) -> tuple[Group, ...]:
    """The characteristic views: one for each pattern of facets that is in view from somewhere, the richest first.

    Of facets in view those count that hang together with the one turned most to the cameras, and of these at most as
    many as the relation matrix has rows. Views of a single facet prove nothing and are none.
    """
    touching = solid.touching
    found: dict[Pattern, tuple[float, tuple[int, ...], Array]] = {}
    directions = spread(DIRECTIONS)
    for towards, seen in zip(directions, visible_from(solid, directions, OBLIQUE), strict=True):
        facing = solid.normals @ towards
        shown = _together(tuple(np.flatnonzero(seen).tolist()), facing, touching)
        if len(shown) < 2:
            continue
        pattern = _pattern(solid, shown, touching)
        clearness = float(facing[list(shown)].min())
        if pattern not in found or clearness > found[pattern][0]:
            found[pattern] = (clearness, shown, towards)
    best = sorted(found.values(), key=lambda view: (-len(view[1]), -view[0]))
    return tuple(imagined_group(solid, shown, towards, rig) for _, shown, towards in best)


def learn_solid(model: Model, solid: Polyhedron, rig: StereoRig, label: str, source: str = "") -> Model:
    """The model with every characteristic view of the solid; its shape is the drawing's, to the last corner.

    Raises TeachError where no two of its facets are ever in view together.
    """
    views = aspects(solid, rig)
    if not views:
        raise TeachError(f"{label}: no two of its {len(solid.facets)} facets that share an edge are in view together")
    for view in views:
        model = learn_pattern(model, view, label, source)
    drawn = merge_views((solid,), model.library)
    count = sum(view.label == label for view in model.views)
    return replace(model, metric={**model.metric, label: MetricModel(drawn.solid, tuple(range(count)))})


def _together(shown: tuple[int, ...], facing: Array, touching: NDArray[np.bool_]) -> tuple[int, ...]:
    """The facets that hang together with the one that faces the cameras most, nearest first, not too many."""
    if not shown:
        return ()
    kept = [max(shown, key=lambda k: facing[k])]
    queue = deque(kept)
    while queue:
        here = queue.popleft()
        for k in sorted(shown, key=lambda k: -facing[k]):
            if touching[here, k] and k not in kept and len(kept) < MATRIX_SIZE:
                kept.append(k)
                queue.append(k)
    return tuple(sorted(kept))


def _pattern(solid: Polyhedron, shown: tuple[int, ...], touching: NDArray[np.bool_]) -> Pattern:
    """What tells one view from another whatever the numbering: each facet's type with those of its neighbours."""
    return tuple(
        sorted(
            (solid.types[k], tuple(sorted(solid.types[n] for n in shown if touching[k, n])))
            for k in shown
        )
    )  # fmt: skip
