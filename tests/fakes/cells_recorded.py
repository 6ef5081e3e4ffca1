"""Record runs of simulated cells: rendered pictures, a line on a pty, the daemon's own pick and log."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from daemon.config import load_config
from daemon.store.model import save
from daemon.store.runlog import RunLog
from daemon.vision.model import Model
from tests.fakes import simulated_cell
from tests.fakes.simulated_cell import CONFIG, ListLog


@dataclass(eq=False)
class KeptLog(ListLog):
    """A log in memory whose records go into a run folder, too."""

    run: RunLog | None = None

    def record(self, kind: str, /, **fields: Any) -> None:
        """Write and keep one record."""
        assert self.run is not None
        self.run.record(kind, **fields)
        super().record(kind, **fields)


async def record_pick(folder: Path, name: str, model: Model, seed: int, labels: list[str]) -> Path:
    """One pick of a cell called `name`, from a table with `labels` on it, as the run in `folder`."""
    spare = folder.parent.parent / f"{name}.npz"
    spare.parent.mkdir(parents=True, exist_ok=True)
    save(model, spare)
    config = load_config(CONFIG, simulated=True)
    run = RunLog(folder, patience_s=10.0)
    kept = {
        key: run.keep(path) for key, path in (("calibration", config.calibration), ("model", spare), ("config", CONFIG))
    }
    run.record("run_start", version="0.1.0", cell="simulated", name=name, utc_offset_s=0, seed=seed, **kept)
    log = KeptLog(run=run)
    async with simulated_cell.rig(seed=seed, model=model, log=log) as here:
        here.cell.scatter(labels)
        await here.cycle.pick()
    for entry in log.wire:
        run.wire(entry)
    assert run.settle(60.0)
    run.close("recorded")
    return folder
