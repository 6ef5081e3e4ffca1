"""One self-contained HTML page of a run: data, pictures, plots and the program that shows them, in one file.

It opens from the disk without a network. Plots are plotly's (the extra `review`); without it the page says so.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Iterable
from importlib import resources
from pathlib import Path
from typing import Any

import cv2

from daemon.review.compare import kept_differences
from daemon.review.digest import Digest, digest
from daemon.review.pagedata import page_data
from daemon.store.files import write_atomically
from daemon.store.outside import FileError
from daemon.store.pictures import read_grey
from daemon.store.runs import check_wire, read_run

PICTURE_BUDGET = 24_000_000
"""Bytes of pictures a page may carry: more would make it slow to open. Failed cycles come first, then the newest."""
JPEG_QUALITY = 72


def write_page(folder: Path, out: Path, against: Path | None = None) -> Path:
    """Write the page of the run in `folder` to `out`; `against`: another run to lay beside it.

    Returns out. Raises RunError where there is no run, OSError where the page cannot be written.
    """
    run = read_digest(folder)
    data = page_data(run)
    data["skipped"] += check_wire(folder)
    if against is not None:
        other = read_digest(against)
        differences = kept_differences(against, other, folder, run)
        data["against"] = {"stats": other.statistics(), "differences": differences}
    pictures, left_out = _pictures(folder, run)
    data["pictures_left_out"] = left_out
    write_atomically(out, render(data, pictures).encode())
    return out


def read_digest(folder: Path) -> Digest:
    """Read and digest one run. Raises RunError."""
    found = read_run(folder)
    return digest(folder.name, found.records, found.skipped)


def render(data: dict[str, Any], pictures: dict[str, str]) -> str:
    """The page as text: the template with style, program, plots, data and pictures put in."""
    assets = resources.files("daemon.review") / "assets"
    page = (assets / "page.html").read_text()
    parts = {
        "STYLE": (assets / "style.css").read_text(),
        "PLOTLY": _plotly(),
        "PROGRAM": (assets / "app.js").read_text(),
        "DATA": _embedded(data),
        "PICTURES": _embedded(pictures),
        "TITLE": str(data["stats"]["run"]),
    }
    head, *rest = page.split("@@")
    return head + "".join(parts[piece] if k % 2 == 0 else piece for k, piece in enumerate(rest))


def _embedded(value: Any) -> str:
    """JSON that cannot end the script element it stands in."""
    return json.dumps(value, separators=(",", ":")).replace("</", "<\\/")


def _plotly() -> str:
    try:
        from plotly.offline import get_plotlyjs
    except ImportError:
        return ""
    return str(get_plotlyjs()).replace("</script", "<\\/script")


def _pictures(folder: Path, run: Digest) -> tuple[dict[str, str], int]:
    """`<seq>-<eye>` -> data URI, within the budget; and how many pictures had to stay out."""
    chosen: dict[str, str] = {}
    spent = left_out = 0
    for look in _by_interest(run):
        for eye, name in (look.get("images") or {}).items():
            if spent >= PICTURE_BUDGET:
                left_out += 1
                continue
            try:
                image = read_grey(Path(name), folder)
            except FileError:
                left_out += 1
                continue
            content = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1].tobytes()
            chosen[f"{look['seq']}-{eye}"] = "data:image/jpeg;base64," + base64.b64encode(content).decode()
            spent += len(content)
    return chosen, left_out


def _by_interest(run: Digest) -> Iterable[dict[str, Any]]:
    """Looks of cycles that failed, then of the others from the newest, then those outside of any cycle."""
    failed = [c for c in run.cycles if c.outcome not in ("picked", "empty")]
    rest = [c for c in reversed(run.cycles) if c.outcome in ("picked", "empty")]
    for cycle in [*failed, *rest]:
        yield from (s.look for s in cycle.stops)
    yield from (r for r in run.outside if r["kind"] == "look")
