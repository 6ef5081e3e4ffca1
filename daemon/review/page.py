"""Write the HTML page of a run: one file with data, images and the script that shows them; no network needed."""

import base64
import gzip
import html
import json
from collections.abc import Container, Iterable
from datetime import datetime, timedelta
from difflib import unified_diff
from importlib import resources
from pathlib import Path
from typing import Any
from urllib.parse import quote

import cv2

from daemon.errors import spelt
from daemon.review.brief import read_runs_with_picks
from daemon.review.digest import Digest, digest, short_hash
from daemon.review.pagedata import page_data
from daemon.review.production import compared, production
from daemon.store.files import being_written, write_atomically
from daemon.store.outside import FileError, open_below, read_below
from daemon.store.pictures import read_grey
from daemon.store.runs import RunError, check_wire, list_runs, read_run
from daemon.store.yamlfile import LARGEST_BYTES

PAGE_BYTES = 4_800_000
"""Largest size, bytes, of a page beside its program. Failed cycles have their looks and images first."""
DETAIL_BYTES = 6_000_000
"""Largest part of it, bytes, for what a page shows of opened cycles, before it is compressed to about a fourth."""
LINK_BYTES = 50
"""About what naming an image takes."""
JPEG_QUALITY = 72
WEEK = timedelta(days=7)


def write_page(folder: Path, out: Path, against: Path | None = None) -> Path:
    """Write the page of a run, compared with the run `against` where given; returns out. Raises RunError, OSError."""
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
    cycles = {cycle.number: cycle for cycle in run.cycles}
    looks = [s.look for number in _pack_details(data) for s in cycles[number].stops]
    looks += [r for r in run.outside if r["kind"] == "look"]
    room = PAGE_BYTES - len(_embedded(data))
    pictures, data["pictures_left_out"] = _pictures(folder, looks, room, out.parent == folder)
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
    """Return when a run began (UTC), from its name; None where the name is not a time."""
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
    """A page as text: the files `name`.html, .css and .js of `package` in the frame that all pages share, with data and
    images. library: script of others that it uses; shared: ours that other pages use too."""
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


def _pack_details(data: dict[str, Any]) -> list[int]:
    """Move what is shown of a cycle once it is opened, and the looks outside of cycles, into `details`, compressed.
    Cycles for which there is no room stay without. Returns the numbers of the others, most interesting first."""
    rows, packed, left = data["cycles"], dict[str, Any](), DETAIL_BYTES
    well = [row for row in rows if row["outcome"] in ("picked", "empty")]
    for row in [*(row for row in rows if row["outcome"] not in ("picked", "empty")), *reversed(well)]:
        details = {name: row.pop(name) for name in ("stops", "decisions")}
        left -= len(json.dumps(details, separators=(",", ":")))
        if left >= 0:
            packed[str(row["n"])] = details
    data["details_left_out"] = len(rows) - len(packed)
    plain = json.dumps({"cycles": packed, "outside": data.pop("outside")}, separators=(",", ":"))
    data["details"] = base64.b64encode(gzip.compress(plain.encode(), mtime=0)).decode()
    return [int(number) for number in packed]


def _pictures(
    folder: Path, looks: Iterable[dict[str, Any]], room: int, in_run_folder: bool
) -> tuple[dict[str, str], int]:
    """The images of looks, `<seq>-<camera>` -> data URI while there is room (bytes), and how many are left out.
    in_run_folder: the page lies in the run's folder, and shows the others from their files."""
    chosen: dict[str, str] = {}
    files = [(look["seq"], look.get("images") or {}) for look in looks]
    images = [(f"{seq}-{camera}", name) for seq, of in files for camera, name in of.items()]
    room -= LINK_BYTES * len(images)
    for key, name in images:
        try:
            picture = embedded(jpeg_of(folder, name)) if room > 0 else ""
            room -= len(picture)
            if room > 0:
                chosen[key] = picture
            elif in_run_folder:
                with open_below(folder, name):
                    chosen[key] = quote(name)
        except FileError:
            continue
    return chosen, len(images) - len(chosen)


def jpeg_of(folder: Path, name: str) -> bytes:
    """An image of a run as a JPEG for a page. Raises FileError."""
    image = read_grey(Path(name), folder)
    return cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1].tobytes()


def embedded(jpeg: bytes) -> str:
    """A JPEG as a data URI."""
    return "data:image/jpeg;base64," + base64.b64encode(jpeg).decode()


def kept_differences(before_folder: Path, before: Digest, after_folder: Path, after: Digest) -> list[dict[str, Any]]:
    """Both hashes of config, calibration and model, and the lines in which the text files differ."""
    entries = []
    for name in ("config", "calibration"):
        files = [(d.start or {}).get(name) for d in (before, after)]
        old, new = (_lines(folder, file) for folder, file in zip((before_folder, after_folder), files, strict=True))
        changed = unified_diff(old, new, before.name, after.name, n=0, lineterm="")
        entries.append(_entry(name, files[0], files[1], [line for line in changed if not line.startswith("@@")]))
    models = [d.models()[-1] if d.models() else None for d in (before, after)]
    entries.append(_entry("model", models[0], models[1], []))
    return entries


def _entry(name: str, before: str | None, after: str | None, lines: list[str]) -> dict[str, Any]:
    same = before == after and before is not None
    return {"name": name, "before": short_hash(before), "after": short_hash(after), "same": same, "lines": lines}


def _lines(folder: Path, file: str | None) -> list[str]:
    try:
        return read_below(folder, file, LARGEST_BYTES).decode().splitlines() if file else []
    except (FileError, UnicodeDecodeError):
        return []
