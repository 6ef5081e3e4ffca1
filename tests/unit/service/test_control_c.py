"""Control-C at any frontend: the arm first; only one that shows that it rests is left alone."""

from __future__ import annotations

import asyncio
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from daemon.service import Service

ALARM = "stopped; NOT CONFIRMED: no answer: press the emergency stop"


def pressed(at_rest: bool, about_to_move: bool, alarm: str | None = None) -> tuple[str, list[str]]:
    """What is answered, and what was done; nothing can be logged."""
    done: list[str] = []

    async def rests() -> bool:
        done.append("asked")
        return at_rest

    async def stop(why: str) -> str | None:
        done.append(why)
        return alarm

    def full(*_: object, **__: object) -> None:
        done.append("logged")
        raise OSError(28, "No space left on device")

    service: Any = Service(Path("facetd.yaml"))
    supervisor = SimpleNamespace(at_rest=rests, stop=stop)
    service.context = SimpleNamespace(cycle=SimpleNamespace(supervisor=supervisor), log=SimpleNamespace(record=full))
    return asyncio.run(service._interrupt("ann\ud800", about_to_move)), done


@pytest.mark.parametrize(
    ("at_rest", "about_to_move", "done"),
    [
        (True, False, ["asked"]),
        (False, False, ["asked", "by control-C of ann\ud800", "logged"]),
        (True, True, ["by control-C of ann\ud800", "logged"]),
    ],
)
def test_only_an_arm_that_shows_that_it_rests_is_left_alone(
    at_rest: bool, about_to_move: bool, done: list[str]
) -> None:
    answer, was_done = pressed(at_rest, about_to_move)
    assert was_done == done
    assert answer == ("Nothing moves." if done == ["asked"] else "Stopped. Nothing moves until `resume`.")


def test_a_stop_that_is_not_confirmed_is_told_as_it_is() -> None:
    assert pressed(False, True, ALARM)[0] == ALARM
