"""Two parts of one shape are told apart by how round their corners are; where these do not tell, neither is named."""

import numpy as np
import pytest

from daemon.store.library import load_facets
from daemon.vision.evidence import by_rounding, counter_evidence
from daemon.vision.evidence.by_rounding import BorderSeen, borders_seen, nats_of, rounded_alike
from daemon.vision.evidence.corner_rounding import bends, squared
from daemon.vision.evidence.hole_rims import of_its_size
from daemon.vision.geometry import exact
from daemon.vision.image import open_stereo
from daemon.vision.look import look
from daemon.vision.model import empty_model, learn_solids
from tests.bench.rounding import fitted, in_code, read
from tests.bench.simulated_looks import true_rig
from tests.fakes.holed import rounded_pair
from tests.fakes.photographed import cell, photograph
from tests.fakes.solids import KNOWN

RADIUS_MM = 6.0


@pytest.fixture(scope="module")
def pair():
    return rounded_pair(RADIUS_MM, 4)


@pytest.fixture(scope="module")
def shown(pair):
    """Each of the pair on the table."""
    return [photograph(p.shape, np.random.default_rng([4, k]), distance_mm=(250.0, 280.0)) for k, p in enumerate(pair)]


def pose_of(part, photo):
    shift = np.eye(4)
    shift[:3, 3] = (part.shape.surface.corners_mm - part.drawing.surface.corners_mm).mean(0)
    return photo.cyclopean_from_part @ shift


def named(pair, photo):
    model = learn_solids(empty_model(load_facets()), [(p.label, p.drawing.solid, p.label) for p in pair])
    scene = look(photo.left, photo.right, true_rig(cell()), model)
    return [part for part in scene.parts if part.named], scene


def test_rounded_corners_are_found_on_a_solid_and_made_sharp(pair):
    sharp, rounded = (part.drawing.solid for part in pair)
    of_rounding = [bend for bend in bends(rounded) if len(bend.run) > 1]
    assert len(of_rounding) == 8
    assert [bend.tangent_mm for bend in of_rounding] == pytest.approx([RADIUS_MM] * 8, abs=0.5)
    assert [bend.stay_mm for bend in of_rounding] == pytest.approx([RADIUS_MM * (np.sqrt(2) - 1)] * 8, abs=0.2)
    assert squared(sharp) is sharp
    assert len(squared(rounded).corners_mm) == 8
    assert len(rounded_alike(sharp, rounded)) == 4
    assert not len(rounded_alike(sharp, sharp))


def test_a_part_is_held_against_taught_parts_with_as_many_corners_and_facets_alone(pair):
    known = {name: exact(body.corners_mm, body.facets) for name, body in KNOWN.items()}
    taught = tuple(squared(solid) for solid in (*(part.drawing.solid for part in pair), *known.values()))
    assert of_its_size(taught[1], taught) == [0, 1, 2 + list(KNOWN).index("cube")]
    assert of_its_size(known["pyramid"], taught[:2]) == []


@pytest.mark.parametrize("lies", [0, 1])
def test_borders_speak_for_the_part_that_is_there(pair, shown, lies):
    images = open_stereo(shown[lies].left, shown[lies].right, true_rig(cell()))
    own, other = (pair[k].drawing.solid for k in (lies, 1 - lies))
    pose = pose_of(pair[lies], shown[lies])
    for one, theirs, sign in ((own, other, 1), (other, own, -1)):
        borders = borders_seen(one, theirs, np.eye(4), pose, images)
        assert len(borders) >= 4
        assert sign * nats_of(borders) > 2.2


@pytest.mark.parametrize("lies", [0, 1])
def test_a_part_is_named_by_its_corners(pair, shown, lies):
    found, _ = named(pair, shown[lies])
    assert [part.recognition.label for part in found] == [pair[lies].label]
    truth = pose_of(pair[lies], shown[lies])[:3, 3]
    assert np.linalg.norm(found[0].cyclopean_from_part[:3, 3] - truth) < 1.0


def test_a_look_whose_corners_do_not_tell_says_which_two(pair, shown, monkeypatch):
    monkeypatch.setattr(by_rounding, "nats_of", lambda borders: 0.5)
    found, scene = named(pair, shown[0])
    assert not found
    assert any("sharp or rounded" in part.recognition.reason for part in scene.parts)


def test_of_some_looks_the_corners_alone_tell_a_rounded_part(pair, monkeypatch):
    photo = photograph(pair[1].shape, np.random.default_rng([9, 1]), distance_mm=(250.0, 280.0))
    assert [part.recognition.label for part in named(pair, photo)[0]] == ["rounded"]
    monkeypatch.setattr(counter_evidence, "resolved_by_rounding", lambda one, *_: one)
    assert not named(pair, photo)[0]


def test_a_border_between_both_says_nothing_and_one_at_either_speaks_for_that():
    assert nats_of([]) == 0.0
    assert nats_of([BorderSeen(1.75, 1.0, 2.5, 1.2)]) == pytest.approx(0.0)
    assert nats_of([BorderSeen(1.1, 1.0, 2.5, 1.2)]) == pytest.approx(-nats_of([BorderSeen(1.1, 2.5, 1.0, 1.2)]))
    assert nats_of([BorderSeen(1.1, 1.0, 2.5, 1.2)]) > 2.2
    assert abs(nats_of([BorderSeen(1.1, 1.0, 1.2, 1.2)])) < 1.0


def test_the_constants_are_those_of_the_kept_table():
    assert in_code() == pytest.approx(fitted(read()), abs=0.05)


def test_a_look_that_shows_no_corner_that_tells_says_which_two(pair, shown, monkeypatch):
    monkeypatch.setattr(by_rounding, "borders_seen", lambda *_: [])
    found, scene = named(pair, shown[0])
    assert not found
    assert any("no visible corner distinguishes them" in part.recognition.reason for part in scene.parts)
    alone = learn_solids(empty_model(load_facets()), [(pair[0].label, pair[0].drawing.solid, pair[0].label)])
    assert [p.recognition.label for p in look(shown[0].left, shown[0].right, true_rig(cell()), alone).parts] == [
        "sharp"
    ]
