"""Facets with arcs in their outline, from painted pairs: found, measured, typed, recalled as drawings have them."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from daemon import frames
from daemon.arrays import Array
from daemon.store.library import load_facets
from daemon.vision.facets import find_facets
from daemon.vision.facets.one_look.arc_rings import is_hole_in, round_facets
from daemon.vision.geometry import Hole, Polyhedron, circle_along, exact, newell_normal
from daemon.vision.image import StereoImages, open_stereo
from daemon.vision.model import empty_model, learn_view, symmetries, types_of
from daemon.vision.recognition import recognise_groups
from daemon.vision.settings import VisionSettings
from daemon.vision.values import Facet, FacetView
from tests.fakes.drawn import block, obj, prism
from tests.fakes.machined import drawing, drawing_from_taught, taught_from
from tests.fakes.painted import paint_pair
from tests.fakes.rigs import rig
from tests.fakes.solids import KNOWN, Body, pose

RADIUS, LONG, HIGH = 16.0, 24.0, 20.0
QUARTERS = [np.linalg.matrix_power(np.array([[0.0, 1.0], [-1.0, 0.0]]), k) for k in range(4)]
TOWARDS = pose(np.array([-0.45, -0.5, 0.75]), 0.9, 300.0)


def ring(kind: str) -> list[tuple[float, float]]:
    """The outline of a face, mm, anticlockwise: a disc, a D, a half disc with a block behind it, a stadium, a block of
    which one edge, and one of which all four, are rounded."""
    sweep = {"disc": 2 * np.pi, "knob": 1.7 * np.pi, "corner": np.pi / 2, "square": np.pi / 2}.get(kind, np.pi)
    turns = np.linspace(0, sweep, 49)[: 48 if kind == "disc" else 49]
    around = RADIUS * np.column_stack([np.cos(turns), np.sin(turns)])
    corners = [around @ turned + LONG / 2 * (np.array([1.0, 1.0]) @ turned) for turned in QUARTERS]
    if kind == "square":
        return [(float(x), float(y)) for x, y in np.concatenate(corners)]
    rest = {
        "half": [[-RADIUS, -LONG], [RADIUS, -LONG]],
        "stadium": [*(-around - [0.0, LONG])],
        "corner": [[-LONG, RADIUS], [-LONG, -LONG], [RADIUS, -LONG]],
    }.get(kind, [])
    return [(float(x), float(y)) for x, y in [*around, *rest]]


@cache
def flat_faces(kind: str) -> Polyhedron:
    """Top and plane walls of a prism of that outline, in the frame of its drawing."""
    corners, rings = prism(ring(kind), HIGH)
    whole = exact(np.array(corners), rings)
    longest = np.array([np.ptp(whole.corners_mm[list(one)], axis=0).max() for one in rings])
    wide = [k for k, one in enumerate(rings) if len(one) > 4 or longest[k] > HIGH + 1e-6]
    return whole.only(wide)


def painted(kind: str, where: Array = TOWARDS) -> StereoImages:
    """Both pictures of it."""
    return open_stereo(*paint_pair([(flat_faces(kind), where)], np.random.default_rng(4), rig()), rig())


@cache
def view(kind: str) -> FacetView:
    """The facets of it that are seen."""
    left, right = (camera.grey for camera in painted(kind).views)
    return find_facets(left, right, rig())


def true_face(kind: str) -> Array:
    """(N, 3) the border of the face with arcs that both cameras have in view, cyclopean."""
    solid = flat_faces(kind)
    facing = solid.facing(TOWARDS) * np.array([len(one) > 4 for one in solid.facets])
    return frames.apply(TOWARDS, solid.corners_mm[list(solid.facets[int(facing.argmax())])])


def with_arcs(kind: str) -> tuple[Facet, ...]:
    return tuple(f for group in view(kind).groups for f in group.facets if f.arcs)


@pytest.mark.parametrize(("kind", "sides", "arcs", "name"), [
    ("disc", 12, 1, "disc"), ("knob", 11, 1, "d_shape_300"), ("half", 9, 1, "rectangle_with_a_round_end"),
    ("stadium", 14, 2, "stadium"), ("corner", 7, 1, "square_with_1_rounded_corner"),
    ("square", 16, 4, "rounded_square"),
])  # fmt: skip
def test_arcs_are_elements_of_a_facet_seen(kind: str, sides: int, arcs: int, name: str) -> None:
    (seen,) = with_arcs(kind)
    assert (len(seen.corners_mm), len(seen.arcs)) == (sides, arcs)
    assert name in types_of([seen], load_facets())[0]
    for points in seen.arcs:
        _, radius, off = circle_along(points, newell_normal(seen.corners_mm))
        assert radius == pytest.approx(RADIUS, rel=0.02 if arcs < 4 else 0.04)  # short arcs
        assert off < 0.01
    face = true_face(kind)
    assert np.abs((seen.corners_mm - face.mean(0)) @ newell_normal(face)).max() < 1.0
    for point in np.concatenate(seen.arcs)[::4]:
        assert np.linalg.norm(face - point, axis=1).min() < 0.5 + np.pi * RADIUS / 48


def test_straight_corners_beside_an_arc_are_where_they_are() -> None:
    (seen,) = with_arcs("half")
    face = true_face("half")
    sides = np.linalg.norm(face - np.roll(face, 1, axis=0), axis=1)
    long = np.flatnonzero(sides > RADIUS)
    for corner in face[np.union1d(long, long - 1)]:
        assert np.linalg.norm(seen.corners_mm - corner, axis=1).min() < 0.5


def test_a_drawing_with_arcs_is_recalled_by_facets_seen() -> None:
    one = drawing("half.obj", obj(*prism(ring("half"), HIGH)))
    model = taught_from({"half": one})
    (found,) = (part for part in recognise_groups(view("half").groups, model) if len(part.group.facets) > 1)
    assert found.label == "half"
    assert {"rectangle_with_a_round_end"} < {facet.type for facet in found.part.facets}
    there = TOWARDS @ drawing_from_taught(one, model.metric["half"].solid)
    corners = model.metric["half"].solid.corners_mm
    measured = frames.apply(found.part.cyclopean_from_part, corners)
    ways = (frames.apply(there @ turn, corners) for turn in symmetries(model.metric["half"].solid).motions)
    assert min(np.linalg.norm(measured - way, axis=1).max() for way in ways) < 1.5


def test_what_is_taught_by_looking_keeps_its_arcs() -> None:
    group = next(group for group in view("half").groups if len(group.facets) > 1)
    solid = learn_view(empty_model(load_facets()), group, "half").metric["half"].solid
    (arc,) = solid.arcs
    assert solid.types[arc.facet] == "rectangle_with_a_round_end"
    assert np.count_nonzero(solid.circles[:, 3]) == len(solid.facets[arc.facet]) - 3
    assert solid.circles[:, 3].max() == pytest.approx(RADIUS, rel=0.02)


def test_a_bore_is_no_facet_of_its_own() -> None:
    plain = block(64.0, 44.0, 26.0)
    face = int((plain.facing(TOWARDS) * np.linalg.norm(plain.areas_mm2, axis=1)).argmax())
    x, y = plain.flat_from_solid[face, :3, :3][:2]
    turns = 2 * np.pi * np.arange(48)[:, None] / 48
    rim = plain.centres_mm[face] + 7.0 * (np.cos(turns) * x + np.sin(turns) * y)
    bored = replace(plain, holes=(Hole(face, rim),))
    left, right = paint_pair([(bored, TOWARDS)], np.random.default_rng(2), rig())
    assert round_facets(open_stereo(left, right, rig()), VisionSettings())
    assert not any(f.arcs for group in find_facets(left, right, rig()).groups for f in group.facets)


def test_a_disc_is_no_hole_in_its_own_outline_of_straight_sides() -> None:
    (one,) = (found for found in round_facets(painted("disc"), VisionSettings()) if found.facet.arcs)
    assert not is_hole_in(one, replace(one, facet=replace(one.facet, arcs=())))


def test_polyhedra_have_no_arcs() -> None:
    bodies: list[Body | Polyhedron] = [*KNOWN.values(), block(50.0, 40.0, 30.0)]
    for body in bodies:
        images = open_stereo(*paint_pair([(body, TOWARDS)], np.random.default_rng(5), rig()), rig())
        assert round_facets(images, VisionSettings()) == []
