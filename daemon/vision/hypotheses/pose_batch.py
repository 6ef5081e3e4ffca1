"""Many poses of any of taught solids at once: where their corners are, which edges show."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from daemon.arrays import Array, Flags, Image32, Index
from daemon.vision.geometry import Baseline, SolidBatch
from daemon.vision.model import Model

COVERED = 0.2  # of the smaller area; more than that, and the two cannot both be there
LEAST_FACING = 0.08
"""Cosine below which a facet is too thin in the image to be looked for."""


def taught_solids(model: Model) -> SolidBatch:
    """Every part that a model has the shape of."""
    return SolidBatch.of([metric.solid for metric in model.metric.values()])


@dataclass(frozen=True, eq=False)
class PoseBatch:
    """Poses (G, 4, 4) cyclopean_from_part of solids: part (G,), which each is of."""

    solids: SolidBatch
    part: Index
    poses: Array

    def chosen(self, which: Index | Flags) -> PoseBatch:
        """Some of them."""
        return PoseBatch(self.solids, self.part[which], self.poses[which])

    def and_also(self, others: PoseBatch) -> PoseBatch:
        """These and others of the same solids."""
        poses = np.concatenate([self.poses, others.poses])
        return PoseBatch(self.solids, np.append(self.part, others.part), poses)

    def corners_mm(self, geometry: Baseline) -> Image32:
        """(G, K, 3) from the middle between the cameras, in axes of the baseline."""
        turn = geometry.cyclopean_from_baseline.T
        rotation = (turn @ self.poses[:, :3, :3]).astype(np.float32)
        shift = ((self.poses[:, :3, 3] - geometry.middle_mm) @ turn.T).astype(np.float32)
        corners = self.solids.corners_mm[self.part].astype(np.float32)
        return np.asarray(corners @ rotation.transpose(0, 2, 1) + shift[:, None])

    def middles_mm(self) -> Array:
        """(G, 3) cyclopean."""
        turned = (self.poses[:, :3, :3] @ self.solids.middles_mm[self.part, :, None])[..., 0]
        return np.asarray(turned + self.poses[:, :3, 3])

    def in_view(self, camera_mm: Array) -> Flags:
        """(G, F) which facets are turned to a camera at (3,) mm, cyclopean."""
        way = (camera_mm - self.poses[:, :3, 3])[:, None]
        camera = (way @ self.poses[:, :3, :3])[:, 0].astype(np.float32)  # where each part has it
        planes = self.solids.planes
        facets = planes.shape[1] // 2
        normals, middles = planes[:, :facets], planes[:, facets:]
        along = (planes[self.part] @ camera[:, :, None])[..., 0]
        towards = along[:, :facets] - (normals * middles).sum(2)[self.part]
        away2 = (camera * camera).sum(1)[:, None] - 2 * along[:, facets:] + (middles * middles).sum(2)[self.part]
        return np.asarray(towards > LEAST_FACING * np.sqrt(away2))

    def in_either_view(self, geometry: Baseline) -> Flags:
        """(G, F) which facets are turned to either camera."""
        left, right = (self.in_view(camera_mm) for camera_mm in geometry.cameras_mm)
        return left | right

    def edges(self, camera_mm: Array) -> tuple[Index, Index]:
        """The edges that a camera at (3,) mm sees, pose after pose: of which (N,), and their ends (N, 2) among all
        corners of all poses."""
        facets, corners = self.solids.rings.shape[1], self.solids.corners_mm.shape[1]
        view = np.zeros((len(self.part), facets + 1), bool)
        view[:, :facets] = self.in_view(camera_mm)
        first = (np.arange(len(self.part)) * (facets + 1))[:, None]
        one, other = (view.reshape(-1)[first + self.solids.beside[self.part, :, k]] for k in (0, 1))
        pose, edge = np.nonzero(one | other)
        return pose, self.solids.ends[self.part[pose], edge] + pose[:, None] * corners


def ideal(corners_mm: Image32, geometry: Baseline) -> tuple[Image32, Image32]:
    """Project points (..., 3), as PoseBatch.corners_mm has them, into either camera: ideal coordinates (N, 2) each."""
    x, y, z = np.moveaxis(corners_mm, -1, 0).reshape(3, -1)
    by_z = 1 / z
    height, half = y * by_z, np.float32(geometry.length_mm / 2)
    return np.stack([(x + half) * by_z, height], 1), np.stack([(x - half) * by_z, height], 1)


def pixels(points: Array, geometry: Baseline) -> tuple[Array, Array]:
    """Project points (N, 3) mm cyclopean into either camera: (N, 2) px each."""
    left, right = geometry.project(points)
    return geometry.left.pixels(left), geometry.right.pixels(right)
