"""A reload: one at a time with what was written for it, and told as it went."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from daemon import service
from daemon.errors import FacetdError
from daemon.service import Service


def test_what_one_operator_writes_is_taken_over_or_put_back_before_another_writes(tmp_path: Path) -> None:
    """Two said `calibrate use` while a reload waited: told `not taken over`, one was at the next start."""
    done: list[str] = []
    on_disk = "configured"

    async def story() -> list[Any]:
        there = Service(tmp_path / "facetd.yaml", simulated=True)

        async def _reload(who: str | None) -> str:
            taken = on_disk
            await asyncio.sleep(0)
            await asyncio.sleep(0)
            done.append(f"{who} reads {taken}")
            if who != "cleo":
                raise FacetdError(f"{who}: not taken over")
            return "taken over"

        def of(who: str) -> Callable[[], Any]:
            async def change() -> Callable[[], None]:
                nonlocal on_disk
                before, on_disk = on_disk, who
                await asyncio.sleep(0)

                def put_back() -> None:
                    nonlocal on_disk
                    on_disk = before

                return put_back

            return change

        there._reload = _reload
        return await asyncio.gather(
            *(there.reload(who, of(who)) for who in ("ann", "bob", "cleo", "dan")), return_exceptions=True
        )

    answers = asyncio.run(story())
    assert [str(answer) for answer in answers] == [
        "ann: not taken over", "bob: not taken over", "taken over", "dan: not taken over",
    ]  # fmt: skip
    assert done == ["ann reads ann", "bob reads bob", "cleo reads cleo", "dan reads dan"]
    assert on_disk == "cleo"


def test_an_arm_that_was_disabled_for_a_reload_that_was_refused_is_told_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It was told: no longer enabled: calibration changed. It had not."""
    told: list[str] = []

    async def disable() -> None:
        return None

    def refuse_during_job(_: str) -> None:
        raise FacetdError("busy: pick")

    for name in ("load_config", "pick_cell", "_report_notes"):
        monkeypatch.setattr(service, name, lambda *_: SimpleNamespace(calibration="c"))
    monkeypatch.setattr(service, "pick_cell", lambda *_: ())
    nothing = SimpleNamespace(check=lambda *_: None, check_hand_eye=lambda *_: None, calibration_in_use=lambda *_: None)
    monkeypatch.setattr(service, "sections", nothing)
    monkeypatch.setattr(service, "_moved", lambda *_: ["calibration"])
    there = Service(tmp_path / "facetd.yaml", simulated=True)
    there.context = SimpleNamespace(  # type: ignore[assignment]
        config=None, calibration=None, hardware=None, log=None, worker=None,
        notices=SimpleNamespace(tell=lambda text, by=None: told.append(text)),
        cycle=SimpleNamespace(
            supervisor=SimpleNamespace(
                busy=False, permission=SimpleNamespace(granted=True), disable=disable,
                refuse_during_job=refuse_during_job
            ),
        ),
    )  # fmt: skip
    with pytest.raises(FacetdError, match="busy: pick"):
        asyncio.run(there.reload("ann"))
    assert told == ["The arm is disabled; nothing else has changed, as the reload was refused: busy: pick"]
