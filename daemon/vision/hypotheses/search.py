"""Search for taught parts by straight edges: a few hypotheses of many, to be registered on both images.

In: both cameras' images, what is named and what is not, the support plane. Out: parts and poses that would look
different from each other, the likeliest first, and of how many hypotheses they are the best. Hypotheses come from
junctions that both cameras see and from facets without a name, or from junctions that one camera sees, of parts that
rest on the support plane.

Segments say how much speaks for each. Where an edge is short, or runs along the baseline, its direction in depth is
uncertain by some twenty degrees. The left camera sees the junction the same when the part turns about one line, so each
hypothesis is turned about that line to where the part's other edges fit best in both images.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import islice
from typing import NamedTuple

import numpy as np

from daemon import frames
from daemon.arrays import Array, Flags, Index
from daemon.vision.facets import MeasuredCircle, find_circles, merge_vertices
from daemon.vision.geometry import Baseline, PlanarShape, Polyhedron
from daemon.vision.hypotheses.circles import poses_from_circles, taught_radii
from daemon.vision.hypotheses.directional_edge_map import DirectionalEdgeMap, evidence, promising
from daemon.vision.hypotheses.junctions import junction_kinds, meet, poses_from_junctions
from daemon.vision.hypotheses.pose_batch import COVERED, PoseBatch, ideal, pixels, taught_solids
from daemon.vision.hypotheses.resting_junctions import poses_on_support, resting_junctions_of
from daemon.vision.hypotheses.resting_poses import SupportPlane, snapped_poses
from daemon.vision.image import SegmentCorners, StereoImages, join_segments, ranks, segment_corners
from daemon.vision.model import Model
from daemon.vision.recognition import facet_kind_counts, facet_placements, facet_poses
from daemon.vision.refine import turned
from daemon.vision.settings import VisionSettings
from daemon.vision.values import Group

LOOKED_AT, MOST, PER_PLACE, PER_LABEL = 60, 24, 6, 2
"""Guesses looked at in the order of what speaks for them; those of them laid onto the images, in all, at one place, and
of each part there however many others are: a part that is like another must be there to be its rival."""
SEARCHED, FEWEST_LAID = 0.6, 5
"""Of a look's budget, after which no more guesses are asked for, and how many are laid onto the images yet."""
WORTH = 0.6
"""Of the evidence for the best guess at a place, what another there must have to be laid as well."""
MOST_PROMISING, OF_A_BUNDLE = 600, 4
"""Guesses that a glance speaks for, of which both cameras are asked; and where there are more, how many at much the
same pose: a part in plain sight has thousands, and one beside it is there as well."""
LEAST_NATS = 180.0
"""Evidence of segments against chance, a third of which a guess must have to be looked at."""
SUSPECT_MM = 8.0  # rms; how badly a facet may have been measured of which a part is suspected
FEWEST_IN_VIEW = 2
"""Facets of a part that is named by its edges: one alone is no proof."""


@dataclass(frozen=True, eq=False)
class Search:
    """What guesses are made from: both cameras, the taught parts, groups of facets without a name, what the left camera
    sees of the parts that have one, maps of segments of both cameras, and the table, where that is seen or known."""

    images: StereoImages
    model: Model
    unnamed: Sequence[Group]
    named: Sequence[PlanarShape]
    maps: tuple[DirectionalEdgeMap, DirectionalEdgeMap]
    ground: SupportPlane | None

    @cached_property
    def uncluttered(self) -> bool:
        """Whether little but parts shows edges: then what a facet could be is likely, and asked by itself."""
        return self.images.uncluttered(VisionSettings())

    @cached_property
    def circles(self) -> list[MeasuredCircle]:
        """Circles that both cameras see, of about the radii of taught rims."""
        return find_circles(self.images, taught_radii(taught_solids(self.model).shapes))

    @cached_property
    def corners(self) -> tuple[SegmentCorners, SegmentCorners]:
        """The corners where straight segments meet, of either camera."""
        left, right = (segment_corners(join_segments(view.segments)) for view in self.images.views)
        return left, right


class EdgeHypothesis(NamedTuple):
    """A part and where it could be: its pose (4, 4) cyclopean_from_part, the best of so many tested at one guess."""

    label: str
    pose: Array
    tested: float = 1.0


class RankedHypotheses(NamedTuple):
    """The likeliest parts and places, of how many tested; what there was no time to ask; and competing: other parts
    that could be at those places, which matter only where one of the likeliest may be named."""

    hypotheses: Sequence[EdgeHypothesis]
    tested: int
    left_out: tuple[str, ...] = ()
    competing: Sequence[EdgeHypothesis] = ()


@lru_cache(maxsize=4)
def prepare(model: Model) -> None:
    """Make what is made once of taught parts, and kept for all looks: .5 s of a thousand on a desktop's core."""
    shapes = taught_solids(model).shapes
    if shapes:
        facet_placements(shapes)
        facet_kind_counts(shapes)
        junction_kinds(shapes)
        taught_radii(shapes)
        resting_junctions_of(shapes)


def hypotheses_from_facets(search: Search, spent: Callable[[], float]) -> RankedHypotheses:
    """Hypotheses from unnamed facets, where these are tried by themselves."""
    if not search.uncluttered or spent() > SEARCHED:
        return RankedHypotheses([], 0)
    posed, hinges = _by_facets(search)
    return _likeliest(search, *_laid_down(search, posed, hinges), len(posed.part), spent)


def hypotheses_from_junctions(search: Search, spent: Callable[[], float]) -> RankedHypotheses:
    """Return hypotheses from corners that both cameras see, and from facets that have no name if these were not asked
    by themselves."""
    left, right = search.corners
    if spent() > SEARCHED:
        return RankedHypotheses([], 1, ("where taught parts could be was not looked for",))
    solids, geometry = taught_solids(search.model), search.images.geometry
    posed, hinges, tested = poses_from_junctions(meet(left, right, geometry), geometry, search.maps, solids)
    more, nats = poses_from_circles(search.circles, solids)  # and what further circles speak for each
    more_hinges = np.zeros((len(nats), 2, 3))
    if not search.uncluttered:
        others, other_hinges = _by_facets(search)
        more, more_hinges = more.and_also(others), np.concatenate([more_hinges, other_hinges])
    tested, further = tested + len(more.part), np.zeros(len(posed.part) + len(more.part))
    further[len(posed.part) : len(posed.part) + len(nats)] = nats
    posed, hinges = posed.and_also(more), np.concatenate([hinges, more_hinges])
    return _likeliest(search, *_laid_down(search, posed, hinges), tested, spent, further)


def _by_facets(search: Search) -> tuple[PoseBatch, Array]:
    """Return what facets without a name could be, and hinges (G, 2, 3): none, but that they lie in the middle."""
    facets = (merge_vertices([facet]).polyhedron for group in search.unnamed for facet in group.facets)
    found = [facet_poses(facet, search.model.metric, SUSPECT_MM) for facet in facets]
    part = np.concatenate([np.zeros(0, np.intp), *(parts for parts, _ in found)])
    posed = PoseBatch(
        taught_solids(search.model), part, np.concatenate([np.zeros((0, 4, 4)), *(own for _, own in found)])
    )
    middles = posed.middles_mm()
    return posed, np.stack([middles, np.zeros_like(middles)], 1)


def _laid_down(search: Search, posed: PoseBatch, hinges: Array) -> tuple[PoseBatch, Array]:
    """Guesses and their hinges (G, 2, 3), laid onto the table where that is known."""
    if search.ground is None:
        return posed, hinges
    return snapped_poses(posed, hinges, search.ground.table, search.images.geometry)


def hypotheses_on_support(search: Search, spent: Callable[[], float]) -> RankedHypotheses:
    """Return hypotheses from corners that one camera sees; nothing where no table is known."""
    if search.ground is None or spent() > SEARCHED:
        return RankedHypotheses([], 0)
    solids, geometry = taught_solids(search.model), search.images.geometry
    posed, tested = poses_on_support(search.corners, geometry, search.maps, search.ground.table, solids)
    return _likeliest(search, posed, np.zeros((len(posed.part), 2, 3)), tested, spent)


def _likeliest(
    search: Search,
    posed: PoseBatch,
    hinges: Array,
    tested: int,
    spent: Callable[[], float],
    further: Array | float = 0.0,
) -> RankedHypotheses:
    """Keep the poses with most evidence, segments and further nats (G,), each turned about its hinge (G, 2, 3) to its
    best angle."""
    geometry, maps, further = search.images.geometry, search.maps, np.broadcast_to(further, len(posed.part))
    good, by_glance = promising(posed, geometry, maps, further)
    good = good[varied_guesses(ScoredPoses(posed.chosen(good), -by_glance))]
    posed, hinges = posed.chosen(good), hinges[good]
    nats = evidence(posed, geometry, maps)[0] + further[good]
    in_view = posed.in_either_view(geometry).sum(1) + (further[good] > 0)
    good = (nats > LEAST_NATS / 3) & (in_view >= FEWEST_IN_VIEW)
    if search.named:
        middle_px = pixels(posed.middles_mm(), geometry)[0]
        good &= np.all([shape.depth(middle_px) <= 0 for shape in search.named], axis=0)
    guesses = ScoredPoses(posed.chosen(good), -nats[good])
    kept, competing = _worth(*best_turned(guesses, hinges[good], geometry, maps), search)
    if spent() > SEARCHED and len(kept) > FEWEST_LAID:
        note = f"{len(kept) - FEWEST_LAID} of {len(kept)} guesses were not compared with the pictures"
        return RankedHypotheses(kept[:FEWEST_LAID], tested, (note,))
    return RankedHypotheses(kept, tested, competing=competing)


def varied_guesses(guesses: ScoredPoses) -> Index:
    """Select the guesses that both cameras are asked of: where they are too many, a few of every bundle."""
    if len(guesses.against) <= MOST_PROMISING:
        return np.arange(len(guesses.against))
    few = thinned(guesses, OF_A_BUNDLE)
    return few[np.argsort(guesses.against[few], kind="stable")[:MOST_PROMISING]]


def _worth(guesses: ScoredPoses, tested: Array, search: Search) -> tuple[list[EdgeHypothesis], list[EdgeHypothesis]]:
    """The best guesses, a few at each place, for which nearly as much speaks as for the best there, of two parts at
    least where two could be there; and beyond these the best of each other part."""
    kept, competing, shapes = list[EdgeHypothesis](), list[EdgeHypothesis](), list[tuple[PlanarShape, float, str]]()
    posed, labels = guesses.posed, list(search.model.metric)
    for k, corners_px in islice(distinct(guesses, search.images), LOOKED_AT):
        shape, against, label = PlanarShape.hull(corners_px), float(guesses.against[k]), labels[posed.part[k]]
        there = [(worst, own) for other, worst, own in shapes if other.covers(shape) > COVERED]
        theirs = [one for _, one in there]
        own = theirs.count(label)
        if not there or ((len(there) < PER_PLACE or own < PER_LABEL) and against < WORTH * there[0][0]):
            among = kept if len(there) < PER_PLACE or (own == 0 and len(set(theirs)) == 1) else competing
            among.append(EdgeHypothesis(label, posed.poses[k], float(tested[k])))
            shapes.append((shape, against, label))
        if len(shapes) == MOST:
            break
    return kept, competing


ROOM_PX = 12
SAME_MM = 2.0  # poses that put every corner this near to the same place look the same

CELL_MM, CELL_TURN = 8.0, 0.4
"""Guesses whose middles and axes round to the same in these are one bundle."""
_BUNDLE = np.random.default_rng(2).integers(1, 2**40, 10)


@dataclass(frozen=True, eq=False)
class ScoredPoses:
    """Poses of parts, and what speaks against each (G,), in any one unit."""

    posed: PoseBatch
    against: Array

    def chosen(self, which: Index | Flags) -> ScoredPoses:
        """Some of them."""
        return ScoredPoses(self.posed.chosen(which), self.against[which])


def thinned(guesses: ScoredPoses, of_each: int = 1) -> Index:
    """Select the likeliest few of every bundle of guesses of one part at much the same pose."""
    posed = guesses.posed
    cells = [posed.part[:, None], posed.middles_mm() / CELL_MM, posed.poses[:, :3, :2].reshape(-1, 6) / CELL_TURN]
    bundle = np.rint(np.concatenate(cells, 1)).astype(np.int64) @ _BUNDLE
    order = np.argsort(guesses.against, kind="stable")
    return np.asarray(order[ranks(bundle[order]) < of_each])


def distinct(guesses: ScoredPoses, images: StereoImages) -> Iterator[tuple[int, Array]]:
    """Select which of a few hundred have the middle of what shows inside both images, the likeliest first, none of
    which looks like an earlier one; and where the left camera sees all corners of each (K, 2) px."""
    posed = guesses.posed
    if not len(posed.part):
        return
    pose, facet = np.nonzero(posed.in_either_view(images.geometry))
    shows = np.zeros((len(posed.part), posed.solids.corners_mm.shape[1]), bool)
    shows[pose[:, None], posed.solids.rings[posed.part[pose], facet]] = True
    corners_mm, own = posed.corners_mm(images.geometry), posed.solids.own[posed.part]
    count = shows.sum(1)
    middle_mm = (corners_mm * shows[..., None]).sum(1) / np.maximum(count, 1)[:, None]
    geometry = images.geometry
    both = zip((geometry.left, geometry.right), ideal(corners_mm, geometry), strict=True)
    seen = [camera.pixels(corners.astype(float)).reshape(*shows.shape, 2) for camera, corners in both]
    most = np.array(images.rig.image_size) - 1 - ROOM_PX
    inside = count > 0
    for px in seen:
        middle = (px * shows[..., None]).sum(1) / np.maximum(count, 1)[:, None]
        inside &= ((middle >= ROOM_PX) & (middle <= most)).all(1)
    of_one = (posed.part[:, None] == posed.part) & (count[:, None] == count)
    alike = of_one & (((middle_mm[:, None] - middle_mm) ** 2).sum(2) < SAME_MM**2)
    order, out = np.argsort(guesses.against, kind="stable"), ~inside
    for best in order.tolist():
        if out[best]:
            continue
        yield best, seen[0][best][own[best]]
        (near,) = alike[best].nonzero()
        if len(near) > 1:
            apart2 = ((corners_mm[near, :, None] - corners_mm[best, shows[best]]) ** 2).sum(3).min(2)
            out[near[((apart2 < SAME_MM**2) | ~shows[near]).all(1)]] = True


MOST_TURNED, TURNS = 100, np.radians([-24.0, -16.0, -8.0, 8.0, 16.0, 24.0])
"""Of the likeliest guesses, and by how much each is turned: what maps of segments and the pictures take for one pose
lies between two of them."""
WORTH_TURNING = 1.1
"""So many times the evidence for a guess as it is must speak for it turned."""
FARTHER_MM, TILT = 5.0, np.radians(7.0)
"""By how much a laid part is moved along the sight, and tilted against it."""


def best_turned(
    guesses: ScoredPoses, hinges: Array, geometry: Baseline, maps: tuple[DirectionalEdgeMap, DirectionalEdgeMap]
) -> tuple[ScoredPoses, Array]:
    """The likeliest of every bundle of guesses, each turned to where most speaks for it, and of how many tested each is
    the best: 1 for those that stay as they are. hinges (G, 2, 3): a point and the direction of the line that each turns
    about, cyclopean, no direction where there is none. What speaks against guesses is less the evidence of the maps."""
    few = thinned(guesses)
    few = few[np.argsort(guesses.against[few], kind="stable")[:MOST_TURNED]]
    posed, against = guesses.posed.chosen(few), guesses.against[few]
    point, cross = hinges[few, 0], frames.cross_matrices(hinges[few, 1])
    rotations = (np.eye(3) + np.sin(by) * cross + (1 - np.cos(by)) * cross @ cross for by in TURNS)  # Rodrigues
    poses = np.stack([posed.poses, *(turned(posed.poses, rotation, point) for rotation in rotations)])
    every = PoseBatch(posed.solids, np.tile(posed.part, len(TURNS)), poses[1:].reshape(-1, 4, 4))
    nats, _ = evidence(every, geometry, maps)
    each = np.concatenate([against[None], -nats.reshape(len(TURNS), -1)])
    best = np.concatenate([WORTH_TURNING * against[None], each[1:]]).argmin(0), np.arange(len(few))
    found = ScoredPoses(PoseBatch(posed.solids, posed.part, poses[best]), each[best])
    kept = thinned(found)
    return found.chosen(kept), np.where(best[0] > 0, len(TURNS) + 1.0, 1.0)[kept]


def perturbed_poses(solid: Polyhedron, pose: Array) -> list[Array]:
    """Poses (4, 4) cyclopean_from_part beside one at which a solid is laid: nearer, farther, tilted either way."""
    middle = frames.apply(pose, solid.corners_mm).mean(0)
    ahead = middle / np.linalg.norm(middle)
    aside = np.cross([0.0, 1.0, 0.0], ahead)
    turns = [frames.rotation_from_vector(by * axis) for axis in (aside, np.cross(ahead, aside)) for by in (TILT, -TILT)]
    moves = [frames.rigid(turn, middle - turn @ middle) for turn in turns]
    return [
        move @ pose for move in (*moves, *(frames.rigid(np.eye(3), by * ahead) for by in (FARTHER_MM, -FARTHER_MM)))
    ]
