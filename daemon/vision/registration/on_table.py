"""Named parts that lie on the table which both eyes see, laid flat on it.

How far away a part is, and how it is tilted in depth, two faces of it leave open to half a millimetre and a degree; a
patterned table says both better, from all of the picture. Whether a part lies on it is asked of what its own edges say.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from daemon import frames
from daemon.arrays import Array
from daemon.vision.facets import Table
from daemon.vision.geometry import Polyhedron, chi_square_limit
from daemon.vision.model import Model
from daemon.vision.registration.resting import Ground, nearest_rest, rests_on
from daemon.vision.values import Part

TABLE_MM, TABLE_RAD = 0.15, np.radians(0.1)
"""How well the table that both eyes see is known where a part stands, standard deviations: in half of the rendered
scenes it is .07 mm and .03 degrees off, in one of twenty .2 mm and .14 degrees."""
LIES, SUNK = chi_square_limit(3, 0.01), chi_square_limit(3, 1e-6)
"""Chi-square of a part's height and tilt against the table: more, and it stands on something else; for one that seems
to have sunk in, which none has, so much that it is no table."""


def rested(
    parts: Sequence[Part], model: Model, ground: Ground | None, by_edges: Sequence[Part] = ()
) -> tuple[Part, ...]:
    """The parts, the named ones that lie on a table which is seen where their edges and it together have them; those
    that edges named lie there already."""
    if ground is None or not ground.seen:
        return tuple(parts)
    done = [not part.named or any(part is other for other in by_edges) for part in parts]
    return tuple(part if there else _laid(part, model, ground) for part, there in zip(parts, done, strict=True))


def _laid(part: Part, model: Model, ground: Ground) -> Part:
    solid = model.metric[part.recognition.label].solid
    lies = rests_on(ground, solid, part.cyclopean_from_part)
    found = flat_on(ground.table, solid, part.cyclopean_from_part, part.covariance) if lies else None
    if found is None:
        return part
    pose, covariance = found
    turn = pose @ frames.inverse(part.cyclopean_from_part)
    fitted = tuple(frames.apply(turn, ring) for ring in part.fitted_mm)
    return part.laid(pose, covariance, fitted)


def flat_on(table: Table, solid: Polyhedron, pose: Array, covariance: Array) -> tuple[Array, Array] | None:
    """Pose (4, 4) cyclopean_from_part and covariance (6, 6) of a solid that rests on a table, if it may: both together
    say where it is. Source: Kalman's update by three measurements, the height of its foot and its tilt two ways."""
    normal, foot = nearest_rest(solid, pose[:3, :3].T @ -table.up)
    down, lever = pose[:3, :3] @ normal, pose[:3, :3] @ foot
    along = np.linalg.svd(table.up[None])[2][1:]
    slope = np.zeros((3, 6))
    slope[0] = table.up @ frames.point_motion(lever[None])[0]
    slope[1:, 3:] = np.cross(down, along)
    off = np.array([table.level_mm - table.up @ (lever + pose[:3, 3]), *(-along @ down)])
    spread = slope @ covariance @ slope.T + np.diag([TABLE_MM**2, TABLE_RAD**2, TABLE_RAD**2])
    if off @ np.linalg.solve(spread, off) > (SUNK if off[0] > 0 else LIES):
        return None
    gain = np.linalg.solve(spread, slope @ covariance).T
    return frames.perturb(pose, gain @ off), covariance - gain @ slope @ covariance
