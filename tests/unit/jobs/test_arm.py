"""`facetctl arm replay`, from the command line: a transcript as it was sent, and what is none."""

from __future__ import annotations

from pathlib import Path

import pytest

from daemon import ctl
from daemon.store import places

TRANSCRIPT = places.HOUSE / "tests" / "data" / "introductions" / "two-dots-whole-words.jsonl"


def test_a_transcript_that_was_cut_off_in_its_last_line_is_replayed_as_far_as_it_goes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = TRANSCRIPT.read_text()
    (tmp_path / "sent.jsonl").write_text(whole + whole.splitlines()[-1][:9])
    assert ctl.main(["arm", "replay", str(tmp_path / "sent.jsonl")]) == 0
    said = capsys.readouterr().out
    assert "lost its end" in said
    assert "word for word" in said


@pytest.mark.parametrize(
    ("sent", "told"),
    [("/dev/zero", "not a regular file"), ("none.jsonl", "No such file"), (str(places.HOUSE / "LICENSE"), "line 1")],
)
def test_what_is_no_transcript_is_told_in_one_line(sent: str, told: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert ctl.main(["arm", "replay", sent]) == 2
    said = capsys.readouterr().err
    assert told in said
    assert said.count("\n") == 1
