"""How one presentation finds its node: choice, vigilance, map field, match tracking (D'Souza, (1.13)-(1.24)).

A node once reset is out for the whole presentation, whatever the vigilance does afterwards: that is what ends every
search, also where match tracking's epsilon is lost in rounding. Learning is not done here.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from daemon.arrays import Array
from daemon.art.errors import ParameterError, within
from tests.bench.networks.errors import one_of
from tests.bench.networks.nodes import Nodes

UNCOMMITTED = -1
SKIPPED = -2
RESET = -1.0

MatchTracking = Literal["MT+", "MT-"]
Uncommitted = Literal["last", "competes"]
Contradiction = Literal["new_node", "skip"]


@dataclass(frozen=True)
class SearchRule:
    """What the text of Fuzzy ARTMAP leaves open, named.

    match_tracking: after a wrong prediction at match m the vigilance becomes m + epsilon (MT+, the original) or
        m - epsilon (MT-, Carpenter and Markuzon 1998: inconsistent samples do not breed nodes).
    uncommitted: "last" (default) takes a new node only when no committed one resonates, whatever alpha and |w|;
        "competes" lets an uncommitted node win by its own activation |I| / (alpha + F), as in Carpenter 1992.
    contradiction: a sample that a node of another label matches entirely (vigilance pushed above 1): "new_node"
        (default) commits one for it, "skip" leaves it unlearnt.
    capacity: how many nodes there may be, None (default) for as many as it takes; a sample in need of one more is
        skipped.
    """

    rho: float = 0.0
    alpha: float = 1e-3
    map_vigilance: float = 1.0
    match_tracking: MatchTracking = "MT+"
    epsilon: float = 1e-10
    uncommitted: Uncommitted = "last"
    contradiction: Contradiction = "new_node"
    capacity: int | None = None

    def __post_init__(self) -> None:
        within("rho", self.rho, 0.0, 1.0)
        within("alpha", self.alpha, 0.0, float("inf"))
        within("map_vigilance", self.map_vigilance, 0.0, 1.0)
        within("epsilon", self.epsilon, 0.0, 1.0)
        if self.capacity is not None and self.capacity < 1:
            raise ParameterError(f"capacity: expected at least 1 node, found {self.capacity!r}")
        one_of("match_tracking", self.match_tracking, ("MT+", "MT-"))
        one_of("uncommitted", self.uncommitted, ("last", "competes"))
        one_of("contradiction", self.contradiction, ("new_node", "skip"))

    def full(self, count: int) -> bool:
        """Whether `count` committed nodes are all there may be."""
        return self.capacity is not None and count >= self.capacity

    def uncommitted_activation(self, size: Array, features: int, count: int) -> Array:
        """Activation (B,) that a committed node must reach to be considered, for samples of size |I| (B,).

        Zero with all nodes committed: a node that does not exist competes with none.
        """
        competes = self.uncommitted == "competes" and not self.full(count)
        return size / (self.alpha + features) if competes else np.zeros_like(size)

    def tracked(self, match: float) -> float:
        """The vigilance after a wrong prediction at this match."""
        return match + self.epsilon if self.match_tracking == "MT+" else match - self.epsilon


def find_node(
    activation: Array, overlap: Array, size: float, floor: float, rule: SearchRule, nodes: Nodes, label: int
) -> int:
    """The node that resonates with one sample, or UNCOMMITTED, or SKIPPED.

    activation T and overlap |I ^ w|, (J,); size |I|; floor the least activation considered; label the number of the
    sample's label. Ties in activation go to the smallest index. An empty sample (|I| = 0, only possible uncoded)
    matches every node entirely.
    """
    rho, remaining = rule.rho, activation
    while remaining.size:
        node = int(remaining.argmax())
        if remaining.item(node) < floor:
            break
        match = overlap.item(node) / size if size > 0.0 else 1.0
        if match >= rho:
            if nodes.agrees_one(node, label, rule.map_vigilance):
                return node
            rho = rule.tracked(match)
            if rho > 1.0:
                return UNCOMMITTED if rule.contradiction == "new_node" else SKIPPED
        remaining = _without(remaining, node, overlap, rho, size)
    return UNCOMMITTED


def _without(remaining: Array, node: int, overlap: Array, rho: float, size: float) -> Array:
    """Activations left when a node is reset, and with it all that the vigilance would reset anyway."""
    left = np.where(overlap / size >= rho, remaining, RESET) if size > 0.0 else remaining.copy()
    left[node] = RESET
    return left


def iterations(max_iter: int) -> int:
    """max_iter as a count of epochs, or ParameterError."""
    if isinstance(max_iter, bool) or not isinstance(max_iter, (int, np.integer)) or max_iter < 1:
        raise ParameterError(f"max_iter: expected a whole number of at least 1, found {max_iter!r}")
    return int(max_iter)
