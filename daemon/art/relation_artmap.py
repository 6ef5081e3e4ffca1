"""Fuzzy ARTMAP behind a pattern rotation layer, for views with pairwise relations between elements: the memory.

A view is a set of elements (facets) in arbitrary order. Its relation matrices contain, for every two elements that
touch, the category of the first and analogue features of the pair. The rotation layer finds the numberings under which
a view is inside a node's taught ranges, for all nodes at once; vigilance resets every node that matches less. Learning
is that of Fuzzy ARTMAP: choice, vigilance, match tracking on the label, w <- beta (I ^ w) + (1 - beta) w.

In: views, labels. Out: another memory; nodes with the numbering of each.
Source: D'Souza, sections 4.4.3, 5.5, 5.6, appendix B; Carpenter et al. 1992 (Fuzzy ARTMAP).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from daemon.arrays import Array, Flags, Index
from daemon.art.errors import InputError, ParameterError, within

MOST_STATES = 4096
"""Most partial numberings kept in the search; of more, those that match best."""
ROUND = 1e-6
"""Matches are rounded to this before a comparison, so that the order of a sum has no effect."""
BATCH = 256
"""New nodes are searched apart from the others up to this number, since each changes their index."""


@dataclass(frozen=True, eq=False)
class RelationalView:
    """n elements and their relations.

    categories (n, K): possible categories of each element, in (0, 1), repeated to fill up; touching (n, n): which are
    related, symmetric; features (n, n, C) in [0, 1] of each ordered pair that touches; doubt (n, n, C): tolerance of
    each feature.
    """

    categories: Array
    touching: Flags
    features: Array
    doubt: Array

    def __post_init__(self) -> None:
        n = len(self.categories)
        if (
            self.touching.shape != (n, n)
            or self.features.shape[:2] != (n, n)
            or self.doubt.shape != self.features.shape
        ):
            raise InputError(f"view: {n} elements, touching {self.touching.shape}, features {self.features.shape}")
        if not (np.isfinite(self.features).all() and np.isfinite(self.doubt).all()):
            raise InputError("view: a feature is not a finite number")
        if not ((self.categories > 0) & (self.categories < 1)).all():
            raise InputError("view: a category is not between 0 and 1")
        if not np.array_equal(self.touching, self.touching.T):
            raise InputError("view: an element touches one that does not touch it")

    def only(self, members: Sequence[int]) -> RelationalView:
        """Some of the elements, in this order."""
        own = np.ix_(members, members)
        return RelationalView(self.categories[list(members)], self.touching[own], self.features[own], self.doubt[own])

    @property
    def compared(self) -> int:
        """Number of elements of the relation matrices that a match compares."""
        n = len(self.categories)
        return n * (n - 1) + int(self.touching.sum()) * int(self.features.shape[2])


class Recall(NamedTuple):
    """Nodes that match a view, each with a numbering that reaches the vigilance; the best match first, then the
    greatest activation.

    node (R,); slots (R, n): the node's slot behind each element of the view; match (R,): 1 less the mean distance of
    the compared elements from what the node was taught; activation (R,): |I ^ w| / (alpha + |w|); ratio (R,): elements
    of the view over those of the node.
    """

    node: Index
    slots: Index
    match: Array
    activation: Array
    ratio: Array


class _Choice(NamedTuple):
    """A node that may learn a view under a numbering, and the index of its label."""

    match: float
    activation: float
    node: int
    label: int
    slots: Index


@dataclass(frozen=True, eq=False)
class RelationARTMAP:
    """The nodes: lower, upper (J, 1 + C, m, m), the range of each element, the categories first; counts (J, L): how
    often each node resonated with each of the labels.

    rho: baseline vigilance of learning, alpha: choice parameter, beta: learning rate. Never changed in place.
    """

    lower: Array
    upper: Array
    counts: Index
    labels: tuple[str, ...]
    rho: float = 1.0
    alpha: float = 0.01
    beta: float = 1.0

    def __post_init__(self) -> None:
        within("rho", self.rho, 0.0, 1.0)
        within("alpha", self.alpha, 0.0, float("inf"))
        within("beta", self.beta, np.nextafter(0.0, 1.0), 1.0)
        nodes = len(self.lower)
        if self.lower.ndim != 4 or self.lower.shape != self.upper.shape or self.lower.shape[2] != self.lower.shape[3]:
            raise ParameterError(f"nodes: lower {self.lower.shape}, upper {self.upper.shape}")
        if not (np.isfinite(self.lower).all() and np.isfinite(self.upper).all() and (self.lower <= self.upper).all()):
            raise ParameterError("nodes: a lower end above its upper end, or not a number")
        if self.counts.shape != (nodes, len(self.labels)) or (self.counts.sum(1) < 1).any():
            raise ParameterError(f"nodes: {nodes}, counts {self.counts.shape}, {len(self.labels)} labels")

    @classmethod
    def empty(cls, features: int, slots: int, rho: float, alpha: float, beta: float) -> RelationARTMAP:
        """A memory without nodes, for views of so many analogue features; slots grow by learning."""
        none = np.zeros((0, 1 + features, slots, slots))
        return cls(none, none, np.zeros((0, 0), np.int64), (), rho, alpha, beta)

    @property
    def slots(self) -> int:
        """Rows of the relation matrices."""
        return int(self.lower.shape[2])

    @cached_property
    def node_labels(self) -> tuple[str, ...]:
        """Label of each node: the one it resonated with most, on a tie the one learnt first."""
        return tuple(self.labels[k] for k in self.counts.argmax(1)) if len(self.counts) else ()

    @cached_property
    def elements(self) -> Index:
        """Number (J,) of filled slots of each node."""
        touching = self.upper[:, 0] > 0
        return np.asarray((touching.any(1) | touching.any(2)).sum(1), np.int64)

    def recall(self, view: RelationalView, vigilance: float, most: int | None = None) -> Recall:
        """Find the nodes and numberings whose match with the view reaches the vigilance; at most `most`."""
        n = len(view.categories)
        budget = (1 - vigilance) * view.compared + ROUND
        if view.features.shape[2] != self.lower.shape[1] - 1:
            raise InputError(
                f"view: {view.features.shape[2]} features of a pair, where the memory knows {self.lower.shape[1] - 1}"
            )
        if n < 2 or n > self.slots or not len(self.lower) or not view.touching.any():
            return Recall(*(np.zeros(0, np.int64), np.zeros((0, n), np.int64), *np.zeros((3, 0))))
        order = _order(view)
        node, slots, off = self._seeds(view, order[0], order[1], budget)
        for k in range(2, n):
            node, slots, off = self._extended(view, order[:k], order[k], (node, slots, off), budget)
        placed = np.empty_like(slots)
        placed[:, order] = slots
        match = np.round(1 - off / view.compared, 6)
        activation = self._activation(view, node, placed, off)
        best = np.lexsort((node, -activation, -match))[:most]
        ratio = n / np.maximum(self.elements[node[best]], n)
        return Recall(node[best], placed[best], match[best], activation[best], ratio)

    def learned(
        self, views: Sequence[RelationalView], labels: Sequence[str]
    ) -> tuple[RelationARTMAP, list[tuple[int, Index]]]:
        """Learn views one after the other: the new memory, and for each view its node and slots (n,)."""
        slots = max([self.slots, *(len(view.categories) for view in views)])
        every = tuple(dict.fromkeys([*self.labels, *labels]))
        memory, ended = self._enlarged(slots, every), list[tuple[int, Index]]()
        recent = memory._some(slice(0, 0))
        for view, label in zip(views, labels, strict=True):
            own = every.index(label)
            node, place = _resonance([*memory._matching(view, 0), *recent._matching(view, len(memory.lower))], own)
            if node < 0:
                place = np.arange(len(view.categories))
                node = len(memory.lower) + len(recent.lower)
                recent = recent._committed(view, own)
            elif node < len(memory.lower):
                memory = memory._adapted(node, place, view, own)
            else:
                recent = recent._adapted(node - len(memory.lower), place, view, own)
            ended.append((node, place))
            if len(recent.lower) >= BATCH:
                memory, recent = memory._and(recent), recent._some(slice(0, 0))
        return memory._and(recent), ended

    @cached_property
    def _relations(self) -> tuple[Index, NDArray[np.float32], NDArray[np.float32]]:
        """Node and slots a, b (3, K) of every ordered pair that touches in a node; lower and upper ends (2 + 2 C, K) of
        its elements: categories of a and b, features of (a, b), features of (b, a)."""
        node, a, b = np.nonzero(self.upper[:, 0] > 0)
        ends = []
        for end in (self.lower, self.upper):
            one, other = end[node, :, a, b].T, end[node, :, b, a].T
            ends.append(np.ascontiguousarray(np.concatenate([one[:1], other[:1], one[1:], other[1:]]), np.float32))
        return np.stack([node, a, b]), ends[0], ends[1]

    def _seeds(self, view: RelationalView, f: int, g: int, budget: float) -> tuple[Index, Index, Array]:
        """Possible places of the pair of elements f, g: nodes (S,), slots (S, 2), distances (S,)."""
        place, lower, upper = self._relations
        off = _category_off(view.categories[f], lower[0], upper[0])
        kept = np.flatnonzero(off <= budget)
        off = off[kept] + _category_off(view.categories[g], lower[1, kept], upper[1, kept])
        kept, off = kept[off <= budget], off[off <= budget]
        seen = np.concatenate([view.features[f, g], view.features[g, f]]).tolist()
        doubt = np.concatenate([view.doubt[f, g], view.doubt[g, f]]).tolist()
        for value, may, low, high in zip(seen, doubt, lower[2:], upper[2:], strict=True):
            off = off + np.maximum(np.maximum(low[kept] - np.float32(value), value - high[kept]) - np.float32(may), 0)
            good = off <= budget
            kept, off = kept[good], off[good]
        if len(kept) > MOST_STATES:
            best = np.argpartition(off, MOST_STATES)[:MOST_STATES]
            kept, off = kept[best], off[best]
        node, a, b = place[:, kept]
        return node, np.stack([a, b], 1), np.asarray(off, np.float64)

    def _extended(
        self, view: RelationalView, placed: list[int], new: int, states: tuple[Index, Index, Array], budget: float
    ) -> tuple[Index, Index, Array]:
        """The states extended by one element, in every slot within the budget."""
        node, slots, off = states
        candidates = np.arange(self.slots)
        free = (slots[:, None] != candidates[:, None]).all(2)
        touch = view.touching[new, placed]
        there = (node[:, None, None], slice(None), candidates[None, :, None], slots[:, None, :])
        back = (node[:, None, None], slice(None), slots[:, None, :], candidates[None, :, None])
        free &= (self.upper[:, 0][there[0], there[2], there[3]] > 0)[..., touch].all(2)
        s, c = np.nonzero(free)
        low, high, low_back, high_back = (
            end[which][s, c] for which in (there, back) for end in (self.lower, self.upper)
        )  # (N, d, 1 + C) each
        related = np.where(touch, view.categories[new][:, None], 0.0), np.where(touch, view.categories[placed].T, 0.0)
        more = _category_off(related[0][:, None], low[..., 0], high[..., 0]).sum(1)
        more = more + _category_off(related[1][:, None], low_back[..., 0], high_back[..., 0]).sum(1)
        for value, may, ends in (
            (view.features[new, placed], view.doubt[new, placed], (low, high)),
            (view.features[placed, new], view.doubt[placed, new], (low_back, high_back)),
        ):
            away = np.maximum(np.maximum(ends[0][..., 1:] - value, value - ends[1][..., 1:]) - may, 0.0)
            more = more + away[:, touch].sum((1, 2))
        total = off[s] + more
        good = np.flatnonzero(total <= budget)
        if len(good) > MOST_STATES:
            good = good[np.argpartition(total[good], MOST_STATES)[:MOST_STATES]]
        s, c = s[good], c[good]
        return node[s], np.concatenate([slots[s], c[:, None]], 1), total[good]

    def _activation(self, view: RelationalView, node: Index, slots: Index, off: Array) -> Array:
        """T = |I ^ w| / (alpha + |w|), complement-coded, over all elements of the matrices: outside the view I is 0."""
        empty, size = self._sums
        among = self.lower[node[:, None, None], :, slots[:, :, None], slots[:, None, :]]
        inside = among[..., 0].sum((1, 2)) + among[:, view.touching, 1:].sum((1, 2))
        return np.asarray((empty[node] + inside - off) / (self.alpha + size[node]))

    @cached_property
    def _sums(self) -> tuple[Array, Array]:
        """|I ^ w| of an empty view with each node, and |w|."""
        count = int(np.prod(self.lower.shape[1:]))
        return count - self.upper.sum((1, 2, 3)), count - (self.upper - self.lower).sum((1, 2, 3))

    def _matching(self, view: RelationalView, first: int) -> list[_Choice]:
        """The nodes, numbered from `first` on, that may learn a view: of its size, with a match of at least rho."""
        found = self.recall(view, self.rho)
        labels = self.counts[found.node].argmax(1).tolist() if len(found.node) else []
        every = zip(
            found.match.tolist(), found.activation.tolist(), found.node.tolist(), labels, found.slots, strict=True
        )
        return [
            _Choice(match, activation, first + node, label, slots)
            for (match, activation, node, label, slots), ratio in zip(every, found.ratio, strict=True)
            if ratio >= 1.0
        ]

    def _committed(self, view: RelationalView, label: int) -> RelationARTMAP:
        """The memory with a new node that has learnt one view."""
        low, high = self._coded(view, np.arange(len(view.categories)))
        counts = np.zeros((1, len(self.labels)), np.int64)
        counts[0, label] = 1
        return self._and(replace(self, lower=low[None], upper=high[None], counts=counts))

    def _adapted(self, node: int, slots: Index, view: RelationalView, label: int) -> RelationARTMAP:
        """The memory with one more view learnt by a node."""
        low, high = self._coded(view, slots)
        lower, upper, counts = self.lower.copy(), self.upper.copy(), self.counts.copy()
        lower[node] -= self.beta * np.maximum(lower[node] - low, 0.0)
        upper[node] += self.beta * np.maximum(high - upper[node], 0.0)
        counts[node, label] += 1
        return replace(self, lower=lower, upper=upper, counts=counts)

    def _coded(self, view: RelationalView, slots: Index) -> tuple[Array, Array]:
        """Lower and upper ends (1 + C, m, m) of a view in these slots: features plus and minus their tolerance."""
        own = np.ix_(slots, slots)
        low = np.zeros((view.features.shape[2] + 1, self.slots, self.slots))
        high = low.copy()
        category = np.where(view.touching, view.categories[:, :1], 0.0)
        low[0][own] = high[0][own] = category
        touching = view.touching[..., None]
        for end, sign in ((low, -1), (high, 1)):
            values = np.where(touching, np.clip(view.features + sign * view.doubt, 0.0, 1.0), 0.0)
            end[1:, own[0], own[1]] = values.transpose(2, 0, 1)
        return low, high

    def _some(self, which: slice) -> RelationARTMAP:
        return replace(self, lower=self.lower[which], upper=self.upper[which], counts=self.counts[which])

    def _and(self, other: RelationARTMAP) -> RelationARTMAP:
        if not len(other.lower):
            return self
        return replace(
            self,
            lower=np.concatenate([self.lower, other.lower]),
            upper=np.concatenate([self.upper, other.upper]),
            counts=np.concatenate([self.counts, other.counts]),
        )

    def _enlarged(self, slots: int, labels: tuple[str, ...]) -> RelationARTMAP:
        """The memory enlarged for views of so many elements and for these labels, which begin with its own."""
        more, wider = slots - self.slots, len(labels) - len(self.labels)
        if not more and not wider:
            return self
        lower, upper = (np.pad(end, [(0, 0), (0, 0), (0, more), (0, more)]) for end in (self.lower, self.upper))
        counts = np.pad(self.counts, [(0, 0), (0, wider)])
        return replace(self, lower=lower, upper=upper, counts=counts, labels=labels)


def _resonance(choices: list[_Choice], label: int) -> tuple[int, Index]:
    """The node that learns a view, with its slots; -1 for a new one. Match tracking: a node of another label raises the
    vigilance to its match, not above: where two labels share a pattern, each keeps its node (MT-, Carpenter and
    Markuzon 1998)."""
    rho = 0.0
    for one in sorted(choices, key=lambda one: (-one.match, -one.activation, one.node)):
        if one.match < rho:
            break
        if one.label == label:
            return one.node, one.slots
        rho = one.match
    return -1, np.zeros(0, np.int64)


def _category_off(may_be: Array, low: Array, high: Array) -> Array:
    """Distance of the nearest possible category (K, ...) from the range."""
    off = np.maximum(np.maximum(low - may_be[0], may_be[0] - high), 0.0)
    for value in may_be[1:]:
        off = np.minimum(off, np.maximum(np.maximum(low - value, value - high), 0.0))
    return np.asarray(off)


def _order(view: RelationalView) -> list[int]:
    """Search order of the elements: the pair measured best, then the ones that touch most of those before."""
    n = len(view.categories)
    uncertainty = np.where(view.touching, view.doubt.sum(2), np.inf)
    uncertainty = uncertainty + uncertainty.T
    order = [int(k) for k in np.unravel_index(uncertainty.argmin(), uncertainty.shape)]
    while len(order) < n:
        rest = [k for k in range(n) if k not in order]
        order.append(max(rest, key=lambda k: (int(view.touching[k, order].sum()), -k)))
    return order
