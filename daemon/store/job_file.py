"""jobs/NAME.yaml beside facetd.yaml: which parts to pick, how many, in which order, and what if one is missing."""

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta

from daemon.events.pick_order import OrderStep, PickOrder
from daemon.store.outside import FileError
from daemon.store.place_file import BIN, NAME, CellPlaces
from daemon.store.yamlfile import Document, read

FOLDER, SUFFIX = "jobs", ".yaml"
MAX_STEPS = 12
"""Most steps of a job: the rest of an order must fit twice into a slot of the recovery file."""
MAX_TIMES = 10_000
StepCount = Annotated[int, Meta(ge=1, le=1_000_000)]
Seconds = Annotated[float, Meta(ge=1, le=3600)]


@dataclass(frozen=True, kw_only=True)
class JobStep:
    """One step: a part, how many, and where they go."""

    part: str
    """Label of the part."""
    count: StepCount = 1
    """How many."""
    place: str | None = None
    """Place or pattern of places.yaml that they go to, or `bin`. Unset: wherever such parts belong."""


@dataclass(frozen=True, kw_only=True)
class JobFile:
    """A job: its steps, and how they are done."""

    version: Literal[1]
    """Version of the file's format."""
    steps: Annotated[tuple[JobStep, ...], Meta(min_length=1, max_length=MAX_STEPS)]
    """What is to be picked, at most 12 steps."""
    order: Literal["in turn", "any"] = "in turn"
    """One step after the other, or whichever of their parts is recognised best."""
    if_missing: Literal["stop", "skip", "wait"] = "stop"
    """When no wanted part can be picked: stop (`auto resume` continues), leave out the step, or look again."""
    look_again_s: Seconds = 10.0
    """How long to wait before the next look, with `if_missing: wait`."""


@dataclass(frozen=True)
class Job:
    """A job file that was read: its name, its values, the document for errors with line numbers."""

    name: str
    file: JobFile
    document: Document

    def order(self, times: int = 1) -> PickOrder:
        """The order for doing the job that many times."""
        file, steps = self.file, tuple(OrderStep(step.part, step.count, step.place) for step in self.file.steps)
        return PickOrder(
            count=times * sum(step.count for step in steps),
            every_s=file.look_again_s if file.if_missing == "wait" else None,
            job=self.name,
            steps=steps,
            in_turn=file.order == "in turn",
            skip=file.if_missing == "skip",
            times=times,
            whole=steps,
        )

    def check(self, labels: Collection[str], places: CellPlaces) -> None:
        """Check that each step's part is taught, and its place is one of that part. Raises ConfigError."""
        for number, step in enumerate(self.file.steps):
            of_part = dict.fromkeys(place.name.partition(".")[0] for place in places.of(step.part))
            if step.part not in labels:
                problem = f"expected a taught part ({', '.join(labels) or 'none'}), found {step.part}"
                raise self.document.error(("steps", number, "part"), problem)
            if step.place not in (None, BIN) and not places.of(step.part, step.place):
                known = ", ".join((*of_part, BIN))
                problem = f"expected a place of {step.part} ({known}), found {step.place}"
                raise self.document.error(("steps", number, "place"), problem)


def job_names(folder: Path) -> list[str]:
    """The names of the job files in a folder, sorted; a missing folder has none. Raises FileError."""
    try:
        return sorted(path.stem for path in folder.iterdir() if path.suffix == SUFFIX and NAME.fullmatch(path.stem))
    except FileNotFoundError:
        return []
    except OSError as error:
        raise FileError(f"{folder}: {error.strerror or error}") from None


def unreadable(folder: Path) -> list[str]:
    """Why job files of a folder cannot be read, one line each."""
    problems = []
    try:
        for name in job_names(folder):
            try:
                load_job(folder, name)
            except FileError as error:
                problems.append(str(error))
    except FileError as error:
        problems.append(str(error))
    return problems


def load_job(folder: Path, name: str) -> Job:
    """Read a job file. Raises ConfigError, FileError."""
    document = read(folder / f"{name}{SUFFIX}")
    return Job(name, document.convert(JobFile), document)
