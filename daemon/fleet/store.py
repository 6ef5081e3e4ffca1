"""Where the runs of many cells are kept: a folder or a bucket, whatever fsspec can reach, and what lies where in it.

runs/<cell>/<run>/...                       a run, as the cell wrote it
collected/<id>,<cell>,<run>.json            written last: its files with size and hash; without it a run is not there
apart/<cell>/<run>/..., apart/<cell>/<run>.txt   a run that is damaged, and how
tables/<table>/cell=<cell>/month=<YYYY-MM>/rows.parquet
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import IO, Any

import msgspec

from daemon.errors import FacetdError
from daemon.store.folders import how_to_add
from daemon.store.outside import PIECE, open_below


class StoreError(FacetdError):
    """The store, or something in it, cannot be used: what, where, what to do."""


class Collected(msgspec.Struct, frozen=True):
    """A run that is safe in the store. id: sha256 of its run.jsonl; files: name -> [bytes, sha256]."""

    cell: str
    run: str
    id: str
    release: str | None
    files: dict[str, tuple[int, str]]


@dataclass(frozen=True, eq=False)
class Store:
    """fs: an fsspec file system; root: the store's path in it."""

    fs: Any
    root: str
    url: str

    def path(self, *parts: str) -> str:
        """Of something in the store, for fs."""
        return "/".join((self.root, *parts))

    @property
    def local(self) -> bool:
        """Whether it is a folder of this computer."""
        return "file" in ((self.fs.protocol,) if isinstance(self.fs.protocol, str) else self.fs.protocol)

    def names(self, *parts: str) -> list[str]:
        """What lies in a folder of the store, sorted; nothing where there is none."""
        try:
            found = self.fs.ls(self.path(*parts), detail=False, refresh=True)
        except (FileNotFoundError, NotADirectoryError):
            return []
        return sorted(PurePosixPath(name.rstrip("/")).name for name in found)

    def read(self, *parts: str) -> bytes:
        """A whole file. Raises StoreError."""
        try:
            return bytes(self.fs.cat_file(self.path(*parts)))
        except (OSError, ValueError) as error:
            raise StoreError(f"{self.url}: {'/'.join(parts)}: cannot be read: {error}") from None

    def write(self, content: bytes, *parts: str) -> None:
        """A whole file, there with all its content or not at all."""
        with self.replacing(*parts) as file:
            file.write(content)

    def replacing(self, *parts: str) -> Any:
        """A file to be written that takes its place once it is closed."""
        self.fs.makedirs(self.path(*parts[:-1]), exist_ok=True)
        return _Replacing(self, self.path(*parts))

    def put(self, folder: Path, name: str, *parts: str) -> tuple[int, str]:
        """Copy a file of a local folder, unless the same is there already; (bytes, sha256) as read back from the store.

        Raises FileError, StoreError, OSError.
        """
        target = self.path(*parts)
        with open_below(folder, name) as source:
            size, digest = _hashed(source)
            if self.fs.exists(target) and self._hash_of(target) == (size, digest):
                return size, digest
            source.seek(0)
            with self.replacing(*parts) as file:
                while piece := source.read(PIECE):
                    file.write(piece)
        self.fs.invalidate_cache()
        if self._hash_of(target) != (size, digest):
            raise StoreError(f"{self.url}: {'/'.join(parts)}: what was written is not what is read back")
        return size, digest

    def _hash_of(self, path: str) -> tuple[int, str]:
        with self.fs.open(path, "rb") as file:
            return _hashed(file)

    def settle(self) -> None:
        """Return once names, too, are on the disk, where that is ours to say; a bucket has them when it answers."""
        if self.local:
            os.sync()

    def collected(self) -> dict[tuple[str, str], str]:
        """(cell, run) -> id of every run that is safe here."""
        named = [name.removesuffix(".json").split(",") for name in self.names("collected") if name.endswith(".json")]
        return {(one[1], one[2]): one[0] for one in named if len(one) == 3}  # another file there is somebody else's

    def manifest(self, cell: str, run: str) -> Collected:
        """What is known of a collected run. Raises StoreError."""
        short = self.collected().get((cell, run))
        if short is None:
            raise StoreError(f"{self.url}: {cell}/{run}: not collected")
        name = manifest_name(short, cell, run)
        try:
            return msgspec.json.decode(self.read("collected", name), type=Collected)
        except (msgspec.MsgspecError, RecursionError, UnicodeDecodeError) as error:
            raise StoreError(f"{self.url}: collected/{name}: {error}") from None

    def damaged(self, run: Collected) -> list[str]:
        """The files of a collected run that are not in the store as they were written."""
        found = []
        for name, (size, digest) in run.files.items():
            path = self.path("runs", run.cell, run.run, *name.split("/"))
            if not self.fs.exists(path) or self._hash_of(path) != (size, digest):
                found.append(name)
        return found

    def fetch(self, cell: str, run: str, names: Iterator[str] | list[str], into: Path) -> Path:
        """Files of a run as a local folder: the store's own where it is local, else a copy in `into`."""
        if self.local:
            return Path(self.path("runs", cell, run))
        for name in names:
            target = into / name
            if not target.exists():
                target.parent.mkdir(parents=True, exist_ok=True)
                target.write_bytes(self.read("runs", cell, run, *name.split("/")))
        return into


class _Replacing:
    """Written beside its place and moved there: a reader, and a start after a crash, see the old file or the new."""

    def __init__(self, store: Store, path: str) -> None:
        self._store, self._path = store, path
        self._beside = f"{path}.new" if store.local else path
        self._file: IO[bytes] = store.fs.open(self._beside, "wb")

    def __enter__(self) -> IO[bytes]:
        return self._file

    def __exit__(self, kind: object, *rest: object) -> None:
        if self._store.local:
            self._file.flush()
            os.fsync(self._file.fileno())
        self._file.close()
        if kind is None and self._beside != self._path:
            os.replace(self._beside, self._path)


def open_store(where: str) -> Store:
    """A folder, or an address that fsspec knows (s3://bucket/facetd). Raises StoreError."""
    try:
        import fsspec
    except ImportError:
        raise StoreError(f"a store of many cells needs fsspec and pyarrow: {how_to_add('fleet')}") from None
    try:
        fs, root = fsspec.core.url_to_fs(where)
    except (ImportError, ValueError, OSError) as error:
        raise StoreError(f"{where}: cannot be opened as a store: {error}") from None
    return Store(fs, str(root).rstrip("/"), where)


def manifest_name(short: str, cell: str, run: str) -> str:
    """Of the file that makes a run count as collected."""
    return f"{short},{cell},{run}.json"


def hashed_below(folder: Path, name: str) -> tuple[int, str]:
    """(bytes, sha256) of a file in a folder. Raises FileError."""
    with open_below(folder, name) as file:
        return _hashed(file)


def _hashed(file: Any) -> tuple[int, str]:
    digest, size = hashlib.sha256(), 0
    while piece := file.read(PIECE):
        digest.update(piece)
        size += len(piece)
    return size, digest.hexdigest()
