"""The text of the only moves of a first contact; whole first contacts are in tests/unit/cell/test_identify.py."""

from __future__ import annotations

import pytest

from drivers.val2.first_contact_moves import STEP_DEG, drive_command


@pytest.mark.parametrize(("joint", "degrees"), [(0, 1.0), (7, 1.0), (1, STEP_DEG + 0.01), (6, -STEP_DEG - 0.01)])
def test_no_text_turns_anything_but_one_joint_by_a_small_step(joint: int, degrees: float) -> None:
    with pytest.raises(ValueError, match="no small step"):
        drive_command(joint, degrees)


def test_a_small_step_is_slow_whatever_the_monitors_speed() -> None:
    assert drive_command(6, -STEP_DEG) == "DO DRIVE 6,-2,1"
