"""Calibrations made in this cell: each stored by its number, which one is in use, and the way back.

calibration/<kind of cell>/0001.yaml, state.json {"current", "instead_of"}       in the state folder

They take precedence over the file that the configuration names, until that file changes: whoever replaces it wants the
new one used.
"""

import hashlib
import os
import tempfile
from datetime import UTC, datetime
from pathlib import Path

import msgspec

from daemon.store.files import failing_as, number_of, write_atomically
from daemon.store.json_file import read_json, write_json
from daemon.store.outside import FileError, read_file
from daemon.store.yamlfile import LARGEST_BYTES

CONFIGURED = 0
"""The number of the file that the configuration names."""


class _CalibrationState(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    current: int = CONFIGURED
    instead_of: str = ""
    """sha256 of the configured file at the time when `current` was taken into use."""


class Calibrations:
    """The calibrations of one kind of cell. One writer: the daemon."""

    def __init__(self, state: Path, kind: str, configured: Path) -> None:
        self.folder, self.configured = state / "calibration" / kind, configured

    @property
    def current(self) -> int:
        """The number of the calibration in use. Raises FileError."""
        state = self._state()
        return state.current if state.current and state.instead_of == self._digest() else CONFIGURED

    @property
    def passed_over(self) -> int | None:
        """The calibration no longer used because the configured file has changed. Raises FileError."""
        state = self._state()
        return state.current if state.current and state.instead_of != self._digest() else None

    @property
    def in_use(self) -> Path:
        """The file of the calibration in use. Raises FileError."""
        return self.path(self.current)

    def path(self, number: int) -> Path:
        return self.configured if number == CONFIGURED else self.folder / f"{number:04d}.yaml"

    def numbers(self) -> list[int]:
        """The numbers of all stored calibrations, oldest first."""
        numbers = (number_of(p.stem) for p in self.folder.glob("*.yaml"))
        return sorted(number for number in numbers if number is not None)

    def made(self, number: int) -> str:
        """Return when the file of a number was written, UTC."""
        seconds = self.path(number).stat().st_mtime
        return datetime.fromtimestamp(seconds, UTC).isoformat(timespec="minutes")[:16].replace("T", " ")

    def check(self) -> None:
        """Check that a new calibration can be stored. Raises FileError."""
        with failing_as(FileError, f"{self.folder}: a calibration cannot be stored here"):
            self.folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=self.folder) as file:
                file.write(bytes(4096))
                file.flush()
                os.fsync(file.fileno())
        self._state()

    def keep(self, content: bytes) -> int:
        """Store a new calibration and take it into use; returns its number. Raises FileError."""
        number = max(self.numbers(), default=0) + 1
        with failing_as(FileError, f"{self.path(number)}: not written"):
            write_atomically(self.path(number), content)
        self.use(number)
        return number

    def use(self, number: int) -> None:
        """Take a stored calibration, or the configured file, into use. Raises FileError."""
        write_json(self.folder / "state.json", _CalibrationState(number, self._digest() if number else ""))

    def _state(self) -> _CalibrationState:
        mend = "remove it, and `calibrate use N`"
        return read_json(self.folder / "state.json", _CalibrationState, mend) or _CalibrationState()

    def _digest(self) -> str:
        try:
            return hashlib.sha256(read_file(self.configured, LARGEST_BYTES)).hexdigest()
        except FileError:
            return ""
