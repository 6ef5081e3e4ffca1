"""Simulated measurements of a part from all sides: exact geometry with corner noise, the arm's error at each pose, and
one error of hand-eye and cameras in all. No rendering.
"""

from __future__ import annotations

import numpy as np

from daemon import frames
from daemon.arrays import Array, Index
from daemon.pick.pose_fusion import Doubt
from daemon.teaching.view_coverage import visible_facets
from daemon.vision.facets import LookFacets, shared_motion
from daemon.vision.geometry import Polyhedron, exact
from daemon.vision.values import Facet, Group
from tests.fakes.solids import Body

FOCAL_PX, BASELINE_MM, CORNER_PX = 800.0, 60.0, 0.1
DOUBT = Doubt()


def solid(body: Body) -> Polyhedron:
    """The part about its middle."""
    return exact(body.corners_mm - body.corners_mm.mean(0), body.facets)


def place(azimuth: float, elevation: float, distance_mm: float = 300.0) -> Array:
    """base_from_cyclopean (4, 4) from where the middle is looked at; angles in rad."""
    level = np.cos(elevation)
    towards = np.array([np.cos(azimuth) * level, np.sin(azimuth) * level, np.sin(elevation)])
    x = np.cross([0.0, 0.0, 1.0], -towards)
    x /= np.linalg.norm(x)
    return frames.rigid(np.stack([x, np.cross(-towards, x), -towards], 1), distance_mm * towards)


def looked_at(
    part: Polyhedron, at: Array, rng: np.random.Generator, error: Array, doubt: Doubt = DOUBT, noise: float = 1.0
) -> LookFacets:
    """One look at the whole facets in view. error (9,): what all looks share; noise: share of CORNER_PX."""
    towards = at[:3, 3] - part.centres_mm.mean(0)
    shown = visible_facets(part, towards / np.linalg.norm(towards))
    points = frames.apply(frames.inverse(at), part.corners_mm)
    across = noise * CORNER_PX * points[:, 2] / FOCAL_PX
    along = np.sqrt(2) * across * points[:, 2] / BASELINE_MM
    covariance = np.array([np.diag([a * a, a * a, b * b]) for a, b in zip(across, along, strict=True)])
    drawn = np.array([rng.multivariate_normal(np.zeros(3), c) for c in covariance])
    measured = points + drawn - shared_motion(points, FOCAL_PX, BASELINE_MM) @ error
    px = FOCAL_PX * points[:, :2] / points[:, 2:]
    shift = np.array([FOCAL_PX * BASELINE_MM / 2, 0.0]) / points[:, 2:]

    def facet(ring: Index) -> Facet:
        zeros = np.zeros(len(ring))
        return Facet(measured[ring], covariance[ring], px[ring] + shift[ring], px[ring] - shift[ring], zeros, 0.0)

    group = Group(tuple(facet(part.rings[k]) for k in shown), tuple(part.facets[k] for k in shown))
    said = frames.perturb(at, -rng.multivariate_normal(np.zeros(6), doubt.arm()))
    return LookFacets((group,) if shown else (), said, doubt.arm(), FOCAL_PX, BASELINE_MM)


def tour(part: Polyhedron, count: int, rng: np.random.Generator, doubt: Doubt = DOUBT) -> list[LookFacets]:
    """Looks from all round, evenly but for chance, from 25 to 65 degrees above."""
    error = rng.multivariate_normal(np.zeros(9), doubt.shared())
    turns = 2 * np.pi * (np.arange(count) + rng.uniform(0, 0.5, count)) / count
    return [looked_at(part, place(turn, rng.uniform(0.45, 1.1)), rng, error, doubt) for turn in turns]


def beside_truth(corners_mm: Array, truth: Polyhedron) -> tuple[Array, Array]:
    """(K,) the true corner nearest to each, and (K, 3) how far it is off."""
    nearest = np.linalg.norm(corners_mm[:, None] - truth.corners_mm, axis=2).argmin(1)
    return nearest, corners_mm - truth.corners_mm[nearest]
