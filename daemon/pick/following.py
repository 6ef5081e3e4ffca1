"""The part being picked, from look to look: found again, brought to the world, held against its neighbours.

Values and geometry; nothing here moves, waits or writes a log.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from daemon import frames
from daemon.arm.workcell import Array, Workcell
from daemon.pick import fusion
from daemon.pick.fusion import Doubt, Estimate, Sighting
from daemon.pick.grasp import Gripper, closed_fingers
from daemon.pick.looking import Expect, Look
from daemon.pick.plan import Plan
from daemon.pick.seen import SAME_PLACE_MM, Seen, seen_parts
from daemon.vision.geometry.polyhedron import Polyhedron
from daemon.vision.geometry.rig import StereoRig
from daemon.vision.image.both_eyes import Eyes, open_eyes
from daemon.vision.registration.corner_pose import Fit, refit
from daemon.vision.registration.edge_pose import fit_edges, shown
from daemon.vision.values import Facet, FacetView, Part, Recognition, Scene

NEAR_MM = 60.0
"""Facets farther than this from where the part's middle should be are not its own."""
FINGERS_SHOW, FINGERS_REACH_MM = 0.7, 1.0
"""The share of the met fingers' outline that proves them so, and how far from its place it is looked for."""
FACETS_REACH_MM, REACH_MM = 2.0, 6.0
"""How far off the pose that edges are searched from may be: one that facets gave, and one thought before the look."""


def far(a: Array, b: Array) -> float:
    """Distance of two points, mm."""
    return float(np.linalg.norm(a - b))


@dataclass(eq=False)
class Target:
    """The part being picked: what is known of it so far.

    view: (3, 3) how the tool is turned for looks, world, where that is not as for the grasp; confidence: of its name.
    looked_before: the look before the last one.
    """

    label: str
    shape: Polyhedron
    world_from_part: Array
    plan: Plan
    look: Look
    sightings: list[Sighting] = field(default_factory=list)
    estimate: Estimate | None = None
    looks: int = 0
    restarts: int = 0
    view: Array | None = None
    confidence: float = 1.0
    looked_before: Look | None = None

    @property
    def looking(self) -> Array:
        """(3, 3) how the tool is turned when looked at, world."""
        return self.plan.grasp.world_from_tool[:3, :3] if self.view is None else self.view

    @property
    def centre(self) -> Array:
        """(3,) world mm: mean of the shape's corners where they are now thought to be."""
        centre: Array = frames.apply(self.world_from_part, self.shape.corners_mm).mean(axis=0)
        return centre


def follow(target: Target, look: Look, cell: Workcell, doubt: Doubt) -> bool:
    """Find the target in a new look and add the sighting; False where it is not where it should be."""
    target.looked_before, target.look = target.look, look
    target.looks += 1
    fit = expected_fit(look) if not look.whole else fitted(target, look, cell)
    if fit is None:
        return False
    target.sightings.append(sighted(look, fit, cell, doubt))
    return True


def fitted(target: Target, look: Look, cell: Workcell) -> Fit | None:
    """The target's pose in a whole look, by the facets near it and then by its edges; None where neither show."""
    near = frames.inverse(look.world_from_cyclopean) @ target.world_from_part
    facets = [f for p in seen_parts(look) if far(p.centre, target.centre) < NEAR_MM for f in p.facets]
    by_facets = refit(target.shape, facets, near)
    if by_facets is None:
        return None
    return fit_edges(target.shape, eyes_of(look, cell), by_facets.cyclopean_from_part, FACETS_REACH_MM) or by_facets


def _in_its_place(target: Target, world_from_cyclopean: Array, eyes: Eyes) -> Fit | None:
    """The target's pose by its edges about where it is thought to lie, None where they do not show there."""
    return fit_edges(target.shape, eyes, frames.inverse(world_from_cyclopean) @ target.world_from_part, REACH_MM)


def expecting(target: Target, cell: Workcell) -> Expect:
    """Looks for the target's edges where it should be, and for nothing else."""

    def expect(left: NDArray[np.uint8], right: NDArray[np.uint8], world_from_cyclopean: Array) -> Scene | None:
        fit = _in_its_place(target, world_from_cyclopean, open_eyes(left, right, cell.rig))
        return None if fit is None else expected_scene(target.label, target.shape, target.confidence, fit, cell.rig)

    return expect


def expected_scene(label: str, shape: Polyhedron, confidence: float, fit: Fit, rig: StereoRig) -> Scene:
    """A scene with one part, named before and found again: the facets that face the cameras, as they must lie."""
    corners = frames.apply(fit.cyclopean_from_part, shape.corners_mm)
    arms = corners - fit.cyclopean_from_part[:3, 3]
    spread = np.array(
        [frames.lever_covariance(frames.rigid(np.eye(3), arm), fit.covariance, np.eye(4)) for arm in arms]
    )
    normals = shape.normals @ fit.cyclopean_from_part[:3, :3].T
    facets = tuple(
        Facet(
            corners_mm=corners[ring],
            covariance_mm2=spread[ring, :3, :3],
            left_px=rig.left.project(corners[ring]),
            right_px=rig.right.project(corners[ring]),
            epipolar_px=np.full(len(ring), np.nan),
            planarity_mm=0.0,
            type=f"polygon{len(ring)}",
        )
        for ring, normal in zip(shape.rings, normals, strict=True)
        if float(normal @ corners[ring].mean(axis=0)) < 0.0
    )
    known = Recognition(label, confidence, np.nan, np.nan, None, False, "its edges lie where they should")
    part = Part(known, facets, fit.cyclopean_from_part, fit.covariance, fit.residual_mm)
    return Scene((part,), (), FacetView((), (), (), (), np.nan), ("only what was expected was looked for",))


def expected_fit(look: Look) -> Fit:
    """The fit that expected_scene was made of."""
    (part,) = look.scene.parts
    return Fit(part.cyclopean_from_part, part.covariance, part.residual_mm, len(part.facets))


def eyes_of(look: Look, cell: Workcell) -> Eyes:
    """A look's images made ready for edges."""
    return open_eyes(look.pictures.left.pixels, look.pictures.right.pixels, cell.rig)


def still_there(target: Target, look: Look, eyes: Eyes) -> bool:
    """Whether the target's edges still show where it lay."""
    return _in_its_place(target, look.world_from_cyclopean, eyes) is not None


def came_back_empty(eyes: Eyes, cell: Workcell, gripper: Gripper) -> bool:
    """Whether a look shows the fingers met with nothing between them. Where the cameras do not have them in view, or a
    part hides them, it does not."""
    cyclopean_from_tool = frames.inverse(cell.tool_from_cyclopean)
    return shown(closed_fingers(gripper), eyes, cyclopean_from_tool, FINGERS_REACH_MM) > FINGERS_SHOW


def sighted(look: Look, fit: Fit, cell: Workcell, doubt: Doubt) -> Sighting:
    """A fit in a look, brought to the world with its errors."""
    return fusion.sighting(
        look.reading.world_from_tool,
        cell.tool_from_cyclopean,
        fit.cyclopean_from_part,
        fit.covariance,
        doubt,
        float(cell.rig.left.matrix[0, 0]),
        cell.rig.baseline_mm,
    )


def others(target: Target, look: Look) -> list[Seen]:
    """The parts in a whole look that are not the target."""
    return [p for p in seen_parts(look) if far(p.centre, target.centre) >= SAME_PLACE_MM]


def beside(
    before: list[Seen], now: list[Seen], shape_of: Callable[[str], Polyhedron | None], cell: Workcell, doubt: Doubt
) -> list[float]:
    """Chi-squares of the parts that two looks both show: did they move as well?"""
    found = []
    for old in before:
        shape = shape_of(old.label)
        near = [p for p in now if far(p.centre, old.centre) < 2 * SAME_PLACE_MM]
        if shape is None or not near:
            continue
        first = refit(shape, old.facets, frames.inverse(old.look.world_from_cyclopean) @ old.world_from_part)
        here = frames.inverse(near[0].look.world_from_cyclopean) @ old.world_from_part
        second = refit(shape, near[0].facets, here, gate_mm=20.0)
        if first is not None and second is not None:
            pair = sighted(old.look, first, cell, doubt), sighted(near[0].look, second, cell, doubt)
            found.append(fusion.disagreement(*pair, doubt))
    return found
