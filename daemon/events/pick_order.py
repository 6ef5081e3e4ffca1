"""What is still to be picked: a number of parts (`auto on 20`), one part (`pick cube`), or steps of a job file."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any

import msgspec
from msgspec import Struct
from msgspec.structs import replace


class OrderStep(Struct, frozen=True, omit_defaults=True):
    """A step: `count` parts with label `part` are still to be brought. place: their place or pattern, `bin`, or None
    for where such parts belong."""

    part: str
    count: int = 1
    place: str | None = None


class PickOrder(Struct, frozen=True):
    """count: parts still to be brought in all, None for every part there; every_s: after how many seconds to look again
    when no wanted part is there, None to end then.

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
        return self.count == 0

    @property
    def _wanted(self) -> tuple[OrderStep, ...]:
        return self.steps[:1] if self.in_turn else self.steps

    @property
    def only(self) -> str | None:
        """The only label that is wanted now; None: any, or several."""
        labels = {step.part for step in self._wanted}
        return labels.pop() if len(labels) == 1 else None

    def wants(self, label: str) -> bool:
        return not self.steps or any(step.part == label for step in self._wanted)

    def place(self, label: str) -> str | None:
        """The place, pattern or `bin` for the next part with this label; None: where such parts belong."""
        return next((step.place for step in self._wanted if step.part == label), None)

    def brought(self, label: str | None) -> PickOrder:
        """The order after a part was brought. label None: it was in the gripper before, and is of no step."""
        number = next((n for n, step in enumerate(self._wanted) if step.part == label), None)
        if self.count is None or (self.steps and number is None):
            return self
        if number is None:
            return replace(self, count=max(0, self.count - 1))
        step = self.steps[number]
        left = (replace(step, count=step.count - 1),) if step.count > 1 else ()
        return self._with(self.steps[:number] + left + self.steps[number + 1 :], self.count - 1)

    def without_wanted(self) -> PickOrder:
        """The order without the steps that are wanted now, after no such part was found."""
        assert self.count is not None, "only a job skips"
        left = self.steps[len(self._wanted) :]
        return self._with(left, self.count - sum(step.count for step in self._wanted))

    def missing(self, brought: Counter[str]) -> dict[str, int]:
        """The parts that a job lacks, by label, after so many of each label were brought."""
        wanted: Counter[str] = Counter()
        for step in (*self.steps, *(self.whole * (self.times - 1))):
            wanted[step.part] += step.count
        return dict(wanted - brought)

    def json(self) -> dict[str, Any]:
        return dict(msgspec.to_builtins(self))

    def _with(self, steps: tuple[OrderStep, ...], count: int) -> PickOrder:
        if steps or self.times == 1:
            return replace(self, steps=steps, count=count)
        return replace(self, steps=self.whole, count=count, times=self.times - 1)


ALL = PickOrder()
"""Every part that lies there."""


def auto_record(order: PickOrder | None) -> dict[str, Any]:
    """The fields of the run log's record `auto`; None: nothing is left to pick."""
    plain = order or ALL
    fields: dict[str, Any] = {"on": order is not None, "count": plain.count, "every_s": plain.every_s}
    return fields if plain.job is None and not plain.on_signal else {**fields, "order": plain.json()}


def read_order(values: Mapping[str, Any]) -> PickOrder:
    """Read the order in a record or in the recovery file. Keys of newer releases are ignored."""
    return msgspec.convert(dict(values), PickOrder)
