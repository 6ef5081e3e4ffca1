"""What vigilance, alpha and beta do to recall: names that facets give, hypotheses measured, time, and recall misled.

Facets are found once, with the full effort, and recognised again for each setting: vigilance is a parameter of recall;
for another alpha or beta the views are learnt anew. Sets: the shared scenes (else those kept here), four parts taught;
look-alikes (even seeds), of a pair both taught, or only the one that is not there, so that no name is right; and one
part on the table, 64 taught. Nothing is asked of the pictures here, though in a look they withdraw some of the names.

Columns: bodies of taught parts, and of them named right, left silent, named wrong; names where no taught body is; ways
measured a group of two facets and more; ms of recognition a look; and how many are still named right where each node
stands for another label. Settings that agree in all but ms are one line, with the least and greatest of these.

usage: python -m tests.bench.vigilance
"""

from __future__ import annotations

import importlib
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Any

import cv2
import numpy as np

from daemon.main import tame_malloc
from daemon.vision.facets import facets_of_images
from daemon.vision.geometry import Polyhedron, StereoRig
from daemon.vision.image import open_stereo
from daemon.vision.model import MetricModel, Model, relearnt
from daemon.vision.recognition import facet_placements, recognise_groups
from daemon.vision.recognition.fits import FacetHypothesis, LabelledCorrespondence
from daemon.vision.settings import VisionSettings
from daemon.vision.values import FacetView, Scene
from tests.bench.look_alikes import shown
from tests.bench.many_parts import photographed
from tests.bench.recognise import matched, test_folders, trained
from tests.bench.simulated_looks import true_rig
from tests.fakes import rendered
from tests.fakes.ablated import four_drawn, misled
from tests.fakes.families import FAMILIES
from tests.fakes.many_parts import drawn_parts, taught
from tests.fakes.photographed import Image, cell

VIGILANCES = (1.0, 0.999, 0.998, 0.995, 0.99, 0.98)
ALPHAS, BETAS = (0.001, 0.01, 0.1), (1.0, 0.5)
PAIRS = 8
"""Look-alikes a family."""
TAUGHT, PICTURES = 64, 48
RECOGNISE = importlib.import_module(
    "daemon.vision.recognition.group_recognition"
)  # the package has a function of that name


@dataclass(frozen=True, eq=False)
class Seen:
    """The facets of one look; which of a set's models is asked; what is there: the bodies of a rendered scene, or the
    label of the one part that is."""

    view: FacetView
    model: int
    told: dict[str, Any] | str


@dataclass(frozen=True, eq=False)
class Set:
    """Looks, and the models they are shown to."""

    name: str
    models: tuple[Model, ...]
    looks: tuple[Seen, ...]

    @property
    def groups(self) -> int:
        """How many groups of two facets and more there are."""
        return sum(len(group.facets) > 1 for seen in self.looks for group in seen.view.groups)


@dataclass
class Row:
    """What a setting gives: bodies by what became of them, ways measured, s of processor a look."""

    counts: Counter[str] = field(default_factory=Counter)
    measured: int = 0
    seconds: list[float] = field(default_factory=list)


def main() -> None:
    cv2.setNumThreads(1)
    tame_malloc()
    print(f"{'':<12}{'vigilance':>10}{'alpha':>18}{'beta':>8}{'bodies':>8}{'right':>7}{'silent':>8}{'wrong':>7}"
          f"{'others named':>14}{'ways a group':>14}{'ms a look':>14}{'misled: right':>15}")  # fmt: skip
    for one in (scenes(), look_alikes(), many_parts()):
        print(f"{one.name}: {len(one.looks)} looks, {one.groups} groups of two facets and more")
        table(one)


def scenes() -> Set:
    """The rendered scenes, the four parts taught from views where those are there, else from drawings."""
    home = rendered.ALL if rendered.ALL.is_dir() else rendered.HERE
    model = trained(rendered.rig(home, "B")) if home == rendered.ALL else four_drawn()
    looks = []
    for folder in test_folders(home):
        told = rendered.truth(folder)
        looks.append(Seen(_facets(rendered.pair(folder), rendered.rig(home, told["rig"])), 0, told))
    return Set("scenes", (model,), tuple(looks))


def look_alikes() -> Set:
    """Of each pair the one that lies there, shown to a model of both and to one of the other alone."""
    models, looks, rig = list[Model](), list[Seen](), true_rig(cell())
    for family, k in product(FAMILIES, range(PAIRS)):
        pair, lies, photo = shown(family, 2 * k)
        view = _facets((photo.left, photo.right), rig)
        for known in (pair.parts, (pair.parts[1 - lies],)):
            looks.append(Seen(view, len(models), pair.parts[lies].label))
            models.append(taught(known))
    return Set("look-alikes", tuple(models), tuple(looks))


def many_parts() -> Set:
    """Parts alone on the table, of many that are taught."""
    parts, truth = drawn_parts(TAUGHT), cell()
    pictures = photographed([parts[k % TAUGHT] for k in range(PICTURES)], truth)
    looks = [
        Seen(_facets((pair.left.pixels, pair.right.pixels), true_rig(truth)), 0, part.label)
        for part, pair, _ in pictures
    ]
    return Set(f"{TAUGHT} taught", (taught(parts),), tuple(looks))


def _facets(pair: tuple[Image, Image], rig: StereoRig) -> FacetView:
    """All that the full effort finds."""
    return facets_of_images(open_stereo(*pair, rig), VisionSettings())


def table(of: Set) -> None:
    """A line for each of the settings that give something else."""
    found = dict[tuple[Any, ...], list[tuple[float, float, float]]]()
    for alpha, beta in product(ALPHAS, BETAS):
        learnt = [
            relearnt(replace(model, parameters=replace(model.parameters, alpha=alpha, beta=beta)))
            for model in of.models
        ]
        wrong = [misled(model) for model in learnt]
        for model in (*learnt, *wrong):
            facet_placements(tuple(known.solid for known in model.metric.values()))
        for vigilance in VIGILANCES:
            row, other = (_recognised(of, models, vigilance) for models in (learnt, wrong))
            c = row.counts
            bodies = c["right"] + c["silent"] + c["wrong"]
            key = (vigilance, bodies, c["right"], c["silent"], c["wrong"], c["other"], row.measured)
            ms = 1000 * float(np.mean(row.seconds))
            found.setdefault((*key, other.counts["right"]), []).append((alpha, beta, ms))
    for (vigilance, *counts, measured, still), same in sorted(found.items(), key=lambda one: -one[0][0]):
        alphas, betas = (" ".join(f"{v:g}" for v in sorted({one[k] for one in same})) for k in (0, 1))
        each = [one[2] for one in same]
        spent = f"{min(each):.1f} to {max(each):.1f}"
        print(f"{'':<12}{vigilance:>10g}{alphas:>18}{betas:>8}{counts[0]:>8}{counts[1]:>7}{counts[2]:>8}{counts[3]:>7}"
              f"{counts[4]:>14}{measured / of.groups:>14.1f}{spent:>14}{still:>15}",
              flush=True)  # fmt: skip


def _recognised(of: Set, models: Sequence[Model], vigilance: float) -> Row:
    row = Row()
    told = [replace(model, parameters=replace(model.parameters, vigilance=vigilance)) for model in models]
    with _counted(row):
        for seen in of.looks:
            start = time.process_time()
            parts = tuple(one.part for one in recognise_groups(seen.view.groups, told[seen.model]))
            row.seconds.append(time.process_time() - start)
            row.counts.update(_became(Scene(parts, (), seen.view), seen.told, told[seen.model]))
    return row


def _became(scene: Scene, told: dict[str, Any] | str, model: Model) -> Iterator[str]:
    """What became of each body that is there, and of names where none is: right, silent, wrong; other."""
    if isinstance(told, str):
        names = {part.recognition.label for part in scene.parts if part.named}
        if told not in model.labels:
            yield from ["other"] * bool(names)
        else:
            yield "wrong" if names - {told} else "right" if names else "silent"
        return
    bodies, ghosts = matched(scene, told)
    for body, part in bodies:
        name = part.recognition.label if part is not None and part.named else None
        if body["label"] in model.labels:
            yield "silent" if name is None else "right" if name == body["label"] else "wrong"
        elif name is not None:
            yield "other"
    yield from ["other"] * len(ghosts)


@contextmanager
def _counted(row: Row) -> Iterator[None]:
    """Counts the ways that are measured of two facets and more."""
    before = RECOGNISE.fit_candidates

    def counting(
        seen: Polyhedron, metric: Mapping[str, MetricModel], ways: Sequence[LabelledCorrespondence], tolerance_mm: float
    ) -> tuple[FacetHypothesis, ...]:
        row.measured += len(ways) if len(seen.facets) > 1 else 0
        found: tuple[FacetHypothesis, ...] = before(seen, metric, ways, tolerance_mm)
        return found

    setattr(RECOGNISE, "fit_candidates", counting)  # noqa: B010
    try:
        yield
    finally:
        setattr(RECOGNISE, "fit_candidates", before)  # noqa: B010


if __name__ == "__main__":
    main()
