"""Calibrations that were made here: each kept by its number, which one is in use, and the way back.

calibration/<kind of cell>/0001.yaml, state.json {"current", "instead_of"}       in the folder of the state

They go before the file that the configuration names, as long as that is the one it was when they were made: whoever
puts another one there means that one.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
from datetime import UTC, datetime
from pathlib import Path

import msgspec

from daemon.errors import FacetdError
from daemon.store.files import number_of, write_atomically
from daemon.store.outside import FileError, read_file

LARGEST_BYTES = 1_000_000
CONFIGURED = 0
"""The number of the file that the configuration names."""


class CalibrationsError(FacetdError):
    """A calibration cannot be kept or found: where, and why."""


class _CalibrationState(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    current: int = CONFIGURED
    instead_of: str = ""
    """sha256 of the configuration's file when the current one was taken into use."""


class Calibrations:
    """Those of one kind of cell. One writer: the daemon."""

    def __init__(self, state: Path, kind: str, configured: Path) -> None:
        self.folder, self.configured = state / "calibration" / kind, configured

    @property
    def current(self) -> int:
        """The number in use. Raises CalibrationsError."""
        state = self._state()
        return state.current if state.current and state.instead_of == self._digest() else CONFIGURED

    @property
    def passed_over(self) -> int | None:
        """The one made here that is not in use, because the configuration's file is another since. Raises
        CalibrationsError."""
        state = self._state()
        return state.current if state.current and state.instead_of != self._digest() else None

    @property
    def in_use(self) -> Path:
        """Its file. Raises CalibrationsError."""
        return self.path(self.current)

    def path(self, number: int) -> Path:
        """The file of a number."""
        return self.configured if number == CONFIGURED else self.folder / f"{number:04d}.yaml"

    def numbers(self) -> list[int]:
        """Every one that was made here, oldest first."""
        numbers = (number_of(p.stem) for p in self.folder.glob("*.yaml"))
        return sorted(number for number in numbers if number is not None)

    def made(self, number: int) -> str:
        """When its file was written, UTC."""
        seconds = self.path(number).stat().st_mtime
        return datetime.fromtimestamp(seconds, UTC).isoformat(timespec="minutes")[:16].replace("T", " ")

    def check(self) -> None:
        """Raise CalibrationsError where one that is made now could not be kept."""
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=self.folder) as file:
                file.write(bytes(4096))
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            raise CalibrationsError(f"{self.folder}: a calibration could not be kept here: {error.strerror}") from None
        self._state()

    def keep(self, content: bytes) -> int:
        """Keep a new one and take it into use; gives its number. Raises CalibrationsError."""
        number = max(self.numbers(), default=0) + 1
        try:
            write_atomically(self.path(number), content)
        except OSError as error:
            raise CalibrationsError(f"{self.path(number)}: not written: {error.strerror or error}") from None
        self.use(number)
        return number

    def use(self, number: int) -> None:
        """Take one that there is into use. Raises CalibrationsError."""
        path = self.folder / "state.json"
        try:
            write_atomically(path, msgspec.json.encode(_CalibrationState(number, self._digest() if number else "")))
        except OSError as error:
            raise CalibrationsError(f"{path}: not written: {error.strerror or error}") from None

    def _state(self) -> _CalibrationState:
        path = self.folder / "state.json"
        try:
            return msgspec.json.decode(read_file(path, LARGEST_BYTES), type=_CalibrationState)
        except (FileError, msgspec.MsgspecError, RecursionError, UnicodeDecodeError) as error:
            if not os.path.lexists(path):
                return _CalibrationState()
            raise CalibrationsError(f"{path}: cannot be read: {error}; remove it, and `calibrate use N`") from None

    def _digest(self) -> str:
        try:
            return hashlib.sha256(read_file(self.configured, LARGEST_BYTES)).hexdigest()
        except FileError:
            return ""
