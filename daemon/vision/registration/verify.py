"""What recognition left unnamed, looked for from what the taught parts would show, and proved on both images.

A lone facet is no proof. The parts it could belong to say where all their edges must lie. Where both images show every
side of two facets there, these are measured like any others, and recognition names the part; where faces shade alike
and only the outline shows, the whole of it must, and that of no other taught part.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from daemon import frames
from daemon.arrays import Array
from daemon.vision.facets import corner_covariance, weld
from daemon.vision.geometry import Baseline, Polyhedron, Shape, planarity
from daemon.vision.image import Eyes
from daemon.vision.model import Model
from daemon.vision.recognition import Recognised, facet_hypotheses, joined, recognise_group, typed_as
from daemon.vision.registration.chamfer import chamfer_px, edge_map, in_view
from daemon.vision.registration.different import Guesses, different, pixels
from daemon.vision.registration.edge_pose import (
    ConfirmedFacet,
    Located,
    confirmed_facets,
    facets_in_view,
    fit_of,
    locate,
    shown,
)
from daemon.vision.registration.measured import measured_facet, silhouette
from daemon.vision.registration.pose_guesses import PoseGuess, guesses_from_corners, guesses_from_outline
from daemon.vision.values import Facet, FacetView, Group, Part, Recognition, Rejected

Flags = NDArray[np.bool_]
COVERED = 0.2  # of the smaller facet's area; more than that, and the two cannot both be there
CLOSE_MM = 2.5  # rms; how well a completed part must fit
OUTLINES = 6  # single outlines followed up, the largest first
EDGE_SIGMAS, MOST_OFF_PX = 4.0, 3.0  # mean distance of a guessed part's edges from edges this clear in the images
MOST = 12  # poses laid onto the images
REACH_MM = 1.5  # how far off the pose that a facet or an outline says may be
LEAST_SHARE = 0.7  # of the edges a part should show, what both images must show on its place
BY_EDGES = 0.9  # confidence in a name that the outline proves: below what recognition is sure of
PROVED, DISPROVED = 0.9, 0.6  # shares of the outline: what a name needs, and what every other must stay below
UNFITTED = 0.8  # what the outline counts of a part whose edges do not hold its pose
OUTLINE_MM = 0.8  # how far off its place an edge of the outline may be
EXPLAINED_MM = 4.0  # rms; how far off the part that the outline proves a facet of it may have been measured


@dataclass(frozen=True, eq=False)
class Laid:
    """A taught part laid onto both images: guessed, where it was thought to be, cyclopean_from_part (4, 4); located:
    where its edges lie, None where they do not show.
    """

    label: str
    solid: Polyhedron
    guessed: Array
    located: Located | None


def beside(
    found: Sequence[Recognised], view: FacetView, more: Sequence[Recognised], model: Model, eyes: Eyes
) -> tuple[tuple[Recognised, ...], FacetView]:
    """What was found with more named parts, those left out that lie where one was named; and the view with the groups
    and refused outlines that are left."""
    named, unnamed = [r for r in found if r.named], [r for r in found if not r.named]
    taken = [_covered(r, model, eyes) for r in named]
    new = [r for r in more if not any(shape.covers(_covered(r, model, eyes)) > COVERED for shape in taken)]
    covered = [_covered(r, model, eyes) for r in new]
    rest = [r for one in unnamed for r in _left_over(one, new, covered, model)]
    known = joined((*named, *new, *rest), model)
    kept = tuple(o for o in view.rejected if not any(_lies_on(o, r.group) for r in new))
    return known, replace(view, groups=tuple(r.group for r in known), rejected=kept)


def verify(
    found: Sequence[Recognised], view: FacetView, model: Model, eyes: Eyes
) -> tuple[tuple[Recognised, ...], FacetView]:
    """What was found, its unnamed facets completed to named parts where both images prove them; and the view with the
    groups and refused outlines that are left.

    Every facet of an unnamed group and every outline of one eye says which parts could be there, and where; should
    none of those be seen, any three corners of theirs do.
    """
    named, unnamed = [r for r in found if r.named], [r for r in found if not r.named]
    facets = [f for r in unnamed for f in r.group.facets]
    single = [o for o in _largest(view.rejected) if not any(_lies_on(o, r.group) for r in named)]
    outlines = [(o.corners_px, o.eye) for o in single[:OUTLINES]]
    outlines += [(f.left_px, "left") for f in facets] + [(f.right_px, "right") for f in facets]
    guesses = [PoseGuess(h.label, h.pose[None]) for f in facets for h in facet_hypotheses(f, model)]
    guesses += [g for o in outlines for g in guesses_from_outline(*o, eyes.geometry, model)]
    laid = _laid(guesses, model, eyes)
    complete = _completed(laid, named, model, eyes)
    if not complete:
        more = _laid(guesses_from_corners(outlines, eyes.geometry, model), model, eyes)
        complete, laid = _completed(more, named, model, eyes), laid + more
    silhouettes = [_covered(r, model, eyes) for r in complete]
    rest = [r for one in unnamed for r in _left_over(one, complete, silhouettes, model)]
    proved = [p for r in rest for p in _by_outline(r, laid, model, eyes)]
    kept = tuple(o for o in view.rejected if not any(_lies_on(o, r.group) for r in complete))
    known = joined((*named, *complete, *proved), model)
    return known, replace(view, groups=tuple(r.group for r in known), rejected=kept)


def _largest(outlines: Sequence[Rejected]) -> list[Rejected]:
    return sorted(outlines, key=lambda o: -Shape.of(o.corners_px).area)


def _lies_on(outline: Rejected, group: Group) -> bool:
    shape = Shape.of(outline.corners_px)
    return any(
        shape.covers(Shape.of(f.right_px if outline.eye == "right" else f.left_px)) > COVERED for f in group.facets
    )


def _laid(guesses: Sequence[PoseGuess], model: Model, eyes: Eyes) -> list[Laid]:
    """The likeliest guesses laid onto both images: two facets in view at least, edges near, and of poses that would
    look the same only one.
    """
    maps = edge_map(eyes.left.scale(2), EDGE_SIGMAS), edge_map(eyes.right.scale(2), EDGE_SIGMAS)
    likely = list[Guesses]()
    for label, metric in model.metric.items():
        poses = np.concatenate([np.zeros((0, 4, 4)), *(g.poses for g in guesses if g.label == label)])
        away_px = chamfer_px(metric.solid, poses, eyes.geometry, maps)
        near = (away_px < MOST_OFF_PX) & (in_view(metric.solid, poses).sum(1) > 1)
        likely.append(Guesses(label, metric.solid, poses[near], away_px[near]))
    kept = different(likely, eyes, MOST)
    solids, poses = [model.metric[label].solid for label, _ in kept], np.array([pose for _, pose in kept])
    located = locate(solids, eyes, poses, REACH_MM, model.parameters.tolerance_mm)
    return [Laid(label, solid, pose, at) for (label, pose), solid, at in zip(kept, solids, located, strict=True)]


def _completed(laid: Sequence[Laid], named: Sequence[Recognised], model: Model, eyes: Eyes) -> list[Recognised]:
    """Parts of which two facets or more were confirmed and have a name together, where none of the others has another
    name and nothing named lies there.
    """
    good = []
    for one in laid:
        if one.located is None:
            continue
        confirmed, share = confirmed_facets(one.solid, one.located, eyes)
        if len(confirmed) > 1 and share > LEAST_SHARE:
            group = weld([measured_facet(f, eyes.geometry) for f in confirmed])
            part = recognise_group(group, model)
            if part.named and part.residual_mm < CLOSE_MM:
                good.append(Recognised(group, part))
    found: list[Recognised] = []
    for new in good:
        rivals = any(new.label != other.label and _collides(new.group, other.group) for other in good)
        if not rivals and not any(_collides(new.group, other.group) for other in (*named, *found)):
            found.append(new)
    return found


def _covered(one: Recognised, model: Model, eyes: Eyes) -> Shape:
    """What a named part covers in the left eye."""
    return silhouette(model.metric[one.label].solid, one.part.cyclopean_from_part, eyes)


def _left_over(
    unnamed: Recognised, found: Sequence[Recognised], silhouettes: Sequence[Shape], model: Model
) -> list[Recognised]:
    """What remains of an unnamed group: all of it, or its facets that lie on none of the parts found, each alone."""
    shapes = [Shape.of(f.left_px) for f in unnamed.group.facets]
    on = [any(shape.common(s) > COVERED * shape.area for s in silhouettes) for shape in shapes]
    alone = [unnamed.group.only([k]) for k in range(len(shapes))]
    on = [o or any(_collides(r.group, one) for r in found) for o, one in zip(on, alone, strict=True)]
    if not any(on):
        return [unnamed]
    return [Recognised(one, recognise_group(one, model)) for o, one in zip(on, alone, strict=True) if not o]


def _collides(one: Group, other: Group) -> bool:
    """Whether two groups cover each other in an image."""
    pairs = [(Shape.of(f.left_px), Shape.of(g.left_px)) for f in one.facets for g in other.facets]
    return any(a.covers(b) > COVERED for a, b in pairs)


@dataclass(frozen=True, eq=False)
class _Outlined:
    """A laid part that explains facets of a group: which, with their corners (N, 3) mm on it; share: of its outline
    that both eyes show.
    """

    laid: Laid
    explained: dict[int, tuple[int, Array]]
    share: float


def _by_outline(unnamed: Recognised, laid: Sequence[Laid], model: Model, eyes: Eyes) -> list[Recognised]:
    """An unnamed group as the only taught part whose whole outline lies where its facets say, and its other facets
    each alone; as it was where no part's outline does, or several parts' do.
    """
    best: dict[str, _Outlined] = {}
    for one in laid:
        outlined = _outlined(unnamed.group, one, eyes)
        if outlined is not None and outlined.share > (best[one.label].share if one.label in best else 0.0):
            best[one.label] = outlined
    ranking = sorted(best.values(), key=lambda o: -o.share)
    if not ranking or ranking[0].share < PROVED or any(o.share >= DISPROVED for o in ranking[1:]):
        return [unnamed]
    first = ranking[0]
    assert first.laid.located is not None
    fit = fit_of(first.laid.located)
    assert fit is not None
    group = unnamed.group.only(sorted(first.explained))
    why = f"{100 * first.share:.0f} % of its outline lies where its facets say"
    runner_up = ranking[1].laid.label if len(ranking) > 1 else None
    named = Recognition(first.laid.label, BY_EDGES, 0.0, 0.0, runner_up, False, why, (first.laid.label,))
    rings = [first.explained[k] for k in sorted(first.explained)]
    facets = typed_as(group.facets, (first.laid.solid.types[index] for index, _ in rings), model.library)
    fitted = tuple(corners for _, corners in rings)
    pose = fit.cyclopean_from_part
    part = Part(named, facets, pose, fit.covariance, fit.residual_mm, fitted, pose[None])
    proved = Recognised(group, part)
    return [proved, *_left_over(unnamed, [proved], [silhouette(first.laid.solid, pose, eyes)], model)]


def _outlined(group: Group, one: Laid, eyes: Eyes) -> _Outlined | None:
    """How much of a laid part's outline shows; None where it explains no facet of the group, or one only shows."""
    fit = None if one.located is None else fit_of(one.located)
    pose = one.guessed if fit is None else fit.cyclopean_from_part
    corners = frames.apply(pose, one.solid.corners_mm)
    explained = dict[int, tuple[int, Array]]()
    for k, facet in enumerate(group.facets):
        for index in np.flatnonzero(one.solid.facing(pose) > 0).tolist():
            ring = corners[one.solid.rings[index]]
            if len(ring) == len(facet.corners_mm):
                turns = [np.roll(ring, -turn, axis=0) for turn in range(len(ring))]
                nearest = min(turns, key=lambda turned: _rms(turned, facet.corners_mm))
                if _rms(nearest, facet.corners_mm) < EXPLAINED_MM:
                    explained[k] = index, nearest
    if not explained or facets_in_view(one.solid, eyes, pose) < 2:
        return None
    return _Outlined(one, explained, shown(one.solid, eyes, pose, OUTLINE_MM) * (UNFITTED if fit is None else 1.0))


def _rms(one: Array, other: Array) -> float:
    """Rms distance of points (N, 3) from others (N, 3)."""
    return float(np.sqrt(((one - other) ** 2).sum(1).mean()))
