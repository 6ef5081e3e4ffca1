"""The table as both cameras see it, where it has a pattern: the plane that most of the picture lies in.

In: both pictures. Out: a TablePlane, or none. A coarse disparity image by blocks (Konolige 1997, OpenCV's StereoBM)
on rectified pictures; a plane in space is a plane there as well, found by random samples (Fischler and Bolles 1981),
fitted to what lies in it, and moved until both pictures agree in it (Lucas and Kanade 1981). What stands on the table
is nearer, so that nothing may lie beyond it.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from daemon.arrays import Array, Flags
from daemon.vision.facets.table_plane import TablePlane
from daemon.vision.geometry import Baseline, RectifiedCamera, robust_weight, solve
from daemon.vision.image import CameraImage, StereoImages
from daemon.vision.settings import VisionSettings

COLUMNS = 213
"""Number of columns of the coarse pictures, about."""
OVERLAP = 0.62
"""The largest disparity, as a share of the picture's width: nearer things are in one camera only."""
SLANTS = (0.1, 0.35)
"""By how much disparity grows from row to row where blocks are matched as they are, the second for what the first does
not find: cameras that are held upright see a table so, the more the flatter they look. Where it is known how they see
it, the nearest of these, either way, is all that is tried."""
BLOCK_PX, TEXTURE, UNIQUE = 11, 110, 12
"""Parameters of the block matching: side of a block, px; least slope in one; per cent by which the second best is
worse."""
SAMPLED, TRIES = 1500, 120
"""Matches a plane is sought in, and how many planes through three of them."""
ON_PLANE_PX, REFINED = 0.35, 3
"""Largest distance, px, of a match's disparity from the plane's for it to lie in it; number of times the plane is
fitted again."""
COMPARED, COMPARISONS = 3000, 4
"""Places in the plane in which both pictures are compared, and how often."""
EVERY = 8
"""Spacing, px, of the pixels of the coarse pictures whose place is computed through the lenses; those between are
interpolated, to a tenth of a pixel."""
STEPS, ROUNDED_UP = 16, 7.5 / 256
"""Steps of a px in OpenCV's disparities; and by how much these are rounded up on average."""
WORTH_ANOTHER = 0.3
"""Share of a picture that is matched, in a plane or not, without which another slant shows no more."""
FEWEST, MIN_AREA_PX2 = 400, 1000.0
"""Matches, without which there is no plane; twice the area of three that are worth one."""
CELLS = (10, 8)
MIN_MATCHED, IN_BOTH = 0.1, 0.5
"""A cell of the picture lies in the plane where so large a share of it does, and is in both pictures where so large a
share would be."""
MIN_CELL_SHARE, MIN_CELLS, MIN_AROUND = 0.2, 20, 0.5
"""Of the cells in both pictures, which should be so many, such a share must lie in the table; with those between them
they fill so much of the picture, as no part's face does."""
MAX_BEYOND, ALL = 0.3, 8.0
"""Of a cell lies all beyond the plane if so many times more does than lies in it, for a pattern that repeats itself is
matched here and there; and for every cell in the plane no more than so much of one may lie beyond."""
MIN_ON_EDGES = 0.02
"""Of a cell that has anything to match: what one line across a part of it leaves. Where a plane was found in the
rendered scenes, 99 in 100 cells had five times as much."""


@dataclass(frozen=True, eq=False)
class Rectified:
    """Where coarse rectified pictures of both cameras take their pixels from, x and y (2, H, W) px each; their pixels
    per unit of the ideal coordinates, and these at the first pixel (2,); the least disparity that is sought, and how
    many; the first column of the left camera's own picture, further left there is room for the right one's; base (3,):
    the plane of disparities that all others are counted from, base . (column, row, 1); and between which columns the
    right picture shows anything where that is nought.
    """

    left: NDArray[np.float32]
    right: NDArray[np.float32]
    per_unit: float
    first: Array
    least: int
    count: int
    margin: int
    base: Array
    shown: tuple[float, float]

    def ideal(self, points: Array) -> Array:
        """(N, 2) columns and rows -> ideal coordinates."""
        return np.asarray(points / self.per_unit + self.first)

    def in_both(self, places: Array) -> tuple[Array, Array]:
        """(N,), (N,) between which disparities what the left picture has at places (N, 3) is in the right one as
        well."""
        own = places[:, 0] + self.margin - places @ self.base
        return own - self.shown[1], own - self.shown[0]


@lru_cache(maxsize=4)
def rectified(geometry: Baseline, columns: int, rows: int, slant: float) -> Rectified:
    """Return the rectification for pictures of so many columns and rows, and a table that is seen at about such a
    slant."""
    border = np.array([[x, y] for x in (0, columns / 2, columns - 1) for y in (0, rows / 2, rows - 1)])
    left, right = (camera.ideal(border) for camera in (geometry.left, geometry.right))
    per_unit = geometry.left.focal_px * COLUMNS / columns
    (low, top), (high, bottom) = left.min(0), left.max(0)
    middle, most = left[4, 0] - right[4, 0], OVERLAP * (high - low)
    least = max(int(per_unit * (middle - most)), 1)
    count = 16 * int(np.ceil((per_unit * (middle + most) - least) / 16))
    margin = least + count + BLOCK_PX
    first = np.array([low - margin / per_unit, top])
    wide, tall = int(per_unit * (high - low)) + margin, int(per_unit * (bottom - top))
    base = slant * np.array([0.0, 1.0, -tall / 2])
    from_left = _taken_from(geometry.left, wide, tall, per_unit, first, np.zeros(3))
    from_right = _taken_from(geometry.right, wide, tall, per_unit, first, base)
    shown = (right[:, 0].min() - first[0]) * per_unit, (right[:, 0].max() - first[0]) * per_unit
    return Rectified(from_left, from_right, per_unit, first, least, count, margin, base, shown)


def _taken_from(
    camera: RectifiedCamera, wide: int, tall: int, per_unit: float, first: Array, base: Array
) -> NDArray[np.float32]:
    """(2, tall, wide) px of a camera's own picture, x and y, all moved to the right by what base (3,) says. An arm that
    moves one camera makes a new rig of every look."""
    columns, rows = ((np.arange(-1, most // EVERY + 2) + 0.5) * EVERY - 0.5 for most in (wide, tall))
    places = np.stack(np.meshgrid(columns, rows), 2).reshape(-1, 2)
    places[:, 0] -= places @ base[:2] + base[2]
    few = camera.pixels(places / per_unit + first)
    many = cv2.resize(few.reshape(len(rows), len(columns), 2), None, fx=EVERY, fy=EVERY, interpolation=cv2.INTER_LINEAR)
    return np.ascontiguousarray(many[EVERY : EVERY + tall, EVERY : EVERY + wide].transpose(2, 0, 1), np.float32)


def estimate_table(images: StereoImages, table: TablePlane | None = None) -> TablePlane | None:
    """The plane that most of both pictures shows, if there is one. known: about as it should lie; unless the cameras
    are upright it is not seen without that where it is steep in them."""
    if _plain(images.left):
        return None
    tall, wide = images.left.grey.shape
    for slant in SLANTS if table is None else (_slant(table, images.geometry),):
        canvas = rectified(images.geometry, wide, tall, slant)
        pictures = _pictures(images, canvas)
        disparities = _disparities(pictures, canvas)
        table = _table_of(disparities, pictures, images.geometry, canvas)
        if table is not None or (disparities > canvas.least).mean() < WORTH_ANOTHER:
            return table
    return None


def _slant(table: TablePlane, geometry: Baseline) -> float:
    """The one of SLANTS, either way, that is nearest to a table's."""
    up = table.up @ geometry.cyclopean_from_baseline
    height_mm = max(float(table.up @ geometry.middle_mm) - table.level_mm, 1.0)
    own = -geometry.length_mm * float(up[1]) / height_mm
    return float(np.copysign(min(SLANTS, key=lambda slant: abs(slant - abs(own))), own))


def _table_of(
    disparities: NDArray[np.float32], pictures: tuple[NDArray[Any], NDArray[Any]], geometry: Baseline, canvas: Rectified
) -> TablePlane | None:
    """The plane that most of the disparities (H, W) lie in, as both pictures have it."""
    every, own = coarse_places(disparities.shape), disparities.ravel()
    matched = own > canvas.least
    places = every[matched]
    plane = plane_of_most(places, own[matched], canvas)
    if plane is None:
        return None
    plane = _compared(plane, places[np.abs(places @ plane - own[matched]) < ON_PLANE_PX], pictures, canvas)
    there = every @ plane
    low, high = canvas.in_both(every)
    in_both = (there > low) & (there < high)
    beyond = np.where(matched & in_both, there - own, np.nan)
    lies, farther, both = (
        cv2.resize(each.reshape(disparities.shape).astype(np.float32), CELLS, interpolation=cv2.INTER_AREA)
        for each in (np.abs(beyond) < 2 * ON_PLANE_PX, beyond > 4 * ON_PLANE_PX, in_both)
    )
    least = MIN_MATCHED * both
    if not _most_of_it((lies > least) & (lies > farther), (farther > least) & (farther > ALL * lies), both > IN_BOTH):
        return None
    return _in_space(plane + canvas.base, canvas, geometry, disparities.shape)


@lru_cache(maxsize=4)
def coarse_places(shape: tuple[int, int]) -> Array:
    """(N, 3) column, row and 1 of every pixel of a coarse picture."""
    row, column = np.indices(shape).reshape(2, -1)
    return np.stack([column, row, np.ones_like(row)], 1).astype(float)


def _most_of_it(lies: Flags, farther: Flags, in_both: Flags) -> bool:
    """Whether cells (rows, columns) that lie in a plane, those of which all lies beyond it, and those that both cameras
    would see, make it the table."""
    if lies.sum() < MIN_CELL_SHARE * max(in_both.sum(), MIN_CELLS) or farther.sum() > MAX_BEYOND * lies.sum():
        return False
    around = cv2.convexHull(np.argwhere(lies).astype(np.float32))
    return bool(cv2.contourArea(around) > MIN_AROUND * np.prod(np.subtract(lies.shape, 1)))


def _plain(view: CameraImage) -> bool:
    """Whether too few cells of a picture show any edges for a plane to lie in them."""
    scale = view.scale(2)
    edges = (scale.strength >= VisionSettings.faintest * scale.sigma).astype(np.float32)
    return bool((cv2.resize(edges, CELLS, interpolation=cv2.INTER_AREA) > MIN_ON_EDGES).mean() < MIN_CELL_SHARE)


def _pictures(images: StereoImages, canvas: Rectified) -> tuple[NDArray[Any], NDArray[Any]]:
    """Coarse rectified pictures of both cameras."""
    shrink = images.geometry.left.focal_px / canvas.per_unit
    left, right = (
        cv2.remap(cv2.GaussianBlur(view.grey, (0, 0), 0.5 * shrink), where[0], where[1], cv2.INTER_LINEAR)
        for view, where in zip(images.views, (canvas.left, canvas.right), strict=True)
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


def plane_of_most(places: Array, disparities: NDArray[np.float32], canvas: Rectified) -> Array | None:
    """(3,) the plane, disparity = plane . (column, row, 1), in which most of places (N, 3) lie and few beyond it, where
    both cameras would see it."""
    if len(places) < FEWEST:
        return None
    some = np.linspace(0, len(places) - 1, SAMPLED).astype(int)
    few, own = places[some], disparities[some]
    three = np.random.default_rng(0).integers(0, SAMPLED, (TRIES, 3))  # the same planes for the same pictures
    three = three[np.abs(np.linalg.det(few[three])) > MIN_AREA_PX2]
    if not len(three):
        return None
    planes = np.linalg.solve(few[three], own[three][..., None])[..., 0]
    low, high = (limit.astype(np.float32) for limit in canvas.in_both(few))
    there = planes.astype(np.float32) @ few.T.astype(np.float32)
    against = (there > np.maximum(own + np.float32(4 * ON_PLANE_PX), low)) & (there < high)
    votes = np.count_nonzero(np.abs(there - own) < ON_PLANE_PX, 1) - 2 * np.count_nonzero(against, 1)
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
    answer = np.array([*plane, 1.0])  # with how much more contrast the left camera has
    for _ in range(COMPARISONS):
        at = (columns - few @ answer[:3]).astype(np.float32)[None]
        there, slope = (cv2.remap(one, at, rows, cv2.INTER_CUBIC)[0] for one in (right, further))
        off = own - answer[3] * there
        design = np.concatenate([-answer[3] * slope[:, None] * few, there[:, None]], 1)
        usual = 1.4826 * float(np.median(np.abs(off))) + 1e-3
        use = robust_weight((off / usual) ** 2)[None]
        answer = answer + solve(design[None, :, None], off[None, :, None], use, 1e-9 * np.eye(4)).unknowns[0]
    return answer[:3]


def _in_space(plane: Array, canvas: Rectified, geometry: Baseline, shape: tuple[int, int]) -> TablePlane:
    """A plane of disparities as it lies in space."""
    tall, wide = shape
    places = np.array([[canvas.margin, 0], [canvas.margin + wide, 0], [canvas.margin + wide / 2, tall]], float)
    there = places.copy()
    there[:, 0] -= (places - [canvas.margin, 0]) @ plane[:2] + plane[2]
    a, b, c = geometry.points(canvas.ideal(places), canvas.ideal(there))
    up = np.cross(b - a, c - a)
    up *= -np.sign(up @ (a + b + c)) / np.linalg.norm(up)
    return TablePlane(up, float(up @ (a + b + c)) / 3)
