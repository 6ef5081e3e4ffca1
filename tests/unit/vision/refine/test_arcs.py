"""Arcs of outlines: from a drawing into the solid and its file; where pictures show them; poses that they hold."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from daemon import frames
from daemon.arrays import Array
from daemon.pick.pose_fusion import CHI_SQUARE_6, Doubt, Sighting, fuse, sighting
from daemon.store.library import load_facets
from daemon.store.model import from_bytes, to_bytes
from daemon.teaching.solid_from_mesh import solid_drawn
from daemon.vision.evidence.edge_places import edge_places
from daemon.vision.geometry import Polyhedron, SolidBatch, StereoRig
from daemon.vision.hypotheses import turns_about_axis
from daemon.vision.image import StereoImages, open_stereo
from daemon.vision.model import TeachError, empty_model, learn_solid, mirror_images, symmetries
from daemon.vision.refine import Fit, aligned_to_edges, edge_samples_of, fit_by_edges
from daemon.vision.refine.expected_edges import project_edges
from drivers.simcell.render import rendered
from tests.bench import machined
from tests.bench.simulated_looks import true_rig
from tests.fakes.chosen import few
from tests.fakes.drawn import block, obj, prism
from tests.fakes.machined import shape_from_drawing, shown_shape
from tests.fakes.painted import paint_pair
from tests.fakes.photographed import cell, taken
from tests.fakes.rigs import rig
from tests.fakes.solids import Body, pose

RADIUS_MM, LONG_MM, HIGH_MM = 18.0, 30.0, 20.0
WHERE = pose(np.array([-0.9, 0.25, 0.5]), 0.3, 380.0)
TOLERANCE_MM = 0.25


def outline(strips: int) -> list[tuple[float, float]]:
    """A straight-sided block with a half round end, its arc in so many chords."""
    turns = np.linspace(-np.pi / 2, np.pi / 2, strips + 1)
    return [(-LONG_MM, RADIUS_MM), (-LONG_MM, -RADIUS_MM),
            *zip((RADIUS_MM * np.cos(turns)).tolist(), (RADIUS_MM * np.sin(turns)).tolist(), strict=True)]  # fmt: skip


@cache
def rounded() -> Polyhedron:
    """It, drawn, about the middle of its corners."""
    return solid_drawn("rounded.obj", obj(*prism(outline(36), HIGH_MM)), "mm", load_facets())


@cache
def images() -> StereoImages:
    """It at WHERE, painted with an arc of many chords."""
    corners, rings = prism(outline(120), HIGH_MM)
    middle = corners[:2].mean(0) - rounded().corners_mm[np.argsort(rounded().corners_mm[:, 0])[:4]].mean(0)
    middle[2] = HIGH_MM / 2 - (rounded().corners_mm[:, 2].max() + rounded().corners_mm[:, 2].min()) / 2
    return open_stereo(
        *paint_pair([(Body(corners - middle, tuple(rings)), WHERE)], np.random.default_rng(5), rig()), rig()
    )


def centre() -> Array:
    """(3,) a point of the round end's axis."""
    return rounded().circles[rounded().circles[:, 3] > 0, :3].mean(0)


def test_a_drawings_arcs_are_kept_with_the_chords_that_stand_for_them() -> None:
    solid = rounded()
    assert len(solid.arcs) == 2
    for arc in solid.arcs:
        away = np.linalg.norm((arc.points_mm - centre())[:, :2], axis=1)
        assert away == pytest.approx(np.full(len(away), RADIUS_MM), abs=0.02)
        assert solid.types[arc.facet] == "rectangle_with_a_round_end"
    on_arc = solid.circles[:, 3] > 0
    middles = solid.corners_mm[solid.lines[0]].mean(1) - centre()
    assert on_arc.sum() >= 8
    assert solid.circles[on_arc, 3] == pytest.approx(np.full(on_arc.sum(), RADIUS_MM), abs=0.02)
    assert (middles[on_arc, 0] > 0).all()
    assert (middles[~on_arc, 0] < 0.1).all()
    outwards = (solid.walls[on_arc, :2] * middles[on_arc, :2]).sum(1)
    assert (outwards > 0.9 * np.linalg.norm(middles[on_arc, :2], axis=1)).all()
    assert not solid.walls[~on_arc].any()


def cut_round(flat_mm: float) -> Polyhedron:
    """A cylinder about the z axis with a flat at y = -flat_mm, drawn, about the middle of its corners."""
    half = np.arccos(flat_mm / RADIUS_MM)
    turns = np.linspace(half - np.pi / 2, 1.5 * np.pi - half, 60)
    ring = [(RADIUS_MM * np.cos(turn), RADIUS_MM * np.sin(turn)) for turn in turns]
    return solid_drawn("cut.obj", obj(*prism(ring, HIGH_MM)), "mm", load_facets())


def test_the_edges_in_which_a_flat_cuts_a_cylinder_have_its_wall_beyond() -> None:
    solid, flat_mm = cut_round(10.0), 10.0
    upright = np.flatnonzero(np.abs(np.ptp(solid.corners_mm[solid.lines[0]], axis=1)[:, 2]) > HIGH_MM / 2)
    assert len(upright) == 2
    (flat,) = {int(facet) for facet in solid.beside[upright, 0]}
    assert solid.normals[flat] == pytest.approx([0, -1, 0], abs=1e-3)
    half_mm = np.sqrt(RADIUS_MM**2 - flat_mm**2)
    sides = np.sign(solid.corners_mm[solid.lines[0][upright, 0], 0])
    out = np.column_stack([sides * half_mm, [-flat_mm] * 2, [0.0] * 2]) / RADIUS_MM
    assert solid.walls[upright] == pytest.approx(out, abs=0.02)


def test_the_edge_of_a_flat_that_is_turned_away_is_where_its_cylinder_ends_in_the_picture() -> None:
    """The flat is seen from behind, and the wall beyond its edge from before: this edge says how the part is turned."""
    solid = cut_round(10.0)
    where = pose(np.array([-2.2, 0.0, 0.0]), 0.0, 380.0)
    where[:3, :3] = where[:3, :3] @ frames.rotation_from_vector(np.array([0.0, 0.0, np.radians(20.0)]))
    laid = SolidBatch.of([solid])
    flat = int((solid.normals @ [0, -1, 0]).argmax())
    assert solid.facing(where)[flat] < -0.3
    for edges in project_edges(laid, images(), where[None], np.ones(1, bool), TOLERANCE_MM):
        upright = np.flatnonzero(np.ptp(solid.corners_mm[edges.ends], axis=1)[:, 2] > HIGH_MM / 2)
        assert len(upright) == 1
        assert edges.outline[upright].all()
        assert not edges.bow[upright].any()
        about_axis = np.concatenate([np.zeros(3), where[:3, 2]])
        assert np.abs(edges.jacobian[upright] @ about_axis).min() > 5.0, "px a radian"


def test_the_straight_side_of_a_segment_is_no_chord_of_its_arc() -> None:
    """That of a flat disc cut off 12 mm from the middle: its ends are on the arc, and its middle is not far from it."""
    half = np.arccos(12.0 / RADIUS_MM)
    turns = np.linspace(np.pi / 2 - half, np.pi / 2 + half, 40)
    ring = [(RADIUS_MM * np.cos(turn), RADIUS_MM * np.sin(turn)) for turn in turns]
    solid = solid_drawn("segment.obj", obj(*prism(ring, HIGH_MM)), "mm", load_facets())
    long_mm = np.linalg.norm(np.diff(solid.corners_mm[solid.lines[0]], axis=1)[:, 0], axis=1)
    straight = long_mm > 1.8 * np.sqrt(RADIUS_MM**2 - 12.0**2)
    assert straight.sum() == 2
    assert not solid.circles[straight].any()
    flats = straight | (np.ptp(solid.corners_mm[solid.lines[0]], axis=1)[:, 2] > HIGH_MM / 2)
    assert solid.circles[~flats, 3] == pytest.approx(np.full((~flats).sum(), RADIUS_MM), abs=0.02)


def test_arcs_go_with_the_part_into_its_frame_its_file_and_its_mirror_image() -> None:
    model = learn_solid(empty_model(load_facets()), rounded(), "rounded")
    kept = from_bytes(to_bytes(model)).model.metric["rounded"].solid
    assert len(kept.arcs) == 2
    assert np.allclose(np.sort(kept.circles[:, 3]), np.sort(rounded().circles[:, 3]), atol=1e-2)
    lopsided = replace(
        rounded(), corners_mm=rounded().corners_mm + 9.0 * (rounded().corners_mm[:, :1] < -20) * [0, 1, 0]
    )
    for image in mirror_images(lopsided):
        assert len(image.solid.arcs) == 2
        assert (image.solid.circles[:, 3] > 0).sum() == (lopsided.circles[:, 3] > 0).sum()


def test_the_bow_of_a_chord_is_where_the_cameras_see_its_arc() -> None:
    laid = SolidBatch.of([rounded()])
    turns = np.linspace(-np.pi / 2, np.pi / 2, 2000)
    for edges, view in zip(
        project_edges(laid, images(), WHERE[None], np.ones(1, bool), TOLERANCE_MM), images().views, strict=True
    ):
        bowed = np.flatnonzero(np.abs(edges.bow).max(1) > 0)
        assert len(bowed) >= 4
        assert len(bowed) < len(edges.bow)
        level = (
            centre() + np.array([0, 0, 1.0]) * (rounded().corners_mm[edges.ends[bowed, 0], 2] - centre()[2])[:, None]
        )
        normal = (edges.start - edges.end)[:, ::-1] * [-1.0, 1.0] / edges.lengths_px[:, None]
        for k, middle in zip(bowed, level, strict=True):
            arc = middle + RADIUS_MM * np.column_stack([np.cos(turns), np.sin(turns), 0 * turns])
            arc_px = view.rectified.camera.project(frames.apply(WHERE, arc))
            for share, bow in zip((0.0, 0.5, 1.0), edges.bow[k], strict=True):
                at = edges.start[k] + share * (edges.end[k] - edges.start[k]) + bow * normal[k]
                assert np.linalg.norm(arc_px - at, axis=1).min() < 0.15


def test_a_turn_about_its_axis_does_not_move_an_arc_and_anything_else_does() -> None:
    laid = SolidBatch.of([rounded()])
    for edges in project_edges(laid, images(), WHERE[None], np.ones(1, bool), TOLERANCE_MM):
        axis, through = WHERE[:3, 2], frames.apply(WHERE, centre()) - WHERE[:3, 3]
        about_axis = np.concatenate([np.cross(through, axis), axis])
        on_arc = np.abs(edges.bow[:, 1]) > 0.1
        turned_px = edges.jacobian @ about_axis
        assert np.abs(turned_px[on_arc]).max() < 0.002 * np.abs(turned_px[~on_arc]).max()
        shifted_px = np.abs(edges.jacobian[on_arc] @ [1.0, 0, 0, 0, 0, 0])
        assert shifted_px.max() > 1.0


def round_end_first() -> Array:
    """A pose (4, 4) at which a round end and the face above it look at both cameras."""
    tilt = np.radians(50.0)
    z, x = np.array([0, -np.sin(tilt), -np.cos(tilt)]), np.array([0, np.cos(tilt), -np.sin(tilt)])
    return frames.rigid(np.stack([x, np.cross(z, x), z], 1), np.array([0.0, 0.0, 350.0]))


def test_the_wall_beyond_an_arc_shows_its_far_rim_and_makes_its_near_one_an_inner_edge() -> None:
    def edges(solid: Polyhedron) -> dict[tuple[int, ...], bool]:
        laid, at = SolidBatch.of([solid]), round_end_first()[None]
        left, _ = project_edges(laid, images(), at, np.ones(1, bool), TOLERANCE_MM)
        return dict(zip(map(tuple, left.ends.tolist()), left.outline.tolist(), strict=True))

    with_wall, without = edges(rounded()), edges(replace(rounded(), arcs=()))
    low = rounded().corners_mm[:, 2] < rounded().corners_mm[:, 2].mean()
    far = [ends for ends, outline in with_wall.items() if ends not in without and outline and low[list(ends)].all()]
    assert far
    inner = [ends for ends, outline in without.items() if outline and not with_wall[ends]]
    assert inner
    assert not low[np.array(inner)].any()
    number = {tuple(ends): k for k, ends in enumerate(rounded().lines[0].tolist())}
    places = edge_places(rounded(), round_end_first(), images())[0]
    assert all(places.visible[number[ends]].any() and places.weight[number[ends]] == 1.0 for ends in far)
    assert all(places.weight[number[ends]] < 1.0 for ends in inner)


def test_arcs_hold_a_pose_that_chords_would_bend() -> None:
    near = WHERE @ frames.rigid(frames.rotation_from_vector(np.array([0.01, -0.02, 0.015])), np.array([0.8, -0.5, 0.6]))
    off = []
    for solid in (rounded(), replace(rounded(), arcs=())):
        found = aligned_to_edges(SolidBatch.of([solid]), images(), near[None], TOLERANCE_MM)[0]
        there = frames.apply(WHERE, solid.corners_mm)
        off.append(np.linalg.norm(frames.apply(found, solid.corners_mm) - there, axis=1).max())
    assert off[0] < 0.5
    assert off[0] < 0.8 * off[1]
    both = edge_samples_of(SolidBatch.of([rounded()]), images(), WHERE[None], TOLERANCE_MM)
    assert all(seen.shows[seen.edges.outline].all() for seen in both)


def test_round_faces_that_share_no_edge_can_be_taught_and_straight_ones_apart_cannot() -> None:
    turns = 2 * np.pi * np.arange(48) / 48
    disc = prism((28.0 * np.column_stack([np.cos(turns), np.sin(turns)])).tolist(), 14.0)
    solid = solid_drawn("disc.obj", obj(*disc), "mm", load_facets())
    assert len(learn_solid(empty_model(load_facets()), solid, "disc").views) == 2
    cube = block(40.0, 40.0, 40.0)
    low, high = (int(k) for k in (np.argmin(cube.normals[:, 2]), np.argmax(cube.normals[:, 2])))
    with pytest.raises(TeachError, match="share an edge"):
        learn_solid(empty_model(load_facets()), replace(cube.only([low, high]), types=("square", "square")), "apart")


@pytest.mark.parametrize("seed", few([0, 2], 1))
def test_the_turn_of_a_disc_is_that_of_its_bores_and_not_of_its_chords(seed: int) -> None:
    drawn = machined.drawn("flange")
    seen = machined.on_table("flange", drawn, np.random.default_rng(seed), (180.0, 260.0))
    true = seen.pose @ frames.rigid(np.eye(3), drawn.origin_mm)
    thought = true @ frames.rigid(frames.rotation_from_vector(np.radians([0.0, 0.0, 3.0])), np.zeros(3))
    pair = open_stereo(seen.left, seen.right, seen.rig)
    fit = fit_by_edges(drawn.solid, pair, thought, 2.0)
    assert fit is not None
    assert np.degrees(frames.angle_between(fit.cyclopean_from_part, true)) < 0.5
    blank = fit_by_edges(replace(drawn.solid, holes=()), pair, thought, 2.0)
    assert blank is not None
    axis = true[:3, 2]
    sigmas_deg = [np.degrees(np.sqrt(axis @ one.covariance[3:, 3:] @ axis)) for one in (fit, blank)]
    assert sigmas_deg[0] < 0.5
    assert sigmas_deg[1] > 45.0, "chords say nothing of it"
    many, doubt = [in_world(blank, seen.rig)] * 5, Doubt()
    assert fuse(many, doubt).predicted_deg > 30.0, "nor do five looks together"
    assert fuse([in_world(fit, seen.rig)] * 5, doubt).predicted_deg < 0.5


def in_world(fit: Fit, of: StereoRig) -> Sighting:
    """A fit as a look straight down brings it to the world."""
    down = frames.rigid(np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.0, 300.0]))
    focal_px = float(of.left.matrix[0, 0])
    return sighting(down, np.eye(4), fit.cyclopean_from_part, fit.covariance, Doubt(), focal_px, of.baseline_mm)


CLOSE = {
    "bracket": ([[0.0, -1.0, 0.0], [0.4637, 0.0, 0.886], [-0.886, 0.0, 0.4637]], [-2.2, -1.1, 203.8]),
    "knob": ([[-0.6612, -0.7502, 0.0], [0.5942, -0.5237, -0.6105], [0.458, -0.4037, 0.792]], [-0.2, -2.1, 203.3]),
    "cover": ([[1.0, 0.0, 0.0], [0.0, 0.886, -0.4637], [0.0, 0.4637, 0.886]], [-0.8, -0.3, 200.7]),
}
"""Poses cyclopean_from_shape at which a pick looked for the last time before the grasp."""


def close(label: str, around_deg: float = 0.0) -> tuple[Polyhedron, Array, StereoImages]:
    """A drawn part, its true pose cyclopean_from_part (4, 4) and both pictures of it, as the last look had it; part
    and cameras are turned together before the light."""
    drawn = machined.drawn(label)
    shape = shown_shape(label, drawn)
    cyclopean_from_shape = frames.rigid(*map(np.array, CLOSE[label]))
    true = cyclopean_from_shape @ shape_from_drawing(shape, drawn) @ frames.rigid(np.eye(3), drawn.origin_mm)
    spot = np.array([*cell().table.centre_mm, cell().table.height_mm])
    around = frames.rigid(frames.rotation_from_vector(np.array([0.0, 0.0, np.radians(around_deg)])), spot)
    stands = [around @ rest @ frames.inverse(cyclopean_from_shape) for rest in shape.rests]
    cameras = max(stands, key=lambda stand: float(stand[2, 3]))
    things = rendered(shape, cameras @ cyclopean_from_shape, cell().lighting.facet_albedo, [()] * len(shape.pieces))
    return drawn.solid, true, open_stereo(*taken(None, cameras, things, 3), true_rig(cell()))


@pytest.mark.parametrize("label", ["bracket", "cover"])
def test_a_part_that_fills_the_picture_is_fitted_by_its_many_short_edges(label: str) -> None:
    """A pick blamed the hand-eye: straight lines within 6 mm had led the part to a pose 3 mm and 3 degrees off."""
    solid, true, pair = close(label)
    near = frames.perturb(true, np.array([0.1, 0.5, -0.9, *np.radians([0.2, -0.2, 0.1])]))
    fit = fit_by_edges(solid, pair, near, 6.0)
    assert fit is not None
    off = frames.apply(fit.cyclopean_from_part, solid.corners_mm) - frames.apply(true, solid.corners_mm)
    assert np.linalg.norm(off, axis=1).max() < 0.3


@pytest.mark.parametrize("turned_deg", [0.0, 5.0, -5.0])
def test_an_edge_that_the_part_mostly_hides_holds_its_turn_by_what_shows_of_it(turned_deg: float) -> None:
    """The rim of a knob hides its flats but for a corner: a pick was given up that had 24 degrees of doubt at the right
    turn, and .4 where the turn was 3 degrees off."""
    solid, true, pair = close("knob", 169.0)
    axis = turns_about_axis(solid)[1]
    turn = frames.vector_from_rotation(axis[:3, :3])
    turn *= np.radians(turned_deg) / np.linalg.norm(turn)
    fit = fit_by_edges(solid, pair, true @ frames.rigid(frames.rotation_from_vector(turn), np.zeros(3)), 6.0)
    assert fit is not None
    off = min((frames.difference(fit.cyclopean_from_part, way) for way in true @ symmetries(solid).motions),
              key=lambda motion: float(np.linalg.norm(motion)))  # fmt: skip
    assert frames.rms_deg(fit.covariance[3:, 3:]) < 0.7
    assert off @ np.linalg.solve(fit.covariance, off) < CHI_SQUARE_6
