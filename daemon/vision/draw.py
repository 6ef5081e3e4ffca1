"""A look as a picture: both images side by side with outlines, corners, facets, types, labels and what was refused.

In: images and a Scene. Out: a BGR image. Nothing is decided here.
"""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from daemon.arrays import Array, Flags
from daemon.vision.image import as_grey
from daemon.vision.values import Facet, NearestGuess, Part, Scene

Picture = NDArray[np.uint8]
Colour = tuple[int, int, int]

SCALE = 2  # drawn this much larger than seen, so that lines do not hide what they mark
FONT = cv2.FONT_HERSHEY_SIMPLEX
OUTLINE: Colour = (150, 150, 60)
REFUSED: Colour = (60, 60, 220)
UNNAMED: Colour = (0, 165, 255)
SHOWS: Colour = (80, 220, 80)
SHOWS_NOT: Colour = (60, 60, 255)
NAMED: tuple[Colour, ...] = ((80, 220, 80), (240, 200, 60), (220, 110, 240), (90, 220, 240))
MARGIN = 26
MAX_NUMBERS = 12
DASH_PX = 4.0  # of the image as seen; an edge that does not show is dashed, for those who do not tell red from green


def draw_scene(left: NDArray[Any], right: NDArray[Any], scene: Scene) -> Picture:
    """(H, W, 3) uint8 BGR: left and right camera side by side, a legend above, notes and refusals with reasons
    below."""
    images = [_enlarged(left), _enlarged(right)]
    for picture, polygons, camera in zip(
        images, (scene.view.polygons_left, scene.view.polygons_right), ("left", "right"), strict=True
    ):
        for polygon in polygons:
            _closed(picture, polygon.corners_px, OUTLINE, 1)
        for number, refused in enumerate(scene.rejected, 1):
            if refused.camera == camera:
                _refusal(picture, refused.corners_px, number)
    for index, part in enumerate(scene.parts):
        _part(images, part, _colour(part, index))
    for guess in scene.guesses:
        _guess(images[0], guess.label, guess.left_px, guess.left_shows)
        _guess(images[1], guess.label, guess.right_px, guess.right_shows)
    return _framed(np.hstack(images), scene)


def _colour(part: Part, index: int) -> Colour:
    return NAMED[index % len(NAMED)] if part.named else UNNAMED


def _part(images: list[Picture], part: Part, colour: Colour) -> None:
    """Facets with type and corner numbers in both cameras; the name above the part."""
    for picture, corners in zip(images, ("left_px", "right_px"), strict=True):
        for facet in part.facets:
            _facet(picture, facet, getattr(facet, corners), colour)
        points = np.concatenate([getattr(f, corners) for f in part.facets])
        _name(picture, part, points, colour)


def _facet(picture: Picture, facet: Facet, corners: Array, colour: Colour) -> None:
    shade = picture.copy()
    cv2.fillPoly(shade, [_points(corners)], colour)
    cv2.addWeighted(shade, 0.18, picture, 0.82, 0, picture)
    _closed(picture, corners, colour, 2)
    for k, corner in enumerate(corners):
        cv2.circle(picture, _pixel(corner), 4, colour, -1, cv2.LINE_AA)
        inward = corner + 0.16 * (corners.mean(0) - corner)
        _text(picture, str(k), inward, colour, 0.4)
    _text(picture, facet.type.replace("_", " "), corners.mean(0), (255, 255, 255), 0.45)


def _name(picture: Picture, part: Part, points: Array, colour: Colour) -> None:
    named = part.recognition
    place = np.array([points[:, 0].mean(), points[:, 1].min() - 14])
    _text(picture, f"{named.label} {named.confidence:.2f}", place, colour, 0.6)
    if not part.named:
        under = "could be " + " or ".join(named.candidates) if named.candidates else ""
    else:
        under = f"ratio {named.match_ratio:.2f}, activation {named.activation:.3f}, {part.residual_mm:.2f} mm rms"
    if under:
        _text(picture, under, place + np.array([0, 8]), colour, 0.42)


def _refusal(picture: Picture, corners: Array, number: int) -> None:
    if len(corners) > 1:
        _closed(picture, corners, REFUSED, 1)
    _text(picture, f"x{number}", corners.mean(0), REFUSED, 0.42)


def _guess(picture: Picture, label: str, edges_px: Array, shows: Flags) -> None:
    """Edges (N, 2, 2) that speak for a guess are drawn through, those that speak against it dashed."""
    for (start, end), there in zip(edges_px, shows, strict=True):
        pieces = 1 if there else 2 * int(np.linalg.norm(end - start) / (2 * DASH_PX)) + 1
        at = np.linspace(start, end, pieces + 1)
        for a, b in zip(at[:-1:2], at[1::2], strict=True):
            cv2.line(picture, _pixel(a), _pixel(b), SHOWS if there else SHOWS_NOT, 2, cv2.LINE_AA)
    if len(edges_px):
        points = edges_px.reshape(-1, 2)
        _text(picture, f"{label}?", np.array([points[:, 0].mean(), points[:, 1].max() + 8]), UNNAMED, 0.6)


def _framed(body: Picture, scene: Scene) -> Picture:
    """The legend above; every part's reason, every note and refusal below."""
    seconds = "  ".join(f"{name} {1000 * s:.1f} ms" for name, s in scene.seconds.items())
    head = [
        (f"left | right   {len(scene.parts)} parts   noise {scene.view.noise_sigma:.1f}   {seconds}", (230, 230, 230))
    ]
    foot = [(f"{p.recognition.label}: {p.recognition.reason}", _colour(p, i)) for i, p in enumerate(scene.parts)]
    foot += [(_guess_line(g), UNNAMED) for g in scene.guesses]
    foot += [(note, (200, 200, 200)) for note in scene.notes if not _is_reason(note, scene)]
    foot += [(line, REFUSED) for line in _refusals(scene)]
    width = body.shape[1]
    return np.vstack([_lines(head, width), body, _lines(foot, width)])


def _guess_line(guess: NearestGuess) -> str:
    """Describe a guess in a line."""
    return f"nearest is {guess.label}: {guess.share:.0%} of its edges show (drawn through), the others do not (dashed)"


def _refusals(scene: Scene) -> list[str]:
    """Return one line a reason and camera, with the numbers of the candidates it was given for."""
    numbers: dict[str, list[str]] = {}
    for n, refused in enumerate(scene.rejected, 1):
        numbers.setdefault(f"{refused.camera}: {refused.reason}", []).append(f"x{n}")
    return [
        f"{' '.join(some[:MAX_NUMBERS])}{' ...' * (len(some) > MAX_NUMBERS)} {why}" for why, some in numbers.items()
    ]


def _is_reason(note: str, scene: Scene) -> bool:
    return any(note == f"{p.recognition.label}: {p.recognition.reason}" for p in scene.parts)


def _lines(lines: list[tuple[str, Colour]], width: int) -> Picture:
    strip = np.full((MARGIN * len(lines) + 8, width, 3), 24, np.uint8)
    for k, (text, colour) in enumerate(lines):
        cv2.putText(strip, text, (10, MARGIN * (k + 1) - 6), FONT, 0.52, colour, 1, cv2.LINE_AA)
    return strip


def _enlarged(image: NDArray[Any]) -> Picture:
    grey = as_grey(image)
    large = cv2.resize(grey, None, fx=SCALE, fy=SCALE, interpolation=cv2.INTER_LINEAR)
    return np.asarray(cv2.cvtColor(large, cv2.COLOR_GRAY2BGR), np.uint8)


def _closed(picture: Picture, corners: Array, colour: Colour, thickness: int) -> None:
    cv2.polylines(picture, [_points(corners)], True, colour, thickness, cv2.LINE_AA)


def _points(corners: Array) -> NDArray[np.int32]:
    return np.rint((corners + 0.5) * SCALE - 0.5).astype(np.int32)


def _pixel(corner: Array) -> tuple[int, int]:
    x, y = _points(corner[None])[0]
    return int(x), int(y)


def _text(picture: Picture, text: str, centre: Array, colour: Colour, size: float) -> None:
    """Text centred on a point (px of the image as seen), dark behind, kept inside the picture."""
    (width, height), _ = cv2.getTextSize(text, FONT, size, 1)
    x, y = _pixel(np.asarray(centre, float))
    x = int(np.clip(x - width // 2, 2, max(picture.shape[1] - width - 2, 2)))
    y = int(np.clip(y + height // 2, height + 2, picture.shape[0] - 4))
    box = picture[max(y - height - 3, 0) : y + 5, max(x - 3, 0) : x + width + 3]
    box[:] = (box * 0.35).astype(np.uint8)
    cv2.putText(picture, text, (x, y), FONT, size, colour, 1, cv2.LINE_AA)
