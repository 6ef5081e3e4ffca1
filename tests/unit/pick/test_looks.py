"""On the approach only the expected part is looked for, by its edges; the rest is looked for when it counts."""

import asyncio
import pickle
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from daemon import frames
from daemon.arm.belief import Reading
from daemon.arm.settling import Settling
from daemon.events.codes import BY_MEASURE
from daemon.pick import looks
from daemon.pick.looks import (
    CapturedPair,
    Expected,
    MisleadingImagesError,
    capture_pair,
    log_look,
    take_look,
    tracked_json,
    whole_look,
)
from daemon.pick.pose_fusion import Doubt
from daemon.vision.health.examination import Finding
from daemon.vision.refine.following import Fit
from tests.fakes.fake_cell import TruthRecogniser, World, build, rig, shape_of

POSE = frames.rigid(frames.rotation_from_vector(np.array([2.6, 0.4, 0.3])), np.array([5.0, -8.0, 300.0]))
FIT = Fit(POSE, np.diag([0.1, 0.1, 0.3, 1e-5, 1e-5, 1e-5]), 0.1, 9)


def expected(fit, label="pyramid"):
    return Expected(label, 0.9, shape_of(label), lambda taken: fit)


def taken(expect):
    """The look, the same with everything looked for, and the first one's record."""
    world = World(np.random.default_rng(0))
    world.put("cube", 520, 0, 0.3)
    cell, recogniser = build(world), TruthRecogniser(world)

    async def story():
        reading = Reading(world.at, np.zeros(6))
        look = await take_look(
            cell, recogniser, await capture_pair(cell, reading, 0.0, Settling()), 0.0, -300.0, expect
        )
        return look, await whole_look(cell.compute, recogniser, look)

    look, whole = asyncio.run(story())
    log_look(cell, recogniser, look, cycle=1, stop=2, purpose="approach", expected=expect)
    return look, whole, world.said("look")[-1]


def test_what_was_expected_and_found_is_all_that_is_looked_for_until_the_whole_look_is_asked_for():
    look, whole, record = taken(expected(FIT))
    assert look.tracked is FIT
    assert not look.scene.parts
    assert np.isnan(look.epipolar_px)
    assert whole.tracked is None
    assert [part.recognition.label for part in whole.scene.parts] == ["cube"]
    assert whole.taken_s == look.taken_s
    assert record["whole"] is False
    assert [part["label"] for part in record["scene"]["parts"]] == ["pyramid"]


@pytest.mark.parametrize("fit", [FIT, None], ids=["followed", "whole"])
def test_how_sharp_a_pair_is_and_how_far_its_rows_are_off_is_judged_where_everything_was_looked_for(
    fit: Fit | None, monkeypatch: pytest.MonkeyPatch
):
    blurred, off = Finding("motion", "left", 9.0, False), Finding("epipolar", "pair", 4.0, False)
    monkeypatch.setattr(looks, "sharpness", lambda _: (blurred,))
    monkeypatch.setattr(looks, "drift", lambda _: (off,))
    look, *_ = taken(expected(fit))
    assert [finding for finding in look.health if not finding.good] == ([] if fit else [blurred, off])


def test_where_the_expected_is_not_found_everything_is_looked_for():
    look, whole, record = taken(expected(None))
    assert look.tracked is None
    assert whole is look
    assert record["whole"] is True
    assert record["scene"]["parts"] == ["cube"]
    assert not {"unmatched", "nothing"} & set(record["scene"]), "why nothing was found is logged where nothing was"


def test_a_look_is_from_where_the_two_cameras_are():
    look, *_ = taken(None)
    for viewpoint, camera in zip(look.viewpoints, (look.taken.rig.left, look.taken.rig.right), strict=True):
        middle = frames.apply(look.world_from_cyclopean, camera.cyclopean_from_camera[None, :3, 3])
        np.testing.assert_allclose(viewpoint, middle[0])


def test_a_look_that_followed_a_part_hints_at_nothing_of_the_calibration():
    look, _, record = taken(expected(FIT))
    assert np.isinf(look.clue.sigma).all()
    assert not [name for name in record["health"] if name.startswith(("pitch", "roll", "vergence"))]


def test_a_part_found_again_is_told_as_the_facets_that_face_the_cameras():
    told: dict[str, Any] = tracked_json(expected(FIT, "cube"), FIT, rig())
    assert told["label"] == "cube"
    assert 1 <= len(told["facets"]) <= 3
    for facet in told["facets"]:
        corners = facet["corners_mm"]
        np.testing.assert_allclose(rig().left.project(corners), facet["left_px"])
        np.testing.assert_allclose(rig().right.project(corners), facet["right_px"])
        assert np.cross(*np.diff(corners[:3], axis=0)) @ corners.mean(axis=0) < 0
    np.testing.assert_array_equal(told["cyclopean_from_part"], POSE)
    np.testing.assert_array_equal(told["covariance"], FIT.covariance)


def test_images_that_mislead_are_told_with_every_finding_and_the_first_ones_cause():
    findings = [Finding("frozen", "left", 3.0, False), Finding("darkness", "right", 12.0, False)]
    error = pickle.loads(pickle.dumps(MisleadingImagesError(findings)))  # as it comes out of a worker process
    assert error.code is BY_MEASURE["frozen"] is not BY_MEASURE["darkness"]
    assert error.findings == ("frozen left", "darkness right")
    assert str(error) == "; ".join(map(str, findings))


def test_every_measure_of_a_look_is_logged_and_what_is_out_of_order_in_words():
    look, _, _ = taken(None)
    world = World(np.random.default_rng(0))
    good, bad = Finding("darkness", "left", 80.0, True), Finding("darkness", "right", 12.0, False)
    log_look(build(world), TruthRecogniser(world), replace(look, health=(good, bad)), cycle=1, stop=2, purpose="survey")
    health = world.said("look")[-1]["health"]
    assert (health["darkness_left"], health["darkness_right"]) == (80.0, 12.0)
    assert health["findings"] == {"darkness right": str(bad)}


@pytest.mark.parametrize("again", [False, True], ids=["another pair", "the same recorded pair"])
def test_a_pair_that_misleads_makes_no_look_and_one_that_is_shown_again_is_not_called_frozen(
    again: bool, monkeypatch: pytest.MonkeyPatch
):
    images, before = (np.zeros((4, 4)), np.ones((4, 4))), (np.zeros((4, 4)), np.ones((4, 4)))
    earlier = images if again else before
    pictures = SimpleNamespace(left=SimpleNamespace(pixels=earlier[0]), right=SimpleNamespace(pixels=earlier[1]))
    held_against = []

    def examine(_, than, *__, **___):
        held_against.append(than)
        return (Finding("frozen", "left", 3.0, than is None),)

    monkeypatch.setattr(looks, "examine", examine)
    monkeypatch.setattr(looks, "misleading", lambda health: [one for one in health if not one.good])
    one: Any = SimpleNamespace(before=pictures, images=images, rig=rig())
    if again:
        assert [finding.good for finding in looks.pair_health(one)] == [True]
    else:
        with pytest.raises(MisleadingImagesError, match="left"):
            looks.pair_health(one)
    assert (held_against[0] is None) is again


@pytest.mark.parametrize("to_the_right", [True, False])
def test_of_two_pictures_of_one_camera_the_left_is_whichever_was_taken_to_the_left(to_the_right: bool):
    """On a wrist that is turned, so that the camera's right is along none of the world's axes."""
    world = World(np.random.default_rng(0))
    cell, turned = build(world), frames.rotation_from_vector(np.array([0.3, 2.0, 1.1]))
    object.__setattr__(cell, "alone", "left")
    start = frames.rigid(turned, np.array([400.0, 100.0, 0.0]))
    camera = start @ cell.rig.left.cyclopean_from_camera
    way = camera[:3, :3] @ [60.0 if to_the_right else -60.0, 40.0, -50.0]
    then = frames.rigid(turned, start[:3, 3] + way)

    def picture(name: str, settled_s: float, at: np.ndarray) -> CapturedPair:
        pair: Any = SimpleNamespace(left=name, right="of nobody")
        return CapturedPair(pair, pair, Reading(at, np.zeros(6)), settled_s, cell.rig, at)

    pair: Any = looks.moved_pair_of(cell, picture("first", 0.4, start), picture("second", 0.7, then), Doubt())
    order = ("first", "second") if to_the_right else ("second", "first")
    assert (pair.pictures.left, pair.pictures.right) == (pair.before.left, pair.before.right) == order
    assert pair.settled_s == 0.7
    assert pair.reading.world_from_tool is then
    places = [start, then] if to_the_right else [then, start]
    for place, one in zip(places, (pair.rig.left, pair.rig.right), strict=True):
        seen_from = pair.world_from_cyclopean @ one.cyclopean_from_camera
        np.testing.assert_allclose(seen_from, place @ cell.rig.left.cyclopean_from_camera, atol=1e-9)
    assert np.array_equal(pair.moved.left, pair.rig.left.cyclopean_from_camera)
    assert np.array_equal(pair.moved.right, pair.rig.right.cyclopean_from_camera)
