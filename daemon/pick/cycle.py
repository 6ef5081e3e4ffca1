"""The pick cycle: the states of transitions.py, for one pick or many. Its supervisor has the arm, and stops it.

All calls come from the one event loop. pick, auto, look, where, go, move_to and hand run one at a time, as jobs of the
supervisor (arm/supervisor.py: enable, stop, pause, step ... are asked of it); a second one raises RefusedError("busy:
..."). A pick goes on when the one who asked for it goes away.
"""

import asyncio
import contextlib
import statistics
from collections import Counter, deque
from collections.abc import Awaitable, Callable, Coroutine, Sequence
from dataclasses import replace
from itertools import islice
from typing import Any

import numpy as np

from daemon import frames
from daemon.arm import (
    Beliefs,
    BeliefSource,
    CellBelief,
    InWorld,
    JobEvent,
    OperatorRefusedError,
    Reading,
    RefusedError,
    Supervisor,
    VoidingEvent,
    Workcell,
    body_of,
    held_anyhow,
    in_view,
)
from daemon.arrays import Array
from daemon.errors import error_text
from daemon.events.codes import BY_OPERATOR, CauseCode, FaultCause, cause_of
from daemon.events.outcomes import BROUGHT, Outcome, tally
from daemon.events.pick_order import ALL, OrderStep, PickOrder, auto_record
from daemon.pick import approach, find, set_down, take
from daemon.pick.around import CircledPart, Report, look_from_around
from daemon.pick.following import Target
from daemon.pick.looks import Look
from daemon.pick.outcome import CycleEnd, Observer, PickResult, Skipped, notify
from daemon.pick.place_table import PlaceTable
from daemon.pick.planning import Goal, SidePlan, plan_from_side
from daemon.pick.recogniser import PartRecogniser
from daemon.pick.settings import Settings
from daemon.pick.transitions import PickEvent, PickState, follows
from daemon.pick.world import Handler, PickContext, WorldModel
from daemon.signals.packml import PackMLState, packml_state
from daemon.signals.production_line import ProductionLine

HANDLERS: dict[PickState, Handler] = {
    PickState.SURVEY: find.survey,
    PickState.CHOOSE: find.choose,
    PickState.SECOND_VIEW: find.second_view,
    PickState.STOP_N: approach.stop_n,
    PickState.LOOKING: approach.looking,
    PickState.ESTIMATING: approach.estimating,
    PickState.FINAL: take.final,
    PickState.CLOSING: take.closing,
    PickState.RETREAT: take.retreat,
    PickState.VERIFY: take.verify,
    PickState.BIN: take.over_bin,
    PickState.SET_DOWN: set_down.set_down,
    PickState.LOOK_AT_PLACE: set_down.look_at_place,
    PickState.LOOK_AT_LAID: set_down.look_at_laid,
    PickState.HOME: take.home,
}
LINE_PERMITS: dict[PickState, str] = {
    **dict.fromkeys(HANDLERS.keys() - {PickState.HOME}, "permit_pick"),
    **dict.fromkeys((PickState.BIN, PickState.SET_DOWN, PickState.LOOK_AT_PLACE), "permit_place"),
}
"""Which permit of the line each move of arm or gripper needs, by the state of the pick; the way home needs none."""
LINE_LOOKS_S = 5.0
"""How long an auto that waits for the line rests after a pick that brought nothing."""
IDLE_LOOKS = 2
"""After so many looks in turn that show nothing new, what has a name is taken for all there is."""
LATEST = 20
"""How many of the last picks say how long the next ones will take."""
KEPT_ENDS = 1000
"""How many ended picks are kept in memory (the run log has all): a daemon runs for years."""


class PickCycle:
    """See the module. recogniser: None where nothing was taught yet; observer: called for each look and each end.

    pick_order: what auto has still to bring (where auto is not on, it was cut off); skipped: parts left alone since the
    last pick or auto began. What is believed of arm and gripper is the robot's (daemon/arm/belief.py).
    """

    def __init__(
        self,
        cell: Workcell,
        settings: Settings,
        recogniser: PartRecogniser | None = None,
        observer: Observer | None = None,
    ) -> None:
        self.supervisor = Supervisor(cell, settings.limits, settings.arrival, self._interrupted)
        self.cell, self.settings, self.recogniser, self.observer = cell, settings, recogniser, observer
        self.state = self._held = PickState.IDLE
        self.ends: deque[CycleEnd] = deque(maxlen=KEPT_ENDS)
        self.tally: Counter[Outcome] = Counter()
        self._left_alone: tuple[Skipped, ...] = ()
        """Parts that earlier picks skipped, and that the next one does not try again."""
        self.pick_order: PickOrder | None = None
        self.placing = PlaceTable()
        """Where parts belong; without places they go to the bin."""
        self.production_line = ProductionLine({}, cell.robot, None, cell.clock, cell.log.record)
        """The signals of the line; none unless the cell has some."""
        self.supervisor.mover.gate, self.supervisor.mover.work_gripper = self._gate, self._work_gripper
        self._world: WorldModel | None = None
        self._cycles = 0
        self._auto = False
        self._end_wait = asyncio.Event()
        """Ends the wait for parts."""

    @property
    def beliefs(self) -> Beliefs:
        return self.cell.robot.beliefs

    @property
    def belief(self) -> CellBelief:
        return self.beliefs.now

    @property
    def auto_on(self) -> bool:
        """Whether auto goes on after the current part."""
        return self._auto

    @property
    def number(self) -> int:
        """The number of the latest cycle, from 1; 0: none has begun."""
        return self._cycles

    @property
    def target(self) -> Target | None:
        """The part that is being approached."""
        return None if self._world is None else self._world.target

    def status(self) -> dict[str, Any]:
        """How things stand, JSON values only."""
        target = self.target
        estimate = None if target is None else target.estimate
        order, counted = self.pick_order, tally(self.tally)
        return {
            "state": self.state,
            **self.supervisor.status(),
            "auto": self._auto,
            "packml": self.packml,
            "waits_for": self.production_line.waits_for,
            "left": None if order is None else order.json(),
            "left_s": self._seconds_left(),
            "cycle": self._cycles,
            "target": None if target is None else target.label,
            "stop": None if target is None else target.looks,
            "predicted_mm": None if estimate is None else round(estimate.predicted_mm, 3),
            "predicted_deg": None if estimate is None else round(estimate.predicted_deg, 3),
            "holding": self.belief.holds_part,
            "believed": self.belief.json(self.cell.clock()),
            "picked": counted.picked,
            "tried": counted.tried,
            "failed": counted.failed,
            "released": counted.released,
            "aborted": counted.aborted,
            "skipped": [
                {"label": s.label, "at": s.centre.round(1).tolist(), "why": f"{s.outcome}: {s.why}"}
                for s in self.skipped
            ],
            "last": None if not self.ends else f"{self.ends[-1].outcome}: {self.ends[-1].why}",
        }

    @property
    def skipped(self) -> Sequence[Skipped]:
        """Parts left alone, those of the pick under way as well."""
        return self._left_alone if self._world is None else self._world.skipped

    @property
    def packml(self) -> PackMLState:
        permission = self.supervisor.permission
        at_work = self.supervisor.busy and self.supervisor.job_moves and not self.production_line.waits_to_begin
        return packml_state(permission.blocked, permission.enabled, at_work, self.production_line.done)

    def use(self, recogniser: PartRecogniser | None) -> None:
        """Take another recogniser or model into use, from the next pick on (None: picking is refused). What may be in
        the gripper may be a part of the model that was in use until now."""
        if self.belief.may_hold:
            self._assume_the_longest()
        self.recogniser = recogniser
        self.use_places(self.placing)

    def use_places(self, placing: PlaceTable) -> None:
        """Bring parts to these places from the next pick on. The shapes of parts are the model's."""
        shapes = {} if self.recogniser is None else {label: self.recogniser.shape(label) for label in placing.labels}
        placing.know({label: shape for label, shape in shapes.items() if shape is not None})
        self.placing = placing

    def refit(self, cell: Workcell, settings: Settings) -> None:
        """Go on with another calibration or other settings (a reload); only while nothing is being done."""
        self.supervisor.refit(cell, settings.limits, settings.arrival)
        self.cell, self.settings = cell, settings

    # Jobs.

    async def pick(self, label: str | None = None) -> CycleEnd:
        """Pick one part; RefusedError when it may not start."""
        self._may_pick()
        return await self.supervisor.run("pick", self._run_single(label))

    async def auto(self, pick_order: PickOrder = ALL) -> list[CycleEnd]:
        """Pick until the order is done, nothing that it wants is there, or auto_off()."""
        return await self.begin_auto(pick_order)

    def begin_auto(self, pick_order: PickOrder = ALL) -> Coroutine[Any, Any, list[CycleEnd]]:
        """Start auto now, so that an auto_off() right after it ends it; return a coroutine that waits for its end."""
        self._may_pick()
        if pick_order.on_signal and not (
            self.production_line.has("cycle_start") or self.production_line.has("part_present")
        ):
            raise RefusedError(
                "the line has no signal to wait for: give an input of facetd.yaml the role cycle_start or part_present"
            )
        task = self.supervisor.begin("auto", self._run_auto())
        task.add_done_callback(self._auto_over)
        self._auto, self._left_alone = True, ()
        self._end_wait.clear()
        self._set_order(pick_order)
        return self.supervisor.end_of("auto", task)

    def auto_off(self) -> None:
        """End auto after the part in hand; where it was cut off, give up what is left."""
        if not self._auto:
            self._set_order(None)
        self._auto = False
        self._end_wait.set()

    async def look(self, purpose: str = "look") -> Look:
        """One settled look from where the arm stands; nothing moves, and nothing needs to be enabled, but with one
        camera, which the arm moves between two pictures, and back."""
        return await self.supervisor.run("look", self._look(purpose), moves=self.cell.alone is not None)

    async def locate(self, label: str) -> Array:
        """Where the one part of this label is that lies in view, world_from_part (4, 4) mm, by looks from several
        sides. RefusedError when it may not start, or there is none, or more than one."""
        self._may_pick()
        self._must_be_empty()
        return await self.supervisor.run(f"locate {label}", self._locate(label))

    async def held_here(self) -> set_down.HeldHere:
        """The part that facetd grasped and has in the gripper, and where it is: by WHERE, the same before and after a
        look, and by the part's edges in the look. Nothing moves, and nothing needs to be enabled: people may have
        guided the arm. RefusedError where it is not known."""
        work = set_down.held_here(self._context())
        return await self.supervisor.run("measure the part in the gripper", work, moves=False)

    async def plan_from_side(self, goal: Goal, side: int) -> SidePlan:
        """How a part that lies on a side, from 0, where the table is surveyed, can be brought to a place; nothing
        moves, and nothing needs to be enabled. Raises ValueError where its taught corners span no solid."""
        purpose = f"plan for place {goal.place.name}"
        return await self.supervisor.run(purpose, self._plan_from_side(goal, side), moves=False)

    async def look_at_places(self, goals: Sequence[Goal]) -> None:
        """Look at places, one after the other, and keep what each shows. RefusedError when it may not start, or a part
        is in the gripper."""
        self._may_pick()
        self._must_be_empty()
        await self.supervisor.run("look at places", self._look_at_places(goals))

    async def look_around(self, most: int) -> WorldModel:
        """Look from where the arm stands, and from up to so many places more, each the one that settles most, until
        all that lies there has a name and two sides more show nothing new; what is known then. RefusedError when it may
        not start, or a part is in the hand: it would count as one that lies there, and the arm would go round it."""
        self._must_move_the_cameras("look around")
        self._may_pick()
        self._must_be_empty()
        return await self.supervisor.run("look around", self._around(most))

    async def walk_round(
        self, recogniser: PartRecogniser, count: int, report: Report
    ) -> tuple[CircledPart, list[Look]]:
        """Look at the one thing there is from `count` places round it; recogniser: what the looks are made with. Raises
        NoSinglePartError, RefusedError (see look_around)."""
        self._must_move_the_cameras("teach --around")
        self.supervisor.refuse_unless_permitted()
        self._must_know_the_hand()
        self._must_be_empty()
        context = self._context(recogniser)
        return await self.supervisor.run("walk round", self._walk(context, count, report))

    async def where(self) -> Reading:
        """Ask the controller where the arm is, for people: of one that moves, a place on the way."""
        return await self.supervisor.run("where", self.cell.robot.where(), moves=False)

    async def go(self, position: str) -> None:
        poses = self.positions()
        if position not in poses:
            raise RefusedError(f"no position {position!r}; there are {', '.join(poses)}")
        await self.move_to(poses[position], position)

    async def move_to(self, world_from_tool: Array, purpose: str) -> None:
        """Move to any pose (calibration, teaching), in bounded, guarded steps."""
        await self.supervisor.run(purpose, self._travel(world_from_tool, purpose))

    async def jog(self, there: Callable[[Array], Array], purpose: str) -> Array:
        """A small move on a straight line: there(world_from_tool) says where to, from where the arm is at rest. Gives
        where that is, (4, 4) mm."""

        async def small_move() -> Array:
            target = there((await self.prepare_to_move()).world_from_tool)
            await self.supervisor.mover.travel(target, purpose, lambda _: self.settings.near_pct, straight=True)
            return target

        return await self.supervisor.run(purpose, small_move())

    async def go_down(self, over: Array, down: Array, purpose: str) -> None:
        """To a place above another, and from there straight and slowly down to that: one job, as nobody is to move the
        arm in between."""

        async def ways() -> None:
            await self._travel(over, f"{purpose}, over it")
            await self.supervisor.mover.travel(down, purpose, lambda _: self.settings.near_pct, straight=True)

        await self.supervisor.run(purpose, ways())

    async def wait_until_at_rest(self) -> Array:
        """Where the arm is at rest, world_from_tool (4, 4) mm."""
        reading = await self.supervisor.run("where", self.supervisor.mover.wait_until_at_rest(), moves=False)
        return reading.world_from_tool

    async def set_gripper(self, closed: bool) -> None:
        work = self.supervisor.mover.set_gripper(closed, self.settings.hand_time_s(closed))
        await self.supervisor.run("close the gripper" if closed else "open the gripper", work)

    def positions(self) -> dict[str, Array]:
        """Named positions of the arm (home, bin, survey, survey2, ...) -> world_from_tool."""
        views = enumerate(self.settings.surveys, start=1)
        mounting = self.cell.mounting
        surveys = {"survey" + (str(n) if n > 1 else ""): view.pose(mounting) for n, view in views}
        return {"home": self.settings.home.pose(), "bin": self.settings.bin.pose(), **surveys}

    def recover(self, state: str, closed: bool | None, pick_order: PickOrder | None = None) -> None:
        """At start, after a crash in mid-cycle: nothing moves until resume; a hand that may be full is asked about;
        pick_order: what was left of auto."""
        self.pick_order = pick_order
        self.supervisor.latch(f"restarted: the daemon ended in {state}", FaultCause(CauseCode.RESTARTED))
        if closed is not False:
            self.beliefs.void(VoidingEvent.RESTARTED)
        self.state = PickState.FAULT

    def holding(self, answer: bool) -> None:
        """What the operator sees in the gripper. That it is empty proves less than that facetd has opened it, where
        that is believed already."""
        if answer:
            self.beliefs.learn(BeliefSource.OPERATOR, holding=True)
        elif self.belief.holds_part is not False or self.belief.empty_unproven:
            self.beliefs.learn(BeliefSource.OPERATOR, holding=False, grasped_part=None, held_shape=None)

    # Inside.

    def _may_pick(self) -> None:
        self.supervisor.refuse_unless_permitted()
        self._must_know_the_hand()
        if self.recogniser is None or not self.recogniser.labels:
            raise RefusedError("there is no model: teach and train first")
        if self.production_line.unreadable is not None:
            raise RefusedError(self.production_line.unreadable)

    def _must_move_the_cameras(self, command: str) -> None:
        """Raise RefusedError where a command needs looks from several sides, and the cameras are fixed."""
        if isinstance(self.cell.mounting, InWorld):
            raise RefusedError(f"`{command}` needs cameras on the gripper; the fixed cameras see from one side only")

    def _must_know_the_hand(self) -> None:
        if self.belief.holds_part is None:
            raise RefusedError(
                "facetd does not know whether the gripper holds a part: look into it, then type `holding yes` or "
                "`holding no`"
            )

    def _must_be_empty(self) -> None:
        if self.belief.holds_part:
            raise RefusedError(
                "a part is in the gripper: `hand open` drops it where the arm is, `pick` brings it to the bin"
            )

    def _interrupted(self, what: JobEvent) -> None:
        """What comes over the job from outside, as an event of the table."""
        self._enter(PickEvent(what))

    def _enter(self, event: PickEvent) -> None:
        """The state changes by the table, and the log says so."""
        then = follows(self.state, event, self._held)
        if event is PickEvent.PAUSE:
            self._held = self.state
        before, self.state = self.state, then
        if event is not PickEvent.PAUSE:
            self._held = then
        if (before, then) != (PickState.IDLE, PickState.IDLE):
            self.cell.log.record("state", cycle=self._cycles, event=event, to=then, **{"from": before})

    async def _gate(self, text: str, seen: Callable[[], Awaitable[object]], valid_s: float) -> None:
        """Hold a move: for a pause and step mode, then as long as the line does not permit it."""
        while True:
            await self.supervisor.hold.wait(text, seen, valid_s)
            if not await self.production_line.wait_for_permit(LINE_PERMITS.get(self.state)):
                return
            await seen()

    async def _work_gripper(self, closed: bool, hand_s: float) -> None:
        """Operate the gripper: by digital outputs if the mounted cup's valves are wired to them, else by the hand
        valves."""
        if self.settings.gripper.by_vacuum and self.production_line.has("vacuum"):
            await self.production_line.work_cup(closed, hand_s)
        else:
            await self.supervisor.mover.operate_hand_valves(closed, hand_s)

    def _context(self, recogniser: PartRecogniser | None = None) -> PickContext:
        """recogniser: None for the one in use. Raises RefusedError where there is none."""
        recogniser = self.recogniser if recogniser is None else recogniser
        if recogniser is None:
            raise RefusedError("there is no model: teach and train first")
        cell, mover, part_held = self.cell, self.supervisor.mover, self.production_line.part_held
        return PickContext(
            cell, mover, recogniser, self.settings, self.observer, placing=self.placing, part_held=part_held
        )

    async def _look(self, purpose: str) -> Look:
        context, mover = self._context(), self.supervisor.mover
        before = await mover.wait_until_at_rest() if self.cell.alone is None else await self._set_out_to_look()
        self._must_be_out_of_view(before)
        look = await context.look_exposed(before, purpose)
        if self.cell.alone is not None:  # who looks ten times finds the arm where it was
            await mover.travel(before.world_from_tool, "back from beside", lambda _: self.settings.near_pct, True)
        return look

    async def _locate(self, label: str) -> Array:
        await self._set_out_to_look()
        return await set_down.locate(self._context(), WorldModel([]), label)

    async def _plan_from_side(self, goal: Goal, side: int) -> SidePlan:
        await self.supervisor.mover.wait_until_at_rest()
        settings, mover = self.settings, self.supervisor.mover
        reach = replace(mover.reach, bounds=mover.limits)  # for a gripper that is empty, whatever it may hold now
        lying_at = np.array([*settings.surveys[0].centre_mm[:2], settings.limits.table_z_mm])
        arm = settings, self.cell.mounting, reach, self.cell.rig
        return await self.cell.compute(plan_from_side, goal, side, lying_at, *arm)

    async def _look_at_places(self, goals: Sequence[Goal]) -> None:
        await self._set_out_to_look()
        for goal in goals:
            await set_down.look_at(self._context(), WorldModel([]), goal)

    async def _around(self, most: int) -> WorldModel:
        context, world = self._context(), WorldModel([])
        await world.add_look(context, await context.look_exposed(await self._set_out_to_look(), "look around"))
        idle = 0
        for _ in range(0 if context.mover.dry else most):
            world.doubtful, before = find.next_unnamed_part(context, world), find.describe_parts(world.found)
            if world.doubtful is not None:
                await find.second_view(context, world)
            elif not await find.look_from_other_side(context, world):
                break
            idle = idle + 1 if find.describe_parts(world.found) == before else 0
            if world.doubtful is None and idle == IDLE_LOOKS:
                break
        return world

    async def _walk(self, context: PickContext, count: int, report: Report) -> tuple[CircledPart, list[Look]]:
        await self._set_out_to_look()
        return await look_from_around(context, count, report)

    async def _travel(self, target: Array, purpose: str) -> None:
        await self.prepare_to_move()
        await self.supervisor.mover.travel(target, purpose, lambda _: self.settings.travel_pct)

    async def prepare_to_move(self) -> Reading:
        """Where the arm is at rest, from where a job may go: each that moves begins so."""
        self.guard_the_hand()
        return await self.supervisor.mover.wait_until_at_rest()

    async def _set_out_to_look(self) -> Reading:
        """From where the arm stands. Raises RefusedError where it would go aside for the second picture of one camera,
        among the parts."""
        here = await self.prepare_to_move()
        if self.cell.alone is not None and self.supervisor.mover.low:
            raise RefusedError(
                "with one camera a look moves the gripper aside, and it is low over the table: raise it first, "
                "for example `jog z 50`"
            )
        return here

    def _must_be_out_of_view(self, here: Reading) -> None:
        """Raise RefusedError where fixed cameras have the arm in view: it may hide a part."""
        cell, limits = self.cell, self.settings.limits
        if not isinstance(cell.mounting, InWorld):
            return
        links, body = cell.robot.kinematics.frames(here.joints_rad[None])[0], body_of(limits.capsules, limits.body_mm)
        piece = in_view(links, body, cell.rig, cell.mounting.world_from_cyclopean)
        if piece is not None:
            raise RefusedError(f"the arm's {piece} is in the fixed cameras' view: `go home` first")

    def guard_the_hand(self) -> None:
        """Guard a part that may be in the gripper in an unknown pose, as the longest taught part in any orientation,
        also one that was taught since. This includes a gripper that is only assumed to be empty: a pendant may have
        closed it on a part. Raises RefusedError if nothing is known of the gripper and no part is taught: any part
        could be in it."""
        if not self.belief.may_hold:
            return
        self._assume_the_longest()
        if self.belief.holds_part is not False and not self.belief.capsules:
            raise RefusedError(
                "a part may be in the gripper, and none is taught, so that facetd does not know how large it may be: "
                "look into the gripper: if it is empty, type `holding no`; if not, `hand open`"
            )

    def _assume_the_longest(self) -> None:
        """Guard what may be in the hand as the longest part of the model, or as what was assumed before."""
        load, recogniser, gripper = self.belief.held_shape, self.recogniser, self.settings.gripper
        if load is not None and load.source is not BeliefSource.ASSUMED:  # facetd grasped it, and knows how it lies
            return
        shapes = [] if recogniser is None else [recogniser.shape(label) for label in recogniser.labels]
        held = held_anyhow([shape.corners_mm for shape in shapes if shape is not None], *gripper.holding_volume)
        loads = self.belief.capsules + (() if held is None else (held,))
        if loads:
            self.beliefs.learn(BeliefSource.ASSUMED, held_shape=(max(loads, key=lambda load: load.radius_mm),))

    def _set_order(self, pick_order: PickOrder | None) -> None:
        """What auto has to bring from now on; None: it is done, or given up."""
        if pick_order == self.pick_order is None:
            return
        self.pick_order = pick_order
        self.cell.log.record("auto", **auto_record(pick_order))

    def _seconds_left(self) -> float | None:
        """How long what is left of auto will take: as each of the last parts took (s). None: nobody knows."""
        took = [end.seconds for end in islice(reversed(self.ends), LATEST) if end.brought]
        count = None if self.pick_order is None else self.pick_order.count
        return None if count is None or not took else count * statistics.median(took)

    def _auto_over(self, _: asyncio.Task[list[CycleEnd]]) -> None:
        self._auto = False

    async def _run_auto(self) -> list[CycleEnd]:
        ends: deque[CycleEnd] = deque(maxlen=KEPT_ENDS)
        try:
            while self._auto and self.pick_order is not None and not self.pick_order.done:
                if self.pick_order.on_signal and not await self._wait_for_request():
                    break
                ends.append(await self._run_cycle(self.pick_order))
                every_s = self.pick_order.every_s
                stopped = ends[-1].ended_by is not None
                if ends[-1].brought and not stopped and not await self._report_to_line():
                    break
                if self._auto and stopped and not self.pick_order.done:
                    return list(ends)
                if ends[-1].outcome is Outcome.DRY:
                    break
                if ends[-1].outcome in (*BROUGHT, Outcome.EMPTIED):
                    self._left_alone = tuple(s for s in self._left_alone if s.outcome is Outcome.MISSED)
                elif self._auto and self.pick_order.skip:
                    self._set_order(self.pick_order.without_wanted())
                elif self._auto and every_s is None and self.pick_order.job is not None:
                    return list(ends)  # its part is missing: once it is there, the job can be resumed
                else:
                    every_s = LINE_LOOKS_S if self.pick_order.on_signal else every_s
                    if every_s is None or not self._auto:
                        break
                    with contextlib.suppress(TimeoutError):
                        async with asyncio.timeout(every_s):
                            await self._end_wait.wait()
                    self._left_alone = ()
            self._set_order(None)
        except asyncio.CancelledError:
            pass  # stopped while it waited for parts: the arm stands, and the caller gets what was picked
        return list(ends)

    async def _report_to_line(self) -> bool:
        """Have the line know that a part was brought; false where its signals cannot be read."""
        return await self._read_signals_or_stop(self.production_line.brought()) is not False

    async def _wait_for_request(self) -> bool:
        """Whether the line asks for a part, once it does; false where auto is to end."""
        return bool(await self._read_signals_or_stop(self.production_line.wanted(lambda: self._auto)))

    async def _read_signals_or_stop(self, asked: Awaitable[bool | None]) -> bool | None:
        """Read the signals of the production line; if that fails, stop the arm with a fault and return False."""
        try:
            return await asked
        except Exception as error:
            await self._stop_arm(JobEvent.ERROR, f"signals: {error}", f"signals: {error}", cause_of(error))
            return False

    async def _run_single(self, label: str | None) -> CycleEnd:
        self._left_alone = ()
        return await self._run_cycle(PickOrder(1, steps=() if label is None else (OrderStep(label),)))

    async def _run_cycle(self, order: PickOrder) -> CycleEnd:
        """Run the machine from idle back to idle, or to fault."""
        context, supervisor, mover = self._context(), self.supervisor, self.supervisor.mover
        self._cycles += 1
        mover.cycle = self._cycles
        started_s = self.cell.clock()
        self.cell.log.record("cycle_start", cycle=self._cycles, target=order.only)
        context = replace(context, cycle=self._cycles, order=order)
        world = self._world = WorldModel(list(self._left_alone), began_s=started_s)
        try:
            await self._run_states(context, world)
        except asyncio.CancelledError:
            by = supervisor.ended_by if supervisor.permission.fault and supervisor.ended_by else JobEvent.ABORT
            code = supervisor.stop_cause.code if supervisor.permission.fault else CauseCode.OPERATOR_ABORT
            self._cut_short(world, by, supervisor.fault_text or "a person gave `abort`", code)
        except OperatorRefusedError as error:
            self._cut_short(world, JobEvent.ABORT, str(error), CauseCode.OPERATOR_NO)
            await self._stop_arm(JobEvent.ABORT, str(error), None)
        except Exception as error:
            why, cause = error_text(error), cause_of(error)
            world.gripper_opened &= cause.code is not CauseCode.SENSOR_DISAGREES
            self._cut_short(world, JobEvent.ERROR, why, cause.code)
            await self._stop_arm(JobEvent.ERROR, why, why, cause)
        end = self._ended(world, started_s)
        self._left_alone, self._world = tuple(world.skipped), None
        notify(self.observer, end)
        return end

    def _cut_short(self, world: WorldModel, by: JobEvent, why: str, code: CauseCode) -> None:
        """Record a stop as the outcome of the pick. A pick that has already released its part, or only goes home, keeps
        its outcome, and its record has the stop beside it."""
        world.ended_by = by
        if not (world.gripper_opened or world.going_home):
            outcome = Outcome.FAULT if by is JobEvent.ERROR else Outcome.ABORTED
            world.result = PickResult(outcome, why, code)
            return
        world.stopped_by, world.result = code, replace(world.result, why=f"{world.result.why}; then {why}")
        if world.gripper_opened and not world.brought:
            self._brought(world)
            self._set_order(self.pick_order)

    async def _stop_arm(self, event: JobEvent, why: str, fault: str | None, cause: FaultCause = BY_OPERATOR) -> None:
        """Stop the arm; if somebody else stops it at the same time, still record how this pick ended."""
        with contextlib.suppress(asyncio.CancelledError):
            await self.supervisor.stop_arm(event, why, fault, cause)

    async def _run_states(self, context: PickContext, world: WorldModel) -> None:
        await self.prepare_to_move()
        if self.belief.holds_part:
            world.result = PickResult(Outcome.EMPTIED, "put down what was in the gripper", None)
        self._enter(PickEvent.FULL_HAND if self.belief.holds_part else PickEvent.BEGIN)
        if self.belief.empty_unproven:
            await take.release_over_bin(context, world, "bin, to open the gripper first")
        while self.state is not PickState.IDLE:
            event = await HANDLERS[self.state](context, world)
            if event in (PickEvent.GONE, PickEvent.MEASURED):
                self.beliefs.learn(BeliefSource.OBSERVED, holding=True)
            if event in (PickEvent.BINNED, PickEvent.SET_DOWN):
                self._brought(world)
            self._enter(event)

    def _brought(self, world: WorldModel) -> None:
        """What was in the gripper was let go where it was to go: auto has less to bring."""
        label = None if world.target is None else world.target.label
        world.brought = label is not None
        if self.pick_order is not None:
            self.pick_order = self.pick_order.brought(label)

    def _ended(self, world: WorldModel, started_s: float) -> CycleEnd:
        target = world.target or world.last_target
        estimate = None if target is None else target.estimate
        end = CycleEnd(
            cycle=self._cycles,
            outcome=world.result.outcome,
            label=None if target is None else target.label,
            why=world.result.why,
            stops=0 if target is None else target.looks,
            seconds=self.cell.clock() - started_s,
            predicted_mm=None if estimate is None else estimate.predicted_mm,
            predicted_deg=None if estimate is None else estimate.predicted_deg,
            grasp=None if target is None else target.plan.grasp.world_from_tool,
            skipped=tuple(world.skipped[len(self._left_alone) :]),
            corners=None if target is None else frames.apply(target.world_from_part, target.shape.corners_mm),
            brought=world.brought and world.result.outcome in BROUGHT,
            place=world.set_down_at,
            ended_by=world.ended_by,
        )
        self.ends.append(end)
        self.tally[end.outcome] += 1
        self.cell.log.record(
            "cycle_end",
            cycle=end.cycle,
            outcome=end.outcome,
            code=world.result.code,
            label=end.label,
            stops=end.stops,
            why=end.why,
            stopped=world.stopped_by,
            grasp=end.grasp,
            predicted={"mm": end.predicted_mm, "deg": end.predicted_deg},
            skipped=[{"label": s.label, "at": s.centre, "outcome": s.outcome, "why": s.why} for s in end.skipped],
        )
        return end
