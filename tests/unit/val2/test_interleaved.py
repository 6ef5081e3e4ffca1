"""Another's line between the letters of ours is told from noise: by what is echoed, and on a line at 9600 baud."""

from __future__ import annotations

import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from drivers.val2.interleaved import SHORTEST_TYPED, answers_search, follows_search, typed_behind, typed_beside
from tests.bench.others_typing import noise, shares, typed_beside_by

OURS = "DO MOVE TRANS(522.00,1.00,-101.00,0.000,80.000,0.000)"
LETTERS = "ABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789=,-()"
REFUSED = b"\r\n*Illegal command*\r\n."
lines = st.text(LETTERS, min_size=SHORTEST_TYPED, max_size=30)


@given(ours=lines, theirs=lines, data=st.data(), prompt=st.sampled_from([b".", b". ", b".."]))
def test_any_two_lines_that_are_typed_into_one_another_are_noticed(
    ours: str, theirs: str, data: st.DataObject, prompt: bytes
) -> None:
    before = data.draw(st.lists(st.integers(0, len(ours)), min_size=len(theirs), max_size=len(theirs)).map(sorted))
    ended = data.draw(st.integers(before[-1], len(ours)))
    mixed, typed = "", 0
    for letter, k in zip(theirs, before, strict=True):
        mixed, typed = mixed + ours[typed:k] + letter, k
    refused = REFUSED[:-1] + prompt
    back = (mixed + ours[typed:ended]).encode() + refused + ours[ended:].encode()
    assert typed_beside(ours.encode(), back)


def test_whichever_letters_somebody_types_they_count() -> None:
    """Of his line's answer nothing came yet; a question is the controller's."""
    for letter in {bytes([code]) for code in range(0x21, 0x7F)} - {b"?"}:
        assert typed_beside(b"WHERE", b"W" + SHORTEST_TYPED * letter + b"\r\nHERE"), letter
        assert not typed_beside(b"WHERE", b"W" + (SHORTEST_TYPED - 1) * letter + b"\r\nHERE"), letter


@pytest.mark.parametrize(
    ("heard", "cancel", "ours"),
    [
        ("", b"", True),
        ("..", b"\x15", True),
        (".....", b"\x15", True),
        ("^U", b"\x15", True),
        ("^U. ^U!!", b"\x15", True),
        ("\x15\x15\x15!!", b"\x15", True),
        ("^U^U", b"\x18", False),
        ("^X^X^C^C", b"\x18\x03", True),
        ("xy", b"\x15", True),
        ("xyz", b"\x15", False),
        ("^U!!DO CLOSEI", b"\x15", False),
    ],
)
def test_what_was_typed_to_find_the_prompt_and_two_letters_of_noise_are_nobodys_line(
    heard: str, cancel: bytes, ours: bool
) -> None:
    assert answers_search(heard, cancel) is ours


@pytest.mark.parametrize(
    ("back", "late"),
    [
        (b"^U\r\n.SPEED", True),
        (b"^U!!\r\n*Illegal command*\r\n. SPEED 40", True),
        (b"DO CLOSEI\r\n.SPEED", False),
        (b"^U\r\n.DO CLOSEI\r\n.SPEED", False),
        (b"^U\r\n.SPEED 1", False),
        (b"^U\r\n.xSPEED", False),
    ],
)
def test_an_echo_is_behind_a_late_search_where_nothing_but_that_is_before_it_and_it_is_ours(
    back: bytes, late: bool
) -> None:
    assert follows_search(b"SPEED 40", back, b"\x15") is late


def spoiled(line: bytes, at: int, harm: str, instead: int) -> bytes:
    kept = {"flip": [instead], "drop": [], "double": [line[at], line[at]], "insert": [instead, line[at]]}[harm]
    return line[:at] + bytes(kept) + line[at + 1 :]


harms = st.tuples(st.floats(0, 1), st.sampled_from(["flip", "drop", "double", "insert"]), st.integers(0, 255))


@given(st.sampled_from(["WHERE", "SPEED 40", "DO BREAK", OURS]), st.lists(harms, max_size=SHORTEST_TYPED))
@example("WHERE", [(0.5, "flip", 13), (0.5, "double", 0), (0.5, "double", 0)])
@example(OURS, [(0.3, "insert", 35)] * SHORTEST_TYPED)
def test_up_to_three_bytes_of_noise_are_nobodys_line(ours: str, noisy: list[tuple[float, str, int]]) -> None:
    """Also where one of them ends the line, and what stood there is refused. Noise that adds a line end, and harms no
    letter, is what somebody's Enter is: of what noise adds, one byte in 128."""
    back = ours.encode()
    for share, harm, instead in noisy:
        if back:
            back = spoiled(back, min(int(share * len(back)), len(back) - 1), harm, instead)
    first, *rest = back.replace(b"\n", b"\r").split(b"\r")
    assume(not rest or not subsequence(ours.encode(), back))
    assert not typed_beside(ours.encode(), first + b"".join(REFUSED + piece for piece in rest))


def subsequence(some: bytes, of: bytes) -> bool:
    left = iter(of)
    return all(byte in left for byte in some)


@given(
    ours=lines,
    at=st.integers(0, 30),
    theirs=st.sampled_from(["", "Y", "N", "GO"]),
    said=st.sampled_from([b"*Illegal command*\r\n.", b"*Syntax error*\r\n.", b"*Ambiguous name*\r\n. ", b"."]),
)
def test_an_enter_and_few_letters_before_it_amid_ours_are_noticed_as_none_of_ours_is_lost(
    ours: str, at: int, theirs: str, said: bytes
) -> None:
    """Somebody who answers a question that nobody asks, or looks whether the controller is there."""
    before, after = ours[:at].encode(), ours[at:].encode()
    assert typed_beside(ours.encode(), before + theirs.encode() + b"\r\n" + said + after)
    if after and not subsequence(ours.encode(), before + theirs.encode() + after[1:]):
        assert not typed_beside(ours.encode(), before + theirs.encode() + b"\r\n" + said + after[1:])


@pytest.mark.parametrize(
    "said",
    [
        b"\r\n*Emergency stop*\r\n.",
        b"\r\nProgram HOLD\r\n.",
        b"\r\nVAL-II 2.0\r\nLoad VAL-II from floppy (Y/N)? ",
        b"\r\n X Y Z O A T\r\n 1.00 2.00 3.00 4.000 5.000 6.000\r\n JT1 JT2 JT3 JT4 JT5 JT6\r\n 1 2 3 4 5 6\r\n.",
    ],
)
def test_what_the_controller_says_amid_an_echo_is_nobodys_line(said: bytes) -> None:
    assert not typed_beside(OURS.encode(), OURS[:20].encode() + said + OURS[20:].encode())


@pytest.mark.parametrize(
    ("said", "others"),
    [
        (b"SPEED 100\r\n*Illegal command*\r\n.", True),
        (b"SP\r\n*Illegal command*\r\n.EED 100\r\n*Illegal command*\r\n.", True),
        (b"#\r\n.", False),
        (b"###\r\n.", False),
        (b"!*Illegal command*\r\n.", False),
        (b"!         X         Y         Z\r\n", False),
        (b"!\r\n.500 .250 1 2 3 4\r\n.", False),
        (b"VAL asks (Y/N)? ", False),
    ],
)
def test_behind_a_whole_echo_a_line_is_anothers_and_a_spoiled_line_end_is_not(said: bytes, others: bool) -> None:
    assert typed_behind(said) is others


def test_a_line_that_another_program_types_amid_a_moves_turn_is_noticed_at_every_moment() -> None:
    assert shares(typed_beside_by("SPEED 100", 0.001), 40) == {"noticed": 40}


def test_an_enter_amid_a_moves_turn_is_noticed_but_while_the_arm_moves() -> None:
    """Typed ahead then, it does nothing but a line end more, which controllers print as they like."""
    assert shares(typed_beside_by("", 0.001), 40)["noticed"] >= 36


@pytest.mark.parametrize("harm", ["drop", "flip", "insert"])
def test_noise_amid_a_moves_turn_is_blamed_on_nobody(harm: str) -> None:
    assert "noticed" not in shares(noise(harm, SHORTEST_TYPED), 20)
