"""A look as plain JSON values, for the run log, the console and `facetctl recognise`.

In: a Scene. Out: dicts, lists, numbers, words. Lengths in mm (cyclopean frame), images in px; nothing is decided here.
"""

from typing import Any

import numpy as np

from daemon.arrays import Array
from daemon.vision.values import Facet, NearestGuess, Part, Rejected, Scene


def scene_json(scene: Scene) -> dict[str, Any]:
    """{ms, parts, notes, ...}: the parts nearest first. ms is the whole look's, None where it was not timed."""
    return {
        "ms": round(1000.0 * sum(scene.seconds.values()), 3) if scene.seconds else None,
        "stages_ms": {name: round(1000.0 * s, 3) for name, s in scene.seconds.items()},
        "parts": [part_json(p) for p in scene.parts],
        "notes": list(scene.notes),
        "rejected": [_rejected_json(r) for r in scene.rejected],
        "guesses": [_guess_json(g) for g in scene.guesses],
        "noise_sigma": _number(scene.view.noise_sigma, 3),
    }


def part_json(part: Part) -> dict[str, Any]:
    """Return one part as JSON values; corners_mm are the most likely ones, measured_mm what was triangulated."""
    named = part.recognition
    fitted = part.fitted_mm or tuple(f.corners_mm for f in part.facets)
    return {
        "label": named.label,
        "confidence": _number(named.confidence, 5),
        "match_ratio": _number(named.match_ratio, 4),
        "activation": _number(named.activation, 5),
        "runner_up": named.runner_up,
        "ambiguous": named.ambiguous,
        "candidates": list(named.candidates),
        "reason": named.reason,
        "cause": named.cause,
        "cyclopean_from_part": _numbers(part.cyclopean_from_part, 6),
        "covariance": [[float(f"{v:.6g}") for v in row] for row in part.covariance],
        "equivalents": [_numbers(e, 6) for e in part.equivalents],
        "residual_mm": _number(part.residual_mm, 4),
        "facets": [_facet_json(f, c) for f, c in zip(part.facets, fitted, strict=True)],
    }


def _facet_json(facet: Facet, corners_mm: Array) -> dict[str, Any]:
    return {
        "type": facet.type,
        "corners_mm": _numbers(corners_mm, 4),
        "measured_mm": _numbers(facet.corners_mm, 4),
        "sigma_mm": _numbers(np.sqrt(np.trace(facet.covariance_mm2, axis1=1, axis2=2)), 4),
        "planarity_mm": _number(facet.planarity_mm, 4),
        "left_px": _numbers(facet.left_px, 3),
        "right_px": _numbers(facet.right_px, 3),
        "epipolar_px": _numbers(facet.epipolar_px, 4),
    }


def _rejected_json(rejected: Rejected) -> dict[str, Any]:
    return {"eye": rejected.camera, "reason": rejected.reason, "corners_px": _numbers(rejected.corners_px, 2)}


def _guess_json(guess: NearestGuess) -> dict[str, Any]:
    """left_px, right_px: a row an edge, the x and y of its two ends."""
    return {
        "label": guess.label,
        "share": _number(guess.share, 3),
        "left_px": _numbers(guess.left_px.reshape(-1, 4), 1),
        "right_px": _numbers(guess.right_px.reshape(-1, 4), 1),
        "left_shows": guess.left_shows.tolist(),
        "right_shows": guess.right_shows.tolist(),
    }


def _number(value: float, digits: int) -> float | None:
    """Rounded; None where it is not a number, because JSON has no word for that."""
    return round(float(value), digits) if np.isfinite(value) else None


def _numbers(values: Array, digits: int) -> Any:
    rounded = np.round(np.asarray(values, float), digits) + 0.0
    listed = rounded.astype(object)
    listed[~np.isfinite(rounded)] = None
    return listed.tolist()
