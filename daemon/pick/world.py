"""Context and world model of a pick, and the actions that its handlers share: travel, look, skip a part.

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
from daemon.pick.fused_objects import SAME_PART_MM, fuse_objects
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
"""Unnamed facets with all corners this near to keep-out boxes are sides of a fixture or post: they are not picked and
get no second view."""
MOST_EXPOSURES = 3
"""Tries at the right exposure in one place."""
MOST_LOOKS, MOST_S = 40, 300.0
"""Looks of one pick, and seconds that it may take besides its motion: a pick that needs more has looks that disagree.
Parts without a name are looked at four times each."""
MOVE_ERRORS = (MoveRefusedError, OutOfReachError)
SUSPECTS = {"camera": CauseCode.CAMERA_KNOCKED, "hand-eye": CauseCode.HAND_EYE}


class SuspectError(FacetdError):
    """Looks disagree in a way that contradicts the calibration. who: camera, hand-eye, or unclear."""

    def __init__(self, text: str, who: str) -> None:
        super().__init__(text)
        self.code = SUSPECTS.get(who, CauseCode.LOOKS_DISAGREE)


async def no_sensor() -> None:
    """The sensor reading of a gripper that has none: always None."""


@dataclass(frozen=True, eq=False)
class PickContext:
    """Resources of a pick. cycle: its number; order: the parts still to pick, including this one; placing: the places
    of parts; part_held: reads the gripper's sensor (None: it has none)."""

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
        """Take and log a look at the arm's present position, once the images are still. expected: see take_look; back:
        a single camera moves left, not right, for its second image."""
        settings, cell = self.settings, self.cell
        rest_s, table_z_mm = cell.clock(), settings.limits.table_z_mm
        taken = await capture_pair(cell, reading, rest_s, settings.settling)
        if cell.alone is not None:
            rest_s, taken = await self._capture_moved_pair(taken, expected is not None, back)
        look = await take_look(cell, self.recogniser, taken, rest_s, table_z_mm, expected)
        log_look(cell, self.recogniser, look, cycle=self.cycle, stop=stop, purpose=purpose, expected=expected)
        notify(self.observer, look)
        return look

    async def _capture_moved_pair(self, first: CapturedPair, known: bool, back: bool) -> tuple[float, CapturedPair]:
        """Move a single camera sideways and take the second image of its pair. Returns the time from which the arm is
        at rest, and the pair. Raises RefusedError where the arm cannot move sideways."""
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
        """Take a look, and repeat it with another exposure while the exposure is wrong. Not for the looks of an
        approach: these must not wait, and all need the same exposure."""
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
    """Information that a further look gained. about: the object; before, after: its hypotheses as text, with their
    entropy in bits; expected: the predicted reduction, bits; seconds: the predicted time of travel and look."""

    about: str
    before: str
    after: str
    bits_before: float
    bits_after: float
    expected: float
    seconds: float


@dataclass(eq=False, repr=False)
class WorldModel:
    """State of the running pick and its table, world frame, mm; the handlers update it."""

    skipped: list[Skipped]
    """Skipped parts, kept from pick to pick."""
    found: list[ObservedPart] = field(default_factory=list)
    """Objects on the table according to these looks."""
    looks: list[Look] = field(default_factory=list)
    """Looks at the whole table since the last survey."""
    looked_again: list[Array] = field(default_factory=list)
    """(3,) centres of parts that got a second view."""
    gained: list[InformationGain] = field(default_factory=list)
    """Information gain of each further look."""
    ghosts: list[Array] = field(default_factory=list)
    """(3,) centres of single facets that later looks did not confirm."""
    unseen_directions: list[tuple[Array, Array]] = field(default_factory=list)
    """Positions (3,) of parts, each with the direction (3,) from which a look along the approach did not find it."""
    target: Target | None = None
    """The part to be picked."""
    last_target: Target | None = None
    """The latest target, also after it was given up."""
    doubtful: ObservedPart | None = None
    """The part that needs a second view."""
    failures: int = 0
    """Failed attempts at a target."""
    replans: int = 0
    """How often a target was planned again."""
    stale_looks: int = 0
    """Number of repeated surveys because the looks were too old."""
    before_disagreement: tuple[list[ObservedPart], list[ObservedPart]] | None = None
    """The other parts and the target, as found before two looks at the target disagreed."""
    disagreement_count: int = 0
    """Number of disagreements that needed another survey."""
    began_s: float = 0.0
    """On the cell's clock."""
    moved_s: float = 0.0
    """Time since then spent in motion or waiting for permission to move."""
    look_count: int = 0
    """Number of looks."""
    seen_again: tuple[int, int] = (0, 0)
    """Numbers of parts that the next look found at the same position, and did not."""
    disagreements: Counter[str] = field(default_factory=Counter)
    """Other disagreements between looks, with their counts."""
    regrasps: int = 0
    """Number of set-downs on the table for another grasp."""
    set_down_at: str | None = None
    """Name of the place where the gripper was commanded to open."""
    result: PickResult = NOTHING_THERE
    """The outcome so far."""
    gripper_opened: bool = False
    """The gripper opened at the destination, and no look has verified the result yet."""
    brought: bool = False
    """Whether the part was released over the bin or at its place."""
    going_home: bool = False
    """Only the way home remains of the pick."""
    ended_by: JobEvent | None = None
    """What stopped the arm in this pick."""
    stopped_by: CauseCode | None = None
    """Its cause, if that is not the outcome of the pick."""

    def the_target(self) -> Target:
        """The target; for states that have one."""
        assert self.target is not None
        return self.target

    async def add_look(self, context: PickContext, look: Look) -> None:
        """Add a look at the whole table or a part of it, and fuse all looks, in the compute process, so that a stop is
        handled meanwhile."""
        if self.looks:
            again, not_again = count_seen_again(self.looks[-1], look)
            self.seen_again = self.seen_again[0] + again, self.seen_again[1] + not_again
        self.looks.append(look)
        found = await context.cell.compute(fuse_objects, [*self.looks], context.recogniser, context.settings.doubt)
        boxes = context.settings.limits.keep_out
        found = [p for p in found if p.named or not lie_at_boxes(p.corners, boxes, AT_BOX_MM)]
        self.found = [
            p for p in found if not (p.lone and any(same_place(p.centre, g, SAME_PART_MM) for g in self.ghosts))
        ]

    def give_up_reason(self, context: PickContext) -> str | None:
        """The reason as text if the pick has used more looks or time than any pick needs, else None."""
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
        """Store and log the information gain of a look."""
        self.gained.append(gained)
        context.cell.log.record("gained", cycle=context.cycle, look=len(self.looks), **vars(gained))

    def left(self, context: PickContext) -> list[ObservedPart]:
        """Found parts that are or may be wanted, are not at an occupied place, and were not skipped; in picking
        order."""
        return [
            part
            for part in in_pick_order(self.found, context.settings.order)
            if (context.order.wants(part.label) or not part.named)
            and not any(same_place(s.centre, part.centre) for s in self.skipped)
            and self.place_of(context, part) is None
        ]

    def place_of(self, context: PickContext, part: ObservedPart) -> Goal | None:
        """The occupied place where a part lies, or None."""
        taken = context.placing.taken()
        return next((goal for goal in taken if same_place(goal.centre, part.centre, AT_PLACE_MM)), None)

    def unseen_directions_of(self, centre: Array) -> list[Array]:
        """(3,) directions from which looks along the approach did not find a part at this position."""
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
    """Skip a part from now on, and log why."""
    seen_at = part.seen_at if isinstance(part, Target) and part.seen_at is not None else part.centre
    world.skipped.append(Skipped(part.label, seen_at, outcome, why))
    world.result = PickResult(outcome, f"{part.label}: {why}", code)
    context.decide(f"skip {part.label}", f"{outcome}: {why}", code, label=part.label)


def reraise_if_all_refused(error: MoveError) -> None:
    """Raise the error again if its rule refuses every move."""
    if isinstance(error, MoveRefusedError) and error.refusal.rule in RULES_FOR_EVERY_MOVE:
        raise error


async def unreachable(context: PickContext, world: WorldModel, error: MoveError) -> None:
    """Handle a refused move. Raise it if no move is permitted. If nobody confirmed it in time, look at the table again
    (until give_up_reason ends that). If looks on the way have refined the target's pose, plan again, a limited number
    of times; else skip the target."""
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
    """Move there in bounded steps, at travel speed, or slower near the target."""
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
    """Take a look from the end of the last move."""
    assert context.mover.belief.resting_reading is not None
    stop = 0 if world.target is None else world.target.looks + 1
    world.look_count += 1
    return await context.look(context.mover.belief.resting_reading, purpose, stop, expected)
