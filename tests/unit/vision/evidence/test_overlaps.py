"""What lies on a named part is that part's; what lies elsewhere stays what it is."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from daemon import frames
from daemon.store.library import load_facets
from daemon.vision.evidence.overlaps import all_accounted_for, without_overlaps
from daemon.vision.facets.grouping import merge_vertices
from daemon.vision.image.stereo_images import StereoImages, open_stereo
from daemon.vision.model.model import Model, empty_model, learn_view
from daemon.vision.recognition.group_recognition import Recognised, recognise_part
from daemon.vision.values import Facet, FacetView, Group, Rejected
from tests.fakes.painted import paint_pair
from tests.fakes.printed import print_pair, straight_rig
from tests.fakes.solids import CUBE, measured, pose, seen_facets, view_of

ASIDE_MM = np.array([140.0, 0.0, 0.0])
WHERE = pose(np.array([0.75, 0.35, 0.6]), 0.3, 330.0)


@cache
def model() -> Model:
    return learn_view(empty_model(load_facets()), view_of(CUBE, WHERE, np.random.default_rng(1), 0.3), "cube")


@cache
def images() -> StereoImages:
    return open_stereo(*print_pair(CUBE, WHERE), straight_rig())


def facet(corners_mm: np.ndarray) -> Facet:
    px = [camera.project(corners_mm) for camera in (straight_rig().left, straight_rig().right)]
    return replace(measured(corners_mm, None), left_px=px[0], right_px=px[1])


def one(*rings: np.ndarray) -> Recognised:
    group = merge_vertices([facet(ring) for ring in rings])
    return Recognised(group, recognise_part(group, model()))


def view(*groups: Group) -> FacetView:
    return FacetView(groups, (), (), (), 2.0)


def face(index: int = 0) -> np.ndarray:
    k = seen_facets(CUBE, WHERE)[index]
    return frames.apply(WHERE, CUBE.corners_mm)[list(CUBE.facets[k])]


def label_on(ring: np.ndarray) -> np.ndarray:
    middle = ring.mean(0)
    return middle + 0.4 * (ring - middle)


def test_more_named_parts_take_what_lies_on_them_and_leave_the_rest() -> None:
    cube = one(face(0), face(1))
    assert cube.named
    label, aside = one(label_on(face())), one(face() + ASIDE_MM)
    known, left = without_overlaps([label, aside], view(label.group, aside.group), [cube], model(), images())
    assert [r.label for r in known if r.named] == ["cube"]
    assert len([r for r in known if not r.named]) == 1
    assert left.groups == tuple(r.group for r in known)


def test_a_part_that_is_named_already_is_not_named_again() -> None:
    cube = one(face(0), face(1))
    known, _ = without_overlaps([cube], view(cube.group), [cube], model(), images())
    assert len(known) == 1


def test_all_is_explained_where_what_is_found_has_a_name_and_what_came_to_nothing_lies_on_it() -> None:
    cube, aside = one(face(0), face(1)), one(face() + ASIDE_MM)

    def explained(*found: Recognised, bent: np.ndarray | None = None, by_both: bool = True) -> bool:
        outlines = () if bent is None else (Rejected(facet(bent).left_px, "left", "bent", unexplained=by_both),)
        seen = replace(view(*(r.group for r in found)), rejected=outlines)
        return all_accounted_for(found, seen, model(), images())

    assert explained(cube)
    assert explained(cube, bent=face(0))
    assert not explained(cube, bent=face(0) + ASIDE_MM)
    assert explained(cube, bent=face(0) + ASIDE_MM, by_both=False), "a shadow's outline in one camera"
    assert not explained(cube, aside)
    assert not explained()


def test_nothing_more_leaves_what_was_found() -> None:
    aside = one(face() + ASIDE_MM)
    known, left = without_overlaps([aside], view(aside.group), [], model(), images())
    assert known == (aside,)
    assert left.groups == (aside.group,)


@pytest.mark.parametrize(
    ("aside_mm", "accounted"),
    [((-75.0, 0.0, 0.0), False), ((0.0, 70.0, 0.0), False), (None, True), ((-130.0, 0.0, 0.0), True)],
)
def test_strong_edges_beside_the_named_parts_are_not_accounted_for_unless_they_lead_out_of_the_picture(
    aside_mm: tuple[float, float, float] | None, accounted: bool
) -> None:
    """Parts that touch may close no outline in either picture; their edges show nevertheless."""
    cube = one(face(0), face(1))
    assert cube.named
    beside = [] if aside_mm is None else [(CUBE, frames.rigid(np.eye(3), np.array(aside_mm)) @ WHERE)]
    seen = open_stereo(*paint_pair([(CUBE, WHERE), *beside], np.random.default_rng(2), straight_rig()), straight_rig())
    assert all_accounted_for([cube], view(cube.group), model(), seen) is accounted
