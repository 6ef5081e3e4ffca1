"""Many looks at one thing: next best views beside the fixed ones, on twins and on heaps; and what facets are found.

`python -m tests.bench.long.looks [TWINS [HEAPS [FOUND]]]`, in the simulated cell with its hand-eye and arm errors.
Twins: a block, the same with an edge cut off and with a step, of three sizes, nine taught; one lies there, and only
first looks that show something and name nothing count. Heaps: five of the four usual parts pushed together on the table
until they touch. Each is looked at by `look around`, and from the survey views, where looks are told by themselves and
fused. FOUND heaps are looked at from all round to count how many of the facets that show are found
(daemon/pick/planning/next_view.py, FOUND).
"""

from __future__ import annotations

import sys
from collections import defaultdict
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from daemon import frames
from daemon.arm.motion import NotSentError
from daemon.arrays import Array
from daemon.pick.fused_objects import fuse_objects
from daemon.pick.looks import Look
from daemon.pick.planning.next_view import viewpoints_round
from daemon.pick.seen import ObservedPart, seen_parts
from daemon.pick.settings import SurveyView
from daemon.store.library import load_facets
from daemon.vision.geometry import exact, visible_from
from daemon.vision.model import learn_solid
from daemon.vision.model.model import Model, empty_model
from drivers.simcell.parts import TAUGHT, PartShape, part_shape, shape
from drivers.simcell.truth import load_truth
from tests.fakes.drawn import obj, prism, solid
from tests.fakes.heaps import heap
from tests.fakes.in_time import lived
from tests.fakes.photographed import ETC
from tests.fakes.simulated_hours import Hours, cell_in_time

TWINS, HEAPS, FOUND = 200, 60, 0
IN_HEAP, LOOKS, MORE = 5, 4, 2
SIZES = ((60, 45, 40), (50, 50, 35), (70, 40, 30))
TILTS, HEADINGS = (5.0, 25.0, 45.0), (50.0, -50.0, 90.0)
NEAR_MM, FAR_OFF_MM = 12.0, 480.0
EVERY = 5
WAYS = "next best, fused", "survey views, fused", "survey views, each by itself"
COSINES = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.01)
TABLE = load_truth(ETC / "simcell.yaml").table


def twins() -> tuple[Model, list[PartShape]]:
    """Nine parts of three sizes that differ in a side or two, taught from their drawings."""
    model, shapes = empty_model(load_facets()), []
    for a, b, height in SIZES:
        whole = [(0.0, 0.0), (a, 0), (a, b), (0, b)]
        cut = [(0.0, 0.0), (a, 0), (a, b), (18, b), (0, b - 18)]
        front = [(0.0, 0.0), (a, 0), (a, 0.6 * b), (0, 0.6 * b)]
        back = [(a / 2, 0.6 * b), (a, 0.6 * b), (a, b), (a / 2, b)]
        step = [(0.0, 0.0), (a, 0), (a, b), (a / 2, b), (a / 2, 0.6 * b), (0, 0.6 * b)]
        for name, outline, pieces in (("block", whole, [whole]), ("cut", cut, [cut]), ("step", step, [front, back])):
            label = f"{name}_{a}"
            model = _learnt(model, label, *prism(outline, height))
            shapes.append(shape(label, *(prism(piece, height)[0] for piece in pieces)))
    return model, shapes


def usual() -> Model:
    """The four usual parts, taught from their drawings."""
    model = empty_model(load_facets())
    for label in TAUGHT:
        hull = part_shape(label).hull
        model = _learnt(model, label, hull.vertices, list(hull.faces))
    return model


def _learnt(model: Model, label: str, corners: Array, rings: Any) -> Model:
    return learn_solid(model, solid(f"{label}.obj", obj(corners, rings)), label)


def right_and_wrong(here: Hours, found: Sequence[ObservedPart]) -> tuple[int, int]:
    """How many parts that lie there have their name, and how many names are none's."""
    right, wrong = set[str](), 0
    for one in (part for part in found if part.named):
        shape_of = here.cycle.recogniser.shape(one.label)
        assert shape_of is not None
        middle = frames.apply(one.world_from_part, shape_of.corners_mm).mean(axis=0)
        own = [p.name for p in here.cell.world.parts if p.label == one.label and _off(p, middle) < NEAR_MM]
        right |= set(own)
        wrong += not own
    return len(right), wrong


def _off(part: Any, middle: Array) -> float:
    return float(np.linalg.norm(frames.apply(part.pose, part.shape.hull.vertices).mean(axis=0) - middle))


async def by_themselves(
    here: Hours, first: SurveyView, more: Sequence[SurveyView]
) -> tuple[list[Look], list[ObservedPart], list[ObservedPart]]:
    """Looks from fixed places: they, what each names by itself, and what they do together."""
    looks = []
    for view in (first, *more):
        await here.cycle.move_to(view.pose(here.cycle.cell.mounting), "survey")
        looks.append(await here.cycle.look())
    assert here.cycle.recogniser is not None
    together = fuse_objects(looks, here.cycle.recogniser, here.cycle.settings.doubt)
    return looks, [part for one in looks for part in seen_parts(one) if part.named], together


async def compared(here: Hours, first: SurveyView, more: int) -> tuple[bool, dict[str, tuple[int, int]], int]:
    """Whether the first look shows something and names nothing; right and wrong by each way; how many looks the next
    best took."""
    settings = here.cycle.settings
    await here.cycle.move_to(first.pose(here.cycle.cell.mounting), "first")
    best = await here.cycle.look_around(more)
    views = [v for v in (*settings.surveys, *settings.last_surveys) if v.heading_deg != first.heading_deg][:more]
    _, alone, together = await by_themselves(here, first, views)
    answers = zip(WAYS, (best.found, together, alone), strict=True)
    shown = best.looks[0].scene.parts
    ambiguous = bool(shown) and not any(part.named for part in shown)
    return ambiguous, {way: right_and_wrong(here, found) for way, found in answers}, len(best.looks)


async def twin(seed: int, model: Model, shapes: list[PartShape]) -> tuple[bool, dict[str, tuple[int, int]], int] | None:
    """One of the twins, anyhow on the table, looked at from anywhere; None where the arm does not get there."""
    rng = np.random.default_rng(seed)
    async with cell_in_time(seed, model) as here:
        here.cell.world.draw(shapes)
        own = shapes[int(rng.integers(len(shapes)))]
        x, y = np.array(TABLE.centre_mm) + rng.uniform(-40, 40, 2)
        here.cell.world.stand(own.label, int(rng.integers(len(own.rests))), x, y, rng.uniform(-np.pi, np.pi))
        at = float(x), float(y), TABLE.height_mm + 20.0
        view = SurveyView(at, FAR_OFF_MM, float(rng.choice(HEADINGS)), float(rng.choice(TILTS)))
        try:
            return await compared(here, view, MORE)
        except NotSentError:
            return None


async def pile(seed: int, model: Model) -> tuple[bool, dict[str, tuple[int, int]], int]:
    """A heap, looked at from the first survey view."""
    rng = np.random.default_rng(seed)
    async with cell_in_time(seed, model) as here:
        _heap(here, rng)
        return await compared(here, here.cycle.settings.surveys[0], LOOKS - 1)


def _heap(here: Hours, rng: np.random.Generator) -> None:
    labels = [str(label) for label in rng.choice(TAUGHT, IN_HEAP)]
    heap(here.cell.world, labels, np.array([*TABLE.centre_mm, TABLE.height_mm]), rng)


async def facets_found(seed: int, model: Model, rows: list[tuple[float, bool, bool]]) -> None:
    """Of each facet that faces the cameras: its cosine, whether it shows whole, whether it was found."""
    rng = np.random.default_rng(seed)
    async with cell_in_time(seed, model) as here:
        _heap(here, rng)
        solids = [exact(frames.apply(p.pose, p.shape.hull.vertices), p.shape.hull.faces) for p in here.cell.world.parts]
        middle = np.mean([one.corners_mm.mean(axis=0) for one in solids], axis=0)
        for pose in rng.permutation(viewpoints_round(middle, here.cycle.cell.mounting))[:12]:
            try:
                await here.cycle.move_to(pose, "round")
            except NotSentError:
                continue
            look = await here.cycle.look()
            camera, rig = look.world_from_cyclopean[:3, 3], look.taken.rig
            seen = [frames.apply(look.world_from_cyclopean, f.corners_mm) for p in look.scene.parts for f in p.facets]
            for one in solids:
                away = camera - one.corners_mm.mean(axis=0)
                away = away[None] / np.linalg.norm(away)
                others = [other.corners_mm[ring] for other in solids if other is not one for ring in other.rings]
                alone, whole = (visible_from(one, away, COSINES[0], some)[0] for some in ((), others))
                for k in np.flatnonzero(alone):
                    ring = one.corners_mm[one.rings[k]]
                    px = rig.left.project(frames.apply(frames.inverse(look.world_from_cyclopean), ring))
                    if px.min() > 8 and (px < np.array(rig.image_size) - 8).all():
                        hit = any(len(s) == len(ring) and _apart(s, ring) < 5.0 for s in seen)
                        rows.append((float(away[0] @ one.normals[k]), bool(whole[k]), hit))


def _apart(a: Array, b: Array) -> float:
    return float(np.linalg.norm(a[:, None] - b, axis=2).min(axis=0).max())


def main(some: int = TWINS, heaps: int = HEAPS, found: int = FOUND) -> None:
    """Measure and print; a table after each five."""
    model, shapes = twins()
    tally, looks = defaultdict[str, list[tuple[int, int]]](list), list[int]()
    for k in range(some):
        one = lived(twin(7000 + k, model, shapes))
        if one is not None and one[0]:
            looks.append(one[2])
            for way, answer in one[1].items():
                tally[way].append(answer)
        if looks and ((k + 1) % EVERY == 0 or k + 1 == some):
            print(f"\n{len(looks)} of {k + 1} first looks at twins leave them open; up to {MORE} more each:")
            _table(tally, 1)
    model, tally, looks = usual(), defaultdict(list), []
    for k in range(heaps):
        _, answers, count = lived(pile(5000 + k, model))
        looks.append(count)
        for way, answer in answers.items():
            tally[way].append(answer)
        if (k + 1) % EVERY == 0 or k + 1 == heaps:
            print(f"\n{k + 1} heaps of {IN_HEAP}, at most {LOOKS} looks each (next best: {np.mean(looks):.2f}):")
            _table(tally, IN_HEAP)
    rows = list[tuple[float, bool, bool]]()
    for k in range(found):
        lived(facets_found(6000 + k, model, rows))
    every = np.array(rows, float).reshape(-1, 3)
    for low, high in pairwise(COSINES):
        here = every[(every[:, 0] >= low) & (every[:, 0] < high)]
        told = [f"{s[:, 2].mean():5.2f} of {len(s):4d}" for s in (here[here[:, 1] == w] for w in (1, 0)) if len(s)]
        if told:
            print(f"facets at a cosine of {low:.1f} to {min(high, 1):.1f}: found whole, covered: {', '.join(told)}")


def _table(tally: dict[str, list[tuple[int, int]]], of: int) -> None:
    for way, answers in tally.items():
        right, wrong = np.sum(answers, axis=0)
        print(f"  {way:30s} named right {100 * right / (of * len(answers)):5.1f} %, wrong names {wrong}", flush=True)


if __name__ == "__main__":
    main(*(int(word) for word in sys.argv[1:]))
