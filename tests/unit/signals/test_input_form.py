"""How an input is read: found by a person who switches it, never assumed, and an odd answer is an error."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon.signals.input_form import FILE, FORMS, InputForm, SignalError, form_found, keep_form, load_form
from daemon.store.outside import FileError

LISTR, TYPE = FORMS
ANSWERS = st.lists(st.one_of(st.none(), st.sampled_from(["0", "-1", "1", ""])), min_size=3, max_size=3)


@given(first=ANSWERS, second=ANSWERS)
def test_only_a_form_whose_answer_follows_the_input_and_comes_back_is_kept(
    first: list[str | None], second: list[str | None]
) -> None:
    found = form_found({LISTR: first, TYPE: second})
    follows = [form for form, (off, on, again) in ((LISTR, first), (TYPE, second)) if off and on and off == again != on]
    assert (None if found is None else found.form) == (follows[0] if follows else None)


def test_an_answer_that_is_neither_of_the_two_known_ones_is_no_level() -> None:
    form = InputForm(LISTR, "0", "-1")
    assert (form.high(1001, "-1"), form.high(1001, "0")) == (True, False)
    for odd in ("", "1", "*Illegal command*", "-1 0"):
        with pytest.raises(
            SignalError, match=r"answered `LISTR SIG\(1001\)` with .*, expected .* or .*: type `signal find` again"
        ):
            form.high(1001, odd)


def test_it_is_kept_on_the_disk_and_a_damaged_file_says_what_to_do(tmp_path: Path) -> None:
    assert load_form(tmp_path) is None
    keep_form(tmp_path, InputForm(TYPE, "0.", "-1."))
    assert load_form(tmp_path) == InputForm(TYPE, "0.", "-1.")
    for damaged in (b"{", b'{"form": "DO RESET", "off": "0", "on": "1"}', b'{"form": "LISTR SIG({number})"}'):
        (tmp_path / FILE).write_bytes(damaged)
        with pytest.raises(FileError, match="delete it, then `signal find`"):
            load_form(tmp_path)
