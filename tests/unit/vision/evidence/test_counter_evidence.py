"""What a part should show and neither picture has speaks against its name; what nobody could see does not."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from daemon.arrays import Array
from daemon.store.library import load_facets
from daemon.vision.evidence import counter_evidence
from daemon.vision.evidence.counter_evidence import (
    CounterEvidence,
    counter_evidence_of,
    missing_in_both_px,
    missing_share,
    verified_names,
)
from daemon.vision.evidence.edge_places import EdgePlaces, edge_places
from daemon.vision.geometry import exact
from daemon.vision.image import StereoImages, open_stereo
from daemon.vision.look import look
from daemon.vision.model.model import Model, empty_model, learn_solid
from daemon.vision.recognition import recognise_group
from daemon.vision.values import Part
from tests.bench.look_alikes import shown
from tests.bench.missing import PRIOR, Seen, agrees, fitted, read, verdict
from tests.bench.simulated_looks import true_rig
from tests.fakes import painted
from tests.fakes.chosen import few
from tests.fakes.drawn import obj, solid
from tests.fakes.many_parts import taught
from tests.fakes.photographed import cell
from tests.fakes.printed import print_pair, straight_rig
from tests.fakes.solids import L_BASE, Body, pose, prism, view_of

BLOCK = prism(np.array([[0.0, 0], [60, 0], [60, 45], [0, 45]]), 40.0)
CUT = prism(np.array([[0.0, 0], [60, 0], [60, 45], [18, 45], [0, 27]]), 40.0)
WHERE = pose(np.array([-0.5, 0.3, 0.8]), 0.3, 330.0)
L_BLOCK = prism(L_BASE, 40.0)
INTO_THE_L = pose(np.array([-0.8, 0.35, 0.5]), 0.3, 330.0)
"""A leg of the L stands before some of the edges in its hollow."""
ONE_SIDE_MORE = 6
"""A seed of which the prism with another number of sides alone is taught."""
STRANGERS = [
    ("mirror", 46, "stepped_wedge_b"),
    ("mirror", 30, "cut_block_a"),
    ("cut", 6, "corner_cut_a"),
    ("dihedral", 46, "cap_or_pit_b"),
    ("dihedral", 28, "cap_or_pit_b"),
    ("cut", 26, "corner_cut_a"),
    ("cut", 46, "corner_cut_b"),
]
"""Looks at parts whose twin alone is taught, which their facets or edges name: a family, its seed, and the twin."""


@cache
def images_of(name: str) -> StereoImages:
    """A bare part on a bare table."""
    bodies = {"block": (BLOCK, WHERE), "cut": (CUT, WHERE), "l_block": (_farthest_first(), INTO_THE_L)}
    return open_stereo(*print_pair(*bodies[name], 3, printed=False, patterned=False), straight_rig())


def _farthest_first() -> Body:
    """The L, its facets in the order in which they are painted over each other."""
    corners = L_BLOCK.corners_mm @ INTO_THE_L[:3, :3].T + INTO_THE_L[:3, 3]
    away = [-np.linalg.norm(corners[list(ring)].mean(0)) for ring in L_BLOCK.facets]
    return Body(L_BLOCK.corners_mm, tuple(L_BLOCK.facets[k] for k in np.argsort(away)))


@cache
def model() -> Model:
    return learn_solid(
        empty_model(load_facets()), solid("block.obj", obj(BLOCK.corners_mm, list(BLOCK.facets))), "block"
    )


def samples(body: Body, where: Array, images: StereoImages) -> list[EdgePlaces]:
    return edge_places(exact(body.corners_mm, body.facets), where, images)


def checked(images: StereoImages) -> Part:
    """What becomes of the block's name, which its facets gave."""
    named = recognise_group(view_of(BLOCK, WHERE), model())
    assert named.label == "block"
    (found,) = verified_names([named], model(), images)
    return found.part


def test_a_part_of_which_nothing_is_missing_keeps_its_name_and_nearly_all_of_its_confidence() -> None:
    seen = samples(BLOCK, WHERE, images_of("block"))
    assert missing_share(seen) < 0.01
    assert missing_in_both_px(seen) == 0.0
    part = checked(images_of("block"))
    assert part.recognition.label == "block"
    before = recognise_group(view_of(BLOCK, WHERE), model()).part.recognition.confidence
    assert before * 0.98 < part.recognition.confidence < before


def test_a_part_with_a_corner_more_than_the_pictures_have_loses_its_name_and_it_is_said_why() -> None:
    seen = samples(BLOCK, WHERE, images_of("cut"))
    share = missing_share(seen)
    assert share > 0.08
    assert missing_in_both_px(seen) > 50.0
    verdict = checked(images_of("cut")).recognition
    assert verdict.label == "unknown"
    said = re.fullmatch(
        r"may be block, but (\d+)% of the edges that it should show are in neither picture", verdict.reason
    )
    assert said is not None
    assert int(said[1]) == pytest.approx(100 * share, abs=2)


def test_what_has_no_name_is_left_as_it_is() -> None:
    nameless = recognise_group(view_of(L_BLOCK, WHERE), model())
    assert not nameless.named
    assert verified_names([nameless], model(), images_of("cut")) == (nameless,)


def test_a_prism_of_another_number_of_sides_is_left_unnamed_for_what_is_missing_and_for_nothing_else(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pair, lies, photo = shown("sides", ONE_SIDE_MORE)
    other = taught((pair.parts[1 - lies],))
    pictures = photo.left, photo.right
    scene = look(*pictures, true_rig(cell()), other)
    assert not any(part.named for part in scene.parts)
    assert any(
        "of the edges that it should show are in neither picture" in part.recognition.reason for part in scene.parts
    )
    monkeypatch.setattr(counter_evidence, "MOST_LIKELY_DUPLICATE", 1.0)
    assert any(part.named for part in look(*pictures, true_rig(cell()), other).parts)


def test_edges_that_the_part_itself_hides_count_not_at_all() -> None:
    seen = samples(L_BLOCK, INTO_THE_L, images_of("l_block"))
    assert missing_share(seen) < 0.01
    ends = exact(L_BLOCK.corners_mm, L_BLOCK.facets).lines[0]
    faces_camera = [np.any(one.visible, axis=1) for one in seen]
    hidden = [(~one.visible & shown[:, None]).sum() for one, shown in zip(seen, faces_camera, strict=True)]
    assert len(ends) == 18
    assert sum(hidden) > 20, "the pose hides nothing: choose another"
    for there in (True, False):
        other = [replace(one, there=np.where(one.visible, one.there, there)) for one in seen]
        assert missing_share(other) == pytest.approx(missing_share(seen), abs=1e-12)


def test_an_edge_between_equal_greys_counts_little(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(painted, "GREYS", (140.0,))
    images = open_stereo(
        *painted.paint_pair([(BLOCK, WHERE)], np.random.default_rng(3), straight_rig()), straight_rig()
    )
    seen = samples(BLOCK, WHERE, images)
    inner = np.concatenate([one.there[(one.weight < 1) & np.any(one.visible, axis=1)] for one in seen])
    assert inner.mean() < 0.2, "the edges between the facets show"
    assert missing_share(seen) < 0.01
    assert missing_in_both_px(seen) == 0.0
    monkeypatch.setattr(counter_evidence, "EXPECTED", 1e-6)
    assert missing_share(seen) > 0.05


def test_what_one_camera_has_and_the_other_misses_is_not_missed_by_both() -> None:
    left, right = samples(BLOCK, WHERE, images_of("cut"))
    shown = replace(left, close=np.ones_like(left.close))
    assert missing_in_both_px((left, right)) > 50.0
    assert missing_in_both_px((shown, right)) == 0.0
    unseen = replace(left, visible=np.zeros_like(left.visible))
    assert 0.0 < missing_in_both_px((unseen, right)) < missing_in_both_px((left, right))


def test_an_edge_that_fades_beside_print_is_not_missed_as_one_that_ends() -> None:
    both = samples(BLOCK, WHERE, images_of("block"))
    edge = [int((one.visible.all(1) & (one.expected > 50).all(1)).argmax()) for one in both]
    assert edge[0] == edge[1]
    for places, missed in ((slice(10, 16), False), (slice(18, 24), True), (slice(0, 24), True)):
        faded = []
        for one in both:
            there = np.ones_like(one.close)
            there[edge[0], places] = False
            step = np.where(there, one.step, 0.0)
            faded.append(replace(one, close=there, step=step, spread=np.zeros_like(one.spread)))
        assert (missing_in_both_px(faded) > 0) == missed


def test_nothing_of_a_part_outside_both_pictures_is_missing() -> None:
    away = WHERE.copy()
    away[0, 3] += 900.0
    against = counter_evidence_of(exact(BLOCK.corners_mm, BLOCK.facets), away, images_of("block"))
    assert against == CounterEvidence(0.0, 0.0, 0.0, 0.0)


def test_the_more_speaks_against_a_part_the_likelier_is_a_twin() -> None:
    for largest in np.diag([0.3, 300.0, 300.0, 40.0]):
        chances = [CounterEvidence(*(share * largest)).duplicate for share in (0.0, 0.05, 0.2, 0.5, 1.0)]
        assert chances == sorted(chances)
        assert chances[0] < PRIOR
        assert chances[-1] > counter_evidence.MOST_LIKELY_DUPLICATE


def test_it_is_said_what_speaks_most_against_a_part() -> None:
    assert str(CounterEvidence(0.1, 30.0, 0.0, 3.0)) == "10% of the edges that it should show are in neither picture"
    assert str(CounterEvidence(0.01, 0.0, 80.0, 0.0)) == "edges of 80 px inside it lie in front of or behind its faces"
    assert str(CounterEvidence(0.03, 0.0, 0.0, 30.0, "mirrored")) == "a similar part (mirrored) fits better"


@pytest.mark.parametrize(("family", "seed", "name"), few(STRANGERS, 3))
def test_near_twins_that_were_never_taught_have_no_name(family: str, seed: int, name: str) -> None:
    pair, lies, photo = shown(family, seed)
    other = taught((pair.parts[1 - lies],))
    assert other.labels == (name,)
    assert not any(part.named for part in look(photo.left, photo.right, true_rig(cell()), other).parts)
    own = look(photo.left, photo.right, true_rig(cell()), taught((pair.parts[lies],)))
    assert [part.recognition.label for part in own.parts if part.named] == [pair.parts[lies].label]


def test_the_fit_finds_what_a_table_was_drawn_by() -> None:
    rng = np.random.default_rng(1)
    drawn = rng.uniform(0, 1, (20_000, 4)) * [0.1, 60.0, 60.0, 20.0]
    against = [CounterEvidence(a, b, c, d) for a, b, c, d in drawn.tolist()]
    odds = np.array([one.terms for one in against]) @ [0.5, 0.8, 1.5, 2.0] - 10.0
    twin = rng.random(len(odds)) < 1 / (1 + np.exp(-odds))
    fit = fitted([Seen("", "", "", not t, one) for t, one in zip(twin, against, strict=True)])
    moved = np.log(PRIOR / (1 - PRIOR)) - np.log(twin.mean() / (1 - twin.mean()))
    assert (np.abs(fit.weights - [-10.0 + moved, 0.5, 0.8, 1.5, 2.0]) < 4 * fit.errors).all()
    assert fit.errors.max() < 0.3


def test_the_constants_are_those_that_the_kept_table_gives() -> None:
    fit = fitted(read())
    assert agrees(fit), verdict(fit)
