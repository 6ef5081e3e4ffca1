"""From which side to look at a part whose turn does not show along its approach. Pure: poses and cameras in, a
direction out.

The flats of a knob lie under its rim: from above it is round. Which edges a look from elsewhere would show, and how
well these would hold the pose, follows from the part's shape.
"""

from collections.abc import Sequence

import numpy as np

from daemon import frames
from daemon.arm import OnHand, Reach
from daemon.arrays import Array
from daemon.pick.planning.next_view import viewpoints_round
from daemon.pick.planning.stand_offs import is_certain_enough
from daemon.pick.pose_fusion import Estimate, Sighting, fuse, sighting
from daemon.pick.settings import Settings
from daemon.vision.geometry import Polyhedron, StereoRig
from daemon.vision.refine import expected_covariance


def side_that_shows_turn(
    shape: Polyhedron,
    sightings: Sequence[Sighting],
    rotation: Array,
    settings: Settings,
    mounting: OnHand,
    rig: StereoRig,
    reach: Reach,
    free_axis: Array | None = None,
) -> Array | None:
    """(3, 3) how to turn the tool, world, so that the looks that are left are expected to be enough for a grasp; None
    where looks with it turned as now, rotation (3, 3), will do, or the arm reaches no side from which
    others would. sightings: the looks so far; free_axis: see enough()."""
    stops, shape_from_world = settings.stops, frames.inverse(sightings[-1].world_from_part)
    centre = frames.apply(sightings[-1].world_from_part, shape.corners_mm).mean(axis=0)
    nearest_mm, left = stops.stand_offs_mm[-1], max(stops.most_looks - len(sightings), 1)

    def expected(rotations: Sequence[Array]) -> list[Estimate]:
        tools = [mounting.look_pose(each, centre, nearest_mm) for each in rotations]
        poses = np.stack([frames.inverse(shape_from_world @ mounting.world_from_cyclopean_at(tool)) for tool in tools])
        covariances = expected_covariance(shape, rig, poses)
        camera = settings.doubt, float(rig.left.matrix[0, 0]), rig.baseline_mm
        seen = [
            sighting(tool, mounting.tool_from_cyclopean, pose, covariance, *camera)
            for tool, pose, covariance in zip(tools, poses, covariances, strict=True)
        ]
        return [fuse([*sightings, *[each] * left], settings.doubt) for each in seen]

    looks = max(len(sightings) + left, stops.least_looks)
    if is_certain_enough(expected([rotation])[0], looks, stops, free_axis):
        return None
    distances = {*stops.stand_offs_mm[1:], nearest_mm, settings.verify_mm}
    rotations = [
        pose[:3, :3]
        for pose in viewpoints_round(centre, mounting, nearest_mm)
        if reach.allows_each(np.stack([mounting.look_pose(pose[:3, :3], centre, each) for each in distances])).all()
    ]
    if not rotations:
        return None
    sure = [
        (estimate.predicted_deg, number)
        for number, estimate in enumerate(expected(rotations))
        if is_certain_enough(estimate, looks, stops, free_axis)
    ]
    return rotations[min(sure)[1]] if sure else None
