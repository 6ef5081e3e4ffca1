"""A first contact with controllers nobody knows: what is found, what is asked, what never moves. In simulated time."""

import asyncio
import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
import yaml

from daemon import config as configs
from daemon.calibration.arm_from_readings import NoArmError
from daemon.cell import sections
from daemon.cell.identified_arm import arm_file, arm_of, page
from daemon.cell.identify import ContactLine, StoppedByPersonError, read_transcript, replay
from daemon.store import folders
from daemon.store.yamlfile import ConfigError
from drivers.puma560 import ArmGeometry, forward
from drivers.pumas import PUBLISHED
from drivers.simcell.arm import standing
from drivers.simcell.controller import Controller, Manners
from drivers.simcell.controller.manners import VAL_II_ASKS
from drivers.simcell.history import MotionRecord
from drivers.val2.contact_findings import CAREFUL_S, Consult, ContactFindings, UnclearError
from drivers.val2.dialect import SLOWEST_BAUD, Dialect
from drivers.val2.errors import Disturbed
from drivers.val2.first_contact_moves import ROUNDS, STEP_DEG
from drivers.val2.location import Location, location_from_matrix
from drivers.val2.wire import Where
from tests.bench.introductions import one
from tests.fakes.chosen import few
from tests.fakes.first_day import ROOMS, arm_yaml
from tests.fakes.strange_controllers import (
    START_DEG,
    Contact,
    PacedLine,
    draw,
    in_simulated_time,
    meet,
    strangers,
    willing,
    wrong,
)

HERE = Path(__file__).resolve().parents[2] / "data" / "introductions"


def typed(contact: Contact) -> list[str]:
    return [line.strip() for line in contact.controller.lines]


def moved(contact: Contact) -> bool:
    return any(isinstance(event, MotionRecord) for event in contact.controller.machine.history.since(0)[1])


@pytest.mark.slow
@pytest.mark.parametrize("seed", few([2, 7, 1927], 1))
def test_a_controller_drawn_at_random_is_introduced_right_without_help(seed: int) -> None:
    assert one(seed) == "right"


def no_to_moves(controller, consult):
    return "no" if consult.about == "move" else willing(controller, consult)


def test_without_a_yes_nothing_that_could_move_is_typed_and_the_dialect_is_found_all_the_same() -> None:
    contact = in_simulated_time(lambda: meet(draw(0), no_to_moves))
    assert contact.known.dialect()["echo"] is True
    assert not moved(contact)
    said = {line.upper() for line in typed(contact) if "!!" not in line and not set(line.upper()) <= set("WHER")}
    assert said <= {"ABORT", "DO BREAK", "PANIC", "Y"}
    assert "geometry" not in arm_file(contact.known, None)


@pytest.mark.parametrize(("asks", "learnt"), [(("Boot now (Y/N)?", "Initialize (Y/N)?"), True), (VAL_II_ASKS, False)])
def test_the_words_in_which_a_controller_asks_at_power_up_are_learnt_where_they_are_no_usual_ones(
    asks: tuple[str, ...], learnt: bool
) -> None:
    strange = draw(0)
    cold = replace(strange, cold=True, manners=replace(strange.manners, power_up=asks))
    contact = in_simulated_time(lambda: meet(cold, no_to_moves))
    section = {"dialect": {name: entry["value"] for name, entry in arm_file(contact.known, None)["dialect"].items()}}
    found = msgspec.convert(section["dialect"].get("power_up_asks", ()), tuple[str, ...])
    assert bool(found) is learnt
    assert all(Dialect(power_up_asks=found).asks_after_power_up(question) for question in asks) is learnt


@pytest.mark.parametrize("seed", [0, 2, 3])
def test_a_controller_that_is_not_calibrated_is_offered_cal_and_is_asked_first(seed: int) -> None:
    asked: list[str] = []

    def answered(controller: Controller, consult: Consult) -> str:
        if consult.about == "calibrate":
            asked.append(consult.text)
            assert not any(line.strip().startswith("CAL") for line in controller.lines), "not before the yes"
        return willing(controller, consult)

    contact = in_simulated_time(lambda: meet(draw(seed), answered, calibrated=False))
    assert len(asked) == 1
    assert "not calibrated" in asked[0].lower()
    assert sum(line.startswith("CAL") for line in typed(contact)) == 1
    assert contact.controller.machine.calibrated
    assert len(contact.known.readings) > 12
    assert list(replay(contact.transcript)) == []


def test_where_cal_is_not_agreed_to_nothing_moves_and_what_to_do_is_told() -> None:
    def answered(controller: Controller, consult: Consult) -> str:
        return "no" if consult.about == "calibrate" else willing(controller, consult)

    with pytest.raises(UnclearError, match="not calibrated, and nothing was moved"):
        in_simulated_time(lambda: meet(draw(0), answered, calibrated=False))
    assert not moved(strangers[-1])
    assert not any(line.startswith("CAL") for line in typed(strangers[-1]))


def straight_wristed() -> Any:
    strange = draw(0)
    joints = strange.joints_deg.copy()
    joints[4] = 0.4
    plain = replace(strange.manners, joint_signs=(1, 1, 1, 1, 1, 1), joint_zeros_deg=(0.0,) * 6)
    return replace(strange, joints_deg=joints, manners=plain)


def test_a_straight_wrist_is_told_before_anything_moves_and_bent_by_the_person() -> None:
    strange, asked = straight_wristed(), list[str]()

    def bent(controller: Controller, consult: Consult) -> str:
        if consult.about == "pendant":
            asked.append(consult.text)
            assert not moved_yet(controller)
            joints = strange.joints_deg.copy()
            joints[4] = -40.0 if len(asked) > 1 else 3.0
            controller.machine.arm.motion = standing(np.radians(joints))
        return willing(controller, consult)

    def moved_yet(controller: Controller) -> bool:
        return any(isinstance(event, MotionRecord) for event in controller.machine.history.since(0)[1])

    contact = in_simulated_time(lambda: meet(strange, bent))
    assert ["straight" in text for text in asked] == [True, True], "bent by 3 degrees it is straight still"
    assert "Joint 5 reads 0.4 degrees" in asked[0]
    assert arm_of(contact.known).found.lengths_mm[0] == pytest.approx(strange.geometry.a2_mm, abs=0.5)


@pytest.mark.parametrize("straight", [True, False])
def test_where_no_arm_fits_a_wrist_that_stayed_straight_is_named(straight: bool, monkeypatch) -> None:
    def stubborn(controller: Controller, consult: Consult) -> str:
        return "no" if consult.about == "pendant" else willing(controller, consult)

    def none_fits(*_: Any) -> None:
        raise NoArmError("no arm fits")

    known = in_simulated_time(lambda: meet(straight_wristed() if straight else draw(0), stubborn)).known
    monkeypatch.setattr("daemon.cell.identified_arm.find_arm", none_fits)
    with pytest.raises(NoArmError, match="no arm fits") as raised:
        arm_of(known)
    assert ("The wrist was straight (joint 5 read 0." in str(raised.value)) is straight


def test_each_move_is_one_joint_by_two_degrees_and_is_announced_and_the_stop_is_proven_before_the_others() -> None:
    contact = in_simulated_time(lambda: meet(draw(0)))
    legs = [event for event in contact.controller.machine.history.since(0)[1] if isinstance(event, MotionRecord)]
    assert len(legs) == len([line for line in contact.told if line.startswith("joint")])
    for leg in legs:
        turned = leg.motion.joints_at(leg.motion.ends_s) - leg.motion.joints_at(leg.motion.started_s)
        assert np.count_nonzero(np.abs(turned) > 1e-9) <= 1
        assert np.abs(turned).max() <= np.radians(STEP_DEG) + 1e-9
    drives = [k for k, line in enumerate(typed(contact)) if "DRIVE" in line]
    assert "ABORT" in typed(contact)[drives[0] + 1]
    assert np.abs(contact.known.readings[-1].joints_deg[0] - contact.known.readings[0].joints_deg[0]) < 0.01


def test_a_line_that_says_nothing_ends_with_what_to_look_at_and_nothing_moved() -> None:
    with pytest.raises(UnclearError, match="nothing answers at any speed"):
        in_simulated_time(lambda: meet(draw(0), dead=True))
    assert not moved(strangers[-1])


def test_where_no_word_stops_a_motion_no_second_joint_is_turned(monkeypatch) -> None:
    monkeypatch.setattr("drivers.simcell.controller.monitor.stops", lambda text, manners: False)
    monkeypatch.setattr("drivers.simcell.controller.machine.Machine.stop", lambda *_: None)
    with pytest.raises(UnclearError, match="did not stop a moving joint"):
        in_simulated_time(lambda: meet(draw(0)))
    drives = [line for line in typed(strangers[-1]) if "DRIVE" in line]
    assert drives
    assert all("DRIVE 6," in line for line in drives)


def test_a_character_lost_at_the_first_stop_is_typed_anew_more_slowly_and_nobody_is_asked_about_it(monkeypatch) -> None:
    arrive, lost = PacedLine._arrive, []

    def arrive_but_one(line: PacedLine, data: bytes) -> None:
        if data == b"B" and not lost and any("DRIVE" in text for text in line._controller.lines):
            lost.append(data)
        else:
            arrive(line, data)

    def answered(controller, consult):
        assert consult.about != "power", consult.text
        return willing(controller, consult)

    monkeypatch.setattr(PacedLine, "_arrive", arrive_but_one)
    contact = in_simulated_time(lambda: meet(draw(0), answered))
    assert lost
    assert contact.known.findings["character_pause_s"].value == CAREFUL_S
    assert len(contact.known.readings) > 1


@pytest.mark.parametrize("stop_s", [0.3, 25.0, 60.0, 90.0])
def test_a_stop_at_any_moment_of_it_is_sent_at_once_and_no_motion_begins_after_it(stop_s: float) -> None:
    async def story():
        with pytest.raises(StoppedByPersonError):
            await meet(draw(2), stop_s=stop_s)
        await asyncio.sleep(3.0)
        with strangers[-1].line.controller() as controller:
            return controller.machine.at_rest(), controller.machine.history.since(0)[1]

    at_rest, events = in_simulated_time(story)
    assert at_rest
    assert all(not isinstance(event, MotionRecord) or event.began_s <= stop_s + 0.1 for event in events)
    sent = "".join(record.get("bytes", "") for record in strangers[-1].transcript if record["way"] == "out")
    assert re.search(r"ABORT", sent[-60:])


@pytest.mark.parametrize("seed", [3, 9])
def test_the_person_s_stop_is_read_by_a_controller_that_loses_what_follows_too_closely(seed: int) -> None:
    async def story():
        with pytest.raises(StoppedByPersonError):
            await meet(draw(seed), stop_s=60.0)
        await asyncio.sleep(3.0)

    assert draw(seed).manners.lost_within_s == 0.02
    in_simulated_time(story)
    assert typed(strangers[-1])[-1] in ("ABORT", "PANIC")


def test_the_person_s_stop_stands_amid_nothing_else_that_is_being_typed() -> None:
    """A letter at a time, the command and the stop went out by turns: `!E! \r4A,B2O,R1T`."""

    def begins(record: dict[str, Any]) -> bool:
        return record["way"] == "out" and record["bytes"] == "V"

    async def story(stop_s: float) -> None:
        with pytest.raises(StoppedByPersonError):
            await meet(draw(3), stop_s=stop_s)

    in_simulated_time(lambda: meet(draw(3)))
    drive_s = [record["t_s"] for record in strangers[-1].transcript if begins(record)][-1]
    in_simulated_time(lambda: story(drive_s + 0.001))
    ways = [record["way"] for record in strangers[-1].transcript]
    sent = [record["bytes"] for record in strangers[-1].transcript[ways.index("stop") :] if record["way"] == "out"]
    assert "".join(sent) == 2 * "!!\rABORT\rPANIC\r"


def beside_the_others(folder: Path, text: str) -> Path:
    for path in (folders.HOUSE / "etc").glob("*.yaml"):
        (folder / path.name).write_bytes(path.read_bytes())
    (folder / "facetd.yaml").write_text(text)
    return folder / "facetd.yaml"


@pytest.mark.slow
def test_what_is_written_is_what_the_cell_then_works_with(tmp_path: Path) -> None:
    strange = draw(0)
    contact = in_simulated_time(lambda: meet(strange))
    arm = arm_of(contact.known)
    (tmp_path / "arm.yaml").write_text(yaml.safe_dump(arm_file(contact.known, arm), sort_keys=False))
    file = beside_the_others(tmp_path, "version: 1\narm: {file: arm.yaml, dialect: {answer_s: 7}}\n")
    config = configs.load_config(file)
    dialect, geometry = sections.dialect(config), sections.arm_geometry(config)
    assert (dialect.answer_s, dialect.line_end, dialect.echo) == (7, b"\r", True)
    reading = contact.known.readings[0]
    joints = np.radians(dialect.our_angles_deg(reading.joints_deg))
    assert np.abs(joints - np.radians(strange.joints_deg)).max() < np.radians(3.0)
    bare = geometry.world_from_base @ forward(joints, strange.geometry)
    assert bare.shape == (4, 4)
    assert geometry.a2_mm == pytest.approx(strange.geometry.a2_mm, abs=0.1)
    text = page(contact.known, arm)
    assert strange.name in text
    sure = {arm_file(contact.known, arm)["geometry"][f"{name}_mm"]["sure"] for name in ("a2", "a3", "d3", "d4")}
    assert ("published" in sure) is bool(arm.source), "lengths that were looked up were not measured"
    assert "What the line cannot show" in text


@pytest.mark.slow
def test_an_arm_that_nobody_published_says_how_loosely_it_is_known_and_takes_the_lengths_of_its_drawing() -> None:
    drawing = 780.0, 0.0, 190.0, 720.0
    strange = draw(3)
    a2, a3, d3, d4 = drawing
    geometry = replace(strange.geometry, a2_mm=a2, a3_mm=a3, d3_mm=d3, d4_mm=d4)
    known = in_simulated_time(lambda: meet(replace(strange, geometry=geometry))).known
    loose, typed_in = arm_of(known), arm_of(known, drawing)
    assert loose.alike is None
    assert "--lengths A2,A3,D3,D4" in page(known, loose)
    assert typed_in.found.lengths_mm == pytest.approx(drawing, abs=1e-6)
    off = np.array(typed_in.found.zeros_deg) / 90.0
    assert off == pytest.approx(np.round(off), abs=1e-4), "with the lengths right the zeros are as well"
    assert "--lengths" not in page(known, typed_in)
    with pytest.raises(NoArmError, match="not the lengths typed"):
        arm_of(known, (650.0, 0.0, 190.0, 600.0))


@pytest.mark.parametrize("moves", [True, False])
def test_a_dozen_places_by_the_pendant_tell_the_lengths_of_an_arm_nobody_published_to_a_tenth(moves: bool) -> None:
    drawing = 780.0, 0.0, 190.0, 720.0
    strange, rng = draw(3), np.random.default_rng(5)
    a2, a3, d3, d4 = drawing
    strange = replace(strange, geometry=replace(strange.geometry, a2_mm=a2, a3_mm=a3, d3_mm=d3, d4_mm=d4))
    places = [*(strange.joints_deg + rng.uniform(-40, 40, (12, 6))), None]
    places.insert(1, places[0])  # where it is already: not taken a second time

    def brought(controller: Controller, consult: Consult) -> str:
        if consult.about == "move" and not moves:
            return "no"
        if consult.about != "pendant":
            return willing(controller, consult)
        if (place := places.pop(0)) is None:
            return "no"
        controller.machine.arm.motion = standing(np.radians(place))
        return "yes"

    contact = in_simulated_time(lambda: meet(strange, brought, pendant=True))
    found = arm_of(contact.known)
    assert len(contact.known.readings) == 12 + (25 if moves else 1)
    assert sum("move the arm farther away" in line for line in contact.told) == 1
    assert found.found.lengths_mm == pytest.approx(drawing, abs=0.1)
    assert "Small steps" not in page(contact.known, found)
    assert list(replay(contact.transcript)) == []


def test_limits_are_typed_as_the_plate_has_them_and_a_little_is_kept_from_them(tmp_path: Path) -> None:
    made = arm_yaml(ArmGeometry())
    made["dialect"] = {
        "joint_signs": {"value": [1, -1, 1, 1, 1, 1]}, "joint_zeros_deg": {"value": [0, 0, -180, 0, 0, 90]},
    }  # fmt: skip
    plate = [[-160, 160], [-225, 45], [-45, 225], [-110, 170], [-100, 100], [-266, 266]]
    made["geometry"]["limits_deg"] = {"value": plate}
    (tmp_path / "arm.yaml").write_text(yaml.safe_dump(made))
    config = configs.load_config(beside_the_others(tmp_path, "version: 1\narm: {file: arm.yaml}\n"))
    found = np.degrees(sections.arm_geometry(config).limits_rad)
    meant = [[-160, 160], [-45, 225], [-225, 45], [-110, 170], [-100, 100], [-176, 356]]
    np.testing.assert_allclose(found, np.array(meant) + [[0.2, -0.2]] * 6, atol=1e-9)


@pytest.mark.parametrize(("file", "section", "where"), [
    (1200, "", r"arm.yaml:3: dialect.baud: 1200 is too slow"),
    (9600, "baud: 4800", r"facetd.yaml:2: arm.dialect.baud: 4800 is too slow.* to 9600 or more"),
    (1200, "baud: 9600", None),
])  # fmt: skip
def test_a_line_on_which_a_stop_is_confirmed_too_late_is_refused_where_its_speed_stands(
    tmp_path: Path, file: int, section: str, where: str | None
) -> None:
    (tmp_path / "arm.yaml").write_text(f"version: 1\ndialect:\n  baud: {{value: {file}}}\n")
    text = f"version: 1\narm: {{file: arm.yaml, dialect: {{{section}}}}}\n"
    config = configs.load_config(beside_the_others(tmp_path, text))
    if where is None:
        assert sections.dialect(config).baud == 9600
        return
    with pytest.raises(ConfigError, match=where):
        sections.dialect(config)


def test_an_arm_file_with_a_wrong_value_is_told_with_its_line(tmp_path: Path) -> None:
    (tmp_path / "arm.yaml").write_text("version: 1\ndialect:\n  echo: {value: perhaps}\n")
    file = beside_the_others(tmp_path, "version: 1\narm: {file: arm.yaml}\n")
    with pytest.raises(ConfigError, match=r"arm.yaml:3: dialect.echo"):
        sections.dialect(configs.load_config(file))


def test_a_transcript_is_followed_word_for_word_and_the_first_change_is_shown() -> None:
    contact = in_simulated_time(lambda: meet(draw(2)))
    lines = [json.dumps(record) for record in contact.transcript]
    assert list(replay(read_transcript(lines))) == []
    k = (
        next(k for k, record in enumerate(contact.transcript) if record["way"] == "answers" and record["text"] == "yes")
        + 1
    )
    (difference,) = replay(read_transcript([*lines[:k], lines[k].replace('"S"', '"Z"'), *lines[k + 1 :]]))
    assert difference.startswith(f"record {k + 1}") or "Z" in difference


def test_a_transcript_of_a_computer_that_was_late_is_followed_too() -> None:
    """It heard an answer after its time was up, and a prompt that came twice when nothing more was expected."""
    records = in_simulated_time(lambda: meet(draw(2))).transcript
    step = next(k for k, record in enumerate(records) if record.get("text", "").startswith("joint 1 by +"))
    before = max(k for k in range(step) if records[k]["way"] == "heard")
    assert records[before - 1]["way"] == "in"
    late = [dict(record) for record in records]
    for record in late[before - 1 :]:
        record["t_s"] += 30.0
    assert list(replay(late)) == []
    stray = {"t_s": records[step]["t_s"] - 0.001, "way": "in", "bytes": "\r\n"}
    assert list(replay([*records[: before + 1], stray, *records[before + 1 :]])) == []


@pytest.mark.parametrize("path", sorted(HERE.glob("*.jsonl")), ids=lambda path: path.stem)
def test_today_s_driver_says_what_it_said_in_the_recorded_introductions(path: Path) -> None:
    assert list(replay(read_transcript(path.read_text().splitlines()))) == []


def test_a_line_that_is_no_record_is_named() -> None:
    with pytest.raises(ValueError, match="line 2"):
        list(read_transcript(['{"t_s": 0, "way": "in", "bytes": ""}', "{}"]))


@pytest.mark.slow
@pytest.mark.parametrize("baud", few([9600, 1200], 1))
def test_a_controller_that_waits_for_two_stop_bits_is_typed_to_with_a_pause_and_known(baud: int) -> None:
    """Eleven bits a character: of ours, which have ten and follow at once, each second one comes too soon."""
    strange = replace(draw(2), baud=baud)
    strange = replace(strange, manners=replace(strange.manners, lost_within_s=10.5 / baud))
    contact = in_simulated_time(lambda: meet(strange))
    assert not wrong(strange, contact.known, arm_of(contact.known))
    assert contact.known.findings["character_pause_s"].value >= 0.5 / baud
    assert ("facetd refuses a line" in page(contact.known, None)) is (baud < SLOWEST_BAUD)


LIKE_A_761 = (650.0, 0.0, 190.0, 850.0), (750.0, 0.0, 190.0, 750.0)
"""Two ways in which its 1500 mm may be shared out."""


@pytest.mark.parametrize("lengths_mm", [*(arm.lengths_mm for arm in PUBLISHED), *LIKE_A_761])
def test_the_hand_of_no_arm_goes_farther_than_the_person_is_told(lengths_mm: tuple[float, ...]) -> None:
    """Every joint as far to both sides as the steps come to, in poses as they are asked for, a hand of 20 cm."""
    hand = np.eye(4)
    hand[2, 3] = 200.0
    a2, a3, d3, d4 = lengths_mm
    geometry, rng, worst_mm = ArmGeometry(a2, a3, d3, d4, flange_from_tool=hand), np.random.default_rng(0), 0.0
    farthest = np.radians(STEP_DEG * np.abs(np.cumsum(ROUNDS)).max())
    for _ in range(400):
        bent = rng.uniform(30.0, 90.0)
        pose = np.radians([0.0, rng.uniform(0, 120), rng.uniform(-180, -40), rng.uniform(-90, 90), -bent, 0.0])
        for _ in range(10):
            turned = pose + rng.choice([-1.0, 1.0], 6) * farthest
            way = forward(turned, geometry) - forward(pose, geometry)
            worst_mm = max(worst_mm, float(np.linalg.norm(way[:3, 3])))
    assert worst_mm < 250.0
    asked = in_simulated_time(lambda: meet(draw(0), no_to_moves)).transcript
    assert any("clear of everything by 25 cm" in record.get("text", "") for record in asked)


def test_the_rooms_that_the_page_tells_of_are_those_that_arms_pick_in() -> None:
    page = (folders.HOUSE / "deploy" / "FIRST-DAY.md").read_text(encoding="utf-8")
    told = re.findall(r"^ *\| (PUMA \d+) \| (\d+) \| (\d+) \| (\d+) \| ([\d, ]+) \| (\d+) \|$", page, re.MULTILINE)
    assert len(told) == len(ROOMS)
    for series, *numbers, stand_offs, hand in told:
        room = ROOMS[series]
        assert [float(number) for number in (*numbers, hand)] == [
            room.below_mm, room.before_mm, room.look_mm, room.hand_mm,
        ]  # fmt: skip
        assert tuple(map(float, stand_offs.split(","))) == room.stand_offs_mm


def test_a_controller_that_counts_in_inches_is_known_by_its_arm_and_told_in_millimetres() -> None:
    inches = PUBLISHED[0].lengths_mm[0] / 25.4, PUBLISHED[0].lengths_mm[1] / 25.4, 150.05 / 25.4, 431.8 / 25.4
    geometry = ArmGeometry(*inches)
    rng = np.random.default_rng(3)
    readings = []
    for _ in range(14):
        degrees = np.round(START_DEG + rng.uniform(-25, 25, 6), 3)
        place = location_from_matrix(forward(np.radians(degrees), geometry))
        readings.append(Where(Location(*(round(value, 4) for value in place.values())), tuple(degrees)))
    known = ContactFindings(readings=readings)
    known.found("digits", (4, 3), "WHERE")
    made = arm_file(known, arm_of(known))
    assert made["dialect"]["unit_mm"]["value"] == 25.4
    assert "PUMA 560" in made["dialect"]["unit_mm"]["found"]
    lengths = [made["geometry"][f"{name}_mm"]["value"] for name in ("a2", "a3", "d3", "d4")]
    assert lengths == pytest.approx(PUBLISHED[0].lengths_mm, abs=0.1)


def test_where_in_whole_numbers_ends_with_a_question_before_anything_is_moved() -> None:
    strange = draw(0)
    strange = replace(strange, manners=replace(strange.manners, decimals=(0, 0)))
    with pytest.raises(UnclearError, match=r"whole numbers \(.*can the controller be set to print decimals\?"):
        in_simulated_time(lambda: meet(strange))
    assert not moved(strangers[-1])


def test_whole_angles_beside_lengths_that_are_not_are_zeros_left_out() -> None:
    """The ready place of many systems."""
    strange = draw(0)
    manners = Manners(decimals=(3, 3), trailing_zeros=False)
    strange = replace(strange, baud=9600, cold=False, manners=manners, geometry=ArmGeometry(), joints_deg=np.array(
        [0.0, 60.0, -150.0, 0.0, -40.0, 0.0]))  # fmt: skip
    known = in_simulated_time(lambda: meet(strange, no_to_moves)).known
    assert known.findings["digits"].value[1] == 3


@pytest.mark.parametrize("decimals", [(2, 3), (1, 2)])
def test_the_digits_of_where_are_found_where_zeros_at_the_end_are_left_out_and_say_what_counts_as_at_rest(
    decimals: tuple[int, int],
) -> None:
    strange = draw(0)
    manners = replace(strange.manners, decimals=decimals, trailing_zeros=False, leading_zero=False)
    strange = replace(strange, manners=manners, joints_deg=np.array([10.0, 60.0, -150.0, 20.0, -40.0, 30.0]))
    found = in_simulated_time(lambda: meet(strange, no_to_moves)).known.findings
    assert found["digits"].value == decimals
    coarse = {name: found[name].value for name in ("same_place_mm", "same_place_deg") if name in found}
    assert coarse == ({} if decimals == (2, 3) else {"same_place_mm": 0.2, "same_place_deg": 0.02})


@pytest.mark.parametrize("seed", [0, 3])
def test_what_becomes_unclear_after_something_was_moved_ends_with_the_stop(seed: int) -> None:
    """Nobody could read whether the arm rested, and it was left as it was."""

    def deaf(controller: Controller, consult: Consult) -> str:
        if consult.about == "move":
            asyncio.get_running_loop().call_later(13.0, setattr, controller.faults, "mute_answers", 1000)
        return willing(controller, consult)

    with pytest.raises(UnclearError, match="WHERE goes on changing"):
        in_simulated_time(lambda: meet(draw(seed), deaf))
    since = [record["way"] for record in strangers[-1].transcript].index("unclear")
    assert b"ABORT" in b"".join(r["bytes"].encode() for r in strangers[-1].transcript[since:] if r["way"] == "out")


def test_a_disk_that_fills_with_a_joint_on_its_way_ends_it_with_the_stop() -> None:
    """It ended there, with the joint on its way and nobody to look whether it came to rest."""
    with pytest.raises(OSError, match="No space left"):
        in_simulated_time(lambda: meet(draw(2), full=lambda controller: not controller.machine.at_rest()))
    assert moved(strangers[-1])
    assert typed(strangers[-1])[-1] in ("ABORT", "PANIC")


def test_no_disk_that_is_full_keeps_the_persons_stop_back() -> None:
    with pytest.raises(StoppedByPersonError):
        in_simulated_time(lambda: meet(draw(2), stop_s=60.0, full=lambda _: asyncio.get_running_loop().time() >= 60.0))
    assert moved(strangers[-1])
    assert typed(strangers[-1])[-1] in ("ABORT", "PANIC")


def test_a_stop_is_typed_also_on_a_port_that_somebody_changed_just_then() -> None:
    written: list[bytes] = []

    class Changed:
        def write(self, data: bytes) -> None:
            written.append(data)
            if len(written) == 1:
                raise Disturbed("stty")

        def close(self) -> None: ...

    opens: Any = lambda *_: Changed()  # noqa: E731
    line = ContactLine("port", opens, lambda: 0.0, lambda _: None)
    line.open(9600)
    line.send_stop(b"ABORT\r")
    assert written == [b"ABORT\r"] * 2
