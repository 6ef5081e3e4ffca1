"""The text of VAL II commands. Strings only: nothing is sent from here."""

from collections.abc import Sequence
from math import ceil, isfinite, log10

from drivers.val2.location import Location

LISTINGS = frozenset({"STATUS", "LISTF", "LISTL", "LISTP", "LISTR", "LISTS", "DIRECTORY", "FREE"})
PRINTS_TEXT = LISTINGS | {"BASE", "HERE"}
"""Monitor commands whose answer may be any text."""
HARMLESS = PRINTS_TEXT | {"WHERE", "ABORT", "PANIC", "SPEED", "TOOL", "Y", "N", "YES", "NO"}
"""Monitor commands, and answers to the controller's questions, that start no motion by themselves. A question whose
answer starts a motion can be open only after a command that is not among these. PANIC stops the arm where ABORT lets it
finish its motion, so it is sent without confirmation."""
PROGRAM_SPEED = "DO SPEED 100 ALWAYS"
"""Resets the factor by which programs multiply the monitor speed to 100 %; another factor would stay until it is
reset."""
HARMLESS_DO = frozenset({"BREAK", "SET"})
"""Program instructions that start no motion. Only the full word counts."""
ARM_ALONE = HARMLESS_DO | {"ALIGN", "APPRO", "APPROS", "DEPART", "DEPARTS", "DRIVE", "MOVE", "MOVES", "NEST", "READY",
                           "SPEED"}  # fmt: skip
"""Program instructions that do not operate the gripper. Only the full word counts: an abbreviation may be taken for
another instruction."""
SAYS_NOTHING = frozenset({"BREAK", "CLOSEI", "MOVE", "MOVES", "OPENI", "SET", "SIGNAL", "SPEED"})
"""Program instructions that facetd uses and that are answered by the prompt alone."""
TURNS_OVER = ("ABOVE", "BELOW", "FLIP", "LEFTY", "NOFLIP", "RIGHTY")
"""Program instructions after which the next motion changes the configuration of shoulder, elbow or wrist."""
SHORTEST = 3
"""Least length of an abbreviation of a harmless word: a shorter one may stand for another word on some system."""


def trans(location: Location, unit_mm: float = 1.0) -> str:
    """TRANS(...) with the digits VAL II prints: mm to 2 decimals, a larger unit as finely, degrees to 3.

    Raises ValueError on inf and nan.
    """
    values = location.values()
    if not all(isfinite(value) for value in values):
        raise ValueError(f"not a location: {values}")
    decimals = 2 + max(0, ceil(log10(unit_mm)))
    lengths = [f"{value / unit_mm:.{decimals}f}" for value in values[:3]]
    angles = [f"{value:.3f}" for value in values[3:]]
    return f"TRANS({','.join(lengths + angles)})"


def move(location: Location, unit_mm: float = 1.0) -> str:
    """Joint-interpolated move."""
    return f"DO MOVE {trans(location, unit_mm)}"


def straight_move(location: Location, variable: str | None, unit_mm: float = 1.0) -> tuple[str, ...]:
    """Straight-line move, in one line or (variable given) by way of a variable."""
    if variable is None:
        return (f"DO MOVES {trans(location, unit_mm)}",)
    return (f"DO SET {variable}={trans(location, unit_mm)}", f"DO MOVES {variable}")


def speed(percent: float) -> str:
    """Monitor speed. Raises ValueError outside 0.1 to 100 percent."""
    if not 0.1 <= percent <= 100:
        raise ValueError(f"speed {percent} percent: expected 0.1 to 100")
    return f"SPEED {percent:g}"


def signals(numbers: Sequence[int]) -> str:
    """Switch digital outputs: n on, -n off. Raises ValueError on 0, and on none."""
    if not numbers or 0 in numbers:
        raise ValueError(f"not outputs: {list(numbers)}")
    return f"DO SIGNAL {','.join(map(str, numbers))}"


def moves_the_arm(command: str) -> bool:
    """Whether a typed command may set anything in motion (the hand included): whatever is not known to be harmless.

    VAL II takes any unambiguous beginning of a word, so those of the harmless words are harmless too.
    """
    words = command.upper().split()
    if not words:
        return False
    if words[0] == "DO":  # alone it repeats the last instruction
        return len(words) < 2 or words[1] not in HARMLESS_DO
    return words[0] not in HARMLESS and not any(
        len(words[0]) >= SHORTEST and known.startswith(words[0]) for known in HARMLESS
    )


def works_the_hand(command: str) -> bool:
    """Whether a typed command may operate the gripper: any motion command that is not known to move only the arm."""
    words = command.upper().split()
    return moves_the_arm(command) and not (words[0] == "DO" and words[1:2] and words[1] in ARM_ALONE)


def turns_over(command: str) -> bool:
    """Whether a typed command, or an abbreviation, may make the next motion change the configuration of shoulder, elbow
    or wrist. It cannot know what a program does."""
    words = command.upper().split()
    if len(words) < 2 or not "DO".startswith(words[0]):
        return False
    return any(known.startswith(words[1]) for known in TURNS_OVER)


def begins_a_program(command: str) -> bool:
    """Whether a typed command may start a program, which keeps running after the controller's next prompt."""
    return moves_the_arm(command) and command.upper().split()[0] != "DO"


def answers_nothing(command: str) -> bool:
    """Whether a line, spelled as facetd does, is answered by the prompt alone, or by an error."""
    words = command.split()
    return words[:1] in (["SPEED"], ["TOOL"]) or (words[:1] == ["DO"] and words[1:2] != [] and words[1] in SAYS_NOTHING)


def prints_text(command: str) -> bool:
    """Whether the answer to a line, by its command word or an abbreviation, may be any text."""
    words = command.upper().split()
    return not moves_the_arm(command) and any(known.startswith(words[0]) for known in PRINTS_TEXT if words)


def tool(flange_from_tool: Location, unit_mm: float = 1.0) -> str:
    """Set the tool centre point, in the flange's frame."""
    return f"TOOL {trans(flange_from_tool, unit_mm)}"
