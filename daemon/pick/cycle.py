"""The pick cycle: one state machine (its table: pick/transitions.py). When the arm moves or stops is decided here.

The console and the service talk to one `Cycle` object (all calls from the one event loop):

    cycle = Cycle(cell, settings, sight)    a Workcell, Settings (pick/plan.py), a Recogniser (pick/looking.py) or None
    cycle.state                     a state of TABLE (daemon/pick/transitions.py)
    cycle.status() -> dict          JSON values, see `status`
    cycle.use(sight)                the recogniser and model from the next pick on (None: picking is refused)
    cycle.enable()                  the arm may move from now on
    await cycle.disable()           it may not; stops the arm first when it moves
    await cycle.pick(label=None) -> CycleEnd    one part; RefusedError when it may not start
    await cycle.auto(count=None, wait_s=None) -> list[CycleEnd]
                                    pick until the table is empty, count is reached or auto_off(); wait_s: an empty
                                    table is looked at again at that interval instead of ending
    cycle.auto_off()                ends after the part in hand is placed; gives up what is left of an auto cut off
    cycle.pick_order                what auto has still to bring; stays where a stop, a fault or a restart cuts it off
    await cycle.look(purpose) -> Look   one settled look from where the arm stands; nothing moves; also without enable
    await cycle.where() -> Reading  ask the controller
    await cycle.go(place)           home, bin, survey, survey2, ...: a guarded move
    await cycle.move_to(world_from_tool, purpose)   a guarded move to any pose (calibration, teaching)
    await cycle.hand(closed)        the gripper
    await cycle.stop(why)           the arm first, then the report; leaves the fault `stopped` standing
    await cycle.fail(code, text)    the same for a watchdog or a lost device
    await cycle.abort()             the arm first; the pick is given up, no fault is left
    cycle.pause() / cycle.resume()  before the next move / go on. resume clears a fault, too (nothing goes on alone)
    cycle.step(on)                  each move waits: status()["pending"] tells it in words until confirm() or refuse()
    cycle.confirm() / cycle.refuse()
    cycle.dry(on)                   everything but the bytes: moves are guarded, logged as not sent, and not sent
    cycle.recover(state, closed, pick_order)    at start, after a crash in mid-cycle: a fault stands, and holding()
                                    must be answered; pick_order: what was left of auto
    cycle.holding(answer)           the operator's word for whether a part is in the gripper
    await cycle.close()             the arm first, then every task of the cycle

pick, auto, look, go, move_to and hand run one at a time; a second one raises RefusedError("busy: ..."). stop, fail,
abort and pause are heard at any moment. A pick goes on when the one who asked for it goes away.
"""

from __future__ import annotations

import asyncio
from collections import Counter, deque
from collections.abc import Awaitable, Callable
from dataclasses import dataclass

from daemon import frames
from daemon.arm.supervisor import OperatorRefusedError, RefusedError, Supervisor
from daemon.arm.workcell import Array, Reading, Workcell
from daemon.pick.looking import Look, Recogniser, log_look, take_look
from daemon.pick.order import PickOrder
from daemon.pick.picking import Pick, PickContext, Skipped
from daemon.pick.settings import Settings
from daemon.pick.transitions import NEXT, TABLE, printed_table

__all__ = ["NEXT", "TABLE", "Cycle", "CycleEnd", "RefusedError", "printed_table"]


HANDLERS: dict[str, Callable[[Pick], Awaitable[str]]] = {
    "survey": Pick.survey,
    "choose": Pick.choose,
    "second_view": Pick.second_view,
    "stop_n": Pick.stop_n,
    "looking": Pick.looking,
    "estimating": Pick.estimating,
    "final": Pick.final,
    "closing": Pick.closing,
    "retreat": Pick.retreat,
    "verify": Pick.verify,
    "place": Pick.place,
    "home": Pick.home,
}
HAND_IN_DOUBT = ("closing", "retreat", "verify", "place")


@dataclass(frozen=True, eq=False)
class CycleEnd:
    """How a pick ended. outcome: picked, missed, empty, lost, ambiguous, unknown, unreachable, unsure, dry, placed,
    aborted, fault; skipped: parts left alone in this pick; grasp: world_from_tool at the grasp;
    corners: (N, 3) world mm, where the part's corners were estimated to be."""

    cycle: int
    outcome: str
    label: str | None
    why: str
    stops: int
    seconds: float
    predicted_mm: float | None
    predicted_deg: float | None
    grasp: Array | None
    skipped: tuple[Skipped, ...]
    corners: Array | None


KEPT_ENDS = 1000
"""How many ended picks are kept in memory (the run log has all): a daemon runs for years."""


class Cycle(Supervisor):
    """The one who moves the arm. See the module for its interface; stop, pause and the like are in Supervisor."""

    def __init__(self, cell: Workcell, settings: Settings, sight: Recogniser | None = None) -> None:
        super().__init__(cell, settings.limits, settings.arrival)
        self.settings, self.sight = settings, sight
        self.state = self._before_pause = "idle"
        self.ends: deque[CycleEnd] = deque(maxlen=KEPT_ENDS)
        self.tally: Counter[str] = Counter()
        self.skipped: list[Skipped] = []
        self.hand_full: bool | None = False
        self.pick_order: PickOrder | None = None
        """What auto has still to bring; where auto is not on, it was cut off."""
        self._pick: Pick | None = None
        self._cycles = 0
        self._auto = False

    def status(self) -> dict[str, object]:
        """How things stand, JSON values only."""
        target = None if self._pick is None else self._pick.target
        estimate = None if target is None else target.estimate
        return {
            "state": self.state,
            **self.reins(),
            "auto": self._auto,
            "left": None
            if self.pick_order is None
            else {"count": self.pick_order.count, "every_s": self.pick_order.every_s},
            "cycle": self._cycles,
            "target": None if target is None else target.label,
            "stop": None if target is None else target.looks,
            "predicted_mm": None if estimate is None else round(estimate.predicted_mm, 3),
            "predicted_deg": None if estimate is None else round(estimate.predicted_deg, 3),
            "holding": self.hand_full,
            "picked": self.tally["picked"],
            "failed": sum(self.tally[outcome] for outcome in ("missed", "lost", "fault")),
            "skipped": [
                {"label": s.label, "at": s.centre.round(1).tolist(), "why": f"{s.outcome}: {s.why}"}
                for s in self.skipped
            ],
            "last": None if not self.ends else f"{self.ends[-1].outcome}: {self.ends[-1].why}",
        }

    def use(self, sight: Recogniser | None) -> None:
        """Take another recogniser or model into use, from the next pick on."""
        self.sight = sight

    def refit(self, cell: Workcell, settings: Settings) -> None:
        """Go on with another calibration or other settings (a reload); only while nothing is being done."""
        if self._task is not None:
            raise RefusedError(f"busy: {self._doing}; settings are changed in between")
        self.cell, self.settings = cell, settings
        self.mover.cell, self.mover.limits, self.mover.arrival = cell, settings.limits, settings.arrival

    async def pick(self, label: str | None = None) -> CycleEnd:
        """Pick one part."""
        self._may_pick()
        self.skipped = []
        return await self.alone("pick", self._one(label, stay=False))

    async def auto(self, count: int | None = None, wait_s: float | None = None) -> list[CycleEnd]:
        """Pick one part after the other; see the module."""
        self._may_pick()
        self.skipped = []
        return await self.alone("auto", self._many(PickOrder(count, wait_s)))

    def auto_off(self) -> None:
        """End auto after the part in hand; where it was cut off, give up what is left."""
        if self._task is None:
            self._take(None)
        self._auto = False

    async def look(self, purpose: str = "look") -> Look:
        """One settled look from where the arm stands."""
        return await self.alone("look", self._look(purpose), moves=False)

    async def where(self) -> Reading:
        """Ask the controller where the arm is."""
        return await self.alone("where", self.mover.where(), moves=False)

    async def go(self, place: str) -> None:
        """Move to a named place."""
        poses = self.places()
        if place not in poses:
            raise RefusedError(f"no place {place!r}; there are {', '.join(poses)}")
        await self.move_to(poses[place], place)

    async def move_to(self, world_from_tool: Array, purpose: str) -> None:
        """Move to any pose, in bounded, guarded steps."""
        await self.alone(purpose, self._travel(world_from_tool, purpose))

    async def hand(self, closed: bool) -> None:
        """Open or close the gripper."""
        await self.alone("close the hand" if closed else "open the hand", self.mover.hand(closed))
        self.hand_full = None if closed else False

    def places(self) -> dict[str, Array]:
        """Named places -> world_from_tool."""
        views = enumerate(self.settings.surveys, start=1)
        tool_from_cyclopean = self.cell.tool_from_cyclopean
        surveys = {"survey" + (str(n) if n > 1 else ""): view.pose(tool_from_cyclopean) for n, view in views}
        return {"home": self.settings.home.pose(), "bin": self.settings.bin.pose(), **surveys}

    def recover(self, state: str, closed: bool | None, pick_order: PickOrder | None = None) -> None:
        """After a crash in mid-cycle: nothing moves until resume; a hand that may be full is asked about."""
        self.pick_order = pick_order
        self.mover.fault = f"restarted: the daemon ended in {state}"
        self.hand_full = None if closed is not False else False
        self.state = "fault"

    def holding(self, answer: bool) -> None:
        """What the operator sees in the gripper."""
        self.hand_full = answer

    # Inside.

    def _may_pick(self) -> None:
        self.may_move()
        if self.hand_full is None:
            raise RefusedError("it is not known whether a part is in the gripper: say `holding yes` or `holding no`")
        if self.sight is None or not self.sight.labels:
            raise RefusedError("there is no model: teach and train first")

    def entered(self, event: str) -> None:
        """The state changes by the table, and the log says so."""
        then = NEXT.get((self.state, event)) or NEXT[("*", event)]
        then = self._before_pause if then == "back" else then
        if event == "pause":
            self._before_pause = self.state
        elif event in ("stop", "error", "abort") and {self.state, self._before_pause} & set(HAND_IN_DOUBT):
            self.hand_full = None
        if (self.state, then) != ("idle", "idle"):
            self.cell.log.record("state", cycle=self._cycles, event=event, to=then, **{"from": self.state})
        self.state = then
        if event == "placed" and self.pick_order is not None:
            self.pick_order = self.pick_order.one_less()
        if event != "pause":
            self._before_pause = then

    async def _look(self, purpose: str) -> Look:
        if self.sight is None:
            raise RefusedError("there is no recogniser to look with")
        reading = await self.mover.where()
        settings = self.settings
        rest_s, table_z_mm = self.cell.clock(), settings.limits.table_z_mm
        look = await take_look(self.cell, self.sight, reading, rest_s, settings.settling, table_z_mm)
        log_look(self.cell, self.sight, look, cycle=0, stop=0, purpose=purpose)
        return look

    async def _travel(self, target: Array, purpose: str) -> None:
        await self.mover.where()
        await self.mover.travel(target, purpose, lambda _: self.settings.travel_pct)

    def _take(self, pick_order: PickOrder | None) -> None:
        """What auto has to bring from now on; None: it is done, or given up."""
        if pick_order == self.pick_order is None:
            return
        self.pick_order = pick_order
        on = pick_order is not None
        self.cell.log.record(
            "auto", on=on, count=pick_order and pick_order.count, every_s=pick_order and pick_order.every_s
        )

    async def _many(self, pick_order: PickOrder) -> list[CycleEnd]:
        ends: deque[CycleEnd] = deque(maxlen=KEPT_ENDS)
        self._auto = True
        self._take(pick_order)
        try:
            while self._auto and self.pick_order is not None and not self.pick_order.done:
                ends.append(await self._one(None, stay=self.pick_order.count != 1))
                if ends[-1].outcome in ("aborted", "fault"):
                    return list(ends)
                if ends[-1].outcome == "dry":
                    break
                if ends[-1].outcome in ("picked", "placed"):
                    self.skipped = [s for s in self.skipped if s.outcome == "missed"]
                else:
                    if pick_order.every_s is None:
                        break
                    await asyncio.sleep(pick_order.every_s)
                    self.skipped = []
            self._take(None)
        except asyncio.CancelledError:
            pass  # stopped while it waited for parts: the arm stands, and what was picked is told
        finally:
            self._auto = False
        return list(ends)

    async def _one(self, label: str | None, stay: bool) -> CycleEnd:
        """Run the machine from idle back to idle, or to fault."""
        assert self.sight is not None
        self._cycles += 1
        self.mover.cycle = self._cycles
        before, started_s = len(self.skipped), self.cell.clock()
        self.cell.log.record("cycle_start", cycle=self._cycles, target=label)
        bench = PickContext(self.cell, self.mover, self.sight, self.settings)
        pick = self._pick = Pick(bench, self._cycles, label, self.skipped, stay)
        try:
            await self._through(pick)
        except asyncio.CancelledError:
            pick.outcome, pick.why = ("fault" if self.mover.fault else "aborted"), self.mover.fault or "aborted"
        except OperatorRefusedError as error:
            await self.stop_arm("abort", str(error), None)
            pick.outcome, pick.why = "aborted", str(error)
        except Exception as error:
            pick.outcome, pick.why = "fault", f"{type(error).__name__}: {error}"
            await self.stop_arm("error", pick.why, pick.why)
        end = self._ended(pick, before, started_s)
        self._pick = None
        return end

    async def _through(self, pick: Pick) -> None:
        await self.mover.where()
        if self.hand_full:
            pick.outcome, pick.why = "placed", "put down what was in the hand"
        self.entered("full_hand" if self.hand_full else "begin")
        while self.state != "idle":
            state = self.state
            event = await HANDLERS[state](pick)
            if (state, event) == ("verify", "gone"):
                self.hand_full = True
            elif event in ("placed", "missed"):
                self.hand_full = False
            self.entered(event)

    def _ended(self, pick: Pick, before: int, started_s: float) -> CycleEnd:
        target = pick.target or pick.last
        estimate = None if target is None else target.estimate
        end = CycleEnd(
            cycle=self._cycles,
            outcome=pick.outcome,
            label=None if target is None else target.label,
            why=pick.why,
            stops=0 if target is None else target.looks,
            seconds=self.cell.clock() - started_s,
            predicted_mm=None if estimate is None else estimate.predicted_mm,
            predicted_deg=None if estimate is None else estimate.predicted_deg,
            grasp=None if target is None else target.plan.grasp.world_from_tool,
            skipped=tuple(self.skipped[before:]),
            corners=None if target is None else frames.apply(target.world_from_part, target.shape.corners_mm),
        )
        self.ends.append(end)
        self.tally[end.outcome] += 1
        self.cell.log.record(
            "cycle_end",
            cycle=end.cycle,
            outcome=end.outcome,
            label=end.label,
            stops=end.stops,
            why=end.why,
            grasp=end.grasp,
            predicted={"mm": end.predicted_mm, "deg": end.predicted_deg},
            skipped=[{"label": s.label, "at": s.centre, "outcome": s.outcome, "why": s.why} for s in end.skipped],
        )
        return end
