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

from daemon.vision.candidates import Candidate, triangulate
from daemon.vision.data import Facet, FacetView, Group
from daemon.vision.epipolar import Baseline, Eye, baseline
from daemon.vision.eye import Sight
from daemon.vision.grouping import touching_table
from daemon.vision.hypotheses import Hypothesis
from daemon.vision.image import Grey, as_grey, measure_noise
from daemon.vision.joining import join
from daemon.vision.measure import newell_normal
from daemon.vision.model import Model
from daemon.vision.outlines import Outline, snap
from daemon.vision.polygons import Fitted, fit_polygons
from daemon.vision.recognise import UNKNOWN, recognise_group, suspicions
from daemon.vision.regions import SMOOTHING_PX, Scale
from daemon.vision.rig import StereoRig
from daemon.vision.rings import rings
from daemon.vision.settings import VisionSettings
from daemon.vision.shapes import Shape

Array = NDArray[np.float64]
LEAST_FACING = 0.08  # cosine below which a facet is too thin in the image to be looked for
REACH_PX = (2.5, 2.5)
STRAY_PX = 5.0  # how far from where it was expected a corner may be found
LEAST_SUPPORT = 0.6
ROOM_PX = 12
COVERED = 0.2  # of the smaller facet's area; more than that, and the two cannot both be there
MOST = 16  # expected facets looked for at once


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


def look_closer(view: FacetView, model: Model, eyes: Eyes, settings: VisionSettings) -> FacetView:
    """The view with unnamed groups completed to parts where both images show the rest; as it was where they do not.

    Each facet of such a group is taken on its own, the largest first: others may be shadows, or measured wrongly.
    """
    groups = list(view.groups)
    for group in view.groups:
        if not any(g is group for g in groups) or recognise_group(group, model).recognition.label != UNKNOWN:
            continue
        others = [g for g in groups if g is not group]
        for facet in sorted(group.facets, key=lambda f: -Shape.of(f.left_px).area):
            whole = _completed(_alone(facet), others, model, eyes, settings)
            if whole is not None:
                rest = [_alone(f) for f in group.facets]
                groups = [g for g in (*others, *rest) if not _absorbs(whole, g)] + [whole]
                break
    return replace(view, groups=tuple(groups))


def _alone(facet: Facet) -> Group:
    return Group((facet,), np.zeros((1, 1), bool))


def _completed(
    group: Group, others: Sequence[Group], model: Model, eyes: Eyes, settings: VisionSettings
) -> Group | None:
    """A lone facet's group with its missing facets, where that gives it a name, no other name is as possible, and

    nothing else lies there.
    """
    named: dict[str, Group] = {}
    for more in expected_groups(group, suspicions(group, model), model, eyes, settings):
        label = recognise_group(more, model).recognition.label
        if label != UNKNOWN and not any(_collides(more, other) for other in others if not _absorbs(more, other)):
            named.setdefault(label, more)
    return next(iter(named.values())) if len(named) == 1 else None


def _absorbs(whole: Group, other: Group) -> bool:
    """Whether the other group is a lone facet that is one of these, measured worse, or lies where these are."""
    return len(other.facets) == 1 and _collides(whole, other)


def _collides(one: Group, other: Group) -> bool:
    """Whether two groups cover each other in an image."""
    pairs = [(Shape.of(f.left_px), Shape.of(g.left_px)) for f in one.facets for g in other.facets]
    return any(a.covers(b) > COVERED for a, b in pairs)


def expected_groups(
    group: Group, suspected: Sequence[Hypothesis], model: Model, eyes: Eyes, settings: VisionSettings
) -> list[Group]:
    """The group with the facets that each suspicion expects and the images show; nothing where they show none.

    suspected: what the group may be, each with its pose. Most facets first.
    """
    wanted = [(s, ring) for s in suspected for ring in _expected(s, model, eyes)]
    distinct = _distinct(wanted)
    if not distinct:
        return []
    old = [f.corners_mm for f in group.facets]
    found = _look_for([*old, *distinct], eyes, settings)
    seen = [c for c in found[: len(old)] if c is not None]
    if len(seen) < len(old):
        return []
    confirmed = [(shape, c) for shape, c in zip(distinct, found[len(old) :], strict=True) if c is not None]
    sets: dict[tuple[int, ...], None] = {}
    for suspicion in suspected:
        own = [r for s, r in wanted if s is suspicion]
        more = tuple(k for k, (shape, _) in enumerate(confirmed) if any(_same_place(shape, r) for r in own))
        if more:
            sets[more] = None
    return [_joined(seen + [confirmed[k][1] for k in more], eyes.geometry) for more in sorted(sets, key=len)[::-1]]


def _expected(suspicion: Hypothesis, model: Model, eyes: Eyes) -> list[Array]:
    """Corners (N, 3) mm of the taught facets not yet found that face the cameras and lie inside both images."""
    solid = model.metric[suspicion.label].solid
    turn, shift = suspicion.pose[:3, :3], suspicion.pose[:3, 3]
    corners = solid.corners_mm @ turn.T + shift
    found = []
    for index, ring in enumerate(solid.facets):
        points = corners[list(ring)]
        middle = points.mean(0)
        facing = -float(newell_normal(points) @ middle) / float(np.linalg.norm(middle))
        if index not in suspicion.facets and facing > LEAST_FACING and _inside(points, eyes):
            found.append(points)
    return found


def _inside(points: Array, eyes: Eyes) -> bool:
    for px in _pixels(points, eyes.geometry):
        if px.min() < ROOM_PX or (px > np.array(eyes.size) - 1 - ROOM_PX).any():
            return False
    return True


def _pixels(points: Array, geometry: Baseline) -> tuple[Array, Array]:
    left, right = geometry.project(points)
    return geometry.left.pixels(left), geometry.right.pixels(right)


def _distinct(wanted: list[tuple[Hypothesis, Array]]) -> list[Array]:
    kept: list[Array] = []
    for _, ring in wanted:
        if len(kept) < MOST and not any(_same_place(ring, other) for other in kept):
            kept.append(ring)
    return kept


def _same_place(one: Array, other: Array) -> bool:
    """Whether two facets are expected at the same place: corner for corner within 2 mm."""
    if one.shape != other.shape:
        return False
    return bool(np.linalg.norm(one[:, None] - other[None], axis=2).min(1).max() < 2.0)


def _look_for(shapes: list[Array], eyes: Eyes, settings: VisionSettings) -> list[Candidate | None]:
    """Each facet as both images show it near where it should be, or None.

    Sides are fitted from where they are expected; where that leads astray, again from the strongest gradient nearby.
    """
    places = [_pixels(shape, eyes.geometry) for shape in shapes]
    starts = ([p[0] for p in places], [p[1] for p in places])
    sights = (eyes.left, eyes.right)
    direct = [_fitted(sight, start) for sight, start in zip(sights, starts, strict=True)]
    found = [_candidate(p, a, b, eyes.geometry, settings) for p, a, b in zip(places, *direct, strict=True)]
    missing = [k for k, c in enumerate(found) if c is None]
    if missing:
        snapped = [
            _fitted(sight, _snapped(sight, [start[k] for k in missing]))
            for sight, start in zip(sights, starts, strict=True)
        ]
        for n, k in enumerate(missing):
            pairs = ((snapped[0][n], direct[1][k]), (direct[0][k], snapped[1][n]), (snapped[0][n], snapped[1][n]))
            again = [_candidate(places[k], a, b, eyes.geometry, settings) for a, b in pairs]
            found[k] = max((c for c in again if c), key=_weakest, default=None)
    return found


def _weakest(candidate: Candidate) -> float:
    return float(min(candidate.left.sides.evidence.min(), candidate.right.sides.evidence.min()))


def _fitted(sight: Sight, places: list[Array]) -> list[Fitted | None]:
    outlines = [
        Outline(corners, np.rint(corners).astype(np.int32), np.zeros(len(corners)), np.ones(len(corners)), 1.0)
        for corners in places
    ]
    return fit_polygons(sight, outlines)


def _snapped(sight: Sight, places: list[Array]) -> list[Array]:
    """The outlines with their sides on the strongest gradient within a few pixels."""
    every = np.concatenate(places)
    low = np.maximum(np.floor(every.min(0)).astype(int) - ROOM_PX, 0)
    high = np.ceil(every.max(0)).astype(int) + ROOM_PX
    window = np.rint(sight.image[low[1] : high[1], low[0] : high[0]]).astype(np.uint8)
    smoothed = np.asarray(cv2.GaussianBlur(cv2.LUT(window, sight.noise.stretch), (7, 7), SMOOTHING_PX), np.float32)
    fine = Scale(1, low.astype(float), smoothed, np.zeros((0, 0), np.float32))
    return snap(fine, rings(places), REACH_PX, np.zeros(len(every))).split()


def _candidate(
    place: tuple[Array, Array], left: Fitted | None, right: Fitted | None, geometry: Baseline, settings: VisionSettings
) -> Candidate | None:
    """The facet, where every side shows in both eyes, near where it was expected, on its epipolar lines."""
    for fit, expected in ((left, place[0]), (right, place[1])):
        if fit is None or fit.sides.evidence.min() < settings.min_evidence or fit.sides.support.min() < LEAST_SUPPORT:
            return None
        if np.abs(fit.polygon.corners_px - expected).max() > STRAY_PX:
            return None
    if left is None or right is None:
        return None
    facet = triangulate(left.polygon, right.polygon, geometry)
    if facet.epipolar_px.max() > settings.max_epipolar_px:
        return None
    return Candidate(facet, left, right, 1.0, Shape.of(facet.left_px), Shape.of(facet.right_px))


def _joined(members: list[Candidate], geometry: Baseline) -> Group:
    facets: list[Facet] = join(members, geometry)[0]
    return Group(tuple(facets), touching_table(tuple(facets)))


def _sight(eye: Eye, image: Grey) -> Sight:
    return Sight(eye, image.astype(np.float32), measure_noise(image), (), [])
