"""Write a run with the real run log, with images, for tests of the review."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from daemon.events.upgrade import VERSION
from daemon.store.runlog import RunLog

FACET = {
    "type": "square",
    "corners_mm": [[0.0, 0, 300], [0, 50, 300], [50, 50, 300], [50, 0, 300]],
    "left_px": [[300.0, 200], [300, 280], [380, 280], [380, 200]],
    "right_px": [[290.0, 200], [290, 280], [370, 280], [370, 200]],
}


def part(label: str, **more: Any) -> dict[str, Any]:
    """A part as daemon/vision/report.py writes it."""
    return {
        "label": label,
        "confidence": 0.98,
        "match_ratio": 1.0,
        "activation": 0.99,
        "runner_up": "pyramid",
        "ambiguous": False,
        "candidates": [],
        "reason": "3 facets fit to 0.10 mm rms",
        "cyclopean_from_part": np.eye(4).tolist(),
        "covariance": (np.eye(6) * 0.01).tolist(),
        "equivalents": [],
        "residual_mm": 0.1,
        "facets": [FACET],
        **more,
    }


class MadeRun:
    """A run whose cycles end with given outcomes."""

    def __init__(self, folder: Path, pictures: bool = True, **start: Any) -> None:
        self.now = 1000.0
        self.log = RunLog(folder, clock=lambda: self.now)
        self.folder = folder
        self.cycle = 0
        self.image = np.full((120, 160), 90, np.uint8) if pictures else None
        self.moved: dict[str, Any] | None = None
        kept = folder / "made.yaml"
        kept.write_text("version: 1\n")
        self.log.record("run_start", config=self.log.keep(kept), calibration=self.log.keep(kept), seed=1, **start)

    def write(self, kind: str, /, after_s: Any = 0.1, **fields: Any) -> None:
        self.now += after_s
        self.log.record(kind, **fields)

    def look(
        self, purpose: str, *parts: dict[str, Any], stop: int = 0, guesses: Any = (), notes: Any = (),
        refused: int = 0, **health: Any,
    ) -> None:  # fmt: skip
        rejected = [{"eye": "left", "reason": "its corners do not lie in one plane", "corners_px": []}] * refused
        scene = {"ms": 12.0, "parts": list(parts), "rejected": rejected, "notes": list(notes), "guesses": list(guesses)}
        images = {} if self.image is None else {"images": {"left": self.image, "right": self.image}}
        self.write(
            "look", cycle=self.cycle, stop=stop, purpose=purpose, scene=scene, seconds={"facets": 0.01},
            health={"epipolar_px": 0.05, "noise": 2.0, **health}, world_from_cyclopean=np.eye(4), where=np.eye(4),
            **images, **({} if self.moved is None else {"moved": self.moved}),
        )  # fmt: skip

    def arrive(self, where: Any, joints: Any, how: str, purpose: str) -> None:
        """A move that ends at where (4, 4), joints (6,) rad."""
        self.write("move", cycle=self.cycle, how=how, target=where, speed_pct=40.0, purpose=purpose, sent=True)
        self.write("moved", after_s=1.0, cycle=self.cycle, where=where, joints=list(joints), error_mm=0.02, seconds=1.0)

    def pick(
        self, outcome: str = "picked", label: str = "cube", why: str = "gone from where it lay", **end: Any
    ) -> None:
        self.cycle += 1
        self.write("cycle_start", cycle=self.cycle, target=None)
        self.write("state", cycle=self.cycle, event="begin", to="survey", **{"from": "idle"})
        self.look("survey 1", part(label))
        self.write("decision", cycle=self.cycle, text=f"pick {label}", why="surest")
        self.write("state", cycle=self.cycle, event="chosen", to="stop_n", **{"from": "choose"})
        for stop, mm in ((1, 1.5), (2, 0.7)):
            self.write("move", cycle=self.cycle, how="straight", target=np.eye(4), speed_pct=50.0, purpose="stand-off")
            self.write(
                "moved", cycle=self.cycle, where=np.eye(4), joints=[0.0] * 6, error_mm=0.01, error_deg=0, seconds=1
            )
            self.look("approach", part(label), stop=stop)
            self.write(
                "estimate", cycle=self.cycle, stop=stop, label=label, world_from_part=np.eye(4), covariance=np.eye(6),
                predicted_mm=mm, predicted_deg=0.2, chi2=end.get("chi2", 1.0),
            )  # fmt: skip
        self.write("cycle_end", cycle=self.cycle, outcome=outcome, label=label, stops=2, why=why, grasp=None,
                   predicted={"mm": 0.7, "deg": 0.2}, code=end.get("code"), stopped=end.get("stopped"))  # fmt: skip

    def set_down(self, place: str, status: str, outcome: str = "picked", **off: float) -> None:
        """A pick of a cube that is set down at a place, and looked at there."""
        self.cycle += 1
        of_place: dict[str, Any] = {"cycle": self.cycle, "place": place, "label": "cube"}
        self.write("cycle_start", cycle=self.cycle, target=None)
        self.look("survey 1", part("cube"))
        for each in ("claimed", "set"):
            self.write("place", **of_place, status=each)
        self.write("place", **of_place, status=status, why="as it was seen", **off)
        self.write("cycle_end", cycle=self.cycle, outcome=outcome, label="cube", stops=0, why="", grasp=None)

    def close(self, version: int = VERSION) -> Path:
        """version: that of the lines, for a run of an earlier release."""
        self.log.close("the made run ends")
        lines = self.folder / "run.jsonl"
        lines.write_text(lines.read_text().replace(f'{{"v":{VERSION},', f'{{"v":{version},'))
        return self.folder

    def cut(self, version: int = VERSION) -> Path:
        """End the run as a killed daemon leaves it: without an end record."""
        lines = self.close(version) / "run.jsonl"
        lines.write_text("".join(lines.read_text().splitlines(keepends=True)[:-1]))
        return self.folder


def quiet(runs: Path) -> None:
    """Date the files of these runs back by more than an hour."""
    for file in runs.rglob("*"):
        if file.is_file():
            then = file.stat().st_mtime - 3600
            os.utime(file, (then, then))


def long_run(folder: Path, cycles: int) -> Path:
    """A run of so many cycles with scenes of four parts; of the last hundred there are images, the hardest to pack."""
    made = MadeRun(folder, pictures=False)
    scene = [part(f"part{k}", facets=[FACET] * 6) for k in range(4)]
    for k in range(cycles - 100):
        made.cycle += 1
        made.write("cycle_start", cycle=made.cycle, target=None)
        made.look("survey 1", *scene, refused=20)
        outcome = "missed" if k % 50 == 7 else "picked"
        made.write("cycle_end", cycle=made.cycle, outcome=outcome, label="cube", stops=0, why="", grasp=None)
    made.image = np.random.default_rng(0).integers(0, 255, (480, 640), np.uint8)
    for _ in range(100):
        made.pick()
    return made.close()
