"""Of two parts that differ in a side, the facets of one may fit the other: the pictures tell them apart, or nobody."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from daemon import frames
from daemon.store.library import load_facets
from daemon.vision.facets.weld import weld
from daemon.vision.geometry import exact
from daemon.vision.image.both_eyes import Eyes, open_eyes
from daemon.vision.model import learn_solid
from daemon.vision.model.model import Model, empty_model
from daemon.vision.recognition.recognise import Recognised, recognise_group
from daemon.vision.registration.beside import beside
from daemon.vision.registration.twins import as_twins, told_apart
from daemon.vision.values import FacetView, Group
from tests.worlds.drawn import obj, solid
from tests.worlds.printed import print_pair, straight_rig
from tests.worlds.solids import CUBE, PYRAMID, Body, pose, prism, view_of

BLOCK = prism(np.array([[0.0, 0], [60, 0], [60, 45], [0, 45]]), 40.0)
CUT = prism(np.array([[0.0, 0], [60, 0], [60, 45], [18, 45], [0, 27]]), 40.0)
WHERE = pose(np.array([-0.5, 0.3, 0.8]), 0.3, 330.0)


@cache
def model() -> Model:
    taught = empty_model(load_facets())
    for label, body in (("block", BLOCK), ("cut", CUT), ("pyramid", PYRAMID)):
        drawing = solid(f"{label}.obj", obj(body.corners_mm, list(body.facets)))
        taught = learn_solid(taught, drawing, label)
    return taught


def recognised(group: Group, taught: Model) -> Recognised:
    return Recognised(group, recognise_group(group, taught))


def eyes_on(body: Body) -> Eyes:
    return open_eyes(*print_pair(body, WHERE, 2, printed=False), straight_rig())


def corner_unseen(group: Group, corner_mm: np.ndarray) -> Group:
    """With one corner so unsure as where two sides meet beyond what shows of them."""
    facets = []
    for facet in group.facets:
        off = np.linalg.norm(facet.corners_mm - corner_mm, axis=1)
        larger = np.where(off < 1.0, 50.0, 1.0)[:, None, None]
        facets.append(replace(facet, covariance_mm2=facet.covariance_mm2 * larger))
    return weld(facets)


def test_facets_measured_as_if_nothing_were_cut_off_give_no_name_where_the_pictures_show_the_cut() -> None:
    taught = model()
    cut_off = frames.apply(WHERE, np.array([[0.0, 45.0, 40.0]]))[0]
    one = recognised(corner_unseen(view_of(BLOCK, WHERE), cut_off), taught)
    assert one.label == "block"
    assert one.part.recognition.confidence > 0.99
    kept = told_apart(one, taught, eyes_on(BLOCK))
    assert kept is one
    left = told_apart(one, taught, eyes_on(CUT))
    assert not left.named
    assert left.part.recognition.candidates == ("block", "cut")
    assert left.part.recognition.ambiguous
    assert left.part.recognition.confidence < 0.6


def test_facets_that_are_found_to_be_one_part_only_later_are_held_against_its_twins_as_well() -> None:
    taught = model()
    whole = corner_unseen(view_of(BLOCK, WHERE), frames.apply(WHERE, np.array([[0.0, 45.0, 40.0]]))[0])
    apart = [recognised(whole.only([k]), taught) for k in range(len(whole.facets))]
    view = FacetView(tuple(one.group for one in apart), (), (), (), 2.0)
    assert not any(one.named for one in apart)
    known, _ = beside(apart, view, (), taught, eyes_on(BLOCK))
    assert [one.label for one in known if one.named] == ["block"]
    known, _ = beside(apart, view, (), taught, eyes_on(CUT))
    assert not any(one.named for one in known)
    assert ("block", "cut") in [one.part.recognition.candidates for one in known]


def test_parts_that_share_no_side_are_no_twins() -> None:
    block, cut, cube, pyramid = (exact(body.corners_mm, body.facets) for body in (BLOCK, CUT, CUBE, PYRAMID))
    assert len(as_twins(block, pyramid)) == len(as_twins(cube, block)) == 0
    assert len(as_twins(block, cut)) == 4
    for turn in as_twins(block, cut):
        moved = frames.apply(turn, cut.corners_mm)
        apart = np.linalg.norm(moved[:, None] - block.corners_mm, axis=2)
        assert (apart.min(0) < 0.1).sum() == 6
        assert (apart.min(1) < 0.1).sum() == 6


def test_a_part_without_a_twin_keeps_its_name() -> None:
    taught = model()
    one = recognised(view_of(PYRAMID, WHERE), taught)
    assert told_apart(one, taught, eyes_on(PYRAMID)) is one


@pytest.mark.parametrize("body", [BLOCK, CUT])
def test_a_part_whose_sides_show_keeps_its_name(body: Body) -> None:
    taught = model()
    one = recognised(view_of(body, WHERE), taught)
    assert one.named
    assert told_apart(one, taught, eyes_on(body)) is one
