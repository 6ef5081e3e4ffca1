"""What `auto` was asked for and has not brought yet. A value; the log has it, too, for a restart."""

from __future__ import annotations

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class PickOrder:
    """count: how many parts are still to be put into the bin (None: until the table is empty); every_s: after how long
    an empty table is looked at again (None: it ends the pick_order)."""

    count: int | None = None
    every_s: float | None = None

    @property
    def done(self) -> bool:
        """Whether nothing is left of it."""
        return self.count == 0

    def one_less(self) -> PickOrder:
        """After a part was put into the bin."""
        return self if self.count is None else replace(self, count=max(0, self.count - 1))
