"""Store of taught views and trained models: views as images or drawings, models by version, and which one is in use.

views/<label>/<number>/{left.png, right.png, view.json}      a view appears whole or not at all
views/<label>/<number>/{mesh.stl or mesh.obj, view.json}     the same for a part taught from its drawing
models/<version>.npz, models/state.json                      {"current", "candidate", "history"}
models/last_views.json                                       {label: the highest number that was a view's}
"""

import contextlib
import fcntl
import json
import os
import shutil
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray

from daemon.errors import spelt_throughout
from daemon.events.records import MovedPairRecord, TableRecord
from daemon.quantities import WHOLE, whole
from daemon.store import folders
from daemon.store import model as files
from daemon.store.files import failing_as, number_of, plain, write_atomically
from daemon.store.json_file import read_json, write_json
from daemon.store.outside import JSON_ERRORS, FileError, read_below, read_file
from daemon.store.pictures import PictureError, read_grey
from daemon.vision.model import Model

Image = NDArray[np.uint8]
LARGEST_NOTE, LARGEST_LAST = 1_000_000, 10_000_000
LOCK_WAIT_S = 60.0
"""Longest wait for another process that changes the store: a halted one never ends."""


@dataclass(frozen=True)
class StoredView:
    """One taught view, or one drawing. note: when, by whom, with which calibration, and the facets found."""

    label: str
    number: int
    folder: Path
    note: dict[str, Any] = field(default_factory=dict, compare=False)
    damage: str = ""
    """What is wrong with view.json; note is then empty. Such a view can be listed and forgotten, not trained on."""

    @property
    def name(self) -> str:
        """The name for people: cube/3."""
        return f"{self.label}/{self.number}"

    @property
    def mesh(self) -> Path | None:
        """The drawing's file, where the view is one."""
        return next((p for p in (self.folder / "mesh.stl", self.folder / "mesh.obj") if p.exists()), None)

    def images(self) -> tuple[Image, Image]:
        """Left and right, (H, W) grey, of a view that is not a drawing. Raises FileError."""
        return self._image("left.png"), self._image("right.png")

    def _image(self, name: str) -> Image:
        try:
            return read_grey(Path(name), self.folder)
        except PictureError:
            raise FileError(f"{self.folder / name}: not an image; `forget` this view and teach it again") from None


@dataclass(frozen=True)
class ModelSummary:
    """What a model's file holds. trained: ISO, UTC; knows: the labels as text, or why the file cannot be read."""

    trained: str
    labels: tuple[str, ...]
    knows: str


class _ModelState(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    current: int | None = None
    candidate: int | None = None
    history: tuple[int, ...] = ()
    """Versions in use before the current one, oldest first."""

    def past(self) -> tuple[int, ...]:
        """The history once another version follows the current one."""
        return self.history if self.current is None else (*self.history, self.current)


class ModelStore:
    """Views and models below one folder. One writer at a time."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def views(self, label: str | None = None) -> list[StoredView]:
        """Every stored view, by label and number, damaged ones included. Raises OSError."""
        root = self.folder / "views"
        labels = [label] if label is not None else sorted(p.name for p in root.iterdir()) if root.is_dir() else []
        found = []
        for name in labels:
            numbers = [number_of(p.name) for p in (root / name).glob("*")] if (root / name).is_dir() else []
            found += [_stored(name, root / name / str(n)) for n in sorted(n for n in numbers if n is not None)]
        return found

    def labels(self) -> list[str]:
        """Every label with at least one stored view."""
        return sorted({view.label for view in self.views()})

    def add_view(self, label: str, left: Image, right: Image, note: dict[str, Any]) -> StoredView:
        """Store a view, whole or not at all, under the next free number. Raises FileError."""
        pair = {"left.png": left, "right.png": right}
        files = {name: cv2.imencode(".png", pixels)[1].tobytes() for name, pixels in pair.items()}
        return self._add(label, files, note)

    def add_mesh(self, label: str, kind: Literal["stl", "obj"], content: bytes, note: dict[str, Any]) -> StoredView:
        """Store a drawing, whole or not at all, under the next free number. Raises FileError."""
        return self._add(label, {f"mesh.{kind}": content}, note)

    def _add(self, label: str, files: Mapping[str, bytes], note: dict[str, Any]) -> StoredView:
        parent = self.folder / "views" / label
        with failing_as(FileError, f"{parent}: the view is not stored"):
            parent.mkdir(parents=True, exist_ok=True)
            making = Path(tempfile.mkdtemp(dir=parent, prefix=".new-"))
            try:
                for name, content in files.items():
                    write_atomically(making / name, content)
                note = {"v": 1, "label": label, "taught": datetime.now(UTC).isoformat(timespec="seconds"), **note}
                write_atomically(making / "view.json", json.dumps(spelt_throughout(note), indent=1).encode())
                os.chmod(making, 0o755)
                with self._locked():
                    numbers = [view.number for view in self.views(label)]
                    number = max(*numbers, self._highest_numbers().get(label, 0), 0) + 1
                    making.rename(parent / str(number))
            except BaseException:
                shutil.rmtree(making, ignore_errors=True)
                raise
        return StoredView(label, number, parent / str(number), note)

    def drop_views(self, label: str, number: int | None = None) -> int:
        """Remove a label's views, or one of them; returns how many were removed. Raises FileError."""
        views, parent = self.views(label), self.folder / "views" / label
        chosen = [view for view in views if number in (None, view.number)]
        with failing_as(FileError, f"{parent}: not removed"):
            self._record_highest_number(label, views)
            for view in chosen:
                doomed = view.folder.with_name(f".gone-{view.folder.name}")
                if os.path.lexists(doomed):  # the power failed during an earlier removal
                    _remove(doomed)
                view.folder.rename(doomed)
                _remove(doomed)
            if parent.is_dir() and not any(parent.iterdir()):
                parent.rmdir()
        return len(chosen)

    def _highest_numbers(self) -> dict[str, int]:
        """The highest number ever used for each label: models name their views by number, so none is used again."""
        try:
            return msgspec.json.decode(read_file(self._last_file, LARGEST_LAST), type=dict[str, int])
        except (FileError, *JSON_ERRORS):
            return {}

    def _record_highest_number(self, label: str, views: Sequence[StoredView]) -> None:
        last = self._highest_numbers()
        highest = max((view.number for view in views), default=0)
        if highest > last.get(label, 0):
            write_atomically(self._last_file, msgspec.json.encode({**last, label: highest}))

    @property
    def _last_file(self) -> Path:
        return self.folder / "models" / "last_views.json"

    @property
    def current(self) -> int | None:
        """The version in use."""
        return self._state().current

    @property
    def candidate(self) -> int | None:
        """The version trained last and not yet accepted."""
        return self._state().candidate

    @property
    def history(self) -> tuple[int, ...]:
        """The versions that a rollback returns to, oldest first."""
        return self._state().history

    def path(self, version: int) -> Path:
        return self.folder / "models" / f"{version:04d}.npz"

    def load(self, version: int) -> files.ModelFile:
        """A version's file. Raises ModelError."""
        return files.load_file(self.path(version))

    def versions(self) -> list[int]:
        """Every stored version, oldest first."""
        numbers = (number_of(p.stem) for p in (self.folder / "models").glob("*.npz"))
        return sorted(number for number in numbers if number is not None)

    def summary(self, version: int) -> ModelSummary:
        """Summarise a version's file, without raising."""
        try:
            file = self.load(version)
        except FileError as error:
            return ModelSummary("", (), str(error))
        return ModelSummary(file.trained, file.model.labels, ", ".join(file.model.labels))

    def put_candidate(self, model: Model, codes: Mapping[str, str] | None = None) -> int:
        """Store a model as the candidate; returns its version. codes: ART-b bits of each part. Raises FileError."""
        with self._locked():
            version = max(self.versions(), default=0) + 1
            trained = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
            files.save(model, self.path(version), trained=trained, codes=None if codes is None else dict(codes))
            self._write(msgspec.structs.replace(self._state(), candidate=version))
        return version

    def accept(self, version: int | None) -> tuple[int, files.ModelFile]:
        """Take the candidate into use if it is this version; returns it and its file. Raises FileError, unchanged."""
        with self._locked():
            state = self._state()
            if state.candidate is None:
                raise FileError("there is no candidate: `train` makes one")
            if state.candidate != version:
                raise FileError(f"the candidate is now version {state.candidate}: try it with `try`")
            file = self.load(state.candidate)
            self._write(_ModelState(state.candidate, None, state.past()))
        return state.candidate, file

    def rollback(self) -> tuple[int, files.ModelFile]:
        """Return to the version used before, as accept; the present one becomes the candidate."""
        with self._locked():
            state = self._state()
            if not state.history:
                raise FileError("there is no earlier model to go back to")
            file = self.load(state.history[-1])
            self._write(_ModelState(state.history[-1], state.current, state.history[:-1]))
        return state.history[-1], file

    def use(self, version: int) -> files.ModelFile:
        """Take any version into use; returns its file. A rollback returns to the version before. As accept."""
        with self._locked():
            state, file = self._state(), self.load(version)
            self._write(_ModelState(version, None if state.candidate == version else state.candidate, state.past()))
        return file

    @contextlib.contextmanager
    def _locked(self) -> Iterator[None]:
        """Exclude other threads and processes from changing the store. Raises FileError."""
        path = self.folder / "models" / "lock"
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o640)
        except OSError as error:
            raise FileError(f"{path}: {plain(error)}") from error
        try:
            ends_s = time.monotonic() + LOCK_WAIT_S
            while True:
                try:
                    fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    break
                except BlockingIOError:
                    if time.monotonic() > ends_s:
                        raise FileError(f"{path.parent}: another process is changing it; try again") from None
                    time.sleep(0.05)
            yield
        finally:
            os.close(handle)

    def _state(self) -> _ModelState:
        mend = "restore it, or remove it and `train` again"
        return read_json(self.folder / "models" / "state.json", _ModelState, mend) or _ModelState()

    def _write(self, state: _ModelState) -> None:
        write_json(self.folder / "models" / "state.json", state)


def model_file(named: Path) -> Path:
    """The model file that `named` means: a path, or a stored version (3, latest). Raises FileError."""
    word = str(named)
    if named.exists() or not (word == "latest" or WHOLE.fullmatch(word)):
        return named
    store = ModelStore(folders.state_last_used())
    versions = store.versions()
    found = versions[-1:] if word == "latest" else [version for version in versions if version == whole(word)]
    if not found:
        stored = ", ".join(map(str, versions)) or "none"
        raise FileError(f"{word}: no such model in {store.folder / 'models'} (stored: {stored})")
    return store.path(found[0])


class _Note(msgspec.Struct):
    """The fields of a view's note that training reads."""

    who: str = ""
    taught: str = ""
    table: TableRecord | None = None
    facets: list[list[str]] = []
    mesh: str = ""
    unit: Literal["mm", "cm", "m", "inch"] = "mm"
    moved: MovedPairRecord | None = None


def _stored(label: str, folder: Path) -> StoredView:
    try:
        content = read_below(folder, "view.json", LARGEST_NOTE)
        msgspec.json.decode(content, type=_Note)
        return StoredView(label, int(folder.name), folder, msgspec.json.decode(content))
    except (FileError, *JSON_ERRORS) as error:
        what = str(error) if isinstance(error, FileError) else f"{folder / 'view.json'}: cannot be read: {error}"
        return StoredView(label, int(folder.name), folder, damage=f"{what}; `forget {label} {folder.name}`")


def _remove(path: Path) -> None:
    """Remove a folder with its content; of a link, only the link."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink()
