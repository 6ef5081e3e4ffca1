"""One look: a stereo pair in, a Scene out. The one entry that service, tool, replay and calibration use.

Pure; the clock is an argument. What the steps do is said where they live.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

from numpy.typing import NDArray

from daemon.vision.evidence import (
    all_accounted_for,
    hole_nats,
    named_by_edges,
    verified_names,
    without_overlaps,
)
from daemon.vision.facets import TablePlane, facets_of_images, round_facets, with_single_camera_outlines, without_table
from daemon.vision.geometry import StereoRig
from daemon.vision.health import ADVICE, Pictures, cause_of_nothing, depth_doubt, with_causes
from daemon.vision.hypotheses import prepare
from daemon.vision.image import StereoImages, open_stereo
from daemon.vision.model import FacetLibrary, Model, empty_model
from daemon.vision.recognition import Recognised, recognise_groups
from daemon.vision.refine import refined_parts
from daemon.vision.settings import VisionSettings
from daemon.vision.values import FacetView, NearestGuess, Part, Scene


def look(
    left: NDArray[Any],
    right: NDArray[Any],
    rig: StereoRig,
    model: Model | None = None,
    settings: VisionSettings | None = None,
    clock: Callable[[], float] | None = None,
    table: TablePlane | None = None,
) -> Scene:
    """See, name and locate everything in one stereo pair.

    left, right: images as find_facets takes them, of the size the rig was calibrated for. Without a model every part is
    `unknown`. With one, what both cameras outline comes first, with a brief effort; full-size pixels, where a taught
    part may be there and few edges are; and then straight edges, as the taught parts would show them, as far as the
    budget of time goes. clock: seconds of processor, for the budget and for Scene.seconds by stage; without it there is
    neither. What is made once a model is on no look's budget. table: where it is, for whoever knows; what lies in it is
    no part, and a part that lies on it is likelier. Raises VisionError where an image cannot be used.
    """
    now = clock or (lambda: 0.0)
    taught = model or empty_model(FacetLibrary(()))
    full = settings or VisionSettings()
    images = open_stereo(left, right, rig)
    if taught.labels:
        prepare(taught)
    began = now()
    coarse = by_facets = _recognise_by_facets(images, full.coarse() if taught.labels else full, taught, table, now)
    naming = coarse.seconds
    if _needs_fine_search(coarse.recognised) and images.uncluttered(full):
        fine = _recognise_by_facets(images, full.fine(), taught, table, now)
        by_facets = max(coarse, fine, key=lambda one: sum(r.named for r in one.recognised))
        naming += fine.seconds
    recognised, view = by_facets.recognised, by_facets.view
    seconds = {"facets": now() - began - naming, "recognise": naming}
    refines = full.corner_detector == "line_fit" and full.stereo_formula == "exact"
    start = now()
    recognised = verified = _refine_and_verify(recognised, (), (), taught, images) if refines else recognised
    seconds["refine"] = now() - start
    guesses, left_out, by_edges = tuple[NearestGuess, ...](), tuple[str, ...](), list[Recognised]()
    complete = bool(taught.labels) and all_accounted_for(recognised, view, taught, images)
    if not complete and not (taught.labels and any(view.outlines)):
        view = with_single_camera_outlines(view, images, by_facets.effort)
    if taught.labels and not complete:
        start = now()
        recognised, view = without_overlaps(recognised, view, (), taught, images)
        if not all_accounted_for(recognised, view, taught, images) and any(view.outlines):
            edge_result = named_by_edges(
                images,
                taught,
                recognised,
                lambda: (now() - began) / full.budget_s,
                table,
                lambda new: all_accounted_for(*without_overlaps(recognised, view, new, taught, images), taught, images),
            )
            if not edge_result.complete:
                view = with_single_camera_outlines(view, images, by_facets.effort)
            recognised, view = without_overlaps(recognised, view, edge_result.named, taught, images)
            guesses, left_out = edge_result.guesses, edge_result.left_out
            by_edges = edge_result.named
        seconds["edges"] = now() - start
    start = now()
    parts = tuple(r.part for r in recognised)
    if refines:
        refined = _refine_and_verify(recognised, verified, by_edges, taught, images)
        parts = tuple(one.part for one in refined)
    seconds["refine"] += now() - start
    pictures = images.left.grey, images.right.grey
    if taught.labels and not all(part.named for part in parts):
        parts = with_causes(parts, guesses, pictures)
    ended = f"the budget of {full.budget_s:g} s (vision: budget_s) ended this look"
    seen = _notes(view, parts, model, pictures)
    notes = (*view.notes, *seen, *(depth_doubt(guesses) if guesses else ()), *(f"{ended}: {what}" for what in left_out))
    return Scene(parts, view.rejected, view, notes, seconds if clock else {}, guesses)


def _refine_and_verify(
    recognised: tuple[Recognised, ...],
    verified: Sequence[Recognised],
    by_edges: Sequence[Recognised],
    taught: Model,
    images: StereoImages,
) -> tuple[Recognised, ...]:
    """Refine named parts to where their edges are, as those that edges named already are; remove the name of one that
    lacks too much of what it should show. What was verified before stays as it is."""
    new = [one for one in recognised if one not in verified]
    parts = refined_parts([one.part for one in new], taught, images, [one.part for one in by_edges])
    refined = [replace(one, part=part) for one, part in zip(new, parts, strict=True)]
    checked = dict(zip(new, verified_names(refined, taught, images), strict=True))
    return tuple(checked.get(one, one) for one in recognised)


class _FacetResult(NamedTuple):
    """What facets name, the facets, the effort by which they were found, and how long the naming took."""

    recognised: tuple[Recognised, ...]
    view: FacetView
    effort: VisionSettings
    seconds: float


def _recognise_by_facets(
    images: StereoImages, effort: VisionSettings, taught: Model, table: TablePlane | None, now: Callable[[], float]
) -> _FacetResult:
    """Recognise groups of facets found with some effort. Those with arcs are looked for where nothing is taught, to be
    taught: what is taught with arcs is named by its edges, with or without them."""
    all_facets = facets_of_images(images, effort, [] if taught.labels else round_facets(images, effort))
    start = now()
    view = all_facets if table is None else without_table(all_facets, table)
    holes = partial(hole_nats, images=images, tolerance_mm=taught.parameters.tolerance_mm)
    recognised = recognise_groups(view.groups, taught, holes)
    return _FacetResult(recognised, view, effort, now() - start)


def _needs_fine_search(recognised: tuple[Recognised, ...]) -> bool:
    """Whether something could be a taught part, if more of it were seen."""
    return any(r.part.recognition.candidates for r in recognised if not r.named)


def _notes(view: FacetView, parts: tuple[Part, ...], model: Model | None, pictures: Pictures) -> tuple[str, ...]:
    """Return notes for people besides the parts: why something is not named, or why nothing is seen."""
    if model is None or not model.labels:
        return ("nothing was taught yet: every part is unknown",) if parts else ()
    silent = tuple(f"{p.recognition.label}: {p.recognition.reason}" for p in parts if not p.named)
    left, right = view.outlines
    if not parts:
        cause = cause_of_nothing(pictures)
        outlined = (f"no facet was found in both images ({left} and {right} outlines)",) if left or right else ()
        return (*outlined, *((f"{ADVICE[cause].words}; {ADVICE[cause].remedy}",) if cause else ()))
    return silent
