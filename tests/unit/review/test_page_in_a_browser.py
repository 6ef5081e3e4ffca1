"""The page as a person uses it: opened from the disk in a browser, filtered, a cycle opened, the next stop."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daemon.review.page import write_page
from daemon.vision.report import scene_json
from daemon.vision.values import FacetView, NearestGuess, Scene
from tests.chromium import ready
from tests.fakes.made_run import MadeRun, long_run, part
from tests.fakes.waiting import until


def rows(browser: Any) -> list[Any]:
    return browser.find_elements("css selector", "#table tbody tr")


def open_page(browser: Any, page: Path) -> None:
    browser.get(page.as_uri())
    ready(browser)


@pytest.fixture
def page(tmp_path: Path) -> Path:
    made = MadeRun(tmp_path / "20260102T030405Z")
    made.pick()
    made.pick("missed", label="pyramid", why="the pyramid lies where it lay", chi2=60.0)
    made.pick(label="pentagonal_prism")
    return write_page(made.close(), tmp_path / "page.html")


def test_a_person_filters_opens_a_cycle_and_goes_to_the_next_stop(browser: Any, page: Path) -> None:
    open_page(browser, page)
    assert len(rows(browser)) == 3
    browser.find_element("css selector", "button[data-outcome=missed]").click()
    (row,) = rows(browser)
    assert "pyramid" in row.text
    row.click()
    cycle = browser.find_element("id", "cycle")
    assert "disagrees with those before" in cycle.text
    assert cycle.text.index("hand-eye") < cycle.text.index("(perhaps)")
    assert "null" not in cycle.text
    before = cycle.find_element("css selector", "button[aria-pressed=true]").text
    browser.find_element("id", "next").click()
    assert cycle.find_element("css selector", "button[aria-pressed=true]").text != before
    assert len(cycle.find_elements("css selector", ".camera img")) == 2
    assert len(cycle.find_elements("css selector", ".camera polygon.facet")) == 2
    browser.find_element("css selector", "button[data-outcome=all]").click()
    browser.find_element("id", "search").send_keys("pentagonal picked")
    assert len(rows(browser)) == 1
    assert browser.get_log("browser") == []


def test_events_are_filtered_by_their_kind_and_lead_to_their_cycle(browser: Any, tmp_path: Path) -> None:
    made = MadeRun(tmp_path / "20260102T030405Z", pictures=False)
    made.write("note", who="ann", text="lamp replaced")
    made.write("cycle_start", cycle=1, target=None)
    made.write("fault", cycle=1, code="camera_lost", text="left camera is gone")
    made.write("cycle_end", cycle=1, outcome="fault", code="camera_lost", why="left camera is gone")
    made.write("command", who="bob", door="console", text="resume")
    made.write("state", cycle=1, event="resume", to="idle", **{"from": "fault"})
    open_page(browser, write_page(made.close(), tmp_path / "page.html"))
    told = [row.text for row in browser.find_elements("css selector", "#event-table tbody tr")]
    assert len(told) == 3
    assert "lamp replaced (ann)" in told[0]
    assert "bob, after 0.3 s" in told[1]
    browser.find_element("xpath", "//div[@id='event-filters']/button[text()='fault 1']").click()
    (row,) = browser.find_elements("css selector", "#event-table tbody tr")
    row.find_element("tag name", "a").click()
    assert "Cycle 1" in browser.find_element("id", "cycle").text
    assert browser.get_log("browser") == []


def test_what_an_unnamed_part_came_nearest_to_is_drawn_into_both_cameras(browser: Any, tmp_path: Path) -> None:
    edges = np.array([[[10.0, 20], [60, 20]], [[60, 20], [60, 70]]])
    shows = np.array([True, False])
    guess = NearestGuess("cube", edges, edges + np.array([5.0, 0]), shows, shows)
    (told,) = scene_json(Scene((), (), FacetView((), (), (), (), 2.0), guesses=(guess,)))["guesses"]
    made = MadeRun(tmp_path / "20260102T030405Z")
    made.look("look", guesses=[told])
    open_page(browser, write_page(made.close(), tmp_path / "page.html"))
    browser.execute_script("document.querySelector('#other-list details').open = true")
    assert "cube: 50 % of its edges show" in browser.find_element("id", "other-list").text
    for name, ends in (("shows", "10,20,60,20"), ("shows-not", "60,20,60,70")):
        left, right = browser.find_elements("css selector", f".camera line.{name}")
        assert ",".join(left.get_attribute(k) for k in ("x1", "y1", "x2", "y2")) == ends
        assert float(right.get_attribute("x1")) == float(left.get_attribute("x1")) + 5
    assert browser.get_log("browser") == []


def test_what_came_near_its_limit_is_open_and_what_was_calm_is_not(browser: Any, tmp_path: Path) -> None:
    made = MadeRun(tmp_path / "20260102T030405Z")
    made.pick()
    made.look("look", focus_left=0.4, motion_left=5.9)
    open_page(browser, write_page(made.close(), tmp_path / "page.html"))
    strips = {s.text.splitlines()[0]: s for s in browser.find_elements("css selector", ".strip")}
    assert "open" in strips["motion blur"].get_attribute("class")
    assert strips["motion blur"].find_elements("css selector", "line.limit")
    calm = strips["edge width (focus)"]
    assert not calm.find_elements("css selector", "line.limit")
    calm.find_element("css selector", ".name").click()
    assert calm.find_elements("css selector", "line.limit")
    assert browser.get_log("browser") == []


def test_a_bar_of_the_timeline_opens_its_cycle_and_a_click_its_pictures_large(browser: Any, page: Path) -> None:
    open_page(browser, page)
    browser.find_element("css selector", "#timeline i.missed").click()
    assert "Cycle 2: pyramid missed" in browser.find_element("id", "cycle").text
    browser.find_element("css selector", "#cycle .stereo").click()
    assert len(browser.find_elements("css selector", "dialog[open] .camera img")) == 2
    browser.find_element("css selector", "dialog[open]").click()
    assert browser.find_elements("css selector", "dialog[open]") == []
    assert browser.get_log("browser") == []


def test_the_cycle_under_the_pointer_is_marked_in_the_table_and_told_with_its_values(browser: Any, page: Path) -> None:
    open_page(browser, page)
    browser.execute_script(
        "const bar = document.querySelector('#timeline i.missed').getBoundingClientRect();"
        "document.getElementById('strips').dispatchEvent(new PointerEvent('pointermove',"
        " {clientX: bar.left + bar.width / 2, clientY: bar.top, bubbles: true}))"
    )
    assert "cycle 2 pyramid missed" in browser.find_element("id", "cursor").text
    (marked,) = browser.find_elements("css selector", "#table tr.under")
    assert marked.get_attribute("data-cycle") == "2"
    assert browser.get_log("browser") == []


def test_charts_have_units_and_names(browser: Any, page: Path) -> None:
    open_page(browser, page)
    told = browser.find_element("id", "plots").text
    for words in ("Predicted error at the grasp, look by look", "mm", "look at the part", "median", "survey the table"):
        assert words in told


def test_two_runs_side_by_side_fit_a_phone(browser: Any, tmp_path: Path) -> None:
    """The column of differences, and the mark where one matters, were beyond the edge."""
    for name in ("20260102T030405Z", "20260103T030405Z"):
        made = MadeRun(tmp_path / name)
        made.pick()
        made.close()
    page = write_page(made.folder, tmp_path / "page.html", tmp_path / "20260102T030405Z")
    browser.set_window_size(420, 900)
    open_page(browser, page)
    wide = browser.execute_script("return document.documentElement.scrollWidth - document.documentElement.clientWidth")
    heads = browser.find_elements("css selector", "#against-body th")
    browser.set_window_size(1300, 1000)
    assert wide <= 0
    assert [head.text for head in heads][2:4] == ["this run", "difference"]


def test_a_look_that_saw_three_parts_without_a_name_says_so_once(browser: Any, tmp_path: Path) -> None:
    made = MadeRun(tmp_path / "20260102T030405Z")
    made.look("find it", *(part(label) for label in ("unknown", "unknown", "cube", "unknown")))
    open_page(browser, write_page(made.close(), tmp_path / "page.html"))
    assert "find it: 3 unidentified parts, cube" in browser.find_element("id", "other-list").text


def test_a_phone_needs_no_sideways_scrolling(browser: Any, page: Path) -> None:
    browser.set_window_size(420, 900)
    open_page(browser, page)
    wide = browser.execute_script("return document.documentElement.scrollWidth - document.documentElement.clientWidth")
    assert wide <= 0
    why = browser.find_element("css selector", "tr[data-cycle='2'] .k-cause")
    assert "the pyramid lies where it lay" in why.text
    assert why.rect["x"] + why.rect["width"] <= 420
    browser.set_window_size(1300, 1000)


@pytest.mark.long
@pytest.mark.slow
def test_of_ten_thousand_cycles_nothing_out_of_sight_is_drawn(browser: Any, tmp_path: Path) -> None:
    """Of thousands of cycles with scenes as a cell records them the page had 46 MB. How soon such a page is open is
    measured by tests/bench/runs.py."""
    big = write_page(long_run(tmp_path / "20260102T030406Z", 10_000), tmp_path / "page.html")
    assert big.stat().st_size < 5_000_000
    open_page(browser, big)
    assert len(rows(browser)) == 1000
    elements = browser.execute_script("return document.querySelectorAll('*').length")
    assert elements < 20 * 1000, "each of the 9,000 cycles without a row costs an element or more"
    assert browser.find_elements("css selector", "img, image, canvas") == []


def test_images_without_room_in_the_page_are_shown_from_the_runs_folder_and_elsewhere_said_to_be_there(
    browser: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("daemon.review.page.PAGE_BYTES", 0)
    made = MadeRun(tmp_path / "20260102T030405Z")
    made.pick()
    folder = made.close()
    widths = "return [...document.querySelectorAll('#cycle .camera img')].map((i) => i.complete && i.naturalWidth)"
    open_page(browser, write_page(folder, folder / "page.html"))
    rows(browser)[0].click()
    until(lambda: browser.execute_script(widths) == [160, 160])
    assert "not in this page" not in browser.find_element("id", "warnings").text
    moved = tmp_path / "page.html"
    (folder / "page.html").rename(moved)
    open_page(browser, moved)
    rows(browser)[0].click()
    until(lambda: "the image is in the run's folder" in browser.find_element("id", "cycle").text)
    browser.get_log("browser")


def test_a_cycle_without_room_for_its_looks_says_what_shows_them(
    browser: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("daemon.review.page.DETAIL_BYTES", 0)
    made = MadeRun(tmp_path / "20260102T030405Z")
    made.pick()
    open_page(browser, write_page(made.close(), tmp_path / "page.html"))
    assert "1 cycle here without looks" in browser.find_element("id", "warnings").text
    rows(browser)[0].click()
    shown = browser.find_element("id", "cycle").text
    assert "not in this page" in shown
    assert "facetctl review 20260102T030405Z --cycle 1" in shown
    assert not browser.find_elements("id", "next")


def test_the_time_line_zooms_and_a_look_on_it_opens(browser: Any, page: Path) -> None:
    open_page(browser, page)
    bars = "return [...document.querySelectorAll('#timeline i:not([hidden])')].map((b) => parseFloat(b.style.width))"
    whole = browser.execute_script(bars)
    for _ in range(2):
        browser.find_element("id", "zoom-in").click()
    closer = browser.execute_script(bars)
    assert len(closer) < len(whole)
    assert max(closer) == pytest.approx(4 * max(whole), rel=0.01)
    browser.find_element("id", "zoom-all").click()
    assert browser.execute_script(bars) == whole
    assert not browser.find_element("id", "zoom-out").is_enabled()
    marks = browser.find_elements("css selector", ".looks i")
    assert len(marks) == 9
    browser.execute_script("arguments[0].click()", marks[5])
    cycle = browser.find_element("id", "cycle")
    assert "Cycle 2" in cycle.text
    assert cycle.find_element("css selector", "button[data-stop='2']").get_attribute("aria-pressed") == "true"
    assert browser.get_log("browser") == []
