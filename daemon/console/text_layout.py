"""Lay out text for a terminal: lines folded between words, tables of two columns."""

import re
import textwrap

NARROWEST, WIDEST, LOWEST = 20, 500, 4
"""Limits of the columns of a terminal, and its least rows."""
NARROW = 60
"""Below that many columns a table has one column."""
COLUMN = re.compile(r"\S+( \S+)*  +(?=\S)")


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
