"""The characteristic views of a solid."""

from __future__ import annotations

import numpy as np
import pytest

from daemon.store.library import load_facets
from daemon.store.model import from_bytes, to_bytes
from daemon.teaching.view_coverage import assess_coverage, simulated_view
from daemon.vision.model import aspects, learn_solid
from daemon.vision.model.aspect_sets import OBLIQUE
from daemon.vision.model.model import empty_model, learn_view
from tests.fakes import drawn, rendered
from tests.fakes.drawn import block, solid

RIG = rendered.rig(rendered.HERE, "B")
LIBRARY = load_facets()


def test_the_characteristic_views_of_a_box_are_those_of_its_corners() -> None:
    """Each shows three facets, which are related alike at all corners: the memory makes one node of them."""
    for sides in ((50, 50, 50), (40, 50, 60)):
        box = block(*sides)
        views = aspects(box)
        assert len(views) == len({view.facets for view in views}) == 8
        for view in views:
            assert len(set.intersection(*(set(box.facets[k]) for k in view.facets))) == 1
            assert (box.normals[list(view.facets)] @ view.towards > OBLIQUE).all()
        assert len(learn_solid(empty_model(LIBRARY), box, "box").artmap.node_labels) == 1


def test_what_stands_before_a_facet_hides_it() -> None:
    block = solid("l.obj", drawn.obj(*drawn.prism(drawn.L_BLOCK, 40)[:1], [(0, 5, 4, 3), (0, 3, 2, 1), (6, 7, 8, 9),
                  (6, 9, 10, 11), *drawn.prism(drawn.L_BLOCK, 40)[1][2:]]))  # fmt: skip
    views = aspects(block)
    assert max(len(view.facets) for view in views) == 5, "both arms' sides and the step are seen from the corner"
    seen = {tuple(sorted(block.types[k] for k in view.facets)) for view in views}
    assert ("polygon6", "rectangle", "rectangle") in seen, "from behind the step is hidden"
    assert not any(set(one.facets) < set(other.facets) for one in views for other in views)


def test_a_learnt_drawing_names_the_part_from_everywhere_and_survives_the_file() -> None:
    model = learn_solid(empty_model(LIBRARY), block(40, 50, 60), "brick", "brick/1")
    model = learn_solid(model, block(50, 50, 50), "cube", "cube/1")
    model = from_bytes(to_bytes(model)).model
    for label, sides in (("brick", {40, 50, 60}), ("cube", {50})):
        metric = model.metric[label].solid
        lengths = {round(float(np.linalg.norm(metric.corners_mm[a] - metric.corners_mm[b]))) for a, b in metric.edges}
        assert lengths == sides
        told = assess_coverage(model, label, RIG)
        assert told.complete
        assert told.unseen == 0
        assert all(len(mistake.facets) == 1 for mistake in told.mistakes), "only a single facet is no proof"


def test_a_drawing_whose_face_is_almost_a_square_is_taught_as_drawn() -> None:
    """Made as regular as a square, a rectangle of 50 x 50.5 mm lost half of the difference, and a knob whose flat is
    one the half turn onto itself."""
    drawn_block = block(50.0, 50.5, 30.0)
    assert "square" in drawn_block.types
    taught = learn_solid(empty_model(LIBRARY), drawn_block, "block").metric["block"].solid
    before, after = (np.linalg.norm(one.corners_mm[:, None] - one.corners_mm, axis=2) for one in (drawn_block, taught))
    assert after == pytest.approx(before, abs=1e-6)


def test_a_drawn_shape_stays_the_drawings_when_a_view_of_many_facets_makes_the_matrix_larger() -> None:
    model = learn_solid(empty_model(LIBRARY), block(40, 50, 60), "brick", "brick/1")
    outline = [(0.0, 0.0), *((80.0 - 20 * (k // 2), 10.0 * ((k + 1) // 2)) for k in range(8)), (0.0, 40.0)]
    stairs = solid("stairs.obj", drawn.obj(*drawn.prism(outline, 40)))
    view = simulated_view(stairs, np.array([0.6, 0.6, 0.53]), RIG)
    assert view is not None
    assert len(view.facets) > model.artmap.slots
    larger = learn_view(model, view, "stairs")
    assert larger.artmap.slots == len(view.facets)
    assert larger.metric["brick"] is model.metric["brick"]
    assert [v.label for v in larger.views] == [*(v.label for v in model.views), "stairs"]
