"""What a part should show and neither picture has speaks against its name; what nobody could see does not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from daemon.arrays import Array
from daemon.store.library import load_facets
from daemon.vision.evidence import missing
from daemon.vision.evidence.missing import missing_share, twin_probability, with_all_they_show
from daemon.vision.geometry import exact
from daemon.vision.image import Eyes, open_eyes
from daemon.vision.look import look
from daemon.vision.model.model import Model, empty_model, learn_solid
from daemon.vision.recognition import recognised
from daemon.vision.refine.edge_samples import Stretches, stretches_of
from daemon.vision.refine.expected_edges import Placements
from daemon.vision.values import Part
from tests.bench.look_alikes import shown
from tests.bench.missing import PRIOR, Share, agrees, fitted, read, verdict
from tests.bench.simulated_looks import true_rig
from tests.fakes import painted
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
MIRRORED = 14
"""A seed of which the mirror image alone is taught."""
TOLERANCE_MM = 0.25


@cache
def eyes_on(name: str) -> Eyes:
    """A bare part on a bare table."""
    bodies = {"block": (BLOCK, WHERE), "cut": (CUT, WHERE), "l_block": (_farthest_first(), INTO_THE_L)}
    return open_eyes(*print_pair(*bodies[name], 3, printed=False, patterned=False), straight_rig())


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


def stretches(body: Body, where: Array, eyes: Eyes) -> tuple[Stretches, Stretches]:
    left, right = stretches_of(Placements.of([exact(body.corners_mm, body.facets)]), eyes, where[None], TOLERANCE_MM)
    return left, right


def share_of(body: Body, seen: Sequence[Stretches], eyes: Eyes) -> float:
    return missing_share(exact(body.corners_mm, body.facets), seen, eyes.views)


def checked(eyes: Eyes) -> Part:
    """What becomes of the block's name, which its facets gave."""
    named = recognised(view_of(BLOCK, WHERE), model())
    assert named.label == "block"
    (found,) = with_all_they_show([named], model(), eyes)
    return found.part


def test_a_part_of_which_nothing_is_missing_keeps_its_name_and_nearly_all_of_its_confidence() -> None:
    assert share_of(BLOCK, stretches(BLOCK, WHERE, eyes_on("block")), eyes_on("block")) < 0.01
    part = checked(eyes_on("block"))
    assert part.recognition.label == "block"
    before = recognised(view_of(BLOCK, WHERE), model()).part.recognition.confidence
    assert before * 0.98 < part.recognition.confidence < before


def test_a_part_with_a_corner_more_than_the_pictures_have_loses_its_name_and_it_is_said_why() -> None:
    share = share_of(BLOCK, stretches(BLOCK, WHERE, eyes_on("cut")), eyes_on("cut"))
    assert share > 0.08
    verdict = checked(eyes_on("cut")).recognition
    assert verdict.label == "unknown"
    assert verdict.reason == f"may be block, but {share:.0%} of what that should show is in neither picture"


def test_what_has_no_name_is_left_as_it_is() -> None:
    nameless = recognised(view_of(L_BLOCK, WHERE), model())
    assert not nameless.named
    assert with_all_they_show([nameless], model(), eyes_on("cut")) == (nameless,)


def test_a_mirror_image_is_left_unnamed_for_what_is_missing_and_for_nothing_else(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pair, lies, photo = shown("mirror", MIRRORED)
    other = taught((pair.parts[1 - lies],))
    pictures = photo.left, photo.right
    scene = look(*pictures, true_rig(cell()), other)
    assert not any(part.named for part in scene.parts)
    assert any("of what that should show is in neither picture" in part.recognition.reason for part in scene.parts)
    monkeypatch.setattr(missing, "MOST_LIKELY_TWIN", 1.0)
    assert any(part.named for part in look(*pictures, true_rig(cell()), other).parts)


def test_edges_that_the_part_itself_hides_count_not_at_all() -> None:
    eyes = eyes_on("l_block")
    seen = stretches(L_BLOCK, INTO_THE_L, eyes)
    assert sum((~one.visible).sum() for one in seen) > 10, "the pose hides nothing: choose another"
    share = share_of(L_BLOCK, seen, eyes)
    assert share < 0.01
    for there in (True, False):
        other = [replace(one, there=np.where(one.visible, one.there, there)) for one in seen]
        assert share_of(L_BLOCK, other, eyes) == pytest.approx(share, abs=1e-12)
    unhidden = [replace(one, visible=np.ones_like(one.visible)) for one in seen]
    assert share_of(L_BLOCK, unhidden, eyes) > share + 0.02


def test_an_edge_between_equal_greys_counts_little(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(painted, "GREYS", (140.0,))
    eyes = open_eyes(*painted.paint_pair([(BLOCK, WHERE)], np.random.default_rng(3), straight_rig()), straight_rig())
    seen = stretches(BLOCK, WHERE, eyes)
    inner = np.concatenate([one.there[one.edges.sharp & ~one.edges.outline] for one in seen])
    assert inner.mean() < 0.2, "the edges between the facets show"
    assert share_of(BLOCK, seen, eyes) < 0.01
    monkeypatch.setattr(missing, "EXPECTED", 1e-6)
    assert share_of(BLOCK, seen, eyes) > 0.05


def test_nothing_of_a_part_outside_both_pictures_is_missing() -> None:
    away = WHERE.copy()
    away[0, 3] += 900.0
    assert share_of(BLOCK, stretches(BLOCK, away, eyes_on("block")), eyes_on("block")) == 0.0


def test_the_more_is_missing_the_likelier_is_a_twin() -> None:
    chances = [twin_probability(share) for share in (0.0, 0.02, 0.05, 0.1, 0.3)]
    assert chances == sorted(chances)
    assert chances[0] < PRIOR
    assert chances[-1] > 0.99


def test_the_fit_finds_what_a_table_was_drawn_by() -> None:
    rng = np.random.default_rng(1)
    shares = rng.uniform(0, 0.15, 20_000)
    twin = rng.random(len(shares)) < 1 / (1 + np.exp(3.0 - 50.0 * shares))
    fit = fitted([Share("", "", "", not t, float(s)) for t, s in zip(twin, shares, strict=True)])
    moved = np.log(PRIOR / (1 - PRIOR)) - np.log(twin.mean() / (1 - twin.mean()))
    assert fit.twin == pytest.approx(-3.0 + moved, abs=4 * fit.twin_error)
    assert fit.by_missing == pytest.approx(50.0, abs=4 * fit.by_missing_error)
    assert fit.by_missing_error < 1.5


def test_the_constants_are_those_that_the_kept_table_gives() -> None:
    fit = fitted(read())
    assert agrees(fit), verdict(fit)
