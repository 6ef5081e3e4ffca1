"""Makes the constants of daemon/vision/evidence/counter_evidence.py again: what speaks against a part tells near twins.

Without an option: DUPLICATE, BY_MISSING, BY_BOTH, BY_OFF and BY_RIVAL are fitted to what is kept in
tests/data/near_twins.csv and held beside the code's, and each kind of evidence is left out in turn. With `--dump` that
table is made anew: what speaks against each part, at its final pose, that is named while the check is switched off,
over the shared scenes and the look-alike families' even seeds, where the part alone is taught and where its twin alone
is; looks that show nothing by which the two differ are left out. With `--held-out` the odd seeds are looked at: names
lost and strangers left. Choose nothing by them.

usage: python -m tests.bench.missing [--dump | --held-out] [PAIRS]
PAIRS a family. FACETD_RENDERED names a folder that keeps what was rendered.
"""

from __future__ import annotations

import argparse
import csv
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import combinations, product
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from daemon.arrays import Array
from daemon.main import tame_malloc
from daemon.vision.evidence import counter_evidence
from daemon.vision.evidence.counter_evidence import CounterEvidence
from daemon.vision.geometry import StereoRig
from daemon.vision.image import StereoImages, open_stereo
from daemon.vision.look import look
from daemon.vision.model.model import Model
from daemon.vision.values import Part, Scene
from tests.bench.look_alikes import _judged, _model, shown
from tests.bench.recognise import matched, test_folders, trained
from tests.bench.simulated_looks import true_rig
from tests.fakes import rendered
from tests.fakes.distinguishable import TELLS_MM, telling_mm
from tests.fakes.families import FAMILIES
from tests.fakes.photographed import Image, cell

KEPT = Path(__file__).resolve().parents[1] / "data" / "near_twins.csv"
PAIRS = 40
PRIOR = 0.015
"""Of what is seen and fits, so much is a near twin that was never taught: seldom, or it would have been taught."""
RIDGE = 0.05
"""Inverse variance of what a weight may be beforehand: a kind of evidence that no right part has would weigh without
end."""
LOST = 0.02
"""The share of right names at whose loss kinds of evidence are compared."""
KINDS = ("missing", "missed by both", "off its faces", "a near-duplicate")
TOLD_S = 20.0


class Seen(NamedTuple):
    """Of one named part: the set and family it is of, its seed or scene, whether the name is right (else it is a near
    twin's), and what speaks against it."""

    set: str
    family: str
    seed: str
    right: bool
    against: CounterEvidence


class Fit(NamedTuple):
    """Log odds that a part is a near twin: where nothing speaks against it, and their slopes by each of the KINDS; the
    standard errors of all."""

    weights: Array
    errors: Array


def main(arguments: list[str] | None = None) -> None:
    told = _arguments(sys.argv[1:] if arguments is None else arguments)
    cv2.setNumThreads(1)
    tame_malloc()
    if told.held_out:
        _what_it_does("held out", list(families(range(1, 2 * told.pairs, 2))))
        return
    if told.dump:
        if not rendered.ALL.is_dir():
            print(f"no scenes at {rendered.ALL}: set FACETD_SHARED to the folder that holds scenes/")
            return
        write([*scenes(), *families(range(0, 2 * told.pairs, 2))])
    seen = read()
    _what_it_does("fitted to", seen)
    _left_out(seen)
    print(verdict(fitted(seen)))


def _arguments(given: list[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="missing", description="How near twins are told by what is missing.")
    parser.add_argument("pairs", type=int, nargs="?", default=PAIRS, help="pairs a family")
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--dump", action="store_true", help=f"make {KEPT.name} anew")
    what.add_argument("--held-out", action="store_true", help="what the code's constants do to the odd seeds")
    return parser.parse_args(given)


@contextmanager
def constants(**values: float) -> Iterator[None]:
    """The check with other constants for a while."""
    before = {name: getattr(counter_evidence, name) for name in values}
    try:
        for name, value in values.items():
            setattr(counter_evidence, name, value)
        yield
    finally:
        for name, value in before.items():
            setattr(counter_evidence, name, value)


def scenes() -> Iterator[Seen]:
    """Every rightly named part of the shared scenes."""
    model = trained(rendered.rig(rendered.ALL, "B"))
    for folder in test_folders(rendered.ALL):
        told, pair = rendered.truth(folder), rendered.pair(folder)
        rig = rendered.rig(rendered.ALL, told["rig"])
        for body, part in matched(_unchecked(pair, rig, model), told)[0]:
            if part is not None and part.named and part.recognition.label == body["label"]:
                yield _measured(("scenes", told["tags"][0], folder.name, True), part, model, open_stereo(*pair, rig))


def families(seeds: range) -> Iterator[Seen]:
    """As scenes(), of the look-alike families' pairs that can be told apart: rightly named parts and named twins."""
    rig, last = true_rig(cell()), time.monotonic()
    for family, seed in product(FAMILIES, seeds):
        pair, lies, photo = shown(family, seed)
        if telling_mm(pair.parts[lies].shape, pair.parts[1 - lies].shape, photo.cyclopean_from_part) < TELLS_MM:
            continue
        cameras = open_stereo(photo.left, photo.right, rig)
        for mode in ("alone", "stranger"):
            model = _model(pair, lies, mode)
            scene = _unchecked((photo.left, photo.right), rig, model)
            right = _judged(pair, lies, mode, photo, scene, TELLS_MM, 0.0).right
            if right or mode == "stranger":
                named = [part for part in scene.parts if part.named]
                yield from (_measured(("look-alikes", family, str(seed), right), one, model, cameras) for one in named)
        if time.monotonic() - last > TOLD_S:
            last = time.monotonic()
            print(f"  {family} {seed}", file=sys.stderr, flush=True)


def _unchecked(pair: tuple[Image, Image], rig: StereoRig, model: Model) -> Scene:
    """A look that leaves names however much is missing."""
    with constants(MOST_LIKELY_DUPLICATE=1.0):
        return look(*pair, rig, model)


def _measured(who: tuple[str, str, str, bool], part: Part, model: Model, cameras: StereoImages) -> Seen:
    solid = model.metric[part.recognition.label].solid
    return Seen(*who, counter_evidence.counter_evidence_of(solid, part.cyclopean_from_part, cameras))


def write(seen: list[Seen]) -> None:
    """The kept table made anew."""
    with KEPT.open("w", newline="") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow([*Seen._fields[:4], "missing", "both_px", "off_px", "rival"])
        for one in seen:
            found = one.against
            figures = f"{found.missing:.5f}", f"{found.both_px:.2f}", f"{found.off_px:.2f}", f"{found.rival:.2f}"
            rows.writerow([*one[:3], int(one.right), *figures])


def read() -> list[Seen]:
    """The kept table."""
    with KEPT.open(newline="") as file:
        return [
            Seen(
                r["set"], r["family"], r["seed"], r["right"] == "1",
                CounterEvidence(float(r["missing"]), float(r["both_px"]), float(r["off_px"]), float(r["rival"])),
            )
            for r in csv.DictReader(file)
        ]  # fmt: skip


def fitted(seen: list[Seen], kinds: Sequence[int] = (0, 1, 2, 3)) -> Fit:
    """The logistic regression of near twins on some of the KINDS: most likely by Newton's method, its intercept moved
    from the twins' share of the table to that of what is seen."""
    twin = np.array([not one.right for one in seen], float)
    design = np.column_stack([np.ones(len(seen)), np.array([one.against.terms for one in seen])[:, list(kinds)]])
    ridge = np.diag([0.0] + [RIDGE] * len(kinds))
    answer: Array = np.zeros(design.shape[1])
    step: Array = np.ones(design.shape[1])
    while np.abs(step).max() > 1e-9:
        chance = 1 / (1 + np.exp(-design @ answer))
        information = design.T @ (design * (chance * (1 - chance))[:, None]) + ridge
        step = np.asarray(np.linalg.solve(information, design.T @ (twin - chance) - ridge @ answer), float)
        answer = answer + step
    share = twin.mean()
    answer[0] += np.log(PRIOR / (1 - PRIOR)) - np.log(share / (1 - share))
    return Fit(answer, np.sqrt(np.diag(np.linalg.inv(information))))


def in_code() -> Array:
    """The constants of the code, as Fit.weights has them."""
    return np.array(
        [
            counter_evidence.DUPLICATE,
            counter_evidence.BY_MISSING,
            counter_evidence.BY_BOTH,
            counter_evidence.BY_OFF,
            counter_evidence.BY_RIVAL,
        ]
    )


def agrees(fit: Fit) -> bool:
    """Whether the code's constants are the fitted ones, within half a standard error."""
    return bool((np.abs(in_code() - fit.weights) <= fit.errors / 2).all())


def verdict(fit: Fit) -> str:
    """The fitted constants beside the code's."""
    found = ", ".join(f"{w:.2f} +- {e:.2f}" for w, e in zip(fit.weights, fit.errors, strict=True))
    code = ", ".join(f"{w:g}" for w in in_code())
    differs = "do not differ" if agrees(fit) else "DIFFER"
    names = "DUPLICATE, BY_MISSING, BY_BOTH, BY_OFF, BY_RIVAL"
    return f"fitted {names} {found}; in code {code}: they {differs} by more than half an error"


def _what_it_does(name: str, seen: list[Seen]) -> None:
    """How many right names are lost, and how many strangers are left, by the constants in code."""
    print(f"{name:<12}{'right':>7}{'lost':>6}{'strangers':>11}{'left':>6}")
    own = dict[str, list[Seen]]()
    for one in seen:
        own.setdefault("scenes" if one.set == "scenes" else one.family, []).append(one)
    for family, some in (*own.items(), ("all", seen)):
        right, strangers = [one for one in some if one.right], [one for one in some if not one.right]
        left = sum(not _lost(one) for one in strangers)
        print(f"{family:<12}{len(right):>7}{sum(map(_lost, right)):>6}{len(strangers):>11}{left:>6}")


def _lost(one: Seen) -> bool:
    """Whether a part against which so much speaks has no name."""
    return one.against.duplicate > counter_evidence.MOST_LIKELY_DUPLICATE


def _left_out(seen: list[Seen]) -> None:
    """How many strangers keep their name where so many right parts lose theirs, by some kinds of evidence only."""
    right, terms = np.array([one.right for one in seen]), np.array([one.against.terms for one in seen])
    print(f"{'by':<48}{f'strangers left at {LOST:.0%} lost':>28}")
    for count in range(1, len(KINDS) + 1):
        for kinds in combinations(range(len(KINDS)), count):
            odds = terms[:, list(kinds)] @ fitted(seen, kinds).weights[1:]
            left = (odds[~right] <= np.quantile(odds[right], 1 - LOST)).sum()
            print(f"{', '.join(KINDS[k] for k in kinds):<48}{left:>18} of {(~right).sum()}")


if __name__ == "__main__":
    main()
