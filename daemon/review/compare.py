"""Compare what two runs used: differing lines of configuration and calibration, and the models."""

from difflib import unified_diff
from pathlib import Path
from typing import Any

from daemon.review.digest import Digest, short_hash
from daemon.store.outside import FileError, read_below
from daemon.store.yamlfile import LARGEST_BYTES


def kept_differences(before_folder: Path, before: Digest, after_folder: Path, after: Digest) -> list[dict[str, Any]]:
    """One entry each for config, calibration and model: both hashes, and the differing lines of the text files."""
    entries = []
    for name in ("config", "calibration"):
        files = [(d.start or {}).get(name) for d in (before, after)]
        lines = [_lines(folder, file) for folder, file in zip((before_folder, after_folder), files, strict=True)]
        changed = [
            line
            for line in unified_diff(lines[0], lines[1], before.name, after.name, n=0, lineterm="")
            if not line.startswith("@@")
        ]
        entries.append(_entry(name, files[0], files[1], changed))
    models = [d.models()[-1] if d.models() else None for d in (before, after)]
    entries.append(_entry("model", models[0], models[1], []))
    return entries


def _entry(name: str, before: str | None, after: str | None, lines: list[str]) -> dict[str, Any]:
    return {
        "name": name,
        "before": short_hash(before),
        "after": short_hash(after),
        "same": before == after and before is not None,
        "lines": lines,
    }


def _lines(folder: Path, file: str | None) -> list[str]:
    try:
        return read_below(folder, file, LARGEST_BYTES).decode().splitlines() if file else []
    except (FileError, UnicodeDecodeError):
        return []
