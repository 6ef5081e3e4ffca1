"""Line editor for a terminal (VT100 or better): bytes in; lines, keys and bytes to echo out. No I/O.

Keys: backspace or delete, control-U (line), control-W (word), control-A, control-E and the arrows (cursor), control-P,
control-N and the arrows (history), control-L (draw again, and ask how large the terminal is), tab (complete),
control-C (interrupt), control-D (end).
"""

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum

from daemon.console.text_layout import LOWEST, NARROWEST, fold
from daemon.errors import visible

LONGEST_LINE = 240
COLUMNS, ROWS = 80, 24
"""A VT100's size, until the terminal reports its own."""
ASK_SIZE = b"\x1b7\x1b[999;999H\x1b[6n\x1b8"
"""Move the cursor as far as it goes, ask for its position, move back."""
SIZE = re.compile(rb"(\d{1,4});(\d{1,4})R")
HISTORY = 200
BELL = b"\x07"
CLEAR_TO_END = b"\x1b[K"
MORE_LEFT, MORE_RIGHT = "<", ">"
"""Marks of a line that is longer than its row."""


class EditorKey(Enum):
    """Keys with a meaning of their own."""

    INTERRUPT = "interrupt"
    END = "end"


@dataclass
class EditorOutput:
    """The result of some bytes: what to send back to the terminal, and lines or keys in order."""

    echo: bytes = b""
    events: list[str | EditorKey] = field(default_factory=list)


class LineEditor:
    """The line being typed at one terminal. `complete` returns whole lines that complete the typed one."""

    def __init__(self, prompt: str, complete: Callable[[str], list[str]]) -> None:
        self.prompt, self.complete = prompt, complete
        self.history: list[str] = []
        self.remember = True
        self.columns, self.rows = COLUMNS, ROWS
        self.text, self._cursor, self._back = "", 0, 0
        self._first, self._fits = 0, True
        """The first visible character, and whether all after it fits in the row."""
        self._unsent_line = ""
        self._escape = b""
        self._after_cr = False
        self._keys: dict[int, Callable[[], bytes]] = {
            0x01: self._home, 0x02: self._left, 0x04: self._delete, 0x05: self._end, 0x06: self._right,
            0x08: self._backspace, 0x09: self._tab, 0x0C: self._redraw, 0x0E: self._later, 0x10: self._earlier,
            0x12: self._redraw, 0x15: self._kill_line, 0x17: self._kill_word, 0x7F: self._backspace,
        }  # fmt: skip
        self._escapes: dict[bytes, Callable[[], bytes]] = {
            b"A": self._earlier, b"B": self._later, b"C": self._right, b"D": self._left,
            b"H": self._home, b"F": self._end, b"3~": self._delete,
        }  # fmt: skip

    def feed(self, data: bytes) -> EditorOutput:
        typed = EditorOutput()
        for byte in data:
            self._take(byte, typed)
        return typed

    def show_prompt(self) -> bytes:
        """Draw the prompt and the typed line in one row; of a longer line the part around the cursor."""
        room = self._scrolled()
        shown = list(self.text[self._first : self._first + room])
        if self._first:
            shown[0] = MORE_LEFT
        if not self._fits:
            shown[-1] = MORE_RIGHT
        back = b"\b" * (self._first + len(shown) - self._cursor)
        return b"\r" + (self.prompt + "".join(shown)).encode() + CLEAR_TO_END + back

    def notice(self, text: str) -> bytes:
        """Print lines above the line being typed and draw that again below them."""
        return b"\r" + CLEAR_TO_END + to_terminal(text, self.columns - 1) + self.show_prompt()

    def _scrolled(self) -> int:
        """Move the visible part of the line to the cursor; returns how many characters fit."""
        room = max(4, self.columns - 1 - len(self.prompt))
        at, length = self._cursor - self._first, len(self.text)
        in_view = (at > 0 or self._first == 0) and (at < room - 1 or (at <= room and self._first + room >= length))
        if length <= room:
            self._first = 0
        elif not in_view:
            self._first = max(0, self._cursor - room // 2)
        self._fits = length - self._first <= room
        return room

    def _drawn(self, changed: bytes) -> bytes:
        """The bytes that show a change: just these, where the whole line fits in its row; else the line drawn again."""
        before = self._first, self._fits
        self._scrolled()
        return changed if before == (self._first, True) and self._fits else self.show_prompt()

    def _take(self, byte: int, typed: EditorOutput) -> None:
        if self._escape and (byte < 0x20 or (self._escape == b"\x1b" and byte not in b"[O")):
            self._escape = b""  # it was a stray one: what follows is typed for itself
        if self._escape:
            typed.echo += self._continue_escape(byte)
        elif byte == 0x0A and self._after_cr:
            pass  # the other half of a line's end
        elif byte in (0x0D, 0x0A):
            typed.echo += b"\r\n"
            typed.events.append(self._finish())
        elif byte == 0x03:
            self._start_over()
            typed.echo += b"^C\r\n"
            typed.events.append(EditorKey.INTERRUPT)
        elif byte == 0x04 and not self.text:
            typed.events.append(EditorKey.END)
        elif byte == 0x1B:
            self._escape = b"\x1b"
        elif byte in self._keys:
            typed.echo += self._keys[byte]()
        elif 0x20 <= byte < 0x7F:
            typed.echo += self._insert(chr(byte))
        elif byte:
            typed.echo += BELL
        self._after_cr = byte == 0x0D

    def _continue_escape(self, byte: int) -> bytes:
        self._escape += bytes([byte])
        body = self._escape[2:]
        if len(self._escape) == 2:
            return b""
        if not (0x40 <= byte <= 0x7E) and len(body) < 8:
            return b""
        self._escape = b""
        if size := SIZE.fullmatch(body):
            self._sized(int(size[1]), int(size[2]))
            return b""
        return self._escapes[body]() if body in self._escapes else BELL

    def _sized(self, rows: int, columns: int) -> None:
        """Take over the terminal's size; an impossible one (it cannot move to its last corner) is ignored."""
        if rows >= LOWEST and columns >= NARROWEST:
            self.rows, self.columns = rows, columns

    def _finish(self) -> str:
        line = self.text
        if self.remember and line.strip() and (not self.history or self.history[-1] != line):
            self.history = [*self.history, line][-HISTORY:]
        self._start_over()
        return line

    def _start_over(self) -> None:
        self.text, self._cursor, self._back, self._unsent_line = "", 0, 0, ""
        self._first, self._fits = 0, True

    def _insert(self, text: str) -> bytes:
        if len(self.text) + len(text) > LONGEST_LINE:
            return BELL
        tail = self.text[self._cursor :]
        self.text = self.text[: self._cursor] + text + tail
        self._cursor += len(text)
        return self._drawn((text + tail).encode() + b"\b" * len(tail))

    def _delete_range(self, start: int, end: int) -> bytes:
        """Remove characters; the cursor must be at start or end, and is at start afterwards."""
        if start == end:
            return BELL
        tail = self.text[end:]
        moved = b"\b" * (self._cursor - start)
        self.text, self._cursor = self.text[:start] + tail, start
        return self._drawn(moved + tail.encode() + CLEAR_TO_END + b"\b" * len(tail))

    def _backspace(self) -> bytes:
        return self._delete_range(max(0, self._cursor - 1), self._cursor)

    def _delete(self) -> bytes:
        return self._delete_range(self._cursor, min(len(self.text), self._cursor + 1))

    def _kill_line(self) -> bytes:
        return self._replace("") if self.text else b""

    def _kill_word(self) -> bytes:
        start = len(self.text[: self._cursor].rstrip().rpartition(" ")[0])
        return self._delete_range(start + (start > 0), self._cursor)

    def _home(self) -> bytes:
        moved, self._cursor = b"\b" * self._cursor, 0
        return self._drawn(moved)

    def _end(self) -> bytes:
        tail, self._cursor = self.text[self._cursor :], len(self.text)
        return self._drawn(tail.encode())

    def _left(self) -> bytes:
        if self._cursor == 0:
            return BELL
        self._cursor -= 1
        return self._drawn(b"\b")

    def _right(self) -> bytes:
        if self._cursor == len(self.text):
            return BELL
        self._cursor += 1
        return self._drawn(self.text[self._cursor - 1].encode())

    def _redraw(self) -> bytes:
        return b"\r\n" + ASK_SIZE + self.show_prompt()

    def _replace(self, text: str) -> bytes:
        self.text, self._cursor = text, len(text)
        return self.show_prompt()

    def _earlier(self) -> bytes:
        if self._back == len(self.history):
            return BELL
        if self._back == 0:
            self._unsent_line = self.text
        self._back += 1
        return self._replace(self.history[-self._back])

    def _later(self) -> bytes:
        if self._back == 0:
            return BELL
        self._back -= 1
        return self._replace(self.history[-self._back] if self._back else self._unsent_line)

    def _tab(self) -> bytes:
        before = self.text[: self._cursor]
        options = self.complete(before)
        if not options:
            return BELL
        common = _common_start(options)
        if len(common) > len(before):
            return self._insert(common[len(before) :] + (" " if len(options) == 1 and common[-1] != "/" else ""))
        offered = "  ".join(o.rpartition(" ")[2] for o in options)
        return b"\r\n" + to_terminal(offered, self.columns - 1) + self.show_prompt()


def to_terminal(text: str, columns: int = COLUMNS - 1) -> bytes:
    """Text as a terminal needs it: ASCII, folded between words, CR LF at each end."""
    return b"".join(line.encode("ascii", "replace") + b"\r\n" for line in fold(visible(text), columns))


def _common_start(options: list[str]) -> str:
    first, last = min(options), max(options)
    same = next((i for i, (a, b) in enumerate(zip(first, last, strict=False)) if a != b), min(len(first), len(last)))
    return first[:same]
