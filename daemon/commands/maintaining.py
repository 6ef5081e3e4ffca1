"""Commands that maintain the service: notices, doctor, bundle, reload."""

import asyncio

from daemon.console.context import CommandContext
from daemon.console.interpreter import CommandResult, Frontend, command, one_of
from daemon.console.notices import NoticeLevel
from daemon.errors import NOT_DONE, CommandError
from daemon.maintenance import bundle as bundles
from daemon.maintenance import doctor as doctors


@command("doctor")
async def doctor(context: CommandContext, words: list[str], _: Frontend) -> CommandResult:
    """Check the installation and the cell; say what to correct."""
    findings = await asyncio.to_thread(doctors.examine, context.config, True)
    fault = context.cycle.supervisor.permission.fault
    findings += doctors.from_service(context.hardware, context.troubles, fault, context.not_held, context.shutters)
    return doctor_answer(findings)


@command("bundle")
async def bundle(context: CommandContext, words: list[str], _: Frontend) -> CommandResult:
    """Pack logs and settings into one file for a maintainer."""
    path = await asyncio.to_thread(bundles.pack, context.config, context.config.state / "bundles")
    return CommandResult(f"{path} ({path.stat().st_size / 1e6:.1f} MB): send this file.", {"file": str(path)})


@command("reload", "change")
async def reload(context: CommandContext, words: list[str], frontend: Frontend) -> CommandResult:
    """Read facetd.yaml and the calibration again."""
    return CommandResult(await context.reload(frontend.who))


@command("notices [faults|outcomes|all]", most=1, choices=tuple(level.name.lower() for level in NoticeLevel))
async def notices(context: CommandContext, words: list[str], frontend: Frontend) -> CommandResult:
    """Choose which notices this console shows.

    faults    faults, stops and refusals only
    outcomes  also how picks and autos end (the default)
    all       also what other operators move or change
    """
    level = context.notices.level(frontend)
    if level is None:
        raise CommandError("notices appear only at `facetctl console` and at the serial terminal")
    if words:
        word = one_of(words, 0, [one.name.lower() for one in NoticeLevel], "level", notices.usage)
        level = NoticeLevel[word.upper()]
        context.notices.set_level(frontend, level)
    return CommandResult(f"Notices shown here: {level.name.lower()}.", {"level": level.name.lower()})


def doctor_answer(findings: list[doctors.CheckResult]) -> CommandResult:
    """Findings as text and JSON; status 1 when something is wrong."""
    bad = [finding for finding in findings if finding.level == "bad"]
    lines = [finding.line() for finding in findings]
    lines.append("Everything is in order." if not bad else f"{len(bad)} to correct.")
    data = {"findings": [{"level": f.level, "what": f.what, "found": f.found, "mend": f.mend} for f in findings]}
    return CommandResult("\n".join(lines), data, NOT_DONE if bad else 0)


COMMANDS = (notices, doctor, bundle, reload)
