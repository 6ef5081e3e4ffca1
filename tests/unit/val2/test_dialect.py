"""The dialect's waits on a line that runs in scaled time."""

import asyncio
from dataclasses import replace

import msgspec
import pytest

from drivers.val2.dialect import Dialect
from drivers.val2.location import Location, apart
from tests.fakes.arm_line import MakesLine

GOAL = Location(520.0, 0.0, -100.0, 0.0, 80.0, 0.0)


def test_only_waits_that_are_counted_in_characters_shorten_on_a_faster_line() -> None:
    usual = Dialect()
    fast = usual.on_a_faster_line(2.0)
    assert fast.prompt_silence_s == pytest.approx(usual.prompt_silence_s / 2)
    same_waits = replace(
        fast, prompt_silence_s=usual.prompt_silence_s, echo_settle_s=usual.echo_settle_s, poll_s=usual.poll_s
    )
    assert same_waits == usual


@pytest.mark.parametrize(
    ("key", "taken", "refused"),
    [
        ("motion_s", 3600.0, 5000.0),  # milliseconds
        ("prompt_silence_s", 0.006, 0.0),
        ("echo_settle_s", 10.0, 12.0),
        ("prompt_late_s", 0.0, -0.1),
        ("same_place_mm", 10.0, 30.0),  # micrometres
        ("arrived_deg", 0.001, 0.0),
        ("unit_mm", 1000.0, 25400.0),
        ("unit_mm", 0.001, 0.0),
        ("joint_signs", [1.0, -1.0, 1.0, -1.0, 1.0, -1.0], [1.0, -2.0, 1.0, 1.0, 1.0, 1.0]),
        ("joint_zeros_deg", [360.0, -360.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 540.0, 0.0, 0.0, 0.0]),
        ("abort_word", "STOP", "STOP\r"),
        ("abort_word", "S" * 40, ""),
        ("power_up_asks", ["OK?"], ["?"]),
        ("baud", 4_000_000, 40),
        ("line_end", b"\r\n\r\n", b""),
    ],
)
def test_what_no_controller_can_mean_is_refused_and_the_widest_that_one_can_is_taken(
    key: str, taken: object, refused: object
) -> None:
    msgspec.convert({key: taken}, Dialect, builtin_types=(bytes,))
    with pytest.raises(msgspec.ValidationError, match=key):
        msgspec.convert({key: refused}, Dialect, builtin_types=(bytes,))


def test_no_wait_falls_below_what_a_busy_machine_keeps_nor_grows() -> None:
    assert Dialect().on_a_faster_line(1000.0).prompt_silence_s == pytest.approx(0.006)
    assert Dialect(prompt_silence_s=0.004).on_a_faster_line(1000.0).prompt_silence_s == pytest.approx(0.004)


def test_shortened_waits_serve_a_fast_simulated_line(arm_line: MakesLine) -> None:
    async def scene() -> None:
        async with arm_line(time_scale=20.0).link(Dialect().on_a_faster_line(20.0)) as link:
            await link.move(GOAL)
            assert apart((await link.wait_until_at_rest(GOAL)).location, GOAL)[0] < 0.01

    asyncio.run(scene())
