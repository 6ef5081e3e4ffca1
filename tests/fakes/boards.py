"""Images of calibration boards: one of 9 x 6 corners, drawn flat, and any board rendered through any camera.

Independent of the corner detection: OpenCV draws the board, and rays sample it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from daemon import frames
from daemon.arrays import Array
from daemon.calibration.board import Board
from daemon.vision.geometry import Camera

BOARD = Board(9, 6, 10.0)
PX_A_SQUARE = 240
"""Resolution of the drawing, in which usual marker widths and their modules are whole pixels."""
WHITE, BLACK, AROUND = 215, 25, 150


def drawn_board(turned: bool = False, square_px: int = 36) -> np.ndarray:
    squares = np.add.outer(np.arange(7), np.arange(10)) % 2
    image: np.ndarray = np.full((480, 640), 230, np.uint8)
    board = np.where(np.kron(squares, np.ones((square_px, square_px))) > 0, 230, 30).astype(np.uint8)
    image[100 : 100 + board.shape[0], 120 : 120 + board.shape[1]] = board
    image = cv2.GaussianBlur(image, (0, 0), 0.8)
    return image[::-1, ::-1].copy() if turned else image


@lru_cache(maxsize=2)
def drawing(board: Board) -> np.ndarray:
    """The grey levels of the board as it is printed, PX_A_SQUARE px a square, with a white rim of one square."""
    if board.kind == "charuco":
        size = (board.columns + 1) * PX_A_SQUARE, (board.rows + 1) * PX_A_SQUARE
        inner = np.asarray(board.charuco().generateImage(size), np.uint8)
    else:
        squares = np.add.outer(np.arange(board.rows + 1), np.arange(board.columns + 1)) % 2
        inner = np.kron(squares * np.uint8(255), np.ones((PX_A_SQUARE, PX_A_SQUARE), np.uint8))
    return np.where(np.pad(inner, PX_A_SQUARE, constant_values=255) > 127, np.uint8(WHITE), np.uint8(BLACK))


@dataclass(frozen=True, eq=False)
class Painter:
    """One camera's pictures of a board: blur_px, sigma of the lens's spread; noise, sigma in grey levels; rays x
    rays make a pixel."""

    camera: Camera
    board: Board
    image_size: tuple[int, int] = (640, 480)
    blur_px: float = 0.7
    noise: float = 1.5
    rays: int = 3

    def picture(self, cyclopean_from_board: Array, rng: np.random.Generator) -> np.ndarray:
        """An image (height, width) uint8 of the board, lit a little unevenly."""
        width, height = self.image_size
        image: np.ndarray = np.full((height, width), AROUND, np.float32)
        (left, top), (right, bottom) = (map(int, corner) for corner in self._window(cyclopean_from_board))
        rays = self._rays(left, top, right, bottom)
        grey = self._grey(rays, frames.inverse(self.camera.cyclopean_from_camera) @ cyclopean_from_board)
        image[top:bottom, left:right] = cv2.resize(grey, (right - left, bottom - top), interpolation=cv2.INTER_AREA)
        image *= np.linspace(0.85, 1.0, width, dtype=np.float32)
        image = cv2.GaussianBlur(image, (0, 0), self.blur_px) if self.blur_px > 0 else image
        return np.clip(np.round(image + rng.normal(0, self.noise, image.shape)), 0, 255).astype(np.uint8)

    def _window(self, cyclopean_from_board: Array) -> tuple[Array, Array]:
        """The pixel bounds (2,), (2,) of the board with its rim."""
        x, y = (self.board.square_mm * np.linspace(-2.0, n + 1.0, 9) for n in (self.board.columns, self.board.rows))
        rim = [[a, b, 0.0] for a in x for b in y]
        px = self.camera.project(frames.apply(cyclopean_from_board, np.array(rim)))
        low, high = np.floor(px.min(axis=0)).astype(int) - 2, np.ceil(px.max(axis=0)).astype(int) + 3
        return np.clip(low, 0, np.array(self.image_size) - 1), np.clip(high, 1, self.image_size)

    def _rays(self, left: int, top: int, right: int, bottom: int) -> np.ndarray:
        """(H, W, 2) where the rays of these pixels meet the plane z = 1: at pixel centres by the lens, between them
        linearly, which is within 0.0001 px."""
        px = np.stack(np.meshgrid(np.arange(left - 1, right + 1), np.arange(top - 1, bottom + 1)), axis=-1)
        met = self.camera.normalised(px.reshape(-1, 2).astype(float)).reshape(px.shape)
        many, rim = self.rays, slice(self.rays, -self.rays)
        return cv2.resize(met, None, fx=many, fy=many, interpolation=cv2.INTER_LINEAR)[rim, rim]

    def _grey(self, rays: np.ndarray, camera_from_board: Array) -> np.ndarray:
        """(H, W) float32 grey levels that the rays meet."""
        to_print = np.diag([PX_A_SQUARE / self.board.square_mm] * 2 + [1.0])
        to_print[:2, 2] = 2 * PX_A_SQUARE - 0.5  # the print's first square is that of the rim
        x, y = cv2.split(cv2.perspectiveTransform(rays, to_print @ np.linalg.inv(camera_from_board[:3, [0, 1, 3]])))
        to = x.astype(np.float32), y.astype(np.float32)
        met = cv2.remap(drawing(self.board), *to, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT, borderValue=AROUND)
        return np.asarray(met, np.float32)


def tilted(board: Board, rng: np.random.Generator, distance_mm: float, aside_mm: float = 25.0) -> Array:
    """cyclopean_from_board (4, 4) of a board in front of the cameras, tilted by up to about 30 degrees."""
    centre = np.append(board.points_mm()[:, :2].mean(axis=0), 0.0)
    turn = frames.rotation_from_vector(rng.uniform(-0.5, 0.5, 3))
    place = np.array([*rng.uniform(-aside_mm, aside_mm, 2), distance_mm])
    return frames.rigid(turn, place - turn @ centre)
