"""What a run's records come to: cycles, causes, a page, tables; also of runs that were cut short."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest

from daemon import ctl
from daemon.review.digest import digest
from daemon.review.page import read_digest, write_page
from daemon.review.pagedata import page_data
from daemon.review.replay import compare
from daemon.review.why import causes
from daemon.store.runs import read_run
from tests.worlds.made_run import MadeRun, part


@pytest.fixture
def made(tmp_path: Path) -> MadeRun:
    return MadeRun(tmp_path / "runs" / "20260102T030405Z")


def test_a_run_is_sorted_into_cycles_and_stops(made: MadeRun) -> None:
    made.pick()
    made.pick("missed", why="the cube lies where it lay")
    run = read_digest(made.close())
    assert [c.outcome for c in run.cycles] == ["picked", "missed"]
    assert [s.purpose for s in run.cycles[0].stops] == ["survey 1", "approach", "approach"]
    assert run.cycles[0].looks == 2
    figures = run.statistics()
    assert (figures["cycles"], figures["picked"], figures["missed"]) == (2, 1, 1)
    assert figures["predicted_mm"] == 0.7
    assert figures["ended"]


def test_a_run_without_a_cycle_makes_a_page(made: MadeRun) -> None:
    page = write_page(made.close(), made.folder / "page.html")
    assert "20260102T030405Z" in page.read_text()


def test_the_likeliest_cause_of_a_miss_comes_first(made: MadeRun) -> None:
    made.pick("missed", chi2=80.0)
    found = causes(read_digest(made.close()).cycles[0])
    assert found[0].stage == "estimate"
    assert "chi-square 80" in found[0].evidence
    assert {c.stage for c in found} >= {"estimate", "grasp"}


def test_a_refused_move_and_a_fault_are_named_with_what_led_to_them(made: MadeRun) -> None:
    made.cycle = 1
    made.write("cycle_start", cycle=1, target="cube")
    made.write("move", cycle=1, how="joint", purpose="stand-off 300 mm", target=None, speed_pct=50.0)
    made.write("refusal", cycle=1, rule="below_table", text="the tool would be 3 mm above the table")
    made.write("fault", cycle=1, code="link", text="no answer within 5 s")
    made.write("cycle_end", cycle=1, outcome="fault", label="cube", why="no answer", stops=0, predicted=None)
    run = read_digest(made.close())
    assert [c.stage for c in causes(run.cycles[0])[:2]] == ["arm", "guard"]
    events = [e for e in page_data(run)["events"] if e["kind"] == "refusal"]
    assert events[0]["after"].endswith("stand-off 300 mm")
    assert events[0]["cycle"] == 1


def test_an_ambiguous_part_is_told_with_its_candidates(made: MadeRun) -> None:
    made.cycle = 1
    made.write("cycle_start", cycle=1, target=None)
    made.look("survey 1", part("unknown", ambiguous=True, candidates=["cube", "pyramid"], reason="one square"))
    made.write("cycle_end", cycle=1, outcome="ambiguous", label=None, why="could be two", stops=0, predicted=None)
    found = causes(read_digest(made.close()).cycles[0])
    assert any("cube or pyramid" in c.evidence for c in found)


def test_a_picked_part_and_an_empty_table_need_no_cause(made: MadeRun) -> None:
    made.pick()
    made.pick("empty", why="nothing on the table")
    assert [causes(c) for c in read_digest(made.close()).cycles] == [[], []]


def test_a_log_cut_at_any_byte_of_its_last_record_still_reviews(made: MadeRun, tmp_path: Path) -> None:
    made.pick()
    whole = (made.close() / "run.jsonl").read_bytes()
    last = whole.rstrip(b"\n").rfind(b"\n") + 1
    cut = tmp_path / "cut"
    cut.mkdir()
    for end in range(last, len(whole) + 1):
        (cut / "run.jsonl").write_bytes(whole[:end])
        found = read_run(cut)
        data = page_data(digest("cut", found.records, found.skipped))
        assert data["stats"]["picked"] == 1
        whole_again = end >= len(whole) - 1
        torn = last < end < len(whole) - 1
        assert bool(data["skipped"]) == torn
        assert data["stats"]["ended"] == whole_again


def test_every_prefix_of_a_run_makes_a_digest(made: MadeRun) -> None:
    made.pick("missed")
    made.pick()
    records = read_run(made.close()).records
    for count in range(len(records) + 1):
        data = page_data(digest("prefix", records[:count]))
        assert len(data["cycles"]) <= 2
    assert page_data(digest("prefix", records[:-2]))["cycles"][-1]["outcome"] == "unfinished"


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


def test_runs_are_tabled_and_laid_side_by_side(
    made: MadeRun, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made.pick()
    made.close()
    other = MadeRun(tmp_path / "runs" / "20260103T030405Z")
    other.pick("missed")
    other.close()
    runs = ["--runs", str(tmp_path / "runs")]
    assert ctl.main(["runs", *runs]) == 0
    table = capsys.readouterr().out.splitlines()
    assert [line.split()[:4] for line in table[1:]] == [
        ["20260102T030405Z", "1", "1", "0"],
        ["20260103T030405Z", "1", "0", "1"],
    ]
    page = tmp_path / "page.html"
    assert ctl.main(["review", *runs, "--out", str(page), "--against", "20260102T030405Z"]) == 0
    data = json.loads(page.read_text().split('id="data">')[1].split("</script>")[0].replace("<\\/", "</"))
    assert data["against"]["stats"]["picked"] == 1
    assert [d["same"] for d in data["against"]["differences"]] == [True, True, False]


def test_an_unknown_run_is_one_line_and_status_2(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for command in ("review", "replay", "tail"):
        assert ctl.main([command, "--runs", str(tmp_path), "nosuch"]) == 2
        said = capsys.readouterr().err
        assert said.count("\n") == 1
        assert "nosuch: no such run" in said


def test_tail_tells_a_run_line_by_line(made: MadeRun, capsys: pytest.CaptureFixture[str]) -> None:
    made.pick()
    made.close()
    assert ctl.main(["tail", "--runs", str(made.folder.parent)]) == 0
    told = capsys.readouterr().out
    assert "approach: cube 0.98" in told
    assert "picked: gone from where it lay" in told
    assert "\x1b[" not in told


def test_csv_tables_have_a_row_a_cycle_and_a_row_a_look(made: MadeRun, tmp_path: Path) -> None:
    made.pick()
    made.pick("missed")
    made.close()
    runs = ["--runs", str(made.folder.parent)]
    assert ctl.main(["export", *runs, "--csv", "--out", str(tmp_path / "csv"), "--cell", "7"]) == 0
    with (tmp_path / "csv" / "cycles.csv").open() as file:
        cycles = list(csv.DictReader(file))
    assert [(c["cell"], c["outcome"]) for c in cycles] == [("7", "picked"), ("7", "missed")]
    with (tmp_path / "csv" / "looks.csv").open() as file:
        assert len(list(csv.DictReader(file))) == 6


def scene(*parts: dict[str, object]) -> dict[str, object]:
    return {"parts": list(parts)}


def test_replay_tells_what_changed_and_what_of_it_is_worse() -> None:
    then = scene(part("cube"))
    assert compare(then, scene(part("cube"))) == []
    assert compare(then, scene())[0][2]
    lost_name = compare(then, scene(part("unknown", reason="one facet")))
    assert lost_name == [("cube", "now unknown: one facet", True)]
    gained = compare(scene(part("unknown")), scene(part("cube")))
    assert gained == [("unknown", "now cube: 3 facets fit to 0.10 mm rms", False)]


def test_replay_takes_a_pose_within_three_sigma_for_the_same_and_one_beyond_for_worse() -> None:
    def shifted(mm: float) -> dict[str, object]:
        pose = [[1.0, 0, 0, mm], [0, 1.0, 0, 0], [0, 0, 1.0, 0], [0, 0, 0, 1.0]]
        return part("cube", cyclopean_from_part=pose)

    assert compare(scene(part("cube")), scene(shifted(0.29))) == []
    assert compare(scene(part("cube")), scene(shifted(0.35)))[0][2]
