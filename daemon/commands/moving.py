"""Commands that let the arm move, hold it, or stop it. Every motion itself is the cycle's, and guarded there."""

from __future__ import annotations

import asyncio
from typing import Any

from daemon.arm import Let, RefusedError, StopRefusedError
from daemon.commands import camera_selection
from daemon.commands.step_mode import POLL_S, decide, not_behind_a_pause, not_too_soon, with_questions
from daemon.console.context import CommandContext
from daemon.console.interpreter import (
    DONE,
    NOT_DONE,
    NOT_UNDERSTOOD,
    CommandError,
    CommandResult,
    Frontend,
    command,
    no_more,
    number,
    one_of,
    yes_or_no,
)
from daemon.console.notices import NoticeLevel
from daemon.console.phrases import cut_off, plural
from daemon.pick.outcome import CycleEnd, Outcome

MOST_PICKS = 1_000_000
HELD = "Moves are held: `resume` lets them go."
AUTO_WORDS = ("on", "off", "wait", "resume")
AUTO_USAGE = "auto on [N] [every S] | auto resume | auto off | auto wait"


@command("enable", "move", first=True)
async def enable(context: CommandContext, words: list[str], frontend: Frontend) -> CommandResult:
    """Let the arm move, once its stop was seen to work.

    The word that stops the arm (arm.dialect.abort_word) is typed, once each time the line was opened; a
    controller that does not take it is not enabled. A stop or `disable`, at whatever frontend, voids an `enable`
    that was asked for before it. Without a hand-eye calibration only `robot` may move the arm, after a yes.
    """
    if context.hardware.kind == "recorded":
        raise CommandError("this cell is recorded: there is no arm to move")
    supervisor = context.cycle.supervisor
    asked = supervisor.stops
    let = Let.ALL if _eyes_on_hand(context) else await _by_hand_only(context, frontend)
    try:
        await supervisor.prove_stop()
    except StopRefusedError as refused:
        raise CommandError(f"not enabled: {refused}: mend arm.dialect.abort_word, and restart facetd") from None
    if let is Let.ALL and not _eyes_on_hand(context):
        raise CommandError("not enabled: meanwhile a calibration without hand_eye was taken over")
    supervisor.enable(asked, let)
    fault = context.cycle.status()["fault"]
    may = "The arm may move." if let is Let.ALL else "`robot` may move the arm; nothing else may."
    return CommandResult(may + (f" First the fault must go: {fault}; say `resume`." if fault else ""))


def _eyes_on_hand(context: CommandContext) -> bool:
    """Whether it is known how the cameras sit on the hand: without that no move may be let."""
    return context.calibration.tool_from_cyclopean is not None


async def _by_hand_only(context: CommandContext, frontend: Frontend) -> Let:
    """Asked where no move could be guarded. Raises CommandError on anything but a yes."""
    lack = f"{context.config.calibration} has no hand_eye yet"
    if not frontend.asks:
        raise CommandError(f"{lack} (a ruler's guess will do to calibrate with); for `robot cal` enable at a console")
    if not await yes_or_no(frontend, f"{lack}. Enable the arm for `robot cal` and `robot monitor` only? [y/n]"):
        raise CommandError(f"not enabled: {lack}")
    return Let.BY_HAND


@command("disable", "move", at_once=True)
async def disable(context: CommandContext, words: list[str], _: Frontend) -> CommandResult:
    """Do not let the arm move; stop it where it does."""
    return _stopped(await context.cycle.supervisor.disable(), "The arm does not move until `enable`.")


@command("stop", "move", most=None, at_once=True, aliases=("halt",), first=True)
async def stop(context: CommandContext, _: list[str], frontend: Frontend) -> CommandResult:
    """Stop the arm now; nothing moves until `resume`.

    Heard before all else, at every frontend, whatever runs or is asked there; `sto`, `STOP!` and `halt` do as well,
    as does control-C. The word that stops the arm is typed until two WHERE agree that it is at rest. Where that
    is in doubt you are told to press the emergency stop, and it goes on being typed. Drops what waits.
    """
    return _stopped(await context.cycle.supervisor.stop(f"by {frontend.who}"), "Stopped. Nothing moves until `resume`.")


def _stopped(alarm: str | None, text: str) -> CommandResult:
    """What a stop has come to."""
    return CommandResult(text) if alarm is None else CommandResult(alarm, {"error": alarm}, NOT_DONE)


@command("resume", "move", at_once=True)
async def resume(context: CommandContext, words: list[str], frontend: Frontend) -> CommandResult:
    """Go on after `pause`; clear a fault.

    After a fault nothing goes on by itself: say `pick`, `auto on` or `auto resume`. Where an auto was cut
    off, and at a frontend that can ask, it is asked whether to take it up now; answered no, the fault stands.
    After a camera's fault each eye is tried; where one is left, it is asked whether to go on with that alone.
    Not heard while a stop is under way: until the arm was seen at rest; nor within a second of a `pause` that
    somebody else says: it may have been meant for one of before. Does not enable the arm.
    """
    supervisor = context.cycle.supervisor
    not_behind_a_pause(context, frontend)
    before, stops, pauses = context.cycle.status(), supervisor.stops, supervisor.hold.pauses
    if before["fault"] is None:
        supervisor.resume()
        return CommandResult(
            "Going on." if before["paused"] else "Nothing to resume: no fault stands, nothing is paused."
        )
    supervisor.not_while_stopping("resume")
    lines = [f"The fault is cleared: {before['fault']}."]
    told = await camera_selection.offered(context, str(before["fault"]), frontend)
    lines += [] if told is None else [told]
    if before["holding"] is None and frontend.asks:
        held = await yes_or_no(frontend, "Is a part in the gripper? [y/n]")
        if held is not None:
            supervisor.not_after(stops, "resume")
            if supervisor.fault is None or context.cycle.status()["holding"] is not None:
                raise CommandError("meanwhile somebody else went on: `status` tells what is taken to be in the gripper")
            lines.append(_take_word(context, held))
    known, pick_order = context.cycle.status()["holding"] is not None, context.cycle.pick_order
    if known and pick_order is not None and frontend.asks and _eyes_on_hand(context):
        left = cut_off(pick_order.count)
        if not await yes_or_no(frontend, f"{left}. Let the arm move and go on? [y/n]"):
            lines[0] = f"The fault stands: {before['fault']}. `resume` asks again."
            lines.append(f"{left}: `auto resume` takes it up after that, `auto off` gives it up.")
            return CommandResult("\n".join(lines), status=NOT_DONE)
        await supervisor.prove_stop()
        if not _eyes_on_hand(context):
            raise CommandError("the fault stands: meanwhile a calibration without hand_eye was taken over")
        if context.cycle.pick_order != pick_order:
            raise CommandError("meanwhile somebody else took up or gave up what was left of the auto")
        supervisor.resume(stops, pauses)
        supervisor.enable(stops)
        try:
            await context.begin_auto(pick_order.count, pick_order.every_s)
        except RefusedError as refused:  # somebody else was faster; the fault is gone all the same, and is told so
            return CommandResult("\n".join([*lines, f"{left}, and does not go on: {refused}; then say `auto resume`."]))
        lines.append("Going on; `auto off` ends it after a part.")
        return CommandResult("\n".join([*lines, HELD] if supervisor.hold.paused else lines))
    supervisor.resume(stops, pauses)
    if not known:
        lines.append("Is a part in the gripper? Say `holding yes` or `holding no` before the next pick.")
    if not context.cycle.status()["enabled"]:
        lines.append("The arm does not move until `enable`; then `pick` or `auto on` go on.")
    if supervisor.hold.paused:
        lines.append(HELD)
    if pick_order is not None:
        lines.append(f"{cut_off(pick_order.count)}: `auto resume` takes it up, `auto off` gives it up.")
    return CommandResult("\n".join(lines))


@command("pause", "move", at_once=True)
async def pause(context: CommandContext, words: list[str], frontend: Frontend) -> CommandResult:
    """Hold before the next move of arm or hand."""
    context.cycle.supervisor.hold.pause(frontend.who)
    return CommandResult("Holding before the next move; `resume` goes on.")


@command("abort", "move", at_once=True)
async def abort(context: CommandContext, words: list[str], _: Frontend) -> CommandResult:
    """Stop the arm, give the part up; leaves no fault."""
    done = "Stopped; the part is given up." if context.cycle.status()["doing"] else "Nothing was being done."
    return _stopped(await context.cycle.supervisor.abort(), done)


@command("pick [LABEL]", "move", most=1, choices=lambda context: context.trainer.model.labels, first=True)
async def pick(context: CommandContext, words: list[str], frontend: Frontend) -> CommandResult:
    """Bring one part to the bin.

    Without LABEL the one that is known best of all in reach (pick.order). It looks, goes nearer and looks again
    until the error at the grasp is small enough, grasps, lifts, and looks whether it has the part. A part that
    has no name or cannot be reached is left alone, and told. control-C or `stop` stops it.
    """
    label = one_of(words, 0, context.trainer.model.labels, "taught part", pick.usage) if words else None
    end = await with_questions(context, context.cycle.pick(label), frontend)
    heard = end.outcome is Outcome.FAULT and context.notices.level(frontend) is not None
    done = DONE if end.outcome in ("picked", "dry", "placed") else NOT_DONE
    return CommandResult(describe_end(end, why=not heard), end_json(end), done)


@command(AUTO_USAGE, "move", most=None, at_once=frozenset({"off"}), choices=AUTO_WORDS, first=True)
async def auto(context: CommandContext, words: list[str], frontend: Frontend) -> CommandResult:
    """Pick until the table is empty, or N parts.

    auto on returns at once; auto wait tells each part as it is picked, until the end.
    With `every S` an empty table is looked at again after S seconds instead of ending.
    auto resume picks what is left of an auto that a stop, a fault or a restart cut off.
    """
    word = one_of(words, 0, AUTO_WORDS, "word", AUTO_USAGE)
    if word in ("on", "resume"):
        count, every_s = _auto_words(words[1:]) if word == "on" else _cut_off(context, words)
        await context.begin_auto(count, every_s)
        what = "until the table is empty" if count is None else f"at most {plural(count, 'part')}"
        what += "" if every_s is None else f", looking again every {every_s:g} s when it is empty"
        told = f"Picking, {what}; `auto off` ends it after a part, `status` tells how far it is."
        return CommandResult(f"{told}\n{HELD}" if context.cycle.supervisor.hold.paused else told)
    no_more(words, 1, AUTO_USAGE)
    if word == "off":
        was_on, left = context.cycle.status()["auto"], context.cycle.pick_order is not None
        context.cycle.auto_off()
        if not was_on:
            return CommandResult("What was left of the auto is given up." if left else "No auto is on.")
        return CommandResult("No further part is picked after this one.")
    if not context.cycle.status()["auto"]:
        raise CommandError("no auto is on; `auto on` begins one")
    ends = await with_questions(context, _auto_told(context, frontend), frontend)
    picked = sum(end.outcome == "picked" for end in ends)
    done = bool(ends) and ends[-1].outcome in ("picked", "empty", "dry")
    said = describe_end(ends[-1]) + "\n" if ends and not done else ""
    data = {"picked": picked, "ends": [end_json(e) for e in ends]}
    return CommandResult(f"{said}{plural(picked, 'part')} picked.", data, DONE if done else NOT_DONE)


async def _auto_told(context: CommandContext, frontend: Frontend) -> list[CycleEnd]:
    """Wait for the end of auto; each part is told as it is picked."""
    ended = asyncio.ensure_future(context.auto_ends())
    told = context.cycle.ends[-1].cycle if context.cycle.ends else 0
    while not ended.done():
        await asyncio.wait([ended], timeout=POLL_S)
        for end in [end for end in context.cycle.ends if end.cycle > told]:
            told = end.cycle
            if end.outcome in (Outcome.PICKED, Outcome.RELEASED, Outcome.PLACED, Outcome.MISSED, Outcome.LOST):
                await frontend.say(describe_end(end))
    return await ended


@command("hand open|close", "move", most=1, choices=("open", "close"))
async def hand(context: CommandContext, words: list[str], frontend: Frontend) -> CommandResult:
    """Open or close the gripper."""
    word = one_of(words, 0, ("open", "close"), "word", hand.usage)
    await with_questions(context, context.cycle.hand(word == "close"), frontend)
    if context.cycle.status()["dry"]:
        return CommandResult("Planned, and not sent: `dry` is on.")
    return CommandResult("The gripper is open." if word == "open" else "The gripper is closed.")


@command("holding yes|no", "move", most=1, choices=("yes", "no"))
async def holding(context: CommandContext, words: list[str], _: Frontend) -> CommandResult:
    """Say whether a part is in the gripper.

    Asked for where a stop, a fault or a restart came between closing and opening the hand. After yes the next
    pick first puts the part into the bin.
    """
    word = one_of(words, 0, ("yes", "no"), "word", holding.usage)
    context.cycle.supervisor.between_jobs("what is in the gripper is said")
    return CommandResult(_take_word(context, word == "yes"))


def _take_word(context: CommandContext, held: bool) -> str:
    """Believe the operator about the gripper."""
    context.cycle.holding(held)
    context.log.record("holding", held=held)
    if held:
        return "The next pick first puts it into the bin."
    by_word = context.cycle.belief.empty_unproven
    return "The gripper is taken as empty" + ("; the next pick opens it over the bin all the same." if by_word else ".")


@command("step on|off", "move", most=1, at_once=True, choices=("on", "off"))
async def step(context: CommandContext, words: list[str], _: Frontend) -> CommandResult:
    """Show each move of arm and hand and wait for a yes before it is sent.

    One that waits as you say `step off` still does: `confirm` sends it.
    """
    on = _on_or_off(words, step.usage)
    if on is None:
        return _how_it_is("step", bool(context.cycle.status()["step"]))
    context.cycle.supervisor.hold.step(on)
    if on:
        return CommandResult("Every move is shown and waits for `confirm` or `refuse`.")
    pending = context.cycle.status()["pending"]
    still = "" if pending is None else f" This one still does: {pending}; `confirm` sends it, `refuse` gives it up."
    return CommandResult(f"Moves no longer wait.{still}")


@command("confirm", "move", at_once=True)
async def confirm(context: CommandContext, words: list[str], _: Frontend) -> CommandResult:
    """Yes to the move that waits."""
    not_too_soon(context)
    return decide(context, True)


@command("refuse", "move", at_once=True)
async def refuse(context: CommandContext, words: list[str], _: Frontend) -> CommandResult:
    """No to the move that waits."""
    return decide(context, False)


@command("dry on|off", "move", most=1, choices=("on", "off"))
async def dry(context: CommandContext, words: list[str], _: Frontend) -> CommandResult:
    """Plan, guard and log moves, but do not send them."""
    on = _on_or_off(words, dry.usage)
    if on is None:
        return _how_it_is("dry", bool(context.cycle.status()["dry"]))
    context.cycle.supervisor.dry(on)
    return CommandResult("Moves are planned, guarded and logged, but not sent." if on else "Moves are sent again.")


def describe_end(end: CycleEnd, why: bool = True) -> str:
    """One pick in a line; without why, where whoever reads it has been told."""
    if end.outcome == "placed":
        return f"{end.outcome}: {end.why}, {end.seconds:.1f} s"
    approached = f"{end.label}, {plural(end.stops, 'look')}" if end.label else "no part"
    text = f"{end.outcome}: {approached}, {end.seconds:.1f} s"
    if end.predicted_mm is not None and end.predicted_deg is not None:
        text += f", predicted error {end.predicted_mm:.2f} mm {end.predicted_deg:.2f} degrees"
    return text + (f" ({end.why})" if why and end.outcome != "picked" and end.why else "")


def tell_end(context: CommandContext, end: CycleEnd) -> None:
    """Tell a pick's end to whoever is not waiting for it. An empty table is no news, a fault was told."""
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
        "skipped": [{"label": s.label, "at": s.centre.tolist(), "why": s.why} for s in end.skipped],
    }


def _auto_words(words: list[str]) -> tuple[int | None, float | None]:
    """[N] [every S] -> how many, and after how many seconds an empty table is looked at again."""
    count = every_s = None
    if words and words[0] != "every":
        count, words = number(words[0], "N", 1, MOST_PICKS), words[1:]
    if words:
        one_of(words, 0, ("every",), "word", AUTO_USAGE)
        if len(words) < 2:
            raise CommandError(f"S is missing: {AUTO_USAGE}", NOT_UNDERSTOOD)
        every_s = number(words[1], "S", 1, 3600)
        no_more(words, 2, AUTO_USAGE)
    return count, every_s


def _cut_off(context: CommandContext, words: list[str]) -> tuple[int | None, float | None]:
    """What is left of an auto that was cut off. Raises CommandError."""
    no_more(words, 1, AUTO_USAGE)
    pick_order = context.cycle.pick_order
    if pick_order is None:
        raise CommandError("no auto was cut off; say `auto on`")
    return pick_order.count, pick_order.every_s


def _on_or_off(words: list[str], usage: str) -> bool | None:
    """What was said; None where nothing was, and nothing is changed."""
    if words and words[0] not in ("on", "off"):
        raise CommandError(f"{words[0]}: expected on or off; usage: {usage}", NOT_UNDERSTOOD)
    return words[0] == "on" if words else None


def _how_it_is(name: str, on: bool) -> CommandResult:
    here, other = ("on", "off") if on else ("off", "on")
    return CommandResult(f"`{name}` is {here}; `{name} {other}` switches it {other}.", {name: on})


COMMANDS = (enable, disable, pick, auto, stop, pause, resume, abort, step, confirm, refuse, dry, hand, holding)
