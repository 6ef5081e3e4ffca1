"""Commands for whoever keeps the cell running: the controller's own monitor, doctor, bundle, reload."""

from __future__ import annotations

import asyncio
from functools import partial

from daemon.arm import Change
from daemon.cell.arm_on_link import moves_the_arm, turns_over
from daemon.commands.controller_terminal import NO_TURNING_OVER, monitor, note_hand
from daemon.commands.step_mode import with_questions
from daemon.console.context import CommandContext
from daemon.console.interpreter import NOT_DONE, CommandError, CommandResult, Frontend, command, no_more, one_of
from daemon.console.notices import NoticeLevel
from daemon.maintenance import bundle as bundles
from daemon.maintenance import doctor as doctors

NOT_OF_POWER_UP = (
    "`{}` is no question after power-up that facetd knows (arm.dialect.power_up_asks): a yes to it may move the arm, "
    "which is not enabled. `stop` answers N, and ends what asks"
)
ROBOT = ("power-up", "cal", "monitor")
ROBOT_USAGE = "robot power-up [Y N ...] | robot cal | robot monitor [TEXT]"


@command(ROBOT_USAGE, "move", most=None, choices=ROBOT)
async def robot(context: CommandContext, words: list[str], frontend: Frontend) -> CommandResult:
    """Speak with the arm's controller as its own terminal would.

    power-up answers what the controller asks after it was switched on (Y Y unless you say otherwise);
    cal lets the arm find its zero (`enable` first); monitor TEXT types one line and shows the answer. monitor
    alone is the controller's own terminal, every line logged: control-] comes back, control-C and `stop` stop.
    What may move the arm waits for a yes, and is held, refused and stopped like a move; no guard sees where it
    goes.
    """
    what = one_of(words, 0, ROBOT, "word", ROBOT_USAGE)
    arm, supervisor = context.hardware.robot, context.cycle.supervisor
    by_hand = partial(supervisor.by_hand, ask=frontend.asks)
    text = " ".join(words[1:])
    if what == "power-up":
        question = arm.question
        if question is None:
            raise CommandError("the controller asks nothing: it is past its power-up questions")
        replies = words[1:] or ["Y", "Y"]
        for reply in replies:
            arm.check_typable(reply)
        if arm.asks_whether_to_move:
            if not (supervisor.enabled or supervisor.by_hand_only):
                raise CommandError(NOT_OF_POWER_UP.format(question))

            async def answered() -> list[str]:
                context.cycle.beliefs.void(Change.GRIPPER_TYPED)
                return await arm.power_up(replies)

            said = await with_questions(context, by_hand("power-up", answered), frontend)
        else:
            said = await supervisor.converse("power-up", lambda: arm.power_up(replies), moves=False)
        return _replies([question, *said])
    if what == "cal":
        no_more(words, 1, "robot cal")
        reply = context.config.values.arm.calibrate_answer
        said = await with_questions(context, by_hand("CAL", lambda: arm.calibrate(reply)), frontend)
        return _replies([*said, f"(answered {reply}) The arm has found its zero and is at rest."])
    if not text:
        return await monitor(context, frontend)
    arm.check_typable(text)
    if turns_over(text):
        raise CommandError(f"{text}: {NO_TURNING_OVER}; not sent")

    async def typed() -> list[str]:
        note_hand(context, text)
        return await arm.monitor(text)

    if moves_the_arm(text):
        return _replies(await with_questions(context, by_hand(text, typed), frontend))
    return _replies(await supervisor.converse(text, typed, moves=False))


@command("doctor")
async def doctor(context: CommandContext, words: list[str], _: Frontend) -> CommandResult:
    """Check everything the cell needs; says how to mend it."""
    findings = await asyncio.to_thread(doctors.examine, context.config, True)
    findings += doctors.from_service(context.hardware, context.troubles.standing, context.cycle.supervisor.fault)
    return doctor_answer(findings)


@command("bundle")
async def bundle(context: CommandContext, words: list[str], _: Frontend) -> CommandResult:
    """Pack logs and settings into one file for a maintainer."""
    path = await asyncio.to_thread(bundles.pack, context.config, context.config.state / "bundles")
    return CommandResult(f"{path} ({path.stat().st_size / 1e6:.1f} MB): send this file.", {"file": str(path)})


@command("reload", "change")
async def reload(context: CommandContext, words: list[str], frontend: Frontend) -> CommandResult:
    """Read the configuration again."""
    return CommandResult(await context.reload(frontend.who))


@command("notices [faults|outcomes|all]", most=1, choices=tuple(level.name.lower() for level in NoticeLevel))
async def notices(context: CommandContext, words: list[str], frontend: Frontend) -> CommandResult:
    """How much this console tells unasked.

    faults    faults, stops and refusals, whoever caused them; no console tells less
    outcomes  how picks and autos end as well (so it is at first)
    all       and what other operators move or change
    """
    level = context.notices.level(frontend)
    if level is None:
        raise CommandError("nothing is told here unasked: that is for `facetctl console` and the serial terminal")
    if words:
        word = one_of(words, 0, [one.name.lower() for one in NoticeLevel], "level", notices.usage)
        level = NoticeLevel[word.upper()]
        context.notices.set_level(frontend, level)
    return CommandResult(f"Told here unasked: {level.name.lower()}.", {"level": level.name.lower()})


def doctor_answer(findings: list[doctors.CheckResult]) -> CommandResult:
    """Findings as text and JSON; status 1 when something is wrong."""
    bad = [finding for finding in findings if finding.level == "bad"]
    lines = [finding.line() for finding in findings]
    lines.append("All is well." if not bad else f"{len(bad)} to mend.")
    data = {"findings": [{"level": f.level, "what": f.what, "found": f.found, "mend": f.mend} for f in findings]}
    return CommandResult("\n".join(lines), data, NOT_DONE if bad else 0)


def _replies(lines: list[str]) -> CommandResult:
    return CommandResult("\n".join(lines) or "(no words)", {"lines": lines})


COMMANDS = (robot, notices, doctor, bundle, reload)
