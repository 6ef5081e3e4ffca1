"""Whether an echo that is not what was typed holds another's line as well, or noise alone. Pure; bytes in.

Noise flips a byte, loses one, doubles or adds a few. Whoever types on the same line loses none of our letters, adds a
line's worth of his own, or as little as an Enter, and ends a line that we had not ended.
"""

import re

from drivers.val2.wire import JOINT_HEADER, LOCATION_HEADER, NUMBER, PROMPT_DOTS, SHARED_HEADER, STOPPED

SHORTEST_TYPED = 3
"""Characters too many that are taken for somebody else's: with fewer it may be noise."""
LINE_END = re.compile(rb"[\r\n]")
BEGINS_WITH_PROMPT = re.compile(rb"^" + PROMPT_DOTS.pattern)
UNTYPED = bytes(byte for byte in range(256) if not (0x21 <= byte <= 0x7E or byte == 0x07))
"""What is not counted: a space may stand behind a prompt. A bell is a character that found no room in its line."""
REFUSES = re.compile(rb"illegal|syntax|ambiguous|undefined|not defined|misspelled", re.IGNORECASE)
"""How a controller refuses half a line."""
ANSWERS = re.compile(rb"\*|\.\s*$|X *Y|X/JT1")
"""Where an answer of the controller's begins, should the line end before it be lost."""


def typed_beside(ours: bytes, back: bytes) -> bool:
    """Whether what came back of a line that was typed and not ended, up to silence, holds another's line as well.

    What asks is the controller: it was switched on meanwhile, or a program asks.
    """
    lines = LINE_END.split(back)
    if len(lines) == 1 or b"?" in back:
        return False
    echoed = lines[0] + b"".join(BEGINS_WITH_PROMPT.sub(b"", line) for line in lines[1:] if not _is_answer(line))
    return _length(echoed) - _length(ours) >= SHORTEST_TYPED or (_ended(lines[1:]) and _holds(echoed, ours))


def answers_search(heard: str, cancel_line: bytes) -> bool:
    """Whether what came behind the prompt that was looked for may be the echo of what was typed to find it (such a key
    as `^U`), or noise: it holds less than a line that somebody types."""
    typed = heard.encode("latin-1").translate(None, UNTYPED)
    for byte in cancel_line:
        typed = typed.replace(b"^" + bytes([byte ^ 0x40]), b"")
    return len(typed.translate(None, b"!.")) < SHORTEST_TYPED


def _ended(lines: list[bytes]) -> bool:
    """Whether what came behind the first line end is what a controller says to a line: its prompt at once, or that it
    knows no such command; and nothing that it says by itself."""
    first = next((line for line in lines if line.strip()), b"")
    return BEGINS_WITH_PROMPT.match(first) is not None or REFUSES.search(first) is not None


def _holds(echoed: bytes, ours: bytes) -> bool:
    """Whether all of our letters are there, in order: noise that makes a line end of one loses it."""
    left = iter(echoed.translate(None, UNTYPED))
    return all(byte in left for byte in ours.translate(None, UNTYPED))


def typed_behind(said: bytes) -> bool:
    """Whether what came after a whole echo, its line end sent, begins with a line's worth that somebody typed: before
    our line end is echoed, and behind a prompt. One character more than in an echo, as that line end may be spoiled."""
    first, *lines = LINE_END.split(said)
    prompted = [line for line in lines if BEGINS_WITH_PROMPT.match(line) and not _is_answer(line)]
    behind_prompts = b"".join(BEGINS_WITH_PROMPT.sub(b"", line) for line in prompted)
    count = _length(ANSWERS.split(first)[0]) + _length(behind_prompts)
    return b"?" not in first and count > SHORTEST_TYPED


def _is_answer(line: bytes) -> bool:
    """Whether a line is a message, or one of WHERE's."""
    text = line.decode("latin-1")
    words = text.split()
    in_a_table = len(words) >= len(LOCATION_HEADER) and all(
        NUMBER.fullmatch(word) or any(word in head for head in (LOCATION_HEADER, JOINT_HEADER, SHARED_HEADER))
        for word in words
    )
    return in_a_table or "*" in text or STOPPED.search(text) is not None


def _length(typed: bytes) -> int:
    return len(typed.translate(None, UNTYPED))
