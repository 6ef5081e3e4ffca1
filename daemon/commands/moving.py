"""Commands that let the arm move, pause it, or stop it. The pick cycle makes and guards every motion."""

import asyncio
from typing import Any

from daemon.arm import Grant, JobEvent, RefusedError, StopRefusedError
from daemon.commands import camera_selection
from daemon.commands.step_mode import POLL_S, decide, refuse_hasty_confirm, refuse_hasty_resume, with_questions
from daemon.config import gripper_unknown
from daemon.console.context import CommandContext
from daemon.console.interpreter import CommandResult, Frontend, command, no_more, number, one_of, yes_or_no
from daemon.console.notices import NoticeLevel
from daemon.console.phrases import NO, YES, cut_off, plural
from daemon.errors import DONE, NOT_DONE, NOT_UNDERSTOOD, CommandError
from daemon.events.outcomes import Outcome
from daemon.events.pick_order import PickOrder
from daemon.pick.outcome import CycleEnd

MOST_PICKS = 1_000_000
PAUSED = "Motion is paused: `resume` continues."
AUTO_WORDS = ("on", "off", "wait", "resume")
AUTO_USAGE = "auto on [N] [every S|signal] | auto resume | auto off | auto wait"


@command("enable", "move", first=True)
async def enable(context: CommandContext, words: list[str], frontend: Frontend) -> CommandResult:
    """Enable the arm, after its stop is tested.

    facetd sends the stop word (arm.dialect.abort_word) once after each opening of the serial line. It does not
    enable an arm whose controller rejects that word. A `stop` or `disable` from any console cancels an earlier
    `enable`. Without a hand-eye calibration the arm is enabled for `robot` only, and you are asked first.
    """
    if context.hardware.kind == "recorded":
        raise CommandError("this cell is a recording: it has no arm to move")
    if context.config.gripper is None:
        raise CommandError(f"not enabled: {gripper_unknown(context.config)}")
    supervisor = context.cycle.supervisor
    asked = supervisor.stops
    grant = Grant.ALL if _has_hand_eye(context) else await _ask_robot_only(context, frontend)
    try:
        await supervisor.test_stop()
    except StopRefusedError as refused:
        raise CommandError(f"not enabled: {refused}: correct arm.dialect.abort_word and restart facetd") from None
    if grant is Grant.ALL and not _has_hand_eye(context):
        raise CommandError(
            "not enabled: the calibration in use has no hand_eye any more; `calibrate list` shows the others"
        )
    supervisor.enable(asked, grant)
    fault = supervisor.fault_text
    may = "The arm is enabled." if grant is Grant.ALL else "The arm is enabled for `robot` only."
    return CommandResult(may + (f" Clear the fault first: `resume` ({fault})." if fault else ""))


def _has_hand_eye(context: CommandContext) -> bool:
    """Whether the pose of the cameras is calibrated, on the hand or in the world: without it no move is permitted."""
    return context.calibration.hand_eye is not None


async def _ask_robot_only(context: CommandContext, frontend: Frontend) -> Grant:
    """Ask whether to enable the arm for `robot` only. Raises CommandError on anything but a yes."""
    lack = f"{context.config.calibration} has no hand_eye yet"
    if not frontend.asks:
        raise CommandError(f"{lack}: measure one with a ruler. For `robot cal` alone, enable at a console")
    if not await yes_or_no(frontend, f"{lack}. Enable the arm for `robot cal` and `robot monitor` only? [y/n]"):
        raise CommandError(f"not enabled: {lack}")
    return Grant.TYPED_LINES


@command("disable", "move", at_once=True)
async def disable(context: CommandContext, words: list[str], _: Frontend) -> CommandResult:
    """Disable the arm; stop it if it moves."""
    return _stop_result(await context.cycle.supervisor.disable(), "The arm is disabled; `enable` lets it move again.")


@command("stop", "move", most=None, at_once=True, aliases=("halt",), first=True)
async def stop(context: CommandContext, _: list[str], frontend: Frontend) -> CommandResult:
    """Stop the arm now; nothing moves until `resume`.

    Works at every console and at any moment, before anything else. `sto`, `STOP!`, `halt` and control-C do the
    same. facetd repeats the stop word until two WHERE answers agree that the arm is at rest. If it cannot confirm
    that, it tells you to press the emergency stop, and keeps trying. Commands that wait are dropped.
    """
    alarm = await context.cycle.supervisor.stop(f"by {frontend.who}")
    return _stop_result(alarm, "Stopped. Nothing moves until `resume`.")


def _stop_result(alarm: str | None, text: str) -> CommandResult:
    return CommandResult(text) if alarm is None else CommandResult(alarm, {"error": alarm}, NOT_DONE)


@command("resume", "move", at_once=True)
async def resume(context: CommandContext, words: list[str], frontend: Frontend) -> CommandResult:
    """Continue after `pause`, or clear a fault.

    Clearing a fault starts nothing: use `pick`, `auto on` or `auto resume` then. If an auto was interrupted, facetd
    asks whether to enable the arm and continue it; if you answer n, it clears the fault and nothing moves.
    After a camera fault facetd tests both cameras; if only one works, it asks whether to use that one alone.
    Refused while a stop is under way, and within one second of somebody else's `pause`.
    """
    supervisor = context.cycle.supervisor
    refuse_hasty_resume(context, frontend)
    paused, stops, pauses = supervisor.hold.paused, supervisor.stops, supervisor.hold.pauses
    fault = supervisor.permission.fault
    if fault is None:
        supervisor.resume()
        nothing = "Nothing to resume: no fault is active, and motion is not paused."
        return CommandResult("Motion resumed." if paused else nothing)
    supervisor.refuse_while_stopping("resume")
    lines = [f"Fault cleared: {fault}."]
    camera_text = await camera_selection.offer_one_camera(context, fault, frontend)
    lines += [] if camera_text is None else [camera_text]
    if context.cycle.belief.holds_part is None and frontend.asks:
        held = await yes_or_no(frontend, "Is a part in the gripper? [y/n]")
        if held is not None:
            supervisor.refuse_if_stopped_since(stops, "resume")
            if supervisor.permission.fault is None or context.cycle.belief.holds_part is not None:
                raise CommandError("another operator resumed meanwhile; `status` shows what the gripper holds")
            lines.append(_set_holding(context, held))
    known, pick_order = context.cycle.belief.holds_part is not None, context.cycle.pick_order
    may_enable = _has_hand_eye(context) and context.config.gripper is not None
    if known and pick_order is not None and frontend.asks and may_enable:
        left = cut_off(pick_order)
        agreed = await yes_or_no(frontend, f"{left}. Enable the arm and continue? [y/n]")
        if agreed is None:
            raise CommandError(f"not resumed, the fault is still active: {fault.text}; `resume` asks again")
        if not agreed:
            return _clear_fault(context, lines, stops, pauses)
        await supervisor.test_stop()
        if not _has_hand_eye(context):
            raise CommandError(
                "not resumed: the calibration in use has no hand_eye any more; `calibrate list` shows the others"
            )
        if context.cycle.pick_order != pick_order:
            raise CommandError(
                "another operator resumed or cancelled the interrupted auto meanwhile; `status` shows what runs"
            )
        supervisor.resume(stops, pauses)
        supervisor.enable(stops)
        try:
            await context.begin_auto(pick_order)
        except RefusedError as refused:  # another operator was faster; report that the fault is cleared all the same
            lines.append(f"{left}. facetd did not continue it: {refused}. Then: `auto resume`.")
            return CommandResult("\n".join(lines))
        lines.append("Auto resumed; `auto off` ends it after the current part.")
        return CommandResult("\n".join([*lines, PAUSED] if supervisor.hold.paused else lines))
    return _clear_fault(context, lines, stops, pauses)


def _clear_fault(context: CommandContext, lines: list[str], stops: int, pauses: int) -> CommandResult:
    """Clear the fault, start nothing, and say what to type next. stops, pauses: their numbers before `resume`."""
    supervisor, pick_order = context.cycle.supervisor, context.cycle.pick_order
    supervisor.resume(stops, pauses)
    if context.cycle.belief.holds_part is None:
        lines.append("Report whether a part is in the gripper before the next pick: `holding yes` or `holding no`.")
    if not supervisor.permission.enabled:
        lines.append("The arm is disabled: `enable`, then `pick` or `auto on`.")
    if supervisor.hold.paused:
        lines.append(PAUSED)
    if pick_order is not None:
        lines.append(f"{cut_off(pick_order)}: `auto resume` continues it, `auto off` cancels it.")
    return CommandResult("\n".join(lines))


@command("pause", "move", at_once=True)
async def pause(context: CommandContext, words: list[str], frontend: Frontend) -> CommandResult:
    """Pause before the next move of arm or gripper."""
    context.cycle.supervisor.hold.pause(frontend.who)
    return CommandResult("Pausing before the next move; `resume` continues.")


@command("abort", "move", at_once=True)
async def abort(context: CommandContext, words: list[str], _: Frontend) -> CommandResult:
    """Stop the arm and cancel the job; leaves no fault."""
    done = "Stopped; the job is cancelled." if context.cycle.supervisor.busy else "No job was running."
    return _stop_result(await context.cycle.supervisor.abort(), done)


@command("pick [LABEL]", "move", most=1, choices=lambda context: context.trainer.model.labels, first=True)
async def pick(context: CommandContext, words: list[str], frontend: Frontend) -> CommandResult:
    """Pick one part, and put it at its place, or into the bin.

    Without LABEL it picks the part in reach that is recognised with the most confidence (pick.order). The arm looks,
    moves closer and looks again until the predicted error at the grasp is small enough. Then it grasps, lifts
    and checks that it holds the part. It skips parts that it cannot recognise or reach, and reports them.
    """
    taught = context.trainer.model.labels
    if words and not taught:
        raise CommandError("no part is taught yet: `teach LABEL`, then `train`")
    label = one_of(words, 0, taught, "taught part", pick.usage) if words else None
    end = await with_questions(context, context.cycle.pick(label), frontend)
    notified = end.ended_by is JobEvent.ERROR and context.notices.level(frontend) is not None
    done = DONE if end.outcome in ("picked", "dry", "emptied") and end.ended_by is None else NOT_DONE
    return CommandResult(describe_end(end, why=not notified), end_json(end), done)


@command(AUTO_USAGE, "move", most=None, at_once=frozenset({"off"}), choices=AUTO_WORDS, first=True)
async def auto(context: CommandContext, words: list[str], frontend: Frontend) -> CommandResult:
    """Pick until the table is empty, or N parts.

    auto on       start, at most N parts; with `every S` look again every S seconds when the table is empty
    auto on signal   wait for the line before each part (docs/operate/signals.md)
    auto off      end after the current part; after an interruption: cancel what is left
    auto wait     show each part as it is picked, until the end
    auto resume   continue an auto that a stop, a fault or a restart interrupted, or a job that lacked a part
    """
    word = one_of(words, 0, AUTO_WORDS, "word", AUTO_USAGE)
    if word in ("on", "resume"):
        return await begin(context, _parse_auto(words[1:]) if word == "on" else _interrupted(context, words))
    no_more(words, 1, AUTO_USAGE)
    if word == "off":
        was_on, left = context.cycle.auto_on, context.cycle.pick_order is not None
        context.cycle.auto_off()
        if not was_on:
            return CommandResult("The interrupted auto is cancelled." if left else "Auto is not running.")
        return CommandResult("Auto ends after the current part.")
    if not context.cycle.auto_on:
        raise CommandError("auto is not running; `auto on` starts it")
    ends = await with_questions(context, _follow_auto(context, frontend), frontend)
    picked = sum(end.outcome == "picked" for end in ends)
    done = bool(ends) and ends[-1].outcome in ("picked", "empty", "dry") and ends[-1].ended_by is None
    prefix = describe_end(ends[-1]) + "\n" if ends and not done else ""
    data = {"picked": picked, "ends": [end_json(e) for e in ends]}
    return CommandResult(f"{prefix}{context.auto_end(ends)}", data, DONE if done else NOT_DONE)


async def begin(context: CommandContext, pick_order: PickOrder) -> CommandResult:
    """Start picking in the background: an auto or a job."""
    await context.begin_auto(pick_order)
    count, every_s = pick_order.count, pick_order.every_s
    what = "until the table is empty" if count is None else f"at most {plural(count, 'part')}"
    what = what if pick_order.job is None else f"job {pick_order.job}, {what.removeprefix('at most ')}"
    missing = "when it is empty" if pick_order.job is None else "when a part is missing"
    what += ", each when the line asks for it" if pick_order.on_signal else ""
    what += "" if every_s is None or pick_order.on_signal else f", looking again every {every_s:g} s {missing}"
    text = f"Picking, {what}; `auto off` ends it after the current part, `status` shows progress."
    return CommandResult(f"{text}\n{PAUSED}" if context.cycle.supervisor.hold.paused else text)


async def _follow_auto(context: CommandContext, frontend: Frontend) -> list[CycleEnd]:
    """Wait for the end of auto; show each part as it is picked."""
    ended = asyncio.ensure_future(context.auto_ends())
    shown_cycle = context.cycle.ends[-1].cycle if context.cycle.ends else 0
    while not ended.done():
        await asyncio.wait([ended], timeout=POLL_S)
        for end in [end for end in context.cycle.ends if end.cycle > shown_cycle]:
            shown_cycle = end.cycle
            if end.outcome in (Outcome.PICKED, Outcome.RELEASED, Outcome.EMPTIED, Outcome.MISSED, Outcome.LOST):
                await frontend.say(describe_end(end))
    return await ended


@command("hand open|close", "move", most=1, choices=("open", "close"))
async def hand(context: CommandContext, words: list[str], frontend: Frontend) -> CommandResult:
    """Open or close the gripper."""
    word = one_of(words, 0, ("open", "close"), "word", hand.usage)
    await with_questions(context, context.cycle.set_gripper(word == "close"), frontend)
    if context.cycle.supervisor.mover.dry:
        return CommandResult("Dry run: planned, not sent.")
    return CommandResult("The gripper is open." if word == "open" else "The gripper is closed.")


@command("holding yes|no", "move", most=1, choices=("yes", "no"))
async def holding(context: CommandContext, words: list[str], _: Frontend) -> CommandResult:
    """Report whether a part is in the gripper.

    Needed after a stop, a fault or a restart between closing and opening the gripper. After `holding yes` the
    next pick first puts the part into the bin.
    """
    word = one_of(words, 0, ("yes", "no"), "word", holding.usage)
    context.cycle.supervisor.refuse_during_job("`holding` is accepted")
    return CommandResult(_set_holding(context, word == "yes"))


def _set_holding(context: CommandContext, held: bool) -> str:
    """Take over the operator's report about the gripper."""
    context.cycle.holding(held)
    context.log.record("holding", held=held)
    if held:
        return "The next pick first puts the part into the bin."
    by_word = context.cycle.belief.empty_unproven
    return "The gripper is assumed empty" + ("; the next pick opens it above the bin anyway." if by_word else ".")


@command("step on|off", "move", most=1, at_once=True, choices=("on", "off"))
async def step(context: CommandContext, words: list[str], _: Frontend) -> CommandResult:
    """Confirm each move of arm and gripper before it is sent.

    A move that waits when you type `step off` still waits: `confirm` sends it.
    """
    on = _on_or_off(words, step.usage)
    if on is None:
        return _switch_state("step", context.cycle.supervisor.hold.stepping)
    context.cycle.supervisor.hold.step(on)
    if on:
        return CommandResult("Step mode is on: each move waits for `confirm` (y) or `refuse` (n).")
    waiting = context.cycle.supervisor.hold.waiting
    if waiting is None:
        return CommandResult("Step mode is off.")
    still = f"This move still waits: {waiting.text}; `confirm` sends it, `refuse` cancels it."
    return CommandResult(f"Step mode is off. {still}")


@command("confirm", "move", at_once=True, aliases=YES)
async def confirm(context: CommandContext, words: list[str], _: Frontend) -> CommandResult:
    """Confirm the waiting move: it is sent."""
    refuse_hasty_confirm(context)
    return decide(context, True)


@command("refuse", "move", at_once=True, aliases=NO)
async def refuse(context: CommandContext, words: list[str], _: Frontend) -> CommandResult:
    """Refuse the waiting move: the job is cancelled."""
    return decide(context, False)


@command("dry on|off", "move", most=1, choices=("on", "off"))
async def dry(context: CommandContext, words: list[str], _: Frontend) -> CommandResult:
    """Plan, guard and log moves, but do not send them."""
    on = _on_or_off(words, dry.usage)
    if on is None:
        return _switch_state("dry", context.cycle.supervisor.mover.dry)
    context.cycle.supervisor.dry(on)
    return CommandResult(
        "Dry run is on: moves are planned, guarded and logged, not sent." if on else "Dry run is off: moves are sent."
    )


def describe_end(end: CycleEnd, why: bool = True) -> str:
    """One pick in a line; without `why` where the operator already has it."""
    if end.outcome == "emptied":
        return f"{end.outcome}: {end.why}, {end.seconds:.1f} s"
    approached = f"{end.label}, {plural(end.stops, 'look')}" if end.label else "no part"
    text = f"{end.outcome}: {approached}, {end.seconds:.1f} s"
    if end.predicted_mm is not None and end.predicted_deg is not None:
        text += f", predicted error {end.predicted_mm:.2f} mm {end.predicted_deg:.2f} degrees"
    says_more = end.outcome != "picked" or end.place or end.ended_by
    return text + (f" ({end.why})" if why and end.why and says_more else "")


def report_end(context: CommandContext, end: CycleEnd) -> None:
    """Report the end of a pick to operators who do not wait for it; faults are reported elsewhere."""
    if end.outcome not in ("empty", "fault"):
        context.notices.tell(describe_end(end), NoticeLevel.OUTCOMES)


def end_json(end: CycleEnd) -> dict[str, Any]:
    """One pick as JSON values."""
    return {
        "cycle": end.cycle,
        "outcome": end.outcome,
        "label": end.label,
        "why": end.why,
        "stops": end.stops,
        "seconds": round(end.seconds, 2),
        "predicted_mm": end.predicted_mm,
        "predicted_deg": end.predicted_deg,
        "place": end.place,
        "skipped": [{"label": s.label, "at": s.centre.tolist(), "why": s.why} for s in end.skipped],
    }


def _parse_auto(words: list[str]) -> PickOrder:
    """Parse `[N] [every S|signal]`. Raises CommandError."""
    count = every_s = None
    if words and words[0] not in ("every", "signal"):
        count, words = number(words[0], "N", 1, MOST_PICKS), words[1:]
    if words == ["signal"]:
        return PickOrder(count, on_signal=True)
    if words:
        one_of(words, 0, ("every", "signal"), "word", AUTO_USAGE)
        if words[0] == "signal":
            no_more(words, 1, AUTO_USAGE)
        if len(words) < 2:
            raise CommandError(f"S is missing: {AUTO_USAGE}", NOT_UNDERSTOOD)
        every_s = number(words[1], "S", 1, 3600)
        no_more(words, 2, AUTO_USAGE)
    return PickOrder(count, every_s)


def _interrupted(context: CommandContext, words: list[str]) -> PickOrder:
    """The rest of an interrupted auto or job. Raises CommandError."""
    no_more(words, 1, AUTO_USAGE)
    pick_order = context.cycle.pick_order
    if pick_order is None:
        raise CommandError("there is no interrupted auto; `auto on` starts a new one")
    return pick_order


def _on_or_off(words: list[str], usage: str) -> bool | None:
    """Parse `on` or `off`; None without an argument: nothing changes."""
    if words and words[0] not in ("on", "off"):
        raise CommandError(f"{words[0]}: expected on or off; usage: {usage}", NOT_UNDERSTOOD)
    return words[0] == "on" if words else None


def _switch_state(name: str, on: bool) -> CommandResult:
    here, other = ("on", "off") if on else ("off", "on")
    return CommandResult(f"`{name}` is {here}; `{name} {other}` switches it {other}.", {name: on})


COMMANDS = (enable, disable, pick, auto, stop, pause, resume, abort, step, confirm, refuse, dry, hand, holding)
