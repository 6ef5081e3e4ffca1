"""Of many poses of taught parts the likeliest that would look different from each other."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from daemon.arrays import Array, Flags, Index
from daemon.vision.image import Eyes, ranks
from daemon.vision.registration.posed import Posed, ideal

ROOM_PX = 12
SAME_MM = 2.0  # poses that put every corner this near to the same place look the same

CELL_MM, CELL_TURN = 8.0, 0.4
"""Guesses whose middles and axes round to the same in these are one bundle."""
_BUNDLE = np.random.default_rng(2).integers(1, 2**40, 10)


@dataclass(frozen=True, eq=False)
class Guesses:
    """Poses of parts, and what speaks against each (G,), in any one unit."""

    posed: Posed
    against: Array

    def chosen(self, which: Index | Flags) -> Guesses:
        """Some of them."""
        return Guesses(self.posed.chosen(which), self.against[which])


def thinned(guesses: Guesses, of_each: int = 1) -> Index:
    """Which are the likeliest few of every bundle of guesses of one part at much the same pose."""
    posed = guesses.posed
    cells = [posed.part[:, None], posed.middles_mm() / CELL_MM, posed.poses[:, :3, :2].reshape(-1, 6) / CELL_TURN]
    bundle = np.rint(np.concatenate(cells, 1)).astype(np.int64) @ _BUNDLE
    order = np.argsort(guesses.against, kind="stable")
    return np.asarray(order[ranks(bundle[order]) < of_each])


def different(guesses: Guesses, eyes: Eyes) -> Iterator[tuple[int, Array]]:
    """Which of a few hundred have the middle of what shows inside both images, the likeliest first, none of which looks
    like an earlier one; and where the left eye sees all corners of each (K, 2) px."""
    posed = guesses.posed
    if not len(posed.part):
        return
    shows = np.asarray((posed.in_view()[:, :, None] & posed.solids.rings[posed.part]).any(1))
    corners_mm, own = posed.corners_mm(eyes.geometry), posed.solids.own[posed.part]
    count = shows.sum(1)
    middle_mm = (corners_mm * shows[..., None]).sum(1) / np.maximum(count, 1)[:, None]
    geometry = eyes.geometry
    both = zip((geometry.left, geometry.right), ideal(corners_mm, geometry), strict=True)
    seen = [eye.pixels(corners.astype(float)).reshape(*shows.shape, 2) for eye, corners in both]
    most = np.array(eyes.rig.image_size) - 1 - ROOM_PX
    inside = count > 0
    for px in seen:
        middle = (px * shows[..., None]).sum(1) / np.maximum(count, 1)[:, None]
        inside &= ((middle >= ROOM_PX) & (middle <= most)).all(1)
    of_one = (posed.part[:, None] == posed.part) & (count[:, None] == count)
    alike = of_one & (((middle_mm[:, None] - middle_mm) ** 2).sum(2) < SAME_MM**2)
    order, out = np.argsort(guesses.against, kind="stable"), ~inside
    for best in order.tolist():
        if out[best]:
            continue
        yield best, seen[0][best][own[best]]
        (near,) = alike[best].nonzero()
        if len(near) > 1:
            apart2 = ((corners_mm[near, :, None] - corners_mm[best, shows[best]]) ** 2).sum(3).min(2)
            out[near[((apart2 < SAME_MM**2) | ~shows[near]).all(1)]] = True
