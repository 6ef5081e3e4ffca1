"""Variants of VAL controllers: what differs between one and the next, and random ones. Values only.

Sources (S: seen in a manual or a client that drove real arms; R: general knowledge of such systems):

    echo, newline, prompt ".", dot then silence    S: public clients; an encyclopaedia's page on VAL (dot at top level)
    line_ends: LF CR answered by two prompts       S: a public driver's start-up routine, which reads a dot behind a dot
    prompt with a space; late; upper case alone    R: terminals of the time print and read so
    abbreviations, as many letters as are unique   S: the same page; older monitors that want the whole word: R
    where: two headers, or one with X/JT1          S: clients that count numbers from the end; R: the other, and HAND
    decimals, none where they are nothing, a bare  R: what FORTRAN and BASIC of the time print
      point, no leading zero
    unit_mm: lengths in inches                     R: small arms are drawn in inches (a 260's are 8, 8 and 5)
    error: between asterisks, or in capitals       S: the asterisks; R: the words
    power_up: floppy and initialise, or the latter S: owners: VAL II asks to load from floppy, VAL only the other
    stops_at_once: ABORT ends what runs and lets   S: V+ manuals: ABORT ends the program, PANIC the motion as well
      the motion finish, PANIC brakes
    knows_break                                    R: BREAK as an immediate instruction is not everywhere
    lost_within_s: a character that follows too    R: single-character receivers polled by software
      closely is lost
    joint_signs, joint_zeros_deg, against_horizon  S: two published tables that differ so; R: the horizon
"""

from dataclasses import dataclass
from typing import Literal, TypeVar

import numpy as np

from drivers.arrays import Array

T = TypeVar("T")
LineEnds = Literal["cr", "lf", "both"]
WhereForm = Literal["two headers", "one header"]
Six = tuple[float, float, float, float, float, float]
VAL_II_ASKS = ("Load VAL-II from floppy (Y/N)?", "Initialize (Y/N)?")
POWER_UP = (
    VAL_II_ASKS,
    ("Initialize (Y/N)?",),
    ("LOAD VAL FROM FLOPPY (Y/N)?", "INITIALIZE (Y/N)?"),
    ("Initialise memory? (Y/N)",),
)


@dataclass(frozen=True)
class Manners:
    """Behaviour of a controller and the people near it; times in the controller's seconds."""

    echo: bool = True
    line_editing: bool = True
    """Whether control-U, rubout and control-C are control keys, or characters like any other."""
    prompt_after_move: Literal["start", "end"] = "start"
    hand_s: float = 0.3
    calibration_s: float = 6.0
    arm_power_after_s: float | None = None
    """Time after which somebody switches arm power on when CAL lacks it (None: nobody does)."""
    line_ends: LineEnds = "cr"
    """End of a typed line; the other is ignored. both: each of a pair ends a line, and the second is answered by
    another prompt."""
    newline: str = "\r\n"
    prompt: str = "."
    prompt_late_s: float = 0.0
    """Pause before the prompt."""
    upper_only: bool = False
    """Whether lower case is refused."""
    abbreviations: bool = True
    where: WhereForm = "two headers"
    hand_column: bool = False
    """Whether a seventh number, the gripper's opening, follows the location (one header only)."""
    decimals: tuple[int, int] = (2, 3)
    """Decimals of lengths and of angles."""
    leading_zero: bool = True
    """Whether 0.5 is printed so, or as .5."""
    trailing_zeros: bool = True
    """Whether 12.50 and 5.00 are printed so, or as 12.5 and 5."""
    unit_mm: float = 1.0
    """Unit of lengths in WHERE, TRANS, TOOL, APPRO and DEPART."""
    capital_errors: bool = False
    power_up: tuple[str, ...] = VAL_II_ASKS
    stops_at_once: bool = True
    """Whether ABORT brakes; else it drops waiting commands and the motion finishes, and PANIC brakes."""
    knows_break: bool = True
    lost_within_s: float = 0.0
    """A character that follows another within this time is lost."""
    reads_inputs_by: Literal["LISTR", "TYPE"] = "LISTR"
    """By which word an input is printed: `LISTR SIG(1001)`, or `DO TYPE SIG(1001)`."""
    joint_signs: Six = (1.0, 1.0, 1.0, 1.0, 1.0, 1.0)
    joint_zeros_deg: Six = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    """Joint convention of WHERE and DRIVE: our angle is sign times the printed one, plus zero."""
    against_horizon: bool = False
    """Whether joint 3 is measured from the horizon instead of the upper arm."""

    def printed_deg(self, joints_rad: Array) -> Array:
        """Our angles (6,) rad -> degrees as printed."""
        signs = np.array(self.joint_signs)
        printed: Array = (np.degrees(joints_rad) - np.array(self.joint_zeros_deg)) * signs
        if self.against_horizon:
            printed[2] += signs[2] * signs[1] * printed[1]
        return printed

    def joints_rad(self, printed_deg: Array) -> Array:
        """Printed angles (6,) degrees -> our angles, rad."""
        signs = np.array(self.joint_signs)
        turned = signs * printed_deg
        if self.against_horizon:
            turned[2] -= turned[1]
        return np.asarray(np.radians(turned + np.array(self.joint_zeros_deg)))


def drawn(rng: np.random.Generator) -> Manners:
    """A random variant."""

    def one(*choices: T) -> T:
        return choices[int(rng.integers(len(choices)))]

    def six(*choices: float) -> Six:
        return one(*choices), one(*choices), one(*choices), one(*choices), one(*choices), one(*choices)

    later = rng.spawn(1)[0]
    """A generator of its own, so that a seed gives the same variant as before these values were added."""
    inches = bool(later.random() < 0.12)
    line_ends: LineEnds = one("cr", "cr", "both", "lf")
    where: WhereForm = one("two headers", "one header")
    return Manners(
        echo=one(True, True, True, False),
        line_editing=one(True, True, False),
        prompt_after_move=one("start", "end"),
        line_ends=line_ends,
        newline=one("\r\n", "\n\r", "\r") if line_ends == "cr" else "\r\n",
        prompt=one(".", ". ", ".."),
        prompt_late_s=one(0.0, 0.05, 0.3, 0.8),
        upper_only=one(True, False),
        abbreviations=one(True, True, False),
        where=where,
        hand_column=where == "one header" and one(True, False),
        decimals=one((2, 3), (3, 3), (2, 2), (1, 3)) if not inches else (one(3, 3, 4, 3), 3),
        leading_zero=one(True, True, False),
        trailing_zeros=bool(later.random() < 0.7),
        unit_mm=25.4 if inches else 1.0,
        capital_errors=one(True, False),
        power_up=one(*POWER_UP),
        stops_at_once=one(True, True, True, False),
        knows_break=one(True, True, True, False),
        lost_within_s=one(0.0, 0.0, 0.004, 0.02),
        joint_signs=six(-1.0, 1.0),
        joint_zeros_deg=six(-180.0, -90.0, 0.0, 90.0),
        against_horizon=one(True, False, False, False),
    )
