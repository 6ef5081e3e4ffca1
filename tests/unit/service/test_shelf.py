"""Views and models on disk: whole or not there, in versions, with a way back."""

from __future__ import annotations

import errno
from pathlib import Path

import numpy as np
import pytest

from daemon.store.library import load_facets
from daemon.store.model import ModelError
from daemon.store.shelf import Shelf, ShelfError
from daemon.vision.model import Model, empty_model


def picture(value: int) -> np.ndarray:
    return np.full((48, 64), value, np.uint8)


@pytest.fixture
def shelf(tmp_path: Path) -> Shelf:
    return Shelf(tmp_path)


@pytest.fixture
def model() -> Model:
    return empty_model(load_facets())


def test_a_view_comes_back_as_it_was_put_there(shelf: Shelf) -> None:
    view = shelf.add_view("cube", picture(1), picture(2), {"who": "anna"})
    (found,) = shelf.views()
    assert (found.name, found.note["who"], found.note["label"]) == ("cube/1", "anna", "cube")
    left, right = found.images()
    assert (left[0, 0], right[0, 0]) == (1, 2)
    assert view == found


def test_numbers_go_on_and_removed_views_leave_nothing_behind(shelf: Shelf) -> None:
    for _ in range(11):
        shelf.add_view("cube", picture(1), picture(2), {})
    assert [view.number for view in shelf.views("cube")] == list(range(1, 12))
    assert shelf.drop_views("cube", 4) == 1
    assert shelf.drop_views("cube", 4) == 0
    assert shelf.add_view("cube", picture(1), picture(2), {}).number == 12
    assert shelf.drop_views("cube") == 11
    assert shelf.labels() == []
    assert list((shelf.folder / "views").iterdir()) == []


def test_a_disk_that_fills_up_in_the_middle_leaves_no_half_view(shelf: Shelf, monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []

    def fail_on_the_second(path: Path, content: bytes) -> None:
        calls.append(path)
        if len(calls) == 2:
            raise OSError(errno.ENOSPC, "No space left on device")
        path.write_bytes(content)

    monkeypatch.setattr("daemon.store.shelf.write_atomically", fail_on_the_second)
    with pytest.raises(ShelfError, match="the view is not stored: No space left on device"):
        shelf.add_view("cube", picture(1), picture(2), {})
    assert shelf.views() == []
    assert list((shelf.folder / "views" / "cube").iterdir()) == []


def test_a_candidate_is_not_in_use_until_accepted_and_rollback_goes_back(shelf: Shelf, model: Model) -> None:
    assert (shelf.current, shelf.candidate) == (None, None)
    with pytest.raises(ShelfError, match="no candidate"):
        shelf.accept()
    assert shelf.put_candidate(model) == 1
    assert (shelf.current, shelf.candidate) == (None, 1)
    assert shelf.accept() == 1
    assert shelf.put_candidate(model) == 2
    assert shelf.put_candidate(model) == 3
    assert shelf.accept() == 3
    assert (shelf.current, shelf.candidate, shelf.history) == (3, None, (1,))
    assert shelf.rollback() == 1
    assert (shelf.current, shelf.candidate) == (1, 3), "what was gone back from can be accepted again"
    assert shelf.accept() == 3
    assert shelf.rollback() == 1
    with pytest.raises(ShelfError, match="no earlier model"):
        shelf.rollback()
    assert shelf.put_candidate(model) == 4, "a version is never used twice"


def test_what_cannot_be_read_is_named_with_what_to_do(shelf: Shelf, model: Model) -> None:
    view = shelf.add_view("cube", picture(1), picture(2), {})
    (view.folder / "left.png").write_bytes(b"\x89PNG cut")
    with pytest.raises(ShelfError, match=r"left\.png: not an image; `forget` this view"):
        view.images()
    (view.folder / "view.json").write_text("{")
    with pytest.raises(ShelfError, match=r"view\.json: cannot be read"):
        shelf.views()
    shelf.put_candidate(model)
    shelf.accept()
    shelf.path(1).write_bytes(shelf.path(1).read_bytes()[:-20])
    with pytest.raises(ModelError):
        shelf.load(1)
    (shelf.folder / "models" / "state.json").write_text('{"current": "one"}')
    with pytest.raises(ShelfError, match=r"state\.json: cannot be read"):
        _ = shelf.current
