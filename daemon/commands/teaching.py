"""Commands that teach: store a view of a part or its drawing, list views, remove them. models.py makes the models."""

import difflib
import hashlib
import re
from collections import Counter
from collections.abc import Sequence
from typing import Any

from daemon.commands import simulated_parts, teach_around
from daemon.commands.ascii_sketch import sketch
from daemon.commands.observing import describe_facet, take_look
from daemon.console.context import CommandContext
from daemon.console.interpreter import CommandResult, Frontend, command, no_more, number, one_of, yes_or_no
from daemon.console.phrases import at_utc, plural
from daemon.console.text_layout import table
from daemon.errors import NOT_DONE, NOT_UNDERSTOOD, CommandError, spelt
from daemon.pick.around import LEAST_PLACES, MOST_PLACES, USUAL_PLACES
from daemon.pick.looks import Look
from daemon.store.outside import read_file
from daemon.store.yamlfile import LARGEST_BYTES
from daemon.teaching.drawing_summary import describe_drawing
from daemon.teaching.foreign_drawings import in_own_format
from daemon.teaching.mesh import UNITS_MM, MeshError, UnitError
from daemon.teaching.solid_from_mesh import Drawing, read_drawing
from daemon.teaching.trainer import ROUND, teaching_note
from daemon.teaching.view_coverage import VIEWPOINTS, ConfusablePair, ViewCoverage, unconnected_facets
from daemon.vision.model import TeachError, facet_name, facets_counted
from daemon.vision.values import Facet

LABEL = re.compile(r"[a-z][a-z0-9_]{0,39}")
MOST_ALIKE = 3
"""Pairs of similar parts that `accept` names."""
MESH_USAGE = "teach LABEL --mesh FILE.stl|obj|ply|3mf|step [mm|cm|m|inch]"


def labels_with_views(context: CommandContext) -> list[str]:
    """Labels that have a view or a drawing."""
    return context.trainer.model_store.labels()


def _numbers(context: CommandContext, label: str) -> list[str]:
    return [str(view.number) for view in context.trainer.model_store.views(label)]


@command("teach LABEL [--mesh FILE | --around [PLACES]]", "change", most=None, choices=lambda context: context.parts,
         first=True, further=lambda _, __: ("--mesh", "--around"))  # fmt: skip
async def teach(context: CommandContext, words: list[str], frontend: Frontend) -> CommandResult:
    """Teach a part, from the cameras or from its drawing.

    Show the part alone. The screen shows a drawing of what is seen; confirm it. Then you see which sides are
    still unknown and which parts it could be confused with.
    --mesh FILE [mm|cm|m|inch]   learn the exact shape from a drawing, a file on your computer: .stl or .obj; with
    the extra `drawings` also .ply, .3mf and .step
    --around [PLACES]   the part lies alone on the table: the arm looks at it from 6 to 12 places (10), and facetd
    learns all sides but the lower one, writes an STL, and compares it with the drawing if there is one. Asks first.
    """
    if "--mesh" in words:
        return await _teach_drawing(context, words, frontend)
    if "--around" in words:
        return await _teach_around(context, words, frontend)
    label = await _label(context, words, frontend)
    hand = context.hardware.operator
    if hand is None:
        return await _teach_what_is_shown(context, label, frontend)
    await frontend.say(simulated_parts.show(context, label))
    try:
        return await _teach_what_is_shown(context, label, frontend)
    finally:
        hand.put_back()


async def _teach_what_is_shown(context: CommandContext, label: str, frontend: Frontend) -> CommandResult:
    seen = await take_look(context, frontend, f"teach {label}")
    left, right = seen.pictures.left.pixels, seen.pictures.right.pixels
    table, moved = context.table_in(seen), seen.taken.moved
    group, others = await context.study(context.trainer.check, label, left, right, table, moved)
    facets, sides = await context.study(context.trainer.preview_view, label, group)
    apart, foreign = unconnected_facets(group, others)
    await frontend.say(facets_shown(label, facets, sides, (apart, foreign), frontend.columns))
    if any(len(other.facets) > 1 for other in others) and not frontend.asks:
        raise CommandError(f"{len(others) + 1} separate objects are in view; show the {label} alone, evenly lit")
    named = _other_name(seen, label)
    if named:
        await frontend.say(f"The model in use recognises this as {named}.")
    if frontend.asks and not await yes_or_no(frontend, f"Is this the {label}, alone and whole? [y/n]"):
        return CommandResult(
            "Not stored. Turn the part or improve the light, then `teach` again.", {"kept": False}, NOT_DONE
        )
    note = teaching_note(frontend.who, _digest(context), table, facets, moved)
    view = await context.study(context.trainer.store, label, left, right, note)
    verdict, data = await _coverage(context, label)
    text = f"Stored as view {view.name} ({plural(len(facets), 'facet')}).\n{verdict}"
    data |= {"kept": True, "view": view.name, "facets": [facet.type for facet in facets], "apart": len(apart)}
    return CommandResult(text, data)


async def _teach_around(context: CommandContext, words: list[str], frontend: Frontend) -> CommandResult:
    """Learn a part on the table from looks all round it."""
    at = words.index("--around")
    no_more(words[at:], 2, teach_around.USAGE)
    count = USUAL_PLACES
    if len(words) > at + 1:
        count = number(words[at + 1], "PLACES", LEAST_PLACES, MOST_PLACES)
    label = await _label(context, words[:at], frontend)
    context.cycle.supervisor.refuse_unless_permitted()
    hand = context.hardware.operator
    if hand is not None:
        await frontend.say(simulated_parts.lay(context, label))
    try:
        part = await teach_around.learn_around(context, label, count, frontend)
    finally:
        if hand is not None:
            hand.put_back()
    if part is None:
        return CommandResult("Cancelled; nothing is stored.", {"kept": False}, NOT_DONE)
    drawn_solid = await context.study(context.trainer.drawing, label)
    lines, deviations = await context.study(teach_around.deviations_from_drawing, part, drawn_solid)
    if lines:
        await frontend.say("\n".join(lines))
    if frontend.asks and not await yes_or_no(frontend, f"Is this the {label}? [y/n]"):
        return CommandResult("Not stored. Improve light or use more places, then repeat.", {"kept": False}, NOT_DONE)
    note = {"who": frontend.who, "calibration": _digest(context), "places": count}
    view = await context.study(context.trainer.store_learnt_part, label, part.solid, note)
    verdict, data = await _coverage(context, label)
    return teach_around.stored_result(view, part, [verdict, "Next: `train`."], {"beside_drawing": deviations, **data})


async def _teach_drawing(context: CommandContext, words: list[str], frontend: Frontend) -> CommandResult:
    """Learn a part from the file of its drawing, without showing it."""
    at = words.index("--mesh")
    file, unit = (*words[at + 1 :], *(None,) * 2)[:2]
    if file is None:
        raise CommandError(f"FILE is missing: {MESH_USAGE}", NOT_UNDERSTOOD)
    no_more(words[at:], 3, MESH_USAGE)
    in_unit = one_of(words, at + 2, UNITS_MM, "unit", MESH_USAGE) if unit is not None else "mm"
    content = await frontend.fetch(file)
    name = spelt(file.rpartition("/")[2])
    try:  # report an unusable file before asking anything
        name, content, in_unit = await context.study(in_own_format, name, content, in_unit)
        drawing, in_unit = await _read_with_unit(context, name, content, in_unit, frontend)
        opening_mm = context.config.values.pick.gripper.widest_mm
        summary = await context.study(describe_drawing, drawing, opening_mm)
        await frontend.say("\n".join(summary))
        label = await _label(context, words[:at], frontend, shown=False)
        odd = await context.study(context.trainer.drawing_conflict, label, name, content, in_unit)
        if odd is not None and not (frontend.asks and await yes_or_no(frontend, f"{odd}. Store it anyway? [y/n]")):
            raise CommandError(f"not stored: {odd}")
        view = await context.study(context.trainer.store_mesh, label, name, content, in_unit, {"who": frontend.who})
    except (MeshError, TeachError) as error:
        raise CommandError(str(error), NOT_UNDERSTOOD) from None
    verdict, data = await _coverage(context, label)
    kinds = view.note["facets"][0]
    lines = [f"Stored as {view.name}: a solid of {plural(len(kinds), 'facet')} ({facets_counted(kinds)})."]
    lines.append(verdict)
    unmade = (await simulated_parts.know_drawings(context)).get(label)
    if unmade is not None:
        lines.append(f"The simulated cell cannot show it: {unmade}.")
    elif context.hardware.operator is not None:
        lines.append(f"In the simulated cell: `show {label}`, or `scatter {label}` onto the table.")
    lines.append("Next: `train`.")
    return CommandResult("\n".join(lines), {"kept": True, "view": view.name, "understood": summary, **data})


async def _read_with_unit(
    context: CommandContext, name: str, content: bytes, unit: str, frontend: Frontend
) -> tuple[Drawing, str]:
    """Read a drawing; ask for its unit where the given one makes an implausible part. Raises MeshError."""
    try:
        return await context.study(read_drawing, name, content, unit, context.trainer.library), unit
    except UnitError as error:
        if not frontend.asks:
            raise
        asked = error
    answer = (await frontend.ask(f"{asked.question} Answer {asked.others}: ")).strip().lower()
    if answer not in UNITS_MM:
        raise asked
    return await context.study(read_drawing, name, content, answer, context.trainer.library), answer


@command("untaught")
async def untaught(context: CommandContext, words: list[str], _: Frontend) -> CommandResult:
    """List parts that are not taught, and views not in use yet."""
    missing, waiting = context.trainer.untaught(), context.trainer.untrained_views()
    lines = [f"Not taught yet: {', '.join(missing)}." if missing else "Every part of parts.yaml is taught."]
    if waiting:
        names = ", ".join(view.name for view in waiting)
        lines.append(f"Taught, not in use yet: {names}; `train`, then `accept`.")
    return CommandResult("\n".join(lines), {"untaught": missing, "waiting": [view.name for view in waiting]})


@command("views [LABEL]", most=1, choices=labels_with_views)
async def views(context: CommandContext, words: list[str], frontend: Frontend) -> CommandResult:
    """List the taught views."""
    label = one_of(words, 0, context.trainer.model_store.labels(), "part with views", views.usage) if words else None
    found = context.trainer.model_store.views(label)
    rows = [(view.name, view.damage or taught_line(view.note)) for view in found]
    data = [{"view": view.name, **{k: v for k, v in view.note.items() if k != ROUND}} for view in found]
    return CommandResult(table(rows, frontend.columns) or "No view is stored yet: `teach LABEL`.", {"views": data})


@command("forget LABEL [NUMBER]", "change", most=2, choices=labels_with_views, further=_numbers)
async def forget(context: CommandContext, words: list[str], frontend: Frontend) -> CommandResult:
    """Remove taught views."""
    label = one_of(words, 0, context.trainer.model_store.labels(), "part with views", forget.usage)
    which = number(words[1], "NUMBER", 1, 9999) if len(words) > 1 else None
    what = f"view {label}/{which}" if which else f"all views of {label}"
    if which and str(which) not in (there := _numbers(context, label)):
        raise CommandError(f"there is no {what}; of {label} there are {', '.join(there)}")
    if frontend.asks and not await yes_or_no(frontend, f"Delete {what} permanently? [y/n]"):
        return CommandResult("Nothing was removed.", {"removed": 0}, NOT_DONE)
    removed = context.trainer.model_store.drop_views(label, which)
    await simulated_parts.know_drawings(context)
    if not removed:
        raise CommandError(f"there is no {what}")
    text = f"{plural(removed, 'view')} deleted. The model in use is unchanged; `train` makes one without."
    return CommandResult(text, {"removed": removed})


async def _label(context: CommandContext, words: list[str], frontend: Frontend, shown: bool = True) -> str:
    """The label to teach; ask about a new one. shown: a simulated operator must have the part. Raises CommandError."""
    no_more(words, 1, "teach LABEL")
    if not words:
        known = ", ".join(context.parts) or "none yet"
        raise CommandError(f"LABEL is missing: `teach LABEL`; known labels: {known}", NOT_UNDERSTOOD)
    label = words[0]
    if label in context.parts:
        return label
    if not LABEL.fullmatch(label) or label in ("unknown", "nothing"):
        raise CommandError(f"{label}: a label is small letters, digits and _, as in hex_bolt", NOT_UNDERSTOOD)
    close = difflib.get_close_matches(label, context.parts, 1)
    hint = f"; did you mean {close[0]}?" if close else f" (known: {', '.join(context.parts)})."
    if context.hardware.operator is not None and shown:
        way = f"The simulated cell cannot show it: teach {label} --mesh FILE"
    elif not frontend.asks:
        way = "To add a new part, teach it at a console or add it to parts.yaml"
    else:
        way = ""
    if way:
        raise CommandError(f"{label}: no such part{hint} {way}", NOT_UNDERSTOOD)
    if not await yes_or_no(frontend, f"{label} is not in parts.yaml{hint} Teach it as a new part? [y/n]"):
        raise CommandError("cancelled; nothing was taught")
    return label


async def _coverage(context: CommandContext, label: str) -> tuple[str, dict[str, Any]]:
    """What the stored views do not yet show of a part, as text and as JSON values."""
    coverage = await context.study(context.trainer.coverage, label)
    if coverage is None:
        return "", {}
    return describe_coverage(coverage), {"sufficiency": coverage_json(coverage)}


def describe_coverage(coverage: ViewCoverage, brief: bool = False) -> str:
    """A few lines: what is known, what was never seen, what the part could be confused with, what to show next. brief:
    one line, without the advice for the person who holds the part."""
    known = f"{coverage.label}: {plural(len(coverage.facets), 'side')} known"
    if coverage.unseen:
        known += f"; from {100 * coverage.unseen:.0f} % of all directions it shows sides that were never seen"
    else:
        known += ", enough from every direction"
    if brief:
        taken = {name for m in coverage.mistakes for name in m.recognised_as if name not in (coverage.label, "unknown")}
        return known + (f"; from some it could be {' or '.join(sorted(taken))}" if taken else "") + "."
    lines = [known + "."]
    if coverage.turn_away is not None:
        place, kind = coverage.turn_away
        lines.append(
            f"  Show next: turn it so that side {place + 1} ({facet_name(kind)}) points away from the cameras."
        )
    counts: Counter[str] = Counter()
    for mistake in coverage.mistakes:
        others = [name for name in mistake.recognised_as if name not in (coverage.label, "unknown")]
        what = f"could be {' or '.join(others)}" if others else "is not named"
        alone = facets_counted(mistake.facets, " and ")
        seen = f"Seen as {alone} alone" if len(mistake.facets) < 3 else "From some sides"
        counts[f"{seen}, it {what}"] += mistake.viewpoints
    for text, directions in list(counts.items())[:3]:
        count = f"{plural(directions, 'direction')} of {VIEWPOINTS}"
        lines.append(f"  {text} ({count}); a second look from another side decides.")
    return "\n".join(lines)


def describe_alike(pairs: Sequence[ConfusablePair]) -> str:
    """One line: the likeliest pairs of parts that could be confused, and the facets that both show."""
    described = [
        f"{' and '.join(two.labels)} seen as {facets_counted(two.facets, ' and ')} alone"
        f" ({plural(two.viewpoints, 'direction')} of {VIEWPOINTS})"
        for two in pairs[:MOST_ALIKE]
    ]
    if len(pairs) > MOST_ALIKE:
        described.append(f"{plural(len(pairs) - MOST_ALIKE, 'pair')} more, less likely")
    return f"Could be confused: {'; '.join(described)}. A second look from another side decides."


def coverage_json(coverage: ViewCoverage) -> dict[str, Any]:
    """The judgement as JSON values."""
    return {
        "sides": list(coverage.facets),
        "open_edges": coverage.open_edges,
        "unseen": round(coverage.unseen, 3),
        "named": round(coverage.named, 3),
        "mistakes": [
            {"taken_for": list(m.recognised_as), "facets": list(m.facets), "viewpoints": m.viewpoints}
            for m in coverage.mistakes
        ],
    }


def facets_shown(
    label: str,
    facets: Sequence[Facet],
    sides: list[int | None],
    without_number: tuple[Sequence[Facet], Sequence[Facet]],
    columns: int,
) -> str:
    """A sketch of the facets in view, numbered as the part's sides, with the lengths of their edges. without_number:
    facets that may be the part's but do not meet it, and those of other objects."""
    apart, foreign = without_number
    marks = ["?" if side is None else str(side + 1) for side in sides]
    outlines = [(f.left_px, "") for f in (*apart, *foreign)]
    outlines += [(facet.left_px, mark) for facet, mark in zip(facets, marks, strict=True)]
    rows: dict[str, list[str]] = {}
    for facet, mark in zip(facets, marks, strict=True):
        rows.setdefault(describe_facet(facet), []).append(mark)
    lines = [sketch(outlines, columns)]
    lines += [f"side {' '.join(sorted(numbers))}: {what}" for what, numbers in rows.items()]
    if foreign:
        lines.append(f"and {plural(len(foreign), 'facet')} of another object")
    if apart:
        lines.append(_describe_apart(label, len(apart)))
    return "\n".join(lines)


def _describe_apart(label: str, count: int) -> str:
    """The problem of a view in which facets of the part meet none of its other sides, and what to do."""
    meet, they_are, them = ("meets", "it is", "it") if count == 1 else ("meet", "they are", "them")
    return (
        f"{plural(count, 'facet')} {meet} none of these sides. If {they_are} the {label}'s, this view teaches little: "
        f"answer n, turn it a little until the edge between shows, and `teach` again. If not, take {them} away."
    )


def _other_name(seen: Look, label: str) -> str | None:
    """Another label that the model in use gives to the part in view."""
    names = [part.recognition.label for part in seen.scene.parts]
    others = [name for name in names if name not in (label, "unknown")]
    return others[0] if others and label not in names else None


def taught_line(note: dict[str, Any]) -> str:
    """A line about one teaching: when, what was shown, and by whom."""
    return f"{at_utc(str(note.get('taught', '')))} UTC  {_what_of(note)}, by {note.get('who', '?')}"


def _what_of(note: dict[str, Any]) -> str:
    groups: list[list[str]] = note.get("facets") or [[]]
    if ROUND in note:
        return f"walked round, {plural(len(groups[0]), 'facet')}"
    if "mesh" in note:
        return f"drawing {note['mesh']} in {note.get('unit', 'mm')}, {plural(len(groups[0]), 'facet')}"
    return ", ".join(sorted(groups, key=len)[-1]) or "?"


def _digest(context: CommandContext) -> str:
    return hashlib.sha256(read_file(context.config.calibration, LARGEST_BYTES)).hexdigest()


COMMANDS = (teach, untaught, views, forget)
