"""The recovery state: what the daemon must know after a restart, in one small file. Where a pick was cut off, whether a
part is in the gripper, what `auto` had still to bring, and which fault was active.

Two slots are written in turn, into space taken when the file was made: a power cut spoils the one that is being written
and no other, and a full disk takes it all the same. A counter says which is the newer: neither clocks nor names do.

The file and the key in it keep the name `standing` that earlier releases gave them.
"""

from __future__ import annotations

import os
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec

from daemon.errors import spelt
from daemon.store.files import OpenFile, naming
from daemon.store.outside import FileError, read_file

SLOT = 4096
LONGEST_TEXT = 200
FILE = "standing"
"""Its name in the state folder."""


class Auto(msgspec.Struct, frozen=True):
    """What an `auto on` has still to bring; count None: until the table is empty."""

    count: int | None
    every_s: float | None

    def one_less(self) -> Auto | None:
        """After a part was put into the bin; None: nothing is left."""
        if self.count is None:
            return self
        return Auto(self.count - 1, self.every_s) if self.count > 1 else None


class RecoveryState(msgspec.Struct, frozen=True, omit_defaults=True):
    """The state of a run: cycle and state of the pick, the last gripper command, which part it was.

    in_doubt: what an earlier daemon left was not resolved, or it ended with a part perhaps in the gripper; ended: in
    order; damage: what is wrong with the file that this was read from.
    """

    run: str
    cycle: int | None = None
    state: str | None = None
    hand_closed: bool = False
    label: str | None = None
    auto: Auto | None = None
    fault: str | None = None
    in_doubt: bool = False
    ended: bool = False
    damage: str = ""

    @property
    def to_be_told(self) -> bool:
        """Whether somebody must look at the cell before anything moves."""
        cut_off = self.cycle is not None or self.hand_closed or self.auto is not None
        return self.in_doubt or self.fault is not None or (cut_off and not self.ended)


class _Slot(msgspec.Struct):
    counter: int
    standing: RecoveryState


def after(standing: RecoveryState, kind: str, fields: Mapping[str, Any]) -> RecoveryState:
    """The recovery state after a record of the run log (daemon/events/records.py). A doubt from before (`left`) stays
    until an operator's `resume`."""
    change: dict[str, Any] = {}
    match kind:
        case "left":
            change = {name: fields.get(name) for name in ("cycle", "state", "label", "fault")}
            auto = fields.get("auto")
            change |= {"run": fields.get("run") or standing.run, "in_doubt": True,
                       "hand_closed": bool(fields.get("hand_closed")), "auto": auto and Auto(**auto)}  # fmt: skip
        case "cycle_start" | "cycle_end":
            begins = kind == "cycle_start"
            change = {"cycle": fields.get("cycle"), "label": fields.get("target")} if begins else {}
            change = change or {"cycle": None, "label": None}
        case "estimate":
            change = {"label": fields.get("label")}
        case "fault":
            change = {"fault": str(fields.get("text"))}
        case "state":
            change = {"state": fields.get("to")}
            if fields.get("from") == "fault" and fields.get("event") == "resume":
                change |= {"cycle": None, "in_doubt": False, "fault": None}
            if fields.get("event") == "binned" and standing.auto is not None:
                change["auto"] = standing.auto.one_less()
        case "auto":
            change = {"auto": Auto(fields.get("count"), fields.get("every_s")) if fields.get("on") else None}
        case "hand" if fields.get("sent") is not False:
            change = {"hand_closed": bool(fields.get("closed"))}
        case "holding":
            change = {"hand_closed": fields.get("held") is not False}
        case "run_end" if "holding" in fields:
            holding = fields["holding"] is not False
            change = {"ended": True, "in_doubt": standing.in_doubt or holding, "hand_closed": holding}
    cut = {name: spelt(value[:LONGEST_TEXT]) if isinstance(value, str) else value for name, value in change.items()}
    return msgspec.structs.replace(standing, **cut)


class RecoveryFile(OpenFile):
    """The file, open for writing: one process has it. Raises OSError."""

    def __init__(self, path: Path) -> None:
        with naming(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            super().__init__(path, os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o640))
            try:
                os.posix_fallocate(self._handle, 0, 2 * SLOT)
            except OSError:
                os.close(self._handle)
                raise
        slots, _ = _slots(os.pread(self._handle, 2 * SLOT, 0))
        self._counter = max((slot.counter for slot in slots), default=0)

    def begin(self, run: str) -> None:
        """Where nothing was ever written, write that nothing stands: from then on a file that says nothing is one that
        was lost. Raises OSError."""
        if self._counter == 0:
            self.write(RecoveryState(run))
            self.sync()

    def write(self, standing: RecoveryState) -> None:
        """Put it into the older slot. Raises OSError."""
        content = msgspec.json.encode(_Slot(self._counter + 1, standing))
        slot = f"{zlib.crc32(content):08x} ".encode() + content
        with naming(self.path):
            os.pwrite(self._handle, slot.ljust(SLOT - 1) + b"\n", SLOT * ((self._counter + 1) % 2))
        self._counter += 1


def left_behind(path: Path, ran_before: bool) -> RecoveryState | None:
    """What the last daemon left that somebody must look at; else None. A file that cannot be believed, or is missing or
    says nothing where there were runs before, is such a thing: then nobody knows what the gripper holds."""
    try:
        content = read_file(path, 2 * SLOT)
    except FileError as error:
        missing = not os.path.lexists(path)
        if missing and not ran_before:
            return None
        return _unknown(f"{path}: missing, though there were runs before" if missing else str(error))
    slots, damaged = _slots(content)
    newest = max(slots, key=lambda slot: slot.counter, default=None)
    if damaged:
        return _unknown(f"{path}: damaged", None if newest is None else newest.standing)
    if newest is None:
        return _unknown(f"{path}: says nothing, though there were runs before") if ran_before else None
    return newest.standing if newest.standing.to_be_told else None


def _unknown(damage: str, known: RecoveryState | None = None) -> RecoveryState:
    known = known or RecoveryState(run="before")
    return msgspec.structs.replace(known, in_doubt=True, hand_closed=True, damage=damage)


def _slots(content: bytes) -> tuple[list[_Slot], bool]:
    """The slots that hold together, and whether one does not. One that was never written is none."""
    found, damaged = [], len(content) not in (0, 2 * SLOT)
    for start in (0, SLOT):
        slot = content[start : start + SLOT]
        told, _, text = slot.rstrip().partition(b" ")
        if not slot.strip(b"\0"):
            continue
        try:
            if int(told, 16) != zlib.crc32(text):
                raise ValueError
            found.append(msgspec.json.decode(text, type=_Slot))
        except (ValueError, msgspec.MsgspecError):
            damaged = True
    return found, damaged
