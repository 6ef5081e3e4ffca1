"""The wire as a ledger: every line sent, echoed and answered, numbered without a gap.

Records are plain dictionaries; who keeps them chains them, so that what was lost or altered afterwards is seen.

    {"seq": 3, "t_s": 12.304, "way": "out", "what": "sent", "bytes": "WHERE"}

way: out (to the controller) or in. what: sent, or the kind of event that was heard. bytes: one character a byte
(latin-1), so that all bytes one way, in order, are the stream of that way.
"""

import contextlib
from collections.abc import Callable
from typing import Any

Record = dict[str, Any]


class Ledger:
    """Numbers records and hands each on."""

    def __init__(self, on_record: Callable[[Record], None] | None = None) -> None:
        self._on_record = on_record
        self._seq = 0

    def sent(self, data: bytes, t_s: float) -> None:
        """Bytes that went to the controller."""
        self._record(t_s, "out", "sent", data)

    def heard(self, what: str, data: bytes, t_s: float) -> None:
        """What was heard, and the bytes it was read from."""
        self._record(t_s, "in", what, data)

    def _record(self, t_s: float, way: str, what: str, data: bytes) -> None:
        if self._on_record is None:
            return
        record: Record = {
            "seq": self._seq,
            "t_s": round(t_s, 6),
            "way": way,
            "what": what,
            "bytes": data.decode("latin-1"),
        }
        self._seq += 1
        with contextlib.suppress(Exception):  # a record nobody could keep is missed by its number; the line goes on
            self._on_record(record)
