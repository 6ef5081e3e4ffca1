"""How this controller reads an input: a command text, and its answers for off and on, found by a test and stored.

No document says what a controller prints. A person switches an input off, on and off; the form counts whose answer
follows. Any other answer is an error, never a level.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import msgspec

from daemon.errors import FacetdError
from daemon.store.json_file import read_json, write_json
from daemon.store.outside import FileError

FILE = "signal-reading.json"
"""File name in the state folder."""
FORMS = ("LISTR SIG({number})", "DO TYPE SIG({number})")
"""Command texts that print one input, in the order of the test; none changes anything."""


class SignalError(FacetdError):
    """A signal cannot be read or set: what, and what to do."""

    code = "signal"


class InputForm(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """form: the command text; off, on: the controller's answers."""

    form: str
    off: str
    on: str

    def line(self, number: int) -> str:
        """The command that reads an input."""
        return self.form.format(number=number)

    def high(self, number: int, printed: str) -> bool:
        """Whether the input is at its high level. Raises SignalError on any other answer than the two known ones."""
        if printed not in (self.on, self.off):
            answered = f"the controller answered `{self.line(number)}` with {printed[:40]!r}"
            raise SignalError(f"{answered}, expected {self.on!r} or {self.off!r}: type `signal find` again")
        return printed == self.on


def form_found(printed: Mapping[str, Sequence[str | None]]) -> InputForm | None:
    """The first form whose answers follow the input. printed: answers for off, on, off by form, None if refused."""
    for form, (off, on, again) in printed.items():
        if off and on and off == again and on != off:
            return InputForm(form, off, on)
    return None


def load_form(folder: Path) -> InputForm | None:
    """Load the stored form; None where none was found yet. Raises FileError."""
    path = folder / FILE
    found = read_json(path, InputForm, "delete it, then `signal find`")
    if found is not None and (found.form not in FORMS or found.on == found.off):
        raise FileError(f"{path}: holds no valid form: delete it, then `signal find`")
    return found


def keep_form(folder: Path, form: InputForm) -> None:
    """Store the form. Raises FileError."""
    write_json(folder / FILE, form)
