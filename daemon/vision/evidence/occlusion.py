"""Which places on the edges of a part something nearer hides: those between its edges where they cross the part's.

In: a part at its pose, both images, the places of its edges where no edge shows. Out: those that are hidden. What lies
before a part crosses its edges with edges of its own, which both cameras see before it; where a part is not what it is
taken for, its edges end at others of the same depth, or at none.
"""

from collections.abc import Sequence

import numpy as np

from daemon import frames
from daemon.arrays import Array, Flags, Index
from daemon.vision.evidence.edge_places import EdgePlaces
from daemon.vision.geometry import Polyhedron
from daemon.vision.image import LEAST_SIGMAS, CameraImage, Segments, StereoImages, levels_across, peaks, slopes_across

SHORT_PX, NEAR_PX = 4.0, 6.0
"""How far before an edge a segment may end that crosses it; and how far from there, and a place, it may end to show."""
TURNED, ALIKE = np.sin(np.radians(20.0)), np.sin(np.radians(20.0))
"""The sine of the angle at which a segment crosses an edge, at least; and between the images of one, at most."""
BEYOND = 0.4
"""Past its ends, in its lengths, where a segment still may be the image of one that ends at an edge of the part."""
NEARER_PX, NEAREST_PX = 2.0, 60.0
"""How much farther apart than an edge both cameras have what lies before it."""

MOSTLY = 0.8
"""Of places on either hand of an edge, those at which an edge that runs on across it shows."""
OWN_PX = 3.0
"""Within which of an edge's line both ends of a segment lie that may be that edge, drawn on."""
_ALONG_PX = np.concatenate([np.arange(-18.0, -3.0, 1.5), np.arange(4.5, 19.0, 1.5)])
_ACROSS_PX = np.arange(-3.0, 3.5)


def hidden_of(solid: Polyhedron, pose: Array, images: StereoImages, both: Sequence[EdgePlaces]) -> tuple[Flags, Flags]:
    """(L, S) which places on the edges of a part at cyclopean_from_part (4, 4), as EdgePlaces have them, something
    nearer hides from the left and the right camera; both: what both images show along its edges."""
    left, right = (hidden_places(solid, pose, images, k, one.visible, one.there) for k, one in enumerate(both))
    return left, right


def hidden_places(
    solid: Polyhedron, pose: Array, images: StereoImages, one: int, visible: Flags, there: Flags
) -> Flags:
    """(E, S) which places of its edges, of those that are visible if nothing is before the part at cyclopean_from_part
    (4, 4), something nearer hides from the left or right (0, 1) camera, which has edges there."""
    missing, hidden = visible & ~there, np.zeros_like(visible)
    if not missing.any():
        return hidden
    ends, count = solid.lines[0], visible.shape[1]
    edges, shares, lengths_px = _crossings(solid, pose, images, one)
    covered, whole, open_at_one = np.zeros(len(solid.corners_mm), bool), list[int](), list[tuple[int, slice, Index]]()
    for edge in np.flatnonzero(missing.any(1)).tolist():
        near = NEAR_PX / max(lengths_px[edge], 1e-9) + 1 / count
        crossed, seen = shares[edges == edge], np.flatnonzero(visible[edge])
        runs = _bridged(
            np.diff(np.concatenate([[False], missing[edge], [False]])).nonzero()[0], crossed * count, near * count
        )
        for first, last in zip(runs[::2], runs[1::2], strict=True):
            free, corners = (first == seen[0], last == seen[-1] + 1), ends[edge][np.array([first == 0, last == count])]
            if all(free):
                whole.append(edge)
            elif all(
                open_ or (np.abs(crossed - place / count) < near).any()
                for open_, place in zip(free, (first, last), strict=True)
            ):
                hidden[edge, first:last] = missing[edge, first:last]
                covered[corners] = True
            else:
                open_at_one.append((edge, slice(first, last), corners))
    for edge, places, corners in open_at_one:
        hidden[edge, places] = missing[edge, places] & covered[corners].any()
    for edge in whole:
        hidden[edge] = missing[edge] & covered[ends[edge]].all()
    return hidden


def _bridged(changes: Index, crossed: Array, near: float) -> list[int]:
    """Join runs of places, given by where they begin and end in turn, over what crosses there: what crosses an edge
    that is not there looks like a little of it."""
    ends: list[int] = changes.tolist()
    for place in range(len(ends) - 3, 0, -2):
        if (np.abs(crossed[:, None] - ends[place : place + 2]) < near).all(1).any():
            del ends[place : place + 2]
    return ends


def _crossings(solid: Polyhedron, pose: Array, images: StereoImages, one: int) -> tuple[Index, Array, Array]:
    """Find where segments of a camera that lie nearer cross the edges of a part: the edges (N,) and shares (N,) of
    their length; and the length (E,) of each, px."""
    geometry, view = images.geometry, images.views[one]
    mine, theirs = (geometry.left, geometry.right)[:: 1 - 2 * one]
    points, ends = frames.apply(pose, solid.corners_mm), solid.lines[0]
    px = view.rectified.camera.project(points)
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
        theirs.ideal(each) for each in (images.views[1 - one].segments.start, images.views[1 - one].segments.end)
    )
    row, on, _ = _met(at, np.array([[1.0, 0.0]]).repeat(len(at), 0), begin, stop - begin)
    unit, units = (each / np.linalg.norm(each, axis=1)[:, None] for each in (mine_way, stop - begin))
    turned, same = unit[:, :1] * units[:, 1] - unit[:, 1:] * units[:, 0], unit @ units.T > 0
    farther = (-row * (1 - 2 * one) - apart) * mine.focal_px
    alike = same & (np.abs(turned) < ALIKE)
    nearer = alike & (on > 0) & (on < 1) & (farther > NEARER_PX) & (farther < NEAREST_PX)
    level = alike & (on > -BEYOND) & (on < 1 + BEYOND) & (np.abs(farther) <= NEARER_PX)
    kept = nearer.any(1) & ~level.any(1)  # what may be as far away is the part's own
    way_px = view.segments.end[segment] - view.segments.start[segment]
    own = _on_lines(view.segments, start[lengths_px > 0], way[lengths_px > 0])  # that of a longer part runs on as well
    asked = ~kept & ~own[segment]
    kept[asked] = _runs_on(view, (start[edge] + where * way[edge])[asked], way_px[asked])
    return edge[kept], share[edge, segment][kept], lengths_px


def _on_lines(segments: Segments, start: Array, way: Array) -> Flags:
    """(N,) which segments lie along any of the lines from start (E, 2) along way (E, 2)."""
    unit = way / np.linalg.norm(way, axis=1, keepdims=True)
    off = [
        np.abs((end[:, None, 0] - start[:, 0]) * unit[:, 1] - (end[:, None, 1] - start[:, 1]) * unit[:, 0])
        for end in (segments.start, segments.end)
    ]
    return np.asarray((np.maximum(*off) < OWN_PX).any(1))


def _runs_on(view: CameraImage, at: Array, way: Array) -> Flags:
    """(N,) whether an image shows an edge through places (N, 2) px, straight on to either hand along ways (N, 2)."""
    unit = way / np.linalg.norm(way, axis=1, keepdims=True)
    places = at[:, None] + _ALONG_PX[:, None] * unit[:, None]
    normal = np.stack([-unit[:, 1], unit[:, 0]], 1)[:, None].repeat(len(_ALONG_PX), 1)
    levels = levels_across(view.smooth, places.reshape(-1, 2), normal.reshape(-1, 2), _ACROSS_PX)
    found = peaks(np.abs(slopes_across(levels)), LEAST_SIGMAS).any(1).reshape(len(at), 2, len(_ALONG_PX) // 2)
    return np.asarray((found.mean(2) >= MOSTLY).all(1))


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
