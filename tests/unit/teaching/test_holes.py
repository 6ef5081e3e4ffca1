"""Rims of holes from drawings: which inner borders are holes, where they lie, and what keeps them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from daemon import frames
from daemon.store.library import load_facets
from daemon.store.model import ModelError, from_bytes, to_bytes
from daemon.teaching.solid_from_mesh import Drawing, read_drawing
from daemon.vision.geometry import Hole, Polyhedron, newell_normal
from daemon.vision.model import empty_model, learn_solid, symmetries
from tests.fakes import drawn

LIBRARY = load_facets()


def bored(a: float, b: float, c: float, radius: float, strips: int = 24) -> Drawing:
    return read_drawing("bored.obj", drawn.obj(*drawn.bored_block(a, b, c, radius, strips)), "mm", LIBRARY)


@pytest.mark.parametrize("strips", [12, 24, 60])
def test_a_bores_rims_are_circles_however_the_drawing_cuts_them(strips: int) -> None:
    found = bored(60, 40, 20, 8.0, strips)
    assert found.holes == len(found.solid.holes) == 2
    for hole in found.solid.holes:
        middle = hole.ring_mm.mean(0)
        assert np.linalg.norm(hole.ring_mm - middle, axis=1) == pytest.approx(8.0, abs=0.01)
        assert middle + found.origin_mm == pytest.approx([30, 20, middle[2] + found.origin_mm[2]], abs=0.01)
        normal, level = found.solid.normals[hole.facet], found.solid.centres_mm[hole.facet]
        assert (hole.ring_mm - level) @ normal == pytest.approx(0.0, abs=0.01)
        assert abs(newell_normal(hole.ring_mm) @ normal) == pytest.approx(1.0)


def stepped(sunk: bool) -> Drawing:
    """A block with a square pocket or a square boss in the middle of its top."""
    low, high = drawn.box(60, 40, 20), drawn.box(20, 16, 6)
    corners = np.vstack([low[0], high[0] + [20, 12, 14 if sunk else 20]])
    face = dict(zip(("x0", "x1", "y0", "y1", "z0", "z1"), drawn.CUBE_RINGS, strict=True))
    outer, foot = face["z1"], [k + 8 for k in face["z1" if sunk else "z0"]]
    foot = foot if sunk else foot[::-1]
    first = int(np.argmin(np.linalg.norm(corners[foot] - corners[outer[0]], axis=1)))
    foot = foot[first:] + foot[:first]
    frame = [(outer[k], outer[(k + 1) % 4], foot[(k + 1) % 4], foot[k]) for k in range(4)]
    walls = [tuple(k + 8 for k in face[name]) for name in ("x0", "x1", "y0", "y1", "z0" if sunk else "z1")]
    rings = [face[name] for name in ("x0", "x1", "y0", "y1", "z0")] + frame
    return read_drawing("b.obj", drawn.obj(corners, rings + [w[::-1] if sunk else w for w in walls]), "mm", LIBRARY)


def test_a_pockets_rim_is_a_hole_and_a_boss_foot_is_none() -> None:
    pocket, boss = stepped(sunk=True), stepped(sunk=False)
    assert (pocket.holes, boss.holes) == (1, 0)
    (hole,) = pocket.solid.holes
    assert sorted(map(tuple, (hole.ring_mm + pocket.origin_mm).round(3).tolist())) == [
        (20, 12, 20), (20, 28, 20), (40, 12, 20), (40, 28, 20)]  # fmt: skip


def test_holes_go_with_the_part_into_its_frame_and_its_file() -> None:
    solid = bored(60, 40, 20, 8.0).solid
    model = learn_solid(empty_model(LIBRARY), solid, "bored")
    kept = from_bytes(to_bytes(model)).model.metric["bored"].solid
    for one, other in zip(kept.holes, solid.holes, strict=True):
        assert one.facet == other.facet
        far, also = (
            np.linalg.norm(h.ring_mm[:, None] - s.corners_mm, axis=2) for h, s in ((one, kept), (other, solid))
        )
        assert np.allclose(far, also, atol=1e-3)


def test_a_hole_that_no_facet_has_is_refused_in_a_models_file() -> None:
    model = learn_solid(empty_model(LIBRARY), bored(60, 40, 20, 8.0).solid, "bored")
    metric = model.metric["bored"]
    wrong = replace(metric.solid, holes=(Hole(9, metric.solid.holes[0].ring_mm),))
    with pytest.raises(ModelError, match="a hole or arc of no facet"):
        from_bytes(to_bytes(replace(model, metric={"bored": replace(metric, solid=wrong)})))


def moved_bore(solid: Polyhedron, by_mm: float) -> Polyhedron:
    return replace(solid, holes=tuple(replace(h, ring_mm=h.ring_mm + np.array([by_mm, 0, 0])) for h in solid.holes))


def test_a_bore_off_the_middle_leaves_a_block_fewer_turns_onto_itself() -> None:
    solid = bored(60, 40, 20, 8.0).solid
    assert len(symmetries(solid).motions) == 4
    off = moved_bore(solid, 5.0)
    found = symmetries(off).motions
    assert len(found) == 2
    for turn in found:
        rings = [frames.apply(turn, hole.ring_mm).mean(0) for hole in off.holes]
        assert min(np.linalg.norm(rings[0] - hole.ring_mm.mean(0)) for hole in off.holes) < 0.01


def test_some_facets_of_a_solid_keep_their_holes() -> None:
    solid = bored(60, 40, 20, 8.0).solid
    bare = [k for k in range(6) if k not in {hole.facet for hole in solid.holes}]
    some = solid.only([bare[0], solid.holes[1].facet])
    assert [hole.facet for hole in some.holes] == [1]
    assert np.array_equal(some.holes[0].ring_mm, solid.holes[1].ring_mm)
