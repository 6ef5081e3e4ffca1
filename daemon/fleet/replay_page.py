"""Report of a replay: one offline HTML page, each difference with its images."""

import tempfile
from collections.abc import Sequence
from pathlib import Path

from daemon.events.records import Json, Record, record_of
from daemon.fleet.replay_results import count_by_kind
from daemon.fleet.store import Store, StoreError, open_store
from daemon.review.digest import LookStep
from daemon.review.page import PAGE_BYTES, embedded, jpeg_of, render
from daemon.review.pagedata import stop_json
from daemon.store.outside import FileError, open_below
from daemon.store.runs import RUN

REPORT = "report.html"
SHOWN = 300
"""Most differences shown one by one; the counts include all."""


def write_replay_page(
    out: Store, total: Json, found: Sequence[Json], folders: Sequence[str], chosen: Sequence[str]
) -> str:
    """Write report.html into the replay's folder; returns its path. folders: of the runs; chosen: the files of --with.
    A difference whose run is no longer available has no images. Raises OSError."""
    rows, pictures, spent = [], {}, 0
    for number, one in enumerate(found[:SHOWN]):
        row: Json = {k: v for k, v in one.items() if k != "now"} | {"looks": None}
        record, images = _recorded(one, folders) if spent < PAGE_BYTES else (None, {})
        if record is not None:
            row["looks"] = [
                stop_json(LookStep(None, "", r, None, ())) for r in (record, record | {"scene": one["now"]})
            ]
        for camera, image in images.items():
            pictures[f"{number}-{camera}"] = embedded(image)
            spent += len(image)
        rows.append(row)
    data = {
        "title": "a replay",
        "total": total,
        "with": [_display_name(name) for name in chosen] or ["today's release"],
        "kinds": count_by_kind(found),
        "differences": rows,
        "more": max(len(found) - SHOWN, 0),
    }
    out.write(render("replay", data, pictures, "daemon.fleet").encode(), REPORT)
    return out.path(REPORT)


def _display_name(name: str) -> str:
    """A file's name; of one named by its hash, the first digits."""
    stem, _, suffix = Path(name).name.partition(".")
    return f"{stem[:8]}.{suffix}" if len(stem) == 64 else Path(name).name


def _recorded(one: Json, folders: Sequence[str]) -> tuple[Record | None, dict[str, bytes]]:
    """The look's record and its images as JPEG, by camera."""
    for where in folders:
        try:
            if Path(where).name == one["run"]:
                return _look(Path(where), one["seq"])
            if not (Path(where) / RUN).exists():
                names = [RUN, *(f"images/{one['seq']:06d}-{camera}.png" for camera in ("left", "right"))]
                with tempfile.TemporaryDirectory() as spare:
                    return _look(open_store(where).fetch(one["cell"], one["run"], names, Path(spare)), one["seq"])
        except (FileError, StoreError):
            continue
    return None, {}


def _look(folder: Path, seq: int) -> tuple[Record | None, dict[str, bytes]]:
    mark = b'"seq":%d,' % seq
    with open_below(folder, RUN) as file:
        line = next((line for line in file if mark in line[:64]), None)
    if line is None:
        return None, {}
    record = record_of(line)
    return record, {camera: jpeg_of(folder, name) for camera, name in (record.get("images") or {}).items()}
