"""Command `teach LABEL --around`: questions, report and storing. daemon/pick/around.py plans the looks."""

import numpy as np

from daemon.arm import RefusedError
from daemon.commands.step_mode import with_questions
from daemon.console.context import CommandContext
from daemon.console.interpreter import CommandResult, Frontend, yes_or_no
from daemon.console.phrases import plural
from daemon.errors import CommandError
from daemon.events.records import Json
from daemon.pick.around import SECONDS_A_PLACE, CircledPart, NoSinglePartError
from daemon.pick.fused_objects import look_facets
from daemon.pick.looks import Look
from daemon.pick.recogniser import ModelRecogniser
from daemon.pick.settings import Settings
from daemon.store.model_store import StoredView
from daemon.teaching.part_from_looks import Deviation, LearntPart, deviations, learn_from_looks
from daemon.vision.facets import fuse
from daemon.vision.geometry import Polyhedron, measure
from daemon.vision.model import FacetLibrary, TeachError, empty_model, facet_name

USAGE = "teach LABEL --around [6..12]"


async def learn_around(context: CommandContext, label: str, count: int, frontend: Frontend) -> LearntPart | None:
    """Ask, move round the part, fuse the looks and report; None where the operator declines. Raises CommandError."""
    seconds = count * SECONDS_A_PLACE * (1.0 if context.hardware.cameras.alone is None else 2.0)
    text = f"The arm moves to {count} places around the {label}, 300 mm from it: about {seconds:.0f} s"
    if frontend.asks and not await yes_or_no(frontend, f"{text}; control-C stops it. Move the arm? [y/n]"):
        return None
    trainer = context.trainer
    sight = ModelRecogniser(empty_model(trainer.library), trainer.rig, trainer.settings)
    try:
        thing, looks = await with_questions(context, context.cycle.walk_round(sight, count, frontend.say), frontend)
    except NoSinglePartError as error:
        raise CommandError(f"teach {label}: {error}") from None
    if context.cycle.supervisor.mover.dry:
        raise RefusedError(f"dry: {plural(count, 'place')} planned; a dry run learns nothing: `dry off`, then repeat")
    try:
        part = await context.worker(_fused_part, thing, looks, context.cycle.settings, trainer.library)
    except TeachError as error:
        raise CommandError(f"teach {label}: {error}") from None
    await frontend.say("\n".join(_part_lines(part, len(looks))))
    return part


def _fused_part(thing: CircledPart, looks: list[Look], settings: Settings, library: FacetLibrary) -> LearntPart:
    """The part that the looks together show. Raises TeachError."""
    doubt, table_z_mm = settings.doubt, settings.limits.table_z_mm
    seen = [look_facets(look, thing.groups_in(look), doubt) for look in looks]
    return learn_from_looks(fuse(seen, doubt.shared(), table_z_mm), table_z_mm, library)


def deviations_from_drawing(part: LearntPart, drawn: Polyhedron | None) -> tuple[list[str], list[Json | None]]:
    """The deviation of each side from the drawing, as text and as JSON values; empty without a drawing."""
    if drawn is None:
        return [], []
    compared = deviations(part.solid, drawn)
    matched = [one for one in compared if one is not None]
    if not matched:
        return ["It does not fit its drawing. Check that it is this part."], [None] * len(compared)
    worst = max(one.off_mm for one in matched)
    lines = [f"Compared with its drawing: {plural(len(matched), 'side')} matched, corners at most {worst:.2f} mm off."]
    for k, one in enumerate(compared):
        if one is None:
            lines.append(f"  side {k + 1}: not in the drawing")
            continue
        lines.append(
            f"  side {k + 1}: {one.off_mm:.2f} mm; lengths within {one.length_mm:.2f} mm, "
            f"angles within {one.angle_deg:.2f} degrees"
        )
    return lines, [None if one is None else _json(one) for one in compared]


def _json(one: Deviation) -> Json:
    rounded = {name: round(float(value), 4) for name, value in vars(one).items()}
    return {**rounded, "facet": one.facet}


def _part_lines(part: LearntPart, looks: int) -> list[str]:
    """The learnt part as text: each side, and what was never seen."""
    solid = part.solid
    closed = "" if solid.open_edges else ", closed"
    lines = [
        f"From {plural(looks, 'place')}: {plural(len(solid.facets), 'side')}{closed}, "
        f"corners known to {part.sigma_mm:.2f} mm."
    ]
    for k, (ring, kind, places) in enumerate(zip(solid.rings, solid.types, part.looks, strict=True)):
        sides = measure(solid.corners_mm[ring]).sides
        lengths = " ".join(f"{mm:.1f}" for mm in sides)
        lines.append(f"  side {k + 1}: {facet_name(kind)} {lengths} mm, seen from {plural(places, 'place')}")
    if part.table_edges:
        lines.append(f"Not seen: the side it lies on ({plural(part.table_edges, 'edge')} end at the table).")
    for k, count in part.open_edges:
        lines.append(f"Not seen: what is beyond {plural(count, 'edge')} of side {k + 1}.")
    if part.left_out:
        lines.append(f"Left out: {plural(part.left_out, 'side')} not seen well enough, or shadows.")
    if solid.open_edges:
        lines.append("To learn all sides: turn it over and repeat.")
    return lines


def stored_result(view: StoredView, part: LearntPart, lines: list[str], data: Json) -> CommandResult:
    """The result of `teach --around` once the part is stored."""
    text = [f"Stored as {view.name}: {plural(len(part.solid.facets), 'side')}; as STL in {view.mesh}.", *lines]
    values = {
        "kept": True,
        "view": view.name,
        "stl": str(view.mesh),
        "facets": list(part.solid.types),
        "looks": list(part.looks),
        "at_table": part.table_edges,
        "open_edges": {str(k + 1): n for k, n in part.open_edges},
        "sigma_mm": round(part.sigma_mm, 4),
        "corners_mm": np.round(part.solid.corners_mm, 3).tolist(),
        "rings": [list(ring) for ring in part.solid.facets],
        **data,
    }
    return CommandResult("\n".join(text), values)
