"""Fuzzy ARTMAP against the textbook, one sample at a time. Not here: the thesis's own figures, speed."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from daemon.art import InputError, ParameterError
from tests.bench.networks import FuzzyART, FuzzyARTMAP, NotTrainedError, presenting
from tests.bench.networks.coding import code, grid_step, on_grid

UNIT = st.floats(0.0, 1.0)
FEW = st.sampled_from([0.0, 0.25, 0.3, 0.5, 0.75, 1.0])


@st.composite
def lessons(draw):
    """Samples, with and without ties, and labels."""
    count, features = draw(st.integers(1, 40)), draw(st.integers(1, 4))
    samples = draw(arrays(np.float64, (count, features), elements=draw(st.sampled_from([UNIT, FEW]))))
    labels = draw(st.lists(st.sampled_from("abc"), min_size=count, max_size=count))
    return samples, labels


def textbook(samples, labels, rho, alpha, beta, complement, match_tracking, uncommitted, contradiction):
    """Fuzzy ARTMAP as the appendix tells it, with a plain loop over nodes and a set of those reset."""
    weights, stands_for = [], []
    coded = code(samples, complement)
    step = grid_step(coded.shape[1])
    for sample, label in zip(coded, labels, strict=True):
        size, vigilance, reset = sample.sum(), rho, set()
        floor = size / (alpha + len(sample)) if uncommitted == "competes" else 0.0
        while True:
            open_nodes = [j for j in range(len(weights)) if j not in reset]
            choices = [np.minimum(sample, weights[j]).sum() / max(alpha + weights[j].sum(), 1e-300) for j in open_nodes]
            if not choices or max(choices) < floor:
                chosen = None
                break
            chosen = open_nodes[int(np.argmax(choices))]
            match = np.minimum(sample, weights[chosen]).sum() / size if size else 1.0
            reset.add(chosen)
            if match < vigilance:
                continue
            if stands_for[chosen] == label:
                break
            vigilance = match + 1e-10 if match_tracking == "MT+" else match - 1e-10
            if vigilance > 1.0:
                chosen = None if contradiction == "new_node" else -1
                break
        if chosen is None:
            weights.append(sample)
            stands_for.append(label)
        elif chosen >= 0:
            smaller = np.minimum(sample, weights[chosen])
            weights[chosen] = on_grid(beta * smaller + (1.0 - beta) * weights[chosen], step)
    return np.array(weights).reshape(-1, coded.shape[1]), stands_for


@settings(deadline=None, max_examples=100)
@given(
    lessons(),
    st.sampled_from([0.0, 0.6, 0.95, 1.0]),
    st.sampled_from([0.0, 1e-3, 1.0]),
    st.sampled_from([1.0, 0.5]),
    st.booleans(),
    st.sampled_from(["MT+", "MT-"]),
    st.sampled_from(["last", "competes"]),
    st.sampled_from(["new_node", "skip"]),
    st.sampled_from([3, 256]),
)
def test_teaching_in_blocks_gives_what_the_textbook_gives(
    lesson, rho, alpha, beta, complement, match_tracking, uncommitted, contradiction, block
):
    samples, labels = lesson
    options = {"match_tracking": match_tracking, "uncommitted": uncommitted, "contradiction": contradiction}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(presenting, "BLOCK", block)
        network = FuzzyARTMAP(rho, alpha, beta, complement=complement, **options).fit(samples, labels)
    weights, stands_for = textbook(samples, labels, rho, alpha, beta, complement, **options)
    assert np.array_equal(network.weights, weights)
    assert list(network.node_labels) == stands_for


@settings(deadline=None, max_examples=40)
@given(lessons(), arrays(np.float64, (30, 4), elements=UNIT), st.sampled_from([0.0, 0.7, 0.9]), st.booleans())
def test_prediction_is_the_best_matching_node_in_exact_arithmetic(lesson, asked, rho, complement):
    samples, labels = lesson
    network = FuzzyARTMAP(0.5, 0.01, complement=complement, rho_predict=rho).fit(samples, labels)
    questions = np.vstack([samples, asked[:, : samples.shape[1]]])
    answers = network.recall(questions)
    coded = code(questions, complement)
    for sample, node, activation, match in zip(coded, answers.node, answers.activation, answers.match, strict=True):
        overlap = np.minimum(sample, network.weights).sum(axis=1)
        matches = overlap / sample.sum() if sample.sum() else np.ones(len(overlap))
        choices = np.where(matches >= rho, overlap / (0.01 + network.weights.sum(axis=1)), -1.0)
        best = int(choices.argmax())
        if choices[best] < 0.0:
            assert (node, activation, match) == (-1, 0.0, 0.0)
        else:
            assert (node, activation, match) == (best, choices[best], matches[best])


def test_nodes_closer_than_single_precision_can_tell_are_told_apart():
    rng = np.random.default_rng(8)
    near = 0.3 + 1e-7 * rng.random((150, 6))
    network = FuzzyARTMAP(1.0, rho_predict=0.0).fit(near, list(range(150)))
    asked = 0.3 + 1e-7 * rng.random((2000, 6))
    overlap = np.minimum(code(asked, True)[:, None], network.weights).sum(axis=2)
    exact = (overlap / (1e-3 + network.weights.sum(axis=1))).argmax(axis=1)
    assert network.predict(asked).tolist() == exact.tolist()


@settings(deadline=None, max_examples=25)
@given(lessons(), st.integers(0, 40))
def test_taught_in_pieces_or_at_once_the_bytes_are_the_same(lesson, cut):
    samples, labels = lesson
    whole = FuzzyARTMAP(0.7, 0.1).fit(samples, labels)
    pieces = FuzzyARTMAP(0.7, 0.1).partial_fit(samples[:cut], labels[:cut]).partial_fit(samples[cut:], labels[cut:])
    assert whole.classes == pieces.classes
    for name, array in whole.state().items():
        assert array.tobytes() == pieces.state()[name].tobytes()


def test_a_sample_that_changes_nothing_leaves_every_byte_alone():
    rng = np.random.default_rng(0)
    samples, labels = rng.random((50, 3)), rng.integers(0, 3, 50)
    network = FuzzyARTMAP(0.9).fit(samples, labels)
    before = network.weights.tobytes()
    network.partial_fit(samples[:0], labels[:0])
    assert network.weights.tobytes() == before


@pytest.mark.parametrize("labels", [["cube", ("prism", 3), None, 7], np.array([1, 2, 3, 4]), ["a", "b", "c", "d"]])
def test_labels_may_be_anything_hashable(labels):
    samples = np.eye(4)
    network = FuzzyARTMAP(1.0, rho_predict=1.0).fit(samples, labels)
    assert list(network.predict(samples)) == list(labels)


def test_a_sample_unlike_anything_taught_is_not_named():
    network = FuzzyARTMAP(0.9).fit([[0.1, 0.1], [0.9, 0.9]], ["low", "high"])
    labels, match = network.predict_with_match([[0.1, 0.12], [0.5, 0.5]])
    assert labels.tolist() == ["low", None]
    assert match[0] == pytest.approx(0.99)
    assert match[1] == 0.0


def test_without_vigilance_labels_keep_their_type():
    network = FuzzyARTMAP().fit([[0.1], [0.9]], [3, 4])
    assert network.predict([[0.2]]).dtype.kind == "i"


def test_many_nodes_may_stand_for_one_label():
    network = FuzzyARTMAP(1.0).fit([[0.1], [0.5], [0.9]], ["edge", "middle", "edge"])
    assert network.n_categories == 3
    assert network.classes == ("edge", "middle")


def test_a_forgiving_map_field_lets_one_node_stand_for_several_labels():
    samples, labels = [[0.5], [0.5], [0.5], [0.5]], ["dog", "dog", "animal", "dog"]
    network = FuzzyARTMAP(1.0, map_vigilance=0.0).fit(samples, labels)
    assert network.n_categories == 1
    assert network.predict_proba([[0.5]]).tolist() == [[0.75, 0.25]]
    assert network.predict([[0.5]]).tolist() == ["dog"]


def test_the_same_sample_under_two_labels_breeds_nodes_with_positive_match_tracking_only():
    samples, labels = [[0.5, 0.5]] * 6, ["a", "b"] * 3
    assert FuzzyARTMAP(match_tracking="MT-").fit(samples, labels).n_categories == 2
    assert FuzzyARTMAP(match_tracking="MT+").fit(samples, labels).n_categories == 4
    assert FuzzyARTMAP(contradiction="skip").fit(samples, labels).n_categories == 1


def test_match_tracking_ends_even_where_its_epsilon_is_lost_in_rounding():
    rng = np.random.default_rng(3)
    samples, labels = rng.random((200, 3)).astype(np.float32), rng.integers(0, 5, 200)
    for epsilon in (0.0, 1e-300):
        assert FuzzyARTMAP(epsilon=epsilon).fit(samples, labels).n_categories > 0


def test_max_iter_is_honoured_and_stops_when_nothing_changes():
    rng = np.random.default_rng(4)
    samples, labels = rng.random((300, 2)), rng.integers(0, 2, 300)
    once = FuzzyARTMAP(max_iter=1).fit(samples, labels)
    often = FuzzyARTMAP(max_iter=50).fit(samples, labels)
    assert once.score(samples, labels) < often.score(samples, labels) == 1.0
    epochs = often.state()["map_counts"].sum() / len(samples)
    assert 1 < epochs < 50


def test_slow_recoding_moves_part_of_the_way():
    network = FuzzyART(0.0, beta=0.5).fit([[0.2], [0.6]])
    assert network.weights[0] == pytest.approx([0.2, 0.6])


def test_forgetting_a_part_leaves_every_other_weight_alone():
    rng = np.random.default_rng(5)
    samples, labels = rng.random((60, 4)), rng.choice(["cube", "prism", "pyramid"], 60)
    network = FuzzyARTMAP(0.8).fit(samples, labels)
    kept = network.weights[[label != "prism" for label in network.node_labels]]
    network.forget("prism")
    assert network.weights.tobytes() == kept.tobytes()
    assert "prism" not in network.classes
    assert "prism" not in network.predict(samples).tolist()
    network.partial_fit(samples[:1], ["prism"])
    assert network.classes[-1] == "prism"


def test_everything_can_be_forgotten_and_taught_anew():
    network = FuzzyARTMAP().fit([[0.5]], ["cube"]).forget("cube")
    assert network.n_categories == 0
    with pytest.raises(NotTrainedError):
        network.predict([[0.5]])
    assert network.partial_fit([[0.5]], ["cube"]).predict([[0.5]]).tolist() == ["cube"]


def test_what_was_learnt_survives_the_way_through_arrays():
    rng = np.random.default_rng(6)
    samples, labels = rng.random((80, 3)), rng.choice(["a", "b"], 80)
    first = FuzzyARTMAP(0.6).fit(samples, labels)
    second = FuzzyARTMAP(0.6).restore(first.state(), first.classes)
    more, their = rng.random((40, 3)), rng.choice(["b", "c"], 40)
    first.partial_fit(more, their)
    second.partial_fit(more, their)
    assert first.state()["weights"].tobytes() == second.state()["weights"].tobytes()
    assert first.predict(samples).tolist() == second.predict(samples).tolist()


@pytest.mark.parametrize(
    "state",
    [
        {"weights": np.ones((2, 4)), "map_counts": np.ones((3, 1))},
        {"weights": np.full((1, 4), 2.0), "map_counts": np.ones((1, 1))},
        {"weights": np.full((1, 4), np.nan), "map_counts": np.ones((1, 1))},
        {"weights": np.ones((1, 4)), "map_counts": np.zeros((1, 1))},
    ],
)
def test_arrays_that_cannot_be_a_network_are_refused(state):
    with pytest.raises(ParameterError, match="state"):
        FuzzyARTMAP().restore(state, ["a"])


@pytest.mark.parametrize(
    ("samples", "labels", "words"),
    [
        ([0.5, 0.5], ["a"], "expected \\(N, M\\)"),
        ([[0.5, 1.5]], ["a"], "row 0, column 1: expected a value in \\[0, 1\\], found 1.5"),
        ([[0.5], [np.nan]], ["a", "b"], "row 1, column 0: expected a finite number"),
        ([["x"]], ["a"], "expected numbers"),
        (np.zeros((1, 0)), ["a"], "at least one feature"),
        ([[0.5]], ["a", "b"], "expected one a sample \\(1\\), found 2"),
        ([[0.5]], [["a"]], "something hashable"),
    ],
)
def test_bad_input_is_refused_by_name_and_place(samples, labels, words):
    with pytest.raises(InputError, match=words):
        FuzzyARTMAP().fit(samples, labels)


def test_a_refused_lesson_teaches_nothing():
    network = FuzzyARTMAP().fit([[0.5]], ["a"])
    with pytest.raises(InputError):
        network.partial_fit([[0.1], [0.2]], ["b", ["unhashable"]])
    with pytest.raises(InputError, match="expected 1 features"):
        network.partial_fit([[0.1, 0.2]], ["c"])
    assert network.classes == ("a",)
    assert network.n_categories == 1


@pytest.mark.parametrize(
    "options",
    [{"rho": 1.1}, {"alpha": -1}, {"beta": 0.0}, {"match_tracking": "MT?"}, {"uncommitted": "first"}, {"max_iter": 0}],
)
def test_a_parameter_out_of_range_is_refused_by_name(options):
    with pytest.raises(ParameterError, match=next(iter(options))):
        FuzzyARTMAP(**options)


def test_an_untrained_network_says_so():
    with pytest.raises(NotTrainedError, match="not learnt a single sample"):
        FuzzyART().predict([[0.5]])
