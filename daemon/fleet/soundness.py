"""Find damage in a run: missing records, breaks in the ledger's hash chain, changed kept files, incomplete images.

A torn last line (killed daemon) and losses that the run itself reports (full disk) do not count as damage.
"""

import os
from collections import deque
from itertools import pairwise
from pathlib import Path

from daemon.store.files import being_written
from daemon.store.outside import FileError, open_below
from daemon.store.runs import RUN, RunRecords, check_wire, kept_file, lines_of

PNG_BEGIN, PNG_END = b"\x89PNG\r\n\x1a\n", b"IEND\xaeB`\x82"
WIRE = "wire.jsonl"


def files_of(folder: Path) -> list[str]:
    """The names of a run's own files in its folder, without pages and exports made from it."""
    found = [folder / RUN, folder / WIRE, *(folder / "images").glob("*"), *(folder / "kept").glob("*")]
    return sorted(f.relative_to(folder).as_posix() for f in found if f.is_file() and not f.is_symlink())


def finished(folder: Path, run: RunRecords, later: bool) -> bool:
    """Whether a run is complete: it ended, or its cell has begun another one since (later)."""
    ended = any(r["kind"] == "run_end" for r in run.records[-1:])
    return (ended or later) and not being_written(folder / RUN)


def damages(folder: Path, run: RunRecords) -> list[str]:
    """One line of text for each damage; none for a sound run."""
    gap = any(r["kind"] == "gap" for r in run.records)
    found = [line.removeprefix(f"{folder}/") for line in run.skipped if "torn last line" not in line]
    found += [] if gap else _missing(run)
    torn_end = _torn_end(folder)
    breaks = [line for line in check_wire(folder) if not line.startswith(f"{torn_end}:")]
    found += [line for line in breaks if not (gap and "are missing" in line)]
    for name in files_of(folder):
        try:
            if name.startswith("kept/"):
                kept_file(folder, name)
            elif name.startswith("images/") and not _complete_image(folder, name):
                found.append(f"{name}: not a complete image")
        except FileError as error:
            found.append(str(error).removeprefix(f"{folder}/"))
    ended = any(r["kind"] == "run_end" for r in run.records)
    return found + ([] if gap or not ended else _missing_images(folder, run))


def _missing(run: RunRecords) -> list[str]:
    pairs = pairwise([-1, *(r["seq"] for r in run.records)])
    return [f"{RUN}: record {now} follows record {before}" for before, now in pairs if now != before + 1]


def _torn_end(folder: Path) -> str | None:
    """`wire.jsonl:<number>` of an incomplete last line; None where it is complete."""
    try:
        with open_below(folder, WIRE) as file:
            last = deque(lines_of(file), 1)
    except FileError:
        return None
    return None if not last or last[0][2] else f"{WIRE}:{last[0][0]}"


def _complete_image(folder: Path, name: str) -> bool:
    with open_below(folder, name) as file:
        begin = file.read(len(PNG_BEGIN))
        file.seek(-len(PNG_END), 2) if file.seek(0, 2) > len(PNG_END) else None
        return begin == PNG_BEGIN and file.read() == PNG_END


def _missing_images(folder: Path, run: RunRecords) -> list[str]:
    names = [n for r in run.records if r["kind"] == "look" for n in (r.get("images") or {}).values()]
    return [f"{name}: the image of a recorded look is missing" for name in names if not os.path.isfile(folder / name)]
