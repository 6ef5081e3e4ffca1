"""Parts learnt by walking round them: lengths and angles beside the truth, and recognition beside their drawings'.

`python -m tests.bench.long.around [SCENES [TOURS [PLACES]]]`, in the simulated cell with the hand-eye and arm errors of
etc/simcell.yaml. Ten drawn parts of six to eight facets are walked round as they lie on the table, TOURS times, each
time on another side; then one model is made of what was learnt and one of the drawings. Both see the same SCENES
pictures of each part, strewn anyhow.
"""

from __future__ import annotations

import asyncio
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from daemon.arrays import Array
from daemon.commands.teaching import teach
from daemon.errors import CommandError
from daemon.pick.recogniser import ModelRecogniser
from daemon.teaching.part_from_looks import Deviation, deviations
from daemon.teaching.solid_from_mesh import DRAWN_MM
from daemon.vision.geometry import Polyhedron
from daemon.vision.model import FacetLibrary, Model, empty_model, learn_solid, type_facet
from tests.fakes.fake_context import FakeFrontend
from tests.fakes.simulated_time import SimulatedLoop
from tests.fakes.walked_round import DRAWN, drawn_cell, lay

SCENES, TOURS, PLACES = 6, 2, 12
GOAL_MM, GOAL_DEG = 0.3, 0.3


class Yes(FakeFrontend):
    """Says yes to whatever is asked."""

    asks = True

    async def ask(self, question: str) -> str:
        """See the class."""
        return "y"

    async def say(self, text: str) -> None:
        """Nobody reads it."""


def drawn_solid(part: Polyhedron, library: FacetLibrary) -> Polyhedron:
    """As a drawing's solid is."""
    count = len(part.corners_mm)
    covariance = np.repeat(DRAWN_MM**2 * np.eye(3)[None], count, axis=0)
    types = tuple(type_facet(part.corners_mm[r], covariance[r], library)[0].name for r in part.rings)
    return Polyhedron(part.corners_mm, part.facets, covariance, types)


async def tours(folder: Path, count: int, places: int) -> tuple[Model, dict[str, list[Any]]]:
    """Every part walked round; the model of all, and by part (sides learnt, deviations, seconds)."""
    told: dict[str, list[Any]] = {label: [] for label in DRAWN}
    async with drawn_cell(11, folder) as here:
        rng = np.random.default_rng(5)
        for label, part in DRAWN.items():
            for rest in range(count):
                lay(here, label, rest, float(rng.uniform(0, 2 * np.pi)))
                began_s, spent_s = here.now_s, time.process_time()
                try:
                    answer = await teach.run(here.context, [label, "--around", str(places)], Yes())
                except CommandError as error:
                    print(f"{label:9s} {error}", flush=True)
                    told[label].append((0, (), here.now_s - began_s))
                    continue
                seconds = here.now_s - began_s, time.process_time() - spent_s
                corners = np.array(answer.data["corners_mm"])
                doubt = np.repeat(np.eye(3)[None] * 0.05**2, len(corners), axis=0)
                solid = Polyhedron(corners, tuple(tuple(ring) for ring in answer.data["rings"]), doubt)
                beside = deviations(solid, part)
                told[label].append((len(solid.facets), beside, seconds[0]))
                print(f"{label:9s} rest {rest}: {row(beside, len(part.facets))}; {seconds[0]:.1f} s of the arm, "
                      f"{seconds[1]:.1f} s of the processor", flush=True)  # fmt: skip
        model, left_out = here.context.trainer.learn_all()
        for line in left_out:
            print(line)
        return model, told


def row(beside: tuple[Deviation | None, ...], sides: int) -> str:
    """What one tour came to."""
    known = [one for one in beside if one is not None]
    strange = len(beside) - len(known)
    if not known:
        return f"{len(beside)} sides, none of the part's {sides}"
    lengths, angles = [k.length_mm for k in known], [k.angle_deg for k in known]
    return (
        f"{len(known)} of {sides} sides{f', {strange} wrong' if strange else ''}; lengths {np.median(lengths):.3f} mm, "
        f"at most {max(lengths):.3f}; angles {np.median(angles):.3f} degrees, at most {max(angles):.3f}"
    )


async def scenes(models: dict[str, Model], count: int) -> dict[str, Counter[str]]:
    """What each model makes of the same pictures of parts strewn one at a time."""
    found: dict[str, Counter[str]] = {name: Counter() for name in models}
    with tempfile.TemporaryDirectory() as folder:
        async with drawn_cell(12, Path(folder)) as here:
            rng = np.random.default_rng(6)
            rig, settings = here.context.trainer.rig, here.context.trainer.settings
            sights = {name: ModelRecogniser(model, rig, settings) for name, model in models.items()}
            here.cycle.use(sights["drawn"])
            views: list[Array] = [view.pose(here.cycle.cell.mounting) for view in here.cycle.settings.surveys]
            for k in range(count):
                await here.cycle.move_to(views[k % len(views)], "look")
                for label in DRAWN:
                    here.cell.scatter([label], rng)
                    seen = await here.cycle.look("bench")
                    for name, sight in sights.items():
                        scene = sight.see(*seen.taken.images, here.context.table_in(seen))
                        named = {part.recognition.label for part in scene.parts if part.named}
                        verdict = "right" if named == {label} else "wrong" if named else "unnamed"
                        found[name][verdict] += 1
                        found[name][f"{verdict} {label}"] += 1
    return found


def run(work: Any) -> Any:
    with asyncio.Runner(loop_factory=SimulatedLoop) as runner:
        return runner.run(work)


def main(looks: int = SCENES, count: int = TOURS, places: int = PLACES) -> None:
    """Measure and print."""
    with tempfile.TemporaryDirectory() as folder:
        walked, told = run(tours(Path(folder), count, places))
    known = [d for rows in told.values() for _, beside, _ in rows for d in beside if d is not None]
    strange = sum(d is None for rows in told.values() for _, beside, _ in rows for d in beside)
    for name, values, goal in (
        ("lengths, mm", [d.length_mm for d in known], GOAL_MM),
        ("angles, degrees", [d.angle_deg for d in known], GOAL_DEG),
    ):
        within = np.mean(np.array(values) <= goal)
        print(f"{name}: median {np.median(values):.3f}, 95 % {np.percentile(values, 95):.3f}, worst {max(values):.3f}; "
              f"{100 * within:.1f} % of {len(values)} sides within {goal:g}")  # fmt: skip
    seconds = np.median([s for rows in told.values() for *_, s in rows])
    print(f"{strange} sides learnt that the parts do not have; {seconds:.1f} s of the arm a tour of {places} places")
    drawn = empty_model(walked.library)
    for label, part in DRAWN.items():
        drawn = learn_solid(drawn, drawn_solid(part, walked.library), label)
    for name, counts in run(scenes({"drawn": drawn, "walked round": walked}, looks)).items():
        total = sum(counts[v] for v in ("right", "wrong", "unnamed"))
        worse = ", ".join(f"{k} {v}" for k, v in sorted(counts.items()) if " " in k and not k.startswith("right"))
        print(f"taught {name}: {counts['right']} of {total} named right, {counts['wrong']} wrong, "
              f"{counts['unnamed']} unnamed ({worse})")  # fmt: skip


if __name__ == "__main__":
    main(*(int(word) for word in sys.argv[1:]))
