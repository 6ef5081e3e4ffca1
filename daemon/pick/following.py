"""The target of a pick, from look to look: its pose by its edges, in the world and in the gripper; its neighbours.

Values and geometry; nothing here moves, waits or writes a log.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from daemon import frames
from daemon.arm import CameraMounting, CameraName, HeldPart, InWorld, Workcell
from daemon.arrays import Array
from daemon.pick import moved_pair, pose_fusion
from daemon.pick.grippers import Gripper
from daemon.pick.looks import CapturedPair, Expected, Look
from daemon.pick.planning import Plan, SetDown
from daemon.pick.pose_fusion import Doubt, Estimate, Sighting
from daemon.pick.seen import SAME_PLACE_MM, ObservedPart, same_place, seen_parts
from daemon.vision.geometry import Polyhedron, SolidBatch, StereoRig
from daemon.vision.image import StereoImages
from daemon.vision.model import symmetries
from daemon.vision.refine import (
    EdgeEvidence,
    Fit,
    aligned_to_edges,
    clear_edge_fraction,
    edge_samples_of,
    fit_by_each_camera,
    fit_by_edges,
    fit_to_facets,
    outline_coverage,
    vanished_edge_fraction,
)
from daemon.vision.settings import TOLERANCE_MM
from daemon.vision.values import Part

NEAR_MM = 60.0
"""Facets farther than this from the expected centre of the part are not its own."""
NEAR_POSE_MM = 15.0
"""A pose is that of the target if no corner is farther off: symmetric parts have other poses that look the same."""
EMPTY_SHOWS, EMPTY_REACH_MM = 0.9, 1.0
"""Share of an empty gripper's outline that proves that it is empty, and the search distance. The outline of an empty
gripper mostly shows whole; the print of a held part looked like 0.82 of it."""
SHARE_IF_HELD = 0.9
"""Share of the length of its edges that proves that a part is in the closed gripper. Of 237 held printed parts over
patterned tables, most showed 1.0, nearly all 0.95, and those out of view none; with the gripper open, three of 711
looks showed as much."""
SHARE_IF_RELEASED = 0.5
"""Share of the length of its edges that must vanish when the gripper opens, to prove that it held the part. Not all
edges show: two faces with the same brightness look like one."""
EXACT = 1e-12
"""Variance of a pose that is assumed to be exact."""
MOST_TURNS = 3
"""Number of turns of a round part about its axis that are fitted, of all that are tried."""
UNDECIDED_NATS = 3.0
"""Lead in nats by which a look decides between two turns. Of nine knobs seen from a side, fits within 2 degrees of the
truth had the most nats, or up to 6 less if not fully converged; those in another minimum, at least 6 degrees off, had 7
to 28 less."""
FACETS_REACH_MM, REACH_MM = 2.0, 6.0
"""Search distance for edges, from a pose by facets and from a pose expected before the look."""

FINGER_EDGE_DEG = 0.2
"""Rotation error per axis that the fingers' edges add to a pose in the gripper: 76 held parts were .15 to .45 degrees
off where their edges predicted .15 to .25. Without it, half of the pentagonal prisms held across an edge were taken to
have slipped."""
FINGER_EDGE_COVARIANCE = np.diag([0.0] * 3 + [np.radians(FINGER_EDGE_DEG) ** 2] * 3)


@dataclass(eq=False)
class Target:
    """The part being picked, with its estimates so far.

    side_view: (3, 3) tool rotation for looks, world, if it differs from that of the grasp; confidence: of its name;
    looked_before: the look before the last one; measured_in_gripper: tool_from_part (4, 4) as measured in the gripper;
    seen_at: (3,) world mm, the centre of its visible facets when it was chosen, which identifies it.
    """

    label: str
    shape: Polyhedron
    world_from_part: Array
    plan: Plan
    look: Look
    sightings: list[Sighting] = field(default_factory=list)
    estimate: Estimate | None = None
    looks: int = 0
    restarts: int = 0
    side_view: Array | None = None
    confidence: float = 1.0
    looked_before: Look | None = None
    measured_in_gripper: Array | None = None
    seen_at: Array | None = None

    @property
    def way(self) -> SetDown | None:
        """Its set-down at a place; None: it goes to the bin."""
        return self.plan.way

    @property
    def look_rotation(self) -> Array:
        """(3, 3) tool rotation for looks, world."""
        return self.plan.grasp.world_from_tool[:3, :3] if self.side_view is None else self.side_view

    @property
    def tool_from_part(self) -> Array:
        """(4, 4) pose of the part in the gripper after the planned grasp."""
        return frames.inverse(self.plan.grasp.world_from_tool) @ self.world_from_part

    @property
    def centre(self) -> Array:
        """(3,) world mm: mean of the shape's corners at the estimated pose."""
        return np.asarray(frames.apply(self.world_from_part, self.shape.corners_mm).mean(axis=0))


NO_TURN = np.eye(4)[None]


def undecided_turns(shape: Polyhedron, estimate: Estimate | None) -> Array:
    """(T, 4, 4) the turns of a round part about its axis, none first, each by as little as its symmetry allows; none
    alone where the estimate has the turn to within half a step of these, or the part is not round, or there is no
    estimate yet."""
    from daemon.vision.hypotheses import turns_about_axis  # in the worker: the daemon's process loads no hypotheses

    if estimate is None:
        return NO_TURN
    turns, alike = turns_about_axis(shape), symmetries(shape).motions
    if len(turns) == 1:
        return NO_TURN
    step = frames.vector_from_rotation(turns[1, :3, :3])
    axis = estimate.world_from_part[:3, :3] @ step / np.linalg.norm(step)
    if np.sqrt(axis @ estimate.covariance[3:, 3:] @ axis) < np.linalg.norm(step) / 2:
        return NO_TURN
    same = turns[:, None] @ alike
    least = np.trace(same[..., :3, :3], axis1=2, axis2=3).argmax(axis=1)
    return np.asarray(same[np.arange(len(same)), least])


def fit_target(target: Target, look: Look) -> Fit | None:
    """The target's pose in a whole look, as named there, or else by the facets near it, and then by its edges; None
    where neither show."""
    near = frames.inverse(look.world_from_cyclopean) @ target.world_from_part
    here = [p for p in seen_parts(look) if same_place(p.centre, target.centre, NEAR_MM)]
    start = _fit_as_seen(here, target.label, target.shape, near)
    if start is None:
        return None
    pose = start.cyclopean_from_part
    turns = undecided_turns(target.shape, target.estimate)
    return fit_pair_in_any_turn(target.shape, look.taken, pose, FACETS_REACH_MM, turns) or start


def _fit_as_seen(
    here: Sequence[ObservedPart], label: str, shape: Polyhedron, near: Array, gate_mm: float = 12.0
) -> Fit | None:
    """A part's pose near cyclopean_from_part (4, 4), as objects of one look have it: by its name, or else by all their
    facets, with corners within gate_mm. The facets of a named part say nothing that its pose does not: where edges
    named it, corners of sides that do not show are where that pose has them."""
    named = [_fit_of_named_part(p.part, shape, near) for p in here if p.named and p.label == label]
    found = [fit for fit in named if fit is not None]
    if found:
        return min(found, key=lambda fit: float(np.trace(fit.covariance[:3, :3])))
    return fit_to_facets(shape, [f for p in here for f in p.facets], near, gate_mm)


def _fit_of_named_part(part: Part, shape: Polyhedron, near: Array) -> Fit | None:
    """The pose that a look gave to a part it named, of those that fit as well the nearest; None where none is near. All
    the part's edges made it; its facets have corners where no side shows, too."""
    thought = frames.apply(near, shape.corners_mm)
    poses = [part.cyclopean_from_part, *part.equivalents]
    apart = [np.linalg.norm(frames.apply(pose, shape.corners_mm) - thought, axis=1).max() for pose in poses]
    pose = poses[int(np.argmin(apart))]
    if min(apart) > NEAR_POSE_MM:
        return None
    moved = np.eye(6)
    moved[:3] = frames.point_motion((pose - part.cyclopean_from_part)[None, :3, 3])[0]
    return Fit(pose, moved @ part.covariance @ moved.T, part.residual_mm, sum(map(len, part.fitted_mm)))


def fit_pair_by_edges(shape: Polyhedron, taken: CapturedPair, near: Array, reach_mm: float) -> Fit | None:
    """A known part's pose by its edges in a pair, near (4, 4) cyclopean_from_part; None where they do not show there.

    In a pair of one camera each image gives a pose by itself, with the arm's error at its viewpoint.
    """
    stereo = taken.stereo
    if taken.moved is None:
        return fit_by_edges(shape, stereo, near, reach_mm)
    both = fit_by_each_camera(shape, stereo, near, reach_mm)
    if both is None:
        return None
    poses, covariances = [fit.cyclopean_from_part for fit in both], [fit.covariance for fit in both]
    across_mm = float(np.linalg.norm(np.ptp(shape.corners_mm, axis=0)))
    cameras = taken.rig.left, taken.rig.right
    pose, covariance = moved_pair.fuse_single_camera_poses(
        poses, covariances, cameras, taken.moved.arm, TOLERANCE_MM / across_mm
    )
    return replace(both[0], cyclopean_from_part=pose, covariance=covariance)


def fit_pair_in_any_turn(
    shape: Polyhedron, taken: CapturedPair, near: Array, reach_mm: float, turns: Array
) -> Fit | None:
    """fit_pair_by_edges from each of several turns (T, 4, 4) of the part, the first of them none: the edges of a round
    part keep the turn at which a fit starts. Returns the fit with the most evidence from edges and holes, or that from
    no turn unless another is clearly better. The covariance covers turns between which the look does not decide."""
    if len(turns) == 1:
        return fit_pair_by_edges(shape, taken, near, reach_mm)
    stereo = taken.stereo
    starts = aligned_to_edges(SolidBatch.of([shape] * len(turns)), stereo, near @ turns, TOLERANCE_MM)
    likely = sorted(starts, key=lambda pose: -_nats_at(shape, stereo, pose))[:MOST_TURNS]
    fits = [fit for pose in (near, *likely) if (fit := fit_pair_by_edges(shape, taken, pose, reach_mm)) is not None]
    if not fits:
        return None
    nats = [_nats_at(shape, stereo, fit.cyclopean_from_part) for fit in fits]
    undecided = [fit for fit, own in zip(fits, nats, strict=True) if own > max(nats) - UNDECIDED_NATS]
    best = fits[0] if fits[0] in undecided else fits[int(np.argmax(nats))]
    apart = max(
        (_least_motion(shape, fit, best) for fit in undecided), key=lambda motion: float(np.linalg.norm(motion[3:]))
    )
    return replace(best, covariance=best.covariance + np.outer(apart, apart))


def _nats_at(shape: Polyhedron, stereo: StereoImages, pose: Array) -> float:
    """Evidence of edges and holes for a part at a pose (4, 4) cyclopean_from_part, nats."""
    from daemon.vision.evidence import hole_nats  # as undecided_turns

    samples = edge_samples_of(SolidBatch.of([shape]), stereo, pose[None], TOLERANCE_MM)
    return EdgeEvidence.of(samples).nats + hole_nats(shape, pose, stereo)


def _least_motion(shape: Polyhedron, one: Fit, other: Fit) -> Array:
    """(6,) the least motion from the other pose to the one, or to one that looks the same."""
    poses = one.cyclopean_from_part @ symmetries(shape).motions
    motions = [frames.difference(pose, other.cyclopean_from_part) for pose in poses]
    return min(motions, key=lambda motion: float(np.linalg.norm(motion[3:])))


def _fit_where_expected(
    shape: Polyhedron, world_from_part: Array, estimate: Estimate | None, taken: CapturedPair
) -> Fit | None:
    """A part's pose by its edges near its expected pose, in any turn that the estimate leaves undecided; None where
    they do not show there."""
    near = frames.inverse(taken.world_from_cyclopean) @ world_from_part
    return fit_pair_in_any_turn(shape, taken, near, REACH_MM, undecided_turns(shape, estimate))


def expected_at(
    label: str, shape: Polyhedron, world_from_part: Array, confidence: float = 1.0, estimate: Estimate | None = None
) -> Expected:
    """The part that a look should show, to be found by its edges near world_from_part (4, 4). confidence: of its name;
    estimate: from the looks so far."""
    return Expected(label, confidence, shape, partial(_fit_where_expected, shape, world_from_part, estimate))


def is_still_there(target: Target, look: Look) -> bool:
    """Whether the target's edges still show where it lay."""
    return _fit_where_expected(target.shape, target.world_from_part, None, look.taken) is not None


@dataclass(frozen=True, eq=False)
class CameraMount:
    """Cameras and their mounting: see Workcell, of which it is a part."""

    rig: StereoRig
    mounting: CameraMounting
    alone: CameraName | None = None


def mount_of(cell: Workcell) -> CameraMount:
    """The cameras of a cell and how they are mounted."""
    return CameraMount(cell.rig, cell.mounting, cell.alone)


def shows_in_gripper(target: Target, taken: CapturedPair, mount: CameraMount, doubt: Doubt) -> bool:
    """Whether a pair shows the target in the gripper, in the pose in which it was grasped; False where it is out of
    view."""
    near, stereo = _cyclopean_from_tool(taken, mount) @ target.tool_from_part, images_of_gripper(taken, mount)
    return any(
        clear_edge_fraction(target.shape, stereo, near, mm) >= SHARE_IF_HELD for mm in _search_reaches_mm(target, doubt)
    )


def shows_release(target: Target, before: CapturedPair, after: CapturedPair, mount: CameraMount, doubt: Doubt) -> bool:
    """Whether two pairs from the same viewpoint, before and after the gripper opened, show that the target was in it
    and left it. Edges that show in both belong to the background or to print."""
    near = _cyclopean_from_tool(before, mount) @ target.tool_from_part
    stereo = images_of_gripper(before, mount), images_of_gripper(after, mount)
    return any(
        vanished_edge_fraction(target.shape, *stereo, near, mm) >= SHARE_IF_RELEASED
        for mm in _search_reaches_mm(target, doubt)
    )


def _search_reaches_mm(target: Target, doubt: Doubt) -> tuple[float, ...]:
    """Search distances for its edges in the gripper, mm: first the error of the grasp, since the fingers' edges are
    beside the part's; then as far as closing jaws may push it."""
    grasped = grasped_part(target, doubt)
    return (REACH_MM,) if grasped is None else (_held_reach_mm(target.shape, grasped, doubt), REACH_MM)


@dataclass(frozen=True, eq=False)
class HeldPose:
    """Pose of a part in the gripper. seen: tool_from_part (4, 4) mm by its edges; pose: that fused with the pose of the
    grasp, with covariance (6, 6); chi2: disagreement of the two (6 degrees of freedom)."""

    seen: Array
    pose: Array
    covariance: Array
    chi2: float


def held_pose(target: Target, taken: CapturedPair, mount: CameraMount, doubt: Doubt) -> HeldPose | None:
    """Pose of the target in the gripper; None where its edges do not show, or a single camera took both images, which
    leaves the distance of the part unknown.

    Fuses the pose of the grasp (errors: the approach's and the arm's) with that by the edges (errors: the edges' and
    the hand-eye's). Edges are searched no farther from the grasp's pose than these errors allow: the fingers' edges run
    a few mm beside the part's.
    """
    grasped = grasped_part(target, doubt)
    return None if grasped is None else held_by_edges(target.shape, grasped, taken, mount, doubt)


def grasped_part(target: Target, doubt: Doubt) -> HeldPart | None:
    """Pose of the target in the gripper by the planned grasp, with the errors of approach and arm; None without an
    estimate."""
    if target.estimate is None:
        return None
    tool_from_world = frames.inverse(target.plan.grasp.world_from_tool)
    covariance = frames.transport_covariance(tool_from_world, target.estimate.covariance) + doubt.arm()
    return HeldPart(target.label, target.tool_from_part, covariance)


def held_by_edges(
    shape: Polyhedron, held: HeldPart, taken: CapturedPair, mount: CameraMount, doubt: Doubt
) -> HeldPose | None:
    """Pose of a held part in the gripper: see held_pose."""
    if mount.alone is not None:
        return None
    grasped = held.tool_from_part
    tool_from_cyclopean = mount.mounting.tool_from_cyclopean_at(taken.reading.world_from_tool)
    near, reach_mm = frames.inverse(tool_from_cyclopean) @ grasped, _held_reach_mm(shape, held, doubt)
    fit = fit_by_edges(shape, taken.stereo, near, reach_mm, partly_hidden=True)
    if fit is None:
        return None
    seen = tool_from_cyclopean @ fit.cyclopean_from_part
    hand_eye = frames.lever_covariance(seen, doubt.shared()[:6, :6], np.eye(4))
    there = frames.transport_covariance(tool_from_cyclopean, fit.covariance) + hand_eye + FINGER_EDGE_COVARIANCE
    apart = frames.difference(seen, grasped)
    chi2 = float(apart @ np.linalg.solve(held.covariance + there, apart))
    pose, covariance = frames.fuse([grasped, seen], [held.covariance, there])
    of_grasp, of_edges = (covariance @ np.linalg.inv(each) for each in (held.covariance, there))
    in_both = of_grasp @ hand_eye @ of_edges.T  # the looks before the grasp err by the same hand-eye
    return HeldPose(seen, pose, covariance + in_both + in_both.T, chi2)


def predicted_error(shape: Polyhedron, tool_from_part: Array, covariance: Array, doubt: Doubt) -> tuple[float, float]:
    """Standard deviations of a held part in the world: of its centre, mm, and its rotation, degrees, over all axes;
    from the covariance (6, 6) of tool_from_part (4, 4) and the arm's repeatability."""
    arm = frames.lever_covariance(tool_from_part, doubt.arm(), np.eye(4))
    middle = frames.point_motion(tool_from_part[:3, :3] @ shape.corners_mm.mean(axis=0))
    both = covariance + arm
    mm = float(np.sqrt(np.trace(middle @ both @ middle.T)))
    return mm, frames.rms_deg(both[3:, 3:])


def _held_reach_mm(shape: Polyhedron, held: HeldPart, doubt: Doubt) -> float:
    """Largest distance of a corner from its position by the grasp, mm: by the errors of the grasp and of the
    hand-eye."""
    hand_eye = frames.lever_covariance(held.tool_from_part, doubt.shared()[:6, :6], np.eye(4))
    return largest_deviation_mm(shape, held.tool_from_part, held.covariance + hand_eye)


def largest_deviation_mm(shape: Polyhedron, b_from_part: Array, covariance: Array) -> float:
    """Largest deviation of a corner, mm, for a pose error of covariance (6, 6) in b with a chi-square of at most
    CHI_SQUARE_6."""
    motion = frames.point_motion(shape.corners_mm @ b_from_part[:3, :3].T)
    largest = np.linalg.eigvalsh(motion @ covariance @ motion.transpose(0, 2, 1))[:, -1].max()
    return float(np.sqrt(pose_fusion.CHI_SQUARE_6 * largest))


def shows_empty_gripper(taken: CapturedPair, mount: CameraMount, gripper: Gripper) -> bool:
    """Whether a pair shows that the closed gripper is empty; False where it is out of view, a part hides it, or it
    looks the same with a part."""
    empty = gripper.empty
    if empty is None:
        return False
    stereo, near = images_of_gripper(taken, mount), _cyclopean_from_tool(taken, mount)
    return outline_coverage(empty, stereo, near, EMPTY_REACH_MM) > EMPTY_SHOWS


def _cyclopean_from_tool(taken: CapturedPair, mount: CameraMount) -> Array:
    return frames.inverse(mount.mounting.tool_from_cyclopean_at(taken.reading.world_from_tool))


def images_of_gripper(taken: CapturedPair, mount: CameraMount) -> StereoImages:
    """A pair's images for objects that move with the cameras: in both images of a single camera these are at the same
    place."""
    stereo = taken.stereo
    if mount.alone is None:
        return stereo
    left, right = (replace(view, rectified=replace(view.rectified, camera=mount.rig.left)) for view in stereo.views)
    return replace(stereo, left=left, right=right)


def sighting_of(look: Look, fit: Fit, rig: StereoRig, doubt: Doubt) -> Sighting:
    """The sighting of a fit in a look: its pose in the world with its errors."""
    return _sighting(
        (fit.cyclopean_from_part, fit.covariance),
        (look.reading.world_from_tool, look.world_from_cyclopean, look.taken.pivot),
        rig,
        doubt,
        look.taken.moved is None,
    )


def least_error(mount: CameraMount, distance_mm: float, doubt: Doubt) -> Estimate:
    """Lower bound of the error at the grasp: from calibration and arm alone, after an exact look at a part distance_mm
    away."""
    seen = frames.rigid(np.eye(3), np.array([0.0, 0.0, distance_mm])), EXACT * np.eye(6)
    pivot = mount.mounting.pivot if isinstance(mount.mounting, InWorld) else None
    there = np.eye(4), mount.mounting.world_from_cyclopean_at(np.eye(4)), pivot
    return pose_fusion.fuse([_sighting(seen, there, mount.rig, doubt, mount.alone is None)], doubt)


def _sighting(
    seen: tuple[Array, Array], there: tuple[Array, Array, Array | None], rig: StereoRig, doubt: Doubt, one_moment: bool
) -> Sighting:
    """seen: cyclopean_from_part and its covariance; there: world_from_tool, world_from_cyclopean and the pivot of fixed
    cameras. What is in a fit of a moved pair already does not count again: the arm's errors, and no offset of one
    camera against another. The arm moves no fixed cameras."""
    world_from_tool, world_from_cyclopean, pivot = there
    carrier = world_from_tool if pivot is None else frames.rigid(np.eye(3), pivot)
    return pose_fusion.sighting(
        carrier,
        frames.inverse(carrier) @ world_from_cyclopean,
        *seen,
        doubt if one_moment and pivot is None else replace(doubt, arm_mm=0.0, arm_deg=0.0),
        float(rig.left.matrix[0, 0]),
        rig.baseline_mm if one_moment else np.inf,
    )


def other_parts(target: Target, look: Look) -> list[ObservedPart]:
    """The parts in a whole look that are not the target."""
    return [p for p in seen_parts(look) if not same_place(p.centre, target.centre)]


def chi_squares_of_others(
    before: list[ObservedPart],
    now: list[ObservedPart],
    shape_of: Callable[[str], Polyhedron | None],
    rig: StereoRig,
    doubt: Doubt,
) -> list[float]:
    """Chi-squares of the motion of the parts that both looks show; a large one means that the part moved as well."""
    found = []
    for old in before:
        shape = shape_of(old.label)
        near = [p for p in now if same_place(p.centre, old.centre, 2 * SAME_PLACE_MM)]
        if shape is None or not near:
            continue
        here = frames.inverse(near[0].look.world_from_cyclopean) @ old.world_from_part
        first = _fit_as_seen([old], old.label, shape, old.part.cyclopean_from_part)
        second = _fit_as_seen(near[:1], old.label, shape, here, gate_mm=20.0)
        if first is not None and second is not None:
            pair = sighting_of(old.look, first, rig, doubt), sighting_of(near[0].look, second, rig, doubt)
            found.append(pose_fusion.disagreement(*pair, doubt))
    return found
