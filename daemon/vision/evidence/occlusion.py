"""Which places on the edges of a part something nearer hides: those between its edges where they cross the part's.

In: a part at its pose, both images, the places of its edges where no edge shows. Out: those that are hidden. What lies
before a part crosses its edges with edges of its own, which both cameras see before it; where a part is not what it is
taken for, its edges end at others of the same depth, or at none.
"""

import numpy as np

from daemon import frames
from daemon.arrays import Array, Flags, Index
from daemon.vision.geometry import Polyhedron
from daemon.vision.image import StereoImages

SHORT_PX, NEAR_PX = 4.0, 6.0
"""How far before an edge a segment may end that crosses it; and how far from there, and a place, it may end to show."""
TURNED, ALIKE = np.sin(np.radians(20.0)), np.sin(np.radians(20.0))
"""The sine of the angle at which a segment crosses an edge, at least; and between the images of one, at most."""
BEYOND = 0.4
"""Past its ends, in its lengths, where a segment still may be the image of one that ends at an edge of the part."""
NEARER_PX, NEAREST_PX = 2.0, 60.0
"""How much farther apart than an edge both cameras have what lies before it."""


def hidden_places(solid: Polyhedron, pose: Array, eyes: StereoImages, one: int, visible: Flags, there: Flags) -> Flags:
    """(E, S) which places of its edges, of those that are visible if nothing is before the part at cyclopean_from_part
    (4, 4), something nearer hides from the left or right (0, 1) camera, which has edges there."""
    missing, hidden = visible & ~there, np.zeros_like(visible)
    if not missing.any():
        return hidden
    ends, count = solid.lines[0], visible.shape[1]
    edges, shares, lengths_px = _crossings(solid, pose, eyes, one)
    covered, whole = np.zeros(len(solid.corners_mm), bool), list[tuple[int, slice]]()
    for edge in np.flatnonzero(missing.any(1)).tolist():
        near = NEAR_PX / max(lengths_px[edge], 1e-9) + 1 / count
        crossed = shares[edges == edge]
        seen = np.flatnonzero(visible[edge])
        changes = np.flatnonzero(np.diff(np.concatenate([[False], missing[edge], [False]]))).tolist()
        for first, last in zip(changes[::2], changes[1::2], strict=True):
            open_ = first == seen[0], last == seen[-1] + 1
            if all(open_):
                whole.append((edge, slice(first, last)))
            elif all(
                free or (np.abs(crossed - place / count) < near).any()
                for free, place in zip(open_, (first, last), strict=True)
            ):
                hidden[edge, first:last] = True
                covered[ends[edge][np.array([first == 0, last == count])]] = True
    for edge, places in whole:
        hidden[edge, places] = covered[ends[edge]].all()
    return hidden


def _crossings(solid: Polyhedron, pose: Array, eyes: StereoImages, one: int) -> tuple[Index, Array, Array]:
    """Where segments of a camera that lie nearer cross the edges of a part: the edges (N,) and shares (N,) of their
    length; and the length (E,) of each, px."""
    geometry, view = eyes.geometry, eyes.views[one]
    mine, theirs = (geometry.left, geometry.right)[:: 1 - 2 * one]
    points, ends = frames.apply(pose, solid.corners_mm), solid.lines[0]
    px = view.eye.camera.project(points)
    start, way = px[ends[:, 0]], px[ends[:, 1]] - px[ends[:, 0]]
    lengths_px = np.linalg.norm(way, axis=1)
    share, along, sine = _met(start, way, view.segments.start, view.segments.end - view.segments.start)
    room = SHORT_PX / view.segments.lengths_px
    near = NEAR_PX / np.maximum(lengths_px, 1e-9)[:, None]
    edge, segment = np.nonzero(
        (np.abs(sine) > TURNED) & (along > -room) & (along < 1 + room) & (share > -near) & (share < 1 + near)
    )
    at = mine.ideal(start[edge] + share[edge, segment, None] * way[edge])
    where = share[edge, segment, None]
    left, right = geometry.project(points[ends[edge, 0]] * (1 - where) + points[ends[edge, 1]] * where)
    apart = (left - right)[:, :1]
    mine_way = mine.ideal(view.segments.end[segment]) - mine.ideal(view.segments.start[segment])
    begin, stop = (
        theirs.ideal(each) for each in (eyes.views[1 - one].segments.start, eyes.views[1 - one].segments.end)
    )
    row, on, _ = _met(at, np.array([[1.0, 0.0]]).repeat(len(at), 0), begin, stop - begin)
    unit, units = (each / np.linalg.norm(each, axis=1)[:, None] for each in (mine_way, stop - begin))
    turned, same = unit[:, :1] * units[:, 1] - unit[:, 1:] * units[:, 0], unit @ units.T > 0
    farther = (-row * (1 - 2 * one) - apart) * mine.focal_px
    alike = same & (np.abs(turned) < ALIKE)
    nearer = alike & (on > 0) & (on < 1) & (farther > NEARER_PX) & (farther < NEAREST_PX)
    level = alike & (on > -BEYOND) & (on < 1 + BEYOND) & (np.abs(farther) <= NEARER_PX)
    kept = nearer.any(1) & ~level.any(1)  # what may be as far away is the part's own
    return edge[kept], share[edge, segment][kept], lengths_px


def _met(start: Array, way: Array, others: Array, ways: Array) -> tuple[Array, Array, Array]:
    """(E, N) where lines from start (E, 2) along way (E, 2) meet others (N, 2), ways (N, 2): in shares of either; and
    the sine of the angle between them."""
    crossed = way[:, :1] * ways[:, 1] - way[:, 1:] * ways[:, 0]
    firm = np.where(np.abs(crossed) < 1e-12, 1e-12, crossed)
    off = others - start[:, None]
    share = (off[..., 0] * ways[:, 1] - off[..., 1] * ways[:, 0]) / firm
    along = (off[..., 0] * way[:, 1:] - off[..., 1] * way[:, :1]) / firm
    lengths = np.linalg.norm(way, axis=1)[:, None] * np.linalg.norm(ways, axis=1)
    return share, along, crossed / np.maximum(lengths, 1e-12)
