"""Of two parts at one place the edges tell that only one of them has."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from daemon.vision.evidence import counter_evidence
from daemon.vision.evidence.competing import lead_by_own_edges
from daemon.vision.evidence.counter_evidence import RIVAL_NATS, DuplicateLead, duplicate_lead
from daemon.vision.evidence.edge_places import edge_places
from daemon.vision.evidence.near_duplicates import without_corner
from daemon.vision.geometry import Polyhedron, exact
from daemon.vision.geometry.polyhedron import SolidBatch
from daemon.vision.image.stereo_images import StereoImages, open_stereo
from daemon.vision.look import look
from daemon.vision.refine.edge_samples import EdgeSamples, edge_samples_of
from daemon.vision.refine.expected_edges import THIN_PX
from tests.bench import look_alikes
from tests.bench.simulated_looks import true_rig
from tests.fakes.chosen import few
from tests.fakes.many_parts import taught
from tests.fakes.photographed import cell
from tests.fakes.printed import print_pair, straight_rig
from tests.fakes.solids import KNOWN, Body, pose, prism

WHERE = pose(np.array([0.75, 0.35, 0.6]), 0.3, 330.0)
CUBE = KNOWN["cube"]
FACING = [k for k in range(6) if exact(CUBE.corners_mm, CUBE.facets).facing(WHERE)[k] > 0]


@cache
def images() -> StereoImages:
    return open_stereo(*print_pair(CUBE, WHERE, 3), straight_rig())


def shown(corners_mm: np.ndarray, facets) -> list[EdgeSamples]:
    return edge_samples_of(SolidBatch.of([exact(corners_mm, facets)]), images(), WHERE[None], 0.25)


def rival_of(solid: Polyhedron, where: np.ndarray, images_of: StereoImages) -> DuplicateLead:
    return duplicate_lead(solid, where, images_of, edge_places(solid, where, images_of))


def longer(body: Body, share: float) -> np.ndarray:
    return body.corners_mm * [1.0, 1.0, share]


def test_a_part_with_the_same_edges_is_told_apart_by_nothing() -> None:
    own = shown(CUBE.corners_mm, CUBE.facets)
    assert lead_by_own_edges(own, own) == pytest.approx(0.0)


def test_a_face_alone_says_no_more_than_the_part_that_has_it() -> None:
    """All its edges are the part's as well, though some weigh more in it: its outline runs inside the part's."""
    whole, face = (shown(CUBE.corners_mm, facets) for facets in (CUBE.facets, [CUBE.facets[FACING[0]]]))
    assert lead_by_own_edges(whole, face) > 10.0
    assert lead_by_own_edges(face, whole) == pytest.approx(-lead_by_own_edges(whole, face))


def test_an_edge_that_is_not_there_speaks_against_the_part_that_has_it() -> None:
    whole, other = shown(CUBE.corners_mm, CUBE.facets), shown(longer(CUBE, 1.4), CUBE.facets)
    assert lead_by_own_edges(whole, other) > 10.0


@pytest.mark.parametrize("seed", few([6, 26, 46], 1))
def test_edges_that_only_a_mirror_image_has_speak_against_a_part(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the part that lies there, and of its mirror image as the same look takes it to lie there."""
    monkeypatch.setattr(counter_evidence, "MOST_LIKELY_DUPLICATE", 1.0)
    pair, lies, photo = look_alikes.shown("mirror", seed)
    images_of, nats = open_stereo(photo.left, photo.right, true_rig(cell())), list[float]()
    for part in (pair.parts[lies], pair.parts[1 - lies]):
        model = taught((part,))
        (found,) = (one for one in look(photo.left, photo.right, true_rig(cell()), model).parts if one.named)
        nats.append(rival_of(model.metric[part.label].solid, found.cyclopean_from_part, images_of).nats)
    assert nats[0] == 0.0
    assert nats[1] > RIVAL_NATS


BLOCK = prism(np.array([[0.0, 0], [60, 0], [60, 45], [0, 45]]), 40.0)
NEAR_BLOCK = pose(np.array([-0.5, 0.3, 0.8]), 0.3, 330.0)


@cache
def cut_block() -> Polyhedron:
    """The block without the corner that is seen best."""
    whole = exact(BLOCK.corners_mm, BLOCK.facets)
    corner = int(np.argmin((whole.corners_mm @ NEAR_BLOCK[:3, :3].T)[:, 2]))
    beside = {k for edge in whole.edges if corner in edge for k in edge} - {corner}
    return without_corner(whole, corner, dict.fromkeys(beside, 0.4))


@cache
def images_of_block(cut: bool) -> StereoImages:
    shown = cut_block() if cut else exact(BLOCK.corners_mm, BLOCK.facets)
    body = Body(shown.corners_mm, shown.facets)
    return open_stereo(*print_pair(body, NEAR_BLOCK, 3, printed=False, patterned=False), straight_rig())


@pytest.mark.parametrize(
    ("taught_cut", "difference"), [(False, "with a corner cut off"), (True, "with a cut corner whole")]
)
def test_a_corner_cut_off_and_one_that_is_whole_speak_against_the_other(taught_cut: bool, difference: str) -> None:
    solid = cut_block() if taught_cut else exact(BLOCK.corners_mm, BLOCK.facets)
    assert rival_of(solid, NEAR_BLOCK, images_of_block(taught_cut)).nats == 0.0
    rival = rival_of(solid, NEAR_BLOCK, images_of_block(not taught_cut))
    assert rival.difference == difference
    assert rival.nats > RIVAL_NATS / 2


def test_a_tip_that_is_seen_from_the_side_alone_tells_by_the_outline(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its facets are too thin to be measured by themselves; what they stick out shows."""
    pair, lies, photo = look_alikes.shown("dihedral", 28)
    images_of, model = open_stereo(photo.left, photo.right, true_rig(cell())), taught((pair.parts[1 - lies],))
    monkeypatch.setattr(counter_evidence, "MOST_LIKELY_DUPLICATE", 1.0)
    (found,) = (one for one in look(photo.left, photo.right, true_rig(cell()), model).parts if one.named)
    solid = model.metric[found.recognition.label].solid
    assert rival_of(solid, found.cyclopean_from_part, images_of).nats > RIVAL_NATS / 2
    monkeypatch.setattr(counter_evidence, "BY_OUTLINE_PX", THIN_PX)
    assert rival_of(solid, found.cyclopean_from_part, images_of).nats == 0.0
