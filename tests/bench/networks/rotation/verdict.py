"""From one view's recall to one answer: which node, for what, and who came second. The search is in layer.py."""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass

from daemon.arrays import Array
from tests.bench.networks.rotation.layer import LayerRecall


@dataclass(frozen=True)
class RotationVerdict:
    """What coarse-to-fine matching says of one view.

    node, label: the node of greatest activation whose (5.2) reaches the vigilance, or None where none does, with its
    activation, match (5.2) and match_ratio (0 where None); runner_up: the best ranked node of another label, whether it
    reaches the vigilance or not, with its label and activation; None and 0 where there is no other label.
    """

    node: int | None
    label: Hashable | None
    activation: float
    match: float
    match_ratio: float
    runner_up: int | None
    runner_up_label: Hashable | None
    runner_up_activation: float


def choose(recall: LayerRecall, labels: Sequence[Hashable], rho: float = 0.9) -> RotationVerdict:
    """Coarse to fine (D'Souza, section 5.6): nodes in the order of activation, the first with (5.2) >= rho wins.

    labels: what each node stands for, (J,). Only nodes that were looked into are considered.
    """
    order = recall.ranking().tolist()
    node = next((j for j in order if recall.match[j] >= rho), None)
    other = next((j for j in order if node is None or labels[j] != labels[node]), None)
    label, runner_up = (None if j is None else labels[j] for j in (node, other))

    def told(values: Array, j: int | None) -> float:
        return 0.0 if j is None else float(values[j])

    activation, match, ratio = (told(values, node) for values in (recall.activation, recall.match, recall.match_ratio))
    return RotationVerdict(node, label, activation, match, ratio, other, runner_up, told(recall.activation, other))
