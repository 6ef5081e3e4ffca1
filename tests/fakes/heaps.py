"""Heaps of touching parts, and near-duplicate parts that differ on a hidden side."""

from __future__ import annotations

import numpy as np

from daemon.arrays import Array
from drivers.rigid import apply, rigid, turn
from drivers.simcell.parts import ConvexSolid as Hull
from drivers.simcell.parts import PartShape
from drivers.simcell.world import World

GAP_MM = 0.05
"""The gap between touching parts, so that rounding does not make them overlap."""


def heap(world: World, labels: list[str], table_mm: Array, rng: np.random.Generator) -> None:
    """Stand parts on the table, each on any stable face and in any turn, pushed in any direction towards the first
    until it touches one that stands there. table_mm (3,)."""
    for label in labels:
        shape = world.shape(label)
        rest = shape.rests[int(rng.integers(len(shape.rests)))]
        spun = rigid(turn([0, 0, 1], rng.uniform(-np.pi, np.pi)), table_mm) @ rest
        angle = rng.uniform(-np.pi, np.pi)
        way = np.array([np.cos(angle), np.sin(angle), 0.0])
        standing = [(part.shape, part.pose) for part in world.parts]
        world.put(label, _pushed(shape, spun, way, standing))


def _pushed(shape: PartShape, pose: Array, way: Array, standing: list[tuple[PartShape, Array]]) -> Array:
    """The position of a part that is pushed in from far away until it touches."""
    near, far = 0.0, 400.0
    if not standing:
        return pose
    while far - near > GAP_MM:
        middle = (near + far) / 2
        tried = rigid(np.eye(3), middle * way) @ pose
        if any(overlap(shape, tried, other, its) for other, its in standing):
            near = middle
        else:
            far = middle
    return rigid(np.eye(3), far * way) @ pose


def overlap(one: PartShape, its_pose: Array, other: PartShape, other_pose: Array) -> bool:
    """Whether two parts overlap: no plane along a face or two edges separates their pieces."""
    return any(_meet(a, its_pose, b, other_pose) for a in one.pieces for b in other.pieces)


def _meet(a: Hull, pose_a: Array, b: Hull, pose_b: Array) -> bool:
    corners_a, corners_b = apply(pose_a, a.vertices), apply(pose_b, b.vertices)
    edges_a, edges_b = (_edges(s) @ p[:3, :3].T for s, p in ((a, pose_a), (b, pose_b)))
    crossed = np.cross(edges_a[:, None], edges_b[None]).reshape(-1, 3)
    axes = np.concatenate([a.normals @ pose_a[:3, :3].T, b.normals @ pose_b[:3, :3].T, crossed])
    axes = axes[np.linalg.norm(axes, axis=1) > 1e-6]
    axes = axes / np.linalg.norm(axes, axis=1, keepdims=True)
    on_a, on_b = corners_a @ axes.T, corners_b @ axes.T
    apart = np.maximum(on_a.min(0) - on_b.max(0), on_b.min(0) - on_a.max(0))
    return bool((apart < 0).all())


def _edges(solid: Hull) -> Array:
    """(E, 3): directions of the edges."""
    return np.array(
        [solid.vertices[p] - solid.vertices[q] for f in solid.faces for p, q in zip(f, (*f[1:], f[0]), strict=True)]
    )
