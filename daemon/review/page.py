"""Write the HTML page of a run: one file with data, images and the script that shows them; no network needed."""

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
from daemon.review.brief import read_runs_with_picks
from daemon.review.compare import kept_differences
from daemon.review.digest import Digest, digest
from daemon.review.pagedata import page_data, shown_of
from daemon.review.production import compared, production
from daemon.store.files import being_written, write_atomically
from daemon.store.outside import FileError
from daemon.store.pictures import read_grey
from daemon.store.runs import RunError, check_wire, list_runs, read_run

PICTURE_BUDGET = 24_000_000
"""Most bytes of images in a page, so that it opens fast. Failed cycles come first, then the newest."""
JPEG_QUALITY = 72
WEEK = timedelta(days=7)


def write_page(folder: Path, out: Path, against: Path | None = None) -> Path:
    """Write the page of the run in `folder` to `out`; returns out. against: another run to compare with.

    Raises RunError without a run, OSError where the page cannot be written.
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
        raise RunError(f"{folder}: the run was removed while its page was made")
    write_atomically(out, page)
    return out


def _before(folder: Path) -> dict[str, Any]:
    """Figures of the previous run and of the week before: {last, week}, each None without such a run."""
    began, every = run_time(folder.name), list_runs(folder.parent)
    earlier = every[: every.index(folder)] if folder in every else []
    week = {f for f in earlier if began and (t := run_time(f.name)) and began - t <= WEEK}
    runs = read_runs_with_picks(f for f in earlier if f in week or f is earlier[-1])
    last = next(reversed(runs), None)
    of_week = [run for f, run in runs.items() if f in week]
    return {
        "last": None if last is None else production([runs[last]]) | {"run": last.name},
        "week": production(of_week) if of_week else None,
    }


def run_time(name: str) -> datetime | None:
    """When a run began (UTC), from its name; None where the name is not a time."""
    try:
        return datetime.strptime(name[:16], "%Y%m%dT%H%M%SZ")
    except ValueError:
        return None


def read_digest(folder: Path, scenes_of: Container[int] | None = None) -> Digest:
    """Read and digest one run; scenes_of as in read_run. Raises RunError."""
    found = read_run(folder, scenes_of)
    return digest(folder.name, found.records, found.skipped, being_written(folder / "run.jsonl"))


def render(
    name: str,
    data: dict[str, Any],
    pictures: dict[str, str],
    package: str = "daemon.review",
    library: str = "",
    shared: str = "",
) -> str:
    """A page as text: the files `name`.html, .css and .js of `package` in the frame, style and script that all pages
    share, with data and images. library: script of others that the page uses; shared: ours that other pages use
    too."""
    assets, own = (resources.files(name) / "assets" for name in ("daemon.review", package))
    style, run = own / f"{name}.css", data.get("run")
    parts = {
        "STYLE": (assets / "style.css").read_text(),
        "OWN": style.read_text() if style.is_file() else "",
        "MAIN": (own / f"{name}.html").read_text(),
        "LIBRARY": library,
        "SHARED": (assets / "shared.js").read_text() + shared,
        "PROGRAM": (own / f"{name}.js").read_text(),
        "DATA": _embedded(data),
        "PICTURES": _embedded(pictures),
        "TITLE": html.escape(f"run {run}" if run else str(data.get("title") or "")),
    }
    head, *rest = (assets / "frame.html").read_text().split("@@")
    return spelt(head + "".join(parts[piece] if k % 2 == 0 else piece for k, piece in enumerate(rest)))


def _embedded(value: Any) -> str:
    """JSON that cannot end the script element around it."""
    return json.dumps(value, separators=(",", ":")).replace("</", "<\\/")


def _pictures(folder: Path, run: Digest) -> tuple[dict[str, str], int]:
    """The images within the budget, `<seq>-<camera>` -> data URI, and the number of images left out."""
    chosen: dict[str, str] = {}
    spent = left_out = 0
    for look in _by_interest(run):
        for camera, name in (look.get("images") or {}).items():
            if spent >= PICTURE_BUDGET:
                left_out += 1
                continue
            try:
                content = jpeg_of(folder, name)
            except FileError:
                left_out += 1
                continue
            chosen[f"{look['seq']}-{camera}"] = embedded(content)
            spent += len(content)
    return chosen, left_out


def jpeg_of(folder: Path, name: str) -> bytes:
    """An image of a run as a JPEG for a page. Raises FileError."""
    image = read_grey(Path(name), folder)
    return cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1].tobytes()


def embedded(jpeg: bytes) -> str:
    """A JPEG as a data URI."""
    return "data:image/jpeg;base64," + base64.b64encode(jpeg).decode()


def _by_interest(run: Digest) -> Iterable[dict[str, Any]]:
    """The looks of failed cycles, then of the others, newest first, then those outside of cycles."""
    failed = [c for c in run.cycles if c.outcome not in ("picked", "empty")]
    rest = [c for c in reversed(run.cycles) if c.outcome in ("picked", "empty")]
    for cycle in [*failed, *rest]:
        yield from (s.look for s in cycle.stops)
    yield from (r for r in run.outside if r["kind"] == "look")
