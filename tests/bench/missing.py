"""Makes the constants of daemon/vision/evidence/missing.py again: how near twins are told by what is missing.

Without an option: TWIN and BY_MISSING are fitted to the shares kept in tests/data/missing_shares.csv and held beside
the code's. With `--dump` that table is made anew: the share missing, at its final pose, of each part that is named
while the check is switched off, over the shared scenes and the look-alike families' even seeds, where the part alone is
taught and where its twin alone is; looks that show nothing by which the two differ are left out. What EXPECTED and
INNER do is told on the way. With `--held-out` the odd seeds are looked at: names lost and strangers left. Choose
nothing by them.

usage: python -m tests.bench.missing [--dump | --held-out] [PAIRS]
PAIRS a family. FACETD_RENDERED names a folder that keeps what was rendered.
"""

from __future__ import annotations

import argparse
import csv
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import product
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from daemon.arrays import Array
from daemon.main import tame_malloc
from daemon.vision.evidence import missing
from daemon.vision.geometry import StereoRig
from daemon.vision.image import Eyes, open_eyes
from daemon.vision.look import look
from daemon.vision.model.model import Model
from daemon.vision.refine.edge_samples import stretches_of
from daemon.vision.refine.expected_edges import Placements
from daemon.vision.values import Part, Scene
from tests.bench.look_alikes import _judged, _model, shown
from tests.bench.recognise import matched, test_folders, trained
from tests.bench.simulated_looks import true_rig
from tests.fakes import rendered
from tests.fakes.families import FAMILIES
from tests.fakes.photographed import Image, cell
from tests.fakes.telling import TELLS_MM, telling_mm

KEPT = Path(__file__).resolve().parents[1] / "data" / "missing_shares.csv"
PAIRS = 40
PRIOR = 0.01
"""Of what is seen and fits, so much is a near twin that was never taught: seldom, or it would have been taught."""
EXPECTED, INNER = (3.0, 6.0, 12.0, 24.0), (0.0, 0.25, 0.5, 1.0)
LOST = 0.01
"""The share of right names at whose loss settings are compared."""
TOLD_S = 20.0


class Share(NamedTuple):
    """Of one named part: the set and family it is of, its seed or scene, whether the name is right (else it is a near
    twin's), and what share of its edges is missing."""

    set: str
    family: str
    seed: str
    right: bool
    share: float


class Fit(NamedTuple):
    """Log odds that a part is a near twin, where nothing is missing, and their slope by the missing share; the standard
    error of each."""

    twin: float
    by_missing: float
    twin_error: float
    by_missing_error: float


def main(arguments: list[str] | None = None) -> None:
    told = _arguments(sys.argv[1:] if arguments is None else arguments)
    cv2.setNumThreads(1)
    tame_malloc()
    if told.held_out:
        _what_it_does("held out", [share for share, _ in families(range(1, 2 * told.pairs, 2))])
        return
    if told.dump:
        if not rendered.ALL.is_dir():
            print(f"no scenes at {rendered.ALL}: set FACETD_SHARED to the folder that holds scenes/")
            return
        found = [*scenes(), *families(range(0, 2 * told.pairs, 2))]
        write([share for share, _ in found])
        _settings(found)
    shares = read()
    _what_it_does("fitted to", shares)
    print(verdict(fitted(shares)))


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
    before = {name: getattr(missing, name) for name in values}
    try:
        for name, value in values.items():
            setattr(missing, name, value)
        yield
    finally:
        for name, value in before.items():
            setattr(missing, name, value)


def scenes() -> Iterator[tuple[Share, Array]]:
    """Every rightly named part of the shared scenes, with its share by each of the settings."""
    model = trained(rendered.rig(rendered.ALL, "B"))
    for folder in test_folders(rendered.ALL):
        told, pair = rendered.truth(folder), rendered.pair(folder)
        rig = rendered.rig(rendered.ALL, told["rig"])
        for body, part in matched(_unchecked(pair, rig, model), told)[0]:
            if part is not None and part.named and part.recognition.label == body["label"]:
                yield _measured(("scenes", told["tags"][0], folder.name, True), part, model, open_eyes(*pair, rig))


def families(seeds: range) -> Iterator[tuple[Share, Array]]:
    """As scenes(), of the look-alike families' pairs that can be told apart: rightly named parts and named twins."""
    rig, last = true_rig(cell()), time.monotonic()
    for family, seed in product(FAMILIES, seeds):
        pair, lies, photo = shown(family, seed)
        if telling_mm(pair.parts[lies].shape, pair.parts[1 - lies].shape, photo.cyclopean_from_part) < TELLS_MM:
            continue
        eyes = open_eyes(photo.left, photo.right, rig)
        for mode in ("alone", "stranger"):
            model = _model(pair, lies, mode)
            scene = _unchecked((photo.left, photo.right), rig, model)
            right = _judged(pair, lies, mode, photo, scene, True, 0.0).right
            if right or mode == "stranger":
                named = [part for part in scene.parts if part.named]
                yield from (_measured(("look-alikes", family, str(seed), right), one, model, eyes) for one in named)
        if time.monotonic() - last > TOLD_S:
            last = time.monotonic()
            print(f"  {family} {seed}", file=sys.stderr, flush=True)


def _unchecked(pair: tuple[Image, Image], rig: StereoRig, model: Model) -> Scene:
    """A look that leaves names however much is missing."""
    with constants(MOST_LIKELY_TWIN=1.0):
        return look(*pair, rig, model)


def _measured(who: tuple[str, str, str, bool], part: Part, model: Model, eyes: Eyes) -> tuple[Share, Array]:
    """The share by the code's constants, and (K,) by each of the settings."""
    solid = model.metric[part.recognition.label].solid
    poses = part.cyclopean_from_part[None]
    both = stretches_of(Placements.of([solid]), eyes, poses, model.parameters.tolerance_mm)
    each = []
    for expected, inner in product(EXPECTED, INNER):
        with constants(EXPECTED=expected, INNER=inner):
            each.append(missing.missing_share(solid, both, eyes.views))
    return Share(*who, round(missing.missing_share(solid, both, eyes.views), 5)), np.array(each)


def write(shares: list[Share]) -> None:
    """The kept table made anew."""
    with KEPT.open("w", newline="") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(Share._fields)
        rows.writerows((*one[:3], int(one.right), f"{one.share:.5f}") for one in shares)


def read() -> list[Share]:
    """The kept table."""
    with KEPT.open(newline="") as file:
        rows = csv.DictReader(file)
        return [Share(r["set"], r["family"], r["seed"], r["right"] == "1", float(r["share"])) for r in rows]


def fitted(shares: list[Share]) -> Fit:
    """The logistic regression of near twins on the missing share: most likely by Newton's method, its intercept moved
    from the twins' share of the table to that of what is seen."""
    twin = np.array([not one.right for one in shares], float)
    design = np.column_stack([np.ones(len(shares)), [one.share for one in shares]])
    answer: Array = np.zeros(2)
    step: Array = np.ones(2)
    while np.abs(step).max() > 1e-9:
        chance = 1 / (1 + np.exp(-design @ answer))
        information = design.T @ (design * (chance * (1 - chance))[:, None])
        step = np.asarray(np.linalg.solve(information, design.T @ (twin - chance)), float)
        answer = answer + step
    errors = np.sqrt(np.diag(np.linalg.inv(information)))
    share = twin.mean()
    moved = np.log(PRIOR / (1 - PRIOR)) - np.log(share / (1 - share))
    return Fit(float(answer[0] + moved), float(answer[1]), float(errors[0]), float(errors[1]))


def agrees(fit: Fit) -> bool:
    """Whether the code's constants are the fitted ones, within its standard errors."""
    off = abs(missing.TWIN - fit.twin), abs(missing.BY_MISSING - fit.by_missing)
    return off[0] <= fit.twin_error and off[1] <= fit.by_missing_error


def verdict(fit: Fit) -> str:
    """The fitted constants beside the code's."""
    differs = "do not differ" if agrees(fit) else "DIFFER"
    return (
        f"fitted TWIN {fit.twin:.2f} +- {fit.twin_error:.2f}, BY_MISSING {fit.by_missing:.1f} +- "
        f"{fit.by_missing_error:.1f}; in code {missing.TWIN:g}, {missing.BY_MISSING:g}: they {differs} by more than "
        "the fit's standard error"
    )


def _what_it_does(name: str, shares: list[Share]) -> None:
    """How many right names are lost, and how many strangers are left, by the constants in code."""
    print(f"{name:<12}{'right':>7}{'lost':>6}{'strangers':>11}{'left':>6}")
    own = dict[str, list[Share]]()
    for one in shares:
        own.setdefault("scenes" if one.set == "scenes" else one.family, []).append(one)
    for family, some in (*own.items(), ("all", shares)):
        right, strangers = [one for one in some if one.right], [one for one in some if not one.right]
        left = sum(not _lost(one) for one in strangers)
        print(f"{family:<12}{len(right):>7}{sum(map(_lost, right)):>6}{len(strangers):>11}{left:>6}")


def _lost(one: Share) -> bool:
    """Whether a part of which so much is missing has no name."""
    return missing.twin_probability(one.share) > missing.MOST_LIKELY_TWIN


def _settings(found: list[tuple[Share, Array]]) -> None:
    """What EXPECTED and INNER do: how often a twin misses more than a right part, and how many twins keep their name
    where so many right ones lose theirs."""
    right = np.array([share.right for share, _ in found])
    each = np.array([values for _, values in found])
    print(f"{'EXPECTED':>8}{'INNER':>7}{'twin misses more':>18}{f'left at {LOST:.0%} lost':>19}")
    for (expected, inner), values in zip(product(EXPECTED, INNER), each.T, strict=True):
        own, twins = values[right], values[~right]
        more = (twins[:, None] > own).mean() + 0.5 * (twins[:, None] == own).mean()
        left = (twins <= np.quantile(own, 1 - LOST)).mean()
        mark = "  as in code" if (expected, inner) == (missing.EXPECTED, missing.INNER) else ""
        print(f"{expected:>8g}{inner:>7g}{more:>18.3f}{left:>19.1%}{mark}")


if __name__ == "__main__":
    main()
