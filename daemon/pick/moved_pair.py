"""A look with one camera: two pictures at rest, the arm's own places between them, and the errors of those places.

Pure: viewpoints and images in, a rig and covariances out; world.py moves the arm and waits. The camera moves sideways
and does not turn. What moves with it (the fingers, a held part) then is at the same place in both images, as if far
away, and is not mistaken for a part on the table; if the camera turned towards one point, it would seem to be there.

The arm is slightly off its reported position, differently at each viewpoint. Therefore: a corner triangulated from two
rays gets the error of their intersection in addition (`with_arm_errors`). A known part is fitted to each image
separately: its size gives its distance, so the arm's error counts as that of two viewpoints, not of a parallax
(`fuse_single_camera_poses`). A look gives only as much evidence on the calibration as that error leaves
(`clue_with_arm_errors`).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from daemon import frames
from daemon.arm import CameraName, Picture
from daemon.arrays import Array
from daemon.pick.pose_fusion import Doubt
from daemon.vision.geometry import Camera, StereoRig, moved_rig
from daemon.vision.health import Clue
from daemon.vision.values import Facet, FacetView, Group, Part, Scene

USUAL_BASELINE_MM = 60.0
"""The baseline that places to look from are planned for: the first picture is taken half of it to the left of them."""
SHORTEST_MM, LONGEST_MM = 40.0, 120.0
SEARCH_SHARE, KNOWN_PART_SHARE = 0.15, 0.25
"""Of the distance looked at, what the camera is moved by. Where parts are to be found, both pictures must show the same
sides of them, and all of the table; of one that is known, the farther apart the better
(tests/bench/long/one_camera.py)."""
USUAL_DISTANCE_MM = 350.0
"""Where it is not known how far what is looked at is."""
SIDES = ((1.0, True), (-1.0, True), (1.0, False), (-1.0, False))
"""Which way the camera is moved, right before left, by the whole baseline before the shortest."""


@dataclass(frozen=True, eq=False)
class MovedPair:
    """Two pictures of one camera (daemon/arm's Pictures)."""

    left: Picture
    right: Picture


@dataclass(frozen=True, eq=False)
class Places:
    """Where one camera was for each picture of a moved pair: left and right, (4, 4) cyclopean_from_camera mm; and how
    far the arm may have been off at each, standard deviations per axis."""

    camera: CameraName
    left: Array
    right: Array
    arm_mm: float
    arm_deg: float

    @property
    def arm(self) -> Array:
        """(6, 6) covariance of one place."""
        return Doubt(arm_mm=self.arm_mm, arm_deg=self.arm_deg).arm()

    def rig(self, calibrated: StereoRig) -> StereoRig:
        """The camera, as it is in a calibrated rig, at both places."""
        camera: Camera = getattr(calibrated, self.camera)
        cameras = [replace(camera, cyclopean_from_camera=place) for place in (self.left, self.right)]
        return StereoRig(cameras[0], cameras[1], calibrated.image_size)

    def json(self) -> dict[str, Any]:
        """As JSON values; `places_of` reads them."""
        left, right = self.left.tolist(), self.right.tolist()
        return {"eye": self.camera, "left": left, "right": right, "arm_mm": self.arm_mm, "arm_deg": self.arm_deg}


def places_of(json: dict[str, Any] | None) -> Places | None:
    """What `Places.json` gave; None where a pair was one of both cameras."""
    if not json:
        return None
    left, right = (np.array(json[name], float) for name in ("left", "right"))
    return Places(json["eye"], left, right, float(json["arm_mm"]), float(json["arm_deg"]))


def rig_of_one_camera(rig: StereoRig, tool_from_cyclopean: Array, alone: CameraName) -> tuple[StereoRig, Array]:
    """The rig of a usual moved pair of one of a rig's cameras, and where that is on the tool: (StereoRig, (4, 4)
    mm)."""
    camera: Camera = getattr(rig, alone)
    tool_from_camera = tool_from_cyclopean @ camera.cyclopean_from_camera
    return moved_rig(camera, rig.image_size, (tool_from_camera, tool_from_camera @ _sideways(USUAL_BASELINE_MM)))


def distance_mm(world_from_camera: Array, table_z_mm: float | None) -> float:
    """How far along its axis a camera at (4, 4) mm meets the table; a usual distance where it hardly looks down."""
    if table_z_mm is None or world_from_camera[2, 2] > -0.2:
        return USUAL_DISTANCE_MM
    return float((table_z_mm - world_from_camera[2, 3]) / world_from_camera[2, 2])


def second_viewpoints(world_from_camera: Array, away_mm: float, known: bool, back: bool = False) -> Iterator[Array]:
    """Where the camera (4, 4) mm may go for the second picture of what is so far away: (4, 4), the best first. known:
    it is one part, and about where is known; back: to the left before the right."""
    share = KNOWN_PART_SHARE if known else SEARCH_SHARE
    most = float(np.clip(share * away_mm, SHORTEST_MM, LONGEST_MM))
    for side, whole in SIDES:
        yield world_from_camera @ _sideways((-side if back else side) * (most if whole else SHORTEST_MM))


def with_arm_errors(scene: Scene, rig: StereoRig, arm: Array) -> Scene:
    """A scene of a moved pair with the arm's errors in every covariance. arm: (6, 6) of one place."""

    def facet(one: Facet) -> Facet:
        added = np.stack([crossing @ (2 * arm) @ crossing.T for crossing in _crossings(rig, one.corners_mm)])
        return replace(one, covariance_mm2=one.covariance_mm2 + added)

    def group(one: Group) -> Group:
        return replace(one, facets=tuple(map(facet, one.facets)))

    view: FacetView = replace(scene.view, groups=tuple(map(group, scene.view.groups)))
    parts = tuple(
        replace(p, facets=tuple(map(facet, p.facets)), covariance=covariance_with_arm_errors(p, rig, arm))
        for p in scene.parts
    )
    return replace(scene, parts=parts, view=view)


def covariance_with_arm_errors(part: Part, rig: StereoRig, arm: Array) -> Array:
    """A part's covariance (6, 6) in a moved pair: its own, and what the arm's errors move it and turn it by."""
    crossing = _crossings(rig, part.cyclopean_from_part[None, :3, 3])[0]
    added = np.zeros((6, 6))
    added[:3, :3] = crossing @ (2 * arm) @ crossing.T
    added[3:, 3:] = arm[3:, 3:] / 2
    return part.covariance + added


def fuse_single_camera_poses(
    poses: Sequence[Array], covariances: Sequence[Array], cameras: Sequence[Camera], arm: Array, size_share: float
) -> tuple[Array, Array]:
    """Fuse the poses that two images give separately: (cyclopean_from_part (4, 4), covariance (6, 6)).

    poses: (4, 4), covariances: (6, 6), of the pictures; arm: (6, 6) of one place; size_share: by which share of itself
    the part may be larger than it was taught. Where the pictures disagree by more than all that says, the covariance
    grows by as much. Source: least squares over the pose and the part's size, which is one in both pictures and which
    the parallax tells; each picture with the error of its own place.
    """
    total, right = np.zeros((7, 7)), np.zeros(7)
    total[6, 6] = size_share**-2.0
    rows = []
    for pose, covariance, camera in zip(poses, covariances, cameras, strict=True):
        camera_from_part = frames.inverse(camera.cyclopean_from_camera) @ pose
        whole = covariance + frames.lever_covariance(camera_from_part, arm, camera.cyclopean_from_camera)
        jacobian = np.eye(6, 7)
        jacobian[:3, 6] = camera.cyclopean_from_camera[:3, 3] - pose[:3, 3]  # a larger part seems to be nearer
        off = frames.difference(pose, poses[0])
        rows.append((jacobian, np.linalg.inv(whole), off))
        total += jacobian.T @ rows[-1][1] @ jacobian
        right += jacobian.T @ rows[-1][1] @ off
    every = np.asarray(np.linalg.inv(total), float)
    found = every @ right
    chi = sum(float((off - j @ found) @ w @ (off - j @ found)) for j, w, off in rows) + (found[6] / size_share) ** 2
    return frames.perturb(poses[0], found[:6]), every[:6, :6] * max(1.0, chi / 6.0)


def clue_with_arm_errors(clue: Clue, arm: Array) -> Clue:
    """A clue of a moved pair: what the arm's errors at both places may have turned is no turn of a camera."""
    turn = 2 * arm[3, 3] + 2 * arm[0, 0] / USUAL_DISTANCE_MM**2
    return replace(clue, sigma=np.sqrt(clue.sigma**2 + turn))


def _crossings(rig: StereoRig, points_mm: Array) -> Array:
    """(N, 3, 6): how points (N, 3), cyclopean, where rays of both cameras cross, move along the left rays with an error
    of the right camera's place (6,) against the left's."""
    left, right = (camera.cyclopean_from_camera[:3, 3] for camera in (rig.left, rig.right))
    found = []
    for point in points_mm:
        a, b = point - left, point - right
        along = np.linalg.pinv(np.stack([a, -b], 1))[0]
        found.append(np.outer(a, along) @ frames.point_motion((point - right)[None])[0])
    return np.array(found)


def _sideways(mm: float) -> Array:
    return frames.rigid(np.eye(3), np.array([mm, 0.0, 0.0]))
