"""One pick: a handler for each state of the cycle (daemon/transitions.py is their table), named as the state.

A handler does what its state is for and returns the event that leaves it. Whatever it raises is a fault: the cycle
stops the arm first and then reports. A part that cannot be had is skipped, and named, and that is no fault.
"""

from __future__ import annotations

import asyncio
from dataclasses import dataclass

from daemon import approach, guard
from daemon.approach import CHI_SQUARE_6
from daemon.following import (
    NEAR_MM,
    Target,
    beside,
    came_back_empty,
    expecting,
    far,
    follow,
    others,
    still_there,
)
from daemon.guard import Command, Standing
from daemon.looking import Expect, Look, Sight, log_look, take_look, whole_look
from daemon.motion import Mover, MoveRefusedError, OutOfReachError
from daemon.plan import (
    SAME_PLACE_MM,
    Seen,
    Settings,
    facings,
    is_own,
    merged,
    ordered,
    other_view,
    plan_part,
    regrasp,
    seen_parts,
)
from daemon.workcell import Array, Workcell

MOST_STALE = 3
"""How often a table is looked at again because looks got old; after that the guard has its say."""
STANDING_RULES = ("fault_stands", "not_enabled", "arm_lost")


class SuspectError(Exception):
    """Looks disagree in a way that says the cell's geometry is not what the calibration says."""


@dataclass(frozen=True, eq=False)
class Skipped:
    """A part left alone: what it was taken for, where (3,) world mm, the outcome in a word, and why."""

    label: str
    centre: Array
    outcome: str
    why: str


@dataclass(frozen=True, eq=False)
class Bench:
    """What every pick works with."""

    cell: Workcell
    mover: Mover
    sight: Sight
    settings: Settings


class Pick:
    """One pick of the wanted label (None: any). skipped goes on from pick to pick; stay: do not go home at the end."""

    def __init__(self, bench: Bench, cycle: int, wanted: str | None, skipped: list[Skipped], stay: bool) -> None:
        self.bench, self.cycle, self.wanted, self.skipped, self.stay = bench, cycle, wanted, skipped, stay
        self.cell, self.mover, self.sight, self.settings = bench.cell, bench.mover, bench.sight, bench.settings
        self.found: list[Seen] = []
        self.looked_again: list[Array] = []
        self.eyes: list[Array] = []
        self.blind: list[tuple[Array, Array]] = []
        self.target: Target | None = None
        self.last: Target | None = None
        self.doubtful: Seen | None = None
        self.tries = self.replans = self.stales = 0
        self.questioned: list[Seen] | None = None
        self.outcome, self.why = "empty", "nothing on the table that can be picked"

    # What handlers share.

    def decide(self, text: str, why: str) -> None:
        """Log a decision."""
        self.cell.log.record("decision", cycle=self.cycle, text=text, why=why)

    def skip(self, outcome: str, part: Seen | Target, why: str) -> None:
        """Leave a part alone from now on."""
        self.skipped.append(Skipped(part.label, part.centre, outcome, why))
        self.outcome, self.why = outcome, f"{part.label}: {why}"
        self.decide(f"skip {part.label}", f"{outcome}: {why}")

    def looks_at(self, centre: Array) -> int:
        """How often a part that lies here was looked at from another side."""
        return sum(far(centre, c) < SAME_PLACE_MM for c in self.looked_again)

    def blind_at(self, centre: Array) -> list[Array]:
        """(3,) directions from a part that lies here in which a look along its approach did not find it."""
        return [away for c, away in self.blind if far(centre, c) < SAME_PLACE_MM]

    def view_of(self, part: Seen) -> Array | None:
        """(3, 3) how the tool was turned in the look that named the part, for one that looks along its approaches do
        not show, and where the arm can look at it so from every stand-off; None: look along the approach."""
        if not self.blind_at(part.centre):
            return None
        view: Array = part.look.reading.world_from_tool[:3, :3]
        distances = (*self.settings.stops.stand_offs_mm, self.settings.verify_mm)
        poses = [approach.look_pose(view, part.centre, d, self.cell.tool_from_cyclopean) for d in distances]
        return view if all(self.allowed(pose) for pose in poses) else None

    def is_skipped(self, centre: Array) -> bool:
        """Whether a part that lies here was given up before."""
        return any(far(s.centre, centre) < SAME_PLACE_MM for s in self.skipped)

    def allowed(self, pose: Array) -> bool:
        """Whether the arm can be there: reached in its present configuration, and no rule of place broken."""
        assert self.mover.at is not None
        command = Command(pose, straight=True, speed_pct=self.settings.near_pct, purpose="plan")
        if guard.refuse(command, Standing(True, None, pose, 0.0), self.settings.limits) is not None:
            return False
        return self.cell.robot.reachable(pose, self.mover.at.joints_rad) is not None

    async def travel(self, target: Array, purpose: str, look: Look | None = None, straight: bool = False) -> None:
        """Go there in bounded steps; slower the nearer a part is (a target known) or at travel speed."""
        settings, target_part = self.settings, self.target

        def speed(pose: Array) -> float:
            away = 1e9 if target_part is None else far(pose[:3, 3], target_part.centre)
            return approach.speed_pct(away, settings.travel_pct, settings.near_pct)

        await self.mover.travel(target, purpose, speed, straight, None if look is None else look.taken_s)

    async def look(self, purpose: str, expect: Expect | None = None) -> Look:
        """A settled look from here, logged; expect: see take_look."""
        assert self.mover.at is not None
        looks = 0 if self.target is None else self.target.looks + 1
        settings = self.settings
        rest_s, table_z_mm = self.cell.clock(), settings.limits.table_z_mm
        look = await take_look(self.cell, self.sight, self.mover.at, rest_s, settings.settling, table_z_mm, expect)
        log_look(self.cell, self.sight, look, cycle=self.cycle, stop=looks, purpose=purpose)
        return look

    def unlucky(self, error: MoveRefusedError | OutOfReachError) -> None:
        """A move was refused: give the part up where its place is to blame, raise where all motion is closed."""
        closed = isinstance(error, MoveRefusedError) and error.refusal.rule in STANDING_RULES
        if closed or self.target is None:
            raise error
        self.skip("unreachable", self.target, str(error))

    # The states.

    async def survey(self) -> str:
        """Look at the table from each survey view until one shows a part that can be named and was not skipped."""
        self.target = None
        self.found = []
        for number, view in enumerate(self.settings.surveys, start=1):
            await self.travel(view.pose(self.cell.tool_from_cyclopean), f"survey {number}")
            self.found = merged(self.found, seen_parts(await self.look(f"survey {number}")))
            self.settle_question()
            if any(p.named for p in self.left()):
                return "seen"
        return "seen" if self.left() else "nothing"

    def left(self) -> list[Seen]:
        """What was found, is wanted and was not skipped, in order."""
        found = ordered(self.found, self.settings.order)
        return [part for part in found if self.wants(part) and not self.is_skipped(part.centre)]

    def is_stale(self, look: Look) -> bool:
        """Whether a look is too old to begin an approach on."""
        return self.cell.clock() - look.taken_s > self.settings.limits.max_look_age_s / 2

    def wants(self, part: Seen) -> bool:
        """Whether the part is, or may be, what this pick is after."""
        return self.wanted in (None, part.label) or not part.named

    async def choose(self) -> str:
        """The first part, in order, that can be had; each that cannot is skipped and named."""
        self.target = None
        for part in self.left():
            if self.stales < MOST_STALE and self.is_stale(part.look):
                self.stales += 1
                return "stale"
            shape = self.sight.shape(part.label)
            if not part.named or shape is None:
                if self.looks_at(part.centre) >= self.settings.views_of_doubtful:
                    taken_for = " or ".join(part.candidates) or "nothing that was taught"
                    self.skip("ambiguous" if part.candidates else "unknown", part, f"fits {taken_for}: {part.reason}")
                    continue
                self.doubtful = part
                return "doubtful"
            neighbours = [p.corners for p in self.found if p is not part and not is_own(p, part)]
            view = self.view_of(part)
            plan = plan_part(
                shape,
                part.world_from_part,
                neighbours,
                self.settings,
                self.cell.tool_from_cyclopean,
                self.allowed,
                facings(part),
                self.blind_at(part.centre) if view is None else (),
            )
            if isinstance(plan, str):
                self.skip("unreachable", part, plan)
                continue
            self.target = self.last = Target(
                part.label, shape, part.world_from_part, plan, part.look, view=view, confidence=part.confidence
            )
            self.decide(
                f"pick {part.label}",
                f"{self.settings.order}: confidence {part.confidence:.2f}; grasp {plan.grasp.width_mm:.0f} mm wide, "
                f"tilted {plan.grasp.tilt_deg:g} degrees, contacts {plan.grasp.slip_deg:.0f} degrees off square",
            )
            return "chosen"
        return "none_left"

    async def second_view(self) -> str:
        """Look at a part that could not be named from where its candidates differ most, or from another side."""
        part = self.doubtful
        assert part is not None
        self.looked_again.append(part.centre)
        pose, why = other_view(part, self.sight.shape, self.eyes, self.cell.tool_from_cyclopean, self.allowed)
        self.decide(f"another view of {part.label}", why)
        if pose is None:
            return "seen"
        self.eyes.append((pose @ self.cell.tool_from_cyclopean)[:3, 3])
        await self.travel(pose, "another view", part.look)
        self.found = merged(self.found, seen_parts(await self.look("another view")))
        return "seen"

    async def stop_n(self) -> str:
        """Go to the next stand-off."""
        target = self.target
        assert target is not None
        distance = approach.next_stand_off(target.sightings, self.settings.doubt, self.settings.stops)
        pose = approach.look_pose(target.looking, target.centre, distance, self.cell.tool_from_cyclopean)
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
            chi = approach.disagreement(target.sightings[-2], target.sightings[-1], settings.doubt)
        event = await self.disagreed(target, chi) if chi > CHI_SQUARE_6 else None
        if event is not None:
            return event
        estimate = approach.fuse(target.sightings, settings.doubt)
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
        if self.mover.dry or approach.enough(estimate, len(target.sightings), settings.stops):
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
        who = approach.suspect(moved, now.epipolar_px, self.settings.epipolar_limit_px)
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

    def moved(self, before: list[Seen], now: list[Seen]) -> list[float]:
        """Chi-squares of the parts that both looks show."""
        return beside(before, now, self.sight.shape, self.cell, self.settings.doubt)

    def settle_question(self) -> None:
        """Looks at one part disagreed: do the others still lie where they lay before it was approached?"""
        before, self.questioned = self.questioned, None
        if before is None:
            return
        who = approach.suspect(self.moved(before, self.found), 0.0, self.settings.epipolar_limit_px)
        self.decide(f"suspect: {who}", "the whole table was looked at again, and held against the look before")
        if who == "unclear":
            raise SuspectError(
                "a part moved, or the cameras were knocked: with no other part in view it cannot be told"
            )
        if who != "part":
            raise SuspectError(f"other parts seem to have moved as well; suspect: {who}")

    async def final(self) -> str:
        """The blind stretch: to before the part, then around it, both straight."""
        target = self.target
        assert target is not None
        grasp = target.plan.grasp.world_from_tool
        try:
            if target.view is not None:
                round_mm = self.settings.stops.stand_offs_mm[0]
                away = approach.look_pose(grasp[:3, :3], target.centre, round_mm, self.cell.tool_from_cyclopean)
                await self.travel(away, "round to the approach", target.look)
            before = approach.backed_off(grasp, self.settings.pregrasp_mm)
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
        """Straight up, then to where the place can be seen."""
        target = self.target
        assert target is not None
        up = approach.lifted(target.plan.grasp.world_from_tool, self.settings.lift_mm)
        await self.travel(up, "lift", straight=True)
        pose = approach.look_pose(target.looking, target.centre, self.settings.verify_mm, self.cell.tool_from_cyclopean)
        await self.travel(pose, "back off", straight=True)
        return "there"

    async def verify(self) -> str:
        """Look whether the part is gone from where it lay, and nowhere else but in the hand."""
        target = self.target
        assert target is not None
        look = await self.look("verify")
        hand = look.reading.world_from_tool[:3, 3]
        on_table = [p for p in seen_parts(look) if far(p.centre, hand) > 70.0]
        left = [p for p in on_table if far(p.centre, target.centre) < self.settings.gone_mm + 20.0]
        if left or still_there(target, look, self.cell):
            why = "still lies there"
        elif self.knocked_away(target, on_table):
            why = "was knocked away"
        elif came_back_empty(look, self.cell, self.settings.gripper):
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
