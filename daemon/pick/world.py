"""What a pick works with, what it knows, and what its handlers do alike: travel, look, leave a part alone.

A handler is `async def state(context, world) -> Event`: it does what its state is for and returns an event that leaves
it, as its annotation says (transitions.py has the table). Whatever it raises is a fault: the arm is stopped first, then
it is reported. A part that cannot be had is skipped, and named, and that is no fault.
"""

from collections import Counter
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field

from daemon import frames
from daemon.arm import (
    UNCONFIRMED,
    JobEvent,
    Mover,
    MoveRefusedError,
    OutOfReachError,
    Reading,
    RefusedError,
    Workcell,
    lie_at_boxes,
    speed_pct,
)
from daemon.arrays import Array
from daemon.errors import FacetdError
from daemon.events.codes import CauseCode, DecisionCode
from daemon.events.outcomes import Outcome
from daemon.events.pick_order import PickOrder
from daemon.pick import moved_pair
from daemon.pick.following import Target
from daemon.pick.fused_objects import ONE_MM, fuse_objects
from daemon.pick.looks import (
    CapturedPair,
    Expected,
    Look,
    adjust_exposure,
    capture_pair,
    log_look,
    moved_pair_of,
    take_look,
    whole_look,
)
from daemon.pick.outcome import NOTHING_THERE, Observer, PickResult, Skipped, notify
from daemon.pick.place_table import PlaceTable
from daemon.pick.planning import Goal
from daemon.pick.recogniser import PartRecogniser
from daemon.pick.seen import ObservedPart, apart_mm, count_seen_again, in_pick_order, same_place, seen_parts
from daemon.pick.settings import Settings
from daemon.pick.transitions import PickEvent
from daemon.store.place_status import AT_PLACE_MM

RULES_FOR_EVERY_MOVE = ("fault_active", "not_enabled", "arm_lost")
MoveError = MoveRefusedError | OutOfReachError
AT_BOX_MM = 4.0
"""Facets without a name whose corners all lie this near to boxes that the arm keeps out of, a fixture's or a post's,
are its sides: nothing to pick, and nothing to look at again."""
MOST_EXPOSURES = 3
"""Tries at the right exposure in one place."""
MOST_LOOKS, MOST_S = 40, 300.0
"""Looks of one pick, and seconds that it may take besides its motion: a pick that needs more has looks that disagree.
Parts without a name are looked at four times each."""
MOVE_ERRORS = (MoveRefusedError, OutOfReachError)
SUSPECTS = {"camera": CauseCode.CAMERA_KNOCKED, "hand-eye": CauseCode.HAND_EYE}


class SuspectError(FacetdError):
    """Looks disagree in a way that says the cell's geometry is not what the calibration says. who: camera, hand-eye, or
    unclear."""

    def __init__(self, text: str, who: str) -> None:
        super().__init__(text)
        self.code = SUSPECTS.get(who, CauseCode.LOOKS_DISAGREE)


async def no_sensor() -> None:
    """The sensor reading of a gripper that has none: always None."""


@dataclass(frozen=True, eq=False)
class PickContext:
    """What a pick works with. cycle: its number; order: what is still to be picked, this part included; placing: where
    parts belong; part_held: what the gripper's sensor says, None: it has none."""

    cell: Workcell
    mover: Mover
    recogniser: PartRecogniser
    settings: Settings
    observer: Observer | None
    cycle: int = 0
    order: PickOrder = field(default_factory=lambda: PickOrder(1))
    placing: PlaceTable = field(default_factory=PlaceTable)
    part_held: Callable[[], Awaitable[bool | None]] = no_sensor

    def decide(self, text: str, why: str, code: CauseCode | DecisionCode, **figures: object) -> None:
        """Log a decision: in words, and as a code. figures: label, slip_deg, chi2 where they belong to it."""
        self.cell.log.record("decision", cycle=self.cycle, text=text, why=why, code=code, **figures)

    async def look(
        self, reading: Reading, purpose: str, stop: int = 0, expected: Expected | None = None, back: bool = False
    ) -> Look:
        """A settled look from where the arm now is, logged; expected: see take_look; back: one camera goes to the left
        for its second picture rather than to the right."""
        settings, cell = self.settings, self.cell
        rest_s, table_z_mm = cell.clock(), settings.limits.table_z_mm
        taken = await capture_pair(cell, reading, rest_s, settings.settling)
        if cell.alone is not None:
            rest_s, taken = await self._from_beside(taken, expected is not None, back)
        look = await take_look(cell, self.recogniser, taken, rest_s, table_z_mm, expected)
        log_look(cell, self.recogniser, look, cycle=self.cycle, stop=stop, purpose=purpose, expected=expected)
        notify(self.observer, look)
        return look

    async def _from_beside(self, first: CapturedPair, known: bool, back: bool) -> tuple[float, CapturedPair]:
        """The second picture of a pair of one camera, from beside the first; since when the arm is at rest, and the
        pair. Raises RefusedError where the arm cannot go beside."""
        mover, settings, cell = self.mover, self.settings, self.cell
        if mover.dry:
            raise RefusedError(
                "with one camera a look needs two places, and nothing moves while `dry` is on: type `dry off` first"
            )
        world_from_camera = first.world_from_cyclopean @ cell.rig.left.cyclopean_from_camera
        camera_from_tool, refused = frames.inverse(world_from_camera) @ first.reading.world_from_tool, ""
        away_mm = moved_pair.distance_mm(world_from_camera, settings.limits.table_z_mm)
        for place in moved_pair.second_viewpoints(world_from_camera, away_mm, known, back):
            try:
                pose = place @ camera_from_tool
                await mover.travel(pose, "beside, for the pair", lambda _: settings.near_pct, straight=True)
            except MOVE_ERRORS as error:
                reraise_if_all_refused(error)
                refused = str(error)
                continue
            beside = mover.belief.resting_reading
            assert beside is not None
            rest_s = cell.clock()
            second = await capture_pair(cell, beside, rest_s, settings.settling)
            return rest_s, moved_pair_of(cell, first, second, settings.doubt)
        raise RefusedError(
            f"the camera cannot go aside for the second picture: {refused}. Move the arm nearer "
            "to the middle of the workspace"
        )

    async def look_exposed(self, reading: Reading, purpose: str) -> Look:
        """A look at whatever is there, again with another exposure while its light is wrong. For looks that no grasp
        hangs on: those of an approach are never held up, and all see by one light."""
        seen = await self.look(reading, purpose)
        for k in range(MOST_EXPOSURES):
            done = await adjust_exposure(self.cell, seen)
            if done is None:
                break
            self.decide(
                done, "the cameras differ in brightness, or the parts are too dark or overexposed", DecisionCode.RELIT
            )
            seen = await self.look(seen.reading, purpose, back=k % 2 == 0)
        return seen


@dataclass(frozen=True)
class InformationGain:
    """What one more look has brought. about: what was looked at; before, after: what is thought of it, in the
    operator's words, and the bits that are open; expected: those that the look was to settle; seconds: what the way and
    the look were to take."""

    about: str
    before: str
    after: str
    bits_before: float
    bits_after: float
    expected: float
    seconds: float


@dataclass(frozen=True, eq=False)
class BeforeDisagreement:
    """What lay on the table before two looks at a target disagreed: the other parts, and the target."""

    others: list[ObservedPart]
    itself: list[ObservedPart]


@dataclass(eq=False, repr=False)
class WorldModel:
    """What a pick knows of the table, in the world frame, mm. The running pick has one, and its handlers keep it."""

    skipped: list[Skipped]
    """Parts left alone, from pick to pick."""
    found: list[ObservedPart] = field(default_factory=list)
    """What lies on the table by these looks."""
    looks: list[Look] = field(default_factory=list)
    """At the whole table since it was last surveyed."""
    looked_again: list[Array] = field(default_factory=list)
    """(3,) centres of parts that were looked at from another side."""
    gained: list[InformationGain] = field(default_factory=list)
    """What each further look brought."""
    ghosts: list[Array] = field(default_factory=list)
    """(3,) middles of lone facets that did not show again."""
    unseen_directions: list[tuple[Array, Array]] = field(default_factory=list)
    """(3,) where a part lay and (3,) in which direction from it a look along its approach did not find it."""
    target: Target | None = None
    """The part to be picked."""
    last_target: Target | None = None
    """Stays when the target is given up."""
    doubtful: ObservedPart | None = None
    """A part to be looked at from another side."""
    failures: int = 0
    """Of tries at a target."""
    replans: int = 0
    """How often a target was planned again."""
    stale_looks: int = 0
    """How often a table was looked at again because its looks got old."""
    before_disagreement: BeforeDisagreement | None = None
    """What was found before two looks at the target disagreed."""
    disagreement_count: int = 0
    """How often two looks disagreed and the whole table had to be looked at."""
    began_s: float = 0.0
    """On the cell's clock."""
    moved_s: float = 0.0
    """How much of the time since then was motion, or waiting for leave to move."""
    look_count: int = 0
    """How many looks there were."""
    seen_again: tuple[int, int] = (0, 0)
    """How many parts the next look showed where they lay, and how many not."""
    disagreements: Counter[str] = field(default_factory=Counter)
    """What else of two looks did not agree, and how often."""
    regrasps: int = 0
    """How often a part was laid down to be taken anew."""
    set_down_at: str | None = None
    """The place at which the gripper was to open."""
    result: PickResult = NOTHING_THERE
    """The outcome so far."""
    gripper_opened: bool = False
    """The gripper has opened where the part was to go, and no look has judged it yet."""
    brought: bool = False
    """Whether the part was released over the bin or at its place."""
    going_home: bool = False
    """Nothing else is left of the pick."""
    ended_by: JobEvent | None = None
    """What stopped the arm in this pick."""
    stopped_by: CauseCode | None = None
    """The cause of that, where it is not the pick's outcome."""

    def the_target(self) -> Target:
        """The target, where a state has one."""
        assert self.target is not None
        return self.target

    async def add_look(self, context: PickContext, look: Look) -> None:
        """One more look at the whole table, or at a part of it. Fused beside the loop: a stop is heard meanwhile."""
        if self.looks:
            again, not_again = count_seen_again(self.looks[-1], look)
            self.seen_again = self.seen_again[0] + again, self.seen_again[1] + not_again
        self.looks.append(look)
        found = await context.cell.compute(fuse_objects, [*self.looks], context.recogniser, context.settings.doubt)
        boxes = context.settings.limits.keep_out
        found = [p for p in found if p.named or not lie_at_boxes(p.corners, boxes, AT_BOX_MM)]
        self.found = [p for p in found if not (p.lone and any(same_place(p.centre, g, ONE_MM) for g in self.ghosts))]

    def give_up_reason(self, context: PickContext) -> str | None:
        """What disagreed, in words, where the pick has taken more looks or time than any needs; else None."""
        seconds = context.cell.clock() - self.began_s - self.moved_s
        if self.look_count < MOST_LOOKS and seconds < MOST_S:
            return None
        again, not_again = self.seen_again
        odd = [f"{what} ({often} times)" for what, often in self.disagreements.most_common(2)]
        if not_again:
            odd.insert(
                0, f"{not_again} of {again + not_again} parts were not seen again where the look before measured them"
            )
        reasons = "; ".join(odd) or "the looks agree, but do not show what lies there"
        blame = (
            "; perhaps a camera repeats its picture, or was knocked: `doctor`, `calibrate verify`" if not_again else ""
        )
        return f"given up after {self.look_count} looks and {seconds:.0f} s of looking and computing: {reasons}{blame}"

    def tell(self, context: PickContext, gained: InformationGain) -> None:
        """Keep what a look has brought, and log it."""
        self.gained.append(gained)
        context.cell.log.record("gained", cycle=context.cycle, look=len(self.looks), **vars(gained))

    def left(self, context: PickContext) -> list[ObservedPart]:
        """What was found, is or may be wanted, lies at no place that is taken, and was not skipped, in order."""
        return [
            part
            for part in in_pick_order(self.found, context.settings.order)
            if (context.order.wants(part.label) or not part.named)
            and not any(same_place(s.centre, part.centre) for s in self.skipped)
            and self.place_of(context, part) is None
        ]

    def place_of(self, context: PickContext, part: ObservedPart) -> Goal | None:
        """The place that is taken, and at which a part lies."""
        taken = context.placing.taken()
        return next((goal for goal in taken if same_place(goal.centre, part.centre, AT_PLACE_MM)), None)

    def unseen_directions_of(self, centre: Array) -> list[Array]:
        """(3,) directions from a part that lies here in which a look along its approach did not find it."""
        return [away for at, away in self.unseen_directions if same_place(at, centre)]


Handler = Callable[[PickContext, WorldModel], Awaitable[PickEvent]]


def skip(
    context: PickContext,
    world: WorldModel,
    outcome: Outcome,
    part: ObservedPart | Target,
    why: str,
    code: CauseCode | DecisionCode,
) -> None:
    """Leave a part alone from now on."""
    seen_at = part.seen_at if isinstance(part, Target) and part.seen_at is not None else part.centre
    world.skipped.append(Skipped(part.label, seen_at, outcome, why))
    world.result = PickResult(outcome, f"{part.label}: {why}", code)
    context.decide(f"skip {part.label}", f"{outcome}: {why}", code, label=part.label)


def reraise_if_all_refused(error: MoveError) -> None:
    """Raise a refusal where no other move would be allowed either."""
    if isinstance(error, MoveRefusedError) and error.refusal.rule in RULES_FOR_EVERY_MOVE:
        raise error


async def unreachable(context: PickContext, world: WorldModel, error: MoveError) -> None:
    """A move was refused: raise where all motion is closed. Where nobody confirmed it in time, look at the table again
    (until world.give_up_reason ends it). Where the target was looked at on the way, its place is known better than when its
    approach was chosen: choose again, but not for ever; else leave it alone."""
    reraise_if_all_refused(error)
    target = world.the_target()
    if isinstance(error, MoveRefusedError) and error.refusal.rule == UNCONFIRMED:
        context.decide("look again", error.refusal.text, DecisionCode.LOOKED_AGAIN, label=target.label)
        world.stale_looks = 0
        world.found = seen_parts(await whole_look(context.cell.compute, context.recogniser, target.look))
        return
    if target.sightings:
        await plan_again(context, world, Outcome.UNREACHABLE, str(error), CauseCode.MOVE_REFUSED)
    else:
        skip(context, world, Outcome.UNREACHABLE, target, str(error), CauseCode.MOVE_REFUSED)


async def plan_again(
    context: PickContext, world: WorldModel, outcome: Outcome, why: str, code: CauseCode | DecisionCode
) -> bool:
    """Choose and plan again from the target's newest look, but not for ever: False where it is left alone, with this
    outcome."""
    target = world.the_target()
    world.replans += 1
    if world.replans > context.settings.tries:
        skip(context, world, outcome, target, why, code)
        return False
    world.disagreements[why] += outcome is Outcome.LOST
    context.decide(f"plan {target.label} again", why, code, label=target.label)
    world.found = seen_parts(await whole_look(context.cell.compute, context.recogniser, target.look))
    return True


async def travel(
    context: PickContext, world: WorldModel, pose: Array, purpose: str, look: Look | None = None, straight: bool = False
) -> None:
    """Go there in bounded steps; slower the nearer a part is (a target known) or at travel speed."""
    settings, target = context.settings, world.target

    def speed(step: Array) -> float:
        away_mm = 1e9 if target is None else apart_mm(step[:3, 3], target.centre)
        return speed_pct(away_mm, settings.travel_pct, settings.near_pct)

    set_out_s = context.cell.clock()
    try:
        await context.mover.travel(pose, purpose, speed, straight, None if look is None else look.taken_s)
    finally:
        world.moved_s += context.cell.clock() - set_out_s


async def look(context: PickContext, world: WorldModel, purpose: str, expected: Expected | None = None) -> Look:
    """A look from where the last move ended."""
    assert context.mover.belief.resting_reading is not None
    stop = 0 if world.target is None else world.target.looks + 1
    world.look_count += 1
    return await context.look(context.mover.belief.resting_reading, purpose, stop, expected)
