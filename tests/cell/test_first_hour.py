"""The operator's first hour, typed line by line at a daemon on a simulated cell: every line works."""

from __future__ import annotations

import re
from collections.abc import Iterator

import pytest

from daemon.store import folders
from tests.fakes.running import Running, judged_daemon

pytestmark = pytest.mark.long


@pytest.fixture
def daemon() -> Iterator[Running]:
    with judged_daemon(seed=7, time_scale=40.0) as daemon:
        yield daemon


def lines() -> list[str]:
    hour = (folders.HOUSE / "docs" / "operate" / "first-hour.md").read_text(encoding="utf-8")
    return [line.partition("  #")[0].strip() for line in re.findall(r"^ *facetd> (.*)", hour, re.MULTILINE)]


@pytest.mark.timeout(300)
def test_every_line_of_the_first_hour_does_what_it_is_there_for(
    daemon: Running, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folders.HOUSE)
    said: dict[str, str] = {}
    for line in lines():
        done = daemon.do(line, answer="y")
        said[line] = done["text"]
        assert done["status"] == 0, f"{line}: {done['text']}"
    assert said["pick bracket"].startswith("picked: bracket")
    assert said["auto wait"].endswith("2 parts picked; that is as many as requested.")
    assert len(said) >= 15
