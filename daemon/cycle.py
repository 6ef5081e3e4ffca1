"""The pick cycle: one state machine, printed as one table. What moves the arm is decided here and nowhere else.

The console and the service talk to one `Cycle` object (all calls from the one event loop):

    cycle = Cycle(cell: Workcell, settings: Settings, model: Model | None)
    cycle.state                     a state of TABLE below
    cycle.status() -> dict          state, fault, enabled, paused, stepping, pending, dry, cycle, target, stop, picked,
                                    failed, predicted_mm, predicted_deg, holding, last (all JSON values)
    cycle.use(model)                the model for the next look on (None: picking is refused, looking is not)
    cycle.enable()                  the arm may move from now on
    await cycle.disable()           it may not; stops the arm first when it moves
    await cycle.pick(label=None)    one part, nearest first or the one named -> CycleEnd; raises Refused when it may not start
    await cycle.auto(count=None, wait_s=None)   pick until the table is empty, count is reached or auto_off() -> list[CycleEnd];
                                    wait_s: an empty table is looked at again at that interval instead of ending
    cycle.auto_off()                ends after the part in hand is placed
    await cycle.look(purpose)       one settled look from where the arm stands -> Look(scene, pictures, world_from_cyclopean,
                                    reading, settled_s, seconds); nothing moves; also without enable
    await cycle.go(place)           to a named place of the settings: home, survey, ... (a guarded joint move)
    await cycle.hand(closed)        the gripper
    await cycle.stop(why)           the arm first, then the report; leaves the fault `stopped` standing
    await cycle.fail(code, text)    the same for a watchdog or a lost device
    await cycle.abort()             the arm first; the part is given up, no fault is left
    cycle.pause() / cycle.resume()  before the next move / go on. resume also clears a fault (then nothing goes on by itself)
    cycle.step(on)                  each move waits: status()["pending"] tells it in words until confirm() or refuse()
    cycle.confirm() / cycle.refuse()
    cycle.dry(on)                   everything but the bytes: moves are guarded, logged as dry and not sent
    cycle.holding(answer)           the operator's word for what is in the gripper after a restart
    await cycle.close()             the arm first, then every task of the cycle

pick, auto, look, go and hand run one at a time; a second one raises Refused("busy: ..."). stop, fail, abort and pause are
heard at any moment.
"""

from __future__ import annotations

from typing import NamedTuple


class Row(NamedTuple):
    """In this state this event leads there."""

    state: str
    event: str
    then: str


TABLE: tuple[Row, ...] = (
    Row("idle", "begin", "survey"),
    Row("survey", "seen", "choose"),
    Row("survey", "nothing", "home"),
    Row("choose", "chosen", "stop_n"),
    Row("choose", "ambiguous", "second_view"),
    Row("choose", "none_left", "home"),
    Row("second_view", "seen", "choose"),
    Row("stop_n", "there", "looking"),
    Row("stop_n", "unreachable", "choose"),
    Row("looking", "looked", "estimating"),
    Row("looking", "lost", "choose"),
    Row("estimating", "unsure", "stop_n"),
    Row("estimating", "sure", "final"),
    Row("estimating", "gave_up", "choose"),
    Row("final", "there", "closing"),
    Row("closing", "closed", "retreat"),
    Row("retreat", "there", "verify"),
    Row("verify", "gone", "place"),
    Row("verify", "missed", "choose"),
    Row("place", "placed", "home"),
    Row("home", "there", "idle"),
)
