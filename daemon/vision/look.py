"""One look: a stereo pair in, a Scene out. The one entry that service, tool, replay and calibration use.

Pure; the clock is an argument. What the steps do is said where they live.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Any

from numpy.typing import NDArray

from daemon.vision.facets import Table, facets_seen, without_table
from daemon.vision.geometry import StereoRig
from daemon.vision.image import open_eyes
from daemon.vision.model import FacetLibrary, Model, empty_model
from daemon.vision.recognition import Recognised, recognise
from daemon.vision.registration import sharpened, verify
from daemon.vision.settings import VisionSettings
from daemon.vision.values import FacetView, Part, Scene


def look(
    left: NDArray[Any],
    right: NDArray[Any],
    rig: StereoRig,
    model: Model | None = None,
    settings: VisionSettings | None = None,
    clock: Callable[[], float] | None = None,
    table: Table | None = None,
) -> Scene:
    """See, name and locate everything in one stereo pair.

    left, right: images as find_facets takes them, of the size the rig was calibrated for. Without a model every part is
    `unknown`. With one, a brief attempt comes first; what it leaves unnamed is looked for with all that the settings
    say, and then from what the taught parts would show. clock: seconds, for Scene.seconds by stage; without it the
    stages are not timed. table: where it is, for whoever knows; what lies in it is no part.
    Raises VisionError where an image cannot be used.
    """
    now = clock or _no_clock
    known = model or empty_model(FacetLibrary(()))
    full = settings or VisionSettings()
    eyes = open_eyes(left, right, rig)
    seconds = {"facets": 0.0, "recognise": 0.0}
    for effort in (full.brief(), full) if known.labels else (full,):
        start = now()
        view = facets_seen(eyes, effort, briefly=effort is not full)
        if table is not None:
            view = without_table(view, table)
        seen = now()
        found = recognise(view.groups, known)
        seconds["facets"] += seen - start
        seconds["recognise"] += now() - seen
        if _all_named(found):
            break
    if known.labels and not _all_named(found) and (view.groups or view.rejected):
        start = now()
        found, view = verify(found, view, known, eyes)
        seconds["closer"] = now() - start
    parts = tuple(r.part for r in found)
    if full.corner_detector == "line_fit" and full.stereo_formula == "exact":
        start = now()
        parts = sharpened(parts, known, eyes)
        seconds["sharpen"] = now() - start
    notes = (*view.notes, *_notes(view, parts, model))
    return Scene(parts, view.rejected, view, notes, seconds if clock else {})


def _all_named(found: tuple[Recognised, ...]) -> bool:
    return bool(found) and all(r.named for r in found)


def _no_clock() -> float:
    return 0.0


def _notes(view: FacetView, parts: tuple[Part, ...], model: Model | None) -> tuple[str, ...]:
    """What a person should know besides the parts: why something is not named, or why nothing is seen."""
    if model is None or not model.labels:
        return ("nothing was taught yet: every part is unknown",) if parts else ()
    silent = tuple(f"{p.recognition.label}: {p.recognition.reason}" for p in parts if not p.named)
    left, right = outlines(view)
    if not parts and (left or right):
        return (f"no facet was found in both images ({left} and {right} outlines)",)
    return silent


def outlines(view: FacetView) -> tuple[int, int]:
    """How many outlines the left and the right eye show, used or refused."""
    refused = Counter(r.eye for r in view.rejected)
    return len(view.polygons_left) + refused["left"], len(view.polygons_right) + refused["right"]
