"""A camera that has moved: told with every look, and the end of picking by itself; what an operator asks for goes
on."""

from __future__ import annotations

import asyncio
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import pytest

from daemon.calibration.drift import Drift, DriftWatch
from daemon.commands.cycle_observer import CycleObserver
from daemon.maintenance.troubles import Troubles
from daemon.pick.settings import Settings
from daemon.service import Service
from daemon.store.place_file import CellPlaces
from tests.fakes.in_time import lived

LOOK: Any = SimpleNamespace(clue=None, taken=SimpleNamespace(moved=None))


def told(drift: Drift | None, auto: bool) -> tuple[dict[str, str], list[tuple[str, str]]]:
    """The troubles that stand after one look, and what the supervisor was told to fail with."""
    failed: list[tuple[str, str]] = []

    async def fail(code: str, text: str, cause: object) -> None:
        failed.append((code, text))

    async def story() -> dict[str, str]:
        cycle = SimpleNamespace(auto_on=auto, supervisor=SimpleNamespace(fail=fail))
        context: Any = SimpleNamespace(cycle=cycle, troubles=Troubles(), calibration=None)
        between: Any = CycleObserver(context, Service(Path("facetd.yaml")).in_background)
        between._drift = SimpleNamespace(add=lambda clue, at: drift, alone=None)
        between.looked(LOOK)
        await asyncio.sleep(0.01)
        standing: dict[str, str] = context.troubles.active
        return standing

    return lived(story()), failed


@pytest.mark.parametrize(
    ("drift", "auto", "fails"),
    [
        (Drift(0.2, True, "a camera has moved"), True, True),
        (Drift(0.2, True, "a camera has moved"), False, False),
        (Drift(0.05, False, "a camera has moved"), True, False),
        (None, True, False),
    ],
)
def test_a_drift_is_told_and_past_its_limit_it_ends_auto(drift: Drift | None, auto: bool, fails: bool) -> None:
    standing, failed = told(drift, auto)
    assert standing == ({} if drift is None else {"calibration": "a camera has moved"})
    assert failed == ([("calibration", "a camera has moved")] if fails else [])


def test_what_was_seen_of_another_calibration_is_no_drift_of_this_one(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[object] = []
    monkeypatch.setattr(DriftWatch, "add", lambda watch, clue, at: asked.append(watch))
    context: Any = SimpleNamespace(cycle=None, troubles=Troubles(), calibration="before")
    between = CycleObserver(context, lambda work, name: work.close())
    for calibration in ("before", "before", "after", "after"):
        context.calibration = calibration
        between.looked(LOOK)
    before, again, after, then = asked
    assert before is again is not after is then


def test_the_daemons_cycle_tells_its_looks_and_picks_to_it(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("daemon.service.pick_cell", lambda *_: (Mock(), Settings()))
    service: Any = Service(Path("facetd.yaml"))
    service._hardware = Mock()
    config = Mock(
        state=tmp_path,
        places=CellPlaces(),
        **{"values.signals": {}, "values.modbus": None, "values.vision.budget_s": 1.0},
    )
    context = service._furnish(config, Mock(), Mock(), Troubles(), Mock())
    assert isinstance(context.cycle.observer, CycleObserver)
