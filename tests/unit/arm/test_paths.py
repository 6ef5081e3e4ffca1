"""Ways from pose to pose: no step too long, slower the nearer."""

from itertools import pairwise

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon import frames
from daemon.arm import paths

TRUE = frames.rigid(frames.rotation_from_vector(np.array([0.1, -0.2, 0.7])), np.array([520.0, 10.0, -275.0]))


@settings(max_examples=50, deadline=None)
@given(move=st.tuples(*[st.floats(-900, 900)] * 3), turn=st.floats(-3, 3))
def test_steps_end_at_the_target_and_none_is_too_long(move, turn):
    target = frames.perturb(TRUE, np.array([*move, 0.0, 0.0, turn]))
    way = [TRUE, *paths.steps(TRUE, target, 100.0, 30.0)]
    assert np.allclose(way[-1], target)
    assert all(paths.within(a, b, 100.0, 30.0) for a, b in pairwise(way))
