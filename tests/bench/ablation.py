"""What recall is worth: rendered scenes named as usual, without recall, and with nodes that stand for other labels.

If recall proposes, then without it the parts that facets name lose their names or fall to the edges, and where its
nodes are mislabelled names go wrong with them or fall silent. Once on the scenes kept here, four parts taught from
drawings; once on all of them, taught from their train views, where FACETD_SHARED says they are.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np

from daemon.main import tame_malloc
from daemon.vision.look import look
from daemon.vision.model.model import Model
from tests.bench.recognise import matched, test_folders, trained
from tests.fakes import rendered
from tests.fakes.ablated import by_facets, four_drawn, instead, misled, without_recall


@dataclass
class Named:
    """What one model made of every body, by scene and number: its label, the name given (None: silent) and whether
    facets gave it; names given where no body is; processor time of each look, ms."""

    given: dict[tuple[str, int], tuple[str, str | None, bool]] = field(default_factory=dict)
    ghosts: int = 0
    ms: list[float] = field(default_factory=list)


def main() -> None:
    cv2.setNumThreads(1)
    tame_malloc()
    print("the scenes kept here, taught from drawings")
    table(rendered.HERE, four_drawn())
    if rendered.ALL.is_dir():
        print(f"\n{rendered.ALL}, taught from views")
        table(rendered.ALL, trained(rendered.rig(rendered.ALL, "B")))


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
