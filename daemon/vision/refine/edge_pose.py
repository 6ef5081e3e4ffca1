"""A known part's edges laid onto both images: its pose from grey levels, and which of its facets they bear out.

Two faces in the same light melt into one outline, and no facet is found; whoever knows the part and about where it
lies knows which edges each camera should see, and measures those. Pure: cameras, a shape and a near pose in, a pose
out. Whether that is enough for a name is by_edges.py's; what to make of a part that is not there is the cycle's
business.

| function | starts from | searches | fits rims of holes | returns | if the edges are not there |
| --- | --- | --- | --- | --- | --- |
| `locate_by_edges` | a pose within reach_mm | the reach | no | pose and measured edges | None |
| `fit_by_edges` | a pose right to a px, and within reach_mm | if need be | yes | pose and covariance | None |
| `fit_by_each_camera` | as fit_by_edges | if need be | yes | as fit_by_edges, from each camera | None |
| `refine_from_pose` | a pose right to a px | no | yes | pose, covariance, measured edges | stays at the pose |
| `clear_edge_fraction` | a pose within reach_mm | the reach | no | how surely the part is there | 0 |
| `vanished_edge_fraction` | a pose within reach_mm | the reach | no | how surely it was there and is gone | 0 |
| `expected_covariance` | poses, no images | no | no | covariances that a fit is expected to have | large |
| `outline_coverage` | a pose that stays | across each edge | no | how much of the outline has edges near it | 0 |
| `count_visible_facets` | a pose that stays | no | no | how many facets both cameras show | 0 |
| `facets_from_edges` | measured edges | no | no | the facets' corners in either camera | no facet |

Beside these: `edge_adjustment.adjust_pose` solves one such fit, `edge_adjustment.refined_parts` fits parts that facets
named, `edge_samples.aligned_to_edges` moves many poses at once, `following.fit_to_facets` fits to corners of facets.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from daemon import frames
from daemon.arrays import Array, Flags
from daemon.vision.geometry import Polyhedron, SolidBatch, StereoRig, chi_square_limit, solve, thickness, whitener
from daemon.vision.image import CameraImage, StereoImages, edge_sigmas, find_sides, open_stereo, probe_sides
from daemon.vision.refine.edge_adjustment import OF_TOLERANCE, PRIOR, UNMEASURED, adjust_pose
from daemon.vision.refine.edge_samples import EdgeEvidence, EdgeSamples, aligned_to_edges, edge_samples_of
from daemon.vision.refine.expected_edges import (
    LEAST_EVIDENCE,
    LEAST_LENGTH_PX,
    LEAST_SUPPORT,
    LINE_TAIL,
    SCALE,
    THIN_PX,
    EdgeObservation,
    ExpectedEdges,
    across,
    longest_runs,
    measure_edges,
    moved,
    nothing_found,
    off_places,
    project_edges,
    visible_stretches,
)
from daemon.vision.refine.following import Fit
from daemon.vision.refine.rim_samples import rim_places
from daemon.vision.settings import TOLERANCE_MM
from daemon.vision.values import MeasuredCorners

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
STRETCH_PX = 0.8
"""How far off either end of an edge is that stretches have laid, all of its stretches together. Of 117 looks at a real
printed cube and 32 at rendered parts lines alone had corners 1.8 and .38 mm off on average, with this 1.4 and .34."""
AGAIN = 8
"""How often at most edges are measured of a part that is known to be there."""
FARTHEST_CHI2 = chi_square_limit(6, 1e-3)
"""How far lines may lead a part from where stretches have it, by the covariance that it has there beforehand: one of
which some edges only stay in view may be led along these."""
STRETCHES, LEAST_IN_VIEW = 8, 0.5
"""In how many places along an edge it is asked whether the part itself hides it, and how much of an arc's chord must be
in view."""
SEARCH_DEG = 3.0
PASSES = 5
LEAST_OUTLINE = 0.75
"""Of the length of the outline that a camera should see, what it must show on its place."""
LEAST_CLEAR = 0.5
"""Of the length of all edges, what must stand out where a part is followed. Parts of the rendered scenes show 0.7 and
more, the slow shading of a patterned table where none lies 0.06 and less."""
LEAST_SIGMAS = 4.0
"""Of the slope across an edge against what lies beside it, where the edge is to prove a facet."""
MOSTLY_IN = 0.5
"""Of a facet, that must be in a picture for it to be in view."""
LEAST_SHOWN = 0.9
"""Of what the own edges of facets could show that one camera alone has in view, what they must: nothing in the other
camera speaks for these or against them. Of 52 look-alikes seen so, each taught alone, 16 have their names without this,
33 with it, and 44 where .8 is enough; of as many strangers that can be told from the part taught 3, 3 and 5 have one
(python -m tests.bench.look_alikes 20 --one-camera)."""
LEAST_SHARE = 0.4
"""Of the evidence that the edges of a part could give, what they must where it is settled. Of 41 parts in the gripper
the edges gave .41 to 1 at their place; from 3 mm beside it they led to places where they gave .38 and less, or more
only where the part was turned by 2 degrees and more, which its covariance forbids."""
IN_PLACE = 0.95
"""Fraction of the edge length in place from which no other start is tried."""
SAFE_CONDITION = 1e7
BY_PRIOR = np.linalg.inv(PRIOR)
"""Covariance of a pose of which no edge says anything."""


@dataclass(frozen=True, eq=False)
class Located:
    """The pose (4, 4) cyclopean_from_part at which edges were last measured, and these edges in the left and right
    camera."""

    pose: Array
    observed: tuple[EdgeObservation, EdgeObservation]


def locate_by_edges(shape: Polyhedron, images: StereoImages, near: Array, reach_mm: float) -> Located | None:
    """Find where within some reach_mm of `near` (4, 4) cyclopean_from_part the edges of a shape lie on the images'
    edges; None where too few edges show for that.

    Source: edges searched for across their expected places, the pose by least squares on their ends (as Harris's RAPiD
    does point by point), then on sub-pixel lines until it moves no more.
    """
    solids, poses = SolidBatch.of([shape]), near[None]
    for share in ROUGHLY:
        rough = [
            _search_edges(edges, view, reach_mm * share)
            for edges, view in zip(_project_unhidden_edges(solids, images, poses), images.views, strict=True)
        ]
        fraction = _fraction_of_length(rough, [seen.there for seen in rough])
        poses = moved(poses, solved_motion(rough, poses[0], near, reach_mm)[None])
    if fraction < HOPELESS:
        return None
    for turn in range(MOST_ROUNDS):
        left, right = measure_edges(_project_unhidden_edges(solids, images, poses), images)
        motion = solved_motion((left, right), poses[0], near, reach_mm)
        still = np.linalg.norm(motion / SCALE) < SMALL_MM
        if turn and not still and _fraction_of_length((left, right), (left.on_place, right.on_place)) < HOPELESS:
            return None
        if still or turn == MOST_ROUNDS - 1:
            break
        poses = moved(poses, motion[None])
    return Located(poses[0], (left, right))


def _project_unhidden_edges(
    solids: SolidBatch, images: StereoImages, poses: Array, tolerance_mm: float = TOLERANCE_MM
) -> tuple[ExpectedEdges, ExpectedEdges]:
    """Project placements into the left and the right camera: the edges that each part does not hide itself."""
    left, right = (
        _unhidden(solids, edges, poses, viewpoint_mm)
        for edges, viewpoint_mm in zip(
            project_edges(solids, images, poses, np.ones(len(poses), bool), tolerance_mm),
            images.geometry.cameras_mm,
            strict=True,
        )
    )
    return left, right


def _unhidden(solids: SolidBatch, edges: ExpectedEdges, poses: Array, viewpoint_mm: Array) -> ExpectedEdges:
    """The edges that a camera at viewpoint_mm (3,) has in view, as far as each part does not hide its own: a straight
    one from where to where most of it shows, a chord of an arc as a whole."""
    if all(solid.convex for solid in solids.shapes):
        return edges
    shows = visible_stretches(solids, edges, poses, viewpoint_mm, STRETCHES)
    first, last = longest_runs(shows)
    arcs = np.any(edges.bow != 0.0, axis=1)
    cut = edges.between(np.where(arcs, 0.0, first / STRETCHES), np.where(arcs, 1.0, last / STRETCHES))
    seen = np.where(arcs, shows.mean(axis=1) > LEAST_IN_VIEW, cut.lengths_px >= LEAST_LENGTH_PX)
    return cut.chosen(np.flatnonzero(seen))


def _hold_pose(observed: Sequence[EdgeObservation]) -> bool:
    """Whether in both cameras so much of a part's outline is in place that its edges hold the pose: also along a bar
    whose ends are out of view there must be an edge. A round part may turn about its axis."""
    in_place = [seen.on_place & seen.edges.sharp for seen in observed]
    if min(_outline_fraction(seen.edges, good) for seen, good in zip(observed, in_place, strict=True)) < LEAST_OUTLINE:
        return False
    information = np.zeros((6, 6))
    for seen, good in zip(observed, in_place, strict=True):
        rows = whitener(seen.doubt[good]) @ seen.edges.jacobian[good]
        information += np.einsum("eia,eib->ab", rows, rows)
    information[3:, 3:] += PRIOR[3:, 3:]  # a turn that no edge shows is that of a round part: its covariance says so
    return bool(np.linalg.cond(information * np.outer(SCALE, SCALE)) <= SAFE_CONDITION)


def refine_from_pose(
    shape: Polyhedron, images: StereoImages, pose: Array, tolerance_mm: float, samples: Sequence[EdgeSamples] = ()
) -> tuple[Fit, tuple[EdgeObservation, EdgeObservation]]:
    """Refine a pose cyclopean_from_part (4, 4) that is right to a pixel; return the fit, as fit_by_edges() has it,
    and the measured edges. samples: of the stretches at the pose, if already taken.

    Print beside edges leads lines astray, from one measurement to the next all the way to another minimum; of stretches
    by themselves most stay on their edges, so that these hold the part where they have it. A part that its lines lead
    farther than PRIOR allows, or out of both pictures, stays at the pose.
    """
    solids = SolidBatch.of([shape])
    known = samples or edge_samples_of(solids, images, pose[None], tolerance_mm)
    anchor = pose, sum((seen.information(STRETCH_PX) for seen in known), np.zeros((6, 6)))
    stays = Fit(pose, BY_PRIOR, 0.0, 0)
    first: tuple[EdgeObservation, EdgeObservation] | None = None
    for _ in range(AGAIN):
        left, right = measure_edges(_project_unhidden_edges(solids, images, pose[None], tolerance_mm), images)
        first = first or (left, right)
        if left.sides is None and right.sides is None:  # the lines led it out of both pictures
            return stays, first
        rims = rim_places(shape, pose, images, tolerance_mm)
        final = adjust_pose(shape, pose, (left, right), tolerance_mm, anchor, rims)
        pose = final.pose
        led = frames.difference(pose, anchor[0])
        if led @ PRIOR @ led > FARTHEST_CHI2:
            return stays, first
        if np.linalg.norm(final.motion / SCALE) < SMALL_MM:
            break
    off_px = np.concatenate([seen.off[seen.on_place] for seen in (left, right)])
    residual_mm = float(np.sqrt((off_px**2).mean()) / left.edges.px_per_mm[0]) if len(off_px) else 0.0
    return Fit(final.pose, final.covariance, residual_mm, len(off_px)), (left, right)


def fit_by_edges(
    shape: Polyhedron, images: StereoImages, near: Array, reach_mm: float, partly_hidden: bool = False
) -> Fit | None:
    """Fit the pose cyclopean_from_part (4, 4) of a part within reach_mm of `near`, by edges, arcs and rims of holes;
    None if the images do not confirm it. Fit.matched counts edges. partly_hidden: something unknown, as fingers, may be
    in front of it; otherwise the edges that show must hold the pose by themselves.

    Begins where stretches of edges lead; unless nearly all edges then lie in place, also where straight lines within
    reach do. The first goes wrong beside strong print, the second where a part has many short edges: the fit with more
    edges in place is taken.
    """
    aligned = aligned_to_edges(SolidBatch.of([shape]), images, near[None], TOLERANCE_MM)[0]
    best = _confirmed_fit(shape, images, aligned, partly_hidden)
    if best is None or best[1] < IN_PLACE:
        found = locate_by_edges(shape, images, near, reach_mm)
        other = None if found is None else _confirmed_fit(shape, images, found.pose, partly_hidden)
        best = max((each for each in (best, other) if each is not None), key=lambda each: each[1], default=None)
    return None if best is None else best[0]


EXPECTED_PX = 0.15
"""To which the ends of an edge are expected to be measured: .05 px on rendered parts, up to .3 px on a real one."""


def expected_covariance(shape: Polyhedron, rig: StereoRig, poses: Array) -> Array:
    """(N, 6, 6) covariance that a fit by edges is expected to have at each of some poses cyclopean_from_part (N, 4, 4),
    where nothing but the part itself hides an edge."""
    blank = np.zeros(rig.image_size[::-1], np.uint8)
    images, solids = open_stereo(blank, blank, rig), SolidBatch.of([shape] * len(poses))
    information = np.repeat(UNMEASURED[None], len(poses), 0)
    for edges in _project_unhidden_edges(solids, images, poses):
        weight = edges.sharp / (EXPECTED_PX**2 + (OF_TOLERANCE * edges.doubt_px) ** 2)
        each = np.einsum("eni,enj,e->eij", edges.jacobian, edges.jacobian, weight)
        np.add.at(information, edges.owner, each)
    return np.asarray(np.linalg.inv(information))


def fit_by_each_camera(shape: Polyhedron, images: StereoImages, near: Array, reach_mm: float) -> tuple[Fit, Fit] | None:
    """Fit as fit_by_edges does, but by the left and the right camera separately, for cameras whose places against each
    other are in doubt."""
    both = fit_by_edges(shape, images, near, reach_mm)
    if both is None:
        return None
    pose = both.cyclopean_from_part
    observed = measure_edges(_project_unhidden_edges(SolidBatch.of([shape]), images, pose[None]), images)
    if any(seen.sides is None for seen in observed):
        return None
    alone = (adjust_pose(shape, pose, [seen], TOLERANCE_MM) for seen in observed)
    left, right = (replace(both, cyclopean_from_part=one.pose, covariance=one.covariance) for one in alone)
    return left, right


def _confirmed_fit(
    shape: Polyhedron, images: StereoImages, start: Array, partly_hidden: bool
) -> tuple[Fit, float] | None:
    """The fit from a pose (4, 4), and the fraction of edge length in place; None if too little of the edges shows, or
    they are too faint to be a part's."""
    samples = edge_samples_of(SolidBatch.of([shape]), images, start[None], TOLERANCE_MM)
    if EdgeEvidence.of(samples).fraction < LEAST_SHARE:
        return None
    fit, observed = refine_from_pose(shape, images, start, TOLERANCE_MM, samples)
    clear = [_clear_edges(seen, view) for seen, view in zip(observed, images.views, strict=True)]
    if not fit.matched or _fraction_of_length(observed, clear) < LEAST_CLEAR:
        return None
    if not partly_hidden and not _hold_pose(observed):
        return None
    return fit, _fraction_of_length(observed, [seen.on_place for seen in observed])


def outline_coverage(shape: Polyhedron, images: StereoImages, pose: Array, reach_mm: float) -> float:
    """Share of the outline of a part at cyclopean_from_part (4, 4) near which both cameras have edges, within reach_mm;
    0 where a camera does not have it in view. Cheaper than a fit, and for what is only partly in view."""
    both = zip(_project_unhidden_edges(SolidBatch.of([shape]), images, pose[None]), images.views, strict=True)
    return min(_outline_fraction(edges, _search_edges(edges, view, reach_mm).there) for edges, view in both)


def clear_edge_fraction(shape: Polyhedron, images: StereoImages, near: Array, reach_mm: float) -> float:
    """Return how surely a part lies within some reach_mm of `near` (4, 4) cyclopean_from_part: the clear share of its
    edges, 0 where too few of them show on their place."""
    found = locate_by_edges(shape, images, near, reach_mm)
    if found is None or not _hold_pose(found.observed):
        return 0.0
    clear = [_clear_edges(seen, view) for seen, view in zip(found.observed, images.views, strict=True)]
    return _fraction_of_length(found.observed, clear)


def vanished_edge_fraction(
    shape: Polyhedron, before: StereoImages, after: StereoImages, near: Array, reach_mm: float
) -> float:
    """Return how surely a part lay within some reach_mm of `near` (4, 4) cyclopean_from_part before, and does no
    longer: the share of its edges that were clear before and are not after; 0 where too few of them showed on their
    place before."""
    found = locate_by_edges(shape, before, near, reach_mm)
    if found is None or not _hold_pose(found.observed):
        return 0.0
    now = measure_edges([seen.edges for seen in found.observed], after)
    then, still = (
        [_clear_edges(seen, view) for seen, view in zip(observed, images.views, strict=True)]
        for observed, images in ((found.observed, before), (now, after))
    )
    return _fraction_of_length(found.observed, [was & ~stays for was, stays in zip(then, still, strict=True)])


def facets_in_view(shape: Polyhedron, images: StereoImages, pose: Array) -> Flags:
    """(2, F) which facets of a part at cyclopean_from_part (4, 4) the left and the right camera see, not edge-on, nor
    mostly outside the picture."""
    points, most = frames.apply(pose, shape.corners_mm), np.array(images.rig.image_size) - 1
    found = np.zeros((2, len(shape.facets)), bool)
    for own, view in zip(found, images.views, strict=True):
        px = view.rectified.camera.project(points)
        for k in np.flatnonzero(thickness(px[shape.ring_table]) >= THIN_PX[1]).tolist():
            ring = px[shape.rings[k]]
            places = np.concatenate([ring, (ring + np.roll(ring, -1, 0)) / 2])  # corners and middles of sides
            own[k] = ((places >= 0) & (places <= most)).all(1).mean() > MOSTLY_IN
    return found


def count_visible_facets(shape: Polyhedron, images: StereoImages, pose: Array, both: Sequence[EdgeSamples]) -> int:
    """Count the facets of a part at cyclopean_from_part (4, 4) that the pictures show, by what either camera has along
    its edges: those in view of both, and beside these those in view of one camera, where their own edges show there;
    and a curved surface, where the far rim of it shows, whose facet does not face the cameras."""
    in_view = facets_in_view(shape, images, pose)
    of_both: Flags = np.asarray(in_view.all(0))
    if not of_both.any():
        return 0
    own = [
        _sides_of(shape, here, seen) & ~_sides_of(shape, of_both, seen)
        for here, seen in zip(in_view, both, strict=True)
    ]
    alone = EdgeEvidence.of(both, own).fraction > LEAST_SHOWN
    return int((in_view.any(0) if alone else of_both).sum()) + _shows_far_rim(shape, np.asarray(in_view.any(0)), both)


def _shows_far_rim(shape: Polyhedron, in_view: Flags, both: Sequence[EdgeSamples]) -> bool:
    """Whether arcs show that bound no facet (F,) in view: they end a curved surface, in another plane than these."""
    if not shape.arcs:
        return False
    arcs = frozenset(map(tuple, shape.lines[0][shape.circles[:, 3] > 0].tolist()))
    far = [
        np.array([pair in arcs or pair[::-1] in arcs for pair in map(tuple, seen.edges.ends.tolist())], bool)
        & ~_sides_of(shape, in_view, seen)
        for seen in both
    ]
    return EdgeEvidence.of(both, far).fraction > LEAST_SHOWN


def _sides_of(shape: Polyhedron, facets: Flags, seen: EdgeSamples) -> Flags:
    """(E,) which of the edges that one camera should see are sides of some facets (F,)."""
    found = np.zeros(len(seen.edges.ends) + 1, bool)  # the last is that of sides that it should not see
    for facet in np.flatnonzero(facets).tolist():
        found[seen.edges.of_ring(shape.facets[facet])[0]] = True
    return found[:-1]


def facets_from_edges(shape: Polyhedron, observed: Sequence[EdgeObservation]) -> dict[int, tuple[MeasuredCorners, ...]]:
    """Every facet that both cameras see, none of them edge-on, by its number: its corners in either camera, from the
    sides that show where they should, and from the pose where they do not."""
    thick = [thickness(seen.edges.corners_px[shape.ring_table]) >= THIN_PX[1] for seen in observed]
    facing = np.flatnonzero(np.all(thick, axis=0)).tolist()
    return {k: tuple(_likeliest_outline(shape.facets[k], seen) for seen in observed) for k in facing}


def _search_edges(edges: ExpectedEdges, view: CameraImage, reach_mm: float) -> EdgeObservation:
    """The strongest straight gradient within the reach of each edge."""
    count = len(edges.start)
    if not count:
        return nothing_found(edges)
    reach_px = np.clip(reach_mm * edges.px_per_mm, FEWEST_PX, MOST_PX)
    image = [(view.smooth, count)]
    start, end, _ = find_sides(image, edges.start, edges.end, reach_px, np.zeros(count), reach_px / 2)
    strength, seen = probe_sides(image, start, end)
    there = (np.abs(strength) > LEAST_EVIDENCE) & (seen > LEAST_SUPPORT)
    doubt_px = np.maximum(1.0, reach_px / 6) * np.where(edges.outline, 1.0, INNER_SIGMAS)
    doubt = np.eye(2) * (doubt_px**2)[:, None, None]
    return EdgeObservation(edges, off_places(edges.start, edges.end, start, end), doubt, there)


def solved_motion(observed: Sequence[EdgeObservation], pose: Array, near: Array, reach_mm: float) -> Array:
    """The motion (6,) that brings a pose onto the edges of both cameras, not much more than the reach from where it was
    thought to be: what no edge says, as the turn of a disc, stays as near."""
    off, jacobian, doubt, usable = (
        np.concatenate(each)
        for each in zip(*((o.off, o.edges.jacobian, o.doubt, o.there & o.edges.sharp) for o in observed), strict=True)
    )
    prior, whiten = np.diag(([reach_mm**-2] * 3) + [np.radians(SEARCH_DEG) ** -2] * 3), whitener(doubt)
    rows, far = (whiten @ jacobian)[None], (whiten @ off[..., None])[None, ..., 0]
    towards = prior @ frames.difference(near, pose)
    return np.asarray(solve(rows, far, usable[None].astype(float), prior, towards, passes=PASSES).unknowns[0])


def _fraction_of_length(observed: Sequence[EdgeObservation], good: Sequence[Flags]) -> float:
    """Return the fraction of the length of all edges in both cameras that the good ones have."""
    lengths = np.concatenate([seen.edges.lengths_px for seen in observed])
    return float(lengths @ np.concatenate(good) / max(lengths.sum(), 1e-9))


def _outline_fraction(edges: ExpectedEdges, good: Flags) -> float:
    """Return the fraction of the length of the outline in one camera that the good edges have; 0 where none of it is in
    view."""
    lengths = edges.lengths_px * edges.outline
    return float(lengths[good].sum()) / float(lengths.sum()) if lengths.sum() > 0 else 0.0


def _clear_edges(seen: EdgeObservation, view: CameraImage) -> Flags:
    """(E,) which edges are on their place and stand out from the shading and the grain beside them."""
    if seen.sides is None or not len(seen.off):
        return np.zeros(len(seen.off), bool)
    sigmas = edge_sigmas([(view.smooth, len(seen.off))], seen.sides.start, seen.sides.end)
    return np.asarray(seen.on_place & (sigmas > LEAST_SIGMAS))


def _likeliest_outline(ring: Sequence[int], seen: EdgeObservation) -> MeasuredCorners:
    """Return the most likely corners given the model and the sides that were found, each doubted by as much as
    Student's t has it of a side that is so far off its place."""
    assert seen.sides is not None
    which, turned = seen.edges.of_ring(ring)
    good = (which >= 0) & np.append(seen.on_place, False)[which]
    sides = seen.sides.chosen(which, turned)
    doubt_px = float(seen.edges.doubt_px[0])
    normal = across(sides.start, sides.end)
    place = np.sum(normal * sides.start, 1)
    doubts = seen.line_doubt
    chi2 = (np.linalg.solve(doubts, seen.off[..., None])[..., 0] * seen.off).sum(1)
    ends = np.append(doubts[:, (0, 1), (0, 1)] * (1 + chi2 / LINE_TAIL)[:, None], np.ones((1, 2)), 0)[which]
    ends = np.where(turned[:, None], ends[:, ::-1], ends)
    firm = good[:, None] / ends
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
