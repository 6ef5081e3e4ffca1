"""An eye that has moved: told with every look, and the end of picking by itself; what an operator asks for goes on."""

from __future__ import annotations

import asyncio
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from daemon.calibration.drift import Drift
from daemon.console.context import Troubles
from daemon.service import Service


def told(drift: Drift | None, auto: bool) -> tuple[dict[str, str], list[tuple[str, str]]]:
    """The troubles that stand after one look, and what the supervisor was told to fail with."""
    failed: list[tuple[str, str]] = []

    async def fail(code: str, text: str) -> None:
        failed.append((code, text))

    async def story() -> dict[str, str]:
        service: Any = Service(Path("facetd.yaml"))
        cycle = SimpleNamespace(status=lambda: {"auto": auto}, supervisor=SimpleNamespace(fail=fail))
        service.context = SimpleNamespace(cycle=cycle, troubles=Troubles())
        service._drift = SimpleNamespace(seen=lambda clue, at: drift, alone=None)
        service.looked(SimpleNamespace(clue=None, taken=SimpleNamespace(moved=None)))
        await asyncio.sleep(0.01)
        standing: dict[str, str] = service.context.troubles.standing
        return standing

    return asyncio.run(story()), failed


@pytest.mark.parametrize(
    ("drift", "auto", "fails"),
    [
        (Drift("pitched", 0.2, "09:12", True, "an eye has moved"), True, True),
        (Drift("pitched", 0.2, "09:12", True, "an eye has moved"), False, False),
        (Drift("pitched", 0.05, "09:12", False, "an eye has moved"), True, False),
        (None, True, False),
    ],
)
def test_a_drift_is_told_and_past_its_limit_it_ends_auto(drift: Drift | None, auto: bool, fails: bool) -> None:
    standing, failed = told(drift, auto)
    assert standing == ({} if drift is None else {"calibration": "an eye has moved"})
    assert failed == ([("calibration", "an eye has moved")] if fails else [])
