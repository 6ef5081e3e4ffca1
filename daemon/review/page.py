"""One self-contained HTML page of a run: data, pictures, plots and the program that shows them, in one file.

It opens from the disk without a network.
"""

from __future__ import annotations

import base64
import html
import json
from collections.abc import Container, Iterable
from datetime import datetime, timedelta
from importlib import resources
from pathlib import Path
from typing import Any

import cv2

from daemon.errors import spelt
from daemon.review.brief import that_picked
from daemon.review.compare import kept_differences
from daemon.review.digest import Digest, digest
from daemon.review.pagedata import page_data, shown_of
from daemon.review.production import compared, production
from daemon.store.files import being_written, write_atomically
from daemon.store.outside import FileError
from daemon.store.pictures import read_grey
from daemon.store.runs import RunError, check_wire, list_runs, read_run

PICTURE_BUDGET = 24_000_000
"""Bytes of pictures a page may carry: more would make it slow to open. Failed cycles come first, then the newest."""
JPEG_QUALITY = 72
WEEK = timedelta(days=7)


def write_page(folder: Path, out: Path, against: Path | None = None) -> Path:
    """Write the page of the run in `folder` to `out`; `against`: another run to lay beside it.

    Returns out. Raises RunError where there is no run, OSError where the page cannot be written.
    """
    run = read_digest(folder)
    data = page_data(run)
    data["skipped"] += check_wire(folder)
    data["before"] = _before(folder)
    if against is not None:
        other = read_digest(against)
        then = production([other])
        data["against"] = {
            "run": other.name,
            "rows": compared(then, data["production"]),
            "paces": sorted({other.times_life, run.times_life}),
            "differences": kept_differences(against, other, folder, run),
        }
    pictures, left_out = _pictures(folder, shown_of(run))
    data["pictures_left_out"] = left_out
    page = render("page", data, pictures).encode()
    if out.parent == folder and not folder.is_dir():
        raise RunError(f"{folder}: was removed while its page was made")
    write_atomically(out, page)
    return out


def _before(folder: Path) -> dict[str, Any]:
    """What the last run, and the runs of the week before, brought: {last, week}, None where there is none such."""
    began, known = run_time(folder.name), list_runs(folder.parent)
    earlier = known[: known.index(folder)] if folder in known else []
    week = {f for f in earlier if began and (t := run_time(f.name)) and began - t <= WEEK}
    runs = that_picked(f for f in earlier if f in week or f is earlier[-1])
    last = next(reversed(runs), None)
    of_week = [run for f, run in runs.items() if f in week]
    return {
        "last": None if last is None else production([runs[last]]) | {"run": last.name},
        "week": production(of_week) if of_week else None,
    }


def run_time(name: str) -> datetime | None:
    """When the run of this name began (UTC); None where the name is no time."""
    try:
        return datetime.strptime(name[:16], "%Y%m%dT%H%M%SZ")
    except ValueError:
        return None


def read_digest(folder: Path, scenes_of: Container[int] | None = None) -> Digest:
    """Read and digest one run; scenes_of as in read_run. Raises RunError."""
    found = read_run(folder, scenes_of)
    return digest(folder.name, found.records, found.skipped, being_written(folder / "run.jsonl"))


def render(name: str, data: dict[str, Any], pictures: dict[str, str], room: str = "daemon.review") -> str:
    """A page as text: its main part, style and program (`name`, of `room`) in the frame, style and parts that all pages
    share, with data and pictures put in."""
    assets, own = (resources.files(package) / "assets" for package in ("daemon.review", room))
    style, run = own / f"{name}.css", data.get("run")
    parts = {
        "STYLE": (assets / "style.css").read_text(),
        "OWN": style.read_text() if style.is_file() else "",
        "MAIN": (own / f"{name}.html").read_text(),
        "SHARED": (assets / "shared.js").read_text(),
        "PROGRAM": (own / f"{name}.js").read_text(),
        "DATA": _embedded(data),
        "PICTURES": _embedded(pictures),
        "TITLE": html.escape(f"run {run}" if run else str(data.get("title") or "")),
    }
    head, *rest = (assets / "frame.html").read_text().split("@@")
    return spelt(head + "".join(parts[piece] if k % 2 == 0 else piece for k, piece in enumerate(rest)))


def _embedded(value: Any) -> str:
    """JSON that cannot end the script element it stands in."""
    return json.dumps(value, separators=(",", ":")).replace("</", "<\\/")


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
                content = jpeg_of(folder, name)
            except FileError:
                left_out += 1
                continue
            chosen[f"{look['seq']}-{eye}"] = embedded(content)
            spent += len(content)
    return chosen, left_out


def jpeg_of(folder: Path, name: str) -> bytes:
    """A picture of a run as a page carries it. Raises FileError."""
    image = read_grey(Path(name), folder)
    return cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1].tobytes()


def embedded(jpeg: bytes) -> str:
    """The same as an address that needs no file."""
    return "data:image/jpeg;base64," + base64.b64encode(jpeg).decode()


def _by_interest(run: Digest) -> Iterable[dict[str, Any]]:
    """Looks of cycles that failed, then of the others from the newest, then those outside of any cycle."""
    failed = [c for c in run.cycles if c.outcome not in ("picked", "empty")]
    rest = [c for c in reversed(run.cycles) if c.outcome in ("picked", "empty")]
    for cycle in [*failed, *rest]:
        yield from (s.look for s in cycle.stops)
    yield from (r for r in run.outside if r["kind"] == "look")
