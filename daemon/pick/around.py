"""The tour round one part: its viewpoints, and the looks from them. Planning the tour is pure; every motion is the
mover's, so that a stop, a pause and step mode are honoured as in a pick.
"""

from collections.abc import Awaitable, Callable
from dataclasses import dataclass

import numpy as np

from daemon import frames
from daemon.arm import CameraMounting, RefusedError
from daemon.arrays import Array
from daemon.pick.looks import Look
from daemon.pick.settings import SurveyView
from daemon.pick.world import MOVE_ERRORS, PickContext, reraise_if_all_refused
from daemon.vision.values import Group

LEAST_PLACES, MOST_PLACES, USUAL_PLACES = 6, 12, 10
SECONDS_A_PLACE = 2.0
"""Estimated time of a viewpoint: move and look, for the question to the operator."""
HEADINGS_DEG = range(-180, 180, 15)
TILTS_DEG = (20.0, 30.0, 40.0, 50.0, 60.0)
LEANS_DEG, TILT_COUNTS = (55.0, 45.0), 1.5
"""Alternating tilts of the tool from straight down, so that both upright and top faces show; weight of a degree of tilt
relative to one of heading."""
NEAREST_MM, FIELD_SHARE = 280.0, 0.19
"""Least viewing distance; the part's radius as a share of the distance, so that it is whole in both images although
tilted and off-centre."""
REACH, BESIDE_MM = 1.5, 15.0
"""Facets beyond this multiple of the first seen radius, plus BESIDE_MM, are not the part's."""
Report = Callable[[str], Awaitable[None]]


class NoSinglePartError(RefusedError):
    """There is no part, or more than one, in view."""


@dataclass(frozen=True, eq=False)
class CircledPart:
    """The part that the cameras circle: its centre (3,) mm, world, and its radius."""

    middle: Array
    radius_mm: float

    def holds(self, group: Group, world_from_cyclopean: Array) -> bool:
        """Whether a group of facets of a look is at the part's position."""
        corners = frames.apply(world_from_cyclopean, group.polyhedron.corners_mm)
        reach_mm = REACH * self.radius_mm + BESIDE_MM
        return bool(np.linalg.norm(corners - self.middle, axis=1).max() < reach_mm)

    def groups_in(self, look: Look) -> list[Group]:
        """The groups of facets of a look that belong to the part."""
        return [group for group in look.scene.view.groups if self.holds(group, look.world_from_cyclopean)]


def single_part_in(look: Look) -> CircledPart:
    """The only part that a look shows. Raises NoSinglePartError for none or several."""
    groups = [group for group in look.scene.view.groups if len(group.facets) > 1]
    if not groups:
        raise NoSinglePartError("no part is seen: put it in the middle of the table, lit from above, nothing else near")
    if len(groups) > 1:
        raise NoSinglePartError(f"{len(groups)} parts are in view; leave the one to be taught alone")
    corners = frames.apply(look.world_from_cyclopean, groups[0].polyhedron.corners_mm)
    middle = (corners.min(0) + corners.max(0)) / 2
    return CircledPart(middle, float(np.linalg.norm(corners - middle, axis=1).max()))


def viewpoints_around(
    part: CircledPart, count: int, mounting: CameraMounting, allowed: Callable[[Array], bool]
) -> list[Array]:
    """At most `count` reachable viewpoints, world_from_tool (4, 4), around a part: nearest to even headings with
    alternating tilts, in the order of their headings."""
    distance_mm = max(NEAREST_MM, part.radius_mm / FIELD_SHARE)
    x, y, z = (float(v) for v in part.middle)
    reached = dict[tuple[int, float], Array]()
    for heading in HEADINGS_DEG:
        for tilt in TILTS_DEG:
            pose = SurveyView((x, y, z), distance_mm, float(heading), tilt).pose(mounting)
            if allowed(pose):
                reached[heading, tilt] = pose
    chosen = dict[tuple[int, float], Array]()
    for k in range(count):
        wanted, lean = 360.0 * k / count - 180.0, LEANS_DEG[k % len(LEANS_DEG)]
        away = {at: abs((at[0] - wanted + 180) % 360 - 180) + TILT_COUNTS * abs(at[1] - lean) for at in reached}
        if away:
            best = min(away, key=lambda at: away[at])
            chosen[best] = reached.pop(best)
    return [chosen[at] for at in sorted(chosen)]


async def look_from_around(context: PickContext, count: int, report: Report) -> tuple[CircledPart, list[Look]]:
    """Find the only part, from the present position or else from the survey views, and look from `count` viewpoints
    around it. In a dry run only the first look is taken, and nothing moves.

    Raises NoSinglePartError, RefusedError where too few viewpoints can be reached, and the errors of moves and looks.
    """
    part = await _find_single_part(context)
    mounting = context.cell.mounting
    poses = viewpoints_around(part, count, mounting, context.mover.reach.allows)
    if len(poses) < LEAST_PLACES:
        raise RefusedError(f"the arm reaches only {len(poses)} places round it; put it nearer to the middle")
    looks = list[Look]()
    for number, pose in enumerate(poses, start=1):
        name = f"place {number} of {len(poses)}"
        try:
            await context.mover.travel(pose, f"round it, {name}", lambda _: context.settings.travel_pct)
        except MOVE_ERRORS as error:
            reraise_if_all_refused(error)
            await report(f"{name}: left out: {error}")
            continue
        if context.mover.dry or context.mover.belief.resting_reading is None:
            continue
        looks.append(await context.look(context.mover.belief.resting_reading, f"round it, {name}"))
        seen = sum(len(group.facets) for group in part.groups_in(looks[-1]))
        await report(f"{name}: {seen} facet" + "s" * (seen != 1))
    return part, looks


async def _find_single_part(context: PickContext) -> CircledPart:
    """Find the only part from the present position, or else from the survey views, one after another."""
    mover, settings = context.mover, context.settings
    lacking: NoSinglePartError | None = None
    for view in (None, *settings.surveys):
        if view is not None:
            if mover.dry:
                break
            pose = view.pose(context.cell.mounting)
            await mover.travel(pose, "find it", lambda _: settings.travel_pct)
        reading = mover.belief.resting_reading or await mover.wait_until_at_rest()
        try:
            return single_part_in(await context.look_exposed(reading, "find it"))
        except NoSinglePartError as error:
            lacking = error
    assert lacking is not None
    raise lacking
