"""Command `signal`: show, read, find and test the line's signals; and the task that serves the line."""

import asyncio
from collections.abc import Sequence
from typing import Any

from daemon.arm import RefusedError
from daemon.console.context import ANSWERABLE, CommandContext
from daemon.console.interpreter import CommandResult, Frontend, command, no_more, one_of, yes_or_no
from daemon.console.notices import NoticeLevel
from daemon.console.text_layout import table
from daemon.errors import NOT_DONE, CommandError
from daemon.events.codes import CauseCode
from daemon.events.outcomes import tally
from daemon.signals.input_form import FORMS, form_found, keep_form
from daemon.signals.modbus import COILS, PLCReadings, readings
from daemon.signals.production_line import keep_watch
from daemon.signals.settings import VALVES

USAGE = "signal show | read | find INPUT | test OUTPUT"
ACTS = ("show", "read", "find", "test")
TEST_S = 2.0
"""How long a test switches an output."""
FOR_PERSONS = (CauseCode.OPERATOR_STOP, CauseCode.RESTARTED)
"""Causes of faults that only a person clears."""


def _further(context: CommandContext, word: str) -> Sequence[str]:
    return context.cycle.production_line.names(word == "find") if word in ("find", "test") else ()


@command(USAGE, "move", most=2, looks=lambda words: not words or words[0] == "show", choices=ACTS, further=_further)
async def signal(context: CommandContext, words: list[str], frontend: Frontend) -> CommandResult:
    """Show, read and test the signals of the line.

    signal show          each signal: number, role, and whether it was on when facetd last read or set it
    signal read          read every input now
    signal find permit   find how inputs are read on this controller: you switch the input permit off, on, and off
    signal test busy     switch the output busy to its other state for 2 seconds
    """
    if not context.cycle.production_line.has_line:
        raise CommandError("this cell has no signals: write them into the section `signals` of facetd.yaml")
    act = one_of(words, 0, ACTS, "word", USAGE) if words else "show"
    return await HANDLERS[act](context, words[1:], frontend)


async def _show(context: CommandContext, words: list[str], frontend: Frontend) -> CommandResult:
    no_more(words, 0, USAGE)
    line, rows = context.cycle.production_line, []
    for name, each in line.signals.items():
        kind = "input" if each.is_input else "output"
        level = line.levels.get(name)
        known = "not known" if level is None else "on" if level.on else "off"
        rows.append((name, f"{kind} {each.number}, {each.role}: {known}"))
    for role in line.plc.roles:
        on = line.plc.on(role)
        known = "no PLC is connected" if on is None else "on" if on else "off"
        rows.append((role, f"coil {COILS.index(role)} of the PLC: {known}"))
    lines = [table(rows, frontend.columns), f"PackML state {context.cycle.packml}"]
    lines += [f"waits for {line.waits_for}"] if line.waits_for else []
    lines += [line.unreadable] if line.unreadable else []
    return CommandResult("\n".join(lines), {"signals": signal_levels(context), "packml": context.cycle.packml})


def plc_readings(context: CommandContext) -> PLCReadings:
    """The values that a PLC reads."""
    cycle = context.cycle
    counted, enabled = tally(cycle.tally), cycle.supervisor.permission.granted
    now_s = context.hardware.clock()
    return readings(cycle.packml, cycle.production_line.done, enabled, now_s, counted.picked, counted.failed)


def signal_levels(context: CommandContext) -> dict[str, Any]:
    """The level of each signal; None: unknown."""
    line = context.cycle.production_line
    return {name: level.on if (level := line.levels.get(name)) else None for name in line.signals}


async def _read(context: CommandContext, words: list[str], frontend: Frontend) -> CommandResult:
    no_more(words, 0, USAGE)

    async def every() -> None:
        for name in context.cycle.production_line.names(inputs=True):
            await context.cycle.production_line.read(name)

    await context.cycle.supervisor.run("read the inputs", every(), moves=False)
    return await _show(context, [], frontend)


async def _find(context: CommandContext, words: list[str], frontend: Frontend) -> CommandResult:
    no_more(words, 1, USAGE)
    name = one_of(words, 0, context.cycle.production_line.names(inputs=True), "input", USAGE)
    if not frontend.asks:
        raise CommandError("a person must switch the input: give this command at a console")
    number = context.cycle.production_line.signals[name].number
    printed: dict[str, list[str | None]] = {form: [] for form in FORMS}
    for level in ("off", "on", "off again"):
        where = "at the line" if context.hardware.operator is None else "by `switch` at a second console"
        if not await yes_or_no(frontend, f"Switch {name} (input {number}) {level} {where}. Done? [y/n]"):
            return CommandResult("Nothing was changed.", status=NOT_DONE)
        for form in FORMS:
            asked = _answer_to(context, form.format(number=number))
            printed[form].append(await context.cycle.supervisor.run("find how inputs are read", asked, moves=False))
    found = form_found(printed)
    if found is None:
        answers = "; ".join(
            f"`{text.format(number=number)}`: {' / '.join(answer or 'refused' for answer in each)}"
            for text, each in printed.items()
        )
        raise CommandError(
            f"no answer changed with input {number} (off / on / off): {answers}. Check number and wiring"
        )
    keep_form(context.config.state, found)
    context.cycle.production_line.form = found
    text = f"`{found.line(number)}` prints {found.off} while {name} is off and {found.on} while it is on: stored."
    return CommandResult(text, {"form": found.form, "off": found.off, "on": found.on})


async def _answer_to(context: CommandContext, text: str) -> str | None:
    """The controller's answer; None where it refuses the line."""
    try:
        return await context.hardware.robot.ask_input(text)
    except ANSWERABLE:
        return None


async def _test(context: CommandContext, words: list[str], frontend: Frontend) -> CommandResult:
    no_more(words, 1, USAGE)
    line = context.cycle.production_line
    name = one_of(words, 0, context.cycle.production_line.names(inputs=False), "output", USAGE)
    if line.signals[name].role in VALVES:
        raise CommandError(f"{name} works the gripper: `hand close` and `hand open` switch it")
    if frontend.asks and not await yes_or_no(frontend, f"Switch {name} for {TEST_S:g} s? The line acts on it. [y/n]"):
        return CommandResult("Nothing was changed.", status=NOT_DONE)
    level = line.levels.get(name)
    other = level is None or not level.on

    async def switched() -> None:
        try:
            await line.switch({name: other})
            await asyncio.sleep(TEST_S)
        finally:
            await line.switch({name: not other})

    await context.cycle.supervisor.run(f"test {name}", switched(), moves=False)
    return CommandResult(f"{name} was {'on' if other else 'off'} for {TEST_S:g} s.")


async def serve_the_line(context: CommandContext) -> None:
    """Serve the line: set outputs by the cell's state, do the hand-shakes, clear faults as the line asks."""
    await keep_watch(
        context.cycle.production_line,
        lambda: context.cycle.packml,
        lambda: context.hardware.robot.permission.stop_tests,
        lambda: reset_by_line(context),
        lambda text: context.troubles.report("signals", text),
        ANSWERABLE,
    )


def reset_by_line(context: CommandContext) -> None:
    """Clear a fault that facetd found, as the line asks; never a person's stop or pause, whatever fault came before or
    after it, nor with unknown content of the gripper. Reports the result."""
    supervisor = context.cycle.supervisor
    fault, why = supervisor.permission.fault, None
    if supervisor.hold.paused or (fault is not None and any(cause.code in FOR_PERSONS for cause in fault.causes)):
        why = "a person stopped or paused the arm, or facetd was restarted"
    elif fault is None:
        context.notices.tell("The line asked for a reset; no fault is active.", NoticeLevel.FAULTS)
        return
    elif context.cycle.belief.holds_part is None:
        why = "the content of the gripper is unknown"
    try:
        if why is None:
            supervisor.resume(supervisor.stops)
    except RefusedError as error:
        why = str(error)
    text = "The line has cleared the fault." if why is None else f"The line's reset was refused: {why}; type `resume`"
    context.notices.tell(text, NoticeLevel.FAULTS)


HANDLERS = {"show": _show, "read": _read, "find": _find, "test": _test}
COMMANDS = (signal,)
