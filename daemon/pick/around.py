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
"""What a place takes, moved to and looked from, for whoever is asked."""
HEADINGS_DEG = range(-180, 180, 15)
TILTS_DEG = (20.0, 30.0, 40.0, 50.0, 60.0)
LEANS_DEG, TILT_COUNTS = (55.0, 45.0), 1.5
"""How the tool leans by turns, from straight down, and how much a degree of that counts beside one of heading: low
enough to face upright sides, high enough to face what is on top."""
NEAREST_MM, FIELD_SHARE = 280.0, 0.19
"""How near the cameras go, and of the distance what half the thing may be: it must lie whole in both images, askew and
not quite in the middle."""
REACH, BESIDE_MM = 1.5, 15.0
"""What lies this much farther from the middle than what was first seen is not the thing's."""
Report = Callable[[str], Awaitable[None]]


class NoSinglePartError(RefusedError):
    """There is not one thing to be walked round."""


@dataclass(frozen=True, eq=False)
class CircledPart:
    """What is walked round: its middle (3,) mm, world, and how far it reaches from there."""

    middle: Array
    radius_mm: float

    def holds(self, group: Group, world_from_cyclopean: Array) -> bool:
        """Whether a group of facets that a look saw lies where the thing does."""
        corners = frames.apply(world_from_cyclopean, group.polyhedron.corners_mm)
        reach_mm = REACH * self.radius_mm + BESIDE_MM
        return bool(np.linalg.norm(corners - self.middle, axis=1).max() < reach_mm)

    def groups_in(self, look: Look) -> list[Group]:
        """The groups of facets that a look saw of it."""
        return [group for group in look.scene.view.groups if self.holds(group, look.world_from_cyclopean)]


def single_part_in(look: Look) -> CircledPart:
    """The one thing that a look shows. Raises NoSinglePartError for none or several."""
    groups = [group for group in look.scene.view.groups if len(group.facets) > 1]
    if not groups:
        raise NoSinglePartError("no part is seen: put it in the middle of the table, lit from above, nothing else near")
    if len(groups) > 1:
        raise NoSinglePartError(f"{len(groups)} parts are in view; leave the one to be taught alone")
    corners = frames.apply(look.world_from_cyclopean, groups[0].polyhedron.corners_mm)
    middle = (corners.min(0) + corners.max(0)) / 2
    return CircledPart(middle, float(np.linalg.norm(corners - middle, axis=1).max()))


def viewpoints_around(
    thing: CircledPart, count: int, mounting: CameraMounting, allowed: Callable[[Array], bool]
) -> list[Array]:
    """At most `count` poses world_from_tool (4, 4) from which the thing is looked at, evenly round it, by turns low and
    higher up, as near to that as the arm comes; in the order of their headings."""
    distance_mm = max(NEAREST_MM, thing.radius_mm / FIELD_SHARE)
    x, y, z = (float(v) for v in thing.middle)
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
    """Find the one thing there is, from where the arm stands or else from the survey views, and look at it from `count`
    places round it. Dry, nothing moves and nothing but the first look is taken.

    Raises NoSinglePartError, RefusedError where too few places are reached, and what moves and looks do.
    """
    thing = await _find_single_part(context)
    mounting = context.cell.mounting
    poses = viewpoints_around(thing, count, mounting, context.mover.reach.allows)
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
        seen = sum(len(group.facets) for group in thing.groups_in(looks[-1]))
        await report(f"{name}: {seen} facet" + "s" * (seen != 1))
    return thing, looks


async def _find_single_part(context: PickContext) -> CircledPart:
    """The thing, from where the arm stands; where none is seen from there, from the survey views, one after another."""
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
