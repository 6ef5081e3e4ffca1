"""A lone facet is no proof, but with the whole outline around it, it is; a part never taught is not named so."""

import importlib
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from daemon import frames
from daemon.store.library import load_facets
from daemon.vision.facets.weld import weld
from daemon.vision.geometry.polyhedron import exact
from daemon.vision.image.both_eyes import open_eyes
from daemon.vision.model.facet_types import type_facet
from daemon.vision.model.merge import MetricModel
from daemon.vision.model.model import empty_model, learn_view
from daemon.vision.recognition.recognise import recognise
from daemon.vision.registration import verify
from daemon.vision.values import FacetView
from tests.worlds import painted
from tests.worlds.painted import paint_pair
from tests.worlds.rigs import rig
from tests.worlds.solids import KNOWN, STRANGERS, measured, pose, view_of

ALIKE = (95.0, 165.0, 165.0, 165.0, 165.0, 165.0, 165.0)
TRIES = 5


@cache
def model():
    """What is known of every part: all of its shape."""
    taught, library = empty_model(load_facets()), load_facets()
    for label, body in KNOWN.items():
        taught = learn_view(taught, view_of(body, pose(np.array([0.6, 0.5, 0.7]), 0.3)), label)
        shape = exact(body.corners_mm, body.facets)
        spread = np.tile(0.01 * np.eye(3), (len(body.corners_mm), 1, 1))
        types = tuple(type_facet(body.corners_mm[r], spread[r], library)[0].name for r in shape.rings)
        known = MetricModel(replace(shape, types=types), (0,))
        taught = replace(taught, metric={**taught.metric, label: known})
    return taught


@pytest.fixture(autouse=True)
def by_the_outline_alone(monkeypatch):
    """No facet is confirmed beside the lone one: its outline must name it; test_verify.py has the rest."""
    module = importlib.import_module("daemon.vision.registration.verify")  # the door shows the function of that name
    monkeypatch.setattr(module, "confirmed_facets", lambda *_: ([], 0.0))


def lone_facets(body, where, rng):
    """Each facet that is well in view, alone, as a stereo pair would measure it."""
    for ring in body.facets:
        corners = frames.apply(where, body.corners_mm)[list(ring)]
        middle = corners.mean(axis=0)
        normal = np.cross(corners - middle, np.roll(corners, -1, axis=0) - middle).sum(axis=0)
        if normal @ middle < -0.3 * np.linalg.norm(normal) * np.linalg.norm(middle):
            facet = measured(corners, rng, 0.5)
            px = [eye.project(facet.corners_mm) for eye in (rig().left, rig().right)]
            yield replace(facet, left_px=px[0], right_px=px[1])


def found_from(facet, eyes):
    """What becomes of a view in which only this facet was found."""
    view = FacetView((weld([facet]),), (), (), (), 2.0)
    return verify(recognise(view.groups, model()), view, model(), eyes)[0]


def names(body, seed):
    """What each lone facet of some views is taken for."""
    rng, given = np.random.default_rng(seed), []
    for _ in range(TRIES):
        view = rng.normal(size=3)
        view[2] = abs(view[2]) + 0.3
        where = pose(view / np.linalg.norm(view), rng.uniform(-3, 3), 330.0)
        eyes = open_eyes(*paint_pair([(body, where)], rng), rig())
        for facet in lone_facets(body, where, rng):
            given += [r.label if r.named else None for r in found_from(facet, eyes)]
    return given


@pytest.mark.slow
@pytest.mark.parametrize("label", KNOWN)
@pytest.mark.parametrize("greys", [painted.GREYS, ALIKE], ids=["told apart", "sides alike"])
def test_a_lone_facet_and_the_outline_around_it_name_a_part(monkeypatch, label, greys):
    monkeypatch.setattr(painted, "GREYS", greys)
    given = names(KNOWN[label], seed=1)
    assert set(given) <= {label, None}
    assert given.count(label) > 0.6 * len(given)


@pytest.mark.parametrize("name", STRANGERS)
@pytest.mark.parametrize("greys", [painted.GREYS, ALIKE], ids=["told apart", "sides alike"])
def test_a_part_never_taught_is_not_named_by_its_edges(monkeypatch, name, greys):
    monkeypatch.setattr(painted, "GREYS", greys)
    assert set(names(STRANGERS[name], seed=2)) == {None}


def test_what_the_outline_proves_says_so_with_its_pose():
    where = pose(np.array([0.75, 0.25, 0.6]), 0.3, 330.0)
    body = KNOWN["pentagonal_prism"]
    eyes = open_eyes(*paint_pair([(body, where)], np.random.default_rng(3)), rig())
    facet = next(lone_facets(body, where, np.random.default_rng(4)))
    (one,) = found_from(facet, eyes)
    told = one.part.recognition
    assert (told.label, told.confidence, told.candidates) == ("pentagonal_prism", 0.9, ("pentagonal_prism",))
    assert told.reason.endswith("% of its outline lies where its facets say")
    placed = frames.apply(one.part.cyclopean_from_part, body.corners_mm)
    apart = np.linalg.norm(placed[:, None] - frames.apply(where, body.corners_mm)[None], axis=2).min(1)
    assert apart.max() < 3.0
    assert one.part.facets[0].type in model().metric["pentagonal_prism"].solid.types
