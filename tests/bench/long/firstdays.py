"""Ten cells drawn at random, each from `facetctl arm identify` to a picked part by commands alone.

`python -m tests.bench.long.firstdays [COUNT] [FIRST]`: a line for each; real time, some minutes a cell.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
import time
from pathlib import Path

from tests.fakes.first_day import first_day, strange_cell


def one(seed: int) -> str:
    """What is wrong with that day; nothing where it ended with a part in the bin."""
    folder = Path(tempfile.mkdtemp(prefix="facetd-"))
    try:
        return first_day(folder, seed).wrong
    except (AssertionError, OSError, KeyError, ValueError) as error:
        return f"{type(error).__name__}: {error}"
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def main(count: int, first: int) -> int:
    """Print the table; how many went wrong."""
    bad = 0
    for seed in range(first, first + count):
        began_s = time.monotonic()
        wrong = one(seed)
        bad += bool(wrong)
        strange, _ = strange_cell(seed)
        print(f"{seed:4} {strange.name:<42} {strange.baud:>5} baud  {time.monotonic() - began_s:4.0f} s  "
              f"{wrong or 'picked'}", flush=True)  # fmt: skip
    print(f"{count - bad} of {count} first days ended with a part in the bin")
    return bad


if __name__ == "__main__":
    words = [int(word) for word in sys.argv[1:]]
    sys.exit(main(*[*words, *(10, 0)[len(words) :]]) > 0)
