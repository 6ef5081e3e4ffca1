"""The page of a run: safe from its texts, small enough, true about its ledger."""

from __future__ import annotations

import json

import pytest

from daemon.review.page import read_digest, write_page
from tests.worlds.made_run import MadeRun


def test_a_run_without_a_cycle_makes_a_page(made: MadeRun) -> None:
    page = write_page(made.close(), made.folder / "page.html")
    assert "20260102T030405Z" in page.read_text()


def test_a_wire_ledger_that_was_altered_is_said_on_the_page(made: MadeRun) -> None:
    for n in range(6):
        made.log.wire({"seq": n, "bytes": "WHERE"})
    made.pick()
    folder = made.close()
    assert "wire.jsonl" not in write_page(folder, folder / "page.html").read_text()
    wire = folder / "wire.jsonl"
    lines = wire.read_bytes().splitlines(keepends=True)
    wire.write_bytes(b"".join(lines[:2] + lines[4:]))
    assert "wire.jsonl:3: 2 entries are missing before it" in write_page(folder, folder / "page.html").read_text()


def test_texts_of_a_run_cannot_break_out_of_the_page(made: MadeRun) -> None:
    made.pick("missed", why="</script><script>alert(1)</script>")
    text = write_page(made.close(), made.folder / "page.html").read_text()
    assert "</script><script>alert(1)" not in text


def test_pictures_of_failures_come_first_when_not_all_fit(made: MadeRun, monkeypatch: pytest.MonkeyPatch) -> None:
    for k in range(6):
        made.pick("missed" if k == 2 else "picked")
    monkeypatch.setattr("daemon.review.page.PICTURE_BUDGET", 1500)
    text = write_page(made.close(), made.folder / "page.html").read_text()
    pictures = json.loads(text.split('id="pictures">')[1].split("</script>")[0])
    failed = read_digest(made.folder).cycles[2].stops[0].look["seq"]
    assert f"{failed}-left" in pictures
    data = json.loads(text.split('id="data">')[1].split("</script>")[0].replace("<\\/", "</"))
    assert data["pictures_left_out"] > 0
