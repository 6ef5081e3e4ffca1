"""What was taught, on disk: views as images, models by version, and which model is in use. Files only; no learning.

views/<label>/<number>/{left.png, right.png, view.json}      a view appears whole or not at all
views/<label>/<number>/{mesh.stl or mesh.obj, view.json}     the same for a part taught from its drawing
models/<version>.npz, models/state.json                      {"current", "candidate", "history"}
models/last_views.json                                       {label: the highest number that was a view's}
"""

from __future__ import annotations

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
from daemon.quantities import WHOLE, whole
from daemon.store import folders
from daemon.store import model as files
from daemon.store.files import number_of, plain, write_atomically
from daemon.store.outside import FileError, read_below, read_file
from daemon.store.pictures import PictureError, read_grey
from daemon.vision.model import Model

Image = NDArray[np.uint8]
LARGEST_NOTE, LARGEST_LAST = 1_000_000, 10_000_000
ALONE_S = 60.0
"""How long another may take to change what is stored: one that was halted in the middle takes for ever."""


class ModelStoreError(FileError):
    """Something taught cannot be read or written: which file, why, what to do."""


@dataclass(frozen=True)
class StoredView:
    """One taught view on disk, or one drawing. note: when, by whom, under which calibration, what was seen."""

    label: str
    number: int
    folder: Path
    note: dict[str, Any] = field(default_factory=dict, compare=False)
    damage: str = ""
    """What is wrong with its note, which is then empty: such a view can be listed and forgotten, and not learnt."""

    @property
    def name(self) -> str:
        """For people: cube/3."""
        return f"{self.label}/{self.number}"

    @property
    def mesh(self) -> Path | None:
        """The drawing's file, where it is one."""
        return next((p for p in (self.folder / "mesh.stl", self.folder / "mesh.obj") if p.exists()), None)

    def images(self) -> tuple[Image, Image]:
        """Left and right, (H, W) grey, of a view that is no drawing. Raises FileError, ModelStoreError."""
        left, right = (_read_image(self.folder, f"{eye}.png") for eye in ("left", "right"))
        return left, right


@dataclass(frozen=True)
class ToldModel:
    """What a model's file says of itself: when it was trained (ISO, UTC), the labels it knows, and those in words, or
    why it cannot be read."""

    trained: str
    labels: tuple[str, ...]
    knows: str


class _ModelState(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    current: int | None = None
    candidate: int | None = None
    history: tuple[int, ...] = ()
    """Versions that were in use before the current one, oldest first."""


class ModelStore:
    """The taught things below one folder. One writer: the daemon."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def views(self, label: str | None = None) -> list[StoredView]:
        """Every stored view, by label and number, the damaged ones too. Raises OSError."""
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
        """Store a view under the next free number. Raises ModelStoreError; then nothing of it is there."""
        images = {f"{eye}.png": cv2.imencode(".png", pixels)[1].tobytes() for eye, pixels in
                  (("left", left), ("right", right))}  # fmt: skip
        return self._add(label, images, note)

    def add_mesh(self, label: str, kind: Literal["stl", "obj"], content: bytes, note: dict[str, Any]) -> StoredView:
        """Store a drawing under the next free number. Raises ModelStoreError; then nothing of it is there."""
        return self._add(label, {f"mesh.{kind}": content}, note)

    def _add(self, label: str, files: Mapping[str, bytes], note: dict[str, Any]) -> StoredView:
        parent = self.folder / "views" / label
        try:
            parent.mkdir(parents=True, exist_ok=True)
            making = Path(tempfile.mkdtemp(dir=parent, prefix=".new-"))
            try:
                for name, content in files.items():
                    write_atomically(making / name, content)
                note = {"v": 1, "label": label, "taught": datetime.now(UTC).isoformat(timespec="seconds"), **note}
                write_atomically(making / "view.json", json.dumps(spelt_throughout(note), indent=1).encode())
                os.chmod(making, 0o755)
                with self._alone():
                    numbers = [view.number for view in self.views(label)]
                    number = max(*numbers, self._last_given().get(label, 0), 0) + 1
                    making.rename(parent / str(number))
            except BaseException:
                shutil.rmtree(making, ignore_errors=True)
                raise
        except OSError as error:
            raise ModelStoreError(f"{parent}: the view is not stored: {error.strerror or error}") from error
        return StoredView(label, number, parent / str(number), note)

    def drop_views(self, label: str, number: int | None = None) -> int:
        """Remove a label's views, or one of them; returns how many there were. Raises ModelStoreError."""
        views = self.views(label)
        gone = [view for view in views if number in (None, view.number)]
        try:
            self._keep_last_given(label, views)
            for view in gone:
                doomed = view.folder.with_name(f".gone-{view.folder.name}")
                if os.path.lexists(doomed):  # the power went in the middle of this
                    _remove(doomed)
                view.folder.rename(doomed)
                _remove(doomed)
            parent = self.folder / "views" / label
            if parent.is_dir() and not any(parent.iterdir()):
                parent.rmdir()
        except OSError as error:
            raise ModelStoreError(f"{self.folder / 'views' / label}: not removed: {error.strerror or error}") from error
        return len(gone)

    def _last_given(self) -> dict[str, int]:
        """The highest number of each label that was ever given and may be no view's any more: it is given to no other,
        as models say by its name what they were trained on."""
        try:
            return msgspec.json.decode(read_file(self._last_file, LARGEST_LAST), type=dict[str, int])
        except (FileError, msgspec.MsgspecError, RecursionError, UnicodeDecodeError):
            return {}

    def _keep_last_given(self, label: str, views: Sequence[StoredView]) -> None:
        last = self._last_given()
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
        """What a rollback goes back through, oldest first."""
        return self._state().history

    def path(self, version: int) -> Path:
        """The file of a version."""
        return self.folder / "models" / f"{version:04d}.npz"

    def load(self, version: int) -> Model:
        """Raises ModelError."""
        return files.load(self.path(version))

    def versions(self) -> list[int]:
        """Every version that is kept, oldest first."""
        numbers = (number_of(p.stem) for p in (self.folder / "models").glob("*.npz"))
        return sorted(number for number in numbers if number is not None)

    def told(self, version: int) -> ToldModel:
        """What a version's file says of itself."""
        try:
            file = files.load_file(self.path(version))
        except FileError as error:
            return ToldModel("", (), str(error))
        return ToldModel(file.trained, file.model.labels, ", ".join(file.model.labels))

    def put_candidate(self, model: Model, codes: Mapping[str, str] | None = None) -> int:
        """Store a trained model as the candidate; returns its version. codes: each part's ART-b bits. Raises
        ModelStoreError."""
        with self._alone():
            version = max(self.versions(), default=0) + 1
            trained = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
            files.save(model, self.path(version), trained=trained, codes=None if codes is None else dict(codes))
            self._write(msgspec.structs.replace(self._state(), candidate=version))
        return version

    def accept(self, version: int | None) -> tuple[int, Model]:
        """Put the candidate into use that is meant: its version, and what it is. Raises FileError where there is none,
        or another by now, or it cannot be read; then nothing has changed."""
        with self._alone():
            state = self._state()
            if state.candidate is None:
                raise ModelStoreError("there is no candidate: `train` makes one")
            if state.candidate != version:
                raise ModelStoreError(f"the candidate is version {state.candidate} by now: `try` looks with it")
            model = self.load(state.candidate)
            history = state.history if state.current is None else (*state.history, state.current)
            self._write(_ModelState(state.candidate, None, history))
        return state.candidate, model

    def rollback(self) -> tuple[int, Model]:
        """Back to the version used before, as accept; the present one becomes the candidate again."""
        with self._alone():
            state = self._state()
            if not state.history:
                raise ModelStoreError("there is no earlier model to go back to")
            model = self.load(state.history[-1])
            self._write(_ModelState(state.history[-1], state.current, state.history[:-1]))
        return state.history[-1], model

    def use(self, version: int) -> Model:
        """Put any version into use, and what it is; the one before is what a rollback goes back to. As accept."""
        with self._alone():
            state, model = self._state(), self.load(version)
            history = state.history if state.current is None else (*state.history, state.current)
            self._write(_ModelState(version, None if state.candidate == version else state.candidate, history))
        return model

    @contextlib.contextmanager
    def _alone(self) -> Iterator[None]:
        """Whoever changes what is stored does so alone, among threads and among processes. Raises ModelStoreError."""
        path = self.folder / "models" / "lock"
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o640)
        except OSError as error:
            raise ModelStoreError(f"{path}: {plain(error)}") from error
        try:
            ends_s = time.monotonic() + ALONE_S
            while not _locked(handle):
                if time.monotonic() > ends_s:
                    raise ModelStoreError(f"{path.parent}: another process has been at work there; try again")
                time.sleep(0.05)
            yield
        finally:
            os.close(handle)

    def _state(self) -> _ModelState:
        path = self.folder / "models" / "state.json"
        try:
            return msgspec.json.decode(read_file(path, LARGEST_NOTE), type=_ModelState)
        except FileError:
            if not os.path.lexists(path):
                return _ModelState()
            raise
        except (msgspec.MsgspecError, RecursionError, UnicodeDecodeError) as error:
            raise ModelStoreError(
                f"{path}: cannot be read: {error}; restore it, or remove it and `train` again"
            ) from None

    def _write(self, state: _ModelState) -> None:
        path = self.folder / "models" / "state.json"
        try:
            write_atomically(path, msgspec.json.encode(state))
        except OSError as error:
            raise ModelStoreError(f"{path}: not written: {error.strerror or error}") from error


def model_file(named: Path) -> Path:
    """A model's file where one is named, or that of a version kept here: 3, or latest. Raises ModelStoreError."""
    word = str(named)
    if named.exists() or not (word == "latest" or WHOLE.fullmatch(word)):
        return named
    store = ModelStore(folders.state_folder())
    known = store.versions()
    found = known[-1:] if word == "latest" else [version for version in known if version == whole(word)]
    if not found:
        there = ", ".join(map(str, known)) or "none"
        raise ModelStoreError(f"{word}: no such model in {store.folder / 'models'} (there: {there})")
    return store.path(found[0])


class _Table(msgspec.Struct):
    up: tuple[float, float, float]
    level_mm: float


_Row = tuple[float, float, float, float]


class _Moved(msgspec.Struct):
    eye: Literal["left", "right"]
    left: tuple[_Row, _Row, _Row, _Row]
    right: tuple[_Row, _Row, _Row, _Row]
    arm_mm: float
    arm_deg: float


class _Note(msgspec.Struct):
    """What of a view's note is looked at again."""

    who: str = ""
    taught: str = ""
    table: _Table | None = None
    facets: list[list[str]] = []
    mesh: str = ""
    unit: Literal["mm", "cm", "m", "inch"] = "mm"
    moved: _Moved | None = None


def _stored(label: str, folder: Path) -> StoredView:
    try:
        content = read_below(folder, "view.json", LARGEST_NOTE)
        msgspec.json.decode(content, type=_Note)
        return StoredView(label, int(folder.name), folder, msgspec.json.decode(content))
    except (FileError, msgspec.MsgspecError, RecursionError, UnicodeDecodeError) as error:
        what = str(error) if isinstance(error, FileError) else f"{folder / 'view.json'}: cannot be read: {error}"
        return StoredView(label, int(folder.name), folder, damage=f"{what}; `forget {label} {folder.name}`")


def _locked(handle: int) -> bool:
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _remove(path: Path) -> None:
    """A folder with all in it; a link, or whatever else somebody put there, by itself."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink()


def _read_image(folder: Path, name: str) -> Image:
    try:
        return read_grey(Path(name), folder)
    except PictureError:
        raise ModelStoreError(f"{folder / name}: not an image; `forget` this view and teach it again") from None
