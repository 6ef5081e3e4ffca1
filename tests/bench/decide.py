"""What the recogniser does by kind of scene, as the table of docs/DECIDE.md.

usage: python -m tests.bench.decide [--write]     --write: put it there, between its marks

Needs the rendered scenes of $FACETD_SHARED/scenes.
"""

from __future__ import annotations

import sys
import time
from collections import defaultdict

import cv2
import numpy as np

from daemon.store import folders
from daemon.vision.look import look
from tests.bench.recognise import Tally, judge, test_folders, trained
from tests.bench.thesis import table, written
from tests.fakes import rendered

DOCUMENT = folders.HOUSE / "docs" / "DECIDE.md"
SAID = {
    "clean": "one part, plain table", "multi": "two or three parts", "shadow": "hard shadows",
    "lowcontrast": "weakest edge 4 to 14 grey levels", "textured": "textured table", "printed": "printed parts",
    "gloss": "metal parts", "clutter": "patterned table, washers and rods about", "factory": "all of that at once",
    "unknown": "parts never taught", "factoryunknown": "never taught, on a factory's table",
    "empty": "no part", "factoryempty": "no part, a factory's table",
}  # fmt: skip


def sets_table() -> str:
    """By set: named right, left unnamed, named wrong; corner errors; time."""
    rigs = {name: rendered.rig(rendered.ALL, name) for name in ("A0", "B")}
    model, tallies = trained(rigs["B"]), defaultdict[str, Tally](Tally)
    for folder in test_folders(rendered.ALL):
        told, pair = rendered.truth(folder), rendered.pair(folder)
        began = time.process_time()
        scene = look(*pair, rigs[told["rig"]], model)
        tally = tallies[told["tags"][0]]
        tally.looks_ms.append(1e3 * (time.process_time() - began))
        judge(scene, told, model.labels, tally)
    rows = [_row(name, tallies[name]) for name in SAID if name in tallies]
    heads = ["scenes", "looks", "parts", "named right", "left unnamed", "named wrong", "corners off, median mm", "95 %",
             "ms a look"]  # fmt: skip
    return table(heads, rows)


def _row(name: str, tally: Tally) -> list[str]:
    c = tally.counts
    silent, wrong = c["silent"] + c["rejected"], c["mistaken"] + c["invented"] + c["ghost"]
    off = [f"{np.percentile(tally.fitted_mm, q):.2f}" if tally.fitted_mm else "-" for q in (50, 95)]
    parts = c["right"] + c["silent"] + c["mistaken"] + c["rejected"] + c["invented"]
    return [SAID[name], str(len(tally.looks_ms)), str(parts), str(c["right"]), str(silent), str(wrong), *off,
            f"{np.median(tally.looks_ms):.0f}"]  # fmt: skip


def main() -> None:
    """Measure and print, or write."""
    cv2.setNumThreads(1)
    if not rendered.ALL.is_dir():
        print("decide: no scenes (set FACETD_SHARED)")
        return
    made = sets_table()
    print(made)
    if "--write" in sys.argv[1:]:
        DOCUMENT.write_text(written(DOCUMENT.read_text(), "sets", made))


if __name__ == "__main__":
    main()
