"""What recall, and each step and term of recognition, is worth: looks as usual and with one of them left out.

If recall proposes, then without it the parts that facets name lose their names or fall to the edges, and where its
nodes are mislabelled names go wrong with them or fall silent. Once on the scenes kept here, four parts taught from
drawings; once on all of them, taught from their train views, where FACETD_SHARED says they are.

Each step or term is left out of looks at rendered scenes, at parts of the look-alike families' even seeds taught alone
and as strangers, at real pairs of a printed cube, and at heaps of parts: what pays in none of these sets is to be
deleted. Names and poses are counted, as rendered names alone do not show what a step does to the covariance of a real
part.

usage: python -m tests.bench.ablation [COMPONENT ...]
COMPONENT: only these of COMPONENTS, after "nothing"; without any: recall, and all of them.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple
from unittest import mock

import cv2
import numpy as np

from daemon.main import tame_malloc
from daemon.vision import look as look_module
from daemon.vision.evidence import by_edges, counter_evidence, occlusion, overlaps
from daemon.vision.hypotheses import search
from daemon.vision.look import look
from daemon.vision.model.model import Model
from daemon.vision.refine import edge_adjustment
from tests.bench import hard_sets, poses
from tests.bench.look_alikes import MODES, answers
from tests.bench.recognise import matched, test_folders, trained
from tests.bench.simulated_looks import true_rig
from tests.fakes import many_parts, rendered
from tests.fakes.ablated import by_facets, four_drawn, instead, misled, without_recall
from tests.fakes.families import FAMILIES
from tests.fakes.hard_scenes import staged
from tests.fakes.photographed import cell


class Without(NamedTuple):
    """A stand-in for a function of a module, by its name."""

    module: ModuleType
    name: str
    instead: Callable[..., Any]


FAMILY_SEEDS = range(0, 24, 2)
"""Of each family: a pair of every kind."""
HEAP_SEEDS = range(8200, 8232, 2)
"""Of the kinds of heaps, 64 parts taught."""
COMPONENTS: dict[str, Without] = {
    "full-resolution pass": Without(look_module, "_needs_fine_search", lambda _: False),
    "poses refined to edges": Without(look_module, "refined_parts", lambda parts, *_: tuple(parts)),
    "of equivalent poses the one with most facets in view": Without(edge_adjustment, "most_in_view", lambda *_: 0),
    "edge wear": Without(edge_adjustment, "wear_of", lambda _, variance_mm2: (0.0, 0.0)),
    "hypotheses from facets": Without(by_edges, "hypotheses_from_facets", lambda *_: search.RankedHypotheses([], 0)),
    "hypotheses on the table": Without(by_edges, "hypotheses_on_support", lambda *_: search.RankedHypotheses([], 0)),
    "best turn of each hypothesis": Without(search, "best_turned", lambda guesses, *_: _likeliest(guesses)),
    "second registration of undecided hypotheses": Without(by_edges, "undecided_poses", lambda *_: []),
    "covariance from other likely poses": Without(by_edges, "pose_spread", lambda *_: np.zeros((6, 6))),
    "self-similarity": Without(by_edges, "self_similarity", lambda *_: 0.0),
    "parts cut by the image border": Without(by_edges, "leaves_a_picture", lambda *_: False),
    "all counter-evidence": Without(look_module, "verified_names", lambda found, *_: tuple(found)),
    "counter-evidence: missing edges": Without(counter_evidence, "missing_share", lambda _: 0.0),
    "counter-evidence: edges missing in both pictures": Without(counter_evidence, "missing_in_both_px", lambda _: 0.0),
    "counter-evidence: edges off the faces": Without(counter_evidence, "off_faces_px", lambda *_: 0.0),
    "counter-evidence: near-duplicates": Without(
        counter_evidence, "duplicate_lead", lambda *_: counter_evidence.DuplicateLead()
    ),
    "rounded corners": Without(counter_evidence, "resolved_by_rounding", lambda one, *_: one),
    "occlusion": Without(occlusion, "hidden_places", lambda _s, _p, _e, _k, visible, _: np.zeros_like(visible)),
    "occlusion: edges that run straight on across a part": Without(
        occlusion, "_runs_on", lambda _, at, __: np.zeros(len(at), bool)
    ),
    "occlusion in the evidence of hypotheses": Without(
        by_edges, "_without_hidden_edges", lambda registered, *_: registered
    ),
    "check of other sizes": Without(by_edges, "other_size_nats", lambda *_: 0.0),
    "strong edges beside named parts": Without(overlaps, "_strong_beside_px2", lambda *_: 0.0),
}


def _likeliest(guesses: search.ScoredPoses) -> tuple[search.ScoredPoses, Any]:
    kept = search.thinned(guesses)
    kept = kept[np.argsort(guesses.against[kept], kind="stable")[: search.MOST_TURNED]]
    return guesses.chosen(kept), np.ones(len(kept))


@dataclass
class Named:
    """What one model made of every body, by scene and number: its label, the name given (None: silent) and whether
    facets gave it; names given where no body is; processor time of each look, ms."""

    given: dict[tuple[str, int], tuple[str, str | None, bool]] = field(default_factory=dict)
    ghosts: int = 0
    ms: list[float] = field(default_factory=list)


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="ablation", description="What recall and each component is worth.")
    parser.add_argument("component", nargs="*", choices=[*COMPONENTS, []], help="these alone")
    chosen = parser.parse_args(sys.argv[1:] if arguments is None else arguments).component
    cv2.setNumThreads(1)
    tame_malloc()
    if not chosen:
        _recall()
    _components(chosen or list(COMPONENTS))


def _recall() -> None:
    print("the scenes kept here, taught from drawings")
    table(rendered.HERE, four_drawn())
    if rendered.ALL.is_dir():
        print(f"\n{rendered.ALL}, taught from views")
        table(rendered.ALL, trained(rendered.rig(rendered.ALL, "B")))


def _components(chosen: Sequence[str]) -> None:
    """A row for each component left out, each set in its columns."""
    print(f"\n{'left out':<54}{'scenes: right':>14}{'wrong':>6}{'mm':>7}{'in 95 %':>8}{'ms':>6}"
          f"{'families: right':>17}{'strangers':>10}{'real pairs':>12}{'mm':>7}{'in 95 %':>8}"
          f"{'any two':>9}{'mm':>7}{'in 95 %':>8}{'> 3 s':>6}{'ms':>6}{'heaps: right':>14}{'strangers':>10}{'ms':>6}"
    )  # fmt: skip
    for name in ("nothing", *chosen):
        with ExitStack() as stack:
            if name in COMPONENTS:
                module, function, instead_of = COMPONENTS[name]
                stack.enter_context(mock.patch.object(module, function, instead_of))
            print(f"{name:<54}{_of_scenes()}{_of_families()}{_of_real()}{_of_heaps()}", flush=True)


def _of_scenes() -> str:
    if not rendered.ALL.is_dir():
        return f"{'-':>41}"
    model, right, wrong = trained(rendered.rig(rendered.ALL, "B")), 0, 0
    measured, ms = list[poses.QuickMeasurements | None](), list[float]()
    for folder in test_folders(rendered.ALL):
        told = rendered.truth(folder)
        scene = look(*rendered.pair(folder), rendered.rig(rendered.ALL, told["rig"]), model, clock=time.process_time)
        bodies, ghosts = matched(scene, told)
        named = [(body, part) for body, part in bodies if part is not None and part.named]
        good = [(body, part) for body, part in named if part.recognition.label == body["label"]]
        right, wrong = right + len(good), wrong + len(named) - len(good) + len(ghosts)
        measured += [poses.measured_as_drawn(body, part, model) for body, part in good]
        ms.append(1000 * sum(scene.seconds.values()))
    return f"{right:>14}{wrong:>6}{_places(measured)}{np.median(ms):>6.0f}"


def _of_families() -> str:
    found = [a for family, seed in product(FAMILIES, FAMILY_SEEDS) for a in answers(family, seed, MODES[1:])]
    tell = [a for a in found if a.tells]
    return f"{sum(a.right for a in tell):>17}{sum(a.wrong for a in tell):>10}"


def _of_real() -> str:
    if not poses.REAL.is_dir():
        return f"{'-':>12}"
    taken = list(poses._frames())
    pairs, any_two = (poses._real(each) for each in (zip(taken[::2], taken[1::2], strict=True), poses._any_two(taken)))
    far = sum(one is not None and one.chi_square > poses.WITHIN_3_SIGMAS for one, _ in any_two)
    named = [sum(one is not None for one, _ in looks) for looks in (pairs, any_two)]
    first, second = (_places([one for one, _ in looks]) for looks in (pairs, any_two))
    return f"{named[0]:>12}{first}{named[1]:>9}{second}{far:>6}{np.median([ms for _, ms in any_two]):>6.0f}"


def _of_heaps() -> str:
    parts = many_parts.drawn_parts(hard_sets.TAUGHT + hard_sets.STRANGERS)
    shown, strangers = parts[: hard_sets.TAUGHT], parts[hard_sets.TAUGHT :]
    rig, model, row = true_rig(cell()), many_parts.taught(shown, None), hard_sets.Row()
    for kind, seed in product(("heap", "all"), HEAP_SEEDS):
        hard_sets.take_look(staged(kind, seed, shown, strangers), rig, model, row)
    return f"{f'{row.right} of {row.asked}':>14}{row.invented:>10}{np.median(row.ms):>6.0f}"


def _places(measured: Sequence[poses.QuickMeasurements | None]) -> str:
    found = [one for one in measured if one is not None]
    inside = np.mean([one.chi_square < poses.WITHIN_95 for one in found])
    return f"{np.mean([one.off_mm for one in found]):>7.3f}{inside:>8.1%}"


def table(home: Path, model: Model) -> None:
    """A row for each way, and the names that changed."""
    rows = ablated(home, model)
    usual, wrong_name = rows["nothing"], instead(model)
    print(f"{'left out':<12}{'bodies':>7}{'right':>7}{'by facets':>11}{'silent':>8}{'wrong':>7}{'follow':>8}"
          f"{'strangers named':>17}{'ghosts':>8}{'ms 50 %':>9}{'95 %':>7}")  # fmt: skip
    for way, row in rows.items():
        taught = [(label, name, facets) for label, name, facets in row.given.values() if label in model.labels]
        wrong = [(label, name) for label, name, _ in taught if name not in (None, label)]
        right = [facets for label, name, facets in taught if name == label]
        follow = sum(wrong_name[label] == name for label, name in wrong)
        others = sum(name is not None for label, name, _ in row.given.values() if label not in model.labels)
        middle, most = np.percentile(row.ms, [50, 95])
        print(f"{way:<12}{len(taught):>7}{len(right):>7}{sum(right):>11}{len(taught) - len(right) - len(wrong):>8}"
              f"{len(wrong):>7}{follow:>8}{others:>17}{row.ghosts:>8}{middle:>9.0f}{most:>7.0f}")  # fmt: skip
    for way, row in rows.items():
        if row is not usual:
            print(
                f"{way}: of {len(_by_facets(usual))} that facets name, {_kept(usual, row)} keep their names by facets"
            )
            _changes(usual, row)


def ablated(home: Path, model: Model) -> dict[str, Named]:
    """What is named in the scenes of a folder: with nothing left out, without recall, and with recall misled."""
    models = {"nothing": model, "recall": without_recall(model), "its labels": misled(model)}
    return {way: _named(home, one) for way, one in models.items()}


def _named(home: Path, model: Model) -> Named:
    row = Named()
    for folder in test_folders(home):
        told = rendered.truth(folder)
        scene = look(*rendered.pair(folder), rendered.rig(home, told["rig"]), model, clock=time.process_time)
        bodies, ghosts = matched(scene, told)
        for number, (body, part) in enumerate(bodies):
            name = part.recognition.label if part is not None and part.named else None
            row.given[folder.name, number] = body["label"], name, part is not None and by_facets(part)
        row.ghosts += len(ghosts)
        row.ms.append(1000 * sum(scene.seconds.values()))
    return row


def _by_facets(row: Named) -> list[tuple[str, int]]:
    """The bodies that facets named rightly."""
    return [body for body, (label, name, facets) in row.given.items() if facets and name == label]


def _kept(usual: Named, row: Named) -> int:
    """How many that facets name rightly as usual have that name by facets yet."""
    return len(set(_by_facets(usual)) & set(_by_facets(row)))


def _changes(usual: Named, row: Named) -> None:
    for body, (label, name, facets) in row.given.items():
        _, before, by = usual.given[body]
        if (name, facets) != (before, by):
            was, now = (f"{n or 'silent'}{' by facets' if f else ''}" for n, f in ((before, by), (name, facets)))
            print(f"  {body[0]} {label}: {was} -> {now}")


if __name__ == "__main__":
    main()
