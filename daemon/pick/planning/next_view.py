"""The next best view: the viewpoint with the largest expected reduction of entropy per second.

An unnamed object has hypotheses: taught parts in poses, and an untaught object. Each predicts which facets a look from
a viewpoint shows, without those that face away or are covered; a visible facet is detected at a measured rate. A look
distinguishes hypotheses whose predictions differ by more than the cameras' error. Pure: hypotheses and viewpoints in,
bits and an order out. Source: expected entropy after an observation (Lindley 1956); of views, Denzler and Brown (2002).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import compress

import numpy as np

from daemon import frames
from daemon.arm import CameraMounting, Reach
from daemon.arrays import Array
from daemon.pick.planning import viewpoints
from daemon.pick.recogniser import PartRecogniser
from daemon.pick.seen import ObservedPart
from daemon.pick.settings import SurveyView
from daemon.vision.facets import merge_vertices
from daemon.vision.geometry import Polyhedron, StereoRig, area_vector, chi_square_limit, corner_covariance, visible_from
from daemon.vision.values import UNKNOWN, Group

CLOSE_MM = 340.0
"""Viewing distance for a further look at an unnamed part."""
TILTS_DEG = (5, 20, 35, 50)
"""Tilts of these viewpoints from straight down."""
COSINES, DETECTION_RATES = (0.1, 0.15, 0.25, 0.35, 0.5, 0.85, 0.95), (0.0, 0.15, 0.6, 0.85, 0.9, 0.87, 0.5)
"""Detection rate of a wholly visible facet by its cosine to the cameras (tests/bench/long/looks.py)."""
COVERED_FACTOR = 0.55
"""Factor on that rate where another object covers any of the facet."""
LEAST_CHANCE, MOST_HYPOTHESES = 1e-3, 24
"""Hypotheses less likely than this, or beyond this number, are left out of the choice of viewpoints."""
MOST_FACETS = 8
"""Maximum number of distinguishing facets that are used."""
LEAST_SHARE = 0.005
IN_TABLE_MM = 6.0
"""A hypothesis may reach this far into the table, since its pose is uncertain."""
LEAST_BITS = 0.02
"""Least expected gain that is worth a look."""
SAME_FACET_TAIL = 1e-3
"""Facets are different if the same facet's corners are this far apart with less than this probability."""


@dataclass(frozen=True, eq=False)
class PartHypothesis:
    """A hypothesis for an object: solid at world_from_part (4, 4) with covariance (6, 6); facets: the solid's facet for
    each observed one. For an untaught object, UNKNOWN, the solid consists of the observed facets."""

    label: str
    solid: Polyhedron
    world_from_part: Array
    covariance: Array
    facets: tuple[int, ...]
    probability: float


@dataclass(frozen=True, eq=False)
class HypothesisSet:
    """Distinct hypotheses, with a number for each facet of each: equal numbers mean the same facet in space. The first
    `seen` numbers are of observed facets."""

    hypotheses: tuple[PartHypothesis, ...]
    numbers: tuple[Array, ...]
    seen: int

    @property
    def chances(self) -> Array:
        """(H,) normalised probabilities."""
        every = np.array([h.probability for h in self.hypotheses])
        return np.asarray(every / every.sum())

    @property
    def entropy(self) -> float:
        """Bits."""
        return entropy(self.chances)


@dataclass(frozen=True)
class Gain:
    """Expected gain of a look from a viewpoint, by its number: bits, and the time until then."""

    place: int
    bits: float
    seconds: float


def hypotheses_of(
    part: ObservedPart, recogniser: PartRecogniser, table_z_mm: float | None
) -> tuple[PartHypothesis, ...]:
    """What a part without a name may be, in world: all that recognition lets stand and the table leaves room for, and
    something not taught, last. Where nothing that was taught explains all its facets together, what explains one of
    them, the largest first."""
    world_from_look = part.look.world_from_cyclopean
    facets = sorted(part.facets, key=lambda f: -float(np.linalg.norm(area_vector(f.corners_mm))))
    for some in (part.facets, *((f,) for f in facets)):
        group = merge_vertices(some)
        found = [
            PartHypothesis(
                one.label,
                solid,
                world_from_look @ one.pose,
                frames.transport_covariance(world_from_look, one.covariance),
                one.facets,
                one.probability,
            )
            for one in recogniser.candidate_poses(group)
            if (solid := recogniser.shape(one.label)) is not None
        ]
        left = max(1.0 - sum(h.probability for h in found), 0.0)
        found = [h for h in found if table_z_mm is None or _above(h, table_z_mm)]
        if found:
            break
    else:
        group, left = merge_vertices(part.facets), 1.0
    here = untaught_hypothesis(part, group, left)
    whole = left + sum(h.probability for h in found)
    return tuple(replace(h, probability=h.probability / whole) for h in (*found, here))


def untaught_hypothesis(part: ObservedPart, group: Group | None = None, probability: float = 1.0) -> PartHypothesis:
    """The hypothesis that a part, or a group of its facets, was not taught."""
    seen = (group or merge_vertices(part.facets)).polyhedron
    every = tuple(range(len(seen.facets)))
    return PartHypothesis(UNKNOWN, seen, part.look.world_from_cyclopean, np.zeros((6, 6)), every, probability)


def _above(h: PartHypothesis, table_z_mm: float) -> bool:
    """Whether the hypothesis does not reach into the table."""
    return bool(frames.apply(h.world_from_part, h.solid.corners_mm)[:, 2].min() > table_z_mm - IN_TABLE_MM)


def hypotheses_in_words(hypotheses: Sequence[PartHypothesis]) -> str:
    """`cube 62 %, pyramid 30 %, not taught 8 %`: by label, the likeliest first, what was not taught last."""
    shares: dict[str, float] = {}
    for h in hypotheses:
        shares[h.label] = shares.get(h.label, 0.0) + h.probability
    not_taught = shares.pop(UNKNOWN, 0.0)
    ranked_shares = sorted(shares.items(), key=lambda one: -one[1])
    texts = [f"{label} {100 * share:.0f} %" for label, share in ranked_shares if share >= LEAST_SHARE]
    return ", ".join([*texts, f"not taught {100 * not_taught:.0f} %"])


def entropy(chances: Array) -> float:
    """Bits of probabilities (H,)."""
    some = chances[chances > 0]
    return float(-(some * np.log2(some)).sum())


def expected_entropy(chances: Array, shows: Array) -> float:
    """Bits that are left on average after a look that finds each of some facets or does not. chances (H,); shows (H, C)
    how often each is found under each hypothesis, independently of the others.

    Never more than before: what is reckoned with is a part of what the look will show.
    """
    mean = chances @ shows
    tells = chances @ (shows - mean) ** 2
    columns = np.argsort(-tells)[: min(MOST_FACETS, int((tells > 1e-12).sum()))]
    ways = (np.arange(2 ** len(columns))[:, None] >> np.arange(len(columns))) & 1
    each = np.where(ways[:, None, :], shows[None, :, columns], 1 - shows[None, :, columns])
    joint = each.prod(axis=2) * chances
    total = joint.sum(axis=1, keepdims=True)
    share = joint / np.maximum(total, 1e-300)
    logs = np.log2(np.maximum(share, 1e-300))
    return float(-(joint * logs).sum())


def distinct_hypotheses(hypotheses: Sequence[PartHypothesis], rig: StereoRig) -> HypothesisSet:
    """Which facets of hypotheses (the last: something not taught) the cameras could not tell apart from so far; those
    that have the same label and the same facets count once, with the sum of what they were given."""
    *taught, untaught = hypotheses
    taught = sorted((h for h in taught if h.probability >= LEAST_CHANCE), key=lambda h: -h.probability)
    kept = [untaught, *taught[:MOST_HYPOTHESES]]
    noise_mm2 = float(np.trace(corner_covariance(rig, CLOSE_MM))) / 3
    known = _FacetsInSpace()
    numbers = [known.numbers(h, noise_mm2) for h in kept]
    once: dict[tuple[str, frozenset[int]], tuple[PartHypothesis, Array]] = {}
    for h, own in zip(kept, numbers, strict=True):
        key = h.label, frozenset(own.tolist())
        before = once[key][0].probability if key in once else 0.0
        first, numbered = once.get(key, (h, own))
        once[key] = replace(first, probability=before + h.probability), numbered
    found, theirs = zip(*once.values(), strict=True)
    return HypothesisSet(tuple(found), tuple(theirs), len(untaught.facets))


class _FacetsInSpace:
    """Distinct facets in space, numbered in the order in which they are added."""

    def __init__(self) -> None:
        self.corners: list[Array] = []
        self.covariances: list[Array] = []

    def numbers(self, h: PartHypothesis, noise_mm2: float) -> Array:
        """(F,) the number of each of a hypothesis's facets: that of the seen one it explains, of one that is where it
        is, or a new one."""
        placed = frames.apply(h.world_from_part, h.solid.corners_mm)
        motion = frames.point_motion(placed - h.world_from_part[:3, 3])
        spread = motion @ h.covariance @ np.swapaxes(motion, 1, 2) + noise_mm2 * np.eye(3)
        explains = {facet: k for k, facet in enumerate(h.facets)}
        found = []
        for f, ring in enumerate(h.solid.rings):
            number = explains[f] if self.corners and f in explains else self._same(placed[ring], spread[ring])
            if number == len(self.corners):
                self.corners.append(placed[ring])
                self.covariances.append(spread[ring])
            found.append(number)
        return np.array(found, np.intp)

    def _same(self, corners: Array, covariance: Array) -> int:
        """The number of the first facet at this position, or the next number."""
        count = len(corners)
        most, middle = chi_square_limit(3 * count, SAME_FACET_TAIL), corners.mean(0)
        for number, (other, its) in enumerate(zip(self.corners, self.covariances, strict=True)):
            if len(other) != count:
                continue
            off, widest = middle - other.mean(0), float(np.trace(covariance + its, axis1=1, axis2=2).max())
            if float(off @ off) > most * widest:
                continue
            for turn in range(count):
                apart = corners - np.roll(other, turn, axis=0)
                both = covariance + np.roll(its, turn, axis=0)
                if float(np.einsum("ni,ni->", apart, np.linalg.solve(both, apart[..., None])[..., 0])) < most:
                    return number
        return len(self.corners)


def visible_facets(competing: HypothesisSet, centre: Array, centres: Array, beside: Sequence[Array] = ()) -> Array:
    """(V, H, C) how often each facet is found from cameras (V, 3), under each hypothesis; the last is whatever
    something not taught shows besides what was seen, wherever one that was taught would show a new facet. centre (3,):
    what is looked at; beside: polygons (N, 3) of other things that may cover it. All world, mm."""
    towards = centres - centre
    towards = towards / np.linalg.norm(towards, axis=1, keepdims=True)
    count = 1 + max(int(own.max()) for own in competing.numbers)
    found = np.zeros((len(centres), len(competing.hypotheses), count + 1))
    for k, (h, own) in enumerate(zip(competing.hypotheses, competing.numbers, strict=True)):
        turned = towards @ h.world_from_part[:3, :3]
        part_from_world = frames.inverse(h.world_from_part)
        others = [frames.apply(part_from_world, ring) for ring in beside]
        often = np.interp(turned @ h.solid.normals.T, COSINES, DETECTION_RATES)
        alone, free = (visible_from(h.solid, turned, COSINES[0], some) for some in ((), others))
        found[:, k, own] = often * np.where(free, 1.0, np.where(alone, COVERED_FACTOR, 0.0))
    strange = [h.label == UNKNOWN for h in competing.hypotheses]
    found[:, strange, -1] = found[:, :, competing.seen : count].max(axis=(1, 2), initial=0.0)[:, None]
    return found


def without_seen_facets(competing: HypothesisSet, shows: Array) -> HypothesisSet:
    """Downweight hypotheses whose facets earlier looks should have shown, shows (V, H, C), but did not."""
    speaks = np.prod(1 - shows[:, :, competing.seen :], axis=(0, 2))
    weights = competing.chances * speaks
    weights = weights / weights.sum() if weights.sum() > 0 else competing.chances
    weighed = [replace(h, probability=float(w)) for h, w in zip(competing.hypotheses, weights, strict=True)]
    return replace(competing, hypotheses=tuple(weighed))


def ranked_gains(competing: HypothesisSet, shows: Array, seconds: Sequence[float]) -> list[Gain]:
    """Gains of the viewpoints, by expected bits per second, largest first. shows (V, H, C)."""
    before, chances = competing.entropy, competing.chances
    gains = [Gain(v, max(before - expected_entropy(chances, one), 0.0), seconds[v]) for v, one in enumerate(shows)]
    return sorted(gains, key=lambda g: -g.bits / g.seconds)


def viewpoints_round(
    centre: Array, mounting: CameraMounting, distance_mm: float = CLOSE_MM, tilts: Sequence[float] = TILTS_DEG
) -> list[Array]:
    """Viewpoints around an object at centre (3,), world: world_from_tool (4, 4) each."""
    x, y, z = (float(v) for v in centre)
    views = [SurveyView((x, y, z), distance_mm, float(h), float(t)) for h in range(-180, 180, 30) for t in tilts]
    return [view.pose(mounting) for view in views]


def reachable_poses(poses: Sequence[Array], reach: Reach) -> list[Array]:
    """The poses, world_from_tool (4, 4), that the arm can reach."""
    return list(compress(poses, reach.allows_each(np.reshape(poses, (-1, 4, 4)))))


def next_best(
    hypotheses: Sequence[PartHypothesis],
    rig: StereoRig,
    centre: Array,
    centres: Array,
    seconds: Sequence[float],
    centres_before: Array,
    beside: Sequence[Array] = (),
) -> list[Gain]:
    """Places the cameras may be brought to, centres (V, 3), in the order in which to try them: by what a look from
    there settles for its seconds; where none settles anything, the farthest from all looks before, centres_before (L,
    3), first. beside: polygons (N, 3) of other things. All world, mm."""
    look = distinct_hypotheses(hypotheses, rig)
    look = without_seen_facets(look, visible_facets(look, centre, centres_before, beside))
    gains = ranked_gains(look, visible_facets(look, centre, centres, beside), seconds)
    if gains and max(g.bits for g in gains) >= LEAST_BITS:
        return gains
    by_place = {g.place: g for g in gains}
    return [by_place[place] for place in farthest_viewpoint(centre, centres, centres_before)]


def farthest_viewpoint(
    centre: Array, centres: Sequence[Array] | Array, centres_before: Sequence[Array] | Array
) -> list[int]:
    """Viewpoints, by their numbers, in order of the angle about a point from all earlier ones, largest first."""
    away = [min(viewpoints.angle_at(centre, place, old) for old in centres_before) for place in centres]
    return sorted(range(len(away)), key=lambda place: -away[place])
