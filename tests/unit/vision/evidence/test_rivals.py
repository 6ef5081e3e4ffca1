"""Of two parts at one place the edges tell that only one of them has."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from daemon.vision.evidence import missing
from daemon.vision.evidence.missing import RIVAL_NATS
from daemon.vision.evidence.rivals import by_own_edges, inverted_corners, untaught_rival
from daemon.vision.geometry import exact
from daemon.vision.image.stereo_images import StereoImages, open_stereo
from daemon.vision.look import look
from daemon.vision.model import mirror_images
from daemon.vision.refine.edge_samples import EdgeSamples, edge_samples_of
from daemon.vision.refine.expected_edges import ShapeBatch
from tests.bench import look_alikes
from tests.bench.simulated_looks import true_rig
from tests.fakes.many_parts import taught
from tests.fakes.photographed import cell
from tests.fakes.printed import print_pair, straight_rig
from tests.fakes.solids import KNOWN, Body, pose

WHERE = pose(np.array([0.75, 0.35, 0.6]), 0.3, 330.0)
CUBE = KNOWN["cube"]
FACING = [k for k in range(6) if exact(CUBE.corners_mm, CUBE.facets).facing(WHERE)[k] > 0]


@cache
def eyes() -> StereoImages:
    return open_stereo(*print_pair(CUBE, WHERE, 3), straight_rig())


def shown(corners_mm: np.ndarray, facets) -> list[EdgeSamples]:
    return edge_samples_of(ShapeBatch.of([exact(corners_mm, facets)]), eyes(), WHERE[None], 0.25)


def longer(body: Body, share: float) -> np.ndarray:
    return body.corners_mm * [1.0, 1.0, share]


def test_a_part_with_the_same_edges_is_told_apart_by_nothing() -> None:
    own = shown(CUBE.corners_mm, CUBE.facets)
    assert by_own_edges(own, own) == pytest.approx(0.0)


def test_a_face_alone_says_no_more_than_the_part_that_has_it() -> None:
    """All its edges are the part's as well, though some weigh more in it: its outline runs inside the part's."""
    whole, face = (shown(CUBE.corners_mm, facets) for facets in (CUBE.facets, [CUBE.facets[FACING[0]]]))
    assert by_own_edges(whole, face) > 10.0
    assert by_own_edges(face, whole) == pytest.approx(-by_own_edges(whole, face))


def test_an_edge_that_is_not_there_speaks_against_the_part_that_has_it() -> None:
    whole, other = shown(CUBE.corners_mm, CUBE.facets), shown(longer(CUBE, 1.4), CUBE.facets)
    assert by_own_edges(whole, other) > 10.0


def test_a_mirror_image_and_a_raised_tip_are_held_against_a_part_and_what_is_its_own_mirror_image_has_none() -> None:
    assert not mirror_images(exact(CUBE.corners_mm, CUBE.facets))
    assert untaught_rival(exact(CUBE.corners_mm, CUBE.facets), WHERE, eyes()) == 0.0
    assert [len(inverted_corners(exact(*one))) for one in (_block_with_tip(12.0), _block_with_tip(-12.0))] == [1, 1]
    sunk = inverted_corners(exact(*_block_with_tip(12.0)))[0]
    assert sunk.corners_mm == pytest.approx(_block_with_tip(-12.0)[0])


def _block_with_tip(mm: float) -> tuple[np.ndarray, list[tuple[int, ...]]]:
    """A block of 40 mm with a pyramid on it, or taken out of it."""
    square = np.array([[-20.0, -20.0], [20.0, -20.0], [20.0, 20.0], [-20.0, 20.0]])
    low, high = (np.column_stack([square, np.full(4, z)]) for z in (0.0, 30.0))
    sides = [(k, (k + 1) % 4, (k + 1) % 4 + 4, k + 4) for k in range(4)]
    tip = [(k + 4, (k + 1) % 4 + 4, 8) for k in range(4)]
    return np.vstack([low, high, [0.0, 0.0, 30.0 + mm]]), [(3, 2, 1, 0), *sides, *tip]


@pytest.mark.parametrize("seed", [6, 26, 46])
def test_edges_that_only_a_mirror_image_has_speak_against_a_part(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the part that lies there, and of its mirror image as the same look takes it to lie there."""
    monkeypatch.setattr(missing, "MOST_LIKELY_TWIN", 1.0)
    pair, lies, photo = look_alikes.shown("mirror", seed)
    eyes_on, nats = open_stereo(photo.left, photo.right, true_rig(cell())), list[float]()
    for part in (pair.parts[lies], pair.parts[1 - lies]):
        model = taught((part,))
        (found,) = (one for one in look(photo.left, photo.right, true_rig(cell()), model).parts if one.named)
        nats.append(untaught_rival(model.metric[part.label].solid, found.cyclopean_from_part, eyes_on))
    assert nats[0] == 0.0
    assert nats[1] > RIVAL_NATS
