"""Commands to set up a cell: small moves from where the arm is, and named positions."""

import re
from functools import partial

import numpy as np

from daemon import frames
from daemon.arrays import Array
from daemon.commands.step_mode import with_questions
from daemon.console.context import CommandContext
from daemon.console.interpreter import CommandResult, Frontend, command, no_more, one_of, yes_or_no
from daemon.console.phrases import at_mm, at_utc, plural
from daemon.errors import NOT_DONE, NOT_UNDERSTOOD, CommandError
from daemon.quantities import decimal, shown
from daemon.store.named_positions import NamedPositions

AXES = {
    "x": (0, "mm"), "y": (1, "mm"), "z": (2, "mm"), "rx": (0, "degrees"), "ry": (1, "degrees"), "rz": (2, "degrees"),
}  # fmt: skip
WRITTEN = {"mm": "mm", "degrees": "deg"}
"""The unit that may follow a distance; another unit than the axis has is an error."""
FRAMES = ("world", "tool")
LONGEST = {"mm": 100.0, "degrees": 30.0}
"""The longest small move; farther: `go` to a position."""
SAME_MM, SAME_DEG = 0.5, 0.2
"""The arm counts as unmoved within this distance and angle."""
JOG_USAGE = "jog x|y|z|rx|ry|rz DISTANCE [world|tool]"
POSITIONS_USAGE = "positions [NAME] | positions drop NAME"
NAME = re.compile(r"[a-z][a-z0-9_]{0,29}")


def kept(context: CommandContext) -> NamedPositions:
    """The positions that operators have named."""
    return NamedPositions(context.config.state)


def all_positions(context: CommandContext) -> list[str]:
    """All positions: the configured ones, and those named by operators."""
    return [*context.cycle.positions(), *kept(context).now()]


@command(JOG_USAGE, "move", most=3, choices=tuple(AXES), further=lambda _, __: ())
async def jog(context: CommandContext, words: list[str], frontend: Frontend) -> CommandResult:
    """Move the gripper by a small distance or angle.

    jog z -5          5 mm down, along the world's z
    jog z 5 tool      5 mm forward, along the z axis of the tool (out of the gripper)
    jog rz 10 tool    turn by 10 degrees about that axis; rx ry rz turn about the point between the fingers
    At most 100 mm or 30 degrees at a time. Guard, `pause`, `step` and `stop` work as for every move.
    """
    axis = one_of(words, 0, AXES, "axis", JOG_USAGE)
    number, unit = AXES[axis]
    distance = _distance(words[1] if len(words) > 1 else "", unit)
    frame = one_of(words, 2, FRAMES, "frame", JOG_USAGE) if len(words) > 2 else "world"
    purpose = f"jog {axis} {distance:g} {unit} ({frame})"
    work = context.cycle.jog(partial(_moved, number, unit, distance, frame), purpose)
    pose = await with_questions(context, work, frontend)
    if context.cycle.supervisor.mover.dry:
        return CommandResult("Dry run: planned, not sent.")
    return CommandResult(f"At {at_mm(pose[:3, 3])}.", {"world_from_tool": pose.tolist()})


def _distance(word: str, unit: str) -> float:
    try:
        distance = decimal(word, WRITTEN[unit])
    except ValueError:
        distance = np.nan
    if not 0 < abs(distance) <= LONGEST[unit]:
        found = shown(word) or "nothing"
        raise CommandError(
            f"DISTANCE: expected a number from -{LONGEST[unit]:g} to {LONGEST[unit]:g} {unit}, found {found}",
            NOT_UNDERSTOOD,
        )
    return distance


def _moved(axis: int, unit: str, distance: float, frame: str, world_from_tool: Array) -> Array:
    """The tool pose after a small move along an axis, or about one through the tool centre point."""
    along = np.eye(3)[axis]
    turned, shifted = np.eye(3), np.zeros(3)
    if unit == "mm":
        shifted = along * distance
    else:
        turned = frames.rotation_from_vector(along * np.radians(distance))
    rotation, point = world_from_tool[:3, :3], world_from_tool[:3, 3]
    if frame == "tool":
        return frames.rigid(rotation @ turned, point + rotation @ shifted)
    return frames.rigid(turned @ rotation, point + shifted)


@command("go POSITION", "move", most=1, choices=all_positions)
async def go(context: CommandContext, words: list[str], frontend: Frontend) -> CommandResult:
    """Move to home, bin, a survey position, or a position named by `here`."""
    position = one_of(words, 0, all_positions(context), "position", go.usage)
    named = kept(context).now()
    if position in named and position in context.cycle.positions():
        raise CommandError(
            f"two positions are named {position}, one in facetd.yaml: `positions drop {position}`, then give the other "
            "another name"
        )
    own = position in named
    work = context.cycle.move_to(named[position], position) if own else context.cycle.go(position)
    await with_questions(context, work, frontend)
    dry = context.cycle.supervisor.mover.dry
    return CommandResult(f"Dry run: planned to {position}, not sent." if dry else f"At {position}.")


@command("here NAME", "change", most=1, choices=lambda context: kept(context).now())
async def here(context: CommandContext, words: list[str], frontend: Frontend) -> CommandResult:
    """Name the position where the arm is now, for `go NAME`.

    A position that had this name before stays in its history (`positions NAME`).
    """
    if not words:
        raise CommandError(f"NAME is missing: {here.usage}", NOT_UNDERSTOOD)
    name = words[0]
    if not NAME.fullmatch(name):
        raise CommandError(f"{name}: a position's name is small letters, digits and _, as in bin2", NOT_UNDERSTOOD)
    if name in context.cycle.positions() or name == "drop":
        raise CommandError(f"{name} is a position of the configuration (`pick` in facetd.yaml); choose another name")
    pose = await context.cycle.wait_until_at_rest()
    before = kept(context).now().get(name)
    if before is not None and frontend.asks:
        apart = float(np.linalg.norm(pose[:3, 3] - before[:3, 3]))
        if not await yes_or_no(frontend, f"{name} is {apart:.1f} mm from here. Replace it by this position? [y/n]"):
            return CommandResult("Nothing was changed.", status=NOT_DONE)
        off_mm, turned = frames.size(frames.difference(await context.cycle.wait_until_at_rest(), pose))
        if off_mm > SAME_MM or np.degrees(turned) > SAME_DEG:
            raise CommandError(f"the arm has moved since the question: repeat `here {name}`")
    kept(context).keep(name, pose, frontend.who)
    return CommandResult(f"{name} is {at_mm(pose[:3, 3])}; `go {name}` returns here.", {"place": name})


@command(
    POSITIONS_USAGE,
    "change",
    most=2,
    looks=lambda words: words[:1] != ["drop"],
    choices=lambda context: ("drop", *kept(context).now()),
    further=lambda context, word: kept(context).now() if word == "drop" else (),
)
async def positions(context: CommandContext, words: list[str], frontend: Frontend) -> CommandResult:
    """List the positions; show the history of one; delete one."""
    named = kept(context)
    if words[:1] == ["drop"]:
        name = one_of(words, 1, named.now(), "named position", POSITIONS_USAGE)
        named.keep(name, None, frontend.who)
        return CommandResult(f"{name} is deleted.", {"dropped": name})
    no_more(words, 1, POSITIONS_USAGE)
    if words:
        one_of(words, 0, {one.name for one in named.history()}, "named position", POSITIONS_USAGE)
        rows = [f"{at_utc(one.kept)} UTC  {_at(one.world_from_tool)}  by {one.who}" for one in named.history(words[0])]
        return CommandResult("\n".join(rows), {"history": len(rows)})
    configured, own = context.cycle.positions(), named.now()
    poses, count = {**configured, **own}, len(own)
    rows = [f"{name:<{max(map(len, poses))}}  {_at(pose)}" for name, pose in [*configured.items(), *own.items()]]
    own_ones = f"{plural(count, 'position')} named with `here NAME`; the others are" if count else "All are"
    rows.append(f"{own_ones} the configuration's.")
    return CommandResult("\n".join(rows), {"places": {name: np.asarray(pose).tolist() for name, pose in poses.items()}})


def _at(pose: Array | None) -> str:
    return "dropped" if pose is None else at_mm(pose[:3, 3])


COMMANDS = (go, jog, here, positions)
