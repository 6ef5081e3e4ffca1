"""How the cameras are mounted: on the arm (eye-in-hand), or fixed in the world (eye-to-hand). Pure: arrays in and out.

This module computes every pose of the cameras, and every pose of the arm for a look.
"""

from dataclasses import dataclass

import numpy as np

from daemon import frames
from daemon.arm import paths
from daemon.arm.body import ArmBody, KeepOut, point_of
from daemon.arrays import Array
from daemon.vision.geometry import StereoRig

CAMERA_MM = 60.0
"""Half the size of a camera with lens and bracket: the keep-out box of fixed cameras extends this far beyond their
optical centres."""
CAMERAS = "the fixed cameras"
"""The name of that box."""
APART_MM = 20.0
"""Distance between the points on a capsule's axis that are projected into the images."""


@dataclass(frozen=True, eq=False)
class OnHand:
    """Eye-in-hand: tool_from_cyclopean, (4, 4) mm, is constant."""

    tool_from_cyclopean: Array

    def world_from_cyclopean_at(self, world_from_tool: Array) -> Array:
        """(4, 4) mm of the cameras while the tool is at world_from_tool (4, 4)."""
        return np.asarray(world_from_tool @ self.tool_from_cyclopean)

    def tool_from_cyclopean_at(self, _world_from_tool: Array) -> Array:
        """(4, 4) mm of the cameras on the tool while that is at world_from_tool (4, 4)."""
        return self.tool_from_cyclopean

    def look_pose(self, rotation: Array, centre: Array, stand_off_mm: float) -> Array:
        """world_from_tool (4, 4) with the tool turned to rotation (3, 3) and the cameras' axis through centre (3,),
        world, from stand_off_mm away."""
        view = rotation @ self.tool_from_cyclopean[:3, :3]
        world_from_cyclopean = frames.rigid(view, centre - stand_off_mm * view[:, 2])
        return world_from_cyclopean @ frames.inverse(self.tool_from_cyclopean)

    def approach_pose(self, grasp: Array, centre: Array, distance_mm: float) -> Array:
        """world_from_tool (4, 4) for a look before a grasp (4, 4) of a part at centre (3,), distance_mm from it."""
        return self.look_pose(grasp[:3, :3], centre, distance_mm)


@dataclass(frozen=True, eq=False)
class InWorld:
    """Camera-to-hand: world_from_cyclopean, (4, 4) mm, is constant. For every look the arm is at out_of_view,
    world_from_tool (4, 4), where it hides nothing. pivot: (3,) world, the centre of rotation of the error of
    world_from_cyclopean."""

    world_from_cyclopean: Array
    out_of_view: Array
    pivot: Array

    def world_from_cyclopean_at(self, _world_from_tool: Array) -> Array:
        return self.world_from_cyclopean

    def tool_from_cyclopean_at(self, world_from_tool: Array) -> Array:
        return np.asarray(frames.inverse(world_from_tool) @ self.world_from_cyclopean)

    def look_pose(self, _rotation: Array, _centre: Array, _stand_off_mm: float) -> Array:
        """See OnHand: fixed cameras always look from the same place, so the arm only has to be out of view."""
        return self.out_of_view

    def approach_pose(self, grasp: Array, _centre: Array, distance_mm: float) -> Array:
        """See OnHand: straight back from the grasp, because no look is taken from there."""
        return paths.backed_off(grasp, distance_mm)


CameraMounting = OnHand | InWorld


def cameras_box(rig: StereoRig, world_from_cyclopean: Array) -> KeepOut:
    """The keep-out box around fixed cameras, along the world's axes."""
    centres = [(world_from_cyclopean @ camera.cyclopean_from_camera)[:3, 3] for camera in (rig.left, rig.right)]
    low, high = np.min(centres, axis=0) - CAMERA_MM, np.max(centres, axis=0) + CAMERA_MM
    return KeepOut(CAMERAS, point_of(low), point_of(high))


def in_view(links: Array, body: ArmBody, rig: StereoRig, world_from_cyclopean: Array) -> str | None:
    """The first section of the arm that fixed cameras see, its name, or None. links: (8, 4, 4).

    Each capsule is tested as balls along its axis. A ball is in an image where its centre is at most its apparent
    radius outside the image.
    """
    (width, height), cyclopean_from_world = rig.image_size, frames.inverse(world_from_cyclopean)
    for name, (start, end), radius in zip(body.names, body.placed(links[None])[0], body.radius_mm, strict=True):
        count = int(np.ceil(np.linalg.norm(end - start) / APART_MM)) + 1
        points = start + np.linspace(0.0, 1.0, count)[:, None] * (end - start)
        seen = frames.apply(cyclopean_from_world, points)
        for camera in (rig.left, rig.right):
            depth = frames.apply(frames.inverse(camera.cyclopean_from_camera), seen)[:, 2]
            before = depth > radius
            if not before.any():
                continue
            px, margin = camera.project(seen[before]), radius * camera.matrix[0, 0] / depth[before]
            inside = (px > -margin[:, None]) & (px < (width, height) + margin[:, None])
            if inside.all(axis=1).any():
                return name
    return None
