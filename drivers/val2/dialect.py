"""Settings for the differences between VAL II systems, with defaults that are known to work. No behaviour."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Literal

from msgspec import Meta

Seconds = Annotated[float, Meta(gt=0, le=3600)]
Pause = Annotated[float, Meta(ge=0, le=10)]
Near = Annotated[float, Meta(gt=0, le=10)]
Unit = Annotated[float, Meta(ge=0.001, le=1000)]
Sign = Annotated[float, Meta(ge=-1, le=1)]
Angle = Annotated[float, Meta(ge=-360, le=360)]
Word = Annotated[str, Meta(min_length=1, max_length=40, pattern="^[ -~]+$")]
Asked = Annotated[str, Meta(min_length=3, max_length=80, pattern="^[ -~]+$")]
SHORTEST_SILENCE_S, SHORTEST_SETTLE_S = 0.006, 0.002
SLOWEST_BAUD = 9600
"""The slowest line on which every stop is confirmed before the operator is sent to the emergency stop."""
WHERE_CHARACTERS = 300
"""More characters than WHERE prints."""


@dataclass(frozen=True)
class Dialect:
    """How one controller speaks on the line. Times are in seconds of real time."""

    baud: Annotated[int, Meta(ge=50, le=4_000_000)] = 9600
    """Speed of the line, bits per second. 8 data bits, no parity, 1 stop bit. facetd refuses less than 9600: on a
    slower line a stop is confirmed too late."""
    software_flow_control: bool = False
    """Whether the line uses XON and XOFF."""
    hardware_flow_control: bool = False
    """Whether the line uses RTS and CTS."""
    echo: bool = True
    """Whether the controller echoes what is typed; without it a garbled command cannot be caught before it runs."""
    line_end: Annotated[bytes, Meta(min_length=1, max_length=4)] = b"\r"
    """What ends a typed line."""
    cancel_line: Annotated[bytes, Meta(max_length=4)] = b"\x15"
    """Makes the controller forget the half-typed line (control-U on terminals of the time)."""
    unit_mm: Unit = 1.0
    """The unit in which this system counts lengths, mm: 25.4 where it counts inches."""
    joint_signs: tuple[Sign, Sign, Sign, Sign, Sign, Sign] = (1.0, 1.0, 1.0, 1.0, 1.0, 1.0)
    """How this system counts its joints: the angle of facetd's kinematics is sign times the printed angle, plus
    zero."""
    joint_zeros_deg: tuple[Angle, Angle, Angle, Angle, Angle, Angle] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    """The zero of each joint, degrees; see `joint_signs`."""
    joint_3_against_horizon: bool = False
    """Whether it counts joint 3 against the horizon: then the angle of joint 2 is subtracted."""
    character_pause_s: Pause = 0.0
    """Pause between typed characters, for controllers that lose some when typed at full speed."""
    echo_settle_s: Pause = 0.006
    """How long after a whole echo a further (doubled) character may still arrive before the line end is sent."""
    prompt_silence_s: Seconds = 0.02
    """A dot at the start of a line is a prompt once nothing followed it for this long."""
    prompt_late_s: Pause = 0.0
    """Longest time from the end of the controller's text to its prompt; facetd waits that long for one that is due."""
    prompt_after_move: Literal["start", "end", "either"] = "either"
    """When DO MOVE gives the prompt back; "either" waits as long as "end" does before it calls the answer lost."""
    break_after_move: bool = True
    """Whether facetd types DO BREAK before it polls WHERE."""
    straight_through_variable: bool = True
    """Whether a straight move is DO SET and DO MOVES of a variable; otherwise it is DO MOVES TRANS(...) in one line."""
    variable: Word = "GOAL"
    """Name of the location variable that facetd sets."""
    calibrate_word: Word = "CAL"
    """The word that lets the arm find its zero."""
    abort_word: Word = "ABORT"
    """The word that stops the arm."""
    power_up_asks: tuple[Asked, ...] = ("floppy", "initiali")
    """Each question that the controller asks after it was switched on contains one of these, in any case. Another
    question may come from a program, and a yes to it may move the arm: facetd answers none."""
    line_limit: Annotated[int, Meta(ge=20, le=1000)] = 79
    """Longest line that the controller takes, characters."""
    typing_s: Seconds = 2.0
    """Longest wait for an echo, s."""
    answer_s: Seconds = 5.0
    """Longest wait for an answer, s."""
    motion_s: Seconds = 60.0
    """Longest wait for the end of a motion, s."""
    calibrate_s: Seconds = 180.0
    """Longest wait for the end of CAL, s."""
    resync_s: Seconds = 1.0
    """How long the line is listened to for a prompt when the conversation is found again, s."""
    typing_attempts: Annotated[int, Meta(ge=1, le=100)] = 3
    """How often a line whose echo was garbled (and which was therefore never ended) is typed again."""
    poll_s: Seconds = 0.02
    """Pause between two WHERE readings while waiting for rest."""
    same_place_mm: Near = 0.03
    """Two readings closer than this show an arm at rest, mm (WHERE prints 0.01 mm)."""
    same_place_deg: Near = 0.01
    """Two readings closer than this show an arm at rest, degrees (WHERE prints 0.001 degrees)."""
    arrived_mm: Near = 0.2
    """How near the target the arm must come to rest, mm."""
    arrived_deg: Near = 0.1
    """How near the target the arm must come to rest, degrees."""
    stall_s: Seconds = 1.5
    """An arm at rest elsewhere for this long will not arrive."""

    @property
    def table_s(self) -> float:
        """How long WHERE may take to print its table and the prompt while nothing moves."""
        return self.resync_s + WHERE_CHARACTERS * 10 / self.baud

    def can_type(self, text: str) -> bool:
        """Whether a line is short enough for the controller and has only printable ASCII characters."""
        return len(text) <= self.line_limit and text.isascii() and text.isprintable()

    def asks_after_power_up(self, question: str) -> bool:
        """Whether a question has the words of those that a controller asks only after it was switched on."""
        return any(words.lower() in question.lower() for words in self.power_up_asks)

    def our_angles_deg(self, printed_deg: Sequence[float]) -> tuple[float, ...]:
        """Convert the joint angles that WHERE prints to those of facetd's kinematics, (6,) degrees."""
        turned = [sign * printed for sign, printed in zip(self.joint_signs, printed_deg, strict=True)]
        if self.joint_3_against_horizon:
            turned[2] -= turned[1]
        return tuple(turn + zero for turn, zero in zip(turned, self.joint_zeros_deg, strict=True))

    def on_a_faster_line(self, times: float) -> Dialect:
        """The same dialect for a line `times` faster than its baud rate (a simulated line in scaled time).

        Only waits that depend on the duration of a character get shorter, and none below what a busy computer can
        keep.
        """
        return replace(
            self,
            prompt_silence_s=max(min(SHORTEST_SILENCE_S, self.prompt_silence_s), self.prompt_silence_s / times),
            echo_settle_s=max(min(SHORTEST_SETTLE_S, self.echo_settle_s), self.echo_settle_s / times),
            poll_s=self.poll_s / times,
        )
