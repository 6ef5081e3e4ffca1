"""More named parts beside what was found: what lies where they are is theirs."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import cv2
import numpy as np

from daemon import frames
from daemon.vision.evidence.hole_rims import hole_nats
from daemon.vision.geometry import PlanarShape
from daemon.vision.hypotheses import COVERED
from daemon.vision.image import CameraImage, StereoImages
from daemon.vision.model import Model
from daemon.vision.recognition import Recognised, merge_adjacent, recognise_group
from daemon.vision.settings import VisionSettings
from daemon.vision.values import Facet, FacetView, Group, Rejected

SCALE, STRONG, BESIDE_PX, LEFT_PX2 = 2, 20.0, 8, 400.0
"""How many px wide the pixels are of which strong edges are counted beside named parts; how many sigmas of its noise
their gradient has; how far beside a part's outline they are its own; and the area of which something may lie there: 20
px of an outline. Of 57 looks that ended with all of their parts named 46 have less; what is left of the others is the
rim of a table or a shadow, which costs a search."""


def without_overlaps(
    found: Sequence[Recognised], view: FacetView, more: Sequence[Recognised], model: Model, images: StereoImages
) -> tuple[tuple[Recognised, ...], FacetView]:
    """Merge newly named parts into the result; drop what overlaps a named part, and from the view the groups and
    refused outlines that it explains.

    What lies where a part was named by its edges is that part's, and so is a lone facet in front of any named part: one
    that two patterns make by chance is likelier than a part of which one facet shows.
    """
    named, unnamed = [r for r in found if r.named], [r for r in found if not r.named]
    taken = [covered(r, model, images) for r in named]
    new = [(r, covered(r, model, images)) for r in more]
    new = [(r, shape) for r, shape in new if not any(shape.covers(other) > COVERED for other in taken)]

    def theirs(facet: Facet, alone: bool) -> bool:
        shape = PlanarShape.of(facet.left_px)
        over = [*(own for _, own in new), *(taken if alone else ())]
        return any(shape.common(own) > COVERED * shape.area for own in over)

    rest = [r for one in unnamed for r in _left_over(one, theirs, model)]
    holes = partial(hole_nats, images=images, tolerance_mm=model.parameters.tolerance_mm)
    known = merge_adjacent((*named, *(r for r, _ in new), *rest), model, holes)
    kept = tuple(o for o in view.rejected if not any(_covers(r.group, o) for r, _ in new))
    return known, replace(view, groups=tuple(r.group for r in known), rejected=kept)


def all_accounted_for(found: Sequence[Recognised], view: FacetView, model: Model, images: StereoImages) -> bool:
    """Whether something was found and all of it has a name, and whatever else both cameras outline lies where that is;
    and where little but parts shows edges, so do all strong ones."""
    if not found or not all(one.named for one in found):
        return False
    taken = [covered(one, model, images) for one in found]
    rest = [PlanarShape.of(one.corners_px) for one in view.rejected if one.unexplained]
    if not all(any(shape.common(own) > COVERED * shape.area for own in taken) for shape in rest):
        return False
    return not images.uncluttered(VisionSettings()) or _strong_beside_px2(taken, images.left) < LEFT_PX2


def _strong_beside_px2(taken: Sequence[PlanarShape], view: CameraImage) -> float:
    """Area, px², of strong edges of the left picture that lie on none of these shapes and do not lead out of it, as the
    rim of a table does; 0 where all together have less than LEFT_PX2."""
    scale = view.scale(SCALE)
    strong = (scale.strength > STRONG * scale.sigma).astype(np.uint8)
    for shape in taken:
        ring = [np.rint(shape.corners / SCALE).astype(np.int32)]
        cv2.fillPoly(strong, ring, 0)
        cv2.polylines(strong, ring, True, 0, 2 * BESIDE_PX // SCALE + 1)
    if SCALE**2 * cv2.countNonZero(strong) < LEFT_PX2:
        return 0.0
    _, _, boxes, _ = cv2.connectedComponentsWithStats(strong, connectivity=8)
    left, top, width, height, area = boxes[1:].T
    inside = (left > 0) & (top > 0) & (left + width < strong.shape[1]) & (top + height < strong.shape[0])
    return float(SCALE**2 * area[inside].sum())


def covered(one: Recognised, model: Model, images: StereoImages) -> PlanarShape:
    """Return the shape that a named part covers in the left camera."""
    corners = frames.apply(one.part.cyclopean_from_part, model.metric[one.label].solid.corners_mm)
    return PlanarShape.hull(images.left.rectified.camera.project(corners))


def _covers(group: Group, outline: Rejected) -> bool:
    shape = PlanarShape.of(outline.corners_px)
    return any(
        shape.covers(PlanarShape.of(f.right_px if outline.camera == "right" else f.left_px)) > COVERED
        for f in group.facets
    )


def _left_over(unnamed: Recognised, theirs: Callable[[Facet, bool], bool], model: Model) -> list[Recognised]:
    """Return what remains of an unnamed group: all of it, or its facets that are nobody else's, each alone."""
    alone = len(unnamed.group.facets) == 1
    own = [k for k, facet in enumerate(unnamed.group.facets) if not theirs(facet, alone)]
    if len(own) == len(unnamed.group.facets):
        return [unnamed]
    return [recognise_group(unnamed.group.only([k]), model) for k in own]
