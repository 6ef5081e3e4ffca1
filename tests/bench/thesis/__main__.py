"""usage: python -m tests.bench.thesis [--write] [NAME ...]     --write: put the tables into docs/THESIS.md.

Tables of patterns are the same on every machine; those of pictures to the precision of floating point; times are CPU
times of this machine.
"""

from __future__ import annotations

import sys
from collections.abc import Callable

import cv2

from tests.bench.thesis import DOCUMENT, patterns, pictures, rounded, written

PATTERNS: dict[str, Callable[[], str]] = {
    "silhouettes": patterns.silhouettes_table,
    "disturbed": patterns.disturbed_table,
    "numbering": patterns.numbering_table,
    "activations": patterns.activations_table,
}
"""The same on every machine: a test compares them with the page."""
PICTURES: dict[str, Callable[[], str]] = {
    "lengths": pictures.lengths_table,
    "detectors": pictures.detectors_table,
    "obtuse": pictures.obtuse_table,
    "vergence": pictures.vergence_table,
    "compensation": pictures.compensation_table,
    "views": pictures.views_table,
    "taught_views": pictures.taught_views_table,
    "rounded": rounded.rounded_table,
}
TIMES: dict[str, Callable[[], str]] = {"rotation": pictures.rotation_table, "times": pictures.times_table}


def main() -> None:
    """Measure and print, or write."""
    cv2.setNumThreads(1)
    wanted = [word for word in sys.argv[1:] if not word.startswith("-")]
    for name, make in {**PATTERNS, **PICTURES, **TIMES}.items():
        if wanted and name not in wanted:
            continue
        made = make()
        print(f"\n{name}\n{made}", flush=True)
        if "--write" in sys.argv[1:]:
            DOCUMENT.write_text(written(DOCUMENT.read_text(), name, made))


if __name__ == "__main__":
    main()
