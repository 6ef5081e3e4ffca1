"""Simulated suction cup: whether a lip is tight on a part, and whether the vacuum holds it in each orientation. Pure.

Tool frame: the lip's middle at the origin, its plane across z, the part beyond it; lengths mm. Straight lines along z
through lip and cup meet the part's true surface, with its bores and roundings.
"""

from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from drivers.arrays import Array
from drivers.rigid import apply
from drivers.simcell.gripper import PALM_MM, Grip, within
from drivers.simcell.parts import ConvexSolid, PartShape, box, hull, prism, volume_and_centre
from drivers.simcell.truth import Rod, SuctionTruth

LIP_POINTS, SIDES = 48, 12
WITHIN = (0.0, 0.35, 0.7)
"""Shares of the radius at which lines go through the cup's inside."""
SEALS_MM = 0.2
"""A gap this narrow the lip closes by itself."""
BAR_N_MM2, GRAVITY_M_S2 = 0.1, 9.81


def cup_rods(cup: SuctionTruth) -> list[Rod]:
    """What of the cup does not give, as inscribed rods: the tube, and the rim above the lip."""
    name, end, edge = "the suction cup", -cup.lip_mm, cup.radius_mm - 2.0
    rods = [Rod(name, "tool", [0.0, 0.0, -cup.length_mm], [0.0, 0.0, end - cup.radius_mm], cup.radius_mm)]
    for x, y in ((edge, 0.0), (0.0, edge)):
        rods.append(Rod(name, "tool", [-x, -y, end - 2.0], [x, y, end - 2.0], 2.0))
    return rods


@lru_cache(maxsize=4)
def cup_solids(cup: SuctionTruth) -> tuple[ConvexSolid, ConvexSolid]:
    """The rigid bodies: cup with tube, and the palm."""
    half = PALM_MM / 2
    back = -cup.length_mm
    tube = _round(cup.radius_mm, back, -cup.lip_mm)
    return tube, hull(box((-half, -half, back - PALM_MM), (half, half, back)))


@lru_cache(maxsize=4)
def cup_shown(cup: SuctionTruth) -> ConvexSolid:
    """The cup as cameras see it, half pressed."""
    return _round(cup.radius_mm, -cup.length_mm, -cup.lip_mm / 2)


def _round(radius_mm: float, low: float, high: float) -> ConvexSolid:
    side_mm = 2.0 * radius_mm * float(np.sin(np.pi / SIDES))
    return hull(prism(SIDES, side_mm, high - low) + np.array([0.0, 0.0, low]))


def cup_strikes(shape: PartShape, tool_from_part: Array, cup: SuctionTruth) -> bool:
    """Whether what does not give collides with the part."""
    if apply(tool_from_part, shape.hull.vertices)[:, 2].min() >= -cup.lip_mm:
        return False
    return any(len(within(shape, tool_from_part, solid).corners) for solid in cup_solids(cup))


def suck(shape: PartShape, tool_from_part: Array, cup: SuctionTruth) -> Grip | None:
    """Switch the vacuum on with the lip at a part; None where the lip does not touch it."""
    turn = np.linspace(0.0, 2.0 * np.pi, LIP_POINTS, endpoint=False)
    rim = cup.radius_mm * np.column_stack([np.cos(turn), np.sin(turn)])
    inner = np.vstack([share * rim[::6] for share in WITHIN])
    triangles = apply(tool_from_part, _surface(shape).reshape(-1, 3)).reshape(-1, 3, 3)
    met = _met(np.vstack([rim, inner]), triangles)
    touching = (met[:LIP_POINTS] <= SEALS_MM) & (met[:LIP_POINTS] >= -cup.lip_mm)
    if not touching.any():
        return None
    why = ""
    if cup_strikes(shape, tool_from_part, cup):
        why = "the cup was driven into the part"
    elif not touching.all():
        why = f"the lip leaks on {np.mean(~touching):.0%} of its way round: a hole, an edge or a slope"
    elif np.isinf(met[LIP_POINTS:]).any():
        why = "a bore through the part leaks inside the lip"
    return Grip(not why, why or "held", tool_from_part, tool_from_part)


def holds(shape: PartShape, tool_from_part: Array, down: Array, cup: SuctionTruth) -> str:
    """Why the vacuum does not hold a tight part at this orientation of the tool; empty where it does. down (3,): the
    direction of gravity, tool frame."""
    force_n = cup.vacuum_bar * BAR_N_MM2 * np.pi * cup.radius_mm**2
    weight_n = _volume(shape) * 1e-6 * cup.density_g_cm3 * GRAVITY_M_S2
    pulled_n, along_n = weight_n * max(float(down[2]), 0.0), weight_n * float(np.hypot(down[0], down[1]))
    if pulled_n + along_n / cup.friction > force_n:
        return "the part is too heavy for the vacuum"
    arm = np.cross(apply(tool_from_part, shape.centre_of_mass), weight_n * down)
    if float(np.hypot(arm[0], arm[1])) > (force_n - pulled_n) * cup.radius_mm:
        return "the part hangs too far beside the cup and turns off"
    return ""


def _volume(shape: PartShape) -> float:
    """mm^3."""
    if shape.surface is not None:
        return shape.surface.volume_and_centre[0]
    return sum(volume_and_centre(piece)[0] for piece in shape.pieces)


def _surface(shape: PartShape) -> Array:
    """(T, 3, 3) triangles in the part frame."""
    if shape.surface is not None:
        return np.asarray(shape.surface.corners_mm[shape.surface.triangles])
    fans = [
        piece.vertices[[face[0], b, c]] for piece in shape.pieces for face in piece.faces for b, c in pairwise(face[1:])
    ]
    return np.array(fans)


def _met(points: Array, triangles: Array) -> Array:
    """(P,): z at which lines along z through points (P, 2), coming from the lip, first meet the surface; inf: never."""
    a, b, c = (triangles[:, k, :2] for k in range(3))
    area = _cross(b - a, c - a)
    flat: NDArray[np.bool_] = np.abs(area) > 1e-9
    a, b, c, area, heights = a[flat], b[flat], c[flat], area[flat], triangles[flat][:, :, 2]
    p = points[:, None]
    shares = np.stack([_cross(b - p, c - p), _cross(c - p, a - p), _cross(a - p, b - p)], axis=-1) / area[:, None]
    z = np.einsum("ptk,tk->pt", shares, heights)
    return np.asarray(np.where((shares >= -1e-9).all(axis=-1), z, np.inf).min(axis=1, initial=np.inf))


def _cross(u: Array, v: Array) -> Array:
    return np.asarray(u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0])
