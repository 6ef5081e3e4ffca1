"""Parts set down at places, as a run's page and a week's show them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from daemon.review.page import read_digest, write_page
from daemon.review.set_downs import last_of_each, placing_figures, set_downs
from daemon.review.week import week_data
from tests.chromium import ready
from tests.fakes.made_run import MadeRun, part

OUTLINE = [[0.0, 0.0], [50.0, 0.0], [50.0, 50.0], [0.0, 50.0]]


def brought(made: MadeRun, place: str, status: str | None, **off: float) -> None:
    """A cycle that sets a cube down; status None: killed before the look at the place."""
    made.cycle += 1
    of_place: dict[str, Any] = {"cycle": made.cycle, "place": place, "label": "cube", "outline": OUTLINE}
    of_place |= {"tolerance_mm": 1.0, "tolerance_deg": 1.0}
    made.write("cycle_start", cycle=made.cycle)
    made.look("survey 1", part("cube"))
    made.look("verify", part("cube"))
    made.write("place", **of_place, status="claimed")
    made.write("place", **of_place, status="set")
    if status is None:
        return
    made.look(f"place {place}", part("cube"))
    made.write("place", **of_place, status=status, why="as it was seen", **off)
    made.write("cycle_end", cycle=made.cycle, outcome="picked", label="cube", why="")


@pytest.fixture
def made(tmp_path: Path) -> MadeRun:
    run = MadeRun(tmp_path / "runs" / "20260102T060000Z", limits={"grasp_mm": 1.0})
    brought(run, "tray.1", "seen right", off_mm=0.2, off_deg=0.1)
    brought(run, "tray.2", "off", off_mm=1.8, off_deg=0.3)
    brought(run, "nest", "missing")
    brought(run, "tray.10", None)
    return run


def test_each_set_down_has_the_looks_before_and_after_it_and_what_they_found(made: MadeRun) -> None:
    run = read_digest(made.close())
    found = set_downs(run)
    assert [(each.place, each.status) for each in found] == [
        ("tray.1", "seen right"), ("tray.2", "off"), ("nest", "missing"), ("tray.10", "set"),
    ]  # fmt: skip
    purposes = {stop.seq: stop.purpose for stop in run.stops}
    assert [purposes[each.before] for each in found if each.before is not None] == ["verify"] * 4
    assert [each.after and purposes[each.after] for each in found] == [
        "place tray.1",
        "place tray.2",
        "place nest",
        None,
    ]
    assert (found[1].off_mm, found[1].tolerance_mm, found[1].why) == (1.8, 1.0, "as it was seen")


def test_figures_are_by_part_and_place_with_those_of_a_pattern_first(made: MadeRun) -> None:
    rows = placing_figures(set_downs(read_digest(made.close())))
    assert [(row["place"], row["looked_at"], row["right"]) for row in rows] == [
        ("nest", 1, 0), ("tray", 2, 1), ("tray.1", 1, 1), ("tray.2", 1, 0),
    ]  # fmt: skip
    tray = rows[1]
    assert (tray["median_mm"], tray["p95_mm"]) == pytest.approx((1.0, 1.72))
    assert (tray["median_deg"], tray["p95_deg"]) == pytest.approx((0.2, 0.29))
    assert rows[0]["median_mm"] is None, "none was seen"


def test_the_last_status_of_each_place_counts_also_one_that_no_cycle_wrote(made: MadeRun) -> None:
    made.write("place", place="tray.2", label="cube", status="emptied by hand", why="by ann", outline=OUTLINE)
    last = {each["name"]: each for each in last_of_each(read_digest(made.close()))}
    assert {name: each["status"] for name, each in last.items()} == {
        "tray.1": "seen right", "tray.2": "emptied by hand", "nest": "missing", "tray.10": "set",
    }  # fmt: skip
    assert last["tray.2"]["outline"] == OUTLINE


def test_a_run_without_places_shows_none(tmp_path: Path) -> None:
    made = MadeRun(tmp_path / "runs" / "20260102T060000Z")
    made.pick()
    run = read_digest(made.close())
    assert (set_downs(run), last_of_each(run), week_data([run], ["x"])["placing"]) == ([], [], [])


def test_a_week_counts_the_set_downs_of_all_its_runs(made: MadeRun, tmp_path: Path) -> None:
    other = MadeRun(tmp_path / "runs" / "20260103T060000Z")
    brought(other, "nest", "seen right", off_mm=0.4, off_deg=0.1)
    runs = [read_digest(each.close()) for each in (made, other)]
    nest = next(row for row in week_data(runs, ["a", "b"])["placing"] if row["place"] == "nest")
    assert (nest["looked_at"], nest["right"], nest["median_mm"]) == (2, 1, pytest.approx(0.4))


def test_places_are_drawn_on_the_page_and_fit_a_phone(browser: Any, made: MadeRun, tmp_path: Path) -> None:
    out = write_page(made.close(), tmp_path / "page.html")
    for width in (1400, 400):
        browser.set_window_size(width, 1000)
        browser.get(f"file://{out}")
        ready(browser)
        drawn = browser.find_elements("css selector", "#places g.place")
        assert [each.get_attribute("class") for each in drawn] == [
            "place right", "place wrong", "place wrong", "place unsure",
        ]  # fmt: skip
        cards = browser.find_elements("css selector", ".set-down")
        assert [len(card.find_elements("css selector", "img")) for card in cards] == [1, 2, 2, 2], "newest first"
        assert "1.8 of 1 mm" in cards[2].text
        assert browser.execute_script("return document.documentElement.scrollWidth <= window.innerWidth")
        assert "1 of 2" in browser.find_element("css selector", "table.placing").text
