"""How much an idle daemon writes: an SD card is worn by it, day and night."""

from __future__ import annotations

import json
from collections.abc import Iterator
from itertools import pairwise

import pytest

from tests.fakes.whole_daemon import Story

HOUR_S = 3600.0
MOST_BYTES, MOST_SYNCS = 500_000, 400
"""Of an idle hour: what its files may grow by, and how often the disk may be written to (each time a page of them and
the file system's journal)."""


@pytest.fixture
def story() -> Iterator[Story]:
    story = Story()
    yield story
    assert story.close() == ()


def size(story: Story) -> int:
    return sum(file.stat().st_size for file in (story.folder / "state").rglob("*") if file.is_file())


def test_an_idle_hour_wears_no_card(story: Story) -> None:
    story.wait(20.0)
    before, began_s = size(story), story.now_s
    story.wait(HOUR_S)
    (wire,) = (story.folder / "state").rglob("wire.jsonl")
    times_s = [at_s for line in wire.read_text().splitlines() if (at_s := json.loads(line)["t_s"]) > began_s]
    syncs = 1 + sum(later - earlier > 1.0 for earlier, later in pairwise(times_s))  # log.sync_s
    assert 1000 < size(story) - before < MOST_BYTES
    assert 100 < syncs < MOST_SYNCS
