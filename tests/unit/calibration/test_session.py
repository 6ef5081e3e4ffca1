"""What looks from new poses say of a calibration. In earnest: tests/cell/test_cell_calibrates.py."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Iterable, Sequence
from dataclasses import replace
from itertools import chain, count, repeat
from types import SimpleNamespace
from typing import Any
from unittest.mock import AsyncMock, Mock

import numpy as np
import pytest

from daemon import frames
from daemon.arm import MoveRefusedError, NotSettledError
from daemon.arm.permission import Refusal
from daemon.arrays import Array
from daemon.calibration import session
from daemon.calibration.arm_error import ArmError
from daemon.calibration.board import BoardError, DetectedBoard
from daemon.calibration.board_detection import find_board
from daemon.calibration.file import Calibration, Quality
from daemon.calibration.guide import BoardPose, missing_views
from daemon.calibration.hand_eye import MIN_TURN_DEG, cyclopean_from_board, diversity_deg
from daemon.calibration.session import (
    EPIPOLAR_LIMIT_PX,
    LENGTH_LIMIT_MM,
    MAX_VIEWS,
    SPREAD_LIMIT_MM,
    BoardView,
    SessionError,
    best_further_view,
    board_at_rest,
    board_capsules,
    plan_tour,
    sample_of,
    solve_camera,
    solve_hand_eye,
    solve_stereo,
    verify,
    view_tour,
)
from daemon.calibration.stereo import MIN_PAIRS, Pair, StereoError
from daemon.vision.geometry import Camera
from tests.fakes.boards import BOARD, drawn_board
from tests.fakes.rigs import unlike_rig


def test_one_camera_that_was_nowhere_far_enough_from_where_it_was_says_so() -> None:
    seen = find_board(drawn_board(), BOARD)
    views = [BoardView(np.eye(4), Pair(f"pose {k}", seen, None)) for k in range(4)]
    calibration = replace(Calibration(unlike_rig(), np.eye(4)), alone="left")
    with pytest.raises(SessionError, match="too near to each other, or too few"):
        verify(views, BOARD, calibration)


ORIGIN = np.zeros(3)
TOOL_FROM_CYCLOPEAN = frames.rigid(
    frames.rotation_from_vector(np.array([0.2, -0.1, 1.5])), np.array([-75.0, 3.0, -110.0])
)
WORLD_FROM_BOARD = frames.rigid(frames.rotation_from_vector(np.array([3.1, 0.05, 0.1])), np.array([520.0, 0, -300.0]))
CALIBRATION = Calibration(unlike_rig(), TOOL_FROM_CYCLOPEAN)


def seen_by(camera: Camera, cyclopean_from_board: Array) -> DetectedBoard:
    points = BOARD.points_mm()
    return DetectedBoard(np.arange(len(points)), camera.project(frames.apply(cyclopean_from_board, points)), 0.5)


def views_of_the_board(count: int = 6, stretched: float = 1.0, arm_mm: float = 0.0) -> list[BoardView]:
    """Looks without noise, a step of 40 mm apart; stretched: how much larger the board is than its description; arm_mm:
    how far the arm is from where it says that it is, to and fro along x."""
    found, centre = [], np.append(BOARD.points_mm()[:, :2].mean(axis=0), 0.0)
    for k in range(count):
        turn = frames.rotation_from_vector(np.array([0.3 * np.sin(k), 0.3 * np.cos(k), 0.0]))
        at = frames.rigid(turn, np.array([40.0 * (k % 3 - 1), 0.0, 300.0]) - turn @ centre)
        world_from_tool = WORLD_FROM_BOARD @ frames.inverse(at) @ frames.inverse(TOOL_FROM_CYCLOPEAN)
        told = frames.perturb(world_from_tool, np.array([arm_mm * (-1) ** k, 0, 0, 0, 0, 0]))
        at[:3, :3] *= stretched
        cameras = (seen_by(camera, at) for camera in (unlike_rig().left, unlike_rig().right))
        found.append(BoardView(told, Pair(f"pose {k}", *cameras)))
    return found


def failing(views: list[BoardView], calibration: Calibration = CALIBRATION) -> set[str]:
    return {failure.split()[0] for failure in verify(views, BOARD, calibration).failures}


def test_a_true_calibration_passes_and_of_one_that_is_wrong_each_figure_fails_from_its_limit_on() -> None:
    assert verify(views_of_the_board(), BOARD, CALIBRATION).passed
    half_a_board_mm = float(np.sqrt(np.mean(np.square(lengths_across_the_board()))))
    for share, fails in ((0.9, False), (1.1, True)):
        assert (
            "length" in failing(views_of_the_board(stretched=1 + share * LENGTH_LIMIT_MM / half_a_board_mm))
        ) is fails
        assert ("spread" in failing(views_of_the_board(arm_mm=share * SPREAD_LIMIT_MM))) is fails
        focal_px = float(unlike_rig().right.matrix[0, 0])
        turned = frames.perturb(unlike_rig().right.cyclopean_from_camera, turn_about_x(share / focal_px))
        rig = replace(unlike_rig(), right=replace(unlike_rig().right, cyclopean_from_camera=turned))
        gaps = verify(views_of_the_board(), BOARD, replace(CALIBRATION, rig=rig)).epipolar_px / share
        turned = frames.perturb(
            unlike_rig().right.cyclopean_from_camera, turn_about_x(share * EPIPOLAR_LIMIT_PX / gaps / focal_px)
        )
        rig = replace(rig, right=replace(rig.right, cyclopean_from_camera=turned))
        assert ("epipolar" in failing(views_of_the_board(), replace(CALIBRATION, rig=rig))) is fails


def lengths_across_the_board() -> Array:
    points = BOARD.points_mm()
    half = len(points) // 2
    return np.linalg.norm(points[half:] - points[: len(points) - half], axis=1)


def turn_about_x(angle_rad: float) -> Array:
    return np.array([0.0, 0.0, 0.0, angle_rad, 0.0, 0.0])


def test_fewer_than_four_poses_verify_nothing() -> None:
    with pytest.raises(SessionError, match="3 poses show the board, 4 are needed"):
        verify(views_of_the_board(3), BOARD, CALIBRATION)


def test_one_camera_that_the_arm_moves_verifies_as_a_pair() -> None:
    views = [replace(view, pair=replace(view.pair, right=None)) for view in views_of_the_board()]
    told = verify(views, BOARD, replace(CALIBRATION, alone="left"))
    assert told.passed
    assert told.length_mm < 0.01


def session_of(**more: Any) -> Any:
    """A session whose arm and cameras are played: a clock that goes on by a second a look."""
    seconds = count()
    cell = SimpleNamespace(clock=lambda: float(next(seconds)))

    async def now(name: str, job: Awaitable[list[BoardView]], moves: bool = True) -> list[BoardView]:
        return await job

    mover = SimpleNamespace(cell=cell, reach=SimpleNamespace(allows=lambda _: True), dry=False, here=None, **more)
    supervisor = SimpleNamespace(mover=mover, run=now, refuse_unless_permitted=lambda: None)
    return SimpleNamespace(
        board_in_gripper=False,
        supervisor=supervisor,
        board=BOARD,
        calibration=CALIBRATION,
        prepare_to_move=AsyncMock(return_value="here"),
    )


def shown_by_hand(monkeypatch: pytest.MonkeyPatch, looks: Iterable[BoardView | Exception]) -> tuple[list[Any], str]:
    """The views that are kept where the board is seen so, or the error; and what was said."""
    looks, said = iter(looks), AsyncMock()

    async def see(_: Any, __: Any, ___: str) -> BoardView:
        look = next(looks)
        if isinstance(look, Exception):
            raise look
        return look

    monkeypatch.setattr(session, "see_board", see)
    kept: list[Any] = asyncio.run(session.views_by_hand(session_of(), said))
    return kept, "\n".join(call.args[0] for call in said.await_args_list)


def held(tilts: Sequence[Array], far_mm: float = 300.0, aside_mm: Array = ORIGIN) -> list[BoardView]:
    centre = np.append(BOARD.points_mm()[:, :2].mean(axis=0), 0.0)
    found = []
    for tilt in tilts:
        turn = frames.rotation_from_vector(np.append(tilt, 0.0))
        at = frames.rigid(turn, np.array([0.0, 0.0, far_mm]) + aside_mm - turn @ centre)
        cameras = (seen_by(camera, at) for camera in (unlike_rig().left, unlike_rig().right))
        found.append(BoardView(np.eye(4), Pair(f"at {tilt}", *cameras)))
    return found


def all_kinds() -> list[BoardView]:
    """What a person shows who does all that is asked for: tilted each way, in each corner, near and far."""
    tilts = [np.array(tilt) for tilt in ([0.5, 0.0], [-0.5, 0.0], [0.0, 0.5], [0.0, -0.5])]
    corners = [np.array([x, y, 0.0]) for x in (-90.0, 90.0) for y in (-65.0, 65.0)]
    return [*held(tilts), *(view for at in corners for view in held([np.zeros(2)], 300.0, at)), *held(tilts[:1], 420.0)]


def test_a_board_held_by_hand_counts_once_a_view_and_what_is_still_missing_is_said(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    views = all_kinds()
    blurred = [BoardError("blurred"), BoardError("blurred"), NotSettledError("it moves")]
    looks: list[Any] = [*blurred, *(look for view in views for look in (view, view))]
    kept, said = shown_by_hand(monkeypatch, looks)
    assert kept == views
    assert said.count("blurred") == said.count("it moves") == 1
    for number in range(1, len(views) + 1):
        assert said.count(f"view {number}") == 1
        residual = f"view {number}, residual 0.00 px so far; next:" in said
        assert residual is (number >= MIN_PAIRS and number % 3 == 0)
    assert f"view 1; next: {missing_views(shown_of(views[:1]))[0]}" in said
    assert said.endswith("next: done")


def shown_of(views: Sequence[BoardView]) -> list[BoardPose]:
    size = np.array(unlike_rig().image_size, float)
    return [
        BoardPose(cyclopean_from_board(sample_of(v, BOARD), unlike_rig()), v.pair.left.corners_px / size) for v in views
    ]


def test_who_shows_nothing_new_is_told_what_is_missing_and_who_shows_the_same_kind_on_and_on_comes_to_an_end(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    first = held([np.zeros(2)])
    with pytest.raises(SessionError, match=r"no new view for 60 s; 1 so far, missing: tilt the board.*, and then"):
        shown_by_hand(monkeypatch, chain(first, repeat(first[0], 61)))
    monkeypatch.setattr(session, "calibrate_stereo", Mock(side_effect=StereoError("too similar")))
    on_and_on = (view for k in count() for view in held([np.full(2, 0.05)], 250.0 + 41.0 * k))
    kept, _ = shown_by_hand(monkeypatch, on_and_on)
    assert len(kept) == MAX_VIEWS


async def _never(*_: Any) -> None:
    raise AssertionError("the arm moved")


def toured(monkeypatch: pytest.MonkeyPatch, poses: int, out_of_reach: int, unseen: int) -> tuple[Any, Any, str]:
    """The views of a tour, where the arm was sent, and what was said; a pose that the arm does not reach, and one from
    which the board is not seen."""
    sent, said = list[Array](), AsyncMock()
    first, *others = views_of_the_board(poses + 1)

    async def travel(pose: Array, _: str, speed: Callable[[Array], float]) -> None:
        sent.append(pose)
        assert speed(pose) == 40.0
        if len(sent) == out_of_reach:
            raise MoveRefusedError(Refusal("keep-out", "post"))

    async def see(_: Any, reading: Any, name: str) -> BoardView:
        if name == f"pose {unseen}":
            raise BoardError("blurred")
        return first if name == "pose 0" else others[int(name.removeprefix("pose ")) - 1]

    monkeypatch.setattr(session, "see_board", see)
    one = session_of(travel=travel)
    one.supervisor.mover.next_start = "there"
    return asyncio.run(view_tour(one, poses, said, 40.0)), sent, "\n".join(c.args[0] for c in said.await_args_list)


def test_a_tour_leaves_out_what_it_cannot_reach_or_see_and_comes_back(monkeypatch: pytest.MonkeyPatch) -> None:
    seen, sent, said = toured(monkeypatch, 9, out_of_reach=2, unseen=5)
    assert [view.pair.name for view in seen] == [f"pose {k}" for k in (0, 1, 3, 4, 6, 7, 8, 9)]
    assert len(sent) == 10
    np.testing.assert_array_equal(sent[-1], seen[0].world_from_tool)
    assert "pose 2 of 9: left out: keep-out: post" in said
    assert "pose 5 of 9: not used: blurred" in said
    assert said.count(": seen") == 7
    seen, _, said = toured(monkeypatch, 8, out_of_reach=9, unseen=20)
    assert len(seen) == 9
    assert "the arm did not return to its first pose: keep-out: post" in said
    assert len(toured(monkeypatch, 0, out_of_reach=20, unseen=20)[1]) == 0
    with pytest.raises(SessionError, match="from here the cameras do not see the board: blurred"):
        toured(monkeypatch, 8, out_of_reach=20, unseen=0)


def test_a_tour_without_a_rough_hand_eye_is_refused_before_the_arm_is_asked() -> None:
    one = session_of(travel=_never)
    one.calibration = Calibration(unlike_rig())
    with pytest.raises(SessionError, match="enter a rough one"):
        asyncio.run(view_tour(one, 8, AsyncMock(), 40.0))
    assert not one.prepare_to_move.called


def test_what_is_solved_from_views_is_their_camera_their_pair_and_their_hand_eye() -> None:
    views, before = views_of_the_board(8), Calibration(unlike_rig(), np.eye(4), Quality(epipolar_px=0.5))
    found, _ = solve_stereo(views, BOARD, before)
    assert found.rig.baseline_mm == pytest.approx(unlike_rig().baseline_mm, abs=1e-3)
    assert found.tool_from_cyclopean is before.tool_from_cyclopean
    found, result = solve_hand_eye(views, BOARD, before)
    np.testing.assert_allclose(found.tool_from_cyclopean, TOOL_FROM_CYCLOPEAN, atol=0.01)
    assert (found.quality.epipolar_px, found.quality.views, found.quality.method) == (0.5, 8, "hand-eye")
    assert found.quality.hand_eye_mm == pytest.approx(result.sigma_mm, abs=1e-4)
    alone = [replace(view, pair=replace(view.pair, right=None)) for view in views]
    one, camera = solve_camera(alone, BOARD, before)
    assert one.alone == "left"
    assert one.rig.left.matrix[0, 0] == pytest.approx(unlike_rig().left.matrix[0, 0], rel=1e-3)
    assert (one.quality.views, one.quality.method) == (len(camera.used), "one camera")


def planned(count: int, allowed: Callable[[Array], bool], mounting_alone: bool) -> list[Array]:
    reach: Any = SimpleNamespace(allows=allowed)
    supervisor = SimpleNamespace(mover=SimpleNamespace(reach=reach))
    session: Any = SimpleNamespace(calibration=CALIBRATION, board=BOARD, supervisor=supervisor, board_in_gripper=False)
    return plan_tour(session, reach, views_of_the_board(1)[0], count, mounting_alone)


@pytest.mark.parametrize("mounting_alone", [False, True])
@pytest.mark.parametrize(("count", "reached", "enough"), [(12, 12, True), (12, 8, True), (12, 7, False), (4, 3, False)])
def test_a_tour_of_too_few_poses_is_refused_and_none_is_of_one_pose_over_and_over(
    count: int, reached: int, enough: bool, mounting_alone: bool
) -> None:
    left = iter(range(reached))
    if not enough:
        with pytest.raises(SessionError, match=f"the arm reaches only {reached} poses around the board"):
            planned(count, lambda _: next(left, None) is not None, mounting_alone)
        return
    poses = planned(count, lambda _: next(left, None) is not None, mounting_alone)
    assert len({pose.tobytes() for pose in poses}) == reached
    assert diversity_deg(poses) > MIN_TURN_DEG


OVER = frames.rigid(np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]]), np.array([520.0, 0.0, 300.0]))
TURN = frames.rotation_from_vector(np.array([0.05, -0.03, 1.6]))
HELD = frames.rigid(TURN, np.array([-60.0, -64.0, 0.0]))


def held_view(world_from_tool: Array) -> BoardView:
    """The board in the gripper, seen by fixed cameras."""
    camera_from_board = frames.inverse(OVER) @ world_from_tool @ HELD
    seen = [seen_by(camera, camera_from_board) for camera in (CALIBRATION.rig.left, CALIBRATION.rig.right)]
    return BoardView(world_from_tool, Pair("held", *seen))


FIXED = replace(CALIBRATION, tool_from_cyclopean=None, world_from_cyclopean=OVER)
GRIPPER_DOWN = frames.rigid(np.diag([1.0, -1.0, -1.0]), np.array([600.0, -10.0, -120.0]))


@pytest.mark.parametrize("mounting_alone", [False, True])
def test_before_fixed_cameras_the_arm_turns_the_board_and_keeps_it_in_their_view(mounting_alone: bool) -> None:
    supervisor = SimpleNamespace(mover=SimpleNamespace(reach=SimpleNamespace(allows=lambda _: True)))
    session: Any = SimpleNamespace(calibration=FIXED, board=BOARD, supervisor=supervisor, board_in_gripper=True)
    first = held_view(GRIPPER_DOWN)
    np.testing.assert_allclose(board_at_rest(first, BOARD, FIXED), HELD, atol=0.05)
    poses = plan_tour(session, supervisor.mover.reach, first, 16, mounting_alone)
    assert diversity_deg(poses) > MIN_TURN_DEG
    middles = [frames.apply(frames.inverse(OVER) @ pose @ HELD, BOARD.points_mm().mean(axis=0)) for pose in poses]
    assert np.ptp([z for _, _, z in middles]) > 80.0
    for x, y, z in middles:
        assert 0.8 * 420.0 < z < 1.2 * 420.0
        assert max(abs(x), abs(y)) < 0.21 * 420.0


def test_of_a_few_poses_that_differ_little_the_further_view_that_helps_most_is_tilted_and_helps() -> None:
    views = views_of_the_board(9)
    reach: Any = SimpleNamespace(allows=lambda _: True)
    few, many = (best_further_view(some, BOARD, CALIBRATION, ArmError(), reach) for some in (views[:3], views))
    assert few is not None
    assert many is not None
    assert few.after_mm < 0.8 * few.before_mm
    assert many.before_mm < few.before_mm
    assert many.after_mm < many.before_mm
    assert many.before_mm - many.after_mm < few.before_mm - few.after_mm
    assert few.tilt_deg > 15.0
    assert 200.0 < few.away_mm < 450.0
    nowhere: Any = SimpleNamespace(allows=lambda _: False)
    assert best_further_view(views, BOARD, CALIBRATION, ArmError(), nowhere) is None


def test_the_guard_knows_the_board_in_the_gripper_with_its_rim() -> None:
    load = board_capsules(SimpleNamespace(calibration=FIXED, board=BOARD), held_view(GRIPPER_DOWN))  # type: ignore[arg-type]
    around = load[-1]
    axis = np.array([around.from_mm, around.to_mm])
    for corner in frames.apply(HELD, BOARD.points_mm()):
        along = np.clip((corner - axis[0]) @ np.ptp(axis, axis=0), 0, None)
        assert np.linalg.norm(corner - axis.mean(axis=0)) < around.radius_mm + np.linalg.norm(np.diff(axis, axis=0)) / 2
        assert np.isfinite(along)
    spread = np.ptp([piece.from_mm for piece in load[:-1]], axis=0)
    board = np.ptp(frames.apply(HELD, BOARD.points_mm()), axis=0)
    assert (spread[:2] >= board[:2] + 4 * BOARD.square_mm).all()


def test_fixed_cameras_are_solved_with_what_the_pick_needs_of_arm_and_place() -> None:
    rng = np.random.default_rng(3)
    turns = [
        frames.rotation_from_vector(np.array([*rng.uniform(-0.4, 0.4, 2), rng.uniform(-0.5, 0.5)])) for _ in range(9)
    ]
    views = [held_view(GRIPPER_DOWN @ frames.rigid(turn, rng.uniform(-20, 20, 3))) for turn in turns]
    rough = replace(FIXED, world_from_cyclopean=frames.perturb(OVER, np.array([9.0, -7, 8, 0.02, -0.01, 0.02])))
    after, result = solve_hand_eye(views, BOARD, rough)
    np.testing.assert_allclose(after.world_from_cyclopean, OVER, atol=0.05)
    assert after.tool_from_cyclopean is None
    assert after.quality.about_mm == tuple(result.about_mm.round(1))
    assert after.quality.arm_mm == round(result.arm.mm, 4)
    assert verify(views, BOARD, after).passed
    knocked = replace(after, world_from_cyclopean=frames.perturb(OVER, np.array([0.0, 0, 0, 0.01, 0, 0])))
    assert any(failure.startswith("spread") for failure in verify(views, BOARD, knocked).failures)


@pytest.mark.parametrize("alone", [None, "left"])
def test_the_board_is_sought_in_the_pictures_of_the_cameras_in_use_and_both_are_logged(
    alone: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    logged: list[dict[str, Any]] = []
    pictures = SimpleNamespace(left=SimpleNamespace(pixels="left's"), right=SimpleNamespace(pixels="right's"))

    async def settled(*_: object) -> Any:
        return SimpleNamespace(pictures=pictures)

    monkeypatch.setattr(session, "settled_pair", settled)
    ids = {"left's": np.arange(20), "right's": np.arange(12, 54)}
    monkeypatch.setattr(
        session, "find_board", lambda pixels, _: DetectedBoard(ids[pixels], np.zeros((len(ids[pixels]), 2)), 1)
    )
    log = SimpleNamespace(record=lambda kind, **fields: logged.append({"kind": kind, **fields}))
    cell = SimpleNamespace(clock=lambda: 0.0, log=log, alone=alone)
    supervisor = SimpleNamespace(mover=SimpleNamespace(cell=cell))
    one: Any = SimpleNamespace(supervisor=supervisor, settling=None, board=BOARD)
    there: Any = SimpleNamespace(world_from_tool=np.eye(4))
    view = asyncio.run(session.see_board(one, there, "pose 3"))
    assert view.pair.left.corner_ids is ids["left's"]
    assert (view.pair.right is None) is (alone is not None)
    assert (view.pair.name, logged[0]["purpose"]) == ("pose 3", "calibrate pose 3")
    assert logged[0]["images"] == {"left": "left's", "right": "right's"}
    assert view.world_from_tool is logged[0]["where"] is there.world_from_tool
    ids["left's"] = np.arange(19)
    if alone is None:
        assert view.pair.right.corner_ids is ids["right's"]
        with pytest.raises(BoardError, match="share 7 of its corners"):  # the tour goes on without it
            asyncio.run(session.see_board(one, there, "pose 4"))
