"""From one view's recall to one answer: which node, for what, and who came second. The search is in layer.py."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass

from daemon.art.rotation.layer import Recall


@dataclass(frozen=True)
class Verdict:
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


def choose(recall: Recall, labels: Sequence[Hashable], rho: float = 0.9) -> Verdict:
    """Coarse to fine (D'Souza, section 5.6): nodes in the order of activation, the first with (5.2) >= rho wins.

    labels: what each node stands for, (J,). Only nodes that were looked into are considered.
    """
    order = recall.ranking().tolist()
    node = next((j for j in order if recall.match[j] >= rho), None)
    other = next((j for j in order if node is None or labels[j] != labels[node]), None)
    return Verdict(
        node,
        None if node is None else labels[node],
        0.0 if node is None else float(recall.activation[node]),
        0.0 if node is None else float(recall.match[node]),
        0.0 if node is None else float(recall.match_ratio[node]),
        other,
        None if other is None else labels[other],
        0.0 if other is None else float(recall.activation[other]),
    )
