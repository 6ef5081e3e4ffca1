"""Parts named by straight edges, where no outline closes: printed faces, patterned tables, worn and shining edges.

Corners in space say which taught parts could be there, and where; the segments of both images say how much speaks for
each; the best are laid onto the grey levels. A name needs most of the edges that the part must show, in both eyes, far
more of them than chance would give in this very picture, print that lies on its faces, and no other taught part that
explains the same place nearly as well.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import islice
from typing import NamedTuple

import numpy as np

from daemon import frames
from daemon.vision.facets import weld
from daemon.vision.geometry import Polyhedron, Shape
from daemon.vision.image import Eyes, joined, segment_corners
from daemon.vision.model import Model
from daemon.vision.recognition import Recognised, facet_hypotheses, typed_as
from daemon.vision.registration.beside import COVERED, covered, lies_on
from daemon.vision.registration.corner_pose import Fit
from daemon.vision.registration.different import Different, Guesses, different, pixels
from daemon.vision.registration.directed import DirectedMap, directed_map, evidence, nudged, other_sizes, promising
from daemon.vision.registration.edge_pose import (
    Located,
    clear_share,
    facets_in_view,
    facets_laid,
    fit_of,
    locate,
    shown,
)
from daemon.vision.registration.faces import likeness
from daemon.vision.registration.measured import measured_facet, silhouette
from daemon.vision.registration.space_corners import PoseGuess, guesses_from_space, lookalikes, meet
from daemon.vision.values import Group, NearestGuess, Part, Recognition

Maps = tuple[DirectedMap, DirectedMap]

LOOKED_AT, MOST, PER_PLACE, REACH_MM = 60, 14, 6, 2.5
"""Guesses looked at in the order of what speaks for them; those of them laid onto the images, in all and at one place;
and how far off these may be."""
SEARCHED, FEWEST_LAID = 0.6, 5
"""Of a look's budget, after which no more guesses are asked for, and how many are laid onto the images yet."""
WORTH = 0.6
"""Of the evidence for the best guess at a place, what another there must have to be laid as well."""
LEAST_NATS = 180.0
"""Evidence against chance; e to the so many-th, with what neighbouring places along an edge have in common."""
LEAST_OUTLINE, LEAST_SHOWN, SHOWN_MM = 0.65, 0.72, 0.8
PROVED, SHARE = 1.03, 0.5
"""What the share of edges that are clearly on their place and SHARE of the share of evidence come to at least."""
SAME_SIZE, OTHER_SIZE, BY_SIZE = 1.05, 1.1, 1.2
"""How much more may speak for the part in another size, what is more than chance, and how much more is needed then."""
LEAST_LIKENESS, SAME_PRINT, BY_PRINT = 0.5, 0.97, 0.12
"""Of print in both eyes: less, and it lies elsewhere; more, and so much less of the edges is needed."""
RIVAL = 0.9
"""Another part with so much of the evidence on the same place leaves the name open."""
NEAREST = 0.4
"""Of the evidence there could be, what a guess has that is worth showing."""
BY_EDGES = 0.9
"""Confidence in a name that edges prove: below what recognition is sure of."""


@dataclass(frozen=True, eq=False)
class Laid:
    """A taught part laid onto both images: nats of evidence, their share of what there could be, and what there is for
    the same part in another size; covers: what it covers in the left eye."""

    label: str
    solid: Polyhedron
    located: Located
    fit: Fit
    nats: float
    share: float
    other_sizes: float
    covers: Shape

    def overlaps(self, other: Laid) -> bool:
        """Whether both cannot be there."""
        return self.covers.covers(other.covers) > COVERED


class Straight(NamedTuple):
    """What straight edges name, what came nearest to it where they name nothing, and what there was no time for."""

    named: list[Recognised]
    guesses: tuple[NearestGuess, ...]
    left_out: tuple[str, ...]


def _no_haste() -> float:
    return 0.0


def named_by_segments(
    eyes: Eyes, model: Model, known: Sequence[Recognised], spent: Callable[[], float] = _no_haste
) -> Straight:
    """The taught parts that the straight edges of both images prove, beside those that are named already.

    Unnamed groups of facets say what each could be, and rule out what does not have them. spent: the share of the
    look's budget that is gone.
    """
    if spent() > SEARCHED:
        return Straight([], (), ("straight edges were not looked for",))
    unnamed = [one.group for one in known if not one.named]
    named = [covered(one, model, eyes) for one in known if one.named]
    maps = directed_map(eyes.left), directed_map(eyes.right)
    likely, left_out = _likely(eyes, model, unnamed, named, maps, spent)
    laid = sorted(_laid(eyes, model, likely, maps), key=lambda one: -one.nats)
    proves = cache(lambda k: _proved(laid[k], eyes))
    taken, found = list[Laid](), list[Recognised]()
    for k, one in enumerate(laid):
        if spent() > 1:
            left_out = (*left_out, f"{len(laid) - k} of {len(laid)} guesses were not tried")
            break
        if any(one.overlaps(other) for other in taken) or any(_contradicts(g, one) for g in unnamed) or not proves(k):
            continue
        taken.append(one)
        rivals = [
            m for m, other in enumerate(laid)
            if other.label != one.label and other.nats > RIVAL * one.nats and other.overlaps(one)
        ]  # fmt: skip
        if not any(proves(m) for m in rivals):
            found.append(_recognised(one, laid[rivals[0]].label if rivals else None, eyes, model))
    nearest = list[Laid]()
    for one in laid:
        if one.share > NEAREST and not any(one.overlaps(other) for other in (*taken, *nearest)):
            nearest.append(one)
    return Straight(found, tuple(map(_guess, nearest)), left_out)


def _guess(one: Laid) -> NearestGuess:
    ends = [np.stack([seen.edges.start, seen.edges.end], 1) for seen in one.located.observed]
    shows = [seen.on_place for seen in one.located.observed]
    return NearestGuess(one.label, ends[0], ends[1], shows[0], shows[1])


def _likely(
    eyes: Eyes, model: Model, unnamed: Sequence[Group], named: Sequence[Shape], maps: Maps, spent: Callable[[], float]
) -> tuple[list[Different], tuple[str, ...]]:
    """The likeliest parts and places, and what there was no time to ask."""
    left, right = (segment_corners(joined(view.segments)) for view in eyes.views)
    corners = meet(left, right, eyes.geometry)
    guesses = guesses_from_space(corners, eyes.geometry, model)
    guesses += [PoseGuess(h.label, h.pose[None]) for g in unnamed for f in g.facets for h in facet_hypotheses(f, model)]
    likely, left_out = list[Guesses](), set[str]()
    for guess in guesses:
        if spent() > SEARCHED:
            left_out.add(guess.label)
            continue
        solid = model.metric[guess.label].solid
        poses = promising(solid, guess.poses, eyes.geometry, maps)
        nats, _ = evidence(solid, poses, eyes.geometry, maps)
        good = nats > LEAST_NATS / 3
        middle = poses[:, :3, :3] @ solid.corners_mm.mean(0) + poses[:, :3, 3]
        middle_px = pixels(middle, eyes.geometry)[0]
        for shape in named:
            good &= shape.depth(middle_px) <= 0
        likely.append(Guesses(guess.label, solid, poses[good], -nats[good]))
    kept, first = _worth(likely, eyes, model)
    for one in first:
        better = nudged(model.metric[one.label].solid, one.pose, eyes.geometry, maps)
        kept.append(Different(one.label, better, one.against))
    told = (f"not everywhere was looked for {', '.join(sorted(left_out))}",) if left_out else ()
    if spent() > SEARCHED and len(kept) > FEWEST_LAID:
        told = (*told, f"{len(kept) - FEWEST_LAID} of {len(kept)} guesses were not compared with the pictures")
        kept = kept[:FEWEST_LAID]
    return kept, told


def _laid(eyes: Eyes, model: Model, likely: Sequence[Different], maps: Maps) -> Iterator[Laid]:
    """Parts laid where their edges lie, near likely places."""
    solids = [model.metric[one.label].solid for one in likely]
    poses = np.array([one.pose for one in likely]).reshape(-1, 4, 4)
    located = locate(solids, eyes, poses, REACH_MM, model.parameters.tolerance_mm)
    for (label, *_), solid, at in zip(likely, solids, located, strict=True):
        fit = None if at is None else fit_of(at, LEAST_OUTLINE)
        if at is not None and fit is not None:
            pose = fit.cyclopean_from_part
            nats, most = evidence(solid, pose[None], eyes.geometry, maps)
            others = other_sizes(solid, pose, eyes.geometry, maps) if nats[0] >= LEAST_NATS else 0.0
            covers = silhouette(solid, pose, eyes)
            yield Laid(label, solid, at, fit, float(nats[0]), float(nats[0] / most[0]), others, covers)


def _contradicts(group: Group, one: Laid) -> bool:
    """Whether a group of facets, measured together where the part is laid, has one that lies on none of its faces; a
    lone facet may be a chance of two patterns."""
    pose = one.fit.cyclopean_from_part
    shapes = [Shape.of(facet.left_px) for facet in group.facets]
    inside = [shape.common(one.covers) > shape.area / 2 for shape in shapes]
    return len(shapes) > 1 and any(
        there and not lies_on(facet, one.solid, pose) for facet, there in zip(group.facets, inside, strict=True)
    )


def _worth(likely: Sequence[Guesses], eyes: Eyes, model: Model) -> tuple[list[Different], list[Different]]:
    """The best guesses: a few at each place, for which nearly as much speaks as for the best there; and those best."""
    kept, first, shapes = list[Different](), list[Different](), list[Shape]()
    for one in islice(different(likely, eyes), LOOKED_AT):
        shape = silhouette(model.metric[one.label].solid, one.pose, eyes)
        there = [k for k, other in enumerate(shapes) if other.covers(shape) > COVERED]
        if not there or (len(there) < PER_PLACE and one.against < WORTH * kept[there[0]].against):
            kept.append(one)
            first += [] if there else [one]
            shapes.append(shape)
        if len(kept) == MOST:
            break
    return kept, first


def _proved(one: Laid, eyes: Eyes) -> bool:
    """Whether both images bear a laid part out."""
    pose = one.fit.cyclopean_from_part
    if one.nats < LEAST_NATS or facets_in_view(one.solid, eyes, pose) < 2:
        return False
    alike = likeness(one.solid, pose, eyes)
    if alike is not None and alike < LEAST_LIKENESS:
        return False
    gain = one.other_sizes / one.nats
    needed = PROVED + BY_SIZE * max(0.0, gain - SAME_SIZE)
    if alike is not None and alike > SAME_PRINT and gain < OTHER_SIZE:
        needed -= BY_PRINT
    if clear_share(one.located, eyes) + SHARE * one.share < needed:
        return False
    return shown(one.solid, eyes, pose, SHOWN_MM) >= LEAST_SHOWN


def _recognised(seen: Laid, runner_up: str | None, eyes: Eyes, model: Model) -> Recognised:
    """The part with the facets that both eyes have in view, measured where its sides show."""
    laid = facets_laid(seen.solid, seen.located, eyes)
    facets = typed_as(
        [measured_facet(f, eyes.geometry) for f in laid], (seen.solid.types[f.index] for f in laid), model.library
    )
    pose = seen.fit.cyclopean_from_part
    corners = frames.apply(pose, seen.solid.corners_mm)
    fitted = tuple(corners[seen.solid.rings[f.index]] for f in laid)
    why = f"{100 * seen.share:.0f} % of its edges show as straight lines in both eyes"
    name = Recognition(seen.label, BY_EDGES, 0.0, 0.0, runner_up, False, why, (seen.label,))
    shown_corners = tuple(sorted({corner for f in laid for corner in seen.solid.facets[f.index]}))
    equivalents = np.array([pose @ frames.inverse(turn) for turn in lookalikes(seen.solid, shown_corners)])
    part = Part(name, facets, pose, seen.fit.covariance, seen.fit.residual_mm, fitted, equivalents)
    return Recognised(weld(list(facets)), part)
