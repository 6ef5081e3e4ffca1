"""A wedge is held evenly: the fingers close along the middle between its two faces, not square on one of them."""

import numpy as np

from daemon.pick.grippers.two_fingers import closing_directions, hull

SLANT = np.arctan2(8.0, 60.0)
"""Of either face against the middle: a finger that lies on one is off the other by twice that."""


def test_between_two_faces_that_look_away_from_each_other_the_fingers_close_along_the_middle() -> None:
    outline = np.array([(-30.0, -20.0), (30.0, -12.0), (30.0, 12.0), (-30.0, 20.0)])
    corners = np.array([(x, y, z) for z in (0.0, 30.0) for x, y in outline])
    wedge = hull(corners)
    along = [abs(float(direction[1])) for direction in closing_directions(wedge, len(wedge.facets))]
    assert max(along) > np.cos(0.1 * SLANT)
