"""`make docs`: write every reference and every piece of a page that is made from the code."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

from daemon.store.folders import HOUSE
from tests.manuals import causes, commands, data, man, records, settings, states

DOCS = HOUSE / "docs"
PAGES: dict[Path, Callable[[], str]] = {
    DOCS / "SETTINGS.md": settings.document,
    DOCS / "COMMANDS.md": commands.document,
    DOCS / "DATA.md": data.document,
    DOCS / "man" / "facetctl.1": man.facetctl,
    DOCS / "man" / "facetd.8": man.facetd,
    DOCS / "man" / "facetctl.bash": man.bash,
}
"""Whole pages."""
PIECES: dict[tuple[Path, str], Callable[[], str]] = {
    (HOUSE / "deploy" / "RUNS.md", "records"): records.document,
    (DOCS / "operate" / "trouble.md", "causes"): causes.table,
    (DOCS / "ARCHITECTURE.md", "states"): states.diagram,
    (DOCS / "ARCHITECTURE.md", "transitions"): states.table,
}
"""Pieces of pages, between `<!-- made NAME -->` and `<!-- end -->`."""


def with_piece(text: str, name: str, piece: str) -> str:
    """A page with a piece of it made anew. Raises ValueError where the page has no place for it."""
    marks = re.compile(rf"(<!-- made {name} -->\n).*?(<!-- end -->)", re.DOTALL)
    if not marks.search(text):
        raise ValueError(f"no place for {name}")
    return marks.sub(lambda found: found[1] + piece + found[2], text)


def main() -> None:
    """Write them all."""
    for page, make in PAGES.items():
        page.write_text(make(), encoding="utf-8")
    for (page, name), make in PIECES.items():
        page.write_text(with_piece(page.read_text(encoding="utf-8"), name, make()), encoding="utf-8")


if __name__ == "__main__":
    main()
