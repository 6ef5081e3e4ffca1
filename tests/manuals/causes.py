"""The table of causes in docs/operate/trouble.md, made from the catalogue of codes: no cause that a page or a message
names is without its row."""

from __future__ import annotations

from daemon.events.codes import CauseCode


def table() -> str:
    """A row for each cause: the name that pages and messages show, where in the cell it lies, what to do."""
    rows = [
        f"| {_cell(cause.summary)} | {cause.stage} | {_cell(cause.remedy[0].upper() + cause.remedy[1:])} |"
        for cause in CauseCode
    ]
    return "\n".join(["| cause | where | what to do |", "| --- | --- | --- |", *rows, ""])


def _cell(text: str) -> str:
    return text.replace("|", "\\|")
