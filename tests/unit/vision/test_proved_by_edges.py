"""A lone facet is no proof, but with the whole outline around it, it is; a part never taught is not named so."""

import numpy as np
import pytest

from daemon import frames
from daemon.vision.geometry.polyhedron import exact
from daemon.vision.registration.edge_pose import open_eyes
from daemon.vision.registration.proving import proved
from tests.worlds import painted
from tests.worlds.painted import paint_pair
from tests.worlds.rigs import rig
from tests.worlds.solids import KNOWN, STRANGERS, measured, pose

ALIKE = (95.0, 165.0, 165.0, 165.0, 165.0, 165.0, 165.0)
SHAPES = {label: exact(body.corners_mm, body.facets) for label, body in KNOWN.items()}
TRIES = 5


def lone_facets(body, where, rng):
    """Each facet that is well in view, alone, as a stereo pair would measure it."""
    for ring in body.facets:
        corners = frames.apply(where, body.corners_mm)[list(ring)]
        middle = corners.mean(axis=0)
        normal = np.cross(corners - middle, np.roll(corners, -1, axis=0) - middle).sum(axis=0)
        if normal @ middle < -0.3 * np.linalg.norm(normal) * np.linalg.norm(middle):
            yield measured(corners, rng, 0.5)


def names(body, seed):
    """What each lone facet of some views is taken for."""
    rng, found = np.random.default_rng(seed), []
    for _ in range(TRIES):
        view = rng.normal(size=3)
        view[2] = abs(view[2]) + 0.3
        where = pose(view / np.linalg.norm(view), rng.uniform(-3, 3), 330.0)
        eyes = open_eyes(*paint_pair([(body, where)], rng), rig())
        found += [proved([facet], SHAPES, eyes) for facet in lone_facets(body, where, rng)]
    return [None if one is None else one.label for one in found]


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
