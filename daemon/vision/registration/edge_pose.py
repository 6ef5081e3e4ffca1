"""A known part's edges laid onto both images: its pose from grey levels, and which of its facets they bear out.

Two faces in the same light melt into one outline, and no facet is found; whoever knows the part and about where it
lies knows which edges each eye should see, and measures those. Pure: eyes, a shape and a near pose in, a pose out.
Whether that is enough for a name is by_segments.py's; what to make of a part that is not there is the cycle's business.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from daemon import frames
from daemon.arrays import Array, Flags, Index
from daemon.vision.geometry import Polyhedron, sides_of
from daemon.vision.image import Eyes, OneEye, edge_sigmas, find_sides, fit_sides, probe_sides
from daemon.vision.model import TOLERANCE_MM
from daemon.vision.registration.corner_pose import Fit
from daemon.vision.registration.edge_adjustment import adjusted
from daemon.vision.registration.expected_edges import THIN_PX, EdgeObservation, ExpectedEdges, Placements, expected
from daemon.vision.registration.pose_step import TUKEY, Solved, across, moved, off_places, solve

Outline = tuple[Array, Array]
"""A facet's corners (N, 2) px in one eye, and their covariance (N, 2, 2)."""

ROUGHLY = (1.0, 0.4)
"""Shares of the reach within which edges are searched for, round by round."""
INNER_SIGMAS = 10.0
"""How much farther off its place an edge inside the outline is searched as likely: print lies inside, and may show more
than the edge."""
FEWEST_PX, MOST_PX = 2.0, 24.0
"""What a reach is at least and at most in the image."""
HOPELESS = 0.4
"""Of the length of all edges, what a search must have found, and a second measurement on its place, to go on."""
MOST_ROUNDS, SMALL_MM = 5, 0.3
"""How often edges are measured anew, and a motion after which that would change nothing more."""
AGAIN = 3
"""How often edges are measured of a part that is known to be there."""
SEARCH_DEG = 3.0
LEAST_EVIDENCE, LEAST_SUPPORT = 6.0, 0.5
"""What an edge must show to be there: step over its noise, and share of its length."""
PASSES = 5
LEAST_OUTLINE = 0.75
"""Of the length of the outline that an eye should see, what it must show on its place."""
LEAST_CLEAR = 0.5
"""Of the length of all edges, what must stand out where a part is followed. Parts of the rendered scenes show 0.7 and
more, the slow shading of a patterned table where none lies 0.06 and less."""
LEAST_SIGMAS = 4.0
"""Of the slope across an edge against what lies beside it, where the edge is to prove a facet."""
FOUND_PX = 0.1
"""How sure a side that was found is, at best."""
SAFE_CONDITION = 1e7
SCALE = np.array([1.0, 1.0, 1.0, 0.03, 0.03, 0.03])
"""Turns are weighed at a lever of some 30 mm, so that mm and rad compare."""


@dataclass(frozen=True, eq=False)
class Located:
    """pose (4, 4) cyclopean_from_part of a shape at which edges were last measured; observed: in the left and right
    eye; tolerance_mm: how well the shape's corners are known; solved: what would move the pose yet.
    """

    shape: Polyhedron
    pose: Array
    observed: tuple[EdgeObservation, EdgeObservation]
    tolerance_mm: float
    solved: Solved


@dataclass(frozen=True, eq=False)
class ConfirmedFacet:
    """A facet of a shape of which both images show the sides: its index, and its corners in either eye."""

    index: int
    left: Outline
    right: Outline


def locate(
    shapes: Sequence[Polyhedron], eyes: Eyes, near: Array, reach_mm: float, tolerance_mm: float = TOLERANCE_MM
) -> list[Located | None]:
    """Where within some reach_mm of `near` (P, 4, 4) cyclopean_from_part the edges of each of the P shapes lie on the
    images' edges.

    None where too few edges show for that. tolerance_mm: how well the shapes' corners are known, a standard deviation.
    All are laid side by side, and each leaves as soon as its place is certain or hopeless.
    Source: edges searched for across their expected places, the pose by Gauss-Newton on their ends with Tukey's weights
    (as Harris's RAPiD does point by point), then on sub-pixel lines until it moves no more.
    """
    found: list[Located | None] = [None] * len(shapes)
    if not shapes:
        return found
    laid, poses, open_ = Placements.of(shapes), near, np.ones(len(shapes), bool)
    for share in ROUGHLY:
        rough = [
            _searched(expected(laid, view, poses, open_, tolerance_mm), view, reach_mm * share) for view in eyes.views
        ]
        shares = _shares(rough, [seen.there for seen in rough], len(shapes))
        poses = moved(poses, _solved(rough, reach_mm, len(shapes)).motion)
    open_ = shares >= HOPELESS
    for turn in range(MOST_ROUNDS):
        if not open_.any():
            break
        left, right = measured([expected(laid, view, poses, open_, tolerance_mm) for view in eyes.views], eyes)
        solved = _solved((left, right), reach_mm, len(shapes))
        still = np.linalg.norm(solved.motion / SCALE, axis=1) < SMALL_MM
        lost = (_shares((left, right), (left.on_place, right.on_place), len(shapes)) < HOPELESS) & ~still & (turn > 0)
        for k in np.flatnonzero(open_ & (still | (turn == MOST_ROUNDS - 1)) & ~lost).tolist():
            step = Solved(solved.motion[k], solved.information[k], solved.excess[k])
            found[k] = Located(shapes[k], poses[k], (left.only(k, laid), right.only(k, laid)), tolerance_mm, step)
        open_ = open_ & ~still & ~lost
        poses = moved(poses, solved.motion)
    return found


def fit_edges(shape: Polyhedron, eyes: Eyes, near: Array, reach_mm: float = 5.0) -> Fit | None:
    """The pose at which `locate` finds the part, with its covariance.

    None where an eye shows too few of the edges it should see, or they are too faint to be the part's, or leave the
    pose open. Fit.matched counts edges.
    """
    found = locate([shape], eyes, near[None], reach_mm)[0]
    return None if found is None or clear_share(found, eyes) < LEAST_CLEAR else fit_of(found)


def fit_each(shape: Polyhedron, eyes: Eyes, near: Array, reach_mm: float) -> tuple[Fit, Fit] | None:
    """As fit_edges, but what each eye says by itself, for eyes whose places against each other are in doubt."""
    found = locate([shape], eyes, near[None], reach_mm)[0]
    whole = None if found is None or clear_share(found, eyes) < LEAST_CLEAR else fit_of(found)
    if found is None or whole is None:
        return None
    alone = (adjusted(shape, found.pose, [seen], found.tolerance_mm) for seen in found.observed)
    left, right = (replace(whole, cyclopean_from_part=one.pose, covariance=one.covariance) for one in alone)
    return left, right


def fit_of(found: Located) -> Fit | None:
    """The located pose moved a last time, with its covariance, if so much of its outline is on its place in both
    eyes."""
    on_place = [seen.on_place & seen.edges.sharp for seen in found.observed]
    shares = map(_outline_share, (seen.edges for seen in found.observed), on_place)
    if min(shares) < LEAST_OUTLINE:
        return None
    solved = found.solved
    if np.linalg.cond(solved.information * np.outer(SCALE, SCALE)) > SAFE_CONDITION:
        return None
    off_px = np.concatenate([seen.off[good] for seen, good in zip(found.observed, on_place, strict=True)])
    residual_mm = float(np.sqrt((off_px**2).mean()) / found.observed[0].edges.px_per_mm[0])
    final = adjusted(found.shape, found.pose, found.observed, found.tolerance_mm)
    return Fit(final.pose, final.covariance, residual_mm, len(off_px))


def fit_at(
    shape: Polyhedron, eyes: Eyes, pose: Array, tolerance_mm: float
) -> tuple[Fit, tuple[EdgeObservation, EdgeObservation]]:
    """Where the edges of a part have it that is at a pose (4, 4) cyclopean_from_part to a px or so; and those edges."""
    laid, once = Placements.of([shape]), np.ones(1, bool)
    for _ in range(AGAIN):
        left, right = measured([expected(laid, view, pose[None], once, tolerance_mm) for view in eyes.views], eyes)
        final = adjusted(shape, pose, (left, right), tolerance_mm)
        pose = final.pose
        if np.linalg.norm(final.motion / SCALE) < SMALL_MM:
            break
    off_px = np.concatenate([seen.off[seen.on_place] for seen in (left, right)])
    residual_mm = float(np.sqrt((off_px**2).mean()) / left.edges.px_per_mm[0]) if len(off_px) else 0.0
    return Fit(final.pose, final.covariance, residual_mm, len(off_px)), (left, right)


def shown(shape: Polyhedron, eyes: Eyes, pose: Array, reach_mm: float) -> float:
    """Share of the outline of a part at cyclopean_from_part (4, 4) near which both eyes have edges, within reach_mm;
    0 where an eye does not have it in view. Cheaper than a fit, and for what is only partly in view."""
    laid, once = Placements.of([shape]), np.ones(1, bool)
    expectations = [(expected(laid, view, pose[None], once, TOLERANCE_MM), view) for view in eyes.views]
    return min(_outline_share(edges, _searched(edges, view, reach_mm).there) for edges, view in expectations)


def facets_in_view(shape: Polyhedron, eyes: Eyes, pose: Array) -> int:
    """How many facets of a part at cyclopean_from_part (4, 4) both eyes see, none of them edge-on."""
    points = frames.apply(pose, shape.corners_mm)
    px = [view.eye.camera.project(points) for view in eyes.views]
    laid = Placements.of([shape])
    return int(np.all([laid.thickness(seen) >= THIN_PX[1] for seen in px], axis=0).sum())


def clear_share(found: Located, eyes: Eyes) -> float:
    """Of the length of all edges in both eyes, that of those on their place that stand out from the shading and the
    grain beside them."""
    good = [_clear(seen, view) for seen, view in zip(found.observed, eyes.views, strict=True)]
    return float(_shares(found.observed, good, 1)[0])


def facets_laid(shape: Polyhedron, observed: Sequence[EdgeObservation]) -> list[ConfirmedFacet]:
    """Every facet that both eyes see, none of them edge-on: its corners from the sides that show where they should, and
    from the pose where they do not."""
    laid = Placements.of([shape])
    thick = [laid.thickness(seen.edges.corners_px) >= THIN_PX[1] for seen in observed]
    found_facets = []
    for index in np.flatnonzero(np.all(thick, axis=0)).tolist():
        ring = shape.facets[index]
        outlines = (_outline(ring, seen, *_sides_of(ring, seen.edges, seen.on_place)) for seen in observed)
        found_facets.append(ConfirmedFacet(index, *outlines))
    return found_facets


def _searched(edges: ExpectedEdges, view: OneEye, reach_mm: float) -> EdgeObservation:
    """The strongest straight gradient within the reach of each edge."""
    count = len(edges.start)
    if not count:
        return _nothing(edges)
    reach_px = np.clip(reach_mm * edges.px_per_mm, FEWEST_PX, MOST_PX)
    image = [(view.smooth, count)]
    start, end, _ = find_sides(image, edges.start, edges.end, reach_px, np.zeros(count), reach_px / 2)
    strength, seen = probe_sides(image, start, end)
    there = (np.abs(strength) > LEAST_EVIDENCE) & (seen > LEAST_SUPPORT)
    doubt_px = np.maximum(1.0, reach_px / 6) * np.where(edges.outline, 1.0, INNER_SIGMAS)
    weight = np.eye(2) / (doubt_px**2)[:, None, None]
    return EdgeObservation(edges, off_places(edges.start, edges.end, start, end), weight, there)


def measured(both: Sequence[ExpectedEdges], eyes: Eyes, *, on_place: bool = False) -> list[EdgeObservation]:
    """Each edge's sub-pixel line, in both eyes. on_place: they are expected to half a px."""
    counts = [len(edges.start) for edges in both]
    if not any(counts):
        return [_nothing(edges) for edges in both]
    start, end = (np.concatenate([getattr(edges, name) for edges in both]) for name in ("start", "end"))
    exposures = [(view.exposure, count) for view, count in zip(eyes.views, counts, strict=True) if count]
    own = [np.unique(edges.owner, return_counts=True)[1] for edges in both]
    blurs = [view.blur_px for view in eyes.views]
    known = np.repeat([b for b in blurs if b], [len(o) for o in own]) if on_place and all(blurs) else None
    sides = fit_sides(exposures, start, end, np.concatenate(own), known)
    found = []
    for edges, which in zip(both, np.split(np.arange(len(start)), counts[:1]), strict=True):
        seen = sides.chosen(which)
        weight = np.asarray(np.linalg.inv(seen.covariance + edges.doubt_px[:, None, None] ** 2 * np.eye(2)))
        there = (seen.evidence > LEAST_EVIDENCE) & (seen.support > LEAST_SUPPORT)
        off = off_places(edges.start, edges.end, seen.start, seen.end)
        found.append(EdgeObservation(edges, off, weight, there, seen))
    return found


def _nothing(edges: ExpectedEdges) -> EdgeObservation:
    return EdgeObservation(edges, np.zeros((0, 2)), np.zeros((0, 2, 2)), np.zeros(0, bool))


def _solved(observed: Sequence[EdgeObservation], reach_mm: float, count: int) -> Solved:
    """The motions (P, 6) that bring the poses of so many placements onto the edges of both eyes, not much more than the
    reach."""
    owner = np.concatenate([seen.edges.owner for seen in observed])
    order = np.argsort(owner, kind="stable")
    edges = np.bincount(owner, minlength=count)
    place = np.arange(len(owner)) - (np.cumsum(edges) - edges)[owner[order]]

    def padded(each: Sequence[Array]) -> Array:
        """(P, most edges of any, ...) from (E, ...) of each eye; zero where a placement has fewer."""
        values = np.concatenate(each)
        wide = np.zeros((count, edges.max(initial=1), *values.shape[1:]))
        wide[owner[order], place] = values[order]
        return wide

    off, jacobian = padded([o.off for o in observed]), padded([o.edges.jacobian for o in observed])
    weight = padded([o.weight for o in observed])
    usable = padded([(o.there & o.edges.sharp).astype(float) for o in observed])
    prior = np.diag(([reach_mm**-2] * 3) + [np.radians(SEARCH_DEG) ** -2] * 3)
    return solve(off, jacobian, weight, usable, prior, TUKEY, PASSES)


def _shares(observed: Sequence[EdgeObservation], good: Sequence[Flags], count: int) -> Array:
    """(P,) of the length of all edges of each of so many placements in both eyes, that of the good ones."""
    lengths = np.concatenate([seen.edges.lengths_px for seen in observed])
    owner = np.concatenate([seen.edges.owner for seen in observed])
    total, part = (np.bincount(owner, each, count) for each in (lengths, lengths * np.concatenate(good)))
    return np.asarray(part / np.maximum(total, 1e-9))


def _outline_share(edges: ExpectedEdges, good: Flags) -> float:
    """Of the length of the outline in one eye, that of the good edges; 0 where none of it is in view."""
    lengths = edges.lengths_px * edges.outline
    return float(lengths[good].sum()) / float(lengths.sum()) if lengths.sum() > 0 else 0.0


def _clear(seen: EdgeObservation, view: OneEye) -> Flags:
    """(E,) which edges are on their place and stand out from the shading and the grain beside them."""
    if seen.sides is None or not len(seen.off):
        return np.zeros(len(seen.off), bool)
    sigmas = edge_sigmas([(view.smooth, len(seen.off))], seen.sides.start, seen.sides.end)
    return np.asarray(seen.on_place & (sigmas > LEAST_SIGMAS))


def _sides_of(ring: Sequence[int], edges: ExpectedEdges, good: Flags) -> tuple[Index, Flags, Flags]:
    """Which edge each side of a facet is (any, where the eye should not see it), whether it runs the other way there,
    and whether it is good."""
    at = {(int(a), int(b)): k for k, (a, b) in enumerate(edges.ends)}
    pairs = list(sides_of(ring))
    which = np.array([at.get(p, at.get(p[::-1], -1)) for p in pairs], np.intp)
    turned = np.array([p not in at and p[::-1] in at for p in pairs], bool)
    return which, turned, (which >= 0) & np.append(good, False)[which]


def _outline(ring: Sequence[int], seen: EdgeObservation, which: Index, turned: Flags, good: Flags) -> Outline:
    """Most likely corners given the model and the sides that were found."""
    assert seen.sides is not None
    sides = seen.sides.chosen(which, turned)
    doubt_px = float(seen.edges.doubt_px[0])
    normal = across(sides.start, sides.end)
    place = np.sum(normal * sides.start, 1)
    firm = good[:, None] / (sides.covariance[:, (0, 1), (0, 1)] + FOUND_PX**2)
    information = np.eye(2) / doubt_px**2 + np.zeros((len(which), 1, 1))
    pull = seen.edges.corners_px[list(ring)] / doubt_px**2
    for weight, n, d in (
        (firm[:, 0], normal, place),
        (np.roll(firm[:, 1], 1), np.roll(normal, 1, 0), np.roll(place, 1)),
    ):
        information = information + weight[:, None, None] * n[:, :, None] * n[:, None, :]
        pull = pull + (weight * d)[:, None] * n
    covariance = np.asarray(np.linalg.inv(information), float)
    return (covariance @ pull[..., None])[..., 0], covariance
