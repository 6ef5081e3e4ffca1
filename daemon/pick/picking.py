"""One pick from the choice of a part to the bin: a handler for each state (daemon/pick/transitions.py is their table).

A handler does what its state is for and returns the event that leaves it. Whatever it raises is a fault: the cycle
stops the arm first and then reports. A part that cannot be had is skipped, and named, and that is no fault.
"""

from __future__ import annotations

import asyncio

from daemon.arm import paths
from daemon.arm.mover import MoveRefusedError, OutOfReachError
from daemon.pick import fusion, viewpoints
from daemon.pick.finding import Finding, PickContext, Skipped, SuspectError
from daemon.pick.following import (
    NEAR_MM,
    Target,
    came_back_empty,
    expecting,
    eyes_of,
    far,
    follow,
    others,
    still_there,
)
from daemon.pick.fusion import CHI_SQUARE_6
from daemon.pick.looking import whole_look
from daemon.pick.plan import regrasp
from daemon.pick.seen import SAME_PLACE_MM, Seen, seen_parts

__all__ = ["Pick", "PickContext", "Skipped", "SuspectError"]


class Pick(Finding):
    """One pick; see Finding for what it is given."""

    async def stop_n(self) -> str:
        """Go to the next stand-off."""
        target = self.target
        assert target is not None
        distance = fusion.next_stand_off(target.sightings, self.settings.doubt, self.settings.stops)
        pose = viewpoints.look_pose(target.looking, target.centre, distance, self.cell.tool_from_cyclopean)
        try:
            if self.mover.closed is not False:
                await self.mover.hand(closed=False)
            await self.travel(pose, f"stand-off {distance:g} mm", target.look, straight=bool(target.sightings))
        except (MoveRefusedError, OutOfReachError) as error:
            self.unlucky(error)
            return "unreachable"
        return "there"

    async def looking(self) -> str:
        """Look, and find the target again."""
        target = self.target
        assert target is not None
        look = await self.look("approach", expecting(target, self.cell))
        if follow(target, look, self.cell, self.settings.doubt):
            return "looked"
        if any(p.label == target.label and far(p.centre, target.centre) < NEAR_MM for p in seen_parts(look)):
            return await self.elsewhere(target, "its corners are not where the look before had them")
        self.tries += 1
        why = f"not seen where it was at look {target.looks}"
        if len(self.blind_at(target.centre)) >= self.settings.views_of_doubtful:
            self.skip("lost", target, why)
            return "lost"
        eye = look.world_from_cyclopean[:3, 3]
        self.blind.append((target.centre, eye - target.centre))
        self.decide(f"approach {target.label} from another side", why)
        return "elsewhere"

    async def elsewhere(self, target: Target, why: str) -> str:
        """The target lies otherwise than was thought: choose and plan again from the newest look, but not for ever."""
        self.replans += 1
        if self.replans > self.settings.tries:
            self.skip("lost", target, why)
            return "lost"
        self.decide(f"plan {target.label} again", why)
        self.found = seen_parts(await whole_look(self.sight, target.look))
        return "elsewhere"

    async def estimating(self) -> str:
        """Hold the look against the one before, fuse, and say whether it is enough."""
        target, settings = self.target, self.settings
        assert target is not None
        chi = 0.0
        if len(target.sightings) > 1:
            chi = fusion.disagreement(target.sightings[-2], target.sightings[-1], settings.doubt)
        event = await self.disagreed(target, chi) if chi > CHI_SQUARE_6 else None
        if event is not None:
            return event
        estimate = fusion.fuse(target.sightings, settings.doubt)
        target.estimate, target.world_from_part = estimate, estimate.world_from_part
        plan = regrasp(target.shape, target.world_from_part, target.plan, settings)
        if plan is None:
            return await self.elsewhere(target, "the grasp that was planned does not hold it as it lies")
        target.plan = plan
        self.cell.log.record(
            "estimate",
            cycle=self.cycle,
            stop=target.looks,
            label=target.label,
            world_from_part=estimate.world_from_part,
            covariance=estimate.covariance,
            predicted_mm=estimate.predicted_mm,
            predicted_deg=estimate.predicted_deg,
            chi2=chi,
        )
        if self.mover.dry or fusion.enough(estimate, len(target.sightings), settings.stops):
            return "sure"
        if target.looks < settings.stops.most_looks:
            return "unsure"
        why = (
            f"{estimate.predicted_mm:.2f} mm, {estimate.predicted_deg:.2f} degrees predicted after {target.looks} looks"
        )
        self.skip("unsure", target, why)
        return "gave_up"

    async def disagreed(self, target: Target, chi: float) -> str | None:
        """Two looks disagree: say which is suspect. Where the part moved, go on from the newest look; where that cannot
        be told from here, the event that leads to a look at the whole table."""
        assert target.looked_before is not None
        before, now = [await whole_look(self.sight, look) for look in (target.looked_before, target.look)]
        moved = self.moved(others(target, before), others(target, now))
        who = fusion.suspect(moved, now.epipolar_px, self.settings.epipolar_limit_px)
        text = (
            f"looks {target.looks - 1} and {target.looks} disagree (chi-square {chi:.0f}, {CHI_SQUARE_6:g} is the most)"
        )
        self.decide(f"suspect: {who}", text)
        if who in ("camera", "hand-eye") or target.restarts:
            raise SuspectError(f"{text}; suspect: {who}")
        target.restarts += 1
        del target.sightings[:-1]
        if who == "part":
            return None
        self.questioned = [p for p in self.found if far(p.centre, target.centre) > 2 * SAME_PLACE_MM]
        return "doubt"

    async def final(self) -> str:
        """The blind stretch: to before the part, then around it, both straight."""
        target = self.target
        assert target is not None
        grasp = target.plan.grasp.world_from_tool
        try:
            if target.view is not None:
                round_mm = self.settings.stops.stand_offs_mm[0]
                away = viewpoints.look_pose(grasp[:3, :3], target.centre, round_mm, self.cell.tool_from_cyclopean)
                await self.travel(away, "round to the approach", target.look)
            before = paths.backed_off(grasp, self.settings.pregrasp_mm)
            await self.travel(before, "before the grasp", target.look, straight=True)
            await self.travel(grasp, "grasp", target.look, straight=True)
        except (MoveRefusedError, OutOfReachError) as error:
            self.unlucky(error)
            return "unreachable"
        if self.mover.dry:
            self.outcome, self.why = "dry", f"{target.label} would be grasped now"
            return "dry"
        return "there"

    async def closing(self) -> str:
        """Close the hand."""
        await self.mover.hand(closed=True)
        await asyncio.sleep(self.settings.hand_s)
        return "closed"

    async def retreat(self) -> str:
        """Straight up and back as planned, then to where the place was seen from."""
        target = self.target
        assert target is not None
        grasp, verify_mm = target.plan.grasp.world_from_tool, self.settings.verify_mm
        await self.travel(paths.lifted(grasp, self.settings.lift_mm), "lift", straight=True)
        back = viewpoints.look_pose(grasp[:3, :3], target.centre, verify_mm, self.cell.tool_from_cyclopean)
        await self.travel(back, "back off", straight=True)
        if target.view is not None:
            seen = viewpoints.look_pose(target.view, target.centre, verify_mm, self.cell.tool_from_cyclopean)
            await self.travel(seen, "where it was seen from")
        return "there"

    async def verify(self) -> str:
        """Look whether the part is gone from where it lay, and nowhere else but in the hand."""
        target = self.target
        assert target is not None
        look = await self.look("verify")
        hand = look.reading.world_from_tool[:3, 3]
        on_table = [p for p in seen_parts(look) if far(p.centre, hand) > 70.0]
        left = [p for p in on_table if far(p.centre, target.centre) < self.settings.gone_mm + 20.0]
        eyes = eyes_of(look, self.cell)
        if left or still_there(target, look, eyes):
            why = "still lies there"
        elif self.knocked_away(target, on_table):
            why = "was knocked away"
        elif came_back_empty(eyes, self.cell, self.settings.gripper):
            why = "is gone, and the hand came back empty"
        else:
            self.outcome, self.why = "picked", f"{target.label} is gone from where it lay"
            return "gone"
        self.tries += 1
        self.outcome, self.why = "missed", f"{target.label} {why}"
        self.decide("missed", self.why)
        if self.tries >= self.settings.tries:
            self.skip("missed", target, f"{why} after {self.tries} tries")
        await self.mover.hand(closed=False)
        return "missed"

    def knocked_away(self, target: Target, on_table: list[Seen]) -> bool:
        """Whether the like of it lies now where nothing lay before."""
        others = [p.centre for p in self.found if far(p.centre, target.centre) > SAME_PLACE_MM]
        alike = [p for p in on_table if p.label == target.label]
        return any(all(far(p.centre, c) > SAME_PLACE_MM for c in others) for p in alike)

    async def place(self) -> str:
        """To the bin, and let go."""
        await self.travel(self.settings.bin.pose(), "bin")
        await self.mover.hand(closed=False)
        await asyncio.sleep(self.settings.hand_s)
        return "placed"

    async def home(self) -> str:
        """Out of the way, unless the next pick follows."""
        self.target = None
        if not (self.stay and self.outcome == "picked"):
            await self.travel(self.settings.home.pose(), "home")
        return "there"
