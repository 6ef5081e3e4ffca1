"""How a part gets to its place, and what is told of it beforehand."""

from types import SimpleNamespace
from typing import Any

import numpy as np

from daemon.pick.planning.place_goals import goal_of
from daemon.pick.planning.place_plan import HEADINGS_DEG, plan_from_side
from daemon.pick.settings import Settings
from daemon.store.place_file import Place, PlaceSettings
from tests.fakes.fake_cell import ON_HAND, rig, shape_of
from tests.unit.pick.test_plan import everywhere

AT = np.array([520.0, 0.0, -300.0])


def nest(label, side):
    return Place("nest", PlaceSettings(part=label), np.eye(4), None, side + 1, (430.0, -220.0, -300.0), 20.0)


def test_a_side_from_which_no_grasp_leads_to_the_place_is_told_with_the_reason_and_one_that_does_with_its_grasp():
    shape = shape_of("pyramid")
    anywhere: Any = SimpleNamespace(allows_each=everywhere)
    base = next(k for k, ring in enumerate(shape.rings) if len(ring) == 4)
    goal = goal_of(nest("pyramid", base), shape)
    plan = plan_from_side(goal, base, AT, Settings(), ON_HAND, anywhere, rig())
    assert (plan.side, plan.found, plan.tried, plan.why) == (base + 1, len(HEADINGS_DEG), len(HEADINGS_DEG), "")
    (motion,) = plan.motions
    assert "mm wide" in motion.grasp
    np.testing.assert_allclose(
        np.linalg.inv(motion.tool_taken) @ motion.part_taken,
        np.linalg.inv(motion.tool_laid) @ motion.part_laid,
        atol=1.0,
    )
    nowhere: Any = SimpleNamespace(allows_each=lambda poses: poses[:, 1, 3] > -150.0)
    none = plan_from_side(goal, base, AT, Settings(), ON_HAND, nowhere, rig())
    assert (none.found, none.motions) == (0, ())
    assert "can set it down at nest" in none.why
