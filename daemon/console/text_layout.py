"""Text on a terminal of so many columns and rows: folded between words, and put before its reader page by page."""

from __future__ import annotations

import re
import textwrap
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from daemon.console.interpreter import Frontend

NARROWEST, WIDEST, LOWEST = 20, 500, 4
"""Columns that a terminal is taken to have, at least and at most, and rows at least."""
NARROW = 60
"""Below that many columns nothing stands beside anything."""
COLUMN = re.compile(r"\S+( \S+)*  +(?=\S)")
MORE = "-- more (Enter, q) --"


def fold(text: str, columns: int) -> list[str]:
    """Lines no longer than that, broken between words; what is folded is indented under its line."""
    folded: list[str] = []
    for line in text.rstrip("\n").split("\n"):
        if len(line) <= columns:
            folded.append(line)
        else:
            indent = " " * (len(line) - len(line.lstrip()) + 4)
            folded += textwrap.wrap(line, columns, subsequent_indent=indent, break_on_hyphens=False)
    return folded


def prose(text: str, columns: int, indent: int = 2) -> list[str]:
    """Paragraphs broken anew for so many columns, however their lines were broken before; a line that explains a word
    in a column of its own (two blanks between them) stays one, folded within that column."""
    paragraphs: list[tuple[str, int]] = []
    for line in text.splitlines():
        column = COLUMN.match(line)
        if column or not paragraphs or paragraphs[-1][1]:
            paragraphs.append((line, len(column[0]) if column else 0))
        else:
            paragraphs[-1] = f"{paragraphs[-1][0]} {line}", 0
    folded: list[str] = []
    for paragraph, hanging in paragraphs:
        begun, below = " " * indent, " " * (indent + (hanging if columns >= NARROW else 2 * bool(hanging)))
        folded += textwrap.wrap(
            paragraph, columns, initial_indent=begun, subsequent_indent=below, break_on_hyphens=False
        )
    return folded


async def by_pages(text: str, frontend: Frontend) -> str:
    """Show all but the last page, each after an Enter; gives the last, or nothing to whoever has seen enough.

    A frontend that does not know how high its terminal is gets all of it at once.
    """
    lines = fold(text, frontend.columns)
    if frontend.rows is None or not frontend.asks:
        return text
    page = max(frontend.rows - 1, 2)
    while len(lines) >= frontend.rows:
        await frontend.say("\n".join(lines[:page]))
        lines = lines[page:]
        if (await frontend.ask(MORE)).strip():
            return ""
    return "\n".join(lines)


def table(rows: list[tuple[str, str]], columns: int) -> str:
    """Words and what is said of each, beside them in one column, or below them where they are too long for that; folded
    within that column."""
    width = 0 if columns < NARROW else max((len(word) for word, _ in rows if len(word) <= 24), default=0)
    lines = []
    for word, said in rows:
        beside, *below = textwrap.wrap(said, max(columns - width - 2, NARROWEST), break_on_hyphens=False) or [""]
        if len(word) <= width:
            lines.append(f"{word:<{width}}  {beside}")
        else:
            lines += [*fold(word, columns), " " * (width + 2) + beside]
        lines += [" " * (width + 2) + line for line in below]
    return "\n".join(lines)
