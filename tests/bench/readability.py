"""How readable the manuals are; usage: python -m tests.bench.readability [REVISION]: those of an older version."""

from __future__ import annotations

import subprocess
import sys

from daemon.store.folders import HOUSE
from tests.manuals.readability import measured


def pages(revision: str | None) -> dict[str, str]:
    """Every manual by its name, as it is now or was at a revision; no page that is made from the code."""
    listing = ["ls-tree", "-r", "--name-only", revision] if revision else ["ls-files", "-co", "--exclude-standard"]
    names = [n for n in git(*listing).split() if n.endswith(".md") and n.startswith(("README", "deploy/", "docs/"))]
    read = {n: git("show", f"{revision}:{n}") if revision else (HOUSE / n).read_text(encoding="utf-8") for n in names}
    return {name: text for name, text in read.items() if "is made from the code" not in text[:1500]}


def git(*words: str) -> str:
    return subprocess.run(["git", *words], cwd=HOUSE, capture_output=True, text=True, check=True).stdout


def main() -> None:
    every = pages(sys.argv[1] if len(sys.argv) > 1 else None)
    print(f"{'page':34} sentences   words   mean    95 %  over 25, %  passive, %  words astray a thousand")
    for name, text in [*every.items(), ("all", "\n\n".join(every.values()))]:
        m = measured(text)
        print(f"{name:34} {m.sentences:9} {m.words:7} {m.mean:6.1f} {m.p95:7} {m.long_pct:11.0f} {m.passive_pct:11.0f}"
              f" {m.astray_per_1000:24.1f}")  # fmt: skip


if __name__ == "__main__":
    main()
