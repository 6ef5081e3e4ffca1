"""Parts that leave a picture: whether what is in view proves how long they are.

In: a part laid onto both images, what its edges show. Out: nats. Where all edges along a part leave the picture, longer
or shorter ones fit as well: no name is proven. One that ends in view, or an end of it that does, says how long it is.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from daemon import frames
from daemon.arrays import Array
from daemon.vision.geometry import Polyhedron
from daemon.vision.image import Eyes
from daemon.vision.registration.directed import in_sizes
from daemon.vision.registration.expected_edges import Placements
from daemon.vision.registration.posed import pixels
from daemon.vision.registration.rivals import by_own_edges
from daemon.vision.registration.stretches import Stretches, stretches_of


def cut_off(solid: Polyhedron, pose: Array, eyes: Eyes) -> bool:
    """Whether a part at cyclopean_from_part (4, 4) leaves the picture of either eye."""
    most = np.array(eyes.rig.image_size) - 1
    seen = pixels(frames.apply(pose, solid.corners_mm), eyes.geometry)
    return any(bool(((px < 0) | (px > most)).any()) for px in seen)


def ahead_of_sizes(solid: Polyhedron, pose: Array, seen: Sequence[Stretches], eyes: Eyes, tolerance_mm: float) -> float:
    """By how many nats what both eyes show at a pose (4, 4) speaks more for a part than for the same part longer or
    shorter there, whichever is nearest to it."""
    sizes = in_sizes(solid)
    laid = Placements.of(sizes)
    both = stretches_of(laid, eyes, pose[None].repeat(len(sizes), 0), tolerance_mm)
    return min(by_own_edges(seen, [one.only(k, laid) for one in both]) for k in range(len(sizes)))
