"""What was taught: facet library, views, Fuzzy ARTMAP nodes, one metric model a part. Learning and forgetting.

Values in, values out: every change gives a new Model; the same views in the same order give the same one. Files are
daemon/store/model.py's business, recognising is recognise.py's.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from daemon.arrays import Array, Flags
from daemon.art import FuzzyARTMAP
from daemon.art.rotation import RotationLayer
from daemon.errors import FacetdError
from daemon.vision.facets import connected
from daemon.vision.geometry import Polyhedron
from daemon.vision.model.facet_types import FacetLibrary
from daemon.vision.model.merge import TOLERANCE_MM, MetricModel, merge_views
from daemon.vision.model.patterns import recall, typed
from daemon.vision.model.relation_matrix import MATRIX_SIZE, relation_matrix
from daemon.vision.values import Group


class TeachError(FacetdError, ValueError):
    """A view cannot be learnt, or a label not be forgotten: the message says why."""


@dataclass(frozen=True)
class Parameters:
    """rho, alpha, beta, complement: those of Fuzzy ARTMAP while learning (rho 1: each distinct pattern is a node).

    vigilance: the least modified match (5.2) at which a node may answer. tolerance_mm: how far a real part may deviate
    from the taught one, as a standard deviation per axis, on top of all predicted measuring errors.
    """

    rho: float = 1.0
    alpha: float = 0.01
    beta: float = 1.0
    complement: bool = True
    vigilance: float = 1.0
    tolerance_mm: float = TOLERANCE_MM


@dataclass(frozen=True, eq=False)
class TaughtView:
    """One taught view: label; solid in the cyclopean frame of its look, mm; numbers (n,) type numbers; touching (n, n);

    node: the ARTMAP node that stands for its pattern; source: where it came from, for people.
    """

    label: str
    solid: Polyhedron
    numbers: Array
    touching: Flags
    node: int
    source: str = ""


@dataclass(frozen=True, eq=False)
class Model:
    """views in the order taught; artmap: None while empty, never changed in place; metric: {label: merged model}."""

    library: FacetLibrary
    parameters: Parameters = Parameters()
    views: tuple[TaughtView, ...] = ()
    artmap: FuzzyARTMAP | None = None
    matrix_size: int = MATRIX_SIZE
    metric: dict[str, MetricModel] = field(default_factory=dict)

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """Every taught label, in the order first taught."""
        return tuple(dict.fromkeys(v.label for v in self.views))

    @property
    def node_labels(self) -> tuple[str, ...]:
        """The label of each node."""
        return () if self.artmap is None else tuple(str(n) for n in self.artmap.node_labels)

    @cached_property
    def rotation(self) -> RotationLayer | None:
        """The pattern rotation layer over the nodes; None while nothing was taught."""
        if self.artmap is None:
            return None
        m, complement = self.matrix_size, self.parameters.complement
        shape = (-1, 2, m, m) if complement else (-1, m, m)
        return RotationLayer(self.artmap.weights.reshape(shape), self.parameters.alpha, complement)


def empty_model(library: FacetLibrary) -> Model:
    """A model that has been taught nothing."""
    return Model(library)


def learn_view(model: Model, group: Group, label: str, source: str = "") -> Model:
    """The model with one more view of a part, its pattern and its shape. What it knew stays as it was.

    group: the facets of the one part in view, typed or not. Raises TeachError for a view of fewer than two facets
    (it could not be told from other parts), for facets that do not share an edge, and for the label `unknown`.
    """
    taught = learn_pattern(model, group, label, source)
    solids = tuple(v.solid for v in taught.views if v.label == label)
    merged = merge_views(solids, model.library, model.parameters.tolerance_mm)
    return replace(taught, metric={**model.metric, label: merged})


def learn_pattern(model: Model, group: Group, label: str, source: str = "") -> Model:
    """As learn_view, without the shape: for a part whose shape is known from elsewhere. Raises TeachError."""
    if not label or label == "unknown":
        raise TeachError(f"a part cannot be called {label!r}: choose another name")
    facets = tuple(typed(f, model.library) for f in group.facets)
    solid = replace(group, facets=facets).polyhedron
    if len(facets) < 2:
        raise TeachError(f"{label}: {len(facets)} facet in view; show at least two that share an edge")
    if len(connected(solid.touching)) > 1:
        raise TeachError(f"{label}: the {len(facets)} facets in view do not hang together; show the part alone")
    numbers = np.array([f.type_number for f in facets])
    view = TaughtView(label, solid, numbers, solid.touching, -1, source)
    if len(facets) > model.matrix_size:
        return _with_patterns(replace(model, matrix_size=len(facets)), (*model.views, view))
    return _with_pattern(model, view)


def forget(model: Model, label: str) -> Model:
    """The model without a part; the others are as if it had never been taught. Raises TeachError for one not known."""
    if label not in model.labels:
        raise TeachError(f"no part called {label!r} was taught; known: {', '.join(model.labels) or 'none'}")
    without = replace(model, metric={name: metric for name, metric in model.metric.items() if name != label})
    return _with_patterns(without, tuple(v for v in model.views if v.label != label))


def _with_patterns(model: Model, views: tuple[TaughtView, ...]) -> Model:
    """Every pattern learnt anew."""
    bare = replace(model, views=(), artmap=None)
    for view in views:
        bare = _with_pattern(bare, view)
    return bare


def _with_pattern(model: Model, view: TaughtView) -> Model:
    matrix = relation_matrix(view.numbers, view.touching, model.matrix_size)
    order = _known_numbering(model, view)
    matrix = matrix[np.ix_(order, order)]
    artmap = _copied(model)
    node = int(artmap.learn(matrix.reshape(1, -1), [view.label])[0])
    return replace(model, views=(*model.views, replace(view, node=node)), artmap=artmap)


def _known_numbering(model: Model, view: TaughtView) -> list[int]:
    """The numbering under which the pattern is one already known, if there is one, else the order it came in."""
    size, count = model.matrix_size, len(view.numbers)
    if model.rotation is not None:
        answers = recall(model.rotation, view.numbers, view.touching)
        for node in answers.ranking():
            whole = answers.match[node] == answers.match_ratio[node] == 1.0
            if whole and model.node_labels[node] == view.label:
                slots = [int(s) for s in answers.numbering[node]]
                free = iter(s for s in range(count, size))
                back = {slot: facet for facet, slot in enumerate(slots)}
                return [back[s] if s in back else next(free) for s in range(size)]
    return list(range(size))


def _copied(model: Model) -> FuzzyARTMAP:
    p = model.parameters
    fresh = FuzzyARTMAP(p.rho, p.alpha, p.beta, complement=p.complement)
    return fresh if model.artmap is None else fresh.restore(model.artmap.state(), model.artmap.classes)
