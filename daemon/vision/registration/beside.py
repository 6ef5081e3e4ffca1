"""More named parts beside what was found: what lies where they are is theirs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from daemon.vision.geometry import Shape
from daemon.vision.image import Eyes
from daemon.vision.model import Model
from daemon.vision.recognition import Recognised, joined, recognise_group
from daemon.vision.registration.measured import silhouette
from daemon.vision.values import FacetView, Group, Rejected

COVERED = 0.2  # of the smaller area; more than that, and the two cannot both be there


def beside(
    found: Sequence[Recognised], view: FacetView, more: Sequence[Recognised], model: Model, eyes: Eyes
) -> tuple[tuple[Recognised, ...], FacetView]:
    """What was found with more named parts, those left out that lie where one was named; and the view with the groups
    and refused outlines that are left."""
    if not more:
        return tuple(found), view
    named, unnamed = [r for r in found if r.named], [r for r in found if not r.named]
    taken = [covered(r, model, eyes) for r in named]
    new = [(r, covered(r, model, eyes)) for r in more]
    new = [(r, shape) for r, shape in new if not any(shape.covers(other) > COVERED for other in taken)]
    rest = [r for one in unnamed for r in _left_over(one, [shape for _, shape in new], model)]
    known = joined((*named, *(r for r, _ in new), *rest), model)
    kept = tuple(o for o in view.rejected if not any(_lies_on(o, r.group) for r, _ in new))
    return known, replace(view, groups=tuple(r.group for r in known), rejected=kept)


def covered(one: Recognised, model: Model, eyes: Eyes) -> Shape:
    """What a named part covers in the left eye."""
    return silhouette(model.metric[one.label].solid, one.part.cyclopean_from_part, eyes)


def _lies_on(outline: Rejected, group: Group) -> bool:
    shape = Shape.of(outline.corners_px)
    return any(
        shape.covers(Shape.of(f.right_px if outline.eye == "right" else f.left_px)) > COVERED for f in group.facets
    )


def _left_over(unnamed: Recognised, silhouettes: Sequence[Shape], model: Model) -> list[Recognised]:
    """What remains of an unnamed group: all of it, or its facets that lie on none of the parts, each alone."""
    shapes = [Shape.of(f.left_px) for f in unnamed.group.facets]
    off = [k for k, shape in enumerate(shapes) if not any(shape.common(s) > COVERED * shape.area for s in silhouettes)]
    if len(off) == len(shapes):
        return [unnamed]
    alone = [unnamed.group.only([k]) for k in off]
    return [Recognised(one, recognise_group(one, model)) for one in alone]
