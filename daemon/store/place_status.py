"""Status of each place on the disk: free, claimed, set, seen right, off, missing, or emptied by hand.

One owner (`PlaceStatuses`), one file in the state folder. It is written whole and synced before anything follows from
it: before a part is carried to a place it is claimed, before the gripper opens it is set. A daemon that is killed at
any line therefore finds a place that it may have filled as one that it must look at, never as a free one.

A status is of a spot, not of a name: the file keeps where the place was. A place that has moved since by more than its
tolerance, or that lies where something was left that no place answers for any more, is to be looked at before it is
used. That is worked out at each reading from what is on the disk and where the places are now, so that it does not
matter who edited places.yaml when.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta

from daemon import frames
from daemon.arrays import Array
from daemon.store.json_file import read_json, write_json
from daemon.store.outside import FileError

FILE = "place-status.json"
"""File name in the state folder."""
MEND = "look at every place, delete the file, and set each with `place check` or `place clear`"
MAX_LEFTOVERS = 1000
"""Largest number of spots with a left part that are stored; older ones are dropped."""
AT_PLACE_MM = 40.0
"""A part counts as at a place where their middles are no farther apart."""


class PlaceStatus(StrEnum):
    """What is known of a place."""

    FREE = "free"
    """No part was ever set down there, or a look showed none."""
    CLAIMED = "claimed"
    """A part is on its way there."""
    SET = "set"
    """The gripper opened there, or was about to; no look has confirmed it yet."""
    RIGHT = "seen right"
    """A look showed the part there, within tolerance."""
    OFF = "off"
    """A look showed the part out of tolerance, or something else there."""
    MISSING = "missing"
    """A part was set down there, and the look after it did not show it."""
    EMPTIED = "emptied by hand"
    """An operator reported it (`place clear`)."""
    TO_LOOK_AT = "to be looked at"
    """Unknown: the place has moved, or a part was left there. Never stored."""


FILLABLE = frozenset({PlaceStatus.FREE, PlaceStatus.EMPTIED})
"""A part may be brought there."""
UNSEEN = frozenset({PlaceStatus.CLAIMED, PlaceStatus.SET, PlaceStatus.TO_LOOK_AT})
"""Statuses of places to be looked at before a part is brought there."""
LEADS_TO: dict[PlaceStatus, frozenset[PlaceStatus]] = {
    PlaceStatus.FREE: frozenset({PlaceStatus.CLAIMED, PlaceStatus.RIGHT, PlaceStatus.OFF}),
    PlaceStatus.EMPTIED: frozenset({PlaceStatus.CLAIMED, PlaceStatus.RIGHT, PlaceStatus.OFF}),
    PlaceStatus.CLAIMED: frozenset({PlaceStatus.SET, PlaceStatus.FREE, PlaceStatus.RIGHT, PlaceStatus.OFF}),
    PlaceStatus.SET: frozenset({PlaceStatus.RIGHT, PlaceStatus.OFF, PlaceStatus.MISSING, PlaceStatus.FREE}),
    PlaceStatus.RIGHT: frozenset({PlaceStatus.OFF, PlaceStatus.FREE}),
    PlaceStatus.OFF: frozenset({PlaceStatus.RIGHT, PlaceStatus.FREE}),
    PlaceStatus.MISSING: frozenset({PlaceStatus.RIGHT, PlaceStatus.OFF, PlaceStatus.FREE}),
    PlaceStatus.TO_LOOK_AT: frozenset({PlaceStatus.RIGHT, PlaceStatus.OFF, PlaceStatus.FREE}),
}
"""Statuses that may follow each status. EMPTIED, and the present status again, are always allowed."""


@dataclass(frozen=True, eq=False)
class PlaceSpot:
    """Where the part of a place lies: middle_mm (3,), world mm, mean of its corners; turn (3, 3): world_from_part;
    reach_mm: distance of its farthest corner from the middle; the place's tolerances."""

    part: str
    middle_mm: Array
    turn: Array
    reach_mm: float
    tolerance_mm: float = 1.0
    tolerance_deg: float = 1.0


@dataclass(frozen=True)
class PlaceState:
    """What is known of one place. off_mm, off_deg: deviation of the part seen there; why: as text; at: time, UTC."""

    status: PlaceStatus = PlaceStatus.FREE
    off_mm: float | None = None
    off_deg: float | None = None
    why: str = ""
    at: str = ""


Point = tuple[float, float, float]


class _Spot(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """A stored spot; turn_deg: rotation vector."""

    part: Annotated[str, Meta(max_length=200)]
    middle_mm: Point
    turn_deg: Point
    reach_mm: Annotated[float, Meta(ge=0, le=1e6)]


class _State(msgspec.Struct, forbid_unknown_fields=True, omit_defaults=True, frozen=True):
    """A stored status. number: counts the writes; spot: where the place was then, None from an earlier release."""

    status: PlaceStatus
    off_mm: Annotated[float, Meta(ge=0, le=1e6)] | None = None
    off_deg: Annotated[float, Meta(ge=0, le=360)] | None = None
    why: Annotated[str, Meta(max_length=500)] = ""
    at: Annotated[str, Meta(max_length=40)] = ""
    number: Annotated[int, Meta(ge=0)] = 0
    spot: _Spot | None = None


class _StatusFile(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """left: parts that may still lie where places were that have moved or were dropped."""

    v: int
    places: dict[str, _State]
    left: tuple[_State, ...] = ()


class PlaceStatuses:
    """The statuses of one cell. One writer: the daemon."""

    def __init__(self, folder: Path) -> None:
        self.path = folder / FILE
        self._kept: _StatusFile | None = None
        self._spots: Mapping[str, PlaceSpot] = {}
        self._states: Mapping[str, PlaceState] | None = None
        """Of every name, by _kept and _spots; None until it is asked for."""

    def know(self, spots: Mapping[str, PlaceSpot]) -> None:
        """Set where the places are now, by name. A place without a spot keeps its stored status."""
        self._spots, self._states = spots, None

    def of(self, name: str) -> PlaceState:
        """The status of a place. Raises FileError."""
        if self._states is None:
            self._states = _known(self._file(), self._spots)
        return self._states.get(name, PlaceState())

    def put(
        self,
        name: str,
        status: PlaceStatus,
        off_mm: float | None = None,
        off_deg: float | None = None,
        why: str = "",
        spot: PlaceSpot | None = None,
    ) -> PlaceState:
        """Store a status, synced. spot: where the place is from now on, when it is taught; any status may follow then.
        Raises FileError, with the old status still valid; ValueError where this status cannot follow the old one."""
        before, file = self.of(name).status, self._file()
        follows = spot is not None or status in (before, PlaceStatus.EMPTIED, *LEADS_TO[before])
        if status is PlaceStatus.TO_LOOK_AT or not follows:
            raise ValueError(f"place {name}: {status} cannot follow {before}")
        now, at = spot or self._spots.get(name), datetime.now(UTC).isoformat(timespec="seconds")
        leftovers, old = list(file.left), file.places.get(name)
        if old is not None and now is not None and _moved(old, now):
            leftovers.append(old)
        if now is not None:
            leftovers = [each for each in leftovers if not _is_answered(each, now)]
        number = 1 + max((each.number for each in (*file.places.values(), *file.left)), default=0)
        state = _State(status, off_mm, off_deg, why[:500], at, number, None if now is None else _kept(now))
        self._write({**file.places, name: state}, leftovers)
        return _state_of(state)

    def forget(self, names: set[str]) -> None:
        """Remove places that are no longer in the file of places; what may lie there is left. Raises FileError."""
        file = self._file()
        dropped = [state for name, state in file.places.items() if name in names]
        self._write({k: state for k, state in file.places.items() if k not in names}, [*file.left, *dropped])

    def _file(self) -> _StatusFile:
        if self._kept is None:
            self._kept = self._read()
        return self._kept

    def _read(self) -> _StatusFile:
        file = read_json(self.path, _StatusFile, MEND) or _StatusFile(2, {})
        if any(s.status is PlaceStatus.TO_LOOK_AT for s in (*file.places.values(), *file.left)):
            raise FileError(f"{self.path}: damaged, a status that is never written; {MEND}")
        return file

    def _write(self, places: dict[str, _State], leftovers: list[_State]) -> None:
        kept = [each for each in leftovers if each.status not in FILLABLE and each.spot is not None][-MAX_LEFTOVERS:]
        file = _StatusFile(2, places, tuple(kept))
        write_json(self.path, file)
        self._kept, self._states = file, None


def _known(file: _StatusFile, spots: Mapping[str, PlaceSpot]) -> dict[str, PlaceState]:
    """The status of every place that is stored or has a spot."""
    moved = {name: _moved(state, spots[name]) for name, state in file.places.items() if name in spots}
    # What may lie where no place of today answers for it: of places that are gone, and of those that moved.
    lying = [s for name, s in file.places.items() if s.status not in FILLABLE and moved.get(name, True)]
    leftovers = [*file.left, *lying]
    return {
        name: _known_at(file.places.get(name), spots.get(name), moved.get(name, ""), leftovers)
        for name in {**file.places, **spots}
    }


def _known_at(state: _State | None, now: PlaceSpot | None, moved: str, leftovers: Sequence[_State]) -> PlaceState:
    """The status of one place; left: parts that may lie anywhere."""
    if moved:
        return PlaceState(PlaceStatus.TO_LOOK_AT, why=moved, at="" if state is None else state.at)
    since = -1 if state is None else state.number
    for each in leftovers:
        if now is not None and each.number > since and _overlap(each, now):
            part = "something" if each.spot is None else each.spot.part
            why = f"a place that is no longer there was {each.status} here: {part} may lie here"
            return PlaceState(PlaceStatus.TO_LOOK_AT, why=why, at=each.at)
    return PlaceState() if state is None else _state_of(state)


def _state_of(state: _State) -> PlaceState:
    return PlaceState(state.status, state.off_mm, state.off_deg, state.why, state.at)


def _kept(spot: PlaceSpot) -> _Spot:
    turn = np.degrees(frames.vector_from_rotation(spot.turn))
    return _Spot(spot.part, _point(spot.middle_mm), _point(turn), round(spot.reach_mm, 4))


def _point(values: Array) -> Point:
    x, y, z = (round(float(each), 4) for each in values)
    return x, y, z


def _moved(state: _State, now: PlaceSpot) -> str:
    """Say how the place's pose differs from when its status was stored; empty: within its tolerance."""
    before, was = state.spot, f"it was {state.status}"
    if before is None:
        return f"{was} under an earlier release, which did not keep where"
    if before.part != now.part:
        return f"{was} with {before.part}, and is now for {now.part}"
    away_mm = float(np.linalg.norm(now.middle_mm - np.array(before.middle_mm)))
    if away_mm > now.tolerance_mm:
        return f"{was} {away_mm:.1f} mm from where it is now"
    turned = frames.rotation_from_vector(np.radians(before.turn_deg))
    turned_deg = float(np.degrees(frames.angle_between(turned, now.turn)))
    return f"{was} turned by {turned_deg:.1f} degrees from how it is now" if turned_deg > now.tolerance_deg else ""


def _overlap(leftover: _State, now: PlaceSpot) -> bool:
    """Whether a part left at one spot may reach to another."""
    if leftover.spot is None:
        return False
    reach_mm = max(leftover.spot.reach_mm + now.reach_mm, AT_PLACE_MM)
    return _apart_mm(leftover.spot, now) < reach_mm + _beside_mm(leftover)


def _is_answered(leftover: _State, now: PlaceSpot) -> bool:
    """Whether a look at a place shows what was left at a spot."""
    if leftover.spot is None:
        return False
    return _apart_mm(leftover.spot, now) + _beside_mm(leftover) < AT_PLACE_MM + now.tolerance_mm


def _beside_mm(leftover: _State) -> float:
    """The largest distance from a spot at which a part left there may lie."""
    return AT_PLACE_MM if leftover.status is PlaceStatus.OFF else 0.0


def _apart_mm(spot: _Spot, now: PlaceSpot) -> float:
    return float(np.linalg.norm(np.array(spot.middle_mm) - now.middle_mm))
