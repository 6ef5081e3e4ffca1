"""Section 6.1: blocks with sharp corners and with rounded ones, both taught from their drawings, from far and near.

The simulated cell's renderer makes the pictures, with its own cameras (etc/simcell.yaml).
"""

from __future__ import annotations

from collections import Counter
from itertools import product

import numpy as np

from daemon.store.library import load_facets
from daemon.vision.look import look
from daemon.vision.model import empty_model, learn_solids
from daemon.vision.settings import VisionSettings
from tests.bench.simulated_looks import true_rig
from tests.bench.thesis.document import table
from tests.fakes.holed import rounded_pair
from tests.fakes.photographed import cell, photograph

PAIRS = 6
RADII_MM = (3.0, 6.0, 10.0)
FAR_MM, NEAR_MM = (500.0, 560.0), (250.0, 280.0)
ANSWERS = ("right", "unnamed", "taken for the other")


def rounded_table() -> str:
    """Blocks that only their rounding tells apart: what is named, by radius and distance."""
    counts, rig = Counter[tuple[str, int, str]](), true_rig(cell())
    for radius, seed, (k, distance) in product(RADII_MM, range(PAIRS), enumerate((FAR_MM, NEAR_MM))):
        pair = rounded_pair(radius, seed)
        model = learn_solids(empty_model(load_facets()), [(p.label, p.drawing.solid, p.label) for p in pair])
        for lies, part in enumerate(pair):
            shown = photograph(part.shape, np.random.default_rng([seed, lies]), distance_mm=distance)
            scene = look(shown.left, shown.right, rig, model, VisionSettings().without_time_limit())
            named = {p.recognition.label for p in scene.parts if p.named}
            answer = ANSWERS[1] if not named else ANSWERS[0] if named == {part.label} else ANSWERS[2]
            counts["sharp" if lies == 0 else f"rounded by {radius:g} mm", k, answer] += 1
    rows = [[block, *(str(counts[block, k, a]) for k, a in product((0, 1), ANSWERS))]
            for block in dict.fromkeys(block for block, *_ in counts)]  # fmt: skip
    heads = [f"{mm[0] / 10:g} to {mm[1] / 10:g} cm: {a}" for mm, a in product((FAR_MM, NEAR_MM), ANSWERS)]
    return table(["block shown", *heads], rows)
