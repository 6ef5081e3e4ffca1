"""Views taught to a model in use: a candidate first, nothing kept of what cannot serve."""

from __future__ import annotations

import json
from types import SimpleNamespace

import numpy as np
import pytest

from daemon.teaching.trainer import Trainer
from daemon.teaching.view_coverage import simulated_view
from daemon.vision.model.model import TeachError
from daemon.vision.settings import MemorySettings, VisionSettings
from tests.fakes import drawn, rendered
from tests.fakes.taught import scenes, taught


def test_taught_views_make_a_candidate_and_the_model_in_use_is_not_touched(trainer: Trainer) -> None:
    labels = taught(trainer, "cube", "pyramid")
    assert [view.label for view in trainer.untrained_views()] == sorted(labels)
    before = trainer.in_use
    trained = trainer.train()
    assert trained.left_out == ()
    assert len(trained.verdicts) == len(labels)
    assert trainer.model.labels == ()
    assert before.labels == ()
    assert trainer.accept(trainer.model_store.candidate) == trained.version
    assert set(trainer.in_use.labels) == set(labels)
    assert trainer.untrained_views() == []
    again = Trainer(trainer.model_store, trainer.rig, trainer.library, trainer.parts)
    assert again.model.labels == trainer.model.labels, "a restart finds the model that was accepted"


def test_nothing_in_view_is_refused_with_what_to_do_and_nothing_is_kept(trainer: Trainer) -> None:
    grey = np.full((480, 640), 90, np.uint8)
    with pytest.raises(TeachError, match="no part is seen: put it where both cameras see it"):
        trainer.store("cube", grey, grey, {})
    assert trainer.model_store.views() == []
    with pytest.raises(TeachError, match="no views to train on"):
        trainer.train()


@pytest.mark.parametrize(
    ("sizes", "told"),
    [
        ((1, 1), "2 facets are seen, and none meets another: turn the part a little until the edge between"),
        ((2, 1, 2), "3 parts are in view; show the one to be taught alone"),
    ],
)
def test_what_hangs_together_nowhere_is_not_told_to_be_so_many_parts(
    trainer: Trainer, monkeypatch: pytest.MonkeyPatch, sizes: tuple[int, ...], told: str
) -> None:
    """A bracket alone in the hand, two of its sides without the edge between: "2 parts are in view; show it alone"."""
    groups = tuple(SimpleNamespace(facets=(None,) * size) for size in sizes)
    scene = SimpleNamespace(view=SimpleNamespace(groups=groups))
    monkeypatch.setattr("daemon.vision.look.look", lambda *_, **__: scene)
    grey = np.full((480, 640), 90, np.uint8)
    with pytest.raises(TeachError, match=told):
        trainer.single_part(grey, grey, None)


def test_a_view_that_can_no_longer_be_read_is_left_out_and_named(trainer: Trainer) -> None:
    taught(trainer, "cube", "pyramid")
    (trainer.model_store.views()[0].folder / "left.png").write_bytes(b"")
    trained = trainer.train()
    assert len(trained.left_out) == 1
    assert "not an image" in trained.left_out[0]


@pytest.mark.parametrize("wrong", [{"unit": "furlong"}, {"moved": {"eye": "left"}}, {"moved": {"eye": "third"}}])
def test_a_note_with_an_unknown_unit_or_half_a_place_spoils_its_own_view_and_no_other(
    trainer: Trainer, wrong: dict[str, object]
) -> None:
    """A unit that nobody knows ended every training with a KeyError, and so did half a place."""
    for label in ("cube", "brick"):
        trainer.store_mesh(label, "box.obj", drawn.obj(*drawn.box(40, 50, 60)), "mm", {})
    note = trainer.model_store.views("cube")[0].folder / "view.json"
    note.write_text(json.dumps(json.loads(note.read_text()) | wrong))
    trained = trainer.train()
    assert [line.split(":")[0] for line in trained.left_out] == ["cube/1"]
    assert [verdict.label for verdict in trained.verdicts] == ["brick"]


def test_the_sides_of_a_view_that_could_be_another_part_are_not_told(trainer: Trainer) -> None:
    """How such a part lies is not known, and those of a small one were told by chance: the nearest of any turn."""
    trainer.store_mesh("brick", "brick.obj", drawn.obj(*drawn.box(12, 16, 24)), "mm", {})
    view = simulated_view(drawn.block(12, 16, 24), np.array([0.6, 0.5, 0.62]), trainer.rig)
    assert view is not None
    assert trainer.preview_view("block", view)[1] == [None] * 3
    assert sorted(map(str, trainer.preview_view("brick", view)[1])) != ["None"] * 3


def test_what_a_candidate_names_does_not_hang_on_how_fast_the_computer_is(trainer: Trainer) -> None:
    """On an emulated computer a view that a look names by straight edges only was taught, and failed its own check."""
    scene = scenes("printed")[3]
    hurried = VisionSettings(budget_s=1e-9)
    slow = Trainer(trainer.model_store, trainer.rig, trainer.library, trainer.parts, hurried)
    slow.store("part", *rendered.pair(scene), {})
    (verdict,) = slow.train().verdicts
    assert verdict.right, verdict
    candidate = slow.version(slow.model_store.candidate)
    assert candidate is not None
    named = [part for part in candidate.see(*rendered.pair(scene)).parts if part.named]
    assert not named, "the look itself keeps to its budget"


def test_a_view_taught_after_a_forgotten_one_is_not_in_use_yet_whatever_the_clock_says(trainer: Trainer) -> None:
    """Its number had been given anew, and the clock decided: wrong for ever after it had been a day ahead."""
    taught(trainer, "cube", "pyramid")
    trainer.train()
    trainer.accept(trainer.model_store.candidate)
    last = trainer.model_store.views()[-1]
    pictures = last.images()
    assert trainer.model_store.drop_views(last.label, last.number) == 1
    again = trainer.model_store.add_view(last.label, *pictures, {"taught": "1999-01-01T00:00:00+00:00"})
    assert again.number == last.number + 1
    assert [view.name for view in trainer.untrained_views()] == [again.name]
    for view in trainer.model_store.views():
        note = view.folder / "view.json"
        note.write_text(json.dumps({**json.loads(note.read_text()), "taught": "2999-01-01T00:00:00+00:00"}))
    assert [view.name for view in trainer.untrained_views()] == [again.name]
    trainer.train()
    trainer.accept(trainer.model_store.candidate)
    assert trainer.untrained_views() == []
    trainer.model_store.drop_views(last.label)
    assert trainer.model_store.add_view(last.label, *pictures, {}).number == again.number + 1


def test_a_model_recalls_as_the_settings_say_that_it_was_trained_with(trainer: Trainer) -> None:
    loose = MemorySettings(vigilance=0.9, beta=0.5)
    other = Trainer(trainer.model_store, trainer.rig, trainer.library, trainer.parts, memory=loose)
    other.store_mesh("cube", "cube.obj", drawn.obj(*drawn.box()), "mm", {})
    version = other.train().version
    kept = trainer.model_store.load(version).model
    assert kept.parameters == loose
    assert kept.artmap.beta == loose.beta
    assert trainer.learn_all()[0].parameters == MemorySettings()
