"""Solids in a mirror, laid where they keep most of their corners."""

from __future__ import annotations

import numpy as np
import pytest

from daemon.vision.geometry import Polyhedron
from daemon.vision.model import mirror_images
from tests.fakes.drawn import solid
from tests.fakes.families import CHIRAL, alike
from tests.fakes.many_parts import drawn_parts


@pytest.mark.parametrize("seed", range(0, 2 * len(CHIRAL), 2))
def test_a_mirror_image_keeps_all_distances_and_the_facets_it_is_said_to_keep(seed: int) -> None:
    part = solid("part.obj", alike("mirror", seed).parts[0].drawing)
    found = mirror_images(part)
    assert found
    for image in found:
        assert _apart(image.solid) == pytest.approx(_apart(part), abs=1e-6)
        assert np.linalg.norm(image.solid.areas_mm2, axis=1) == pytest.approx(np.linalg.norm(part.areas_mm2, axis=1))
        corners = image.solid.corners_mm
        off = np.linalg.norm(corners[:, None] - part.corners_mm, axis=2).min(1)
        kept = np.array([(off[ring] < 2.0).all() for ring in part.rings])
        assert not kept.all()
        assert np.array_equal(kept, image.kept)
        assert np.linalg.det((corners - corners.mean(0))[:3]) == pytest.approx(
            -np.linalg.det((part.corners_mm - part.corners_mm.mean(0))[:3])
        )


def test_what_is_its_own_mirror_image_has_none() -> None:
    for part in drawn_parts(24):
        assert not mirror_images(solid("part.obj", part.drawing)), part.label


def _apart(one: Polyhedron) -> np.ndarray:
    return np.linalg.norm(one.corners_mm[:, None] - one.corners_mm, axis=2)
