"""A context for tests of commands: a cycle that records calls, a trainer on a real folder, no hardware."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal
from unittest.mock import Mock

import numpy as np

from daemon.arm.belief import Belief, BeliefSource, CellBelief
from daemon.arm.hold import Waiting
from daemon.arm.operators import RefusedError
from daemon.arm.permission import Fault, Grant
from daemon.arm.robot import StopRefusedError
from daemon.console.notices import Notices
from daemon.errors import CommandError
from daemon.events.pick_order import PickOrder
from daemon.maintenance.troubles import Troubles
from daemon.pick.place_table import PlaceTable
from daemon.pick.planning.place_plan import SidePlan
from daemon.pick.set_down import HeldHere
from daemon.pick.settings import Settings as PickSettings
from daemon.pick.transitions import PickState
from daemon.signals.packml import PackMLState
from daemon.signals.production_line import ProductionLine
from tests.fakes.checked_record import checked
from tests.fakes.computing import ComputesHere


@cache
def _waiting(text: str) -> Waiting:
    return Waiting(text, Mock(), 0.0)


@dataclass
class FakeCycle:
    """A cycle that accepts every call and counts it; if it is slow, `doing` stays set until it is released."""

    told: list[str] = field(default_factory=list)
    fault: Fault | None = None
    doing: str | None = None
    pending: str | None = None
    pending_s: float = 60.0
    refuse_with: str | None = None
    stop_refused_with: str | None = None
    slow: bool = False
    pick_order: PickOrder | None = None
    held: bool | None = False
    stops: int = 0
    pauses: int = 0
    paused: bool = False
    auto: bool = False
    dry: bool = False
    stepping: bool = False
    enabled: bool = True
    state: PickState = PickState.IDLE
    target: None = None
    skipped: list[dict[str, Any]] = field(default_factory=list)
    placing: PlaceTable = field(default_factory=PlaceTable)
    recogniser: Any = None
    located: Any = None
    errs: tuple[float, float] = (0.3, 0.1)
    plans: Sequence[SidePlan] = ()
    production_line: ProductionLine = field(
        default_factory=lambda: ProductionLine({}, Mock(), None, lambda: 0.0, lambda *_, **__: None)
    )
    packml: PackMLState = PackMLState.IDLE
    at: Any = field(default_factory=lambda: np.diag([-1.0, 1.0, -1.0, 1.0]))

    @property
    def belief(self) -> CellBelief:
        """The belief about the gripper that an operator reported."""
        return CellBelief(holding=None if self.held is None else Belief(self.held, BeliefSource.OPERATOR, 0.0))

    @property
    def supervisor(self) -> FakeCycle:
        """The supervisor: this fake itself."""
        return self

    @property
    def permission(self) -> FakeCycle:
        """The motion permission: this fake itself."""
        return self

    @property
    def hold(self) -> FakeCycle:
        """The hold: this fake itself."""
        return self

    @property
    def waiting(self) -> Any:
        """The move that waits; it stays the same object while its text is the same."""
        return None if self.pending is None else _waiting(self.pending)

    @property
    def mover(self) -> FakeCycle:
        """The mover: this fake itself."""
        return self

    @property
    def busy(self) -> bool:
        return self.doing is not None

    @property
    def auto_on(self) -> bool:
        return self.auto

    @property
    def fault_text(self) -> str | None:
        """The active fault as a line for people."""
        return None if self.fault is None else self.fault.text

    def status(self) -> dict[str, Any]:
        return {
            "state": "fault" if self.fault else "idle", "doing": self.doing, "fault": self.fault_text,
            "fault_code": self.fault and self.fault.cause.code, "enabled": self.enabled,
            "paused": False, "step": self.stepping, "dry": self.dry, "pending": self.pending, "auto": self.auto,
            "cycle": 1, "target": None, "stop": None, "predicted_mm": None, "predicted_deg": None, "left_s": None,
            "holding": self.held, "picked": 2, "tried": 3, "failed": 1, "released": 0, "aborted": 0,
            "skipped": self.skipped, "last": None, "packml": self.packml, "waits_for": self.production_line.waits_for,
        }  # fmt: skip

    async def move_to(self, world_from_tool: Any, purpose: str) -> None:
        self.told.append(f"move to {purpose}: {world_from_tool[:3, 3].round(3).tolist()}")

    async def go_down(self, over: Any, down: Any, purpose: str) -> None:
        self.told.append(f"{purpose}, from over it: {over[:3, 3].round(3).tolist()}")
        self.at = down

    async def wait_until_at_rest(self) -> Any:
        return self.at

    async def jog(self, there: Callable[[Any], Any], purpose: str) -> Any:
        self.told.append(purpose)
        self.at = there(self.at)
        return self.at

    async def locate(self, label: str) -> Any:
        self.told.append(f"locate {label}")
        return self.located

    async def held_here(self) -> Any:
        self.told.append("held here")
        return HeldHere("cube", self.located, *self.errs)

    async def plan_from_side(self, goal: Any, side: int) -> SidePlan:
        self.told.append(f"plan {goal.place.name} from side {side + 1}")
        return self.plans[side % len(self.plans)]

    async def look_at_places(self, goals: Any) -> None:
        self.told.append(f"look at {', '.join(goal.place.name for goal in goals)}")

    async def set_gripper(self, closed: bool) -> None:
        self.told.append("hand close" if closed else "hand open")

    def positions(self) -> dict[str, Any]:
        return {"home": np.eye(4), "bin": np.eye(4), "survey": np.eye(4)}

    def refuse_if_stopped_since(self, stops: int, word: str) -> None:
        if stops != self.stops:
            raise RefusedError("stopped again")

    def refuse_while_stopping(self, word: str, busy: bool = False) -> None:
        """Refuse nothing: stops of this fake take no time."""

    async def test_stop(self) -> None:
        if self.stop_refused_with:
            raise StopRefusedError(self.stop_refused_with)

    def enable(self, stops: int | None = None, grant: Grant = Grant.ALL) -> None:
        if stops not in (None, self.stops):
            raise RefusedError("stopped again")
        self.told.append("enable" if grant is Grant.ALL else f"enable {grant}")

    def refuse_during_job(self, what: str) -> None:
        """Refuse nothing: this fake has no long jobs."""

    def resume(self, stops: int | None = None, pauses: int | None = None) -> None:
        if stops not in (None, self.stops):
            raise RefusedError("stopped again")
        self.told.append("resume")
        self.fault = None

    def holding(self, held: bool) -> None:
        self.held = held

    def pause(self, by: str) -> None:
        self.told.append("pause")

    async def stop(self, why: str) -> None:
        self.told.append(f"stop {why}")
        self.fault, self.doing = Fault(f"stopped {why}"), None
        self.stops += 1

    async def disable(self) -> None:
        self.told.append("disable")
        self.doing = None
        self.stops += 1

    async def go(self, place: str) -> None:
        if self.refuse_with:
            raise RefusedError(self.refuse_with)
        self.told.append(f"go {place}")
        if self.slow:
            self.doing = place
            while self.doing:
                await asyncio.sleep(0.01)

    def confirm(self) -> None:
        self.told.append("confirm")
        self.pending = self.doing = None

    def refuse(self) -> None:
        self.told.append("refuse")
        self.pending = self.doing = None


@dataclass
class FakeLog:
    """Keeps records."""

    records: list[tuple[str, dict[str, Any]]] = field(default_factory=list)

    def record(self, kind: str, /, **fields: Any) -> None:
        checked(kind, fields)
        self.records.append((kind, fields))


@dataclass
class FakeFrontend:
    """An operator who answers questions in turn."""

    name: str = "test"
    who: str = "tester"
    may: Literal["look", "all"] = "all"
    answers: list[str] = field(default_factory=list)
    said: list[str] = field(default_factory=list)
    asked: list[str] = field(default_factory=list)
    shown: int | None = None
    columns: int = 80
    rows: int | None = None

    @property
    def asks(self) -> bool:
        return bool(self.answers)

    async def fetch(self, path: str) -> bytes:
        raise CommandError(f"no file {path} here")

    async def terminal(self, typed: Callable[[bytes], None]) -> None:
        raise CommandError("no terminal here")

    def show(self, data: bytes) -> None:
        self.said.append(data.decode("latin-1"))

    def notice(self, text: str) -> None:
        self.said.append(text)

    async def say(self, text: str) -> None:
        self.said.append(text)

    async def ask(self, question: str) -> str:
        self.asked.append(question)
        return self.answers.pop(0) if self.answers else ""


def fake_context(folder: Path, reload: Callable[..., Any] | None = None) -> Any:
    """A CommandContext with everything that commands use."""
    trainer = SimpleNamespace(
        parts={"cube": None, "pyramid": None},
        model=SimpleNamespace(labels=("cube",), metric={}),
        model_store=SimpleNamespace(current=3, candidate=None, labels=lambda: ["cube"], views=lambda *_: []),
    )
    return SimpleNamespace(
        cycle=FakeCycle(),
        log=FakeLog(),
        trainer=trainer,
        worker=ComputesHere(),
        study=ComputesHere(),
        coverages=None,
        troubles=Troubles(),
        notices=Notices(),
        hardware=SimpleNamespace(kind="real", seed=None, operator=None, cameras=SimpleNamespace(alone=None)),
        run_log=SimpleNamespace(folder=folder),
        calibration=SimpleNamespace(
            tool_from_cyclopean=1, world_from_cyclopean=None, fixed=False, hand_eye=1, alone=None
        ),
        config=SimpleNamespace(
            calibration=folder / "calibration.yaml",
            state=folder / "state",
            kind="real",
            gripper="fingers",
            values=SimpleNamespace(cameras={"left": "a", "right": "b"}, pick=PickSettings(), grippers={}),
        ),
        parts=["cube", "pyramid"],
        started_s=0.0,
        reload=reload,
    )
