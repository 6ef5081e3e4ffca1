"""Command `place`: show, check, plan, teach, clear and drop places for parts. positions.py has positions of the arm."""

from collections import Counter
from collections.abc import Callable, Sequence

import numpy as np

from daemon import frames
from daemon.commands.step_mode import with_questions
from daemon.console.context import CommandContext
from daemon.console.interpreter import CommandResult, Frontend, command, form_of, no_more, one_of, yes_or_no
from daemon.console.phrases import at_mm, at_utc, millimetres, plural
from daemon.console.text_layout import table
from daemon.errors import NOT_DONE, NOT_UNDERSTOOD, CommandError
from daemon.pick.planning import Goal, SidePlan, flattened, plan_picture, spot_of, stable_sides
from daemon.pick.set_down import HeldHere
from daemon.store.files import failing_as, write_atomically
from daemon.store.outside import FileError
from daemon.store.place_file import NAME, PlaceEntry, PlacesFile, pattern_of, with_place, without_place, write_places
from daemon.store.place_status import FILLABLE, PlaceState, PlaceStatus
from daemon.vision.geometry import Polyhedron

USAGE = "place show [NAME|PART] | check [NAME] | plan PART [NAME] | teach NAME PART|here | clear NAME|all | drop NAME"
ACTS = ("show", "check", "plan", "teach", "clear", "drop")
SURE = 2.0
"""A place is known well enough where its tolerance is this many predicted errors."""
HERE = "here"
"""In place of a label: the part in the gripper, where the arm is."""
MOST_PLANNED = 3
"""The most places planned by one command; of a pattern only the first."""
PICTURE = "place-plan.svg"
"""File name of the drawing of the last plan, in the state folder."""
MOST_NAMED = 3
"""The most places named in a line about places that moved."""


def _names(context: CommandContext) -> list[str]:
    return [place.name for place in context.cycle.placing.places.places]


def _places_and_patterns(context: CommandContext) -> list[str]:
    return [*_names(context), *context.cycle.placing.places.file.patterns]


def _places_named(context: CommandContext, words: list[str], act: str) -> list[str]:
    """The places that a name means: one place, or those of a pattern. act: for which `place ...`."""
    name = one_of(words, 0, _places_and_patterns(context), "place or pattern", form_of(USAGE, act))
    return [each for each in _names(context) if name in (each, pattern_of(each))]


def _completions(context: CommandContext, word: str) -> Sequence[str]:
    more = {"clear": ("all",), "show": context.parts, "plan": context.parts}
    return (*_places_and_patterns(context), *more.get(word, ()))


@command(USAGE, "move", most=3, looks=lambda words: not words or words[0] == "show", choices=ACTS, further=_completions)
async def place(context: CommandContext, words: list[str], frontend: Frontend) -> CommandResult:
    """Show, check and teach where parts belong.

    place show          every place: its part, its status, where it is
    place show cube     the sides of the cube, by number
    place check         look at every place that is not free, and store its status
    place check nest    the same for one place, or for the places of a pattern
    place plan cube     for each side that the cube can lie on: the grasps that bring it to its places, at most three,
                        laid on the table in between; or why there are none. Draws a picture
    place teach nest cube   the cube lies where it belongs: look at it from up to three sides and store its pose
    place teach nest here   the gripper holds a part that facetd picked: first jog or guide the arm to where it belongs
    place clear nest    you have emptied it: facetd brings parts there again (also a pattern, or `all`)
    place drop nest     delete it
    A part without a place goes to the bin. Write fixtures and patterns into places.yaml, then `reload`.
    """
    if words and context.hardware.operator is not None and words[0] in context.hardware.operator.labels:
        raise CommandError(f"to hold a part before the cameras: `show {' '.join(words)}`", NOT_UNDERSTOOD)
    act = one_of(words, 0, ACTS, "word", USAGE) if words else "show"
    result = await HANDLERS[act](context, words[1:], frontend)
    report_moved(context)
    return result


async def _show(context: CommandContext, words: list[str], frontend: Frontend) -> CommandResult:
    no_more(words, 1, USAGE)
    placing = context.cycle.placing
    if words and words[0] in context.parts and words[0] not in _places_and_patterns(context):
        return _sides(context, words[0])
    names = _places_named(context, words, "show") if words else _names(context)
    rows, data = [], {}
    for name in names:
        state, part = placing.statuses.of(name), placing.places.named(name)
        assert part is not None
        goal = placing.goals.get(name)
        where = placing.unusable[name] if goal is None else at_mm(goal.centre)
        rows.append((name, f"{part.part}: {_status_text(state)}; {where}"))
        data[name] = {"part": part.part, **_status_json(state), "at": None if goal is None else goal.centre.tolist()}
    lines = [table(rows, frontend.columns)] if rows else ["No place is taught; every part goes to the bin."]
    if not words:
        lines += [
            f"pattern {name}: the fourth corner is {off_mm:.2f} mm from where the other three put it"
            for name, off_mm in placing.places.residuals_mm.items()
        ]
        lines += [
            f"fixture {one.name}: its solid has {plural(len(one.entry.solid), 'piece')}"
            for one in placing.places.fixtures
        ]
    return CommandResult("\n".join(lines), {"places": data})


def _status_text(state: PlaceState) -> str:
    """A status as text: seen right, 0.12 mm and 0.05 degrees off, within 1 mm and 1 degrees (since ...)."""
    since = f" ({at_utc(state.at)} UTC)" if state.at else ""
    return f"{state.status}{f', {state.why}' if state.why else ''}{since}"


def _status_json(state: PlaceState) -> dict[str, object]:
    return {"status": str(state.status), "off_mm": state.off_mm, "off_deg": state.off_deg}


def _sides(context: CommandContext, label: str) -> CommandResult:
    """List the sides of a part, numbered as side_down numbers them."""
    shape = _shape(context, label)
    corners = [shape.corners_mm[ring] for ring in shape.rings]
    lengths = [np.linalg.norm(np.roll(each, -1, axis=0) - each, axis=1) for each in corners]
    rows = [f"side {n}: {len(each)} corners, {millimetres(each)}" for n, each in enumerate(lengths, start=1)]
    return CommandResult("\n".join(rows), {"sides": len(rows), "edges_mm": [each.tolist() for each in lengths]})


def _shape(context: CommandContext, label: str) -> Polyhedron:
    sight = context.cycle.recogniser
    shape = None if sight is None else sight.shape(label)
    if shape is None:
        raise CommandError(f"{label}: not taught yet; `teach {label}`, then `train`")
    return shape


def _goal(context: CommandContext, name: str) -> Goal:
    """Where the part of a place lies. Raises CommandError for a place that cannot be used."""
    placing = context.cycle.placing
    if name in placing.unusable:
        raise CommandError(f"place {name}: {placing.unusable[name]}")
    return placing.goals[name]


async def _check(context: CommandContext, words: list[str], frontend: Frontend) -> CommandResult:
    no_more(words, 1, USAGE)
    placing = context.cycle.placing
    taken = [goal.place.name for goal in placing.taken()]
    names = _places_named(context, words, "check") if words else taken
    names = names if len(names) == 1 else [name for name in names if name in taken]
    goals = [_goal(context, name) for name in names]
    if not goals:
        return CommandResult("Every place is free: there is nothing to look at.", {"places": {}})
    await with_questions(context, context.cycle.look_at_places(goals), frontend)
    if context.cycle.supervisor.mover.dry:
        return CommandResult(f"Dry run: {plural(len(goals), 'place')} planned, not looked at.")
    states = {name: placing.statuses.of(name) for name in names}
    right = all(state.status in (PlaceStatus.RIGHT, *FILLABLE) for state in states.values())
    rows = [(name, f"{placing.goals[name].place.part}: {_status_text(state)}") for name, state in states.items()]
    data = {name: {**_status_json(state), "why": state.why} for name, state in states.items()}
    return CommandResult(table(rows, frontend.columns), {"places": data}, 0 if right else NOT_DONE)


async def _plan(context: CommandContext, words: list[str], frontend: Frontend) -> CommandResult:
    """Plan whether a part can be brought to its places, from each side that it can lie on."""
    no_more(words, 2, USAGE)
    label, placing = one_of(words, 0, context.parts, "part", form_of(USAGE, "plan")), context.cycle.placing
    own = [place.name for place in placing.places.of(label)]
    if not own:
        return CommandResult(f"The {label} has no place: it goes to the bin.", {"plans": {}})
    if words[1:]:
        names = [name for name in _places_named(context, words[1:], "plan") if name in own][:1]
    else:
        names = list({pattern_of(name): name for name in reversed(own)}.values())[::-1][:MOST_PLANNED]
    if not names:
        raise CommandError(f"{words[1]}: not a place of the {label}, which goes to {', '.join(own[:MOST_NAMED])}")
    plans: dict[str, list[SidePlan]] = {}
    for name in names:
        goal, plans[name] = _goal(context, name), []
        try:
            for side in stable_sides(goal.shape):
                plan = await context.cycle.plan_from_side(goal, side)
                await frontend.say(f"{name}, from side {plan.side} down: {_plan_text(plan)}")
                plans[name].append(plan)
        except ValueError as error:
            raise CommandError(f"{label}: its taught corners give no solid to grasp: {error}") from None
    ways = {name: sum(bool(plan.found) for plan in each) for name, each in plans.items()}
    reached = [f"{name} from {n} of {plural(len(plans[name]), 'side')}" for name, n in ways.items()]
    path = context.config.places_file.with_name(PICTURE)
    with failing_as(CommandError, f"{path}: the picture was not written"):
        write_atomically(path, plan_picture(_shape(context, label), plans, context.cycle.settings.gripper.body))
    text = f"The {label} can be brought to {'; '.join(reached)} that it can lie on. Picture: {path}"
    data = {
        name: [
            {"side": p.side, "found": p.found, "tried": p.tried, "grasps": [m.grasp for m in p.motions], "why": p.why}
            for p in each
        ]
        for name, each in plans.items()
    }
    return CommandResult(text, {"plans": data, "picture": str(path)}, 0 if any(ways.values()) else NOT_DONE)


def _plan_text(plan: SidePlan) -> str:
    how = ", laid down, then ".join(motion.grasp for motion in plan.motions)
    if len(plan.motions) > 1:
        how = f"{len(plan.motions)} grasps: {how}"
    if plan.found == plan.tried:
        return f"yes, {how}"
    if plan.found:
        return f"in {plan.found} of {plan.tried} headings on the table: {how}; in the others: {plan.why}"
    return f"no: {plan.why}"


async def _teach(context: CommandContext, words: list[str], frontend: Frontend) -> CommandResult:
    no_more(words, 2, USAGE)
    if len(words) < 2:
        raise CommandError(f"{'PART' if words else 'NAME'} is missing: {form_of(USAGE, 'teach')}", NOT_UNDERSTOOD)
    name = words[0]
    held = words[1] == HERE and HERE not in context.parts
    label = HERE if held else one_of(words, 1, (*context.parts, HERE), "part", form_of(USAGE, "teach"))
    placing = context.cycle.placing
    if not NAME.fullmatch(name) or name == "all" or name in placing.places.file.patterns:
        raise CommandError(
            f"{name}: a place's name has small letters, digits and _, as nest_2, and is no pattern's and not `all`",
            NOT_UNDERSTOOD,
        )
    old = placing.places.file.places.get(name)
    asked = old is not None and frontend.asks
    if asked and not await yes_or_no(frontend, f"There is a place {name}. Replace its pose? [y/n]"):
        return CommandResult("Nothing was changed.", status=NOT_DONE)
    known: HeldHere | None = None
    if held:
        known = await context.cycle.held_here()
        label, pose = known.label, known.world_from_part
    else:
        _shape(context, label)
        pose = await with_questions(context, context.cycle.locate(label), frontend)
        if context.cycle.supervisor.mover.dry:
            return CommandResult("Dry run: planned, nothing taught.")
    shape = _shape(context, label)
    pose = flattened(pose, shape, context.config.values.pick.limits.table_z_mm)
    frame = np.eye(4)
    if old is not None and old.fixture is not None:
        frame = placing.places.file.fixtures[old.fixture].world_from_fixture
    rows = tuple(tuple(float(v) for v in row) for row in (frames.inverse(frame) @ pose).round(6))
    entry = _taught_entry(old, label, rows)
    # Status first: a daemon killed before the file is written leaves no place that counts as free.
    spot = spot_of(entry, shape, pose)
    if held:
        placing.statuses.put(name, PlaceStatus.CLAIMED, why="the gripper held a part there", spot=spot)
    else:
        placing.statuses.put(name, PlaceStatus.RIGHT, 0.0, 0.0, "it lay there as the place was taught", spot)
    await _write(context, frontend, with_place(placing.places, name, entry))
    status = context.cycle.placing.statuses.of(name).status
    _record(context, name, label, status, f"taught by {frontend.who}")
    middle = np.asarray(frames.apply(pose, shape.corners_mm).mean(axis=0))
    lies = "is in the gripper" if held else "lies"
    text = f"{name} is where the {label} {lies}, {at_mm(middle)}. When you take it away: `place clear {name}`."
    data: dict[str, object] = {"place": name, "world_from_part": pose.tolist()}
    if known is not None:
        text += f"\n{_accuracy_text(known, entry)}"
        data |= {"errs_mm": known.errs_mm, "errs_deg": known.errs_deg}
    if why := context.cycle.placing.unusable.get(name):
        text += f"\nIt cannot be used: {why}"
    return CommandResult(text, data)


def _accuracy_text(known: HeldHere, entry: PlaceEntry) -> str:
    """The accuracy of a place that was taught with the part in the gripper, compared with its tolerance."""
    text = f"Known to {known.errs_mm:.2f} mm and {known.errs_deg:.2f} degrees (one standard deviation)"
    if SURE * known.errs_mm <= entry.tolerance_mm and SURE * known.errs_deg <= entry.tolerance_deg:
        return f"{text}."
    most = f"{entry.tolerance_mm:g} mm and {entry.tolerance_deg:g} degrees"
    lay_it = "If you can, lay the part there and type `place teach NAME PART`"
    return f"{text}: too much for its tolerance of {most}. {lay_it}."


def _record(context: CommandContext, name: str, label: str, status: PlaceStatus, why: str) -> None:
    goal = context.cycle.placing.goals.get(name)
    outline = None if goal is None else goal.outline
    context.log.record("place", place=name, label=label, status=str(status), why=why, outline=outline)


def _taught_entry(old: PlaceEntry | None, label: str, pose: tuple[tuple[float, ...], ...]) -> PlaceEntry:
    place_settings = {} if old is None else {
        key: getattr(old, key)
        for key in ("fixture", "tolerance_mm", "tolerance_deg", "equivalents", "any_turn", "approach_mm", "release_mm")
    }  # fmt: skip
    return PlaceEntry(part=label, pose=pose, **place_settings)  # type: ignore[arg-type]


async def _clear(context: CommandContext, words: list[str], frontend: Frontend) -> CommandResult:
    no_more(words, 1, USAGE)
    every = words[:1] == ["all"]
    names = _names(context) if every else _places_named(context, words, "clear")
    if len(names) > 1 and frontend.asks and not await yes_or_no(frontend, f"Are all {len(names)} places empty? [y/n]"):
        return CommandResult("Nothing was changed.", status=NOT_DONE)
    if context.cycle.supervisor.busy:
        raise CommandError("a job is running: clear places when it has ended")
    for name in names:
        context.cycle.placing.statuses.put(name, PlaceStatus.EMPTIED)
        label = next(one.part for one in context.cycle.placing.places.places if one.name == name)
        _record(context, name, label, PlaceStatus.EMPTIED, f"by {frontend.who}")
    return CommandResult(f"{plural(len(names), 'place')} marked as emptied: facetd brings parts there again.")


async def _drop(context: CommandContext, words: list[str], frontend: Frontend) -> CommandResult:
    no_more(words, 1, USAGE)
    placing = context.cycle.placing
    known = [*placing.places.file.places, *placing.places.file.patterns]
    name = one_of(words, 0, known, "place or pattern", form_of(USAGE, "drop"))
    dropped = {one for one in _names(context) if name in (one, pattern_of(one))}
    await _write(context, frontend, without_place(placing.places, name))
    context.cycle.placing.statuses.forget(dropped)
    return CommandResult(f"{name} is deleted.", {"dropped": name})


async def _write(context: CommandContext, frontend: Frontend, file: PlacesFile) -> None:
    """Write places.yaml and take it into use, in one turn; a file that cannot be used is replaced by the old one."""
    path, before = context.config.places_file, context.cycle.placing.places.file

    async def change() -> Callable[[], None]:
        write_places(path, file)
        return lambda: write_places(path, before)

    try:
        await context.reload(frontend.who, change)
    except FileError as error:
        raise CommandError(str(error)) from None


def destinations(context: CommandContext, label: str) -> str:
    """Where parts of a label go, as text."""
    placing = context.cycle.placing
    own = placing.places.of(label)
    if not own:
        return "to the bin"
    free = sum(placing.statuses.of(one.name).status in FILLABLE for one in own)
    if len(own) == 1:
        return f"to place {own[0].name}, {'free' if free else 'not free'}"
    return f"to {len(own)} places, {free} free"


def report_moved(context: CommandContext) -> None:
    """Report, once each, the places that must be checked because they moved, or overlap one where a part was left."""
    try:
        moved = context.cycle.placing.moved()
    except FileError as error:
        context.troubles.report("places", str(error))
        return
    text = "; ".join(f"place {name}: {why}" for name, why in list(moved.items())[:MOST_NAMED])
    more = f"; and {len(moved) - MOST_NAMED} more" if len(moved) > MOST_NAMED else ""
    advice = "the next pick looks there first; `place check` looks now, `place clear NAME` if it is empty"
    context.troubles.report("places", f"{text}{more}: {advice}" if moved else None)


def counted(context: CommandContext) -> dict[str, int]:
    """The number of places of each status."""
    statuses = context.cycle.placing.statuses
    return dict(Counter(str(statuses.of(name).status) for name in _names(context)))


def each_place(context: CommandContext) -> list[dict[str, object]]:
    """Every place whose part is taught, with its outline from above (mm, world), for the dashboard."""
    placing = context.cycle.placing
    return [
        {"name": name, "part": goal.place.part, **_status_json(placing.statuses.of(name)), "outline": goal.outline}
        for name, goal in placing.goals.items()
    ]


HANDLERS = {"show": _show, "check": _check, "plan": _plan, "teach": _teach, "clear": _clear, "drop": _drop}
COMMANDS = (place,)
