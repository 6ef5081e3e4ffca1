"""Top-down: what a taught part would show beside the facets already found, looked for where it should be.

A lone facet is no proof. The parts it could belong to say where their other facets must lie; where both images show
every side of one there, it joins the group, measured like any other facet. Naming stays recognise.py's business.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daemon import frames
from daemon.vision.align import Aligned, Placement, align, showing
from daemon.vision.candidates import corner_covariance
from daemon.vision.data import Facet, FacetView, Group, Rejected
from daemon.vision.epipolar import Baseline, Eye, baseline
from daemon.vision.eye import Sight
from daemon.vision.image import Grey, as_grey, measure_noise
from daemon.vision.measure import newell_normal
from daemon.vision.model import Model
from daemon.vision.oneeye import Suspicion, suspicions_in
from daemon.vision.planes import planarity
from daemon.vision.recognise import UNKNOWN, recognise_group, suspicions
from daemon.vision.relation import Solid, touching_from, weld
from daemon.vision.rig import StereoRig
from daemon.vision.shapes import Shape

Array = NDArray[np.float64]
LEAST_FACING = 0.08  # cosine below which a facet is too thin in the image to be looked for
ROOM_PX = 12
COVERED = 0.2  # of the smaller facet's area; more than that, and the two cannot both be there
CLOSE_MM = 1.5  # rms; how well a completed part must fit
OUTLINES = 6  # single outlines followed up, the largest first
MOST = 8  # poses tried for one facet


@dataclass(frozen=True, eq=False)
class Eyes:
    """Both images made ready for looking closer: rig geometry and each eye's grey levels and noise."""

    geometry: Baseline
    left: Sight
    right: Sight
    size: tuple[int, int]


def open_eyes(left: NDArray[Any], right: NDArray[Any], rig: StereoRig) -> Eyes:
    """Prepare a stereo pair, (H, W) uint8 or what as_grey takes. Raises VisionError."""
    geometry = baseline(rig)
    return Eyes(
        geometry,
        _sight(geometry.left, as_grey(left, "left image")),
        _sight(geometry.right, as_grey(right, "right image")),
        rig.image_size,
    )


def look_closer(view: FacetView, model: Model, eyes: Eyes) -> FacetView:
    """The view with unnamed groups completed to parts where both images show the rest; as it was where they do not.

    Each facet of such a group is taken on its own, the largest first: others may be shadows, or measured wrongly.
    """
    groups = list(view.groups)
    for group in view.groups:
        if not any(g is group for g in groups) or recognise_group(group, model).recognition.label != UNKNOWN:
            continue
        others = [g for g in groups if g is not group]
        for facet in sorted(group.facets, key=lambda f: -Shape.of(f.left_px).area):
            whole = _completed(facet, others, model, eyes)
            if whole is not None:
                rest = [_alone(f) for f in group.facets]
                groups = [g for g in (*others, *rest) if not _absorbs(whole, g)] + [whole]
                break
    return _with_one_eyed(replace(view, groups=tuple(groups)), model, eyes)


def _with_one_eyed(view: FacetView, model: Model, eyes: Eyes) -> FacetView:
    """The view with parts of which only single outlines in single eyes were found, the largest outlines first."""
    groups, rejected = list(view.groups), list(view.rejected)
    for outline in sorted(rejected, key=lambda r: -Shape.of(r.corners_px).area)[:OUTLINES]:
        if any(_lies_on(outline, g) for g in groups if len(g.facets) > 1):
            continue
        suspected = suspicions_in(outline.corners_px, outline.eye, eyes.geometry, model)
        whole = _proved(expected_groups(suspected, model, eyes), groups, model)
        if whole is not None:
            groups = [g for g in groups if not _absorbs(whole, g)] + [whole]
            rejected.remove(outline)
    return replace(view, groups=tuple(groups), rejected=tuple(rejected))


def _lies_on(outline: Rejected, group: Group) -> bool:
    shape = Shape.of(outline.corners_px)
    return any(
        shape.covers(Shape.of(f.right_px if outline.eye == "right" else f.left_px)) > COVERED for f in group.facets
    )


def _alone(facet: Facet) -> Group:
    return Group((facet,), np.zeros((1, 1), bool))


def _completed(facet: Facet, others: Sequence[Group], model: Model, eyes: Eyes) -> Group | None:
    """A facet with those missing beside it, where that gives it a name."""
    suspected = [Suspicion(h.label, h.pose, h.rms_mm) for h in suspicions(facet, model)]
    return _proved(expected_groups(suspected, model, eyes), others, model)


def _proved(candidates: Sequence[Group], others: Sequence[Group], model: Model) -> Group | None:
    """The first of these groups that has a name, if no other of them has another name and nothing else lies there."""
    named: dict[str, Group] = {}
    for more in candidates:
        part = recognise_group(more, model)
        free = not any(_collides(more, other) for other in others if not _absorbs(more, other))
        if part.recognition.label != UNKNOWN and part.residual_mm < CLOSE_MM and free:
            named.setdefault(part.recognition.label, more)
    return next(iter(named.values())) if len(named) == 1 else None


def _absorbs(whole: Group, other: Group) -> bool:
    """Whether the other group is a lone facet that is one of these, measured worse, or lies where these are."""
    return len(other.facets) == 1 and _collides(whole, other)


def _collides(one: Group, other: Group) -> bool:
    """Whether two groups cover each other in an image."""
    pairs = [(Shape.of(f.left_px), Shape.of(g.left_px)) for f in one.facets for g in other.facets]
    return any(a.covers(b) > COVERED for a, b in pairs)


def expected_groups(suspected: Sequence[Suspicion], model: Model, eyes: Eyes) -> list[Group]:
    """For each part and pose that a facet may belong to, the facets that the images confirm there, two or more."""
    both = (eyes.left, eyes.right)
    laid = [align(p, eyes.geometry, both) for p in showing(_placements(suspected, model, eyes), eyes.geometry, both)]
    return [_group(a, eyes.geometry) for a in laid if len(a.facets) > 1]


def _placements(suspected: Sequence[Suspicion], model: Model, eyes: Eyes) -> list[Placement]:
    """Where to try: two facets in view at least, and of poses that would look the same only one."""
    found, known = list[Placement](), list[Array]()
    for suspicion in suspected:
        solid = model.metric[suspicion.label].solid
        visible = _visible(solid, suspicion.pose, eyes)
        corners = frames.apply(suspicion.pose, solid.corners_mm)[sorted({k for f in visible for k in solid.facets[f]})]
        if len(visible) > 1 and not any(_same_place(corners, k) for k in known):
            known.append(corners)
            found.append(Placement(solid, visible, suspicion.pose))
        if len(found) == MOST:
            break
    return found


def _visible(solid: Solid, pose: Array, eyes: Eyes) -> tuple[int, ...]:
    """The taught facets that face the cameras and lie inside both images."""
    corners = frames.apply(pose, solid.corners_mm)
    found = []
    for index, ring in enumerate(solid.facets):
        points = corners[list(ring)]
        middle = points.mean(0)
        facing = -float(newell_normal(points) @ middle) / float(np.linalg.norm(middle))
        if facing > LEAST_FACING and _inside(points, eyes):
            found.append(index)
    return tuple(found)


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
        covariance = corner_covariance(geometry, *ideal, _round(left_doubt), _round(right_doubt))
        corners = geometry.points(*ideal)
        off = np.abs(ideal[0][:, 1] - ideal[1][:, 1]) * geometry.left.focal_px
        facets.append(Facet(corners, covariance, left, right, off, planarity(corners)))
    return Group(tuple(facets), touching_from(weld(tuple(facets))))


def _round(doubt_px: Array) -> Array:
    """(N,) px the same every way -> (N, 2, 2) px^2."""
    return np.asarray(doubt_px[:, None, None] ** 2 * np.eye(2))


def _sight(eye: Eye, image: Grey) -> Sight:
    return Sight(eye, image.astype(np.float32), measure_noise(image), (), [])
