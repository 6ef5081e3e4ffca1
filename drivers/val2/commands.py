"""The text of VAL II commands. Strings only: nothing is sent from here."""

from collections.abc import Sequence
from math import ceil, isfinite, log10

from drivers.val2.location import Location

LISTINGS = frozenset({"STATUS", "LISTF", "LISTL", "LISTP", "LISTR", "LISTS", "DIRECTORY", "FREE"})
PRINTS_TEXT = LISTINGS | {"BASE", "HERE"}
"""Monitor words that are answered by text of any kind."""
HARMLESS = PRINTS_TEXT | {"WHERE", "ABORT", "PANIC", "SPEED", "TOOL", "Y", "N", "YES", "NO"}
"""Monitor words, and answers to the controller's questions, that set nothing in motion by themselves. A question whose
yes begins a motion is only open where a word that is not among these was typed before. PANIC stops the arm where ABORT
lets it finish its motion: whoever types it is not asked whether it may be sent."""
PROGRAM_SPEED = "DO SPEED 100 ALWAYS"
"""What programs multiply the monitor's speed by, back to where it changes nothing; who says another has it so for
good."""
HARMLESS_DO = frozenset({"BREAK", "SET"})
"""Program instructions of which the same is true, spelled out."""
ARM_ALONE = HARMLESS_DO | {"ALIGN", "APPRO", "APPROS", "DEPART", "DEPARTS", "DRIVE", "MOVE", "MOVES", "NEST", "READY",
                           "SPEED"}  # fmt: skip
"""Program instructions that work no hand, spelled out: of a beginning nobody knows for which it is taken."""
SAYS_NOTHING = frozenset({"BREAK", "CLOSEI", "MOVE", "MOVES", "OPENI", "SET", "SIGNAL", "SPEED"})
"""Program instructions of ours that are answered by the prompt alone."""
TURNS_OVER = ("ABOVE", "BELOW", "FLIP", "LEFTY", "NOFLIP", "RIGHTY")
"""Program instructions after which the next motion, whoever's, goes with shoulder, elbow or wrist turned over."""
SHORTEST = 3
"""Letters that a beginning of a harmless word has at least: with fewer it may be another word's on some system."""


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
    if words[0] == "DO":  # alone it does again what was done last
        return len(words) < 2 or words[1] not in HARMLESS_DO
    return words[0] not in HARMLESS and not any(
        len(words[0]) >= SHORTEST and known.startswith(words[0]) for known in HARMLESS
    )


def works_the_hand(command: str) -> bool:
    """Whether a typed command may work the hand: whatever moves, and is not known to move the arm alone."""
    words = command.upper().split()
    return moves_the_arm(command) and not (words[0] == "DO" and words[1:2] and words[1] in ARM_ALONE)


def turns_over(command: str) -> bool:
    """Whether a typed command may have the next motion turn shoulder, elbow or wrist over, by any beginning of such a
    word. What a program says nobody knows."""
    words = command.upper().split()
    if len(words) < 2 or not "DO".startswith(words[0]):
        return False
    return any(known.startswith(words[1]) for known in TURNS_OVER)


def begins_a_program(command: str) -> bool:
    """Whether a typed command may begin a program, which goes on when the controller asks for the next command."""
    return moves_the_arm(command) and command.upper().split()[0] != "DO"


def answers_nothing(command: str) -> bool:
    """Whether a line, spelled as we do, is answered by the prompt alone, or by an error."""
    words = command.split()
    return words[:1] in (["SPEED"], ["TOOL"]) or (words[:1] == ["DO"] and words[1:2] != [] and words[1] in SAYS_NOTHING)


def prints_text(command: str) -> bool:
    """Whether a line, by its word or the beginning of one, is answered by text of any kind."""
    words = command.upper().split()
    return not moves_the_arm(command) and any(known.startswith(words[0]) for known in PRINTS_TEXT if words)


def tool(flange_from_tool: Location, unit_mm: float = 1.0) -> str:
    """Where the tool point lies, seen from the flange."""
    return f"TOOL {trans(flange_from_tool, unit_mm)}"
