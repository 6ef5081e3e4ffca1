"""Line editing and echo of the simulated controller's terminal. Bytes only."""

from dataclasses import dataclass
from enum import Enum, auto

from drivers.simcell.controller.manners import Manners

CANCEL_LINE, INTERRUPT = 0x15, 0x03
RUBOUTS = (0x08, 0x7F)
CARRIAGE_RETURN, LINE_FEED = 0x0D, 0x0A
LINE_ENDS = (CARRIAGE_RETURN, LINE_FEED)
IGNORED = (0x00,)
LONGEST_LINE = 80


@dataclass(frozen=True)
class Line:
    """A complete line. second: ended by the second of a pair of line ends, and thus empty."""

    text: str
    second: bool = False


class LineKey(Enum):
    """CANCEL: the line was cancelled. INTERRUPT: control-C, to stop what is running."""

    CANCEL = auto()
    INTERRUPT = auto()


class ControllerTerminal:
    """Line editing with rubout, control-U, control-C."""

    def __init__(self, manners: Manners) -> None:
        self._editing, self._newline = manners.line_editing, manners.newline.encode("ascii")
        self._ends = {"cr": (CARRIAGE_RETURN,), "lf": (LINE_FEED,), "both": LINE_ENDS}[manners.line_ends]
        self._before = 0
        self._typed = bytearray()
        self._too_long = False

    @property
    def typed(self) -> str:
        return self._typed.decode("ascii", "replace")

    def take(self, byte: int) -> tuple[bytes, Line | LineKey | None]:
        """Process one typed byte. Returns the echo, and a completed Line or LineKey."""
        before, self._before = self._before, byte
        if byte in self._ends:
            if before in self._ends and before != byte:
                self._before = 0
                return b"", Line("", second=True)
            text = "?" if self._too_long else self.typed
            self.clear()
            return self._newline, Line(text)
        if byte in LINE_ENDS:
            self._before = before
            return b"", None
        if not self._editing and byte not in IGNORED:
            return self._add(byte), None
        if byte == CANCEL_LINE:
            self.clear()
            return b"^U" + self._newline, LineKey.CANCEL
        if byte == INTERRUPT:
            self.clear()
            return b"^C" + self._newline, LineKey.INTERRUPT
        if byte in RUBOUTS:
            return self._rub_out(), None
        if not 0x20 <= byte <= 0x7E:
            return b"", None
        return self._add(byte), None

    def clear(self) -> None:
        self._typed.clear()
        self._too_long = False

    def _add(self, byte: int) -> bytes:
        if len(self._typed) >= LONGEST_LINE:
            self._too_long = True
            return b"\x07"
        self._typed.append(byte)
        return bytes([byte])

    def _rub_out(self) -> bytes:
        if not self._typed:
            return b""
        self._typed.pop()
        return b"\b \b"
