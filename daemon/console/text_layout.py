"""Lay out text for a terminal: fold lines between words, tables of two columns, paging."""

from __future__ import annotations

import re
import textwrap
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from daemon.console.interpreter import Frontend

NARROWEST, WIDEST, LOWEST = 20, 500, 4
"""Limits of the columns of a terminal, and its least rows."""
NARROW = 60
"""Below that many columns a table has one column."""
COLUMN = re.compile(r"\S+( \S+)*  +(?=\S)")
MORE = "-- more (Enter, q) --"


def fold(text: str, columns: int) -> list[str]:
    """Fold lines at that many columns, between words, with continuation lines indented."""
    folded: list[str] = []
    for line in text.rstrip("\n").split("\n"):
        if len(line) <= columns:
            folded.append(line)
        else:
            indent = " " * (len(line) - len(line.lstrip()) + 4)
            folded += textwrap.wrap(line, columns, subsequent_indent=indent, break_on_hyphens=False)
    return folded


def prose(text: str, columns: int) -> list[str]:
    """Fold paragraphs at that many columns, indented by two, regardless of their line breaks; a line of two columns
    (separated by two blanks) stays one, folded within the second."""
    paragraphs: list[tuple[str, int]] = []
    for line in text.splitlines():
        column = COLUMN.match(line)
        if column or not paragraphs or paragraphs[-1][1]:
            paragraphs.append((line, len(column[0]) if column else 0))
        else:
            paragraphs[-1] = f"{paragraphs[-1][0]} {line}", 0
    folded: list[str] = []
    for paragraph, hanging in paragraphs:
        below = " " * (2 + (hanging if columns >= NARROW else 2 * bool(hanging)))
        folded += textwrap.wrap(
            paragraph, columns, initial_indent="  ", subsequent_indent=below, break_on_hyphens=False
        )
    return folded


async def by_pages(text: str, frontend: Frontend) -> str:
    """Show all pages but the last, waiting for Enter after each. Returns the last, or nothing where the operator quits;
    all of it where the height of the terminal is unknown.
    """
    lines = fold(text, frontend.columns)
    if frontend.rows is None or not frontend.asks:
        return text
    page = max(frontend.rows - 2, 2)  # what is asked, and the line to answer on, are below it
    while len(lines) >= frontend.rows:
        await frontend.say("\n".join(lines[:page]))
        lines = lines[page:]
        if (await frontend.ask(MORE)).strip():
            return ""
    return "\n".join(lines)


def table(rows: list[tuple[str, str]], columns: int) -> str:
    """Lay out rows of word and description in two columns; a long word gets a line of its own."""
    width = 0 if columns < NARROW else max((len(word) for word, _ in rows if len(word) <= 24), default=0)
    lines = []
    for word, description in rows:
        first, *below = textwrap.wrap(description, max(columns - width - 2, NARROWEST), break_on_hyphens=False) or [""]
        if len(word) <= width:
            lines.append(f"{word:<{width}}  {first}")
        else:
            lines += [*fold(word, columns), " " * (width + 2) + first]
        lines += [" " * (width + 2) + line for line in below]
    return "\n".join(lines)
