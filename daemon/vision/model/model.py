"""What was taught: facet library, views, the memory (Fuzzy ARTMAP nodes), one metric model a part; learning it.

Values in, values out: every change gives a new Model; the same views in the same order give the same one. Files are
daemon/store/model.py's business, recognising is daemon/vision/recognition's.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from daemon.arrays import Index
from daemon.art import RelationalView, RelationARTMAP
from daemon.errors import FacetdError
from daemon.vision.facets import connected
from daemon.vision.geometry import Polyhedron
from daemon.vision.model.aspect_sets import aspects
from daemon.vision.model.facet_types import FacetLibrary
from daemon.vision.model.merge import MetricModel, corresponding_facets, in_part_frame, merge_views
from daemon.vision.model.relations import FEATURES, MATRIX_SIZE, relational_view, types_of
from daemon.vision.settings import MemorySettings
from daemon.vision.values import Group


class TeachError(FacetdError, ValueError):
    """A view cannot be learnt, or a label not be forgotten: the message says why."""


@dataclass(frozen=True, eq=False)
class TaughtView:
    """One taught view. sides (n,): the part's facet, in its metric model, that each facet of the view is, or -1 where
    the view could not be joined; node: the one that stands for it, slots (n,): of each facet there; source: where it
    came from, for people; solid: as it was measured, cyclopean frame of its look, mm; None where the part was drawn.
    """

    label: str
    sides: tuple[int, ...]
    node: int
    slots: tuple[int, ...]
    source: str = ""
    solid: Polyhedron | None = None


@dataclass(frozen=True, eq=False)
class Model:
    """views in the order taught; artmap: the memory, never changed in place; metric: {label: merged model}."""

    library: FacetLibrary
    parameters: MemorySettings = field(default_factory=MemorySettings)
    views: tuple[TaughtView, ...] = ()
    artmap: RelationARTMAP = field(default_factory=lambda: _no_memory(MemorySettings()))
    metric: dict[str, MetricModel] = field(default_factory=dict)

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """Every taught label, in the order first taught."""
        return tuple(dict.fromkeys(v.label for v in self.views))

    @cached_property
    def facet_in_slot(self) -> Index:
        """(J, m) the part's facet in each slot of each node, as the first view behind it that could be joined has it;
        -1: none."""
        facets = np.full((len(self.artmap.lower), self.artmap.slots), -1, np.intp)
        for view in reversed(self.views):
            if -1 not in view.sides:
                facets[view.node, list(view.slots)] = view.sides
        return facets

    def view_behind(self, node: int) -> str:
        """The first view that a node learnt, by its source or else its number among the views."""
        number, view = next((k, view) for k, view in enumerate(self.views, 1) if view.node == node)
        return view.source or f"view {number}"

    def solid_of(self, view: TaughtView) -> Polyhedron:
        """Return the solid that a view showed: as measured, or as drawn."""
        return self.metric[view.label].solid.only(view.sides) if view.solid is None else view.solid


def empty_model(library: FacetLibrary, parameters: MemorySettings | None = None) -> Model:
    """A model that has been taught nothing."""
    settings = parameters or MemorySettings()
    return Model(library, settings, artmap=_no_memory(settings))


def learn_view(model: Model, group: Group, label: str, source: str = "") -> Model:
    """The model with one more view of a part, its pattern and its shape. What it knew stays as it was.

    group: the facets of the one part in view, typed or not. A part that was drawn keeps the drawing's shape. Raises
    TeachError for a view of fewer than two facets (it could not be told from other parts), for facets that do not share
    an edge, and for the label `unknown`.
    """
    solid = group.polyhedron
    if not label or label == "unknown":
        raise TeachError(f"a part cannot be called {label!r}: choose another name")
    if len(solid.facets) < 2:
        raise TeachError(f"{label}: {len(solid.facets)} facet in view; show at least two that share an edge")
    if len(connected(solid.touching)) > 1:
        raise TeachError(f"{label}: the {len(solid.facets)} facets in view do not hang together; show the part alone")
    solid = replace(solid, types=tuple(names[0] for names in types_of(group.facets, model.library)))
    artmap, ended = model.artmap.learned([_relations(model, solid)], [label])
    view = TaughtView(label, (-1,) * len(solid.facets), ended[0][0], _tuple(ended[0][1]), source, solid)
    views = (*model.views, view)
    own = tuple(v for v in views if v.label == label)
    if any(v.solid is None for v in own):
        merged = model.metric[label]
    else:
        measured = tuple(v.solid for v in own if v.solid is not None)
        merged = merge_views(measured, model.library, model.parameters.tolerance_mm)
    return _joined(replace(model, views=views, artmap=artmap), label, merged)


def learn_solid(model: Model, solid: Polyhedron, label: str, source: str = "") -> Model:
    """The model with every characteristic view of a drawn solid; its shape is the drawing's, to the last corner.

    Raises TeachError for the label `unknown`, and where no two of its facets are ever in view together.
    """
    return learn_solids(model, [(label, solid, source)])


def learn_solids(model: Model, drawn: Sequence[tuple[str, Polyhedron, str]]) -> Model:
    """Learn many (label, solid, source), as `learn_solid` does one, which costs less than one after the other."""
    views, relations, known = list[TaughtView](), list[RelationalView](), model
    for label, solid, source in drawn:
        if not label or label == "unknown":
            raise TeachError(f"a part cannot be called {label!r}: choose another name")
        shape = MetricModel(in_part_frame(solid), (0,))
        shown = [one.facets for one in aspects(shape.solid)]
        if not shown and len(shape.solid.arcs) > 1:  # no facets that touch are a pattern: edges and rims tell it
            shown = [(facet,) for facet in range(len(shape.solid.facets))]
        if not shown:
            raise TeachError(
                f"{label}: no two of its {len(solid.facets)} facets that share an edge are in view together"
            )
        if label in known.metric:  # views of a shape that is given up keep their own
            views = [replace(v, solid=known.solid_of(v)) if v.label == label else v for v in views]
            before = (replace(v, solid=known.solid_of(v)) if v.label == label else v for v in known.views)
            known = replace(known, views=tuple(before))
        known = replace(known, metric={**known.metric, label: shape})
        views += [TaughtView(label, sides, -1, (), source) for sides in shown]
        whole = _relations(model, shape.solid)
        relations += [whole.only(sides) for sides in shown]
    artmap, ended = model.artmap.learned(relations, [view.label for view in views])
    placed = {
        (view.label, view.source, node): replace(view, node=node, slots=_tuple(slots))
        for view, (node, slots) in reversed(list(zip(views, ended, strict=True)))
    }  # a view that is like another of the drawing, turned, says nothing new
    known = replace(known, views=(*known.views, *reversed(placed.values())), artmap=artmap)
    for label in dict.fromkeys(label for label, *_ in drawn):
        known = _joined(known, label, known.metric[label])
    return known


def relearnt(model: Model) -> Model:
    """The model with the patterns of its views learnt anew, one after the other; their shapes stay."""
    relations = [_relations(model, model.solid_of(view)) for view in model.views]
    artmap, ended = _no_memory(model.parameters).learned(relations, [view.label for view in model.views])
    views = tuple(
        replace(v, node=node, slots=_tuple(slots)) for v, (node, slots) in zip(model.views, ended, strict=True)
    )
    known = replace(model, views=views, artmap=artmap)
    for label, merged in known.metric.items():
        known = _joined(known, label, merged)
    return known


def _relations(model: Model, solid: Polyhedron) -> RelationalView:
    """Return what the memory learns of a typed solid: its features as far as they are unsure; none where it is
    drawn."""
    return relational_view(solid, [(name,) for name in solid.types], model.library, 0.0)


def _joined(model: Model, label: str, merged: MetricModel) -> Model:
    """The model with a part's shape, each view of the part laid onto it."""
    views, own, joined = list(model.views), 0, list[int]()
    for k, view in enumerate(views):
        if view.label != label:
            continue
        if view.solid is not None:
            laid = corresponding_facets(view.solid, merged.solid, model.parameters.tolerance_mm)
            views[k] = view = replace(view, sides=laid or (-1,) * len(view.sides))
        if -1 not in view.sides:
            joined.append(own)
        own += 1
    metric = {**model.metric, label: replace(merged, joined=tuple(joined))}
    return replace(model, views=tuple(views), metric=metric)


def _tuple(slots: Index) -> tuple[int, ...]:
    return tuple(int(slot) for slot in slots)


def _no_memory(parameters: MemorySettings) -> RelationARTMAP:
    return RelationARTMAP.empty(FEATURES, MATRIX_SIZE, parameters.rho, parameters.alpha, parameters.beta)
