"""Who acts behind the daemon's back is noticed: with the guard that notices it taken away, the motion monitor finds it.

Each story is lived twice: as it is, in which nothing may be found, and with one guard taken away, in which something
must. So a story that proves nothing fails, too.
"""

from __future__ import annotations

from unittest.mock import patch

import pytest

from daemon.arm.motion import Mover
from tests.fakes.surprises import Call, surprise

pytestmark = pytest.mark.slow

ON_THE_WAY_S = 12.0
"""After `pick`, seconds of the cell: a look is being worked out, or the arm is on its way to one."""


def story(*acts: Call) -> list[Call]:
    """A cell with parts, the arm enabled and picking; then what somebody else does, and what becomes of it."""
    begun: Call = ("begin", {"may": "all", "holds": False, "parts": 9, "at_end": False, "ready": True})
    return [begun, _typed("go home", 20.0), _typed("pick", ON_THE_WAY_S), *acts, ("wait", {"seconds": 20.0})]


def _typed(text: str, seconds: float) -> Call:
    return "do", {"frontend": 0, "text": text, "seconds": seconds, "first": True}


def _pendant(degrees: float) -> Call:
    return "take_the_pendant", {"joint": 0, "degrees": degrees, "seconds": 30.0, "at_rest": True, "going": None}


@pytest.mark.parametrize("degrees", [90.0, -90.0])
def test_an_arm_that_the_pendant_moves_amid_a_pick_begins_no_way_from_where_it_is_not(degrees: float):
    acts = story(_pendant(degrees))
    assert surprise(acts) == ""
    with patch.object(Mover, "_not_moved_by_others", lambda *_: None):
        assert "step too long" in surprise(acts)
