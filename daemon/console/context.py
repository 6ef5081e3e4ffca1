"""The context of commands: what they share. service.py builds it, starts and ends its parts."""

import asyncio
import socket
import time
from collections import Counter
from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Protocol

from daemon import VERSION
from daemon.arm import CameraName, Recorder
from daemon.calibration.file import Calibration
from daemon.cell.hardware import EXPECTED_ERRORS, Hardware
from daemon.cell.pick_cell import pick_cell
from daemon.compute.worker import Worker
from daemon.config import Config
from daemon.console.notices import NoticeLevel, Notices
from daemon.console.phrases import plural
from daemon.errors import FacetdError
from daemon.events.outcomes import Outcome
from daemon.events.pick_order import ALL, PickOrder, auto_record
from daemon.maintenance.troubles import Troubles
from daemon.pick.cycle import PickCycle
from daemon.pick.looks import Look
from daemon.pick.outcome import CycleEnd
from daemon.store.runlog import RunLog
from daemon.store.runs import new_folder
from daemon.teaching.trainer import Trainer
from daemon.teaching.view_coverage import ViewCoverage
from daemon.vision.facets import TablePlane, table_at

ANSWERABLE: tuple[type[Exception], ...] = (FacetdError, *EXPECTED_ERRORS)
"""Errors that a command answers instead of failing. Drivers have error roots of their own."""

Change = Callable[[], Awaitable[Callable[[], None]]]
"""Writes new files; returns a function that restores the old ones."""


class Reload(Protocol):
    """Reload configuration and calibration from disk (service.py)."""

    def __call__(self, who: str | None, change: Change | None = None) -> Awaitable[str]:
        """who: the operator; change: applied first, in the same turn. Raises FacetdError."""


@dataclass
class CommandContext:
    """What commands work with. A reload replaces config and calibration."""

    config: Config
    calibration: Calibration
    hardware: Hardware
    cycle: PickCycle
    trainer: Trainer
    run_log: RunLog
    log: Recorder
    troubles: Troubles
    reload: Reload
    worker: Worker
    """Computes observations and plans."""
    study: Worker
    """Computes what no arm waits for: training, drawings, calibrations."""
    notices: Notices = field(default_factory=Notices)
    started_s: float = field(default_factory=time.monotonic)
    roll_due: bool = False
    """The run's folder is large: start a new one as soon as no pick is under way."""
    coverages: tuple[int, tuple[ViewCoverage, ...]] | None = None
    """The model version checked last for sufficient views, and the result."""
    one_camera_allowed: bool = False
    """An operator permitted picking with one camera after a fault of the other."""
    not_held: Mapping[CameraName, Sequence[str]] | None = None
    """What each camera did not hold in the last test before a still scene; None: not tested."""
    shutters: Mapping[CameraName, str] | None = None
    """How each camera exposes its rows, where `cameras moving` measured it; None: never tested."""
    _auto: asyncio.Task[list[CycleEnd]] | None = None
    _begun: PickOrder = ALL
    """The order that the last auto was to bring."""

    @property
    def parts(self) -> list[str]:
        """All valid labels: in parts.yaml, taught, or with stored views."""
        known = [*self.trainer.parts, *self.trainer.model.labels, *self.trainer.model_store.labels()]
        return list(dict.fromkeys(known))

    def table_in(self, look: Look) -> TablePlane:
        """The table in the cyclopean frame of an observation."""
        return table_at(self.config.values.pick.limits.table_z_mm, look.world_from_cyclopean)

    async def look_with(self, alone: CameraName | None, why: str) -> None:
        """Use one camera, or both (None), between jobs and as a job of its own. Raises CameraError, RefusedError."""
        before, cameras = self.hardware.cameras.alone, self.hardware.cameras

        async def changed() -> None:
            try:
                await cameras.use(alone)
            except BaseException:  # a stop in between: the cameras may have changed already
                await cameras.use(before)
                raise
            self.cycle.refit(*pick_cell(self.config, self.calibration, self.hardware, self.log, self.worker))

        self.cycle.supervisor.refuse_during_job("cameras are changed")
        await self.cycle.supervisor.run("change cameras", changed(), moves=False)
        self.log.record("eyes", alone=alone, why=why)
        self.troubles.report("eyes", None if alone is None else f"using the {alone} camera alone: {why}")

    async def begin_auto(self, pick_order: PickOrder = ALL) -> None:
        """Start `auto` in the background. Raises RefusedError where it may not start."""
        auto = asyncio.create_task(self.cycle.begin_auto(pick_order), name="auto")
        auto.add_done_callback(self._auto_ended)
        self._begun = pick_order
        self._auto = auto

    def _auto_ended(self, auto: asyncio.Task[list[CycleEnd]]) -> None:
        if not auto.cancelled() and auto.exception() is None:
            self.notices.tell(f"Auto has ended: {self.auto_end(auto.result())}", NoticeLevel.OUTCOMES)

    def auto_end(self, ends: list[CycleEnd]) -> str:
        """The end of the last auto in words, such as `2 parts picked; the table is empty.`."""
        picked, count = sum(end.outcome == Outcome.PICKED for end in ends), self._begun.count
        outcome, why = (ends[-1].outcome, ends[-1].why) if ends else (None, "")
        if (fault := self.cycle.supervisor.fault_text) is not None:
            reason = fault
        elif ends and ends[-1].ended_by is not None:
            reason = f"the last one ended as {outcome}: {why}"
        elif count is not None and picked >= count:
            reason = "that is as many as requested" if self._begun.job is None else "that is all of the job"
        elif outcome == Outcome.EMPTY:
            left = len(self.cycle.skipped)
            alone = f"{plural(left, 'part')} left alone, `status` says why"
            reason = f"nothing more to pick: {alone}" if left else "the table is empty"
        elif outcome in (Outcome.PICKED, Outcome.EMPTIED):
            reason = "ended by `auto off`"
        elif outcome is None:
            reason = "stopped before the first pick"
        else:
            reason = f"the last one ended as {outcome}" + (f": {why}" if why else "")
        lacking = self._begun.missing(Counter(end.label for end in ends if end.label and end.brought))
        still = ", ".join(f"{count} {label}" for label, count in lacking.items())
        return f"{plural(picked, 'part')} picked; {reason}." + (f" Still missing: {still}." if still else "")

    async def auto_ends(self) -> list[CycleEnd]:
        """Wait for the last auto to end: the end of each pick. Empty where there was no auto."""
        return [] if self._auto is None else await asyncio.shield(self._auto)

    def roll_if_due(self) -> None:
        """Start a new run folder between two picks where one is due: an auto of weeks is never idle."""
        if self.roll_due:
            self.roll_due = False
            self.new_run(new_folder(self.config.runs, datetime.now(UTC)))

    def new_run(self, folder: Path) -> None:
        """Continue in a new run folder, which again records configuration, calibration and model."""
        before = self.run_log.folder
        self.run_log.roll(folder)
        self.record_start(continues=before.name)
        pick_order = self.cycle.pick_order
        if pick_order is not None:
            self.log.record("auto", **auto_record(pick_order))
        if self.cycle.belief.holds_part is not False:
            self.log.record("holding", held=self.cycle.belief.holds_part)

    def record_start(self, **more: object) -> None:
        """Record the start of a run with its configuration, calibration and model, each file by its content."""
        model_store, log, config = self.trainer.model_store, self.run_log, self.config
        pick = config.values.pick
        model = None if model_store.current is None else log.keep(model_store.path(model_store.current))
        log.record(
            "run_start",
            version=VERSION,
            cell=self.hardware.kind,
            name=socket.gethostname(),
            utc_offset_s=int((datetime.now().astimezone().utcoffset() or timedelta()).total_seconds()),
            limits={"grasp_mm": pick.stops.enough_mm, "arrival_mm": pick.arrival.within_mm},
            config=log.keep(config.path),
            arm=None if config.values.arm.file is None else log.keep(config.file(config.values.arm.file)),
            calibration=log.keep(config.calibration),
            model=model,
            gripper=config.gripper,
            seed=self.hardware.seed,
            times_life=config.values.simulated.time_scale if self.hardware.kind == "simulated" else None,
            **more,
        )

    def use_model(self, action: str, version: int | None) -> None:
        """Use the trainer's model from the next pick on, and record it."""
        recogniser = self.trainer.in_use
        self.cycle.use(recogniser)
        self.worker.prepare(recogniser)
        kept = None if version is None else self.run_log.keep(self.trainer.model_store.path(version))
        self.log.record("model", action=action, version=version, labels=list(recogniser.labels), file=kept)
