"""Replay the looks of many runs by many workers, with dask.distributed.

A job is some looks of one run. Its result is a file in the replay's folder, named by the hash of all that it depends
on: a job whose file exists is done, and an interrupted replay continues from there.
"""

import hashlib
import json
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from daemon import VERSION
from daemon.calibration.file import load_calibration
from daemon.config import load_config
from daemon.events.records import Json
from daemon.fleet.replay_results import result_of
from daemon.fleet.store import Store, StoreError, open_store
from daemon.fleet.views import open_views
from daemon.review.digest import Digest
from daemon.review.page import read_digest
from daemon.review.replay import ReplayInputs, replayed_looks
from daemon.store.folders import needing
from daemon.store.library import FACETS, load_facets
from daemon.store.model import load
from daemon.store.model_store import model_file
from daemon.store.outside import read_file
from daemon.store.runs import RUN
from daemon.store.yamlfile import read
from daemon.vision.settings import VisionSettings

LOOKS_A_JOB = 40
"""Some seconds of work: a lost worker costs little, and the scheduler can serve hundreds of workers."""
LARGEST_WITH = 256_000_000
WORKER_MEMORY = "1.5GiB"
TRIES = 5
"""Workers that may fail on a job before it is reported as failed."""


@dataclass(frozen=True)
class Run:
    """A run to replay: a local folder, or a run collected in a store."""

    cell: str
    name: str
    id: str
    where: str
    in_store: bool
    looks: tuple[int, ...]


@dataclass(frozen=True)
class ReplayWith:
    """What replaces the runs' own: files by kind (model, calibration), and settings of vision."""

    files: tuple[tuple[str, str], ...] = ()
    settings: VisionSettings | None = None

    def using(self) -> ReplayInputs:
        """Read the files. Raises ModelError, ConfigError, FileError."""
        found = dict(self.files)
        return ReplayInputs(
            load(Path(found["model"])) if "model" in found else None,
            load_calibration(Path(found["calibration"])).rig if "calibration" in found else None,
            self.settings,
        )

    def digest(self) -> str:
        """Hash of the content of the files and of the settings."""
        kinds = [(kind, hashlib.sha256(read_file(Path(name), LARGEST_WITH)).hexdigest()) for kind, name in self.files]
        return hashlib.sha256(f"{sorted(kinds)} {self.settings}".encode()).hexdigest()


@dataclass(frozen=True)
class ReplayJob:
    """Some looks of a run. out: the replay's folder, which also has copies of the files that it uses."""

    key: str
    run: Run
    looks: tuple[int, ...]
    out: str
    chosen: ReplayWith
    release: str


def replay_with(names: Sequence[str]) -> ReplayWith:
    """Interpret each `--with`: a model, a calibration, or a facetd.yaml (vision). Raises StoreError, FileError."""
    files: dict[str, str] = {}
    settings: VisionSettings | None = None
    for name in names:
        if not name.endswith((".yaml", ".yml")):
            kind = "model"
        elif isinstance(data := read(Path(name)).data, dict) and {"left", "right"} <= set(data):
            kind = "calibration"
        else:
            kind, settings = "settings", load_config(Path(name)).values.vision
        if kind in files:
            raise StoreError(f"--with {name}: a second {kind}")
        files[kind] = str((model_file(Path(name)) if kind == "model" else Path(name)).resolve())
    files.pop("settings", None)
    return ReplayWith(tuple(sorted(files.items())), settings)


def run_in_folder(folder: Path) -> Run:
    """A local run folder as a run to replay. Raises FileError."""
    run = read_digest(folder)
    looks = tuple(int(look["seq"]) for look in run.of("look"))
    with (folder / RUN).open("rb") as file:
        identity = hashlib.file_digest(file, "sha256").hexdigest()
    return Run(cell_of(folder, run), folder.name, identity, str(folder.resolve()), False, looks)


def cell_of(folder: Path, run: Digest) -> str:
    """The name of a run's cell where none is given: that of its computer."""
    return str((run.start or {}).get("name") or folder.parent.name)


def runs_in_store(store: Store) -> list[Run]:
    """Every collected run that has looks. Raises StoreError."""
    query = "SELECT cell, run, list(seq ORDER BY seq) FROM looks GROUP BY cell, run"
    looks = {(cell, run): tuple(seqs) for cell, run, seqs in open_views(store).execute(query).fetchall()}
    collected = sorted(store.collected().items())
    return [Run(*key, short, store.url, True, looks[key]) for key, short in collected if looks.get(key)]


def jobs_of(runs: Iterable[Run], chosen: ReplayWith, out: str) -> list[ReplayJob]:
    """Divide the runs into jobs; the same runs, files and release give the same jobs."""
    with_digest, version = chosen.digest(), VERSION
    found = []
    for run in runs:
        for begin in range(0, len(run.looks), LOOKS_A_JOB):
            looks = run.looks[begin : begin + LOOKS_A_JOB]
            inputs = json.dumps([run.cell, run.name, run.id[:16], looks, with_digest, version]).encode()
            found.append(ReplayJob(hashlib.sha256(inputs).hexdigest()[:24], run, looks, out, chosen, version))
    return found


def replay_here(folders: Iterable[Path], chosen: ReplayWith) -> list[tuple[str, Json]]:
    """Replay local runs one after the other in this process; returns (cell, result) pairs."""
    using, library = chosen.using(), load_facets(FACETS)
    runs = [(folder, read_digest(folder)) for folder in folders]
    return [(cell_of(folder, run), result_of(run, replayed_looks(folder, run, library, using))) for folder, run in runs]


def work(job: ReplayJob) -> str:
    """Do a job on a worker, unless its result exists; returns its key. Raises whatever prevents it."""
    out = open_store(job.out)
    if job.release != VERSION:
        raise StoreError(f"this worker has facetd {VERSION}, the replay began with {job.release}")
    if out.fs.exists(out.path("done", f"{job.key}.json")):
        return job.key
    with tempfile.TemporaryDirectory(prefix="facetd-replay-") as spare:
        folder = _folder(job, Path(spare))
        run = read_digest(folder, frozenset(job.looks))
        found = replayed_looks(folder, run, load_facets(FACETS), _using(job, out, Path(spare)), frozenset(job.looks))
        result = result_of(run, found) | {"run": job.run.name, "cell": job.run.cell}
    out.write(json.dumps(result).encode(), "done", f"{job.key}.json")
    return job.key


def _folder(job: ReplayJob, spare: Path) -> Path:
    """The run as a local folder with the files that the job needs."""
    if not job.run.in_store:
        return Path(job.run.where)
    store = open_store(job.run.where)
    seqs = {f"{seq:06d}" for seq in job.looks}
    files = () if store.local else store.manifest(job.run.cell, job.run.name).files
    names = [n for n in files if not n.startswith("images/") or n.removeprefix("images/")[:6] in seqs]
    return store.fetch(job.run.cell, job.run.name, names, spare / job.run.name)


def _using(job: ReplayJob, out: Store, spare: Path) -> ReplayInputs:
    """Read the copies in the replay's folder: the originals may change, or be out of the worker's reach."""
    copies = []
    for kind, name in job.chosen.files:
        copy = spare / f"{kind}{Path(name).suffix}"
        copy.write_bytes(out.read("with", copy.name))
        copies.append((kind, str(copy)))
    return ReplayWith(tuple(copies), job.chosen.settings).using()


def replay_many(
    jobs: Sequence[ReplayJob], workers: int, cluster: str | None, say: Callable[[int, int], object] = lambda *_: None
) -> tuple[list[tuple[str, Json]], list[str]]:
    """Do the jobs that are not done; returns all (cell, result) pairs in the order of jobs, and a line for each
    failure. cluster: address of a dask scheduler; None: `workers` local processes. Raises StoreError."""
    if not jobs:
        return [], []
    out = open_store(jobs[0].out)
    for kind, name in jobs[0].chosen.files:
        out.write(read_file(Path(name), LARGEST_WITH), "with", f"{kind}{Path(name).suffix}")
    done = _done(out)
    todo = [job for job in jobs if job.key not in done]
    failed: list[str] = []
    say(len(jobs) - len(todo), len(jobs))
    if todo:
        with _client(workers, cluster) as (distributed, client):
            futures = client.map(work, todo, key=[f"replay-{job.key}" for job in todo], retries=2)
            described = {future.key: _in_words(job) for future, job in zip(futures, todo, strict=True)}
            if cluster:
                distributed.fire_and_forget(futures)
            for count, future in enumerate(distributed.as_completed(futures), len(jobs) - len(todo) + 1):
                if future.status != "finished":
                    failed.append(f"{described[future.key]}: {future.exception()}")
                future.release()
                say(count, len(jobs))
    done = _done(out)
    results = [json.loads(out.read("done", f"{job.key}.json")) for job in jobs if job.key in done]
    return [(result["cell"], result) for result in results], failed


def _in_words(job: ReplayJob) -> str:
    return f"{job.run.cell}/{job.run.name}: {len(job.looks)} looks from {job.looks[0]} on"


def _done(out: Store) -> set[str]:
    return {name.removesuffix(".json") for name in out.names("done") if name.endswith(".json")}


@contextmanager
def _client(workers: int, cluster: str | None) -> Iterator[tuple[Any, Any]]:
    with needing("fleet", "a replay by many workers", StoreError):
        import dask
        import distributed as untyped
    distributed: Any = untyped
    settings = {"distributed.scheduler.allowed-failures": TRIES, "distributed.logging.distributed": "error"}
    with dask.config.set(settings), tempfile.TemporaryDirectory(prefix="facetd-dask-") as spare:
        try:
            here: Any = cluster or distributed.LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                memory_limit=WORKER_MEMORY,
                dashboard_address="127.0.0.1:0",
                local_directory=spare,
            )
            client = distributed.Client(here, timeout=20)
        except (OSError, ValueError) as error:
            raise StoreError(f"{cluster}: no scheduler answers: {error}") from None
        try:
            yield distributed, client
        finally:
            client.close()
            if not cluster:
                here.close()
