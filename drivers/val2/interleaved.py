"""Decide whether a wrong echo also contains somebody else's line, or only noise. Pure; bytes in.

Noise changes a byte, loses one, doubles one or adds a few. A person who types on the same line loses none of facetd's
characters, adds a whole line or at least an Enter, and so ends a line that facetd has not ended.
"""

import re

from drivers.val2.wire import JOINT_HEADER, LOCATION_HEADER, NUMBER, PROMPT_DOTS, SHARED_HEADER, STOPPED

SHORTEST_TYPED = 3
"""With this many extra characters, somebody else typed; fewer may be noise."""
LINE_END = re.compile(rb"[\r\n]")
BEGINS_WITH_PROMPT = re.compile(rb"^" + PROMPT_DOTS.pattern)
UNTYPED = bytes(byte for byte in range(256) if not (0x21 <= byte <= 0x7E or byte == 0x07))
"""Bytes that are not counted: for example a space, which may follow a prompt. A bell is counted: it stands for a
character that did not fit into its line."""
REFUSES = re.compile(rb"illegal|syntax|ambiguous|undefined|not defined|misspelled", re.IGNORECASE)
"""How a controller refuses an incomplete line."""
ANSWERS = re.compile(rb"\*|\.\s*$|X *Y|X/JT1")
"""How an answer of the controller begins; needed where the line end before it was lost."""


def typed_beside(ours: bytes, back: bytes) -> bool:
    """Whether the echo (back) of a line that facetd typed and did not end also contains somebody else's line.

    A question mark means no: then the controller asks, after it was switched on or for a program.
    """
    lines = LINE_END.split(back)
    if len(lines) == 1 or b"?" in back:
        return False
    echoed = lines[0] + b"".join(BEGINS_WITH_PROMPT.sub(b"", line) for line in lines[1:] if not _is_answer(line))
    return _length(echoed) - _length(ours) >= SHORTEST_TYPED or (_ended(lines[1:]) and _holds(echoed, ours))


def answers_search(heard: str, cancel_line: bytes) -> bool:
    """Whether text after a prompt that facetd searched for is only the echo of the search (a key such as `^U`), or
    noise: it is shorter than a line that somebody types."""
    return len(_beside_search(heard.encode("latin-1"), cancel_line)) < SHORTEST_TYPED


def follows_search(ours: bytes, back: bytes, cancel_line: bytes) -> bool:
    """Whether the echo (back) of a line begins with the late echo of a search for the prompt, and has nothing else
    before the line."""
    *before, last = LINE_END.split(back)
    searched = all(_is_answer(line) or not _beside_search(line, cancel_line) for line in before)
    return searched and ours.startswith(BEGINS_WITH_PROMPT.sub(b"", last))


def in_carets(keys: bytes) -> bytes:
    """How a controller echoes control keys: `^U`."""
    return b"".join(b"^" + bytes([byte ^ 0x40]) for byte in keys)


def _beside_search(heard: bytes, cancel_line: bytes) -> bytes:
    """What is left of text without prompts and the echo of a search for one."""
    typed = heard.translate(None, UNTYPED)
    for k in range(len(cancel_line)):
        typed = typed.replace(in_carets(cancel_line[k : k + 1]), b"")
    return typed.translate(None, b"!.")


def _ended(lines: list[bytes]) -> bool:
    """Whether the lines after the first line end begin as a controller's answer to a line does: with its prompt, or
    with a refusal; not with something that it reports by itself."""
    first = next((line for line in lines if line.strip()), b"")
    return BEGINS_WITH_PROMPT.match(first) is not None or REFUSES.search(first) is not None


def _holds(echoed: bytes, ours: bytes) -> bool:
    """Whether the echo has all of facetd's characters, in order: noise that turns one into a line end loses it."""
    left = iter(echoed.translate(None, UNTYPED))
    return all(byte in left for byte in ours.translate(None, UNTYPED))


def typed_behind(heard: bytes) -> bool:
    """Whether the output after a complete echo and its line end contains a line that somebody else typed: before the
    echo of facetd's line end, or after a prompt. It needs one more character than in an echo, because facetd's line end
    may be damaged."""
    first, *lines = LINE_END.split(heard)
    prompted = [line for line in lines if BEGINS_WITH_PROMPT.match(line) and not _is_answer(line)]
    behind_prompts = b"".join(BEGINS_WITH_PROMPT.sub(b"", line) for line in prompted)
    count = _length(ANSWERS.split(first)[0]) + _length(behind_prompts)
    return b"?" not in first and count > SHORTEST_TYPED


def _is_answer(line: bytes) -> bool:
    """Whether a line is a message of the controller, or a line of WHERE's table."""
    text = line.decode("latin-1")
    words = text.split()
    in_a_table = len(words) >= len(LOCATION_HEADER) and all(
        NUMBER.fullmatch(word) or any(word in head for head in (LOCATION_HEADER, JOINT_HEADER, SHARED_HEADER))
        for word in words
    )
    return in_a_table or "*" in text or STOPPED.search(text) is not None


def _length(typed: bytes) -> int:
    return len(typed.translate(None, UNTYPED))
