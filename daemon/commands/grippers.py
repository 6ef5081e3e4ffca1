"""Command `gripper`: show the configured grippers, and report which one is mounted."""

from collections.abc import Callable, Sequence
from datetime import UTC, datetime

import numpy as np

from daemon.commands.positions import kept
from daemon.config import Config, gripper_unknown, kind_of
from daemon.console.context import Change, CommandContext
from daemon.console.interpreter import CommandResult, Frontend, command, no_more, one_of, yes_or_no
from daemon.console.phrases import at_mm, plural
from daemon.console.text_layout import table
from daemon.errors import NOT_DONE, CommandError
from daemon.store.mounted_gripper import MountedGripper, keep_mounted

USAGE = "gripper [use NAME]"


def _further(context: CommandContext, word: str) -> Sequence[str]:
    return tuple(context.config.values.grippers) if word == "use" else ()


@command(USAGE, "move", most=2, looks=lambda words: not words, choices=("use",), further=_further)
async def gripper(context: CommandContext, words: list[str], frontend: Frontend) -> CommandResult:
    """Show the grippers that the cell knows; say which one is mounted.

    gripper            each gripper: its kind, where its tool centre point is, and which is mounted
    gripper use cup    you have mounted the cup: facetd sets TOOL to it, guards its body, grasps with it, and disables
                       the arm. Before the arm moves, report what the gripper holds (`holding yes`, `holding no`)
    Refused while a job runs, while the arm moves, and while a part is in the gripper. facetd keeps the choice after a
    restart. The section `grippers` of facetd.yaml describes the grippers.
    """
    if not words:
        return _show(context, frontend)
    one_of(words, 0, ("use",), "word", USAGE)
    config = context.config
    if not config.values.grippers:
        raise CommandError("facetd.yaml describes only one gripper: describe each in the section `grippers`")
    name = one_of(words, 1, config.values.grippers, "gripper", USAGE)
    no_more(words, 2, USAGE)
    if name == config.gripper:
        return CommandResult(f"{name} is mounted already: nothing has changed.", {"gripper": name})
    await _check_may_change(context)
    if frontend.asks and not await yes_or_no(frontend, f"Is {name} on the arm now? [y/n]"):
        return CommandResult("Nothing was changed.", status=NOT_DONE)
    await _check_may_change(context)
    taken = await context.reload(frontend.who, _change(context, name, frontend.who))
    lines = [f"{name} is mounted. {taken}", *_what_changed(config, context.config), *_to_do(context)]
    return CommandResult("\n".join(lines), {"gripper": name, "before": config.gripper})


def _show(context: CommandContext, frontend: Frontend) -> CommandResult:
    config, rows, data = context.config, [], {}
    for name, each in config.each_gripper().items():
        kind, tool_mm = kind_of(each.values.pick.gripper), np.array(each.values.arm.flange_from_tool)[:3, 3]
        mounted = config.gripper == (name or kind)
        where = f"{kind}, tool centre point {at_mm(tool_mm)} from the wrist centre"
        rows.append((name or kind, f"{where}{'; mounted' if mounted else ''}"))
        data[name or kind] = {"kind": kind, "tool_mm": tool_mm.tolist(), "mounted": mounted}
    reported = config.mounted
    lines = [table(rows, frontend.columns)]
    lines += [gripper_unknown(config)] if config.gripper is None else []
    if reported is not None and config.gripper:
        lines.append(f"{reported.name} was mounted by {reported.who}, {reported.at}")
    return CommandResult("\n".join(lines), {"grippers": data, "gripper": config.gripper})


async def _check_may_change(context: CommandContext) -> None:
    """Check that no job runs, the gripper is empty, and the arm at rest. Raises CommandError, RefusedError."""
    supervisor = context.cycle.supervisor
    supervisor.refuse_while_stopping("gripper use")
    supervisor.refuse_during_job("the gripper is changed")
    if context.cycle.belief.holds_part:
        raise CommandError("a part is in the gripper: let it go first (`hand open` here, `pick` over the bin)")
    if not await supervisor.run("check that the arm is at rest", context.hardware.robot.at_rest(), moves=False):
        raise CommandError("the arm moves: change the gripper on an arm at rest")


def _change(context: CommandContext, name: str, who: str) -> Change:
    config, operator = context.config, context.hardware.operator
    mounted = MountedGripper(name, who, datetime.now(UTC).isoformat(timespec="seconds"))

    def mount(which: Config) -> None:
        if operator is not None:
            operator.mount(kind_of(which.values.pick.gripper))

    async def change() -> Callable[[], None]:
        keep_mounted(config.state, mounted)
        mount(config.each_gripper()[name])

        def undo() -> None:
            keep_mounted(config.state, config.mounted)
            mount(config)

        return undo

    return change


def _what_changed(before: Config, after: Config) -> list[str]:
    """What the new gripper changes: tool, guarded body and grasps, as lines of text."""
    old, new = (np.array(each.values.arm.flange_from_tool) for each in (before, after))
    held = after.values.pick.gripper
    wide, outside_mm = held.outside
    moved_mm = float(np.linalg.norm(new[:3, 3] - old[:3, 3]))
    by = "parts of any width, by their flat facets" if held.widest_mm is None else f"parts up to {held.widest_mm:g} mm"
    return [
        f"Tool: its centre point is {at_mm(new[:3, 3])} from the wrist centre, {moved_mm:.1f} mm from where it was.",
        f"Guarded: {held.tip_mm:g} mm beyond that point, {outside_mm:g} mm to either side ({wide}).",
        f"Grasps: {kind_of(held)}, {by}; `parts` says more.",
    ]


def _to_do(context: CommandContext) -> list[str]:
    """What a person has to do after the change."""
    lines = ["What it holds is unknown: look, then `holding yes` or `holding no`."]
    named = len(kept(context).now())
    if named:
        lines.append(f"{plural(named, 'position')} named with `here`: `go` brings the new tool centre point there.")
    return lines


COMMANDS = (gripper,)
