"""Calibration with the arm: move around the board, view it from each pose, solve; verify a calibration.

The supervisor runs a tour as a job, and the guard checks each of its moves. tour.py chooses the poses; stereo.py,
camera.py and hand_eye.py solve.
"""

import asyncio
from collections.abc import Awaitable, Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product

import numpy as np

from daemon import frames
from daemon.arm import (
    BeliefSource,
    Capsule,
    MoveRefusedError,
    NotSettledError,
    OutOfReachError,
    Reach,
    Reading,
    RefusedError,
    Settling,
    Supervisor,
    carried_part,
    settled_pair,
)
from daemon.arrays import Array
from daemon.calibration.arm_error import ArmError
from daemon.calibration.board import Board, BoardError
from daemon.calibration.board_detection import find_board
from daemon.calibration.camera import CameraResult, calibrate_camera
from daemon.calibration.file import Calibration, Quality, calibration_of, now, rig_of_one
from daemon.calibration.guide import BoardPose, is_new_view, missing_views
from daemon.calibration.hand_eye import HandEyeResult, Sample, calibrate_hand_eye, cyclopean_from_board
from daemon.calibration.informative_poses import Setup, error_mm, information, most_informative
from daemon.calibration.least_squares import MatchedCorners
from daemon.calibration.stereo import (
    MIN_PAIRS,
    Pair,
    StereoError,
    StereoResult,
    calibrate_stereo,
    epipolar_distances,
    match_corners,
)
from daemon.calibration.tour import (
    AIMS_MM,
    DISTANCES_MM,
    FIXED_AIMS,
    FIXED_ASIDE,
    FIXED_DISTANCES,
    choose_spread,
    shortest_order,
    viewpoints_around,
)
from daemon.errors import FacetdError
from daemon.pick.moved_pair import SHORTEST_MM
from daemon.vision.geometry import StereoRig

Say = Callable[[str], Awaitable[None]]
MARGIN_SQUARES, PLATE_MM = 2.5, 10.0
"""Size of a board in the gripper beyond its inner corners, in squares, and across its face, mm."""


class SessionError(FacetdError):
    """The calibration cannot continue; the message says why, and what to do."""


@dataclass(frozen=True, eq=False)
class BoardView:
    """A view of the board by the cameras in use: world_from_tool (4, 4) as WHERE reported it."""

    world_from_tool: Array
    pair: Pair


@dataclass(frozen=True, eq=False)
class CalibrationSession:
    """The arm and its first reading, the limits for still images, the board, the calibration so far;
    board_in_gripper: whether the gripper holds the board, before fixed cameras."""

    supervisor: Supervisor
    prepare_to_move: Callable[[], Awaitable[Reading]]
    settling: Settling
    board: Board
    calibration: Calibration
    board_in_gripper: bool = False


async def view_tour(
    session: CalibrationSession, count: int, say: Say, speed_pct: float, mounting_alone: bool = False
) -> list[BoardView]:
    """Move to `count` poses around the board and view it from each, as one job of the supervisor.

    mounting_alone: choose the poses that tell most about the hand-eye, not those that differ most, which determine the
    lenses and the stereo pair too. The first view is from the present pose, to which the arm returns; with a count of 0
    it is the only one. Raises SessionError where the board is not in view from here or too few poses are in reach, and
    what the arm raises.
    """
    return await session.supervisor.run("calibrate", _tour(session, count, say, speed_pct, mounting_alone))


async def _tour(
    session: CalibrationSession, count: int, say: Say, speed_pct: float, mounting_alone: bool
) -> list[BoardView]:
    mover = session.supervisor.mover
    session.supervisor.refuse_unless_permitted()
    if mover.dry:
        raise RefusedError(
            "`dry` is on, so the arm does not move, and one pose is not enough to calibrate: type `dry off`"
        )
    if session.calibration.hand_eye is None:
        raise SessionError("no hand_eye in calibration.yaml: enter a rough one, measured by ruler")
    reading = await session.prepare_to_move()
    try:
        first = await see_board(session, reading, "pose 0")
    except BoardError as error:
        raise SessionError(f"from here the cameras do not see the board: {error}") from None
    if count == 0:
        return [first]
    if session.board_in_gripper:
        mover.beliefs.learn(BeliefSource.OBSERVED, holding=True, held_shape=board_capsules(session, first))
    poses = await asyncio.to_thread(plan_tour, session, mover.reach, first, count, mounting_alone)
    await say(f"The board is in view. {len(poses)} poses around it follow; control-C stops the arm at any moment.")
    views = [first]
    for number, pose in enumerate(poses, start=1):
        try:
            await mover.travel(pose, f"calibration pose {number}", lambda _: speed_pct)
        except (OutOfReachError, MoveRefusedError) as error:
            await say(f"pose {number} of {len(poses)}: left out: {error}")
            continue
        assert mover.next_start is not None
        try:
            views.append(await see_board(session, mover.next_start, f"pose {number}"))
            await say(f"pose {number} of {len(poses)}: seen")
        except BoardError as error:
            await say(f"pose {number} of {len(poses)}: not used: {error}")
    try:  # the next calibration, too, starts from a pose with the whole board in view
        await mover.travel(first.world_from_tool, "back from the calibration poses", lambda _: speed_pct)
    except (OutOfReachError, MoveRefusedError) as error:
        await say(f"the arm did not return to its first pose: {error}")
    return views


def plan_tour(
    session: CalibrationSession, reach: Reach, first: BoardView, count: int, mounting_alone: bool
) -> list[Array]:
    """Poses world_from_tool of the tour."""
    here = session.calibration.world_from_cyclopean_at(first.world_from_tool)
    looks = _around(first, session.board, session.calibration)
    if mounting_alone:
        setup = setup_of([first], session.board, session.calibration, ArmError())
        tools = _tool_at(np.array(looks), first, session.calibration)
        chosen = [looks[k] for k in most_informative(setup, tools, count, reach.allows, [first.world_from_tool])]
    else:
        chosen = choose_spread(
            looks, count, lambda look: reach.allows(_tool_at(look, first, session.calibration)), here
        )
    if len(chosen) < min(count, 8):
        raise SessionError(f"the arm reaches only {len(chosen)} poses around the board; move it nearer to the middle")
    return [_tool_at(look, first, session.calibration) for look in shortest_order(chosen, here)]


def _around(view: BoardView, board: Board, calibration: Calibration) -> list[Array]:
    """Poses (4, 4) of the cameras around the board as a view shows it, for a board at rest."""
    here = calibration.world_from_cyclopean_at(view.world_from_tool)
    world_from_board = board_in_world(view, board, calibration)
    centre = board.points_mm().mean(axis=0)
    sizes: tuple[Sequence[float], Sequence[tuple[float, float]]] = (DISTANCES_MM, AIMS_MM)
    if calibration.fixed:
        away_mm = float(frames.apply(frames.inverse(here) @ world_from_board, centre)[2])
        aside_mm = FIXED_ASIDE * away_mm
        sizes = [share * away_mm for share in FIXED_DISTANCES], [(x * aside_mm, y * aside_mm) for x, y in FIXED_AIMS]
    return viewpoints_around(world_from_board, centre, here[:3, 0], *sizes)


def _tool_at(look: Array, view: BoardView, calibration: Calibration) -> Array:
    """world_from_tool that puts the cameras at looks (..., 4, 4) or, before fixed cameras, the board in the gripper."""
    here = calibration.world_from_cyclopean_at(view.world_from_tool)
    if calibration.fixed:
        return np.asarray(here @ frames.inverse(look) @ view.world_from_tool)
    return np.asarray(look @ frames.inverse(here) @ view.world_from_tool)


@dataclass(frozen=True)
class FurtherView:
    """The further view that would make a hand-eye surest: away_mm from the cameras to the middle of the board, and how
    far that is tilted; rms error where parts are, in mm, that all views leave by chance, without and with it."""

    away_mm: float
    tilt_deg: float
    before_mm: float
    after_mm: float


def best_further_view(
    views: Sequence[BoardView], board: Board, calibration: Calibration, arm: ArmError, reach: Reach
) -> FurtherView | None:
    """Find the further view that would improve most on the calibration that these views gave. None where the arm
    reaches no further pose around the board."""
    setup = setup_of(views, board, calibration, arm)
    looks = _around(views[-1], board, calibration)
    tools = _tool_at(np.array(looks), views[-1], calibration)
    done = [view.world_from_tool for view in views]
    best = most_informative(setup, tools, 1, reach.allows, done)
    if not best:
        return None
    look_from_board = frames.inverse(looks[best[0]]) @ board_in_world(views[-1], board, calibration)
    middle = frames.apply(look_from_board, board.points_mm().mean(axis=0))
    adds, _ = information(setup, [*done, tools[best[0]]])
    before_mm, after_mm = (float(error_mm(setup, total)) for total in (adds[:-1].sum(axis=0), adds.sum(axis=0)))
    tilt_deg = float(np.degrees(np.arccos(min(abs(look_from_board[2, 2]), 1.0))))
    return FurtherView(float(np.linalg.norm(middle)), tilt_deg, before_mm, after_mm)


def setup_of(views: Sequence[BoardView], board: Board, calibration: Calibration, arm: ArmError) -> Setup:
    """The setup by which further poses are rated: the calibration's hand-eye, the board where the last view shows it,
    and parts as far away as the board."""
    assert calibration.hand_eye is not None
    away_mm = float(np.median([cyclopean_from_board(sample_of(v, board), calibration.rig)[2, 3] for v in views]))
    return Setup(
        calibration.rig,
        calibration.hand_eye,
        board_at_rest(views[-1], board, calibration),
        board.points_mm(),
        frames.apply(calibration.hand_eye, np.array([0.0, 0.0, away_mm])),
        calibration.fixed,
        arm,
        2 if calibration.alone is None else 1,
    )


def board_capsules(session: CalibrationSession, first: BoardView) -> tuple[Capsule, ...]:
    """Return the capsules that the guard is to keep clear for the board in the gripper: its corners with a margin for
    print and plate, and for a hand-eye by ruler."""
    board = session.board
    low, high = (np.array(end(board.points_mm(), axis=0)) for end in (np.min, np.max))
    margin = np.array([MARGIN_SQUARES * board.square_mm] * 2 + [PLATE_MM])
    corners = np.array(list(product(*zip(low - margin, high + margin, strict=True))))
    tool_from_board = board_at_rest(first, board, session.calibration)
    return carried_part(frames.apply(tool_from_board, corners), "the board in the gripper")


async def see_board(session: CalibrationSession, reading: Reading, name: str) -> BoardView:
    """Capture a settled pair and find the board in the images of the cameras in use. Raises BoardError, also where they
    share too few corners."""
    cell = session.supervisor.mover.cell
    pictures = (await settled_pair(cell, cell.clock(), session.settling)).pictures
    cell.log.record(
        "look",
        cycle=0,
        stop=0,
        purpose=f"calibrate {name}",
        images={"left": pictures.left.pixels, "right": pictures.right.pixels},
        where=reading.world_from_tool,
    )
    left = await asyncio.to_thread(find_board, pictures.left.pixels, session.board)
    right = None
    if cell.alone is None:
        right = await asyncio.to_thread(find_board, pictures.right.pixels, session.board)
    pair = Pair(name, left, right)
    if right is not None:
        match_corners(pair, session.board)
    return BoardView(reading.world_from_tool, pair)


async def views_by_hand(session: CalibrationSession, say: Say) -> list[BoardView]:
    """Collect views of a board that a person holds, and say which views are missing. The arm does not move; `stop` or
    `abort` ends it.

    Raises SessionError where no new view comes for PATIENCE_S.
    """
    return await session.supervisor.run("calibrate by hand", _collect_by_hand(session, say), moves=False)


PATIENCE_S, MAX_VIEWS = 60.0, 40


async def _collect_by_hand(session: CalibrationSession, say: Say) -> list[BoardView]:
    views, board_poses = list[BoardView](), list[BoardPose]()
    board, calibration, clock = session.board, session.calibration, session.supervisor.mover.cell.clock
    last_s, reported = clock(), ""
    nowhere = Reading(np.eye(4), np.zeros(6))
    size = np.array(calibration.rig.image_size, float)
    await say("Show the board to both cameras. Hold it still for a moment: then the view counts.")
    while len(views) < MAX_VIEWS and (
        lacking := missing_views(board_poses) or ["a few more"] * (len(views) < MIN_PAIRS + 2)
    ):
        if clock() - last_s > PATIENCE_S:
            raise SessionError(
                f"no new view for {PATIENCE_S:.0f} s; {len(views)} so far, missing: {'; '.join(lacking)}"
            )
        try:
            view = await see_board(session, nowhere, f"view {len(views) + 1}")
        except (BoardError, NotSettledError) as error:
            if str(error) != reported:
                await say(f"  {error}")
            reported = str(error)
            continue
        pose = cyclopean_from_board(sample_of(view, board), calibration.rig)
        if not is_new_view(board_poses, pose):
            continue
        views.append(view)
        board_poses.append(BoardPose(pose, view.pair.left.corners_px / size))
        last_s, reported = clock(), ""
        next_ = (missing_views(board_poses) or ["done"])[0]
        await say(f"view {len(views)}{await _interim_residual(views, board, calibration)}; next: {next_}")
    return views


async def _interim_residual(views: list[BoardView], board: Board, calibration: Calibration) -> str:
    """The reprojection error so far, at every third view once there are enough."""
    if len(views) < MIN_PAIRS or len(views) % 3:
        return ""
    try:
        result = await asyncio.to_thread(calibrate_stereo, [v.pair for v in views], board, calibration.rig.image_size)
    except StereoError:
        return ""
    return f", residual {result.stereo_rms_px:.2f} px so far"


def solve_stereo(views: Sequence[BoardView], board: Board, before: Calibration) -> tuple[Calibration, StereoResult]:
    """Stereo calibration from the views; the old hand-eye stays, and needs a new calibration. Raises StereoError."""
    result = calibrate_stereo([v.pair for v in views], board, before.rig.image_size)
    return calibration_of(result, before), result


def solve_camera(views: Sequence[BoardView], board: Board, before: Calibration) -> tuple[Calibration, CameraResult]:
    """Calibration of the only camera from the views; the hand-eye needs a new one. Raises StereoError."""
    result = calibrate_camera([(v.pair.name, v.pair.left) for v in views], board, before.rig.image_size)
    quality = Quality(reprojection_px=round(result.rms_px, 4), views=len(result.used), method="one camera", made=now())
    rig = rig_of_one(result.camera, before.rig.image_size)
    return replace(before, rig=rig, quality=quality, alone="left", world_from_cyclopean=None), result


def solve_hand_eye(views: Sequence[BoardView], board: Board, before: Calibration) -> tuple[Calibration, HandEyeResult]:
    """Hand-eye calibration from the views. Raises HandEyeError."""
    board_in_gripper = before.fixed
    result = calibrate_hand_eye(
        [replace(sample_of(v, board), board_in_gripper=board_in_gripper) for v in views], before.rig
    )
    quality = Quality(
        reprojection_px=before.quality.reprojection_px,
        epipolar_px=before.quality.epipolar_px,
        hand_eye_mm=round(result.sigma_mm, 4),
        hand_eye_deg=round(result.sigma_deg, 4),
        about_mm=None if result.about_mm is None else tuple(result.about_mm.round(1).tolist()),
        arm_mm=round(result.arm.mm, 4) if board_in_gripper else None,
        arm_deg=round(result.arm.deg, 4) if board_in_gripper else None,
        views=len(views),
        method=before.quality.method or "hand-eye",
        made=now(),
    )
    if board_in_gripper:
        return replace(before, quality=quality, world_from_cyclopean=result.mounting), result
    return replace(before, quality=quality, tool_from_cyclopean=result.mounting), result


@dataclass(frozen=True)
class VerificationResult:
    """Errors of a calibration in views that were not used for it. scale_error: relative error of known lengths;
    length_mm: rms error of the distances between corners; epipolar_px: mean; spread_mm: rms distance of the board's
    corners, where it is fastened, from their mean over the poses; failures: figures out of their limits, with the
    remedy."""

    poses: int
    scale_error: float
    length_mm: float
    epipolar_px: float
    spread_mm: float
    failures: tuple[str, ...]

    @property
    def passed(self) -> bool:
        """Whether all figures are within their limits."""
        return not self.failures


LENGTH_LIMIT_MM, EPIPOLAR_LIMIT_PX, SPREAD_LIMIT_MM = 0.3, 0.3, 0.6


def verify(views: Sequence[BoardView], board: Board, calibration: Calibration) -> VerificationResult:
    """Verify a calibration with views of a board of known size. With one camera each two consecutive poses are a pair,
    whose epipolar limit includes the arm's error. Raises SessionError with fewer than 4 views, or no pair."""
    if len(views) < 4:
        raise SessionError(f"{len(views)} poses show the board, 4 are needed to verify")
    ratios, errors, gaps, corners = [], [], [], []
    for rig, match in _stereo_views(views, board, calibration):
        seen = triangulate(rig, match.left_px, match.right_px)
        found, true = _distances(seen), _distances(match.points_mm)
        ratios.append(found.sum() / true.sum())
        errors.append(found - true)
        gaps.append(epipolar_distances(rig, match.left_px, match.right_px))
    if not errors:
        raise SessionError(
            "no two poses in succession give a stereo pair (too near to each other, or too few common corners): put "
            "the board where both cameras see it whole, and repeat"
        )
    for view in views:
        corners.append(frames.apply(board_at_rest(view, board, calibration), board.points_mm()))
    placed = np.array(corners)
    epipolar_px = EPIPOLAR_LIMIT_PX
    if calibration.alone is not None:
        arm_px = np.sqrt(2) * np.radians(ArmError().deg) * calibration.rig.left.matrix[0, 0]
        epipolar_px = float(np.hypot(epipolar_px, arm_px))
    figures = {
        "length": float(np.sqrt(np.mean(np.concatenate(errors) ** 2))),
        "epipolar": float(np.mean(np.concatenate(gaps))),
        "spread": float(np.sqrt(((placed - placed.mean(axis=0)) ** 2).sum(axis=2).mean())),
    }
    limits = (
        ("length", LENGTH_LIMIT_MM, "mm", "calibrate stereo, and check the board's square size"),
        ("epipolar", epipolar_px, "px", "a camera has moved: calibrate stereo (with one camera: calibrate camera)"),
        ("spread", SPREAD_LIMIT_MM, "mm", "tighten the bracket, and calibrate hand-eye"),
    )
    failures = tuple(
        f"{name} {figures[name]:.2f} {unit}, limit {limit:.2g}: {remedy}"
        for name, limit, unit, remedy in limits
        if figures[name] > limit
    )
    scale = float(np.mean(ratios)) - 1.0
    return VerificationResult(len(views), scale, figures["length"], figures["epipolar"], figures["spread"], failures)


def _stereo_views(
    views: Sequence[BoardView], board: Board, calibration: Calibration
) -> Iterator[tuple[StereoRig, MatchedCorners]]:
    if calibration.alone is None:
        for view in views:
            yield calibration.rig, match_corners(view.pair, board)
        return
    assert calibration.tool_from_cyclopean is not None
    camera = calibration.rig.left
    tool_from_camera = calibration.tool_from_cyclopean @ camera.cyclopean_from_camera
    for one, next_ in pairwise(views):
        cameras = [
            replace(camera, cyclopean_from_camera=view.world_from_tool @ tool_from_camera) for view in (one, next_)
        ]
        rig = StereoRig(cameras[0], cameras[1], calibration.rig.image_size)
        if rig.baseline_mm >= SHORTEST_MM:
            try:
                match = match_corners(replace(one.pair, right=next_.pair.left), board)
            except BoardError:  # the two poses show different parts of the board
                continue
            yield rig, match


def triangulate(rig: StereoRig, left_px: Array, right_px: Array) -> Array:
    """Triangulate matched corners: (N, 3) mm, cyclopean, midway along the shortest line between the two rays, which of
    a moved pair pass each other by the arm's errors."""
    points = []
    ends = [camera.cyclopean_from_camera for camera in (rig.left, rig.right)]
    for p, q in zip(rig.left.normalised(left_px), rig.right.normalised(right_px), strict=True):
        a, b = (end[:3, :3] @ np.append(ray, 1.0) for end, ray in zip(ends, (p, q), strict=True))
        s, t = np.linalg.lstsq(np.column_stack([a, -b]), ends[1][:3, 3] - ends[0][:3, 3], rcond=None)[0]
        points.append((ends[0][:3, 3] + s * a + ends[1][:3, 3] + t * b) / 2)
    return np.array(points)


def _distances(points: Array) -> Array:
    """Distances between corners half a board apart: long ones, sensitive to an error of scale."""
    half = len(points) // 2
    return np.asarray(np.linalg.norm(points[half:] - points[: len(points) - half], axis=1))


def board_in_world(view: BoardView, board: Board, calibration: Calibration) -> Array:
    """world_from_board (4, 4) from one view. The calibration must have a hand-eye."""
    seen = cyclopean_from_board(sample_of(view, board), calibration.rig)
    return calibration.world_from_cyclopean_at(view.world_from_tool) @ seen


def board_at_rest(view: BoardView, board: Board, calibration: Calibration) -> Array:
    """(4, 4) of the board where it is fastened, by one view: in the world, or before fixed cameras on the tool. The
    calibration must have a hand-eye."""
    there = board_in_world(view, board, calibration)
    return frames.inverse(view.world_from_tool) @ there if calibration.fixed else there


def sample_of(view: BoardView, board: Board) -> Sample:
    """The view as a Sample for the hand-eye solver. Raises BoardError where the cameras share too few corners."""
    if view.pair.right is None:
        seen = view.pair.left
        return Sample(view.world_from_tool, board.points_mm()[seen.corner_ids], seen.corners_px, None)
    match = match_corners(view.pair, board)
    return Sample(view.world_from_tool, match.points_mm, match.left_px, match.right_px)
