"""Status of each place on the disk: free, claimed, set, seen right, off, missing, or emptied by hand.

One owner (`PlaceStatuses`), one file in the state folder. It is written whole and synced before anything follows from
it: before a part is carried to a place it is claimed, before the gripper opens it is set. A daemon that is killed at
any line therefore finds a place that it may have filled as one that it must look at, never as a free one.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import msgspec
from msgspec import Meta

from daemon.store.files import write_atomically
from daemon.store.outside import FileError, read_file

FILE = "place-status.json"
"""Its name in the state folder."""
LARGEST_BYTES = 1_000_000


class PlaceStatus(StrEnum):
    """What is known of a place."""

    FREE = "free"
    """Nothing was ever set down there, or a look showed nothing."""
    CLAIMED = "claimed"
    """A part is being brought there."""
    SET = "set"
    """The gripper opened there, or was about to; no look has shown yet how the part lies."""
    RIGHT = "seen right"
    """A look showed the part there, within tolerance."""
    OFF = "off"
    """A look showed the part there, outside of tolerance, or something else."""
    MISSING = "missing"
    """A part was set down there, and the look after it did not show it."""
    EMPTIED = "emptied by hand"
    """An operator said so."""


FILLABLE = frozenset({PlaceStatus.FREE, PlaceStatus.EMPTIED})
"""A part may be brought there."""
UNSEEN = frozenset({PlaceStatus.CLAIMED, PlaceStatus.SET})
"""Left by a pick that was cut off: looked at before anything is brought there."""
LEADS_TO: dict[PlaceStatus, frozenset[PlaceStatus]] = {
    PlaceStatus.FREE: frozenset({PlaceStatus.CLAIMED, PlaceStatus.RIGHT, PlaceStatus.OFF}),
    PlaceStatus.EMPTIED: frozenset({PlaceStatus.CLAIMED, PlaceStatus.RIGHT, PlaceStatus.OFF}),
    PlaceStatus.CLAIMED: frozenset({PlaceStatus.SET, PlaceStatus.FREE, PlaceStatus.RIGHT, PlaceStatus.OFF}),
    PlaceStatus.SET: frozenset({PlaceStatus.RIGHT, PlaceStatus.OFF, PlaceStatus.MISSING, PlaceStatus.FREE}),
    PlaceStatus.RIGHT: frozenset({PlaceStatus.OFF, PlaceStatus.FREE}),
    PlaceStatus.OFF: frozenset({PlaceStatus.RIGHT, PlaceStatus.FREE}),
    PlaceStatus.MISSING: frozenset({PlaceStatus.RIGHT, PlaceStatus.OFF, PlaceStatus.FREE}),
}
"""Which status may follow which; an operator's word (EMPTIED), and the status that a place has already, always may."""


class PlaceStatusError(FileError):
    """The status of a place cannot be read or kept: nothing is set down."""


@dataclass(frozen=True)
class PlaceState:
    """What is known of one place. off_mm, off_deg: how far from it the part was seen; why: in words; at: when, UTC."""

    status: PlaceStatus = PlaceStatus.FREE
    off_mm: float | None = None
    off_deg: float | None = None
    why: str = ""
    at: str = ""


class _State(msgspec.Struct, forbid_unknown_fields=True, omit_defaults=True):
    status: PlaceStatus
    off_mm: Annotated[float, Meta(ge=0, le=1e6)] | None = None
    off_deg: Annotated[float, Meta(ge=0, le=360)] | None = None
    why: Annotated[str, Meta(max_length=500)] = ""
    at: Annotated[str, Meta(max_length=40)] = ""


class _StatusFile(msgspec.Struct, forbid_unknown_fields=True):
    v: int
    places: dict[str, _State]


class PlaceStatuses:
    """Those of one cell. One writer: the daemon."""

    def __init__(self, folder: Path) -> None:
        self.path = folder / FILE
        self._states: dict[str, PlaceState] | None = None

    def of(self, name: str) -> PlaceState:
        """What is known of a place. Raises PlaceStatusError."""
        return self._all().get(name, PlaceState())

    def put(
        self, name: str, status: PlaceStatus, off_mm: float | None = None, off_deg: float | None = None, why: str = ""
    ) -> PlaceState:
        """Write a status down, synced. Raises PlaceStatusError, and then the one before holds; ValueError where the
        status cannot follow the one before."""
        before = self.of(name).status
        if status not in (before, PlaceStatus.EMPTIED) and status not in LEADS_TO[before]:
            raise ValueError(f"place {name}: {status} cannot follow {before}")
        now = datetime.now(UTC).isoformat(timespec="seconds")
        state = PlaceState(status, off_mm, off_deg, why[:500], now)
        self._write({**self._all(), name: state})
        return state

    def forget(self, names: set[str]) -> None:
        """Drop the status of places that the file of places no longer has. Raises PlaceStatusError."""
        self._write({name: state for name, state in self._all().items() if name not in names})

    def _all(self) -> dict[str, PlaceState]:
        if self._states is None:
            self._states = self._read()
        return self._states

    def _read(self) -> dict[str, PlaceState]:
        if not os.path.lexists(self.path):
            return {}
        try:
            file = msgspec.json.decode(read_file(self.path, LARGEST_BYTES), type=_StatusFile)
        except FileError as error:
            raise PlaceStatusError(str(error)) from None
        except (msgspec.MsgspecError, RecursionError, UnicodeDecodeError):
            text = "damaged: look at every place, delete the file, and set each with `place check` or `place clear`"
            raise PlaceStatusError(f"{self.path}: {text}") from None
        return {name: PlaceState(s.status, s.off_mm, s.off_deg, s.why, s.at) for name, s in file.places.items()}

    def _write(self, states: dict[str, PlaceState]) -> None:
        told = {name: _State(s.status, s.off_mm, s.off_deg, s.why, s.at) for name, s in states.items()}
        try:
            write_atomically(self.path, msgspec.json.encode(_StatusFile(1, told)))
        except OSError as error:
            raise PlaceStatusError(f"{self.path}: not kept: {error.strerror or error}") from None
        self._states = states
