"""What lies there by all looks: names stay, what none names alone many may, names that differ are asked anew."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from daemon import frames
from daemon.arrays import Array
from daemon.pick import fused_objects
from daemon.pick.fused_objects import SAME_PART_MM, fuse_objects, most_informative, outlines_of, untaught_facets
from daemon.pick.looks import Look
from daemon.pick.pose_fusion import Doubt
from daemon.pick.recogniser import ModelRecogniser
from daemon.pick.seen import seen_parts
from daemon.store.library import load_facets
from daemon.vision import facets, geometry
from daemon.vision.facets.many_looks.fusing import FusedLooks
from daemon.vision.geometry import Polyhedron, exact, newell_normal
from daemon.vision.model import learn_solid
from daemon.vision.model.model import empty_model
from daemon.vision.values import UNKNOWN, Part
from tests.fakes import drawn
from tests.fakes.observed_around import looked_at, place
from tests.fakes.rigs import rig

BLOCK = drawn.prism([(-30.0, -20.0), (30, -20), (30, 20), (-30, 20)], 30)
BRACKET = drawn.prism([(-30.0, -25.0), (30, -25), (30, -13), (-18, -13), (-18, 25), (-30, 25)], 40)
CUT = drawn.prism([(-30.0, -20.0), (30, -20), (30, 20), (-15, 20), (-30, 5)], 30)


@pytest.fixture(scope="module")
def recogniser() -> ModelRecogniser:
    model = empty_model(load_facets())
    for label, (corners, rings) in (("block", BLOCK), ("cut", CUT), ("bracket", BRACKET)):
        model = learn_solid(model, drawn.solid(f"{label}.obj", drawn.obj(corners, rings)), label)
    return ModelRecogniser(model, rig())


def look_from(
    recogniser: ModelRecogniser, azimuth_deg: float, elevation_deg: float, seed: int = 0, shape: Any = BLOCK
) -> Look:
    """As much of a look at the block, or another shape, from there as things are made of."""
    at, rng = place(np.radians(azimuth_deg), np.radians(elevation_deg)), np.random.default_rng(seed)
    body = drawn.solid("block.obj", drawn.obj(*shape))
    seen = looked_at(body, at, rng, np.zeros(9))
    parts = tuple(part for group in seen.groups for part in recogniser.recognise(group))
    return as_look(parts, seen.base_from_cyclopean)


def as_look(parts: tuple[Part, ...], world_from_cyclopean: Array) -> Look:
    made: Any = SimpleNamespace(
        scene=SimpleNamespace(parts=parts), world_from_cyclopean=world_from_cyclopean, taken=SimpleNamespace(rig=rig())
    )
    return made


def labels(looks: list[Look], recogniser: ModelRecogniser) -> list[str]:
    return [part.label for part in fuse_objects(looks, recogniser, Doubt())]


def test_what_neither_of_two_looks_names_alone_both_together_do(recogniser: ModelRecogniser) -> None:
    top, side = look_from(recogniser, 90, 88), look_from(recogniser, 90, 3, 1)
    assert [p.named for one in (top, side) for p in seen_parts(one)] == [False, False]
    assert labels([top, side], recogniser) == ["block"]


def test_a_name_is_not_unlearnt_by_a_look_that_shows_less(recogniser: ModelRecogniser) -> None:
    whole, less = look_from(recogniser, 135, 40), look_from(recogniser, 0, 3, 1)
    assert labels([whole], recogniser) == ["block"]
    assert labels([whole, less], recogniser) == ["block"], "the facet that it shows is the block's"


def test_a_facet_with_a_notch_is_its_parts_though_its_middle_lies_outside_it(recogniser: ModelRecogniser) -> None:
    from_above = [look_from(recogniser, 200 + 70 * k, 50, k, BRACKET) for k in range(3)]
    assert any(len(part.facets[0].corners_mm) == 6 for look in from_above for part in look.scene.parts)
    assert labels(from_above, recogniser) == ["bracket"]


def test_names_that_contradict_each_other_are_asked_anew_of_all_facets(recogniser: ModelRecogniser) -> None:
    one, other = look_from(recogniser, 135, 40), look_from(recogniser, 100, 50, 1)
    part = one.scene.parts[0]
    wrong = replace(part, recognition=replace(part.recognition, label="cut"))
    assert labels([as_look((wrong,), one.world_from_cyclopean), other], recogniser) == ["block"]


@pytest.mark.parametrize("label", ["block", "cut"])
def test_of_two_parts_that_would_lie_in_each_other_one_is_there(label: str, recogniser: ModelRecogniser) -> None:
    """A look laid its part so far aside that their middles are apart, and yet half a side of one is the other's."""
    one, other = look_from(recogniser, 135, 40), look_from(recogniser, 100, 50, 1)
    (part,) = other.scene.parts
    aside = frames.rigid(np.eye(3), other.world_from_cyclopean[:3, :3].T @ np.array([SAME_PART_MM + 2.0, 0.0, 0.0]))
    laid = replace(
        part,
        recognition=replace(part.recognition, label=label),
        cyclopean_from_part=aside @ part.cyclopean_from_part,
        fitted_mm=tuple(frames.apply(aside, ring) for ring in part.fitted_mm),
    )
    found = fuse_objects([one, as_look((laid,), other.world_from_cyclopean)], recogniser, Doubt())
    assert [thing.label for thing in found] == ["block"]
    assert np.linalg.norm(found[0].world_from_part[:3, 3] - seen_parts(one)[0].world_from_part[:3, 3]) < 3.0


def test_a_facet_that_one_look_measured_badly_is_no_neighbour_of_the_part_that_it_lies_in(
    recogniser: ModelRecogniser,
) -> None:
    """The first look at a T-nut ran out of time with one facet, wildly off; fused with the next look's it lay tilted in
    the nut, and barred every grasp."""
    whole, less = look_from(recogniser, 135, 40), look_from(recogniser, 0, 3, 1)
    (part,) = seen_parts(less)
    (facet,) = part.facets
    middle, tilt = facet.corners_mm.mean(axis=0), frames.rotation_from_vector(np.array([0.0, np.radians(25.0), 0.0]))
    inward = 6.0 * newell_normal(facet.corners_mm)
    badly = replace(facet, corners_mm=middle - inward + (facet.corners_mm - middle) @ tilt.T)
    off = as_look((replace(part.part, facets=(badly,)),), less.world_from_cyclopean)
    assert labels([whole, off], recogniser) == ["block"]
    outside = replace(badly, corners_mm=badly.corners_mm + 4.0 * inward)
    beside = as_look((replace(part.part, facets=(outside,)),), less.world_from_cyclopean)
    assert labels([whole, beside], recogniser) == ["block", UNKNOWN], "a facet 18 mm before it is another's"


@pytest.fixture(scope="module")
def odd_looks(recogniser: ModelRecogniser) -> list[Look]:
    """Forty, each of which shows the block elsewhere, as cameras do that repeat a picture while the arm goes on."""
    found = []
    for k in range(40):
        seen = look_from(recogniser, 37.0 * k, 3.0 + k, k)
        at = seen.world_from_cyclopean.copy()
        at[:3, 3] += (150.0 * (k % 7), 150.0 * (k // 7), 0.0)
        found.append(as_look(seen.scene.parts, at))
    return found


def test_the_fortieth_look_is_fused_with_no_more_than_the_fifth_was(
    recogniser: ModelRecogniser, odd_looks: list[Look], monkeypatch: pytest.MonkeyPatch
) -> None:
    """What fusing takes grew with the square of the looks: 28 s at the twentieth, in the event loop."""
    fused, tried = list[int](), 0

    def fuse(looks: Any, shared: Array) -> Any:
        fused.append(len(looks))
        return fuse_once(looks, shared)

    def encloses(solid: Any, points: Array) -> Any:
        nonlocal tried
        tried += points.shape[1]
        return encloses_once(solid, points)

    fuse_once, encloses_once = facets.fuse, geometry.encloses
    monkeypatch.setattr(fused_objects, "fuse", fuse)
    monkeypatch.setattr(fused_objects, "encloses", encloses)
    for count in (5, 40):
        fuse_objects(odd_looks[:count], recogniser, Doubt())
    assert fused == [fused_objects.MOST_FUSED] * 2
    assert 0 < tried < 100, "each part is held against the facets near it alone"


def test_the_looks_that_are_fused_are_the_newest_and_those_from_where_least_was_seen(
    recogniser: ModelRecogniser,
) -> None:
    names = [0, 3, 5, 90, 180, 183, 270, 272]
    looks = [look_from(recogniser, azimuth, 40, k) for k, azimuth in enumerate(names)]
    nothing = as_look((), np.eye(4))
    chosen = [
        names[looks.index(look)]
        for look in most_informative([*looks, nothing, looks[1]][-9:], 5)
        if look is not nothing
    ]
    assert {round(name / 90) % 4 for name in chosen} == {0, 1, 2, 3}
    assert 3 in chosen
    assert most_informative(looks[:5], 5) == looks[:5]
    assert most_informative([nothing] * 7, 5)[-1] is nothing


def test_from_where_a_look_was_is_its_cameras_place_and_not_how_they_were_turned(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def look(viewpoint_mm: tuple[float, float, float], roll_deg: float) -> Any:
        turn = np.radians(roll_deg)
        rolled = np.array([[np.cos(turn), -np.sin(turn), 0.0], [np.sin(turn), np.cos(turn), 0.0], [0.0, 0.0, 1.0]])
        return SimpleNamespace(world_from_cyclopean=frames.rigid(rolled, np.array(viewpoint_mm)))

    def seen(of: Any) -> list[Any]:
        return [SimpleNamespace(look=of, centre=np.zeros(3), named=True)]

    monkeypatch.setattr(fused_objects, "seen_parts", seen)
    newest, as_it, elsewhere = look((0, 0, 300), 0.0), look((0, 0, 300), 180.0), look((300, 0, 0), 0.0)
    assert most_informative([as_it, elsewhere, newest], 2) == [elsewhere, newest]


@pytest.mark.parametrize(("names", "stay"), [(("block", "block"), [0]), (("block", "cut"), []), (("cut", "block"), [])])
def test_of_two_named_parts_with_a_facet_in_common_the_larger_stays_where_they_have_one_name(
    names: tuple[str, str], stay: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    one_mm = np.array([[0.0, 0, 0], [10, 0, 0], [0, 10, 0]])
    seen = exact(
        np.concatenate([one_mm + 20.0 * k for k in range(3)]), tuple((3 * k, 3 * k + 1, 3 * k + 2) for k in range(3))
    )
    larger, less = (cast("Any", SimpleNamespace(label=name)) for name in names)
    shares = {id(larger): np.array([1.0, 1.0, 0.0]), id(less): np.array([0.0, 1.0, 0.0])}
    monkeypatch.setattr(fused_objects, "_shares", lambda _, part, __: shares[id(part)])
    fused: Any = SimpleNamespace(polyhedron=seen)
    for parts in ([larger, less], [less, larger]):
        kept = fused_objects.parts_not_overlapping(fused, parts, None)
        assert kept == [[larger, less][k] for k in stay]
    shares[id(less)] = np.array([0.0, 0.0, 1.0])
    assert fused_objects.parts_not_overlapping(fused, [larger, less], None) == [larger, less]


def test_one_look_alone_is_what_it_is(recogniser: ModelRecogniser) -> None:
    look = look_from(recogniser, 0, 3)
    assert [part.part for part in fuse_objects([look], recogniser, Doubt())] == list(look.scene.parts)
    assert fuse_objects([as_look((), np.eye(4))], recogniser, Doubt()) == []
    assert fuse_objects([as_look((), np.eye(4))] * 2, recogniser, Doubt()) == []


def test_where_looks_cannot_be_fused_what_each_says_by_itself_stands(
    recogniser: ModelRecogniser, monkeypatch: pytest.MonkeyPatch
) -> None:
    def of_no_extent(*_: object) -> FusedLooks:
        raise np.linalg.LinAlgError

    monkeypatch.setattr(fused_objects, "fuse", of_no_extent)
    named, nameless = look_from(recogniser, 135, 40), look_from(recogniser, 0, 3, 1)
    assert labels([named, nameless], recogniser) == ["block", "unknown"]
    assert labels([nameless, named], recogniser) == ["block"], "what has no name is the newest look's"
    (newest,) = fuse_objects([named, again := look_from(recogniser, 135, 40, 2)], recogniser, Doubt())
    assert newest.look is again


def test_a_named_part_hides_by_all_its_faces_and_another_by_what_was_seen(recogniser: ModelRecogniser) -> None:
    named, nameless = (
        fuse_objects([look_from(recogniser, *way)], recogniser, Doubt())[0] for way in ((135, 40), (0, 3))
    )
    assert (len(outlines_of(named, recogniser)), len(outlines_of(nameless, recogniser))) == (6, 1)
    placed = np.concatenate(outlines_of(named, recogniser))
    assert placed.max(0) == pytest.approx([30, 20, 15], abs=1.5)
    assert placed.min(0) == pytest.approx([-30, -20, -15], abs=1.5)


def corner_only() -> ModelRecogniser:
    """Who knows three sides of the block that meet in a corner, its upper one among them."""
    whole = drawn.solid("block.obj", drawn.obj(*BLOCK))
    corner = int(np.argmax(whole.corners_mm @ [1.0, 1.0, 1.0]))
    three = [k for k, ring in enumerate(whole.facets) if corner in ring]
    used = sorted({k for facet in three for k in whole.facets[facet]})
    rings = tuple(tuple(used.index(k) for k in whole.facets[facet]) for facet in three)
    types = tuple(whole.types[facet] for facet in three)
    solid = Polyhedron(whole.corners_mm[used], rings, whole.covariance_mm2[used], types)
    return ModelRecogniser(learn_solid(empty_model(load_facets()), solid, "block"), rig())


def test_a_side_that_was_never_taught_is_its_parts_and_no_other_thing() -> None:
    partly = corner_only()
    taught, behind = look_from(partly, 45, 40), look_from(partly, 225, 40, 1)
    assert labels([taught], partly) == ["block"]
    assert labels([taught, behind], partly) == ["block"]


def test_what_stands_flush_beside_a_part_is_another_thing() -> None:
    partly = corner_only()
    one, beside = look_from(partly, 45, 40), look_from(partly, 225, 40, 1)
    moved = frames.rigid(np.eye(3), np.array([-60.0, 0.0, 0.0])) @ beside.world_from_cyclopean
    assert len(fuse_objects([one, as_look(beside.scene.parts, moved)], partly, Doubt())) == 2


@pytest.mark.parametrize(("rises_mm", "sides"), [(-30.0, 1), (30.0, 0), (0.0, 0)], ids=["down", "up", "flat"])
def test_only_what_bends_away_beyond_an_open_edge_is_a_side_never_taught(rises_mm: float, sides: int) -> None:
    top = np.array([[0.0, 0, 0], [40, 0, 0], [40, 40, 0], [0, 40, 0]])
    over = np.array([[40.0 if rises_mm else 80.0, y, rises_mm] for y in (0.0, 40.0)])
    known_side = exact(top, [(0, 1, 2, 3)])
    both = exact(np.vstack([top, over]), [(0, 1, 2, 3), (1, 4, 5, 2)])
    assert len(untaught_facets(both, {0}, known_side, np.eye(4))) == sides
    elsewhere = exact(top - np.array([20.0, 0, 0]), [(0, 1, 2, 3)])
    assert not untaught_facets(both, {0}, elsewhere, np.eye(4))


def test_named_parts_of_looks_without_a_facet_in_common_are_none(recogniser: ModelRecogniser) -> None:
    none = np.zeros((0, 0))
    nothing = FusedLooks((), np.zeros((0, 4, 4)), exact(np.zeros((0, 3)), ()), none, none, np.zeros(0, np.intp), 0.0)
    assert fused_objects.parts_not_overlapping(nothing, [], recogniser) == []


@pytest.mark.parametrize(("rises_mm", "pieces"), [(-30.0, [[0, 1]]), (30.0, [[0], [1]])], ids=["ridge", "hollow"])
def test_facets_that_meet_in_a_hollow_edge_are_also_tried_as_two_things(rises_mm: float, pieces: list[Any]) -> None:
    top = np.array([[0.0, 0, 0], [40, 0, 0], [40, 40, 0], [0, 40, 0]])
    over = np.array([[40.0, y, rises_mm] for y in (0.0, 40.0)])
    both = exact(np.vstack([top, over]), [(0, 1, 2, 3), (1, 4, 5, 2)])
    assert fused_objects.convex_groups(both, [0, 1]) == pieces
