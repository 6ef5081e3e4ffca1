"""Commands about models: train a candidate, put it into use, list the versions, use another one."""

import asyncio
from typing import Any

from daemon.commands.teaching import coverage_json, describe_alike, describe_coverage
from daemon.console.context import CommandContext
from daemon.console.interpreter import CommandResult, Frontend, command, no_more, number, one_of, yes_or_no
from daemon.console.phrases import at_utc, plural
from daemon.errors import NOT_DONE, NOT_UNDERSTOOD, CommandError
from daemon.store.model_store import ModelStore
from daemon.teaching.view_coverage import ViewCoverage, confusable_pairs

MODEL_WORDS = ("list", "use")
MODEL_USAGE = "model list | model use N|latest"


@command("train", "change", first=True)
async def train(context: CommandContext, words: list[str], frontend: Frontend) -> CommandResult:
    """Train a model on all views; `accept` puts it into use.

    The new model is a candidate; the model in use stays in use. The first model of all is used at once.
    """
    trained = await context.study(context.trainer.train)
    wrong = [v for v in trained.verdicts if not v.right]
    right = len(trained.verdicts) - len(wrong)
    text = f"Candidate {trained.version}: names {right} of {plural(len(trained.verdicts), 'taught view')} correctly"
    lines = [f"{text} ({trained.seconds:.1f} s)."]
    lines += [f"  {v.view}: taken for {v.named} ({v.reason})" for v in wrong]
    lines += [f"  left out: {line}" for line in trained.left_out]
    frontend.shown = trained.version
    coverages = await _coverages(context, trained.version)
    data: dict[str, Any] = {"version": trained.version, "right": right, "views": len(trained.verdicts)}
    data["seconds"] = round(trained.seconds, 2)
    lines += [describe_coverage(coverage, brief=True) for coverage in coverages]
    data["parts"] = {coverage.label: coverage_json(coverage) for coverage in coverages}
    lines.append("`try` tests it, `accept` puts it into use.")
    first = context.trainer.model_store.current is None and not context.trainer.model.labels
    if first and not wrong:
        version = context.trainer.accept(trained.version)
        context.use_model("first", version)
        lines[-1] = f"This is the first model: version {version} is in use now."
        data["accepted"] = True
    return CommandResult("\n".join(lines), data, NOT_DONE if wrong else 0)


@command("accept", "change")
async def accept(context: CommandContext, words: list[str], frontend: Frontend) -> CommandResult:
    """Put the candidate model into use.

    It takes the candidate that you saw last, by `train`, `try`, `status` or `model`, and shows which parts could be
    confused with each other.
    """
    model_store = context.trainer.model_store
    candidate, shown = model_store.candidate, frontend.shown
    if candidate is None and model_store.current is not None:
        raise CommandError(f"version {model_store.current} is in use and there is no candidate; `train` makes one")
    if shown not in (None, candidate):
        frontend.shown = candidate
        raise CommandError(
            f"not accepted: somebody trained meanwhile. You saw version {shown}, the candidate is now version "
            f"{candidate}: `try` tests it, `accept` again takes {candidate}, `model use {shown}` takes {shown}"
        )
    await _confirm_during_pick(context, frontend)
    pairs = [] if candidate is None else confusable_pairs(await _coverages(context, candidate))
    version = await asyncio.to_thread(context.trainer.accept, candidate)
    context.use_model("accept", version)
    lines = [f"Version {version} is in use; `rollback` switches back.", *([describe_alike(pairs)] if pairs else [])]
    data = [{"labels": two.labels, "facets": two.facets, "viewpoints": two.viewpoints} for two in pairs]
    return CommandResult("\n".join(lines), {"version": version, "alike": data})


@command("rollback", "change")
async def rollback(context: CommandContext, words: list[str], frontend: Frontend) -> CommandResult:
    """Go back to the model used before."""
    if context.trainer.model_store.history:
        await _confirm_during_pick(context, frontend)
    version = await asyncio.to_thread(context.trainer.rollback)
    context.use_model("rollback", version)
    frontend.shown = context.trainer.model_store.candidate
    return CommandResult(f"Version {version} is in use again; the previous one is the candidate.", {"version": version})


@command(MODEL_USAGE, "change", most=2, choices=MODEL_WORDS, aliases=("models",),
         looks=lambda words: words[:1] in ([], ["list"]),
         further=lambda context, word: _versions(context) if word == "use" else ())  # fmt: skip
async def model(context: CommandContext, words: list[str], frontend: Frontend) -> CommandResult:
    """List the models; take one into use.

    Every version is kept. `model use 3` takes version 3, `model use latest` the newest. `rollback` returns to the
    version in use before.
    """
    word = one_of(words, 0, MODEL_WORDS, "word", MODEL_USAGE) if words else "list"
    store = context.trainer.model_store
    if word == "list":
        no_more(words, 1, MODEL_USAGE)
        frontend.shown = store.candidate
        return list_of(store)
    if len(words) < 2:
        raise CommandError(f"N is missing: {MODEL_USAGE}", NOT_UNDERSTOOD)
    version = version_named(store, words[1])
    if version == store.current:
        raise CommandError(f"version {version} is in use already")
    await _confirm_during_pick(context, frontend)
    await asyncio.to_thread(context.trainer.take, version)
    context.use_model("use", version)
    return CommandResult(f"Version {version} is in use; `rollback` switches back.", {"version": version})


async def _coverages(context: CommandContext, version: int) -> tuple[ViewCoverage, ...]:
    """Judge every part that a version knows; the last result is reused."""
    if context.coverages is None or context.coverages[0] != version:
        context.coverages = version, await context.study(context.trainer.coverages_of_version, version)
    return context.coverages[1]


def version_named(store: ModelStore, word: str) -> int:
    """The version that `word` names: a number, or `latest`. Raises CommandError."""
    known = store.versions()
    if not known:
        raise CommandError("no model is trained yet: `teach`, then `train`")
    version = known[-1] if word == "latest" else number(word, "N", 1, 9999)
    if version not in known:
        raise CommandError(f"there is no version {version}; `model list` lists the versions", NOT_UNDERSTOOD)
    return version


def list_of(store: ModelStore) -> CommandResult:
    """List every version, the parts that it knows, and its state."""
    current, candidate, before = store.current, store.candidate, store.history[-1:]
    rows, data = [], []
    for version in store.versions():
        summary = store.summary(version)
        state = {current: "in use", candidate: "candidate"}.get(version, "before" if version in before else "")
        rows.append(f"{version:>4}  {at_utc(summary.trained):<16}  {state:<9}  {summary.knows}")
        data.append({"version": version, "trained": summary.trained, "state": state, "labels": list(summary.labels)})
    if not rows:
        return CommandResult("No model is trained yet: `teach`, then `train`.", {"models": []})
    return CommandResult("\n".join([f"{'':>4}  {'trained (UTC)':<16}  {'':<9}  knows", *rows]), {"models": data})


def _versions(context: CommandContext) -> list[str]:
    return [*map(str, context.trainer.model_store.versions()), "latest"]


async def _confirm_during_pick(context: CommandContext, frontend: Frontend) -> None:
    """Ask before the model changes while the arm picks. Raises CommandError on anything but a yes."""
    cycle = context.cycle
    if not cycle.auto_on and cycle.supervisor.doing != "pick":
        return
    what = "auto is on" if cycle.auto_on else "a pick is under way"
    if not frontend.asks:
        raise CommandError(f"{what}: the next part would be picked with another model; wait, or `auto off` first")
    if not await yes_or_no(frontend, f"{what}: the next part will be picked with another model. Change it now? [y/n]"):
        raise CommandError("cancelled; the model is unchanged")


COMMANDS = (train, accept, rollback, model)
