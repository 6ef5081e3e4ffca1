"""Discs and half discs: one flat facet and a curved side prove a part; the measured edges decide between sizes."""

from __future__ import annotations

from functools import cache

import numpy as np

from daemon.teaching.solid_from_mesh import Drawing
from daemon.vision.geometry import SolidBatch
from daemon.vision.image import open_stereo
from daemon.vision.look import look
from daemon.vision.refine import count_visible_facets, edge_samples_of
from tests.bench.machined import Look, on_table
from tests.fakes.drawn import obj, prism
from tests.fakes.machined import drawing, drawing_from_taught, taught_from


def rounded(sweep: float, radius_mm: float, rest: tuple[tuple[float, float], ...] = ()) -> Drawing:
    """A prism 22 mm high over an arc and further corners."""
    turns = np.linspace(0, sweep, 49)[: 49 - (sweep > 6)]
    arc = [(radius_mm * float(np.cos(turn)), radius_mm * float(np.sin(turn))) for turn in turns]
    return drawing("one.obj", obj(*prism([*arc, *rest], 22.0)))


def half(radius_mm: float) -> Drawing:
    return rounded(np.pi, radius_mm, ((-radius_mm, -24.0), (radius_mm, -24.0)))


@cache
def shown(one: Drawing, seed: int) -> Look:
    return on_table("1", one, np.random.default_rng([*b"round sizes", seed]), (290.0, 310.0))


def names(one: Look, **drawings: Drawing) -> list[str]:
    """What a look names, where such parts are taught."""
    return [p.recognition.label for p in look(one.left, one.right, one.rig, taught_from(drawings)).parts if p.named]


DISC, HALF = rounded(2 * np.pi, 13.0), half(13.5)


def test_a_disc_is_named_by_its_face_and_the_far_rim_of_its_curved_side() -> None:
    one = shown(DISC, 1)
    assert names(one, disc=DISC) == ["disc"]


def test_a_face_alone_is_not_counted_as_a_curved_side() -> None:
    one, solid = shown(DISC, 1), taught_from({"disc": DISC}).metric["disc"].solid
    pose, images = one.pose @ drawing_from_taught(DISC, solid), open_stereo(one.left, one.right, one.rig)
    samples = edge_samples_of(SolidBatch.of([solid]), images, pose[None], 0.25)
    assert count_visible_facets(solid, images, pose, samples) == 2
    taller = taught_from({"disc": drawing("one.obj", obj(*prism(circle(13.0), 32.0)))}).metric["disc"].solid
    samples = edge_samples_of(SolidBatch.of([taller]), images, pose[None], 0.25)
    assert count_visible_facets(taller, images, pose, samples) < 2


def circle(radius_mm: float) -> list[tuple[float, float]]:
    turns = np.linspace(0, 2 * np.pi, 49)[:48]
    return [(radius_mm * float(np.cos(turn)), radius_mm * float(np.sin(turn))) for turn in turns]


def test_of_sizes_a_twentieth_of_a_radius_apart_the_shown_one_is_named_and_no_other() -> None:
    sizes = {"small": half(0.95 * 13.5), "true": HALF, "large": half(1.05 * 13.5)}
    one = shown(HALF, 1)
    assert names(one, **sizes) == ["true"]
    assert names(one, small=sizes["small"], large=sizes["large"]) == []


def quarter(radius_mm: float) -> Drawing:
    """A block with a rounded corner, whose straight sides go on from the arc."""
    return rounded(np.pi / 2, radius_mm, ((-24.0, radius_mm), (-24.0, -24.0), (radius_mm, -24.0)))


def test_a_rounded_corner_of_another_radius_is_told_by_all_edges_together() -> None:
    sizes = {"small": quarter(0.95 * 11.0), "true": quarter(11.0), "large": quarter(1.05 * 11.0)}
    one = shown(sizes["true"], 2)
    assert names(one, **sizes) == ["true"], "their corners are as round to half a millimetre"
    assert [names(one, other=sizes[name]) for name in ("small", "large")] == [[], []]
