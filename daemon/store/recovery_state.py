"""Recovery state: what the daemon must know after a restart, in one small file: where a pick was interrupted, whether
the gripper holds a part, what `auto` has still to pick, and which fault was active.

Two slots are written in turn, into space allocated when the file was made: a power cut damages only the slot that is
being written, and a full disk does not matter. A counter shows which slot is newer, independent of clocks.

The file and the key in it keep the name `standing` that earlier releases gave them.
"""

import os
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec

from daemon.errors import spelt
from daemon.events.pick_order import PickOrder, read_order
from daemon.store.files import OpenFile, naming
from daemon.store.outside import FileError, read_file

SLOT = 4096
LONGEST_TEXT = 200
FILE = "standing"
"""Name of the file in the state folder."""


class RecoveryState(msgspec.Struct, frozen=True, omit_defaults=True):
    """The state of a run: cycle and state of the pick, the last gripper command, the part.

    in_doubt: nobody resolved what an earlier daemon left, or it ended with a part perhaps in the gripper; ended: the
    run ended in order; damage: what is wrong with the file that this was read from.
    """

    run: str
    cycle: int | None = None
    state: str | None = None
    hand_closed: bool = False
    label: str | None = None
    auto: PickOrder | None = None
    fault: str | None = None
    in_doubt: bool = False
    ended: bool = False
    damage: str = ""

    @property
    def needs_attention(self) -> bool:
        """Whether a person must check the cell before anything moves."""
        cut_off = self.cycle is not None or self.hand_closed or self.auto is not None
        return self.in_doubt or self.fault is not None or (cut_off and not self.ended)


class RecoverySlot(msgspec.Struct):
    """One slot of the file: the state, and the number of the write."""

    counter: int
    standing: RecoveryState


def after(before: RecoveryState, kind: str, fields: Mapping[str, Any]) -> RecoveryState:
    """The recovery state after a record of the run log. Only `resume` ends a doubt of an earlier daemon (`left`)."""
    change: dict[str, Any] = {}
    match kind:
        case "left":
            change = {name: fields.get(name) for name in ("cycle", "state", "label", "fault")}
            auto = fields.get("auto")
            change |= {"run": fields.get("run") or before.run, "in_doubt": True,
                       "hand_closed": bool(fields.get("hand_closed")), "auto": auto and read_order(auto)}  # fmt: skip
        case "cycle_start":
            change = {"cycle": fields.get("cycle"), "label": fields.get("target")}
        case "cycle_end":
            change = {"cycle": None, "label": None}
        case "estimate":
            change = {"label": fields.get("label")}
        case "fault":
            change = {"fault": str(fields.get("text"))}
        case "state":
            change = {"state": fields.get("to")}
            if fields.get("from") == "fault" and fields.get("event") == "resume":
                change |= {"cycle": None, "in_doubt": False, "fault": None}
            elif fields.get("event") == "full_hand":
                change |= {"label": None}
            elif fields.get("event") in ("binned", "set_down") and before.auto is not None:
                left = before.auto.brought(before.label)
                change["auto"] = None if left.done else left
        case "auto":
            order = fields.get("order") or {name: fields.get(name) for name in ("count", "every_s")}
            change = {"auto": read_order(order) if fields.get("on") else None}
        case "hand" if fields.get("sent") is not False:
            change = {"hand_closed": bool(fields.get("closed"))}
        case "holding":
            change = {"hand_closed": fields.get("held") is not False}
        case "run_end" if "holding" in fields:
            holding = fields["holding"] is not False
            change = {"ended": True, "in_doubt": before.in_doubt or holding, "hand_closed": holding}
    cut = {name: spelt(value[:LONGEST_TEXT]) if isinstance(value, str) else value for name, value in change.items()}
    return msgspec.structs.replace(before, **cut)


class RecoveryFile(OpenFile):
    """The recovery file, open for writing by one process. Raises OSError."""

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
        """Write an empty state into a new file: from then on an empty file means a lost state. Raises OSError."""
        if self._counter == 0:
            self.write(RecoveryState(run))
            self.sync()

    def write(self, state: RecoveryState) -> None:
        """Write a state into the older slot. Raises OSError."""
        content = msgspec.json.encode(RecoverySlot(self._counter + 1, state))
        slot = f"{zlib.crc32(content):08x} ".encode() + content
        with naming(self.path):
            os.pwrite(self._handle, slot.ljust(SLOT - 1) + b"\n", SLOT * ((self._counter + 1) % 2))
        self._counter += 1


def read_interrupted_state(path: Path, ran_before: bool) -> RecoveryState | None:
    """The state to check that the last daemon left, else None. A lost or damaged file counts as one."""
    try:
        content = read_file(path, 2 * SLOT)
    except FileError as error:
        missing = not os.path.lexists(path)
        if missing and not ran_before:
            return None
        return _in_doubt(f"{path}: missing, although there were runs before" if missing else str(error))
    slots, damaged = _slots(content)
    newest = max(slots, key=lambda slot: slot.counter, default=None)
    if damaged:
        return _in_doubt(f"{path}: damaged", None if newest is None else newest.standing)
    if newest is None:
        return _in_doubt(f"{path}: empty, although there were runs before") if ran_before else None
    return newest.standing if newest.standing.needs_attention else None


def _in_doubt(damage: str, newest: RecoveryState | None = None) -> RecoveryState:
    return msgspec.structs.replace(newest or RecoveryState("before"), in_doubt=True, hand_closed=True, damage=damage)


def _slots(content: bytes) -> tuple[list[RecoverySlot], bool]:
    """The intact slots, and whether one is damaged. A slot that was never written is neither."""
    found, damaged = [], len(content) not in (0, 2 * SLOT)
    for start in (0, SLOT):
        slot = content[start : start + SLOT]
        checksum, _, text = slot.rstrip().partition(b" ")
        if not slot.strip(b"\0"):
            continue
        try:
            if int(checksum, 16) != zlib.crc32(text):
                raise ValueError
            found.append(msgspec.json.decode(text, type=RecoverySlot))
        except (ValueError, msgspec.MsgspecError):
            damaged = True
    return found, damaged
