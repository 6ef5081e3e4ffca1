"""How an input is read on this controller: a form of words that was found by a person who switched one, and kept.

No source shows what a controller prints, so nothing is assumed: a form counts whose answer differs while the input is
on and is the first one again when it is off. An answer that is neither of the two is an error, never a level.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import msgspec

from daemon.errors import FacetdError
from daemon.store.files import failing_as, write_atomically
from daemon.store.json_file import read_json
from daemon.store.outside import FileError

FILE = "signal-reading.json"
"""Its name in the state folder."""
FORMS = ("LISTR SIG({number})", "DO TYPE SIG({number})")
"""Forms of words that print one input, in the order in which they are tried; none of them sets anything."""


class SignalError(FacetdError):
    """A signal cannot be read or set: what, and what to do."""

    code = "signal"


class InputForm(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """form: what is typed; off, on: what the controller printed."""

    form: str
    off: str
    on: str

    def line(self, number: int) -> str:
        """What is typed to read an input."""
        return self.form.format(number=number)

    def high(self, number: int, printed: str) -> bool:
        """Whether the input is at its high level. Raises SignalError on any other answer than the two known ones."""
        if printed not in (self.on, self.off):
            problem = f"`{self.line(number)}` printed {printed[:40]!r}, which is neither {self.on!r} nor {self.off!r}"
            raise SignalError(f"{problem}: `signal find` anew")
        return printed == self.on


def form_found(printed: Mapping[str, Sequence[str | None]]) -> InputForm | None:
    """The first form whose answer followed the input: off, on, off again. printed: those answers by form, None where
    the controller refused it."""
    for form, (off, on, again) in printed.items():
        if off and on and off == again and on != off:
            return InputForm(form, off, on)
    return None


def load_form(folder: Path) -> InputForm | None:
    """What was kept; None where nothing was found yet. Raises FileError."""
    path = folder / FILE
    found = read_json(path, InputForm, "delete it, then `signal find`")
    if found is not None and (found.form not in FORMS or found.on == found.off):
        raise FileError(f"{path}: not a form of words that reads an input: delete it, then `signal find`")
    return found


def keep_form(folder: Path, form: InputForm) -> None:
    """Keep it. Raises FileError."""
    with failing_as(FileError, f"{folder / FILE}: not kept"):
        write_atomically(folder / FILE, msgspec.json.encode(form))
