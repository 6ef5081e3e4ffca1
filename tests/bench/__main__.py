"""`make bench`: run every measuring module and package of this folder, or those named, and print their tables.

A module here has a `main()` that measures and prints; nothing in this folder passes or fails. Those in long/ take many
minutes and run when named (`long.picks`), or by a target of their own.
usage: python -m tests.bench [MODULE...]
"""

from __future__ import annotations

import importlib
import sys
from pathlib import Path


def main(names: list[str]) -> int:
    here = Path(__file__).parent
    packages = {f.parent.name for f in here.glob("*/__main__.py")}
    round_of_all = sorted({f.stem for f in here.glob("[!_]*.py")} | packages)
    sys.argv = sys.argv[:1]
    for name in names or round_of_all:
        print(f"\n=== {name}", flush=True)
        importlib.import_module(f"tests.bench.{name}" + (".__main__" if name in packages else "")).main()
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
