"""The memory of related elements, against all numberings tried one by one; and what it learns, against the textbook."""

from __future__ import annotations

from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon.art import InputError, ParameterError, RelationalView, RelationARTMAP
from daemon.art import relation_artmap as module

SLOTS, FEATURES = 5, 2
VIGILANCES = (1.0, 0.98, 0.9, 0.75, 0.4)
LABELS = st.sampled_from("abc")
Found = dict[tuple[int, tuple[int, ...]], float]
# All values lie on a grid of powers of two: sums are exact in whatever order, and in single precision.


@st.composite
def views(draw, most=SLOTS, doubted=True, kinds=2):
    """Views of 2 to `most` elements, touching or not, with doubts and alternative categories."""
    n, rng = draw(st.integers(2, most)), np.random.default_rng(draw(st.integers(0, 2**31)))
    touching = rng.random((n, n)) < draw(st.sampled_from([0.4, 0.8, 1.0]))
    touching = np.triu(touching, 1)
    categories = rng.choice([0.25, 0.5, 0.75], (n, kinds))
    if draw(st.booleans()):
        categories[:, 1:] = categories[:, :1]
    features = rng.choice(16, (n, n, FEATURES)) / 16
    doubt = rng.choice(4, (n, n, FEATURES)) / 32 * (doubted and draw(st.booleans()))
    return RelationalView(categories, touching | touching.T, features, doubt)


@st.composite
def memories(draw):
    """What some views and variants of them have left behind, of vigilant learning or of lax."""
    seen = draw(st.lists(views(), min_size=1, max_size=4))
    rho, beta = draw(st.sampled_from([(1.0, 1.0), (0.9, 1.0), (0.8, 0.5)]))
    labels = draw(st.lists(LABELS, min_size=len(seen), max_size=len(seen)))
    return empty(rho=rho, beta=beta).learned(seen, labels)[0], draw(st.sampled_from(seen))


def empty(rho: float = 1.0, alpha: float = 0.01, beta: float = 1.0) -> RelationARTMAP:
    return RelationARTMAP.empty(FEATURES, SLOTS, rho, alpha, beta)


def chain(*features: float, categories: tuple[float, ...] = (), doubt: float = 0.0) -> RelationalView:
    """Elements in a row, each touching the next, all features of a pair the same."""
    n = len(features) + 1
    touching, values = np.zeros((n, n), bool), np.zeros((n, n, FEATURES))
    for k, value in enumerate(features):
        touching[k, k + 1] = touching[k + 1, k] = True
        values[k, k + 1] = values[k + 1, k] = value
    kinds = np.array(categories or (0.5,) * n)[:, None]
    return RelationalView(kinds, touching, values, np.full_like(values, doubt))


def beyond(value: float, low: float, high: float) -> float:
    return max(low - value, value - high, 0.0)


def textbook(memory: RelationARTMAP, view: RelationalView, vigilance: float) -> Found:
    """Every node and numbering that reaches the vigilance, with its match: all are tried, element by element."""
    n, found = len(view.categories), {}
    pairs = [(i, j) for i in range(n) for j in range(n) if i != j]
    for node, (lower, upper) in enumerate(zip(memory.lower, memory.upper, strict=True)):
        for slots in permutations(range(memory.slots), n):
            off, possible = 0.0, view.touching.any()
            for i, j in pairs:
                a, b = slots[i], slots[j]
                if view.touching[i, j]:
                    possible = possible and upper[0, a, b] > 0
                    off += min(beyond(kind, lower[0, a, b], upper[0, a, b]) for kind in view.categories[i])
                    for k in range(FEATURES):
                        away = beyond(view.features[i, j, k], lower[1 + k, a, b], upper[1 + k, a, b])
                        off += max(away - view.doubt[i, j, k], 0.0)
                else:
                    off += lower[0, a, b]
            compared = len(pairs) + view.touching.sum() * FEATURES
            if possible and off <= (1 - vigilance) * compared + 1e-9:
                found[node, slots] = 1 - off / compared
    return found


def answers(memory: RelationARTMAP, view: RelationalView, vigilance: float) -> Found:
    told = memory.recall(view, vigilance)
    return {
        (int(node), tuple(slots)): float(match)
        for node, slots, match in zip(told.node, told.slots.tolist(), told.match, strict=True)
    }


@settings(max_examples=50, deadline=None)
@given(memories(), views(), st.booleans(), st.sampled_from(VIGILANCES))
def test_recall_finds_exactly_the_numberings_that_trying_all_of_them_finds(known, other, own, vigilance) -> None:
    memory, taught = known
    view = taught if own else other
    told, truth = answers(memory, view, vigilance), textbook(memory, view, vigilance)
    assert told.keys() == truth.keys()
    assert list(told.values()) == pytest.approx([truth[key] for key in told], abs=1e-6)


@settings(max_examples=25, deadline=None)
@given(memories(), st.sampled_from(VIGILANCES))
def test_the_best_match_comes_first_then_the_greatest_activation(known, vigilance) -> None:
    memory, view = known
    told = memory.recall(view, vigilance)
    order = list(zip((-told.match).tolist(), (-told.activation).tolist(), strict=True))
    assert order == sorted(order)
    few = memory.recall(view, vigilance, most=2)
    assert few.slots.tolist() == told.slots[:2].tolist()
    filled = [int(((upper[0] > 0).any(0)).sum()) for upper in memory.upper]
    n = len(view.categories)
    assert told.ratio.tolist() == [n / max(filled[node], n) for node in told.node]


@settings(max_examples=25, deadline=None)
@given(memories(), st.sampled_from(VIGILANCES))
def test_activation_is_the_share_of_a_nodes_weight_that_the_view_covers(known, vigilance) -> None:
    """|I ^ w| / (alpha + |w|) of the two complement-coded, element by element."""
    memory, view = known
    view = replace(view, categories=view.categories[:, :1], doubt=np.zeros_like(view.doubt))
    told = memory.recall(view, vigilance)
    for node, slots, activation in zip(told.node, told.slots, told.activation, strict=True):
        lower, upper = memory.lower[node], memory.upper[node]
        seen, own = np.zeros_like(lower), np.ix_(slots, slots)
        seen[0][own] = np.where(view.touching, view.categories, 0.0)
        seen[1:, own[0], own[1]] = np.where(view.touching[..., None], view.features, 0.0).transpose(2, 0, 1)
        both = np.minimum(seen, lower).sum() + np.minimum(1 - seen, 1 - upper).sum()
        assert activation == pytest.approx(both / (memory.alpha + (lower + 1 - upper).sum()))
        assert activation < 1


def test_of_nodes_that_match_alike_the_more_particular_is_chosen_by_whatever_alpha() -> None:
    """None leaves it to which was learnt first: of each the view covers all."""
    memory = empty(rho=0.5).learned([chain(0.25), chain(0.75)], ["a", "a"])[0]
    assert len(memory.node_labels) == 1
    memory = replace(memory, rho=1.0).learned([chain(0.5)], ["b"])[0]
    told = memory.recall(chain(0.5), 1.0)
    assert told.match.tolist() == [1.0] * 4
    assert [memory.node_labels[node] for node in told.node] == ["b", "b", "a", "a"]
    told = replace(memory, alpha=0.0).recall(chain(0.5), 1.0)
    assert [memory.node_labels[node] for node in told.node] == ["a", "a", "b", "b"]


@settings(max_examples=25, deadline=None)
@given(memories(), st.randoms(use_true_random=False), st.sampled_from(VIGILANCES))
def test_renumbering_a_view_changes_nothing_but_the_numbering(known, random, vigilance) -> None:
    memory, view = known
    order = tuple(random.sample(range(len(view.categories)), len(view.categories)))
    plain, other = answers(memory, view, vigilance), answers(memory, view.only(order), vigilance)
    moved = {(node, tuple(slots[k] for k in order)): match for (node, slots), match in plain.items()}
    assert moved == other


def handed() -> RelationalView:
    """Two elements whose sides before and after the edge they share differ: features 0 and 1 of each."""
    touching = ~np.eye(2, dtype=bool)
    features = np.zeros((2, 2, 2))
    features[0, 1], features[1, 0] = (0.25, 0.5), (0.75, 0.625)
    return RelationalView(np.full((2, 1), 0.5), touching, features, np.zeros((2, 2, 2)))


def test_a_mirror_image_is_not_recalled_where_it_differs() -> None:
    view = handed()
    mirrored = replace(view, features=view.features[..., ::-1])
    memory = empty().learned([view], ["left"])[0]
    assert len(memory.recall(view, 1.0).node) == 1
    assert len(memory.recall(mirrored, 1.0).node) == 0
    assert len(memory.recall(mirrored, 0.7).node) >= 1
    even = replace(view, features=np.full((2, 2, 2), 0.5))
    memory = empty().learned([even], ["even"])[0]
    assert len(memory.recall(replace(even, features=even.features[..., ::-1]), 1.0).node) == 2, "in both numberings"


def test_the_same_pattern_under_two_labels_makes_a_node_of_each_and_no_more() -> None:
    view = chain(0.25, 0.5)
    memory, ended = empty().learned([view, view, view, view, view], ["a", "b", "b", "a", "b"])
    assert memory.node_labels == ("a", "b")
    assert [node for node, _ in ended] == [0, 1, 1, 0, 1]
    assert memory.counts.tolist() == [[2, 0], [0, 3]]


def test_a_node_of_another_label_that_matches_better_keeps_a_view_from_its_own() -> None:
    """Match tracking: by rho alone the view would be learnt by a."""
    memory = empty(rho=0.5).learned([chain(0.25), chain(0.5)], ["a", "b"])[0]
    assert memory.node_labels == ("a", "b")
    grown, ended = memory.learned([chain(0.4375)], ["a"])
    assert ended[0][0] == 2
    assert grown.node_labels == ("a", "b", "a")
    assert memory.learned([chain(0.3125)], ["a"])[1][0][0] == 0, "nearer to its own"


@settings(max_examples=25, deadline=None)
@given(views(), st.randoms(use_true_random=False))
def test_a_view_numbered_otherwise_is_learnt_by_the_node_it_made_and_changes_nothing_there(view, random) -> None:
    if not view.touching.any():
        return
    order = tuple(random.sample(range(len(view.categories)), len(view.categories)))
    view = replace(view, categories=view.categories[:, :1])
    first = empty().learned([view], ["a"])[0]
    if first.elements[0] < len(view.categories):
        return  # an element that touches none leaves no trace
    again, ended = first.learned([view.only(order)], ["a"])
    assert len(again.lower) == 1
    assert again.counts.tolist() == [[2]]
    assert ended[0][0] == 0
    np.testing.assert_array_equal(again.lower, first.lower)
    np.testing.assert_array_equal(again.upper, first.upper)


@pytest.mark.parametrize("beta", [1.0, 0.5, 0.25])
def test_a_box_grows_towards_what_is_learnt_by_beta(beta: float) -> None:
    memory = empty(rho=0.5, beta=beta).learned([chain(0.5), chain(0.75, doubt=0.0625), chain(0.25)], ["a"] * 3)[0]
    high = 0.5 + beta * 0.3125
    low = 0.5 - beta * 0.25
    assert memory.upper[0, 1:, 0, 1] == pytest.approx(high)
    assert memory.lower[0, 1:, 0, 1] == pytest.approx(low)
    assert memory.upper[0, 1:, 0, 0] == pytest.approx(0.0)
    untouched = memory.upper[0, 0, 2:] + memory.lower[0, 0, 2:]
    assert not untouched.any()


def test_rho_says_how_far_off_a_view_may_be_that_is_learnt_by_a_node() -> None:
    """Off by an eighth in each of four features of six elements compared."""
    match = 1 - 4 * 0.125 / 6
    for rho, nodes in ((match - 0.01, 1), (match + 0.01, 2), (1.0, 2)):
        assert len(empty(rho=rho).learned([chain(0.5), chain(0.625)], ["a", "a"])[0].lower) == nodes


def test_a_part_of_a_view_is_recalled_by_it_and_yet_learnt_as_a_node_of_its_own() -> None:
    memory = empty().learned([chain(0.25, 0.5)], ["a"])[0]
    told = memory.recall(chain(0.25), 1.0)
    assert told.ratio.tolist() == [2 / 3] * 2
    assert len(memory.learned([chain(0.25)], ["a"])[0].lower) == 2


@settings(max_examples=50, deadline=None)
@given(st.data(), st.sampled_from([(1.0, 1.0), (0.9, 1.0), (0.8, 0.5), (0.5, 1.0)]), st.sampled_from([1, 2, 256]))
def test_learning_one_after_the_other_is_learning_them_at_once(data, how, batch) -> None:
    few = data.draw(st.lists(views(), min_size=1, max_size=3))
    shown = data.draw(st.lists(st.sampled_from(few), min_size=1, max_size=8))
    labels = data.draw(st.lists(LABELS, min_size=len(shown), max_size=len(shown)))
    before = data.draw(st.integers(0, len(shown)))
    at_once, ended = empty(rho=how[0], beta=how[1]).learned(shown[:before], labels[:before])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "BATCH", batch)
        at_once, later = at_once.learned(shown[before:], labels[before:])
    memory, one_by_one = empty(rho=how[0], beta=how[1]), []
    for view, label in zip(shown, labels, strict=True):
        memory, last = memory.learned([view], [label])
        one_by_one += last
    ended += later
    assert memory.labels == at_once.labels
    assert memory.node_labels == at_once.node_labels
    for name in ("lower", "upper", "counts"):
        np.testing.assert_array_equal(getattr(memory, name), getattr(at_once, name))
    assert [(node, slots.tolist()) for node, slots in one_by_one] == [(node, slots.tolist()) for node, slots in ended]


def test_slots_and_labels_grow_and_what_was_known_answers_as_before() -> None:
    small = empty().learned([chain(0.25, 0.5)], ["a"])[0]
    large = small.learned([chain(*np.arange(1, 9) / 16)], ["b"])[0]
    assert (small.slots, large.slots) == (SLOTS, 9)
    assert (large.labels, large.counts.tolist()) == (("a", "b"), [[1, 0], [0, 1]])
    for memory in (small, large):
        told = memory.recall(chain(0.25, 0.5), 1.0)
        assert (told.node.tolist(), told.slots.tolist()) == ([0], [[0, 1, 2]])
    assert len(small.recall(chain(*np.arange(1, 9) / 16), 0.5).node) == 0, "more elements than it has slots"
    assert small.labels == ("a",), "never changed in place"


@settings(max_examples=15, deadline=None)
@given(memories(), st.sampled_from(VIGILANCES), st.sampled_from([0.0, 0.1, 10.0]))
def test_alpha_changes_the_order_of_equal_matches_alone(known, vigilance, alpha) -> None:
    memory, view = known
    one, other = answers(memory, view, vigilance), answers(replace(memory, alpha=alpha), view, vigilance)
    assert one == other
    assert list(one.values()) == list(other.values())


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        ({"touching": np.ones((2, 3), bool)}, "view: 2 elements, touching"),
        ({"features": np.zeros((3, 3, 2))}, "view: 2 elements"),
        ({"doubt": np.zeros((2, 2, 1))}, "view: 2 elements"),
        ({"features": np.full((2, 2, 2), np.nan)}, "not a finite number"),
        ({"doubt": np.full((2, 2, 2), np.inf)}, "not a finite number"),
        ({"categories": np.zeros((2, 1))}, "not between 0 and 1"),
        ({"categories": np.full((2, 1), np.nan)}, "not between 0 and 1"),
        ({"touching": np.triu(np.ones((2, 2), bool), 1)}, "touches one that does not touch it"),
    ],
)
def test_a_view_that_is_none_is_refused_with_the_reason(spoil, words) -> None:
    with pytest.raises(InputError, match=words):
        replace(handed(), **spoil)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        ({"rho": 1.1}, "rho"),
        ({"rho": float("nan")}, "rho"),
        ({"alpha": -0.1}, "alpha"),
        ({"beta": 0.0}, "beta"),
        ({"beta": 1.5}, "beta"),
        ({"lower": np.ones((1, 3, 5, 5))}, "a lower end above its upper end"),
        ({"upper": np.full((1, 3, 5, 5), np.nan)}, "not a number"),
        ({"lower": np.zeros((1, 3, 5, 4))}, "nodes: lower"),
        ({"counts": np.zeros((1, 1), np.int64)}, "nodes: 1, counts"),
        ({"counts": np.ones((2, 1), np.int64)}, "nodes: 1, counts"),
        ({"labels": ()}, "0 labels"),
    ],
)
def test_a_memory_that_is_none_is_refused_with_the_reason(spoil, words) -> None:
    memory = empty().learned([handed()], ["a"])[0]
    with pytest.raises(ParameterError, match=words):
        replace(memory, **spoil)


def test_a_view_of_other_features_than_those_learnt_is_refused() -> None:
    view = replace(handed(), features=np.zeros((2, 2, 3)), doubt=np.zeros((2, 2, 3)))
    for memory in (empty(), empty().learned([handed()], ["a"])[0]):
        for use in (lambda known: known.recall(view, 1.0), lambda known: known.learned([view], ["a"])):
            with pytest.raises(InputError, match="view: 3 features of a pair, where the memory knows 2"):
                use(memory)


def test_what_has_no_relations_recalls_nothing() -> None:
    memory = empty().learned([handed()], ["a"])[0]
    assert len(memory.recall(handed().only([0]), 0.0).node) == 0
    assert len(memory.recall(replace(handed(), touching=np.zeros((2, 2), bool)), 0.0).node) == 0
    assert len(empty().recall(handed(), 0.0).node) == 0
