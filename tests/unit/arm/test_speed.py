"""The speed that a move near a part is given."""

from daemon.arm.paths import speed_pct


def test_speed_falls_towards_the_part():
    speeds = [speed_pct(d, 100.0, 30.0) for d in (50, 100, 250, 400, 900)]
    assert speeds == [30.0, 30.0, 65.0, 100.0, 100.0]
