"""The table as both eyes see it, where it has a pattern: the plane that most of the picture lies in.

In: eyes. Out: a Table, or none. A coarse disparity image by blocks (Konolige 1997, OpenCV's StereoBM) on rectified
pictures; a plane in space is a plane there as well, found by random samples (Fischler and Bolles 1981), fitted to what
lies in it, and moved until both pictures agree in it (Lucas and Kanade 1981). What stands on the table is nearer, so
that nothing may lie beyond it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from daemon.arrays import Array
from daemon.vision.facets.table import Table
from daemon.vision.geometry import Baseline, Eye
from daemon.vision.image import Eyes, OneEye
from daemon.vision.settings import VisionSettings

COLUMNS = 213
"""How many the coarse pictures have, about."""
OVERLAP = 0.62
"""The largest disparity, as a share of the picture's width: nearer things are in one eye only."""
BLOCK_PX, TEXTURE, UNIQUE = 11, 110, 12
"""Of the matching by blocks: their side; the least slope in one; by how many per cent the second best is worse."""
SAMPLED, TRIES = 1500, 120
"""Matches a plane is sought in, and how many planes through three of them."""
ON_PLANE_PX, REFINED = 0.35, 3
"""How near its disparity is to the plane's where a match lies in it; how often the plane is fitted again."""
COMPARED, COMPARISONS, ALIKE = 3000, 4, 4.0
"""Places in the plane in which both pictures are compared, how often, and so many times the usual difference, at which
one counts no more."""
EVERY = 8
"""Where every so manieth pixel of the coarse pictures is taken from is reckoned through the lenses; those between lie
evenly between, to a tenth of a pixel."""
STEPS, ROUNDED_UP = 16, 7.5 / 256
"""Of a disparity's unit in OpenCV's answer; which is rounded up to them, by so much on average."""
FEWEST, LEAST_AREA_PX2 = 400, 1000.0
"""Matches, without which there is no plane; twice the area of three that are worth one."""
CELLS = (10, 8)
LEAST_MATCHED, LEAST_CELLS, MOST_BEYOND = 0.1, 0.35, 0.15
"""A cell of the picture lies in the plane where so large a share of it does; so many of the cells must, and at most so
many of the matches may lie beyond it."""
LEAST_ON_EDGES = 0.02
"""Of a cell that has anything to match: what one line across a part of it leaves. Where a plane was found in the
rendered scenes, 99 in 100 cells had five times as much."""


@dataclass(frozen=True, eq=False)
class Rectified:
    """Where coarse rectified pictures of both eyes take their pixels from, x and y (2, H, W) px each; their pixels per
    unit of the ideal coordinates, and these at the first pixel (2,); the least disparity that is sought, and how many;
    the first column of the left eye's own picture, further left there is room for the right one's.
    """

    left: NDArray[np.float32]
    right: NDArray[np.float32]
    per_unit: float
    first: Array
    least: int
    count: int
    margin: int

    def ideal(self, points: Array) -> Array:
        """(N, 2) columns and rows -> ideal coordinates."""
        return np.asarray(points / self.per_unit + self.first)


@lru_cache(maxsize=4)
def rectified(geometry: Baseline, columns: int, rows: int) -> Rectified:
    """For pictures of so many columns and rows."""
    border = np.array([[x, y] for x in (0, columns / 2, columns - 1) for y in (0, rows / 2, rows - 1)])
    left, right = (eye.ideal(border) for eye in (geometry.left, geometry.right))
    per_unit = geometry.left.focal_px * COLUMNS / columns
    (low, top), (high, bottom) = left.min(0), left.max(0)
    middle, most = left[4, 0] - right[4, 0], OVERLAP * (high - low)
    least = max(int(per_unit * (middle - most)), 1)
    count = 16 * int(np.ceil((per_unit * (middle + most) - least) / 16))
    margin = least + count + BLOCK_PX
    first = np.array([low - margin / per_unit, top])
    wide, tall = int(per_unit * (high - low)) + margin, int(per_unit * (bottom - top))
    from_left, from_right = (_taken_from(eye, wide, tall, per_unit, first) for eye in (geometry.left, geometry.right))
    return Rectified(from_left, from_right, per_unit, first, least, count, margin)


def _taken_from(eye: Eye, wide: int, tall: int, per_unit: float, first: Array) -> NDArray[np.float32]:
    """(2, tall, wide) px of an eye's own picture, x and y. An arm that moves one eye makes a new rig of every look."""
    columns, rows = ((np.arange(-1, most // EVERY + 2) + 0.5) * EVERY - 0.5 for most in (wide, tall))
    few = eye.pixels(np.stack(np.meshgrid(columns, rows), 2).reshape(-1, 2) / per_unit + first)
    many = cv2.resize(few.reshape(len(rows), len(columns), 2), None, fx=EVERY, fy=EVERY, interpolation=cv2.INTER_LINEAR)
    return np.ascontiguousarray(many[EVERY : EVERY + tall, EVERY : EVERY + wide].transpose(2, 0, 1), np.float32)


def seen_table(eyes: Eyes) -> Table | None:
    """The plane that most of both pictures shows, if there is one."""
    if _plain(eyes.left):
        return None
    tall, wide = eyes.left.grey.shape
    canvas = rectified(eyes.geometry, wide, tall)
    pictures = _pictures(eyes, canvas)
    disparities = _disparities(pictures, canvas)
    rows, columns = np.nonzero(disparities > canvas.least)
    own, places = disparities[rows, columns], np.stack([columns, rows, np.ones(len(rows))], 1, dtype=float)
    plane = _plane(places, own)
    if plane is None:
        return None
    plane = _compared(plane, places[np.abs(places @ plane - own) < ON_PLANE_PX], pictures, canvas)
    y, x = np.mgrid[: disparities.shape[0], : disparities.shape[1]]
    beyond = plane[0] * x + plane[1] * y + plane[2] - disparities
    matched = disparities > canvas.least
    lies = matched & (np.abs(beyond) < 2 * ON_PLANE_PX)
    shares = cv2.resize(lies.astype(np.float32), CELLS, interpolation=cv2.INTER_AREA)
    if (shares > LEAST_MATCHED).mean() < LEAST_CELLS or (beyond[matched] > 4 * ON_PLANE_PX).mean() > MOST_BEYOND:
        return None
    return _table(plane, canvas, eyes.geometry, (len(lies), lies.shape[1]))


def _plain(view: OneEye) -> bool:
    """Whether too few cells of a picture show any edges for a plane to lie in them."""
    scale = view.scale(2)
    edges = (scale.strength >= VisionSettings.faintest * scale.sigma).astype(np.float32)
    return bool((cv2.resize(edges, CELLS, interpolation=cv2.INTER_AREA) > LEAST_ON_EDGES).mean() < LEAST_CELLS)


def _pictures(eyes: Eyes, canvas: Rectified) -> tuple[NDArray[Any], NDArray[Any]]:
    """Coarse rectified pictures of both eyes."""
    shrink = eyes.geometry.left.focal_px / canvas.per_unit
    left, right = (
        cv2.remap(cv2.GaussianBlur(view.grey, (0, 0), 0.5 * shrink), where[0], where[1], cv2.INTER_LINEAR)
        for view, where in zip(eyes.views, (canvas.left, canvas.right), strict=True)
    )
    return left, right


def _disparities(pictures: tuple[NDArray[Any], NDArray[Any]], canvas: Rectified) -> NDArray[np.float32]:
    """(H, W) px of the coarse left picture; where nothing is matched, less than the least."""
    matcher = cv2.StereoBM.create(canvas.count, BLOCK_PX)
    matcher.setMinDisparity(canvas.least)
    matcher.setTextureThreshold(TEXTURE)
    matcher.setUniquenessRatio(UNIQUE)
    matcher.setPreFilterType(cv2.STEREO_BM_PREFILTER_XSOBEL)
    found = matcher.compute(*pictures)[:, canvas.margin :]
    return np.asarray(found / STEPS - ROUNDED_UP, np.float32)


def _plane(places: Array, disparities: NDArray[np.float32]) -> Array | None:
    """(3,) the plane, disparity = plane . (column, row, 1), in which most of places (N, 3) lie and few beyond."""
    if len(places) < FEWEST:
        return None
    some = np.linspace(0, len(places) - 1, SAMPLED).astype(int)
    few, own = places[some], disparities[some]
    three = np.random.default_rng(0).integers(0, SAMPLED, (TRIES, 3))  # the same planes for the same pictures
    three = three[np.abs(np.linalg.det(few[three])) > LEAST_AREA_PX2]
    if not len(three):
        return None
    planes = np.linalg.solve(few[three], own[three][..., None])[..., 0]
    beyond = planes @ few.T - own
    votes = (np.abs(beyond) < ON_PLANE_PX).sum(1) - 2 * (beyond > 4 * ON_PLANE_PX).sum(1)
    plane = planes[votes.argmax()]
    for _ in range(REFINED):
        near = np.abs(few @ plane - own) < ON_PLANE_PX
        if near.sum() < FEWEST / 10:
            return None
        plane = np.linalg.lstsq(few[near], own[near], rcond=None)[0]
    return np.asarray(plane)


def _compared(plane: Array, places: Array, pictures: tuple[NDArray[Any], NDArray[Any]], canvas: Rectified) -> Array:
    """The plane (3,), moved until the slopes along the baseline agree in both pictures at places (N, 3) in it: blocks
    are matched to a tenth of a pixel or so, each for itself."""
    left, right = (cv2.Sobel(one, cv2.CV_32F, 1, 0, scale=1 / 8) for one in pictures)
    further = cv2.Sobel(right, cv2.CV_32F, 1, 0, scale=1 / 8)
    few = places[np.linspace(0, len(places) - 1, min(len(places), COMPARED)).astype(int)]
    columns, rows = few[:, 0] + canvas.margin, few[None, :, 1].astype(np.float32)
    own = left[few[:, 1].astype(int), columns.astype(int)]
    answer = np.array([*plane, 1.0])  # with how much more contrast the left eye has
    for _ in range(COMPARISONS):
        at = (columns - few @ answer[:3]).astype(np.float32)[None]
        there, slope = (cv2.remap(one, at, rows, cv2.INTER_CUBIC)[0] for one in (right, further))
        off = own - answer[3] * there
        design = np.concatenate([-answer[3] * slope[:, None] * few, there[:, None]], 1)
        usual = 1.4826 * float(np.median(np.abs(off))) + 1e-3
        pull = (design * (np.maximum(1 - (off / (ALIKE * usual)) ** 2, 0.0) ** 2)[:, None]).T
        answer = answer + np.linalg.lstsq(pull @ design, pull @ off, rcond=None)[0]
    return answer[:3]


def _table(plane: Array, canvas: Rectified, geometry: Baseline, shape: tuple[int, int]) -> Table:
    """A plane of disparities as it lies in space."""
    tall, wide = shape
    places = np.array([[canvas.margin, 0], [canvas.margin + wide, 0], [canvas.margin + wide / 2, tall]], float)
    there = places.copy()
    there[:, 0] -= (places - [canvas.margin, 0]) @ plane[:2] + plane[2]
    a, b, c = geometry.points(canvas.ideal(places), canvas.ideal(there))
    up = np.cross(b - a, c - a)
    up *= -np.sign(up @ (a + b + c)) / np.linalg.norm(up)
    return Table(up, float(up @ (a + b + c)) / 3)
