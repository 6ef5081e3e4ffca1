"""Top-down: a lone facet, or an outline in one eye, becomes a named part only where both images show the rest of it."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from daemon import frames
from daemon.arrays import Array
from daemon.store.library import load_facets
from daemon.vision.facets.weld import weld
from daemon.vision.image.both_eyes import open_eyes
from daemon.vision.model.model import Model, empty_model, learn_view
from daemon.vision.recognition.recognise import recognise
from daemon.vision.registration.verify import verify
from daemon.vision.values import Facet, FacetView, Group, Rejected
from tests.worlds.painted import paint_pair
from tests.worlds.rigs import rig
from tests.worlds.solids import (
    CUBE,
    KNOWN,
    PENTAGONAL,
    PYRAMID,
    STRANGERS,
    TRIANGULAR,
    Body,
    measured,
    pose,
    seen_facets,
    view_of,
)

TAUGHT = (
    ("cube", CUBE, (1.0, 0.1, 0.8)),
    ("pyramid", PYRAMID, (0.05, 0.03, 1.0)),
    ("pyramid", PYRAMID, (0.7, 0.55, -0.6)),
    ("triangular_prism", TRIANGULAR, (0.7, 0.05, 0.5)),
    ("pentagonal_prism", PENTAGONAL, (0.25, 0.76, 0.5)),
)
WHERE = pose(np.array([0.75, 0.25, 0.6]), 0.3, 340.0)


@cache
def model() -> Model:
    rng = np.random.default_rng(3)
    taught = empty_model(load_facets())
    for label, body, direction in TAUGHT:
        taught = learn_view(taught, view_of(body, pose(np.array(direction), 0.3), rng, 0.5), label)
    return taught


def facet_of(body: Body, index: int, where: Array = WHERE) -> Facet:
    """One facet as both eyes of the rig see it, with the noise of a good fit."""
    corners = frames.apply(where, body.corners_mm)[list(body.facets[index])]
    found = measured(corners, np.random.default_rng(index), 0.5)
    px = [eye.project(found.corners_mm) for eye in (rig().left, rig().right)]
    return Facet(found.corners_mm, found.covariance_mm2, px[0], px[1], np.zeros(len(corners)), 0.0)


def seen(groups: tuple[Group, ...] = (), rejected: tuple[Rejected, ...] = ()) -> FacetView:
    return FacetView(groups, rejected, (), (), 2.0)


def names(body: Body | None, view: FacetView) -> list[str]:
    """What the view is taken for after a closer look at a painting of the body."""
    bodies = [(body, WHERE)] if body else []
    eyes = open_eyes(*paint_pair(bodies, np.random.default_rng(4)), rig())
    found, _ = verify(recognise(view.groups, model()), view, model(), eyes)
    return [r.label for r in found]


@pytest.mark.parametrize("label", sorted(KNOWN))
def test_a_lone_facet_is_completed_where_both_images_show_the_rest(label: str) -> None:
    body = KNOWN[label]
    for index in seen_facets(body, WHERE, 0.35):
        view = seen((weld([facet_of(body, index)]),))
        assert {r.label for r in recognise(view.groups, model())} == {"unknown"}
        assert names(body, view) == [label]


@pytest.mark.parametrize("name", sorted(STRANGERS))
def test_a_lone_facet_of_a_stranger_stays_alone(name: str) -> None:
    body = STRANGERS[name]
    for index in seen_facets(body, WHERE, 0.35):
        assert names(body, seen((weld([facet_of(body, index)]),))) == ["unknown"]


def test_a_lone_facet_without_anything_in_the_images_stays_alone() -> None:
    assert names(None, seen((weld([facet_of(CUBE, 1)]),))) == ["unknown"]


@pytest.mark.parametrize("eye", ["left", "right"])
@pytest.mark.parametrize("label", ["cube", "triangular_prism", "pentagonal_prism"])
def test_an_outline_in_one_eye_is_enough_to_look_for_the_part(label: str, eye: str) -> None:
    body = KNOWN[label]
    largest = max(seen_facets(body, WHERE, 0.35), key=lambda i: len(body.facets[i]))
    facet = facet_of(body, largest)
    outline = facet.left_px if eye == "left" else facet.right_px
    assert names(body, seen(rejected=(Rejected(outline, eye, "no polygon of the other eye fits"),))) == [label]


@pytest.mark.parametrize("name", sorted(STRANGERS))
def test_an_outline_of_a_stranger_in_one_eye_names_nothing(name: str) -> None:
    body = STRANGERS[name]
    outlines = tuple(Rejected(facet_of(body, i).left_px, "left", "") for i in seen_facets(body, WHERE, 0.35))
    assert names(body, seen(rejected=outlines)) == []


def test_two_facets_of_one_part_found_apart_become_one_part() -> None:
    shown = seen_facets(CUBE, WHERE, 0.35)
    groups = tuple(weld([facet_of(CUBE, i)]) for i in shown)
    assert names(CUBE, seen(groups)) == ["cube"]
