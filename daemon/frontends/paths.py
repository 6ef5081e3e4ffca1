"""Files that a line being typed may go on with: those where the operator sits, not where the daemon runs."""

from __future__ import annotations

import contextlib
from pathlib import Path

MOST = 200


def files_begun(typed: str) -> list[str] | None:
    """Every line that the typed one may become, where a file's name is being typed behind --mesh; else None."""
    before, space, begun = typed.rpartition(" ")
    if not space or not before.endswith(" --mesh"):
        return None
    folder, _, name = begun.rpartition("/")
    found: list[str] = []
    with contextlib.suppress(OSError, RuntimeError, ValueError):
        for path in sorted(Path(f"{folder}/" if "/" in begun else ".").expanduser().iterdir())[:MOST]:
            if path.name.startswith(name or "") and (name.startswith(".") or not path.name.startswith(".")):
                found.append(begun[: len(begun) - len(name)] + path.name + ("/" if path.is_dir() else ""))
    return [f"{before} {one}" for one in found if " " not in one]
