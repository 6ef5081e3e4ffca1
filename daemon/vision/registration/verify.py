"""Top-down: what a taught part would show beside the facets already found, looked for where it should be.

A lone facet is no proof. The parts it could belong to say where their other facets must lie; where both images show
every side of one there, it joins the group, measured like any other facet. Naming stays recognise.py's business.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from daemon import frames
from daemon.vision.facets.candidates import corner_covariance
from daemon.vision.facets.weld import weld
from daemon.vision.geometry.planes import planarity
from daemon.vision.geometry.polygon import Shape
from daemon.vision.geometry.rectified import Baseline, Eye, baseline
from daemon.vision.geometry.rig import StereoRig
from daemon.vision.image.grey import Grey, as_grey
from daemon.vision.image.one_eye import OneEye
from daemon.vision.model.model import Model
from daemon.vision.recognition.recognise import UNKNOWN, recognise_group, suspicions
from daemon.vision.registration.chamfer import EdgeMap, edge_map, facing, trial_costs
from daemon.vision.registration.edge_alignment import Aligned, Placement, align
from daemon.vision.registration.pose_guesses import Suspicion, suspicions_at, suspicions_in
from daemon.vision.values import Facet, FacetView, Group, Rejected

Array = NDArray[np.float64]
ROOM_PX = 12
COVERED = 0.2  # of the smaller facet's area; more than that, and the two cannot both be there
CLOSE_MM = 2.5  # rms; how well a completed part must fit
OUTLINES = 6  # single outlines followed up, the largest first
LEAST_SHARE = 0.7  # of the edges a part should show, what both images must show on its place
MOST_OFF_PX = 3.0  # mean distance of a suspected part's edges from edges in the images
EDGE_SIGMAS = 4.0
MOST = 12  # poses laid onto the images


@dataclass(frozen=True, eq=False)
class Eyes:
    """Both images made ready for looking closer: rig geometry, each eye's grey levels and
    noise, and how far its pixels are from edges."""

    geometry: Baseline
    left: OneEye
    right: OneEye
    edges: tuple[EdgeMap, EdgeMap]
    size: tuple[int, int]


def open_eyes(left: NDArray[Any], right: NDArray[Any], rig: StereoRig) -> Eyes:
    """Prepare a stereo pair, (H, W) uint8 or what as_grey takes. Raises VisionError."""
    geometry = baseline(rig)
    one, one_edges = _sight(geometry.left, as_grey(left, "left image"))
    other, other_edges = _sight(geometry.right, as_grey(right, "right image"))
    return Eyes(geometry, one, other, (one_edges, other_edges), rig.image_size)


def look_closer(view: FacetView, model: Model, eyes: Eyes) -> FacetView:
    """The view with unnamed facets completed to parts where both images show the rest; as it was where they do not.

    Every facet of an unnamed group and every outline of one eye says which parts could be there, and where; should
    none of those be seen, any three corners of theirs do.
    """
    unnamed = [g for g in view.groups if recognise_group(g, model).recognition.label == UNKNOWN]
    named = [g for g in view.groups if not any(g is u for u in unnamed)]
    facets = [f for g in unnamed for f in g.facets]
    single = [o for o in _largest(view.rejected) if not any(_lies_on(o, g) for g in named)]
    outlines = [(o.corners_px, o.eye) for o in single[:OUTLINES]]
    outlines += [(f.left_px, "left") for f in facets] + [(f.right_px, "right") for f in facets]
    suspected = [Suspicion(h.label, h.pose, h.rms_mm) for f in facets for h in suspicions(f, model)]
    suspected += [s for o in outlines for s in suspicions_in(*o, eyes.geometry, model)]
    found = _proved(expected_groups(suspected, model, eyes), named, model)
    if not found:
        suspected = suspicions_at(outlines, eyes.geometry, model)
        found = _proved(expected_groups(suspected, model, eyes), named, model)
    outlined = [_silhouette(g, model, eyes) for g in found]
    rest = [part for g in unnamed for part in _left_over(g, found, outlined)]
    kept = tuple(o for o in view.rejected if not any(_lies_on(o, g) for g in found))
    return replace(view, groups=(*named, *found, *rest), rejected=kept)


def _largest(outlines: Sequence[Rejected]) -> list[Rejected]:
    return sorted(outlines, key=lambda o: -Shape.of(o.corners_px).area)


def _lies_on(outline: Rejected, group: Group) -> bool:
    shape = Shape.of(outline.corners_px)
    return any(
        shape.covers(Shape.of(f.right_px if outline.eye == "right" else f.left_px)) > COVERED for f in group.facets
    )


def _proved(candidates: Sequence[Group], named: Sequence[Group], model: Model) -> list[Group]:
    """Those of the groups that have a name, where none of the others has another name and nothing named lies there."""
    parts = [(group, recognise_group(group, model)) for group in candidates]
    good = [
        (group, part.recognition.label)
        for group, part in parts
        if part.recognition.label != UNKNOWN and part.residual_mm < CLOSE_MM
    ]
    found: list[Group] = []
    for group, label in good:
        rivals = any(name != label and _collides(group, other) for other, name in good)
        if not rivals and not any(_collides(group, g) for g in (*named, *found)):
            found.append(group)
    return found


def _silhouette(group: Group, model: Model, eyes: Eyes) -> Shape:
    """What the part that a group was named after covers in the left eye."""
    part = recognise_group(group, model)
    corners = frames.apply(part.cyclopean_from_part, model.metric[part.recognition.label].solid.corners_mm)
    hull = cv2.convexHull(_pixels(corners, eyes.geometry)[0].astype(np.float32))
    return Shape.of(hull[:, 0].astype(float))


def _left_over(group: Group, found: Sequence[Group], outlined: Sequence[Shape]) -> list[Group]:
    """What remains of an unnamed group: all of it, or its facets that lie on none of the parts found, each alone."""
    shapes = [Shape.of(f.left_px) for f in group.facets]
    on = [any(shape.common(s) > COVERED * shape.area for s in outlined) for shape in shapes]
    on = [o or any(_collides(whole, weld([f])) for whole in found) for o, f in zip(on, group.facets, strict=True)]
    return [weld([f]) for o, f in zip(on, group.facets, strict=True) if not o] if any(on) else [group]


def _collides(one: Group, other: Group) -> bool:
    """Whether two groups cover each other in an image."""
    pairs = [(Shape.of(f.left_px), Shape.of(g.left_px)) for f in one.facets for g in other.facets]
    return any(a.covers(b) > COVERED for a, b in pairs)


def expected_groups(suspected: Sequence[Suspicion], model: Model, eyes: Eyes) -> list[Group]:
    """For the likeliest of the parts and poses that are suspected, the facets that the images confirm there, two or
    more.
    """
    laid = [align(p, eyes.geometry, (eyes.left, eyes.right)) for p in _placements(suspected, model, eyes)]
    return [_group(a, eyes.geometry) for a in laid if len(a.facets) > 1 and a.share > LEAST_SHARE]


def _placements(suspected: Sequence[Suspicion], model: Model, eyes: Eyes) -> list[Placement]:
    """Where to try: two facets in view at least, edges near, and of poses that would look the same only one."""
    ranked = list[tuple[float, Placement]]()
    for label, metric in model.metric.items():
        poses = np.array([s.pose for s in suspected if s.label == label]).reshape(-1, 4, 4)
        if not len(poses):
            continue
        costs = trial_costs(metric.solid, poses, eyes.geometry, eyes.edges)
        shown = facing(metric.solid, poses)
        for k in np.flatnonzero((costs < MOST_OFF_PX) & (shown.sum(1) > 1)):
            place = Placement(metric.solid, tuple(np.flatnonzero(shown[k]).tolist()), poses[k])
            ranked.append((float(costs[k]), place))
    found, known = list[Placement](), list[Array]()
    for _, place in sorted(ranked, key=lambda r: r[0]):
        corners = frames.apply(place.pose, place.solid.corners_mm)
        corners = corners[sorted({k for f in place.visible for k in place.solid.facets[f]})]
        if not any(_same_place(corners, k) for k in known) and _inside(corners, eyes):
            known.append(corners)
            found.append(place)
        if len(found) == MOST:
            break
    return found


def _inside(points: Array, eyes: Eyes) -> bool:
    for px in _pixels(points, eyes.geometry):
        if px.min() < ROOM_PX or (px > np.array(eyes.size) - 1 - ROOM_PX).any():
            return False
    return True


def _pixels(points: Array, geometry: Baseline) -> tuple[Array, Array]:
    left, right = geometry.project(points)
    return geometry.left.pixels(left), geometry.right.pixels(right)


def _same_place(one: Array, other: Array) -> bool:
    """Whether two facets are expected at the same place: corner for corner within 2 mm."""
    if one.shape != other.shape:
        return False
    return bool(np.linalg.norm(one[:, None] - other[None], axis=2).min(1).max() < 2.0)


def _group(laid: Aligned, geometry: Baseline) -> Group:
    """The confirmed facets, triangulated from where the images show their sides to meet."""
    facets = []
    for left, left_doubt, right, right_doubt in laid.outlines:
        ideal = geometry.left.ideal(left), geometry.right.ideal(right)
        covariance = corner_covariance(geometry, *ideal, left_doubt, right_doubt)
        corners = geometry.points(*ideal)
        off = np.abs(ideal[0][:, 1] - ideal[1][:, 1]) * geometry.left.focal_px
        facets.append(Facet(corners, covariance, left, right, off, planarity(corners)))
    return weld(facets)


def _sight(eye: Eye, image: Grey) -> tuple[OneEye, EdgeMap]:
    view = OneEye(eye, image)
    return view, edge_map(view.scale(2), EDGE_SIGMAS)
