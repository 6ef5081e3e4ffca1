"""Parts named and measured by straight edges, where no outline closes: printed faces, patterned tables, worn edges.

The likeliest hypotheses are registered on the grey levels: first, where little but parts shows edges, those from facets
without a name, which cost little; then those from junctions that both cameras see; then, where these name nothing,
those from the support plane and the junctions of one camera alone.

How likely such a part is there depends on what its edges show beyond the chance of this very image, on its rest on the
support plane, and on repetition in the image. All hypotheses that were made count against it, so that more taught parts
raise the bar, and what only it has must tell it from every other taught part that could lie there. A named part is
measured where it was registered: pose, facets, and the covariance of its place.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from daemon import frames
from daemon.arrays import Array
from daemon.vision.evidence.competing import LEAST_APART, lead_by_own_edges, lead_over_other_lengths, leaves_a_picture
from daemon.vision.evidence.hole_rims import MOST_NATS, by_holes, hole_nats, turned_by_holes
from daemon.vision.evidence.other_sizes import misfit_nats, other_radius_nats, other_size_nats
from daemon.vision.evidence.overlaps import covered
from daemon.vision.evidence.photo_consistency import print_apart_px
from daemon.vision.evidence.registered import (
    BY_NATS,
    ON_TABLE,
    RegisteredPart,
    recognised_at,
    register_at,
    register_near,
)
from daemon.vision.facets import TablePlane, estimate_table
from daemon.vision.geometry import Polyhedron, SolidBatch
from daemon.vision.hypotheses import (
    FEWEST_IN_VIEW,
    SEARCHED,
    EdgeHypothesis,
    PoseBatch,
    Search,
    SupportPlane,
    edge_distances,
    hypotheses_from_facets,
    hypotheses_from_junctions,
    hypotheses_on_support,
    indistinguishable_turns,
    perturbed_poses,
    self_similarity,
    snapped_poses,
    snapped_where_it_lies,
    turns_about_axis,
)
from daemon.vision.image import StereoImages
from daemon.vision.model import Model, facet_turns
from daemon.vision.recognition import Recognised
from daemon.vision.refine import SCALE, count_visible_facets
from daemon.vision.values import NearestGuess, Recognition

BY_ELSEWHERE, USUAL_ELSEWHERE = 7.5, 0.35
"""Log odds less, the more the picture would give the part elsewhere, from this share on: two of three true ones of 300
looks had less, the worst .74; of 151 guesses on photographed chessboards 149 had more than .72."""
FEWEST_TESTS = 1500
"""Guesses of each taught part that a look is taken to have made at least: what shows few edges has been chosen by where
they are. Of 368 rendered looks without the part that lay there two were named with as many as were made, none with
these; of 200 strangers to 64 taught parts six and one."""
LEAST_CONFIDENCE = 0.95
"""Of a name. No stranger of those looks had more than 0.93."""
LEAST_CUT_OFF = 0.99
"""Of the name of a part that leaves a picture: what is outside cannot speak against it. Of 40 strangers cut off, 64
parts taught, three had .97 to .987."""
UNDECIDED, MOST_UNDECIDED = (-1.6, 7.4), 3
"""Log odds between which it is not decided by its edges whether a part is there, and how many such are laid anew beside
where they lie. In a trial fourteen true ones gained 1.3 by it on average, 5 at most; five strangers .5, 1 at most. They
pay for their tries as turned guesses do: unpaid, a cylinder was taken for a prism."""
OTHER_RADIUS = 3.0
"""Nats by which another radius of its arcs must fit a part's edges better for it to have no name. Of round parts of
tests/bench/arcs.py 61 named by edges had .12 at most, machined ones .24; of 27 named with a radius 5 % off 25 had 3.8
and more (seeds 601 to 606, 801 to 803, 811 to 814)."""
OTHER_SIZE = 9.5
"""Nats by which another size of a part must fit its measured edges better for it to have no name. Of 125 parts that
edges named, in heaps, on patterned tables and in the shared scenes, rightly named ones had 7.9 at most, and three of
four strangers of another size, who showed it, 11.6 and more."""
HIDDEN_ODDS, MOST_HIDDEN, PER_PLACE = (-7.0, 7.4), 6, 2
"""Log odds between which it is asked what something nearer hides of a laid part; of how many in all, and at one place.
Twelve in all, from odds of -9 on, gave the same names in heaps and took 13 ms more where nothing taught lies."""
ALIKE, LEAST_BY_SIZE, MOST_OFF_SIZE = 2.0, 0.5, 1.5
"""Lead, log odds, within which the measured edges decide between two parts of nearly one size, or two turns of a round
part; nats by which these must; and nats that another size than the likelier part's may have, as it may be one that
nobody taught. Of those of tests/bench/arcs.py's parts that were looked into (seeds 421 to 424) the true size had .7 at
most, one 5 % off .1 to 9."""
HOLES_APART = 3.0
"""Nats by which the holes of a part must speak more for it than those of another part of its shape for that, and less
for a turn of it that is none."""
ELSE_TURNED = 1 + 2 * np.cos(np.radians(30.0))
"""Trace of a turn by so much: farther than that a part lies another way, nearer it is a pose a little off."""
MOST_WAYS = 3
"""Ways a part could lie otherwise that are held against the one that is likeliest."""
MOST_TURNS = 6
"""Turns of a round part about its axis that are measured, of those that are likelier than their neighbours."""
SURE_NATS = 8.0
"""By so many more than one hole can have, holes prove what a second facet would."""
NEAREST = 0.4
"""Of the evidence there could be, what a guess has that is worth showing."""


class NamedByEdges(NamedTuple):
    """What straight edges name, what came nearest to it where they name nothing, and what there was no time for;
    complete: nothing is left to be named."""

    named: list[Recognised]
    guesses: tuple[NearestGuess, ...]
    left_out: tuple[str, ...]
    complete: bool = False


def named_by_edges(
    images: StereoImages,
    model: Model,
    known: Sequence[Recognised],
    spent: Callable[[], float] = lambda: 0.0,
    known_table: TablePlane | None = None,
    enough: Callable[[Sequence[Recognised]], bool] = bool,
) -> NamedByEdges:
    """The taught parts that the straight edges of both images prove, beside those that are named already.

    Unnamed groups of facets say what each could be. spent: the share of the look's budget that is used. known_table:
    the table as others know it, for where both cameras do not see it; what does not lie on that one may lie on
    something else. enough: whether so many more names leave nothing to be named.
    """
    if spent() > SEARCHED:
        return NamedByEdges([], (), ("straight edges were not looked for",))
    unnamed = [one.group for one in known if not one.named]
    named = [covered(one, model, images) for one in known if one.named]
    maps = edge_distances(images.left), edge_distances(images.right)
    search = Search(
        images, model, unnamed, named, maps, SupportPlane.of(estimate_table(images, known_table), known_table)
    )
    fewest = FEWEST_TESTS * len(model.labels)
    by_facets = hypotheses_from_facets(search, spent)
    chances = max(by_facets.tested, fewest)
    registered = _by_odds(register_near(search, by_facets.hypotheses))
    registered = with_competing(search, registered, by_facets.competing, chances)
    found = accept_hypotheses(search, registered, chances, spent).named
    if found and enough(found):
        return NamedByEdges(found, (), (), complete=True)
    tested, left_out = 0, tuple[str, ...]()
    for hypotheses_of in (hypotheses_from_junctions, hypotheses_on_support):
        hypotheses, of, unasked, competing = hypotheses_of(search, spent)
        tested += of
        chances = max(tested, fewest)
        fresh = _by_odds(register_near(search, hypotheses))
        if spent() < SEARCHED:
            fresh += register_near(search, undecided_poses(fresh, chances, images))
        registered = _by_odds([*registered, *fresh])
        if spent() < SEARCHED:
            registered = _by_odds(_without_hidden_edges(registered, chances))
            registered = with_competing(search, registered, competing, chances)
        proven, found, untested = accept_hypotheses(search, registered, chances, spent)
        left_out += unasked + untested
        if named or found or search.ground is None or spent() > SEARCHED:
            break  # the second way is for looks that would come home with nothing, and needs a table
    nearest = list[RegisteredPart]()
    for one in registered:
        if one.evidence.fraction > NEAREST and not any(one.overlaps(other) for other in (*proven, *nearest)):
            nearest.append(one)
    apart_px = 0.0
    if nearest and not named and not found and spent() < 1:
        apart_px = print_apart_px(nearest[0].solid, nearest[0].pose, images)
    guesses = tuple(_guess(one, apart_px if one is nearest[0] else 0.0) for one in nearest)
    return NamedByEdges(found, guesses, left_out)


def with_competing(
    search: Search, registered: list[RegisteredPart], competing: Sequence[EdgeHypothesis], tested: int
) -> list[RegisteredPart]:
    """Registered parts, the likeliest first, and, where one may have a name, those that could be there as well."""
    if not any(_may_be_named(one, tested) for one in registered):
        return registered
    return _by_odds([*registered, *register_near(search, competing)])


class AcceptedHypotheses(NamedTuple):
    """Hypotheses that the edges prove; of these, those that have a name; and notes on what there was no time for."""

    proven: list[RegisteredPart]
    named: list[Recognised]
    left_out: tuple[str, ...] = ()


def accept_hypotheses(
    search: Search, registered: Sequence[RegisteredPart], tested: int, spent: Callable[[], float]
) -> AcceptedHypotheses:
    """Accept registered hypotheses, the likeliest first: those that the edges prove beyond all that were tested, and
    that do not overlap. Of these, name those that no other taught part explains as well."""
    accepted = AcceptedHypotheses([], [])
    for k, one in enumerate(registered):
        if spent() > 1:
            return accepted._replace(left_out=(f"{len(registered) - k} of {len(registered)} guesses were not tried",))
        if any(one.overlaps(other) for other in accepted.proven):
            continue
        odds = log_odds_of(one, search, tested)
        if probability_of(odds) < LEAST_CONFIDENCE:
            continue
        one = _best_size(_best_orientation(one, registered, search), registered, search, tested)
        accepted.proven.append(one)
        named = _name_if_unrivalled(one, odds, registered, search)
        if named is not None:
            accepted.named.append(named)
    return accepted


def _name_if_unrivalled(
    one: RegisteredPart, odds: float, registered: Sequence[RegisteredPart], search: Search
) -> Recognised | None:
    """A proven hypothesis, with such log odds, as a named part, measured; None where another taught part, a part of
    another size, or the same part longer or shorter explains the edges and holes as well."""
    one = _best_turn_about_axis(one, search)
    holes = by_holes(one.label, one.pose, search.model, search.images)
    confidence = probability_of(odds + min(holes.nats, 0.0))
    if holes.apart < HOLES_APART or confidence < LEAST_CONFIDENCE:
        return None
    if holes.pose is not one.pose:
        (one,) = register_at(search, [EdgeHypothesis(holes.label, holes.pose, one.tested)])
    competing = (other for other in registered if other.label != one.label and other.overlaps(one))
    if not all(_fits_better(one, other, holes.nats, search) for other in competing):
        return None
    if not _proven_if_cut_off(one, confidence, search):
        return None
    measured, tolerance = one.measured, search.model.parameters.tolerance_mm
    pose = measured.fit.cyclopean_from_part
    if other_size_nats(one.solid, pose, measured.edges, tolerance) >= OTHER_SIZE:
        return None
    if other_radius_nats(one.solid, pose, measured.edges, tolerance) >= OTHER_RADIUS:
        return None
    if not measured.facets:  # of edges alone, without a facet, no part is made
        return None
    same = [other for other in registered if other.label == one.label and other.overlaps(one)]
    return recognised_part(one, confidence, same, search)


def _best_orientation(one: RegisteredPart, registered: Sequence[RegisteredPart], search: Search) -> RegisteredPart:
    """A part, or the same part as it lies there another way, where the edges that it has only that way are there, or
    only that way it rests: with its plain side up a part leaves all the edges of its other side unexplained, and where
    both have one outline, the wrong one sinks into the table or hovers. Another way is registered already, or has
    another facet where this one has the one that shows most. That the part is there is proven: another way pays for the
    test of it only. They are compared as they were registered: measured first, they win in the same 330 of 331 looks,
    which then take a tenth longer."""
    same = [other for other in registered if other.label == one.label and other is not one and other.overlaps(one)]
    over = _turned_over(one, search)
    others = [*same, *register_at(search, over)] if over else same
    ways = _by_odds(other for other in others if _oriented_otherwise(other, one))[:MOST_WAYS]
    likely = [way for way in ways if probability_of(log_odds_of(way, search, len(ways))) >= LEAST_CONFIDENCE]
    if not likely:
        return one
    best = max(likely, key=lambda other: _by_own_edges(other, one))
    return best if _by_own_edges(best, one) > 0 else one


def _turned_over(one: RegisteredPart, search: Search) -> list[EdgeHypothesis]:
    """The part with another facet where this one has the one that shows most: there, and laid onto the table."""
    facet = int((one.solid.facing(one.pose) * np.linalg.norm(one.solid.areas_mm2, axis=1)).argmax())
    turns = frames.inverse(facet_turns(one.solid, facet))
    if not len(turns):
        return []
    over = PoseBatch(SolidBatch.of([one.solid]), np.zeros(len(turns), np.intp), one.pose @ turns)
    if search.ground is not None:
        middle = frames.apply(one.pose, one.solid.centres_mm[facet, None])
        hinges = np.stack([middle, np.zeros((1, 3))], 1).repeat(len(turns), 0)
        down, _ = snapped_poses(over, hinges, search.ground.table, search.images.geometry)
        over = over.and_also(down.chosen((down.poses != over.poses).any((1, 2))))
    return [EdgeHypothesis(one.label, pose) for pose in over.poses]


def _oriented_otherwise(one: RegisteredPart, other: RegisteredPart) -> bool:
    """Whether two of the same part are turned against each other, and not by one of its symmetries."""
    own = indistinguishable_turns(one.solid, tuple(range(len(one.solid.corners_mm))))[:, :3, :3]
    turn = other.pose[:3, :3].T @ one.pose[:3, :3]
    return bool(np.trace(turn @ own.swapaxes(1, 2), axis1=1, axis2=2).max() < ELSE_TURNED)


def _by_own_edges(one: RegisteredPart, other: RegisteredPart) -> float:
    """Return the log odds by which a part is ahead of one at the same place by the edges that only one of them has, and
    by whether it lies on the table."""
    edges = lead_by_own_edges(one.seen, other.seen) - LEAST_APART
    return BY_NATS * edges + ON_TABLE[one.rests] - ON_TABLE[other.rests]


def _best_turn_about_axis(one: RegisteredPart, search: Search) -> RegisteredPart:
    """A round part in the turn about its axis for which its edges and holes speak most; of turns that are alike in
    that, as arcs are much the same in all, the one in which its edges, once measured, lie nearest to where they should
    be. It is no surer for having been turned."""
    turns = turns_about_axis(one.solid)
    if len(turns) == 1:
        return one
    tolerance = search.model.parameters.tolerance_mm

    def nats(other: RegisteredPart) -> float:
        return BY_NATS * other.evidence.nats + hole_nats(other.solid, other.pose, search.images, tolerance)

    def misfit(other: RegisteredPart) -> float:
        pose, edges = other.measured.fit.cyclopean_from_part, other.measured.edges
        return BY_NATS * misfit_nats(other.solid, pose, edges, tolerance)

    turned = list(register_at(search, [EdgeHypothesis(one.label, one.pose @ turn, one.tested) for turn in turns]))
    values = np.array([nats(own) for own in turned])
    peaks = np.nonzero((values > np.roll(values, 1)) & (values >= np.roll(values, -1)))[0]
    likely = peaks[np.argsort(-values[peaks])][:MOST_TURNS]
    near = register_near(search, [EdgeHypothesis(one.label, turned[k].pose, one.tested) for k in likely])
    found = [(values[0], one), *((nats(own), own) for own in near)]
    most = max(own for own, _ in found)
    best = [(own, other) for own, other in found if own > most - ALIKE]
    return best[0][1] if len(best) == 1 else max(best, key=lambda each: each[0] - misfit(each[1]))[1]


def _fits_better(one: RegisteredPart, other: RegisteredPart, holes: float, search: Search) -> bool:
    """Whether of two parts laid at one place it is the first: by the edges that only one of them has, by whether it
    lies on the table, and by nats that its holes have more than those of the other. The print of a face may be where
    another part would have its edges."""
    others, _ = turned_by_holes(other.label, other.pose, search.model, search.images)
    lead = _by_own_edges(one, other) + holes - others
    if abs(lead) >= ALIKE:
        return lead > 0
    own = _other_size(one, search)
    return own < MOST_OFF_SIZE and lead + _other_size(other, search) - own > LEAST_BY_SIZE


def _other_size(one: RegisteredPart, search: Search) -> float:
    """Nats by which another size fits the measured edges of a registered part better than its own."""
    pose, tolerance = one.measured.fit.cyclopean_from_part, search.model.parameters.tolerance_mm
    return other_size_nats(one.solid, pose, one.measured.edges, tolerance)


def _best_size(
    one: RegisteredPart, registered: Sequence[RegisteredPart], search: Search, tested: int
) -> RegisteredPart:
    """Of parts at one place that their own edges do not tell apart, as they differ in size alone, the one whose size
    fits the measured edges best, by LEAST_BY_SIZE and more."""
    alike = {one.label: one}
    for other in registered:
        near = other.label not in alike and other.overlaps(one) and abs(_by_own_edges(one, other)) < ALIKE
        if near and probability_of(log_odds_of(other, search, tested)) >= LEAST_CONFIDENCE:
            alike[other.label] = other
    if len(alike) == 1:
        return one
    best = min(alike.values(), key=lambda each: _other_size(each, search))
    return best if _other_size(one, search) - _other_size(best, search) > LEAST_BY_SIZE else one


def _proven_if_cut_off(one: RegisteredPart, confidence: float, search: Search) -> bool:
    """Whether what is in view of a part proves it and how long it is, where it leaves a picture."""
    images, tolerance = search.images, search.model.parameters.tolerance_mm
    if not leaves_a_picture(one.solid, one.pose, images):
        return True
    return (
        confidence > LEAST_CUT_OFF
        and lead_over_other_lengths(one.solid, one.pose, one.seen, images, tolerance) > LEAST_APART
    )


def _by_odds(registered: Iterable[RegisteredPart]) -> list[RegisteredPart]:
    return sorted(registered, key=lambda one: -one.odds)


def _guess(one: RegisteredPart, apart_px: float) -> NearestGuess:
    ends = [np.stack([seen.edges.start, seen.edges.end], 1) for seen in one.seen]
    return NearestGuess(one.label, ends[0], ends[1], one.seen[0].shows, one.seen[1].shows, apart_px)


def undecided_poses(registered: Sequence[RegisteredPart], tested: int, images: StereoImages) -> list[EdgeHypothesis]:
    """Other poses of the likeliest part at each place, where its edges do not decide whether it is there."""
    places, found = list[RegisteredPart](), list[EdgeHypothesis]()
    for one in registered:
        odds = one.odds - np.log(tested)
        if odds < UNDECIDED[0] or len(places) == MOST_UNDECIDED:
            break
        if count_visible_facets(one.solid, images, one.pose, one.seen) < FEWEST_IN_VIEW or any(
            one.overlaps(there) for there in places
        ):
            continue
        places.append(one)
        if odds < UNDECIDED[1]:
            poses = perturbed_poses(one.solid, one.pose)
            found += [EdgeHypothesis(one.label, pose, one.tested * (1 + len(poses))) for pose in poses]
    return found


def _without_hidden_edges(registered: Sequence[RegisteredPart], tested: int) -> Iterator[RegisteredPart]:
    """Registered hypotheses, the likeliest first; for undecided ones, the edges hidden by nearer objects are left out
    of the evidence."""
    places = list[RegisteredPart]()
    for one in registered:
        odds = one.odds - np.log(tested)
        here = sum(one.overlaps(there) for there in places)
        if HIDDEN_ODDS[0] < odds < HIDDEN_ODDS[1] and here < PER_PLACE and len(places) < MOST_HIDDEN:
            places.append(one)
            yield one.without_hidden()
        else:
            yield one


def log_odds_of(one: RegisteredPart, search: Search, tested: int) -> float:
    """Log odds that a registered hypothesis is true, corrected for the number of hypotheses tested; minus infinity
    below the threshold for a name."""
    if not _may_be_named(one, tested):
        return -np.inf
    odds, beside = one.odds - float(np.log(tested)), 0.0
    if len(one.solid.holes) > 1:
        nats = hole_nats(one.solid, one.pose, search.images, search.model.parameters.tolerance_mm)
        beside = max(nats - MOST_NATS, 0.0)
    if count_visible_facets(one.solid, search.images, one.pose, one.seen) + (beside > SURE_NATS) < FEWEST_IN_VIEW:
        return -np.inf
    again = self_similarity(one.solid, one.pose, search.images.geometry, search.maps[0])
    return odds + beside - BY_ELSEWHERE * max(again - USUAL_ELSEWHERE, 0.0)


def _may_be_named(one: RegisteredPart, tested: int) -> bool:
    """Whether the best that could speak for a laid part besides its edges would make it sure enough for a name."""
    further = MOST_NATS * max(len(one.solid.holes) - 1, 0)
    return probability_of(one.odds - float(np.log(tested)) + further) >= LEAST_CONFIDENCE


def probability_of(log_odds: float) -> float:
    """The probability that log odds mean."""
    return float(1 / (1 + np.exp(-log_odds)))


OF_ODDS = 0.5
"""Of log odds, what counts between places of one part: its edges in one are mostly those in another. With this 99 of
100 poses of a real printed cube are within the 95 % of their covariance, one of 95 is beyond three sigmas; of rendered
parts that edges named 90 and four of 39, of look-alikes 96 and three of 110 (python -m tests.bench.poses)."""


def recognised_part(
    seen: RegisteredPart, confidence: float, same: Sequence[RegisteredPart], search: Search
) -> Recognised:
    """The part with the facets that both cameras have in view, measured where its sides show; same: the same part as it
    was registered there, in this orientation and others."""
    images = search.images
    near = [EdgeHypothesis(seen.label, pose) for pose in perturbed_poses(seen.solid, seen.pose)]
    same = [*same, *register_near(search, near)]
    equivalent = _equivalent_poses(
        seen.solid, seen.pose, np.flatnonzero(seen.solid.facing(seen.pose) > 0).tolist(), images
    )
    fit, numbers = seen.measured.fit, seen.measured.numbers
    pose, covariance = snapped_where_it_lies(search.ground, seen.solid, fit.cyclopean_from_part, fit.covariance)
    reason = f"{100 * seen.evidence.fraction:.0f} % of its expected edges are visible"
    name = Recognition(seen.label, confidence, 0.0, 0.0, None, False, reason, (seen.label,))
    equivalents = _equivalent_poses(seen.solid, pose, numbers, images)
    covariance = covariance + pose_spread(seen, same, equivalent)
    return recognised_at(seen.solid, seen.measured, name, pose, covariance, equivalents)


def _odds_of_pose(one: RegisteredPart) -> float:
    """Log odds of this pose against other poses of the same part, without the correction for the number of poses
    tried."""
    return one.odds + float(np.log(one.tested))


def pose_spread(best: RegisteredPart, same: Sequence[RegisteredPart], equivalent: Array) -> Array:
    """(6, 6) extra covariance of the pose from other poses of the same part that are nearly as likely. equivalent
    (S, 4, 4): the poses at which the part would look the same as at the likeliest one."""
    spread, total = np.zeros((6, 6)), 1.0
    for one in same:
        if one is not best:
            odds = OF_ODDS * (_odds_of_pose(one) - _odds_of_pose(best))
            if _oriented_otherwise(one, best):
                odds = min(odds, _by_own_edges(one, best))
            weight = float(np.exp(odds))
            ways = [frames.difference(one.pose, pose) for pose in equivalent]
            off = min(ways, key=lambda way: float(np.linalg.norm(way / SCALE)))
            spread += weight * np.outer(off, off)
            total += weight
    return spread / total


def _equivalent_poses(solid: Polyhedron, pose: Array, facets: Sequence[int], images: StereoImages) -> Array:
    """(S, 4, 4) equivalent poses: those at which the corners of some facets coincide with corners of the solid at this
    pose (4, 4), which is the first."""
    turns = indistinguishable_turns(solid, tuple(solid.corners_of(facets).tolist()))
    poses = np.asarray(pose @ frames.inverse(turns))
    if not solid.holes or len(poses) == 1:
        return poses
    seen = np.array([hole_nats(solid, one, images) for one in poses])
    return np.asarray(poses[seen > seen[0] - HOLES_APART])
