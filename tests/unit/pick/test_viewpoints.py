"""From where to look: the point on the axis, two facets rather than one, the side on which candidates differ."""

from types import SimpleNamespace

import numpy as np
import pytest

from daemon import frames
from daemon.pick.grippers.two_fingers import tool_rotation
from daemon.pick.planning import viewpoints
from tests.fakes.fake_cell import shape_of

TRUE = frames.rigid(frames.rotation_from_vector(np.array([0.1, -0.2, 0.7])), np.array([520.0, 10.0, -275.0]))
ROTATION = tool_rotation(np.array([0.0, 1.0, 0.0]), 0.4)


def test_a_view_of_two_facets_is_worth_more_than_of_one():
    cube, pose = shape_of("cube"), np.eye(4)
    on_one, on_two = np.array([400.0, 0, 0]), np.array([300.0, 300.0, 0])
    assert viewpoints.view_worth(cube, pose, on_two) > 2 * viewpoints.view_worth(cube, pose, on_one)


@pytest.mark.parametrize(
    ("facing", "worth"),
    [([1.0, 1.0, 1.0], 1.0), ([1.0] * 5, 1.0), ([1.0, 1.0], 1.3 / 1.6), ([1.0, 0.0, -1.0], 0.3 / 1.6), ([0.0], 0.0)],
)
def test_a_view_straight_at_three_facets_is_worth_one_and_one_of_none_nothing(
    facing: list[float], worth: float
) -> None:
    shape = SimpleNamespace(facing=lambda *_: np.array(facing))
    assert viewpoints.view_worth(shape, np.eye(4), np.zeros(3)) == pytest.approx(worth)  # type: ignore[arg-type]
