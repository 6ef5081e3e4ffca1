"""The page docs/THESIS.md, and tables and charts as it shows them."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from daemon.store import folders

DOCUMENT = folders.HOUSE / "docs" / "THESIS.md"


def table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table in Markdown."""
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def chart(title: str, across: tuple[str, Sequence[str]], up: str, lines: Mapping[str, Sequence[float]]) -> str:
    """A chart that the page's reader draws (Mermaid); each line's name is a sentence below it, in the lines' order."""
    values = [value for line in lines.values() for value in line]
    low, high = min(0.0, *values), max(0.0, *values)
    drawn = "\n".join(f"  line [{', '.join(f'{v:.2f}' for v in line)}]" for line in lines.values())
    named = "; ".join(lines)
    return (
        f'```mermaid\nxychart-beta\n  title "{title}"\n'
        f'  x-axis "{across[0]}" [{", ".join(across[1])}]\n'
        f'  y-axis "{up}" {low:.2f} --> {high:.2f}\n{drawn}\n```\nLines, in the order of the data: {named}.'
    )


def written(text: str, name: str, made: str) -> str:
    """The document with the table between the marks of its name. Raises ValueError where it has none."""
    marks = re.compile(rf"(<!-- table {name} -->\n).*?(<!-- end -->)", re.DOTALL)
    if not marks.search(text):
        raise ValueError(f"no marks for the table {name}")
    return marks.sub(lambda found: f"{found[1]}{made}\n{found[2]}", text)
