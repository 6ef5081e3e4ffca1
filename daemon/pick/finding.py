"""One pick up to the choice of a part: what its handlers share, and those that find, name and choose.

A handler (transitions.py has their table) does what its state is for and returns the event that leaves it. What
follows on the choice is daemon/pick/picking.py's.
"""

from __future__ import annotations

from dataclasses import dataclass

from daemon.arm import guard, paths
from daemon.arm.guard import ArmState, Command
from daemon.arm.mover import Mover, MoveRefusedError, OutOfReachError
from daemon.arm.workcell import Array, Workcell
from daemon.pick import fusion, viewpoints
from daemon.pick.following import Target, beside, far
from daemon.pick.looking import Expect, Look, Recogniser, log_look, take_look
from daemon.pick.plan import other_view, plan_part
from daemon.pick.seen import (
    NEIGHBOUR_MM,
    SAME_PLACE_MM,
    Seen,
    facings,
    is_own,
    merged,
    ordered,
    seen_parts,
    unconfirmed,
)
from daemon.pick.settings import Settings
from daemon.vision.look import outlines

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
class PickContext:
    """What every pick works with."""

    cell: Workcell
    mover: Mover
    sight: Recogniser
    settings: Settings


class Finding:
    """A pick of the wanted label (None: any) as far as its approach. skipped goes on from pick to pick; stay: do not
    go home at the end."""

    def __init__(self, bench: PickContext, cycle: int, wanted: str | None, skipped: list[Skipped], stay: bool) -> None:
        self.bench, self.cycle, self.wanted, self.skipped, self.stay = bench, cycle, wanted, skipped, stay
        self.cell, self.mover, self.sight, self.settings = bench.cell, bench.mover, bench.sight, bench.settings
        self.found: list[Seen] = []
        self.looked_again: list[Array] = []
        self.eyes: list[Array] = []
        self.blind: list[tuple[Array, Array]] = []
        self.target: Target | None = None
        self.last: Target | None = None
        self.doubtful: Seen | None = None
        self.tries = self.replans = self.stales = self.riddles = 0
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
        poses = [viewpoints.look_pose(view, part.centre, d, self.cell.tool_from_cyclopean) for d in distances]
        return view if all(self.allowed(pose) for pose in poses) else None

    def is_skipped(self, centre: Array) -> bool:
        """Whether a part that lies here was given up before."""
        return any(far(s.centre, centre) < SAME_PLACE_MM for s in self.skipped)

    def allowed(self, pose: Array) -> bool:
        """Whether the arm can be there: reached in its present configuration, and no rule of place broken."""
        assert self.mover.at is not None
        command = Command(pose, straight=True, speed_pct=self.settings.near_pct, purpose="plan")
        if guard.refuse(command, ArmState(True, None, pose, 0.0), self.settings.limits) is not None:
            return False
        return self.cell.robot.reachable(pose, self.mover.at.joints_rad) is not None

    async def travel(self, target: Array, purpose: str, look: Look | None = None, straight: bool = False) -> None:
        """Go there in bounded steps; slower the nearer a part is (a target known) or at travel speed."""
        settings, target_part = self.settings, self.target

        def speed(pose: Array) -> float:
            away = 1e9 if target_part is None else far(pose[:3, 3], target_part.centre)
            return paths.speed_pct(away, settings.travel_pct, settings.near_pct)

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
        """Look at the table from each survey view until one shows a part that can be named and was not skipped; where
        none shows any part, from the last ones, too."""
        self.target = None
        self.found = []
        usual = self.settings.surveys
        for number, view in enumerate((*usual, *self.settings.last_surveys), start=1):
            if number > len(usual) and (self.left() or self.skipped):
                break
            await self.travel(view.pose(self.cell.tool_from_cyclopean), f"survey {number}")
            look = await self.look(f"survey {number}")
            self.found = merged(self.found, seen_parts(look))
            self.riddles += all(outlines(look.scene.view))
            self.settle_question()
            if any(p.named for p in self.left()):
                return "seen"
        if not self.found and self.riddles and self.outcome == "empty":
            self.outcome, self.why = "unknown", "outlines in both images, but no facet: light, focus, a knocked camera?"
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
                beside = [p for p in self.found if p.lone and far(p.centre, part.centre) < NEIGHBOUR_MM]
                if beside and self.looks_at(part.centre) < self.settings.views_of_doubtful:
                    self.doubtful = part
                    return "doubtful"
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
        """Look at a part that could not be named from where its candidates differ most, or from another side; at one
        that has a name, whether what bars the way to it shows again."""
        part = self.doubtful
        assert part is not None
        self.looked_again.append(part.centre)
        pose, why = other_view(part, self.sight.shape, self.eyes, self.cell.tool_from_cyclopean, self.allowed)
        self.decide(f"another view of {part.label}", "does what bars the way show again?" if part.named else why)
        if pose is None:
            return "seen"
        self.eyes.append((pose @ self.cell.tool_from_cyclopean)[:3, 3])
        await self.travel(pose, "another view", part.look)
        look = await self.look("another view")
        if part.named:
            gone = unconfirmed(self.found, look, part.centre, self.cell.rig)
            self.found = [p for p in self.found if p not in gone]
        self.found = merged(self.found, seen_parts(look))
        return "seen"

    def moved(self, before: list[Seen], now: list[Seen]) -> list[float]:
        """Chi-squares of the parts that both looks show."""
        return beside(before, now, self.sight.shape, self.cell, self.settings.doubt)

    def settle_question(self) -> None:
        """Looks at one part disagreed: do the others still lie where they lay before it was approached?"""
        before, self.questioned = self.questioned, None
        if before is None:
            return
        who = fusion.suspect(self.moved(before, self.found), 0.0, self.settings.epipolar_limit_px)
        self.decide(f"suspect: {who}", "the whole table was looked at again, and held against the look before")
        if who == "unclear":
            raise SuspectError(
                "a part moved, or the cameras were knocked: with no other part in view it cannot be told"
            )
        if who != "part":
            raise SuspectError(f"other parts seem to have moved as well; suspect: {who}")
