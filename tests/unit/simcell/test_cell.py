"""The simulated cell as one: a port that answers, a camera that sees what the arm's pose shows, a hand that takes."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import yaml

from daemon.arrays import Array
from daemon.store import folders
from drivers.rigid import apply, inverse, rigid
from drivers.simcell.cell import SimulatedCell
from drivers.simcell.truth import TruthError, load_truth
from drivers.simcell.world import PartPlace
from drivers.val2.link import Link
from drivers.val2.location import Location, location_from_matrix

TRUTH = folders.HOUSE / "etc" / "simcell.yaml"
DOWN = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])


@pytest.fixture
def cell() -> Iterator[SimulatedCell]:
    with SimulatedCell(TRUTH, seed=1, time_scale=40.0) as cell:
        cell.camera.open()
        yield cell


def drive(cell: SimulatedCell, *steps: str | Array) -> None:
    """Carry out over the line: a matrix is a move to it, 'open' and 'close' are the hand's."""

    async def work() -> None:
        link = Link(cell.port)
        await link.open()
        try:
            for step in steps:
                if isinstance(step, str):
                    await (link.set_hand(closed=True) if step == "close" else link.set_hand(closed=False))
                else:
                    target: Location = location_from_matrix(step)
                    await link.move(target)
                    await link.wait_until_at_rest(target, 10.0)
        finally:
            await link.close()

    asyncio.run(work())


def above(x_mm: float, y_mm: float, z_mm: float) -> Array:
    return rigid(DOWN, np.array([x_mm, y_mm, z_mm]))


def test_the_arm_is_truly_a_little_off_where_it_says_it_is(cell: SimulatedCell) -> None:
    said = above(520.0, 0.0, -100.0)
    drive(cell, said)
    off_mm = np.linalg.norm(cell.world_from_tool()[:3, 3] - said[:3, 3])
    assert 0.02 < off_mm < 1.0


def test_a_part_closed_on_goes_with_the_hand_and_lands_in_the_bin_where_it_is_let_go(cell: SimulatedCell) -> None:
    part = cell.world.stand("cube", 0, 520.0, 20.0, 0.03)
    grasp = above(520.0, 21.0, -280.0)
    drive(cell, above(520.0, 21.0, -150.0), grasp, "close", above(520.0, 21.0, -150.0))
    told = cell.truth.grasps[-1].grip
    assert told is not None
    assert told.held, told.why
    assert cell.world.held is not None
    assert told.width_mm == pytest.approx(50.0, abs=0.05)
    assert abs(told.shift_mm) < 0.5, "tool y lies along world x, where the aim was right"
    assert abs(told.turn_deg) == pytest.approx(np.degrees(0.03), abs=0.1)
    x_mm, y_mm = cell.truth.settings.bin.centre_mm
    drive(cell, above(x_mm, y_mm, -150.0), "open")
    assert cell.world.held is None
    assert {p.name: p.where for p in cell.world.parts} == {part.name: PartPlace.BIN}
    assert cell.world.strikes == []


def test_a_hand_that_is_beside_the_part_takes_nothing(cell: SimulatedCell) -> None:
    cell.world.stand("cube", 0, 520.0, 0.0, 0.0)
    drive(cell, above(520.0, 60.0, -280.0), "close")
    assert not cell.truth.grasps[-1].held
    assert cell.world.held is None


def test_the_camera_shows_the_part_where_the_cameras_true_pose_says(cell: SimulatedCell) -> None:
    part = cell.world.stand("cube", 0, 500.0, 0.0, 0.4)
    drive(cell, above(560.0, 0.0, 0.0))
    pair = cell.camera.grab(time.monotonic(), 2.0)
    seen = apply(inverse(cell.world_from_cyclopean()), cell.truth.corners(part.name))
    for camera, frame in ((cell.truth.settings.left, pair.left), (cell.truth.settings.right, pair.right)):
        outline = camera.lens().project(seen)
        bright = np.argwhere(frame.pixels > 140)[:, ::-1]
        assert len(bright) > 500
        assert np.all(bright.min(axis=0) > outline.min(axis=0) - 2)
        assert np.all(bright.max(axis=0) < outline.max(axis=0) + 2)


def test_a_board_in_the_gripper_goes_with_it(cell: SimulatedCell) -> None:
    tool_from_board = cell.hold_board()
    scenes = []
    for place in (above(520.0, 0.0, 0.0), above(480.0, 60.0, -40.0)):
        drive(cell, place)
        scenes.append(cell._scene_at(time.monotonic()))
        (board,) = scenes[-1].solids
        assert np.allclose(board.world_from_solid, cell.world_from_tool() @ tool_from_board, atol=0.01)
    assert scenes[0].state != scenes[1].state, "what the cameras see is rendered anew"
    cell.clear()
    assert cell._scene_at(time.monotonic()).solids == ()


def test_what_the_daemon_believes_is_off_by_realistic_errors(cell: SimulatedCell) -> None:

    believed = yaml.safe_load((TRUTH.parent / "calibration.yaml").read_text())
    truth = cell.truth.settings
    wrist = inverse(np.array(believed["hand_eye"]["tool_from_cyclopean"])) @ np.array(truth.tool_from_cyclopean)
    angle_deg = np.degrees(np.arccos((np.trace(wrist[:3, :3]) - 1) / 2))
    assert 0.2 < np.linalg.norm(wrist[:3, 3]) < 0.4
    assert 0.03 < angle_deg < 0.07
    for camera in ("left", "right"):
        off_px = np.abs(np.array(believed[camera]["camera_matrix"]) - np.array(getattr(truth, camera).camera_matrix))
        assert 0.1 < off_px.max() < 0.5


def test_a_truth_file_with_a_wrong_value_is_refused_by_name(tmp_path: Path) -> None:
    broken = tmp_path / "simcell.yaml"
    broken.write_text(TRUTH.read_text().replace("blur_px: 0.6", "blur_px: -1"))
    with pytest.raises(TruthError, match=r"simcell.yaml: .*blur_px"):
        SimulatedCell(broken)


@pytest.mark.parametrize("name", ["cyclopean_from_camera", "flange_from_tool", "tool_from_cyclopean"])
def test_a_transform_that_is_none_is_refused_by_name(tmp_path: Path, name: str) -> None:
    data = yaml.safe_load(TRUTH.read_text())
    holder = {"cyclopean_from_camera": data["right"], "flange_from_tool": data["arm"]}.get(name, data)
    holder[name][0][0] += 0.1
    (tmp_path / "simcell.yaml").write_text(yaml.safe_dump(data))
    with pytest.raises(TruthError, match=rf"simcell.yaml: {name}: .*not a rotation"):
        load_truth(tmp_path / "simcell.yaml")


def test_a_fixture_on_the_table_is_seen_but_under_the_cloth_and_nothing_may_strike_it(tmp_path: Path) -> None:
    box = {"low_mm": [460.0, -60.0, -300.0], "high_mm": [580.0, 60.0, -270.0]}
    (tmp_path / "simcell.yaml").write_text(yaml.safe_dump({**yaml.safe_load(TRUTH.read_text()), "fixture": [box]}))
    with SimulatedCell(tmp_path / "simcell.yaml", seed=1, time_scale=40.0) as cell:
        assert [each.world_from_solid.tolist() for each in cell._scene_at(time.monotonic()).solids] == [
            np.eye(4).tolist()
        ]
        cell.place_for_teaching("cube", 0)
        assert len(cell._scene_at(time.monotonic()).solids) == 1, "the cube, before a cloth"
        drive(cell, rigid(DOWN, [520.0, 0.0, -265.0]))
        assert any(found.rule == "in keep-out box 1" for found in cell.violations())


def test_whether_the_vacuum_holds_is_asked_of_no_motion_twice(monkeypatch: pytest.MonkeyPatch) -> None:
    """A cell of weeks had its whole history read at each input."""
    with SimulatedCell(folders.ETC / "suction" / "simcell.yaml", seed=1, time_scale=40.0) as cell:
        drive(cell, *(rigid(DOWN, [x, 0.0, -100.0]) for x in (520.0, 500.0, 520.0)))
        with cell.server.controller() as controller:
            cell._watch_hold(controller.now_s)
        history, read = cell.truth.machine.history, list[int]()
        since = history.since
        monkeypatch.setattr(history, "since", lambda number: read.append(len(since(number)[1])) or since(number))
        with cell.server.controller() as controller:
            cell._watch_hold(controller.now_s)
        assert read == [0]
        assert len(cell.truth.motions) == 3


def test_a_file_from_before_there_was_a_motion_monitor_still_loads(tmp_path: Path) -> None:
    (tmp_path / "simcell.yaml").write_text(TRUTH.read_text().split("safety:")[0])
    assert load_truth(tmp_path / "simcell.yaml").safety.body == []


def test_a_wrongly_set_tool_moves_the_arm_elsewhere_but_not_the_gripper_on_its_flange(cell: SimulatedCell) -> None:
    before = cell.world_from_tool()
    with cell.server.controller() as controller:
        controller.arm.tool = rigid(np.eye(3), [0.0, 0.0, 60.0])
    assert np.allclose(cell.world_from_tool(), before)


def test_the_cameras_see_the_fingers_at_the_upper_rim_and_nowhere_else(cell: SimulatedCell) -> None:
    drive(cell, above(520.0, 0.0, 0.0))
    seen = cell.camera.grab(time.monotonic(), 2.0).left.pixels.astype(int)
    assert seen[:25].max() > seen[60:].max() + 15


def test_what_is_typed_beside_the_daemon_is_known_to_the_truth(cell: SimulatedCell) -> None:
    drive(cell, above(520.0, 0.0, -100.0))
    with cell.server.controller() as controller:
        for line in (b"SPEED 35\r", b"TOOL TRANS(0,0,60,0,0,0)\r", b"DO DRIVE 1,2,50\r", b"DO DRIVE 6,2,50\r"):
            controller.receive(line, controller.now_s)
    drive(cell, "close")
    with cell.server.controller() as controller:
        controller.receive(b"DO DEPART 20\r", controller.now_s)
    typed = {motion.by: motion for motion in cell.truth.motions}
    move = next(motion for by, motion in typed.items() if by.startswith("DO MOVE"))
    assert move.speed_percent == 100.0
    assert typed["DO DRIVE 1,2,50"].speed_percent == 50.0, "DRIVE names its own"
    assert typed["DO DEPART 20"].speed_percent == 35.0
    machine = cell.truth.machine
    assert (machine.speed_percent, machine.hand_closed, machine.arm_power) == (35.0, True, True)
    assert machine.arm.tool[2, 3] == 60.0


def written(tmp_path: Path, **arm: object) -> Path:
    made = yaml.safe_load(TRUTH.read_text())
    made["arm"] |= arm
    (tmp_path / "cell.yaml").write_text(yaml.safe_dump(made))
    return tmp_path / "cell.yaml"


def test_the_file_says_which_arm_stands_there_how_its_controller_counts_and_where_it_begins(tmp_path: Path) -> None:
    file = written(
        tmp_path, lengths_mm=[203.2, 0.0, -127.0, 203.2], start_deg=[0, 60, -150, 0, -40, 0],
        manners={"joint_signs": [1, -1, 1, 1, 1, 1], "newline": "\r"}, cold=True,
    )  # fmt: skip
    with SimulatedCell(file, seed=1) as cell:
        assert cell.arm.geometry.lengths_mm == (203.2, 0.0, -127.0, 203.2)
        with cell.server.controller() as controller:
            assert controller.question is not None
            printed = controller.machine.manners.printed_deg(controller.machine.joints())
    np.testing.assert_allclose(printed, [0, -60, -150, 0, -40, 0], atol=1e-9)


@pytest.mark.parametrize(
    ("arm", "told"),
    [
        ({"manners": {"ehco": False}}, "ehco: no such manner"),
        ({"manners": {"prompt_after_move": "never"}}, "prompt_after_move|Invalid enum"),
        ({"lengths_mm": [1.0, 2.0]}, "lengths_mm"),
    ],
)
def test_an_arm_that_cannot_be_is_told_with_its_file(tmp_path: Path, arm: dict[str, object], told: str) -> None:
    with pytest.raises(TruthError, match=rf"cell.yaml: .*{told}"):
        load_truth(written(tmp_path, **arm))


def test_cameras_are_on_the_hand_or_in_the_world() -> None:
    text = (folders.HOUSE / "etc" / "fixed" / "simcell.yaml").read_text()
    truth = load_truth(folders.HOUSE / "etc" / "fixed" / "simcell.yaml")
    for tool in (np.eye(4), np.diag([1.0, -1.0, -1.0, 1.0])):
        assert np.array_equal(truth.world_from_cyclopean_at(tool), np.array(truth.world_from_cyclopean))
    assert "tool_from_cyclopean" not in text
