"""Labels of any hashable kind <-> small integers, in the order in which they were first seen.

What a node has to do with a label is the map field's business (tests/bench/networks/nodes.py).
"""

from collections.abc import Hashable, Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daemon.arrays import Index
from daemon.art.errors import InputError


class Labels:
    """An ordered set of labels, in the order in which they were first seen."""

    def __init__(self, labels: Iterable[Hashable] = ()) -> None:
        self._labels: list[Hashable] = []
        self._number: dict[Hashable, int] = {}
        listed = list(labels)
        self.numbers(listed, len(listed))

    def __len__(self) -> int:
        return len(self._labels)

    def __getitem__(self, number: int) -> Hashable:
        return self._labels[number]

    def known(self, label: Hashable) -> int | None:
        """The number of a label seen before, else None."""
        return self._number.get(_plain(label))

    def number(self, label: Hashable) -> int:
        """The number of a label, a new one where it was never seen."""
        label = _plain(label)
        if label not in self._number:
            self._number[label] = len(self._labels)
            self._labels.append(label)
        return self._number[label]

    def numbers(self, labels: Any, expected: int) -> Index:
        """One number a label, or InputError where one is unhashable or there are not as many labels as samples."""
        listed = labels.tolist() if isinstance(labels, np.ndarray) else list(labels)
        if len(listed) != expected:
            raise InputError(f"labels: expected one a sample ({expected}), found {len(listed)}")
        try:
            number = {label: self.number(label) for label in dict.fromkeys(listed)}
        except TypeError as error:
            raise InputError(f"labels: expected something hashable ({error})") from error
        return np.array([number[label] for label in listed], dtype=np.int64)

    def all(self) -> tuple[Hashable, ...]:
        return tuple(self._labels)

    def table(self) -> NDArray[Any]:
        """The labels as an array: of their own type where they share one of int, float, bool or str, else objects."""
        kinds = {type(label) for label in self._labels}
        if len(kinds) == 1 and kinds <= {int, float, bool, str}:
            return np.array(self._labels)
        return self.object_table()

    def object_table(self) -> NDArray[Any]:
        """The labels as an object array with None, for no answer, at the end (so that index -1 finds it)."""
        table = np.empty(len(self._labels) + 1, dtype=object)
        for number, label in enumerate(self._labels):
            table[number] = label
        return table


def _plain(label: Hashable) -> Hashable:
    """numpy scalars as the Python value they hold, so that np.int64(3) and 3 are one label."""
    return label.item() if isinstance(label, np.generic) else label
