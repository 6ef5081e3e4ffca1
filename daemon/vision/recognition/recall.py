"""What the memory recalls of a group of facets: taught views, numbered so that they fit, and from those every way in
which the facets may be a taught part.

Recall proposes: only what a node answers for is measured. A view of which no node knows all is asked for by its pairs
of facets, as where one taught view showed some of it and another the rest. In: facets with the types they may have, a
Model. Out: recalled ways, the best first. How well one fits is fits.py's business.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from daemon.art import RelationalView
from daemon.vision.geometry import Polyhedron
from daemon.vision.model import Correspondence, Model, correspondences, relational_view, spread_from, symmetries

MOST_RECALLED = 96
"""Nodes under a numbering that are followed, of each question."""


@dataclass(frozen=True, eq=False)
class Recalled:
    """A taught view that the memory answers with: node, the label it stands for, match (1: all agrees within errors),
    activation, ratio of the facets it explains to those of the view or the node, whichever has more; way: which facet
    and corner of the part lies behind each seen one."""

    label: str
    node: int
    match: float
    activation: float
    ratio: float
    way: Correspondence


def recalled(seen: Polyhedron, types: Sequence[Sequence[str]], model: Model, vigilance: float) -> tuple[Recalled, ...]:
    """Every way in which facets that hang together may be a taught part, as far as a node's match reaches the
    vigilance, one of those that a turn of the part takes onto each other; those that explain most facets first, then
    the best match. types: those each facet may have. Nothing for a lone facet, which has no relations."""
    if len(seen.facets) < 2 or not seen.seams:
        return ()
    view = relational_view(seen, types, model.library, model.parameters.tolerance_mm)
    found = _ways(seen, view, range(len(seen.facets)), model, vigilance)
    if not found and len(seen.facets) > 2:
        pairs = (_ways(seen, view.only(seam), seam, model, vigilance) for seam in seen.seams)
        found = {key: way for one in pairs for key, way in one.items()}
    most = max((one.way.explained for one in found.values()), default=0)
    best = (one for one in found.values() if one.way.explained == most)
    return tuple(sorted(best, key=lambda one: (-one.match, -one.activation)))


def _ways(
    seen: Polyhedron, view: RelationalView, members: Sequence[int], model: Model, vigilance: float
) -> dict[tuple[str, tuple[int, ...]], Recalled]:
    """What is recalled of some facets (a view of them alone), each way once."""
    answer = model.artmap.recall(view, vigilance, MOST_RECALLED)
    if not len(answer.node):
        return {}
    labels, facets = model.artmap.node_labels, model.facet_in_slot
    found, every = dict[tuple[str, tuple[int, ...]], Recalled](), set[str]()
    for node, slots, match, activation, ratio in zip(*answer, strict=True):
        label, own = labels[node], facets[node, slots].tolist()
        if -1 in own or label not in model.metric:
            continue
        solid = model.metric[label].solid
        if solid.holes:  # the memory knows facets and no holes: which of the places alike it is, these tell
            ways = () if label in every else correspondences(seen, solid)
            every.add(label)
        else:
            ways = _laid(seen, solid, dict(zip(members, own, strict=True)))
        for way in ways:
            key = label, _of_equals(way, solid)
            if key not in found:
                share = float(ratio) * way.explained / len(members)
                found[key] = Recalled(label, int(node), float(match), float(activation), min(share, 1.0), way)
    return found


def _laid(seen: Polyhedron, solid: Polyhedron, onto: dict[int, int]) -> tuple[Correspondence, ...]:
    """Seen facets laid edge to edge onto a solid, from the first two on that are said to lie on facets of it: the rest
    follows from these. Relations in pairs do not tell which way round facets meet, as at corners of a box."""
    first, second = next((f, g) for f, g in seen.seams if f in onto and g in onto)
    if max(onto.values()) >= len(solid.facets):
        return ()
    edges = [place for (f, place), (g, _) in seen.across.items() if (f, g) == (first, second)]
    there = [place for (f, place), (g, _) in solid.across.items() if (f, g) == (onto[first], onto[second])]
    sides = len(seen.facets[first])
    if len(solid.facets[onto[first]]) != sides:
        return ()
    places = [(first, (onto[first], (place - edges[0]) % sides)) for place in there]
    return spread_from(seen, solid, places)


def _of_equals(way: Correspondence, solid: Polyhedron) -> tuple[int, ...]:
    """The corners of the way, of all that a turn of the solid takes onto it the first."""
    turned = symmetries(solid).corners[:, way.corners]
    turned[:, way.corners < 0] = -1
    return tuple(min(turned.tolist()))
