"""What is still to be picked: a count of any parts (`auto on 20`), one part (`pick cube`), or the steps of a job file.

A value. The run log and the recovery file hold it as well, so that a restart can continue it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any

import msgspec
from msgspec import Struct
from msgspec.structs import replace


class OrderStep(Struct, frozen=True, omit_defaults=True):
    """count parts with label `part` are still to be brought; place: the place or pattern that they go to, `bin` for the
    bin, None for wherever such parts belong."""

    part: str
    count: int = 1
    place: str | None = None


class PickOrder(Struct, frozen=True):
    """count: how many parts are still to be brought in all, None for every one that lies there; every_s: after how many
    seconds a table without a wanted part is looked at again, None where that ends the order.

    job: name of the job that it comes from; steps: what is still to be brought this time, none for any part; in_turn:
    only the first step is wanted now; skip: a step whose part is not there is left out; times: how often all of `whole`
    is to be brought, this time included; on_signal: the line asks for each part.
    """

    count: int | None = None
    every_s: float | None = None
    job: str | None = None
    steps: tuple[OrderStep, ...] = ()
    in_turn: bool = True
    skip: bool = False
    times: int = 1
    whole: tuple[OrderStep, ...] = ()
    on_signal: bool = False

    @property
    def done(self) -> bool:
        """Whether nothing is left of it."""
        return self.count == 0

    @property
    def _wanted(self) -> tuple[OrderStep, ...]:
        return self.steps[:1] if self.in_turn else self.steps

    @property
    def only(self) -> str | None:
        """The one part that is wanted now; None: any, or several."""
        labels = {step.part for step in self._wanted}
        return labels.pop() if len(labels) == 1 else None

    def wants(self, label: str) -> bool:
        """Whether a part of this label is to be brought now."""
        return not self.steps or any(step.part == label for step in self._wanted)

    def place(self, label: str) -> str | None:
        """The place, pattern or `bin` that the next part of this label goes to; None: wherever such parts belong."""
        return next((step.place for step in self._wanted if step.part == label), None)

    def brought(self, label: str | None) -> PickOrder:
        """After a part was put down; label None: one that was in the gripper before, which belongs to no step."""
        number = next((n for n, step in enumerate(self._wanted) if step.part == label), None)
        if self.count is None or (self.steps and number is None):
            return self
        if number is None:
            return replace(self, count=max(0, self.count - 1))
        step = self.steps[number]
        left = (replace(step, count=step.count - 1),) if step.count > 1 else ()
        return self._with(self.steps[:number] + left + self.steps[number + 1 :], self.count - 1)

    def without_wanted(self) -> PickOrder:
        """After no part could be had that is wanted now: the order without those steps."""
        assert self.count is not None, "only a job skips"
        left = self.steps[len(self._wanted) :]
        return self._with(left, self.count - sum(step.count for step in self._wanted))

    def missing(self, brought: Counter[str]) -> dict[str, int]:
        """What a job lacks, by label, once so many parts of each label were brought of it."""
        wanted: Counter[str] = Counter()
        for step in (*self.steps, *(self.whole * (self.times - 1))):
            wanted[step.part] += step.count
        return dict(wanted - brought)

    def json(self) -> dict[str, Any]:
        """JSON values of every field."""
        values: dict[str, Any] = msgspec.to_builtins(self)
        return values

    def _with(self, steps: tuple[OrderStep, ...], count: int) -> PickOrder:
        if steps or self.times == 1:
            return replace(self, steps=steps, count=count)
        return replace(self, steps=self.whole, count=count, times=self.times - 1)


ALL = PickOrder()
"""Every part that lies there."""


def auto_record(order: PickOrder | None) -> dict[str, Any]:
    """The fields of the run log's record `auto`; None: nothing is to be picked any more."""
    plain = order or ALL
    fields: dict[str, Any] = {"on": order is not None, "count": plain.count, "every_s": plain.every_s}
    return fields if plain.job is None and not plain.on_signal else {**fields, "order": plain.json()}


def read_order(values: Mapping[str, Any]) -> PickOrder:
    """The order of a record or of the recovery file. Keys of newer releases are left out."""
    return msgspec.convert(dict(values), PickOrder)
