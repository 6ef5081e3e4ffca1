"""What the journal and the operator are told of a run, in sentences that say each thing once."""

import pytest

from daemon.upkeep import journal


class Nowhere:
    """A run log that keeps nothing."""

    def record(self, kind: str, /, **fields: object) -> None:
        """Nothing is kept."""


@pytest.mark.parametrize(
    ("kind", "fields", "sentence"),
    [
        ("fault", {"code": "stopped by ann", "text": "stopped by ann"}, "FAULT stopped by ann"),
        ("fault", {"code": "CameraError", "text": "CameraError: no pair"}, "FAULT CameraError: no pair"),
        ("fault", {"code": "at work", "text": "it was stopped"}, "FAULT at work: it was stopped"),
        ("cycle_end", {"cycle": 2, "outcome": "fault", "label": None, "why": "no pair"}, "cycle 2: fault: no pair"),
        ("cycle_end", {"cycle": 3, "outcome": "picked", "label": "cube", "why": ""}, "cycle 3: picked cube"),
        ("cycle_start", {"cycle": 4, "target": None}, "cycle 4: looking for any part"),
    ],
)
def test_the_journal_says_each_thing_once(
    monkeypatch: pytest.MonkeyPatch, kind: str, fields: dict[str, object], sentence: str
) -> None:
    told: list[tuple[str, str]] = []
    monkeypatch.setattr(journal, "tell", lambda kind, text, priority, **more: told.append((kind, text)))
    noticed: list[str] = []
    journal.JournalledLog(Nowhere(), noticed.append).record(kind, **fields)
    assert told == [(kind, sentence)]
    assert noticed == ([sentence] if kind == "fault" else [])
