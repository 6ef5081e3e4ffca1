"""Views and models on disk: whole or not there, in versions, with a way back."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daemon.store.library import load_facets
from daemon.store.model import ModelError
from daemon.store.model_store import ModelStore, model_file
from daemon.store.outside import FileError
from daemon.vision.model.model import Model, empty_model


def picture(value: int) -> np.ndarray:
    return np.full((48, 64), value, np.uint8)


@pytest.fixture
def model_store(tmp_path: Path) -> ModelStore:
    return ModelStore(tmp_path)


@pytest.fixture
def model() -> Model:
    return empty_model(load_facets())


def test_a_view_comes_back_as_it_was_put_there(model_store: ModelStore) -> None:
    view = model_store.add_view("cube", picture(1), picture(2), {"who": "anna"})
    (found,) = model_store.views()
    assert (found.name, found.note["who"], found.note["label"]) == ("cube/1", "anna", "cube")
    left, right = found.images()
    assert (left[0, 0], right[0, 0]) == (1, 2)
    assert view == found


def test_numbers_go_on_and_removed_views_leave_nothing_behind(model_store: ModelStore) -> None:
    for _ in range(11):
        model_store.add_view("cube", picture(1), picture(2), {})
    assert [view.number for view in model_store.views("cube")] == list(range(1, 12))
    assert model_store.drop_views("cube", 4) == 1
    assert model_store.drop_views("cube", 4) == 0
    assert model_store.add_view("cube", picture(1), picture(2), {}).number == 12
    assert model_store.drop_views("cube") == 11
    assert model_store.labels() == []
    assert list((model_store.folder / "views").iterdir()) == []


def test_a_disk_that_fills_up_in_the_middle_leaves_no_half_view(
    model_store: ModelStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = []

    def fail_on_the_second(path: Path, content: bytes) -> None:
        calls.append(path)
        if len(calls) == 2:
            raise OSError(errno.ENOSPC, "No space left on device")
        path.write_bytes(content)

    monkeypatch.setattr("daemon.store.model_store.write_atomically", fail_on_the_second)
    with pytest.raises(FileError, match="the view is not stored: No space left on device"):
        model_store.add_view("cube", picture(1), picture(2), {})
    assert model_store.views() == []
    assert list((model_store.folder / "views" / "cube").iterdir()) == []


def test_a_candidate_is_not_in_use_until_accepted_and_rollback_goes_back(model_store: ModelStore, model: Model) -> None:
    assert (model_store.current, model_store.candidate) == (None, None)
    with pytest.raises(FileError, match="no candidate"):
        model_store.accept(model_store.candidate)
    assert model_store.put_candidate(model) == 1
    assert (model_store.current, model_store.candidate) == (None, 1)
    assert model_store.accept(model_store.candidate)[0] == 1
    assert model_store.put_candidate(model) == 2
    assert model_store.put_candidate(model) == 3
    with pytest.raises(FileError, match="the candidate is now version 3"):
        model_store.accept(2)
    assert model_store.current == 1
    assert model_store.accept(model_store.candidate)[0] == 3
    assert (model_store.current, model_store.candidate, model_store.history) == (3, None, (1,))
    assert model_store.rollback()[0] == 1
    assert (model_store.current, model_store.candidate) == (1, 3), "what was gone back from can be accepted again"
    assert model_store.accept(model_store.candidate)[0] == 3
    assert model_store.rollback()[0] == 1
    with pytest.raises(FileError, match="no earlier model"):
        model_store.rollback()
    assert model_store.put_candidate(model) == 4, "a version is never used twice"


def test_what_cannot_be_read_is_named_with_what_to_do(model_store: ModelStore, model: Model) -> None:
    view = model_store.add_view("cube", picture(1), picture(2), {})
    (view.folder / "left.png").write_bytes(b"\x89PNG cut")
    with pytest.raises(FileError, match=r"left\.png: not an image; `forget` this view"):
        view.images()
    (view.folder / "view.json").write_text("{")
    model_store.put_candidate(model)
    model_store.accept(model_store.candidate)
    model_store.path(1).write_bytes(model_store.path(1).read_bytes()[:-20])
    with pytest.raises(ModelError):
        model_store.load(1)
    (model_store.folder / "models" / "state.json").write_text('{"current": "one"}')
    with pytest.raises(FileError, match=r"state\.json: cannot be read"):
        _ = model_store.current


def test_a_damaged_note_names_itself_and_keeps_nobody_from_the_other_views(model_store: ModelStore) -> None:
    for content in (b"{", b"[" * 100_000, b'{"table": 3}', b'{"facets": [[1]]}', b"\xff"):
        whole, broken = (model_store.add_view(label, picture(1), picture(2), {}) for label in ("cube", "wedge"))
        (broken.folder / "view.json").write_bytes(content)
        assert [view.damage == "" for view in model_store.views()] == [True, False], content
        (told,) = (view.damage for view in model_store.views("wedge"))
        assert told.startswith(f"{broken.folder / 'view.json'}: cannot be read")
        assert told.endswith(f"`forget wedge {broken.number}`")
        assert model_store.labels() == ["cube", "wedge"]
        assert model_store.drop_views("wedge", broken.number) == 1
        assert model_store.drop_views("cube") == 1
        assert whole.damage == ""


def test_who_accepts_while_another_trains_is_not_undone_and_no_two_models_share_a_version(
    model_store: ModelStore, model: Model
) -> None:
    accepted: list[int] = []

    def train(_: int) -> int:
        return model_store.put_candidate(model)

    def accept(_: int) -> None:
        with contextlib.suppress(FileError):
            accepted.append(model_store.accept(model_store.candidate)[0])

    with ThreadPoolExecutor(4) as pool:
        trained = [pool.submit(train, k) for k in range(40)]
        for work in [pool.submit(accept, k) for k in range(40)]:
            work.result()
        versions = [work.result() for work in trained]
    assert sorted(versions) == list(range(1, 41))
    assert [*model_store.history, model_store.current] == sorted(accepted), "every accept is there"


def test_who_was_halted_in_the_middle_is_not_waited_for_for_ever(
    model_store: ModelStore, model: Model, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another process that changes models, and stands still (control-Z): `train` and `accept` never came back."""
    monkeypatch.setattr("daemon.store.model_store.LOCK_WAIT_S", 0.3)
    model_store.put_candidate(model)
    halted = os.open(model_store.folder / "models" / "lock", os.O_RDONLY)
    fcntl.flock(halted, fcntl.LOCK_EX)
    with pytest.raises(FileError, match=r"models: another process is changing it; try again"):
        model_store.accept(model_store.candidate)
    os.close(halted)
    assert model_store.accept(model_store.candidate)[0] == 1


def test_a_number_that_nobody_counted_to_keeps_nobody_from_the_next(model_store: ModelStore, model: Model) -> None:
    """A file of 250 digits, and there was no name for the next version, view or calibration."""
    models, views = model_store.folder / "models", model_store.folder / "views" / "cube"
    for folder in (models, views):
        folder.mkdir(parents=True)
    for odd in ("9" * 250, "999999999", "\u0663"):
        (models / f"{odd}.npz").touch()
        (views / odd).mkdir()
    assert [model_store.put_candidate(model) for _ in range(2)] == [1, 2]
    assert [model_store.add_view("cube", picture(1), picture(2), {}).name for _ in range(2)] == ["cube/1", "cube/2"]
    assert (model_store.versions(), [view.number for view in model_store.views()]) == ([1, 2], [1, 2])


def test_why_a_view_is_not_stored_is_said_whatever_became_of_what_was_begun(
    model_store: ModelStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(path: Path, _: bytes) -> None:
        path.parent.rmdir()
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("daemon.store.model_store.write_atomically", full)
    with pytest.raises(FileError, match="cube: the view is not stored: No space left on device"):
        model_store.add_view("cube", picture(1), picture(2), {})


def test_what_is_accepted_is_what_was_read(model_store: ModelStore, model: Model) -> None:
    model_store.put_candidate(model)
    model_store.path(1).write_bytes(b"damaged")
    with pytest.raises(ModelError):
        model_store.accept(model_store.candidate)
    assert (model_store.current, model_store.candidate) == (None, 1)


@pytest.mark.parametrize("kind", ["file", "link"])
def test_what_lies_among_the_views_and_is_no_folder_can_be_forgotten(
    model_store: ModelStore, tmp_path: Path, kind: str
) -> None:
    """As `views` advises; a link's own end is left alone, and the next view of that number can be forgotten, too."""
    model_store.add_view("cube", picture(1), picture(2), {})
    odd = model_store.folder / "views" / "cube" / "2"
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "own").touch()
    odd.touch() if kind == "file" else odd.symlink_to(tmp_path / "elsewhere")
    assert "`forget cube 2`" in model_store.views("cube")[1].damage
    assert model_store.drop_views("cube", 2) == 1
    assert [view.name for view in model_store.views()] == ["cube/1"]
    model_store.add_view("cube", picture(1), picture(2), {})
    assert model_store.drop_views("cube") == 2
    assert list((model_store.folder / "views").iterdir()) == []
    assert (tmp_path / "elsewhere" / "own").exists()


def test_a_model_is_named_by_its_file_its_number_or_as_the_latest(
    model_store: ModelStore, model: Model, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("STATE_DIRECTORY", str(model_store.folder))
    monkeypatch.chdir(tmp_path)
    for word in ("latest", "1"):
        with pytest.raises(FileError, match=rf"^{word}: no such model in .*models \(stored: none\)$"):
            model_file(Path(word))
    for _ in range(2):
        model_store.put_candidate(model)
    assert model_file(Path("latest")) == model_store.path(2)
    assert model_file(Path("1")) == model_store.path(1)
    for word in ("3", "0"):
        with pytest.raises(FileError, match=rf"^{word}: no such model in .*models \(stored: 1, 2\)$"):
            model_file(Path(word))
    assert model_file(Path("some.npz")) == Path("some.npz")
    (tmp_path / "2").touch()
    assert model_file(Path("2")) == Path("2"), "a file that is there is meant"


@pytest.mark.parametrize("words", [(errno.ENOSPC, "No space left on device"), ("the net is down",)])
def test_why_the_state_is_not_written_is_said_in_the_systems_words_where_it_has_some(
    model_store: ModelStore, model: Model, monkeypatch: pytest.MonkeyPatch, words: tuple[Any, ...]
) -> None:
    def failing(*_: object, **__: object) -> None:
        raise OSError(*words)

    model_store.put_candidate(model)
    for module in ("model_store", "json_file"):
        monkeypatch.setattr(f"daemon.store.{module}.write_atomically", failing)
    with pytest.raises(FileError, match=rf"state\.json: not written: {words[-1]}$"):
        model_store.accept(model_store.candidate)
    with pytest.raises(FileError, match=rf"cube: the view is not stored: {words[-1]}$"):
        model_store.add_view("cube", picture(1), picture(2), {})
    monkeypatch.undo()
    model_store.add_view("cube", picture(1), picture(2), {})
    monkeypatch.setattr("daemon.store.model_store.shutil.rmtree", failing)
    with pytest.raises(FileError, match=rf"cube: not removed: {words[-1]}$"):
        model_store.drop_views("cube")
