"""Holes as evidence: rims seen, missing, of another size or place; turns and twins that only a hole tells apart."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from daemon import frames
from daemon.arrays import Array
from daemon.store.library import load_facets
from daemon.vision.evidence import hole_rims
from daemon.vision.evidence.counter_evidence import OTHER_HOLE
from daemon.vision.evidence.hole_rims import HIDDEN_NATS, by_holes, hole_nats, other_hole_nats
from daemon.vision.evidence.photo_consistency import bare_places
from daemon.vision.geometry import Hole, Polyhedron, exact
from daemon.vision.image import StereoImages, open_stereo
from daemon.vision.look import look
from daemon.vision.model import Model, empty_model, learn_solids, symmetries, turns_but_for_holes
from daemon.vision.refine import rim_samples
from daemon.vision.refine.rim_samples import rim_places, rims_seen
from daemon.vision.values import Part
from tests.bench.holes import fitted, in_code, read
from tests.fakes.drawn import block
from tests.fakes.painted import paint_pair
from tests.fakes.rigs import rig
from tests.fakes.solids import pose

PLAIN = block(64.0, 44.0, 26.0)
TOP = int(np.argmax(np.linalg.norm(PLAIN.areas_mm2, axis=1)))
BOTTOM = int(np.argmin(PLAIN.normals @ PLAIN.normals[TOP]))
WHERE = pose(np.array([-0.5, 0.3, 0.8]), 0.3, 330.0)
TURNS = 2 * np.pi * np.arange(48) / 48


def bored(along_mm: float, radius_mm: float = 7.0) -> Polyhedron:
    """The block with a bore square to its largest faces that lies so far from their middles."""
    x, y = PLAIN.flat_from_solid[TOP, :3, :3][:2]
    middle = PLAIN.centres_mm[TOP] + along_mm * x
    ring = middle + radius_mm * (np.cos(TURNS)[:, None] * x + np.sin(TURNS)[:, None] * y)
    through = (PLAIN.centres_mm[BOTTOM] - PLAIN.centres_mm[TOP]) @ PLAIN.normals[TOP] * PLAIN.normals[TOP]
    return replace(PLAIN, holes=(Hole(TOP, ring), Hole(BOTTOM, ring + through)))


def facing() -> Array:
    """A pose in which the largest face looks at both cameras."""
    for turn in symmetries(block(50.0, 50.0, 50.0)).motions:
        if PLAIN.facing(WHERE @ turn)[TOP] > 0.5:
            return WHERE @ turn
    raise AssertionError("no turn shows it")


@cache
def images_of(along_mm: float | None, radius_mm: float = 7.0, seed: int = 1) -> StereoImages:
    """The block, bored or not, in a painted pair."""
    solid = PLAIN if along_mm is None else bored(along_mm, radius_mm)
    return open_stereo(*paint_pair([(solid, facing())], np.random.default_rng(seed), rig()), rig())


def test_a_hole_that_is_there_speaks_for_the_part_and_one_that_is_not_against_it() -> None:
    solid = bored(14.0)
    assert hole_nats(solid, facing(), images_of(14.0)) > 4.0
    assert hole_nats(solid, facing(), images_of(None)) == HIDDEN_NATS
    assert hole_nats(PLAIN, facing(), images_of(14.0)) == 0.0


def test_a_pose_that_is_off_by_a_pixel_changes_little() -> None:
    off = facing()
    off[:3, 3] += [0.4, -0.3, 1.0]
    assert hole_nats(bored(14.0), off, images_of(14.0)) > 4.0


@pytest.mark.parametrize("moved_mm", [-28.0, -5.0, 5.0])
def test_a_hole_in_another_place_is_not_this_one(moved_mm: float) -> None:
    assert hole_nats(bored(14.0 + moved_mm), facing(), images_of(14.0)) < 0.0


@pytest.mark.parametrize("factor", [0.9, 1.1])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_tenth_of_a_radius_is_told(factor: float, seed: int) -> None:
    images = images_of(14.0, 7.0, seed)
    right, wrong = (hole_nats(bored(14.0, radius), facing(), images) for radius in (7.0, 7.0 * factor))
    assert right > wrong + 3.0


@pytest.mark.parametrize("factor", [0.93, 1.07])
def test_a_rim_of_another_size_speaks_for_another_size_and_a_missing_one_does_not(factor: float) -> None:
    assert other_hole_nats(bored(14.0, 7.0 * factor), facing(), images_of(14.0), 0.25) > OTHER_HOLE
    assert other_hole_nats(bored(14.0), facing(), images_of(14.0), 0.25) < 0.5
    assert other_hole_nats(bored(14.0), facing(), images_of(None), 0.25) == 0.0


def test_how_much_larger_a_hole_is_comes_out_in_pixels() -> None:
    ((one, _),) = rims_seen(bored(14.0, 6.5), facing(), images_of(14.0, 7.0), 0.25)
    px_per_mm = 700 / np.linalg.norm(frames.apply(facing(), bored(14.0).holes[0].ring_mm).mean(0))
    assert one.larger_px == pytest.approx(0.5 * px_per_mm, abs=0.3)


def test_a_rim_says_where_it_is_beside_where_the_pose_has_it_and_how_that_moves_with_the_pose() -> None:
    solid, off = bored(14.0), facing()
    off[:3, 3] += [0.5, -0.4, 0.0]
    before, after = (rim_places(solid, one, images_of(14.0), 0.25) for one in (facing(), off))
    assert len(before) == len(after) == 2  # in either camera
    for here, there in zip(before, after, strict=True):
        moved = here.off_px - there.off_px
        assert moved == pytest.approx(here.jacobian @ [0.5, -0.4, 0.0, 0.0, 0.0, 0.0], abs=0.3)
        assert np.linalg.norm(moved) > 0.8


def test_a_rim_of_another_size_holds_no_pose() -> None:
    assert rim_places(bored(14.0, 6.0), facing(), images_of(14.0), 0.25) == []


def bare(solid: Polyhedron) -> list[bool]:
    """Of three places on the block's top, just in the bore, just beside it and far from it, which show the face to
    both."""
    middle, rim = bored(14.0).holes[0].ring_mm.mean(0), bored(14.0).holes[0].ring_mm[0]
    inside, beside = (middle + share * (rim - middle) for share in (0.9, 1.15))
    far = 2 * PLAIN.centres_mm[TOP] - middle
    return bare_places(solid, TOP, np.stack([inside, beside, far]), facing(), images_of(None)).tolist()


def test_print_is_not_looked_for_in_a_hole_nor_beside_its_rim() -> None:
    assert bare(bored(14.0)) == [False, False, True]
    assert bare(replace(bored(14.0), holes=bored(14.0).holes[1:])) == [True, True, True]


def test_print_is_not_looked_for_where_the_part_itself_is_before_the_face() -> None:
    rim = bored(14.0).holes[0].ring_mm
    lid = rim.mean(0) + 1.5 * (rim[::12] - rim.mean(0)) + 3.0 * PLAIN.normals[TOP]  # as a boss or a rib is
    assert bare(replace(PLAIN, covers=lid[None])) == [False, False, True]


def test_a_hole_too_small_or_out_of_view_says_nothing() -> None:
    assert hole_nats(bored(14.0, 1.0), facing(), images_of(None)) == 0.0
    away = replace(bored(14.0), holes=bored(14.0).holes[1:])
    assert hole_nats(away, facing(), images_of(None)) == 0.0
    aside = facing()
    aside[0, 3] += 400.0
    assert hole_nats(bored(14.0), aside, images_of(None)) == 0.0


def test_a_rim_that_passes_beside_the_camera_says_nothing_and_takes_no_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    """Projected from behind the image plane it may be millions of px long: a look took gigabytes."""
    places, along, rng = list[int](), rim_samples.places_along_rim, np.random.default_rng(0)

    def counted(hole: Hole, ring_px: Array) -> Array:
        found = along(hole, ring_px)
        places.append(len(found))
        return found

    monkeypatch.setattr(rim_samples, "places_along_rim", counted)
    for depth_mm in (0.5, 2.0, 6.0, 12.0, 20.0, 40.0):
        for _ in range(30):
            near = facing()
            near[:3, 3] = [*rng.uniform(-30, 30, 2), depth_mm]
            near[:3, :3] = near[:3, :3] @ frames.rotation_from_vector(rng.normal(0, 0.8, 3))
            hole_nats(bored(14.0), near, images_of(None))
    assert max(places, default=0) < 20_000


def test_a_missing_rim_says_no_more_than_how_seldom_one_is_hidden(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hole_rims, "HIDDEN_NATS", -50.0)
    assert hole_nats(bored(14.0), facing(), images_of(None)) < -10.0


def model(**parts: Polyhedron) -> Model:
    return learn_solids(empty_model(load_facets()), [(label, solid, label) for label, solid in parts.items()])


def named(cameras_along_mm: float | None, known: Model) -> list[Part]:
    pair = [view.grey.astype(np.uint8) for view in images_of(cameras_along_mm).views]
    return [part for part in look(pair[0], pair[1], rig(), known).parts if part.named]


def test_of_two_parts_of_one_shape_the_one_is_named_whose_hole_is_there() -> None:
    known = model(plain=PLAIN, near=bored(8.0), far=bored(20.0))
    for label, along_mm in (("plain", None), ("near", 8.0), ("far", 20.0)):
        assert [part.recognition.label for part in named(along_mm, known)] == [label]


def test_a_part_whose_hole_has_another_size_has_no_name() -> None:
    assert named(0.0, model(one=bored(0.0, 7.0)))
    assert not named(0.0, model(one=bored(0.0, 6.4)))


def test_a_hole_that_may_lie_on_the_far_side_leaves_both_names_open() -> None:
    known = model(plain=PLAIN, blind=replace(PLAIN, holes=bored(14.0).holes[:1]))
    assert named(None, known) == []
    assert [part.recognition.label for part in named(14.0, known)] == ["blind"]


def off_mm(solid: Polyhedron, cyclopean_from_part: Array, along_mm: float) -> float:
    """How far the nearest hole of a part is from the one that is painted."""
    painted = frames.apply(facing(), bored(along_mm).holes[0].ring_mm).mean(0)
    return min(
        float(np.linalg.norm(frames.apply(cyclopean_from_part, one.ring_mm).mean(0) - painted)) for one in solid.holes
    )


def test_a_half_turn_that_only_the_hole_tells_is_told() -> None:
    known = model(bored=bored(14.0))
    (part,) = named(14.0, known)
    assert off_mm(known.metric["bored"].solid, part.cyclopean_from_part, 14.0) < 1.0


def test_a_twin_and_a_turn_are_found_from_the_wrong_one() -> None:
    known = model(near=bored(8.0), far=bored(20.0))
    images = images_of(20.0)
    solid = known.metric["near"].solid
    drawn_from_part = _laid(solid)
    for turn in symmetries(replace(solid, holes=())).motions:
        found = by_holes("near", facing() @ drawn_from_part @ turn, known, images)
        assert found.label == "far"
        assert found.apart > 3.0
        assert off_mm(known.metric["far"].solid, found.pose, 20.0) < 1.0


def _laid(solid: Polyhedron) -> Array:
    """drawn_from_part (4, 4) of a part in its own frame."""
    here, there = (s.flat_from_solid[TOP] for s in (PLAIN, solid))
    return np.asarray(frames.inverse(here) @ there)


def test_the_constants_are_those_that_the_bench_makes_of_what_is_kept() -> None:
    found, code = fitted(read()), in_code()
    assert pytest.approx(found.SHOWS, abs=0.01) == code.SHOWS
    assert pytest.approx(found.BY_RIM, abs=0.1) == code.BY_RIM
    assert pytest.approx(found.HIDDEN_NATS, abs=0.25) == code.HIDDEN_NATS
    assert pytest.approx(found.MOST_NATS, abs=0.25) == code.MOST_NATS
    assert code.RADIUS_PX >= found.RADIUS_PX


def test_turns_but_for_holes_are_all_turns_of_the_shape_one_of_a_kind() -> None:
    solid = bored(14.0)
    assert len(symmetries(solid).motions) == 2
    assert len(turns_but_for_holes(solid)) == 2
    assert len(turns_but_for_holes(PLAIN)) == 1
    assert np.allclose(turns_but_for_holes(solid)[0], np.eye(4))


def test_the_floor_of_a_blind_bore_belongs_to_the_bore_and_hinders_no_turn() -> None:
    solid = bored(14.0)
    (hole, *_) = solid.holes
    normal, middle = solid.normals[hole.facet], hole.ring_mm.mean(0)
    floor = middle + 1.07 * (hole.ring_mm[::6] - middle) - 10 * normal
    places = range(len(solid.corners_mm), len(solid.corners_mm) + len(floor))
    blind = exact(np.vstack([solid.corners_mm, floor]), [*solid.facets, places])
    assert len(turns_but_for_holes(replace(blind, holes=(hole,)))) == len(symmetries(PLAIN).motions) == 4
    assert len(turns_but_for_holes(blind)) == 1  # a facet that no hole is around tells the turns apart
