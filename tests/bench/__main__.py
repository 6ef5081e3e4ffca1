"""`make bench`: run every measuring module of this folder, or those named, and print their tables.

A module here has a `main()` that measures and prints; nothing in this folder passes or fails.
usage: python -m tests.bench [MODULE...]
"""

from __future__ import annotations

import importlib
import pkgutil
import sys
from pathlib import Path

NOT_IN_THE_ROUND = {
    "__main__",
    "faults",
    "kill",
    "lent_eyes",
    "outlive",
    "picks",
    "running",
    "sentry",
    "soak",
    "travels",
}  # minutes long: named, or by their own target; or what those share


def main(names: list[str]) -> int:
    here = Path(__file__).parent
    found = sorted(m.name for m in pkgutil.iter_modules([str(here)]) if m.name not in NOT_IN_THE_ROUND)
    sys.argv = sys.argv[:1]
    for name in names or found:
        print(f"\n=== {name}", flush=True)
        importlib.import_module(f"tests.bench.{name}").main()
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
