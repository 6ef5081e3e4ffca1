"""The page of a run: safe from its texts, small enough, true about its ledger."""

from __future__ import annotations

import base64
import gzip
import json
import os
import re
import shutil
from pathlib import Path
from typing import Any

import pytest

from daemon.review.page import read_digest, render, write_page
from daemon.review.week import write_week
from daemon.store.runs import RunError
from tests.fakes.made_run import MadeRun


def test_a_run_without_a_cycle_makes_a_page(made: MadeRun) -> None:
    page = write_page(made.close(), made.folder / "page.html")
    assert "20260102T030405Z" in page.read_text()


def test_an_earlier_run_that_cannot_be_read_spoils_no_page_of_another(tmp_path: Path) -> None:
    """The disk does not give it, or the quota has just removed it: no page of its week could be made."""
    runs = tmp_path / "runs"
    for day in (1, 3):
        made = MadeRun(runs / f"2026010{day}T000000Z", pictures=False)
        made.pick()
        folder = made.close()
    (runs / "20260102T000000Z").mkdir()
    (runs / "20260102T000000Z" / "run.jsonl").symlink_to(runs / "20260101T000000Z" / "run.jsonl")
    before = data_of(write_page(folder, tmp_path / "page.html").read_text())["before"]
    assert before["week"]["tried"] == 1
    assert data_of(write_week(runs, folder, tmp_path / "week.html").read_text())["production"]["tried"] == 2


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


def data_of(page: str) -> Any:
    return json.loads(page.split('id="data">')[1].split("</script>")[0].replace("<\\/", "</"))


def details_of(data: Any) -> Any:
    return json.loads(gzip.decompress(base64.b64decode(data["details"])))


def pictures_of(page: str) -> dict[str, str]:
    found: dict[str, str] = json.loads(page.split('id="pictures">')[1].split("</script>")[0])
    return found


def test_a_run_that_is_being_written_is_still_going_and_one_that_was_killed_is_not(made: MadeRun) -> None:
    made.pick()
    made.write("cycle_start", cycle=2, target=None)
    made.log.settle()
    data = data_of(write_page(made.folder, made.folder / "page.html").read_text())
    assert data["going"]
    assert data["cycles"][1]["outcome"] == "going on"
    assert data["cycles"][1]["causes"] == []
    assert data["production"]["tried"] == 1
    os.close(made.log._run.lines._handle)  # what kill -9 does
    made.log._run.lines._handle = -1
    data = data_of(write_page(made.folder, made.folder / "page.html").read_text())
    assert not data["going"]
    assert data["cycles"][1]["causes"][0]["name"] == "interrupted by a crash or power cut"


def test_all_models_in_use_are_named_with_their_versions(made: MadeRun) -> None:
    for version in (3, 4):
        made.write("model", action="accepted", version=version, labels=[], file=f"kept/{version}aaaaaaaabb.npz")
    data = data_of(write_page(made.close(), made.folder / "page.html").read_text())
    assert data["models"] == ["version 3 (3aaaaaaa)", "version 4 (4aaaaaaa)"]


def test_a_fault_is_told_once(made: MadeRun) -> None:
    for _ in range(2):
        made.write("fault", cycle=1, code="CameraError", text="CameraError: gone", **{"while": "pick"})
    data = data_of(write_page(made.close(), made.folder / "page.html").read_text())
    assert [e["text"] for e in data["events"] if e["kind"] == "fault"] == ["fault: gone"]


def test_what_one_more_look_brought_is_on_the_page(made: MadeRun) -> None:
    made.write(
        "gained", cycle=1, look=2, about="what lies at 520, 10", before="cube 84 %, pyramid 16 %", after="cube 99.9 %"
    )
    data = data_of(write_page(made.close(), made.folder / "page.html").read_text())
    told = "look 2 at what lies at 520, 10. Before: cube 84 %, pyramid 16 %. Now: cube 99.9 %"
    assert [e["text"] for e in data["events"] if e["kind"] == "gained"] == [told]


def test_texts_of_a_run_cannot_break_out_of_the_page(made: MadeRun) -> None:
    made.pick("missed", why="</script><script>alert(1)</script>")
    text = write_page(made.close(), made.folder / "page.html").read_text()
    assert "</script><script>alert(1)" not in text


def test_pictures_of_failures_come_first_when_not_all_fit(made: MadeRun, monkeypatch: pytest.MonkeyPatch) -> None:
    for k in range(6):
        made.pick("missed" if k == 2 else "picked")
    folder = made.close()
    whole = data_of(write_page(folder, made.folder.parent / "page.html").read_text())
    assert whole["pictures_left_out"] == 0
    monkeypatch.setattr("daemon.review.page.PAGE_BYTES", len(json.dumps(whole)) + 2500)
    text = write_page(folder, made.folder.parent / "page.html").read_text()
    pictures = pictures_of(text)
    failed = read_digest(made.folder).cycles[2].stops[0].look["seq"]
    assert f"{failed}-left" in pictures
    assert data_of(text)["pictures_left_out"] == 36 - len(pictures) > 0
    beside = pictures_of(write_page(folder, folder / "page.html").read_text())
    assert len(beside) == 36
    linked = {picture for picture in beside.values() if not picture.startswith("data:")}
    assert all((folder / name).is_file() for name in linked), "a page in the run's folder shows the files"
    assert len(linked) >= 36 - len(pictures)


def test_details_of_failures_come_first_when_not_all_fit(made: MadeRun, monkeypatch: pytest.MonkeyPatch) -> None:
    for k in range(6):
        made.pick("missed" if k == 2 else "picked")
    folder = made.close()
    data = data_of(write_page(folder, folder / "page.html").read_text())
    one = len(json.dumps(details_of(data)["cycles"]["1"], separators=(",", ":")))
    assert (sorted(details_of(data)["cycles"]), data["details_left_out"]) == (list("123456"), 0)
    monkeypatch.setattr("daemon.review.page.DETAIL_BYTES", int(2.5 * one))
    data = data_of(write_page(folder, folder / "page.html").read_text())
    assert sorted(details_of(data)["cycles"]) == ["3", "6"], "the failure, then the newest"
    assert data["details_left_out"] == 4
    assert [len(row["mms"]) for row in data["cycles"]] == [2] * 6, "figures are of all"


def test_a_file_outside_of_the_run_that_its_records_name_as_an_image_is_not_linked(
    made: MadeRun, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("daemon.review.page.PAGE_BYTES", 0)
    made.pick()
    made.write("look", purpose="console", images={"left": "http://elsewhere/x.png", "right": "../../../etc/hostname"})
    text = write_page(made.close(), made.folder / "page.html").read_text()
    assert "elsewhere" not in text
    assert "hostname" not in text


def test_a_page_is_called_by_its_run_or_its_title_or_nothing() -> None:
    def title(**data: object) -> str:
        return render("page", data, {}).split("<title>")[1].split("</title>")[0]

    assert title(run="a<b") == "run a&lt;b"
    assert title(title="The hall & all") == "The hall &amp; all"
    assert title() == title(run=None, title=None) == ""


def test_a_run_is_shown_beside_the_last_one_and_those_of_the_week_before_it(tmp_path: Path) -> None:
    """The last, when it is older than a week, is no run of that week."""
    for name, outcomes in (
        ("20260102T030405Z", ("picked",)),
        ("20260113T030405Z", ("picked", "missed")),
        ("20260118T030405Z", ("picked", "picked", "missed")),
    ):
        made = MadeRun(tmp_path / name, pictures=False)
        for outcome in outcomes:
            made.pick(outcome)
        made.close()
    folders = sorted(tmp_path.iterdir())
    data = [data_of(write_page(folder, tmp_path / "page.html").read_text()) for folder in folders]
    befores = [of_one["before"] for of_one in data]
    assert befores[0] == {"last": None, "week": None}
    assert (befores[1]["last"]["run"], befores[1]["last"]["tried"], befores[1]["week"]) == (folders[0].name, 1, None)
    assert (befores[2]["last"]["run"], befores[2]["last"]["tried"]) == (folders[1].name, 2)
    assert befores[2]["week"]["tried"] == 2


def test_pictures_of_picks_that_went_well_are_on_the_page_where_there_is_room(made: MadeRun, tmp_path: Path) -> None:
    made.pick()
    made.pick("missed")
    folder = made.close()
    page = write_page(folder, tmp_path / "page.html").read_text()
    shown = set(re.findall(r'"(\d+)-left":"data:image/jpeg', page))
    assert shown == {str(look["seq"]) for look in read_digest(folder).of("look")}


def test_of_very_many_cycles_the_newest_are_shown_and_the_others_are_told(
    made: MadeRun, monkeypatch: pytest.MonkeyPatch
) -> None:
    """10,000 made a page of 102 MB."""
    for _ in range(4):
        made.pick()
    monkeypatch.setattr("daemon.review.pagedata.MAX_CYCLES", 3)
    page = write_page(made.close(), made.folder / "page.html").read_text()
    data = data_of(page)
    assert [cycle["n"] for cycle in data["cycles"]] == [bar["n"] for bar in data["timeline"]] == [2, 3, 4]
    assert (data["cycles_left_out"], data["production"]["tried"]) == (1, 4)
    assert "not in this page: facetctl export --csv" in page


def test_a_run_that_is_removed_while_its_page_is_made_is_not_made_anew(
    made: MadeRun, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A folder of a page alone, which no quota counts."""
    made.pick()
    folder = made.close()

    def removed(*_: object) -> str:
        shutil.rmtree(folder)
        return "page"

    monkeypatch.setattr("daemon.review.page.render", removed)
    with pytest.raises(RunError, match="was removed while its page was made"):
        write_page(folder, folder / "report.html")
    assert not folder.exists()
