"""Stereo pairs of a printed part on a patterned table: every face and the table carry a texture of our own making."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from daemon import frames
from daemon.arrays import Array
from daemon.vision.geometry.rig import Camera, StereoRig
from tests.fakes.rigs import STRAIGHT, rig
from tests.fakes.solids import Body, seen_facets

TEXELS, TABLE_MM = 256, 900.0
BASE = (95.0, 165.0, 110.0, 185.0, 140.0, 205.0, 125.0)


def straight_rig() -> StereoRig:
    """The tests' rig with lenses that keep lines straight, so that a homography paints a face."""
    return rig(distortion=STRAIGHT)


def print_pair(
    body: Body | None,
    where: Array,
    seed: int = 0,
    *,
    printed: bool = True,
    patterned: bool = True,
    table: Array | None = None,
    speckled: bool = False,
) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Left and right image (480, 640) of a body at cyclopean_from_part, and a table that lies in z = 0 of table, (4, 4)
    cyclopean_from_table, of stone where it is speckled; else one behind it that faces the cameras."""
    rng = np.random.default_rng(seed)
    cloth = _stone(rng) if speckled else _cloth(rng) if patterned else np.full((TEXELS, TEXELS), 45.0, np.float32)
    half = TABLE_MM / 2
    square = half * np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    lies = frames.rigid(np.eye(3), np.array([0.0, 0.0, where[2, 3] + 60.0])) if table is None else table
    faces = [(frames.apply(lies, square), cloth)]
    if body is not None:
        corners = frames.apply(where, body.corners_mm)
        for k in seen_facets(body, where, 0.0):
            faces.append((corners[list(body.facets[k])], _print(rng, BASE[k % len(BASE)], printed)))
    cameras = straight_rig()
    left, right = (_paint(faces, camera, cameras.image_size, rng) for camera in (cameras.left, cameras.right))
    return left, right


def _cloth(rng: np.random.Generator) -> NDArray[np.float32]:
    """A texture of threads: noise stretched along one direction, and stripes across it."""
    threads = cv2.GaussianBlur(rng.normal(size=(TEXELS, TEXELS)).astype(np.float32), (0, 0), sigmaX=12, sigmaY=0.7)
    stripes = np.sin(np.arange(TEXELS) / 5.0)[:, None]
    return np.asarray(60 + 14 * threads / threads.std() + 12 * stripes, np.float32)


def _stone(rng: np.random.Generator) -> NDArray[np.float32]:
    """A texture of specks of all sizes."""
    each = [cv2.GaussianBlur(rng.normal(size=(TEXELS, TEXELS)).astype(np.float32), (0, 0), s) for s in (0.6, 1.5, 4.0)]
    return np.asarray(70 + sum(9 * one / one.std() for one in each), np.float32)


def _print(rng: np.random.Generator, base: float, printed: bool) -> NDArray[np.float32]:
    """A texture of paper with text and a band."""
    paper = np.full((TEXELS, TEXELS), base, np.uint8)
    if printed:
        ink = base - 60
        for row in range(60, TEXELS, 55):
            word = "".join(rng.choice(list("ACEHKMNRTX4790"), 7))
            cv2.putText(paper, word, (20, row), cv2.FONT_HERSHEY_SIMPLEX, 1.3, ink, 4, cv2.LINE_AA)
        start = int(rng.integers(40, 160))
        paper[:, start : start + 30] = base - 30
    return paper.astype(np.float32)


def _paint(
    faces: list[tuple[Array, NDArray[np.float32]]], camera: Camera, size: tuple[int, int], rng: np.random.Generator
) -> NDArray[np.uint8]:
    finer = 2
    wide = (size[0] * finer, size[1] * finer)
    image = np.zeros(wide[::-1], np.float32)
    for corners, texture in faces:
        x = corners[1] - corners[0]
        x = x / np.linalg.norm(x)
        normal = np.cross(x, corners[2] - corners[1])
        y = np.cross(normal / np.linalg.norm(normal), x)
        flat = (corners - corners[0]) @ np.stack([x, y], 1)
        low, span = flat.min(0), np.ptp(flat, axis=0).max()
        square = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
        places = corners[0] + (low + span * square) @ np.stack([x, y])
        px = ((camera.project(places) + 0.5) * finer - 0.5).astype(np.float32)
        warp = cv2.getPerspectiveTransform((square * (TEXELS - 1)).astype(np.float32), px)
        painted = cv2.warpPerspective(texture, warp, wide, flags=cv2.INTER_AREA)
        mask = np.zeros(wide[::-1], np.uint8)
        border = (camera.project(corners) + 0.5) * finer - 0.5
        cv2.fillPoly(mask, [np.rint(border * 16).astype(np.int32)], 1, cv2.LINE_8, 4)
        image = np.where(mask > 0, painted, image)
    small = cv2.resize(cv2.GaussianBlur(image, (0, 0), 0.6 * finer), size, interpolation=cv2.INTER_AREA)
    return np.clip(np.rint(small + rng.normal(0, 1.5, small.shape)), 0, 255).astype(np.uint8)
