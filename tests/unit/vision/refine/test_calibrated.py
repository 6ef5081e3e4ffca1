"""What is said of how surely a part was measured agrees with how far off it is."""

from __future__ import annotations

import numpy as np
import pytest

from daemon import frames
from daemon.vision.geometry import chi_square_limit
from daemon.vision.look import look
from tests.bench.look_alikes import shown
from tests.bench.simulated_looks import true_rig
from tests.fakes.many_parts import taught
from tests.fakes.photographed import cell

SEEDS = range(0, 40, 2)
SEVERAL = 6


@pytest.mark.long
def test_poses_by_facets_are_off_by_what_their_covariance_says() -> None:
    """Their chi-squares, of six degrees of freedom each, are neither too many too large nor all far too small."""
    found = []
    for seed in SEEDS:
        pair, lies, photo = shown("size", seed)
        part = pair.parts[lies]
        model = taught((part,))
        for one in look(photo.left, photo.right, true_rig(cell()), model).parts:
            if one.named and "facets fit" in one.recognition.reason:
                off = _off(part, photo.cyclopean_from_part, one, model.metric[part.label].solid)
                found.append(float(off @ np.linalg.solve(one.covariance, off)))
    assert len(found) >= SEVERAL
    assert np.mean(np.array(found) < chi_square_limit(6, 0.05)) > 0.8
    assert np.mean(found) > 0.7


def _off(part, true, one, solid):
    """(6,) from where the part is to where it was found, whichever turn of it that is."""
    corners = frames.apply(true, np.unique(np.vstack([p.vertices for p in part.shape.pieces]).round(3), axis=0))
    pose = one.cyclopean_from_part
    here = frames.apply(pose, solid.corners_mm)
    there = corners[np.linalg.norm(here[:, None] - corners, axis=2).argmin(1)]
    u, _, vt = np.linalg.svd((there - there.mean(0)).T @ (here - here.mean(0)))
    turn = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt
    return frames.difference(pose, frames.rigid(turn, there.mean(0) - turn @ here.mean(0)) @ pose)
