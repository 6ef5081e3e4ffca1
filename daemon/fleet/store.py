"""The store of many cells' runs: a folder or a bucket, whatever fsspec can reach.

runs/<cell>/<run>/...                       a run, as the cell wrote it
collected/<id>,<cell>,<run>.json            its files with size and hash; written last: without it the run is not stored
apart/<cell>/<run>/..., apart/<cell>/<run>.txt   a damaged run, and its damage
tables/<table>/cell=<cell>/month=<YYYY-MM>/rows.parquet
"""

import hashlib
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import IO, Any

import msgspec

from daemon.errors import FacetdError
from daemon.store.folders import needing
from daemon.store.outside import JSON_ERRORS, PIECE, open_below


class StoreError(FacetdError):
    """The store, or a file in it, cannot be used: what, where, what to do."""


class Collected(msgspec.Struct, frozen=True):
    """Manifest of a collected run. id: sha256 of its run.jsonl; files: name -> [bytes, sha256]."""

    cell: str
    run: str
    id: str
    release: str | None
    files: dict[str, tuple[int, str]]


@dataclass(frozen=True, eq=False)
class Store:
    """A store. fs: its fsspec file system; root: its path in fs."""

    fs: Any
    root: str
    url: str

    def path(self, *parts: str) -> str:
        """The path of a file or folder of the store, for fs."""
        return "/".join((self.root, *parts))

    @property
    def local(self) -> bool:
        return "file" in ((self.fs.protocol,) if isinstance(self.fs.protocol, str) else self.fs.protocol)

    def names(self, *parts: str) -> list[str]:
        """Names in a folder of the store, sorted; empty without the folder."""
        try:
            found = self.fs.ls(self.path(*parts), detail=False, refresh=True)
        except (FileNotFoundError, NotADirectoryError):
            return []
        return sorted(PurePosixPath(name.rstrip("/")).name for name in found)

    def read(self, *parts: str) -> bytes:
        """Read a file. Raises StoreError."""
        try:
            return bytes(self.fs.cat_file(self.path(*parts)))
        except (OSError, ValueError) as error:
            raise StoreError(f"{self.url}: {'/'.join(parts)}: cannot be read: {error}") from None

    def write(self, content: bytes, *parts: str) -> None:
        """Write a file, whole or not at all."""
        with self.replacing(*parts) as file:
            file.write(content)

    @contextmanager
    def replacing(self, *parts: str) -> Iterator[IO[bytes]]:
        """Open a file for writing that takes its place once complete: readers see the old file or the new one."""
        self.fs.makedirs(self.path(*parts[:-1]), exist_ok=True)
        path = self.path(*parts)
        temporary = f"{path}.new" if self.local else path
        with self.fs.open(temporary, "wb") as file:
            yield file
            if self.local:
                file.flush()
                os.fsync(file.fileno())
        if self.local:
            os.replace(temporary, path)

    def put(self, folder: Path, name: str, *parts: str) -> tuple[int, str]:
        """Copy a file unless the store has it; returns (bytes, sha256), read back. Raises FileError, StoreError."""
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
            raise StoreError(f"{self.url}: {'/'.join(parts)}: the content read back differs from the content written")
        return size, digest

    def _hash_of(self, path: str) -> tuple[int, str]:
        with self.fs.open(path, "rb") as file:
            return _hashed(file)

    def settle(self) -> None:
        """Wait until a local store is on the disk; a bucket is durable once it answers."""
        if self.local:
            os.sync()

    def collected(self) -> dict[tuple[str, str], str]:
        """(cell, run) -> id of every collected run."""
        named = [name.removesuffix(".json").split(",") for name in self.names("collected") if name.endswith(".json")]
        return {(one[1], one[2]): one[0] for one in named if len(one) == 3}  # other files are not ours

    def manifest(self, cell: str, run: str) -> Collected:
        """The manifest of a collected run. Raises StoreError."""
        short = self.collected().get((cell, run))
        if short is None:
            raise StoreError(f"{self.url}: {cell}/{run}: not collected")
        name = manifest_name(short, cell, run)
        try:
            return msgspec.json.decode(self.read("collected", name), type=Collected)
        except JSON_ERRORS as error:
            raise StoreError(f"{self.url}: collected/{name}: {error}") from None

    def damaged(self, run: Collected) -> list[str]:
        """The files of a collected run that are missing or changed in the store."""
        found = []
        for name, (size, digest) in run.files.items():
            path = self.path("runs", run.cell, run.run, *name.split("/"))
            if not self.fs.exists(path) or self._hash_of(path) != (size, digest):
                found.append(name)
        return found

    def fetch(self, cell: str, run: str, names: Sequence[str], into: Path) -> Path:
        """Provide files of a run as a local folder: the store's own if local, else copies in `into`."""
        if self.local:
            return Path(self.path("runs", cell, run))
        for name in names:
            target = into / name
            if not target.exists():
                target.parent.mkdir(parents=True, exist_ok=True)
                target.write_bytes(self.read("runs", cell, run, *name.split("/")))
        return into


def open_store(where: str) -> Store:
    """Open a store: a folder, or an address that fsspec supports (s3://bucket/facetd). Raises StoreError."""
    with needing("fleet", "a store of many cells", StoreError):
        import fsspec
    try:
        fs, root = fsspec.core.url_to_fs(where)
    except (ImportError, ValueError, OSError) as error:
        raise StoreError(f"{where}: cannot be opened as a store: {error}") from None
    return Store(fs, str(root).rstrip("/"), where)


def manifest_name(short: str, cell: str, run: str) -> str:
    """The name of a run's manifest."""
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
