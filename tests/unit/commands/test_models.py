"""Commands about models: what `accept` tells of parts that could be taken for each other."""

from __future__ import annotations

import asyncio
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from daemon.commands.models import accept
from daemon.commands.observing import status
from daemon.commands.teaching import describe_alike
from daemon.errors import CommandError
from daemon.store.library import load_facets, load_parts
from daemon.store.model_store import ModelStore
from daemon.teaching.trainer import Trainer
from daemon.teaching.view_coverage import VIEWPOINTS, ConfusablePair
from tests.fakes import drawn, fake_context, rendered


class Nobody:
    """A frontend at which nobody is asked."""

    name, who, may, asks = "test", "tester", "all", False
    shown: int | None = None


def accepted(folder: Path, **drawings: tuple[float, float, float]) -> tuple[str, list[dict[str, object]]]:
    trainer = Trainer(ModelStore(folder), rendered.rig(rendered.HERE, "B"), load_facets(), load_parts())
    for label, size in drawings.items():
        trainer.store_mesh(label, f"{label}.stl", drawn.binary_stl(*drawn.box(*size)), "mm", {})
    trainer.train()
    context = fake_context.fake_context(folder)
    context.trainer = trainer
    context.use_model = lambda action, version: None
    answer = asyncio.run(accept.run(context, [], Nobody()))  # type: ignore[arg-type]
    return answer.text, answer.data["alike"]


@pytest.mark.slow
def test_parts_that_could_be_taken_for_each_other_are_told_of_with_what_is_then_seen(tmp_path: Path) -> None:
    text, pairs = accepted(tmp_path, brick=(40, 50, 60), copy=(40, 50, 60.2))
    assert pairs[0]["labels"] == ("brick", "copy")
    assert pairs[0]["facets"] == ("rectangle",) * 3
    told = text.splitlines()
    assert told[0] == "Version 1 is in use; `rollback` switches back."
    assert told[1].startswith("Could be confused: brick and copy seen as 3 rectangles alone (")
    assert told[1].endswith(f" directions of {VIEWPOINTS}). A second look from another side decides.")


@pytest.mark.slow
def test_parts_that_differ_in_every_side_are_not(tmp_path: Path) -> None:
    assert accepted(tmp_path, brick=(40, 50, 60), plank=(25, 70, 90)) == (
        "Version 1 is in use; `rollback` switches back.", []
    )  # fmt: skip


class Store:
    """Versions without models."""

    current: int | None = None
    candidate: int | None = 7
    history = ()

    def accept(self, version: int | None) -> int | None:
        assert version == self.candidate, "what was meant when it was said"
        self.current, self.candidate = version, None
        return version


def with_store(folder: Path, store: Store) -> Any:
    context = fake_context.fake_context(folder)
    context.trainer = SimpleNamespace(
        model_store=store,
        coverages_of_version=lambda _: (),
        accept=store.accept,
        model=SimpleNamespace(labels=("cube",)),
    )
    context.use_model = lambda action, version: None
    return context


def test_accept_takes_the_candidate_that_was_shown_at_that_frontend_and_no_other(tmp_path: Path) -> None:
    """It took what somebody else had trained meanwhile, seen by nobody who said so."""
    store = Store()
    context, ann, bob = with_store(tmp_path, store), fake_context.FakeFrontend(), fake_context.FakeFrontend()
    asyncio.run(status.run(context, [], ann))
    store.candidate = 8
    with pytest.raises(CommandError) as refused:
        asyncio.run(accept.run(context, [], ann))
    assert str(refused.value) == (
        "not accepted: somebody trained meanwhile. You saw version 7, the candidate is now version 8: "
        "`try` tests it, `accept` again takes 8, `model use 7` takes 7"
    )
    assert store.current is None
    asyncio.run(status.run(context, [], bob))
    assert asyncio.run(accept.run(context, [], bob)).text == "Version 8 is in use; `rollback` switches back."
    store.candidate, ann.shown = 9, 9
    assert asyncio.run(accept.run(context, [], ann)).data["version"] == 9


def test_accept_takes_no_candidate_that_somebody_trains_while_it_is_asked_about(tmp_path: Path) -> None:
    store = Store()
    context = with_store(tmp_path, store)
    context.cycle.auto = True

    class Slow(fake_context.FakeFrontend):
        async def ask(self, question: str) -> str:
            store.candidate = 8
            return "y"

    with pytest.raises(AssertionError, match="what was meant"):
        asyncio.run(accept.run(context, [], Slow(answers=["y"])))


def test_the_likeliest_few_pairs_are_told_and_how_many_more_there_are() -> None:
    pairs = [ConfusablePair((f"a{k}", f"b{k}"), ("square", "rectangle", "square"), 9 - k) for k in range(5)]
    told = describe_alike(pairs)
    assert "a0 and b0 seen as 2 squares and 1 rectangle alone (9 directions of 60); " in told
    assert "a3" not in told
    assert told.endswith("; 2 pairs more, less likely. A second look from another side decides.")
