"""A shadow's edge joins what it divides; a crease, a step and a gap do not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon import frames
from daemon.arrays import Array
from daemon.vision.facets import reconstruct, shades
from daemon.vision.facets.candidates import Candidate
from daemon.vision.facets.reconstruct import find_facets
from daemon.vision.geometry import StereoRig
from daemon.vision.image import StereoImages
from drivers.simcell.parts import PartShape, box, part_shape, shape
from drivers.simcell.render import RenderedSolid
from drivers.simcell.truth import Lamp, Lighting
from tests.fakes.chosen import few
from tests.fakes.pictures import TABLE
from tests.fakes.rigs import thesis_rig
from tests.fakes.solids import measured
from tests.fakes.thesis_scenes import Shade, Shot, laid, rig_of, shaded_shot, taken

WHOLE_MM = 2.0


def whole(facets: Sequence[Array], rig: StereoRig, left: Array, right: Array) -> int:
    """How many of these facets, (N, 3) mm, were measured as one each."""
    found = [f.corners_mm for g in find_facets(left, right, rig).groups for f in g.facets]
    return sum(
        any(len(f) == len(t) and np.linalg.norm(t[:, None] - f, axis=2).min(1).max() < WHOLE_MM for f in found)
        for t in facets
    )


@pytest.mark.parametrize("turn_rad", [1.9, 2.6])
@pytest.mark.parametrize("baseline_mm", [100.0, 200.0])
def test_a_face_that_a_shadow_divides_is_one_facet(
    baseline_mm: float, turn_rad: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = rig_of(baseline_mm, 600.0)
    shot = shaded_shot(part_shape("cube"), 0, 60.0, 20.0, 450.0, rig, Shade(turn_rad, 0.0))
    joined = whole(shot.facets_mm, rig, shot.left, shot.right)
    monkeypatch.setattr(reconstruct, "join_shaded", lambda *_: None)
    assert joined > whole(shot.facets_mm, rig, shot.left, shot.right)


def roof(bend_deg: float) -> PartShape:
    """A block whose top bends along its middle."""
    ridge = 30 + 30 * np.tan(np.radians(bend_deg / 2))
    block = [[x, y, z] for x in (-30, 30) for y in (-30, 30) for z in (0, 30)]
    return shape("roof", np.array([*block, [0, -30, ridge], [0, 30, ridge]], float))


def on_its_base(part: PartShape) -> int:
    return next(k for k, rest in enumerate(part.rests) if rest[2, 2] > 0.99)


@pytest.mark.parametrize(
    ("baseline_mm", "bend_deg"),
    few([(mm, deg) for deg in (2.0, 8.0, 3.0, 4.0, 6.0) for mm in (60.0, 200.0)], 4),
)
def test_no_crease_of_a_few_degrees_is_taken_for_a_shadow(
    baseline_mm: float, bend_deg: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    part, rig = roof(bend_deg), rig_of(baseline_mm, 700.0)
    rest = on_its_base(part)
    along = part.rests[rest][:3, :3] @ np.array([900.0, 0.0, 0.0])
    up = TABLE.height_mm + 30 + 900 * np.tan(np.radians(bend_deg / 2 + 6))
    low = along + np.array([*TABLE.centre_mm, up])
    grazing = Lighting(40.0, [Lamp(low.tolist(), 3.0, 900.0)], 0.0, 0.8, 0.1)
    joined = noted(monkeypatch)
    for azimuth in (15.0, 100.0, 200.0):
        shot = shaded_shot(part, rest, 55.0, azimuth, 550.0, rig, None, grazing)
        find_facets(shot.left, shot.right, rig)
    assert joined
    assert not any(joined)


@pytest.mark.parametrize(("gap_mm", "albedos"), [(2.0, (0.8, 0.5)), (0.5, (0.8, 0.7)), (1.0, (0.8, 0.8))])
def test_two_parts_side_by_side_with_level_tops_stay_two(
    gap_mm: float, albedos: tuple[float, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    rig, part, joined = thesis_rig(), shape("block", box((0, 0, 0), (30, 60, 30))), noted(monkeypatch)
    rng = np.random.default_rng(round(10 * gap_mm))
    for seed in range(6):
        shot = side_by_side(part, gap_mm, albedos, rng.uniform(40, 80), rng.uniform(0, 360), rig, seed)
        find_facets(shot.left, shot.right, rig)
    assert joined
    assert not any(joined)


def side_by_side(
    part: PartShape,
    gap_mm: float,
    albedos: tuple[float, float],
    elevation_deg: float,
    azimuth_deg: float,
    rig: StereoRig,
    seed: int,
) -> Shot:
    """A part and another of another grey, moved along the first's x axis by its width of 30 mm and a gap."""
    world, pose = laid(part, on_its_base(part), elevation_deg, azimuth_deg, 600.0)
    beside = world.copy()
    beside[:3, 3] += (30 + gap_mm) * world[:3, 0]
    things = [RenderedSolid(part.hull, at, grey) for at, grey in zip((world, beside), albedos, strict=True)]
    bodies = [frames.apply(at, part.hull.vertices) for at in (world, beside)]
    return taken(part, things, bodies, SIDE_LIT, world, pose, rig, seed)


SIDE_LIT = Lighting(70.0, [Lamp([100.0, -700.0, 900.0], 3.0, 200.0)], 0.0, 0.8, 0.15)


def noted(monkeypatch: pytest.MonkeyPatch) -> list[bool]:
    """Whether each pair of facets that share an edge was joined, as it is decided from now on."""
    made = list[bool]()
    real = shades.joined_across

    def joined_across(one: Candidate, i: int, other: Candidate, j: int, eyes: StereoImages) -> Candidate | None:
        found = real(one, i, other, j, eyes)
        made.append(found is not None)
        return found

    monkeypatch.setattr(shades, "joined_across", joined_across)
    return made


@given(st.floats(-0.5, 0.5), st.floats(0.02, 1.0))
def test_a_bend_is_measured_as_it_is(bend: float, sigma_mm: float) -> None:
    near = np.array([[-40.0, 0, 0], [-40, 30, 0], [0, 30, 0], [0, 0, 0]])
    far = np.array([[0.0, 0, 0], [0, 30, 0], [40, 30, 0], [40, 0, 0]])
    for quad in (near, far):
        quad[:, 2] = 500 + np.tan(bend / 2) * np.abs(quad[:, 0])
    found, sigma = shades.bend_at(_candidate(near, sigma_mm), 2, _candidate(far, sigma_mm), 0)
    assert abs(found) == pytest.approx(2 * np.tan(abs(bend) / 2), abs=1e-6)
    assert 0.5 < sigma / (sigma_mm / 40) < 4


def _candidate(corners_mm: Array, sigma_mm: float) -> Candidate:
    spread = np.repeat(sigma_mm**2 * np.eye(3)[None], len(corners_mm), 0)
    nothing: Any = object()
    facet = replace(measured(corners_mm, None), covariance_mm2=spread)
    return Candidate(facet, nothing, nothing, 0.0, nothing, nothing)
