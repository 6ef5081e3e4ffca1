"""The distance of the next look on the approach, and when the pose is known well enough to grasp. Pure."""

from collections.abc import Sequence

from daemon.arrays import Array
from daemon.pick.pose_fusion import Doubt, Estimate, Sighting, fuse
from daemon.pick.settings import StandOffs


def is_certain_enough(estimate: Estimate, looks: int, stops: StandOffs, free_axis: Array | None = None) -> bool:
    """Whether the pose is known well enough for the final approach, which is made without another look. free_axis:
    (3,) world, about which the turn of the part does not matter."""
    if free_axis is not None:
        estimate = estimate.of_any_turn(free_axis)
    good = estimate.predicted_mm <= stops.enough_mm and estimate.predicted_deg <= stops.enough_deg
    return good and looks >= stops.least_looks


def next_stand_off(sightings: Sequence[Sighting], doubt: Doubt, stops: StandOffs) -> float:
    """The stand-off of the next look, mm: the nearest not yet passed whose look is predicted to be enough (nearer costs
    no more, and says more), or the next one in the list where none is; the nearest again when all are passed.

    A look's own covariance is taken to shrink with the square of the distance (depth from disparity), its shared part
    as the cameras' would from there.
    """
    done = len(sightings)
    ahead = stops.stand_offs_mm[min(done, len(stops.stand_offs_mm) - 1) :]
    if not sightings or done + 1 < stops.least_looks:
        return ahead[0]
    last = sightings[-1]
    for distance in reversed(ahead):
        ratio = distance / last.distance_mm
        shared = last.shared.copy()
        shared[:3, 6:8] *= ratio
        shared[:3, 8] *= ratio**2
        imagined = Sighting(last.world_from_part, last.covariance * ratio**2, shared, distance)
        if is_certain_enough(fuse([*sightings, imagined], doubt), done + 1, stops):
            return distance
    return ahead[0]
