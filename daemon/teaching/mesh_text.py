"""The text of a drawing's file, as editors and programs write it: its encoding, its lines, its numbers. Pure."""

import codecs
import re

from daemon.teaching.mesh import MeshError

Line = tuple[int, str]
"""A line's number, counted from 1 as an editor does, and its text."""
MARKS = ((codecs.BOM_UTF8, "utf-8"), (codecs.BOM_UTF16_LE, "utf-16-le"), (codecs.BOM_UTF16_BE, "utf-16-be"))
NUMBERS = re.compile(r"[+-]?[\d.,]+([eE][+-]?\d+)?(/[\d/-]*)?")
WITH_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")


def plain(content: bytes) -> bytes:
    """A text's bytes without a byte order mark, one byte a letter where it was UTF-16. Bytes, as of the text a letter
    such as Å would end a line."""
    for mark, name in MARKS:
        if content.startswith(mark):
            content = content[len(mark) :]
            return content if name == "utf-8" else _narrow(content, name)
    if content[1:2] == b"\0" and content[3:4] == b"\0" and content[:1] > b"\0":
        return _narrow(content, "utf-16-le")
    return content


def _narrow(content: bytes, name: str) -> bytes:
    return content.decode(name, "replace").encode("latin-1", "replace")


def lines(content: bytes) -> list[Line]:
    """Lines with something on them but a comment, which may stand behind it."""
    texts = enumerate((raw.decode("latin-1").partition("#")[0].strip() for raw in content.splitlines()), 1)
    return [(number, text) for number, text in texts if text]


def joined(found: list[Line]) -> list[Line]:
    """A line that ends in a backslash and the next one as one, under the number of the first."""
    whole: list[Line] = []
    going_on = False
    for number, text in found:
        if going_on:
            number, before = whole.pop()
            text = f"{before} {text}"
        going_on = text.endswith("\\")
        whole.append((number, text.rstrip("\\")))
    return whole


class Words:
    """First words of lines that the format does not have. What could be a corner or a face gone wrong is an error."""

    def __init__(self, kind: str) -> None:
        self.kind, self.odd = kind, dict[str, int]()

    def add(self, words: list[str], line: int) -> None:
        """Keep one for the notes. Raises MeshError where three or more numbers follow it."""
        first = words[0][:20].encode("ascii", "backslashreplace").decode()
        if len(words) > 3 and all(NUMBERS.fullmatch(word) for word in words[1:]):
            raise MeshError(
                f":{line}: `{first}` is no word of an {self.kind} file, and numbers follow it; mend the line"
            )
        self.odd.setdefault(first, line)

    @property
    def notes(self) -> tuple[str, ...]:
        """Each word once, with the line it was first met on."""
        return tuple(
            f"line {line}: `{word}` is no word of an {self.kind} file; left out" for word, line in self.odd.items()
        )


class Numbers:
    """Reads three coordinates a line. Commas may stand for decimal points, if they do so in the whole file."""

    def __init__(self) -> None:
        self.commas = self.points = 0
        """The line on which a number first had one; 0: none did."""

    def three(self, words: list[str], line: int) -> tuple[float, ...]:
        """The first three words as numbers. Raises MeshError, which names the line."""
        words = [word.rstrip(",") for word in words[:3]]
        if any(WITH_COMMA.fullmatch(word) for word in words):
            self.commas = self.commas or line
        if any("." in word for word in words):
            self.points = self.points or line
        if self.commas and self.points:
            raise MeshError(
                f":{line}: decimal commas and decimal points in one file (lines {self.commas}, {self.points}): which "
                "is meant? export it again"
            )
        try:
            found = tuple(float(word.replace(",", ".") if WITH_COMMA.fullmatch(word) else word) for word in words)
        except ValueError:
            found = ()
        if len(found) != 3:
            raise MeshError(f":{line}: expected 3 numbers, found {' '.join(words)[:40]!r}")
        return found

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on the numbers, for people."""
        return ("commas are read as decimal points",) if self.commas else ()
