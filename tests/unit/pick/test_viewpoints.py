"""From where to look: the point on the axis, two facets rather than one, the side on which candidates differ."""

import numpy as np

from daemon import frames
from daemon.pick import viewpoints
from daemon.pick.grasp import tool_rotation
from tests.fakes.fake_cell import shape_of

TRUE = frames.rigid(frames.rotation_from_vector(np.array([0.1, -0.2, 0.7])), np.array([520.0, 10.0, -275.0]))
ROTATION = tool_rotation(np.array([0.0, 1.0, 0.0]), 0.4)


def test_a_view_of_two_facets_is_worth_more_than_of_one():
    cube, pose = shape_of("cube"), np.eye(4)
    on_one, on_two = np.array([400.0, 0, 0]), np.array([300.0, 300.0, 0])
    assert viewpoints.view_worth(cube, pose, on_two) > 2 * viewpoints.view_worth(cube, pose, on_one)
