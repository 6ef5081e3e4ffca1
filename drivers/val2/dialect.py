"""What differs between one VAL II system and the next, as settings with the known-good default. No behaviour here."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

SHORTEST_SILENCE_S, SHORTEST_SETTLE_S = 0.006, 0.002


@dataclass(frozen=True)
class Dialect:
    """One controller's manners on the line. Times in seconds of real time."""

    baud: int = 9600
    software_flow_control: bool = False
    hardware_flow_control: bool = False
    echo: bool = True
    """Whether the controller echoes what is typed; without it a garbled command cannot be caught before it runs."""
    line_end: bytes = b"\r"
    cancel_line: bytes = b"\x15"
    """Makes the controller forget the half-typed line (control-U on terminals of the time)."""
    joint_signs: tuple[float, float, float, float, float, float] = (1.0, 1.0, 1.0, 1.0, 1.0, 1.0)
    joint_zeros_deg: tuple[float, float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    """How this system counts its joints: the angle of our kinematics is sign times the printed one, plus zero."""
    character_pause_s: float = 0.0
    """Pause between typed characters, for controllers that lose some when typed at full speed."""
    echo_settle_s: float = 0.006
    """How long after a whole echo a further (doubled) character may still arrive before the line end is sent."""
    prompt_silence_s: float = 0.02
    """A dot at the start of a line is a prompt once nothing followed it for this long."""
    prompt_after_move: Literal["start", "end", "either"] = "either"
    """When DO MOVE gives the prompt back; "either" waits as long as "end" does before it calls the answer lost."""
    break_after_move: bool = True
    """Ask DO BREAK before polling WHERE."""
    straight_through_variable: bool = True
    """DO SET and DO MOVES of a variable; otherwise DO MOVES TRANS(...) in one line."""
    variable: str = "GOAL"
    calibrate_word: str = "CAL"
    abort_word: str = "ABORT"
    line_limit: int = 79
    typing_s: float = 2.0
    """Longest wait for an echo."""
    answer_s: float = 5.0
    motion_s: float = 60.0
    calibrate_s: float = 180.0
    resync_s: float = 1.0
    typing_attempts: int = 3
    """How often a line whose echo was garbled (and which was therefore never ended) is typed again."""
    poll_s: float = 0.02
    """Pause between two WHERE readings while waiting for rest."""
    same_place_mm: float = 0.03
    same_place_deg: float = 0.01
    """Two readings closer than this show an arm at rest (WHERE prints 0.01 mm and 0.001 degrees)."""
    arrived_mm: float = 0.2
    arrived_deg: float = 0.1
    """How near the target the rest must be."""
    stall_s: float = 1.5
    """An arm at rest elsewhere for this long will not arrive."""

    def on_a_faster_line(self, times: float) -> Dialect:
        """The same manners where characters come `times` faster than the baud says (a simulated line in scaled time).

        Only the waits that are counted in characters shorten, and none below what a busy machine keeps.
        """
        return replace(
            self,
            prompt_silence_s=max(min(SHORTEST_SILENCE_S, self.prompt_silence_s), self.prompt_silence_s / times),
            echo_settle_s=max(min(SHORTEST_SETTLE_S, self.echo_settle_s), self.echo_settle_s / times),
            poll_s=self.poll_s / times,
        )
