"""Command `job`: list, show and run job files. `auto` (moving.py) ends or resumes a job."""

from collections.abc import Sequence

from msgspec.structs import replace

from daemon.commands.moving import begin
from daemon.console.context import CommandContext
from daemon.console.interpreter import CommandResult, Frontend, command, no_more, number, one_of
from daemon.console.phrases import plural
from daemon.console.text_layout import table
from daemon.errors import DONE, NOT_DONE, CommandError
from daemon.store.job_file import MAX_TIMES, SUFFIX, Job, job_names, load_job
from daemon.store.outside import FileError
from daemon.store.place_file import BIN

USAGE = "job list | show NAME | run NAME [TIMES] [signal]"
ACTS = ("list", "show", "run")
SIGNAL = "signal"


def _names(context: CommandContext, word: str) -> Sequence[str]:
    return () if word == "list" else job_names(context.config.jobs)


@command(USAGE, "move", most=4, looks=lambda words: words[:1] != ["run"], choices=ACTS, further=_names)
async def job(context: CommandContext, words: list[str], frontend: Frontend) -> CommandResult:
    """Pick the parts of a job file: how many of each, where to, in which order.

    job list         every job, and what is wrong with one that cannot be run
    job show kit     its steps
    job run kit 5    run it five times (without a number: once); the command returns at once
    job run kit signal   wait for the line before each part (docs/operate/signals.md)
    A job is a file in jobs/ beside facetd.yaml. `auto off` ends it after the current part, `auto wait` follows it,
    `auto resume` continues it where it was interrupted.
    """
    act = one_of(words, 0, ACTS, "word", USAGE) if words else "list"
    if act == "list":
        no_more(words, 1, USAGE)
        return _list(context)
    words = [words[0], *(word.removesuffix(SUFFIX) for word in words[1:2]), *words[2:]]
    names = job_names(context.config.jobs)
    if not names:
        raise CommandError(f"there is no job: put a job file into {context.config.jobs}, such as kit{SUFFIX}")
    made = load_job(context.config.jobs, one_of(words, 1, names, "job", USAGE))
    if act == "show":
        no_more(words, 2, USAGE)
        return _show(context, made, frontend.columns)
    on_signal = words[-1] == SIGNAL and len(words) > 2
    words = words[:-1] if on_signal else words
    no_more(words, 3, USAGE)
    times = number(words[2], "TIMES", 1, MAX_TIMES) if len(words) > 2 else 1
    made.check(context.trainer.model.labels, context.cycle.placing.places)
    return await begin(context, replace(made.order(times), on_signal=on_signal))


def _list(context: CommandContext) -> CommandResult:
    data = {}
    for name in job_names(context.config.jobs):
        try:
            made = load_job(context.config.jobs, name)
            made.check(context.trainer.model.labels, context.cycle.placing.places)
            steps = ", ".join(f"{step.count} {step.part}" for step in made.file.steps)
            data[name] = f"{plural(made.order().count or 0, 'part')}, {made.file.order}: {steps}"
        except FileError as error:
            data[name] = str(error)
    if not data:
        return CommandResult(f"There is no job. Put a job file into {context.config.jobs}.", {"jobs": {}})
    return CommandResult("\n".join(f"{name}: {text}" for name, text in data.items()), {"jobs": data})


def _show(context: CommandContext, made: Job, columns: int) -> CommandResult:
    file = made.file
    rows = []
    for count, step in enumerate(file.steps, start=1):
        where = "where it belongs" if step.place is None else "the bin" if step.place == BIN else f"place {step.place}"
        rows.append((f"{count}", f"{step.count} {step.part} to {where}"))
    lines = [table(rows, columns), f"order: {file.order}; if a part is missing: {file.if_missing}"]
    try:
        made.check(context.trainer.model.labels, context.cycle.placing.places)
    except FileError as error:
        return CommandResult("\n".join([*lines, f"It cannot be run: {error}"]), made.order().json(), NOT_DONE)
    return CommandResult("\n".join(lines), made.order().json(), DONE)


COMMANDS = (job,)
