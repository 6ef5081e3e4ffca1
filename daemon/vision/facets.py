"""A stereo pair -> facets in space, grouped into parts: the order of the steps, and nothing else."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from daemon.vision.candidates import choose, find_candidates
from daemon.vision.data import FacetView, Group, Polygon, Rejected
from daemon.vision.epipolar import baseline
from daemon.vision.eye import Sight, look_with
from daemon.vision.grouping import connected, touching_table
from daemon.vision.image import as_grey, check_size
from daemon.vision.joining import join
from daemon.vision.rig import StereoRig
from daemon.vision.settings import VisionSettings


def find_facets(
    left: NDArray[Any], right: NDArray[Any], rig: StereoRig, settings: VisionSettings | None = None
) -> FacetView:
    """Everything geometry can say of one stereo pair.

    left, right: (H, W) uint8, or what `as_grey` takes. Facets come untyped, corners anticlockwise as seen.
    Raises VisionError where an image cannot be used; an image with nothing in it gives an empty view.
    """
    settings = settings or VisionSettings()
    eyes = baseline(rig)
    sights = []
    for image, eye, name in ((left, eyes.left, "left image"), (right, eyes.right, "right image")):
        grey = as_grey(image, name)
        check_size(grey, rig.image_size, name)
        sights.append(look_with(eye, grey, settings))
    chosen, refused = choose(find_candidates(sights[0], sights[1], eyes, settings), settings)
    groups = []
    touch = touching_table(tuple(c.facet for c in chosen))
    for members in connected(touch):
        facets, _ = join([chosen[k] for k in members], eyes)
        groups.append(Group(tuple(facets), touch[np.ix_(members, members)]))
    groups.sort(key=lambda g: float(np.mean([f.corners_mm[:, 2].mean() for f in g.facets])))
    polygons = tuple(c.left.polygon for c in chosen), tuple(c.right.polygon for c in chosen)
    rejected = _unmatched(sights[0], polygons[0], "left") + _unmatched(sights[1], polygons[1], "right")
    rejected += tuple(Rejected(c.facet.left_px, "left", why) for c, why in refused)
    sigma = float(np.mean([s.noise.sigma[128] for s in sights]))
    return FacetView(tuple(groups), rejected, *polygons, sigma)


def _unmatched(sight: Sight, used: tuple[Polygon, ...], eye: str) -> tuple[Rejected, ...]:
    """Outlines well away from every polygon that was used."""
    taken = [(*p.corners_px.min(0), *p.corners_px.max(0)) for p in used]
    alone = []
    for o in sight.outlines:
        x, y = o.corners.mean(0)
        if not any(left < x < right and top < y < bottom for left, top, right, bottom in taken):
            alone.append(Rejected(o.corners, eye, "no polygon of the other eye fits along its epipolar lines"))
    return tuple(alone)
