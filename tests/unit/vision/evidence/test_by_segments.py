"""Parts are named by straight edges where nothing closes; strangers, rivals and contradictions are not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from itertools import chain, repeat

import numpy as np
import pytest

from daemon import frames
from daemon.store.library import load_facets
from daemon.vision.evidence import by_edges, registered
from daemon.vision.evidence.by_edges import FEWEST_TESTS, LEAST_CONFIDENCE, AcceptedHypotheses, named_by_edges
from daemon.vision.evidence.registered import RegisteredPart, register_near
from daemon.vision.facets.grouping import merge_vertices
from daemon.vision.facets.table_plane import TablePlane
from daemon.vision.geometry import PlanarShape
from daemon.vision.hypotheses import search
from daemon.vision.hypotheses.directional_edge_map import edge_distances
from daemon.vision.hypotheses.resting_poses import resting_planes
from daemon.vision.hypotheses.search import RankedHypotheses, Search, hypotheses_from_junctions
from daemon.vision.image.stereo_images import StereoImages, open_stereo
from daemon.vision.look import look
from daemon.vision.model.model import Model, empty_model, learn_view
from daemon.vision.recognition.fits import facet_poses
from daemon.vision.recognition.group_recognition import Recognised, recognise_part
from daemon.vision.refine.edge_samples import EdgeEvidence, EdgeSamples
from daemon.vision.values import Group
from tests.fakes.printed import print_pair, straight_rig
from tests.fakes.solids import CUBE, KNOWN, PENTAGONAL, PYRAMID, STRANGERS, TRIANGULAR, measured, pose, view_of

TAUGHT = (
    ("cube", CUBE, (1.0, 0.1, 0.8)),
    ("cube", CUBE, (-0.7, -0.9, -0.6)),
    ("pyramid", PYRAMID, (0.05, 0.03, 1.0)),
    ("pyramid", PYRAMID, (0.7, 0.55, -0.6)),
    ("triangular_prism", TRIANGULAR, (0.7, 0.05, 0.5)),
    ("pentagonal_prism", PENTAGONAL, (0.25, 0.76, 0.5)),
)
WHERE = pose(np.array([0.75, 0.35, 0.6]), 0.3, 330.0)


@cache
def model() -> Model:
    rng = np.random.default_rng(3)
    taught = empty_model(load_facets())
    for label, body, direction in TAUGHT:
        taught = learn_view(taught, view_of(body, pose(np.array(direction), 0.3), rng, 0.3), label)
    return taught


@cache
def images_of(name: str | None, seed: int = 0) -> StereoImages:
    body = None if name is None else {**KNOWN, **STRANGERS}[name]
    return open_stereo(*print_pair(body, WHERE, seed), straight_rig())


def unnamed(group: Group) -> Recognised:
    part = recognise_part(group, model())
    return Recognised(group, replace(part, recognition=replace(part.recognition, label="unknown")))


@pytest.mark.parametrize("label", sorted(KNOWN))
def test_a_printed_part_on_a_patterned_table_is_named_and_placed(label: str) -> None:
    (found,) = named_by_edges(images_of(label), model(), []).named
    assert found.label == label
    corners = frames.apply(WHERE, KNOWN[label].corners_mm)
    seen = np.concatenate(found.part.fitted_mm)
    off = np.linalg.norm(seen[:, None] - corners, axis=2).min(1)
    assert off.max() < 1.5
    assert all(facet.type for facet in found.part.facets)
    assert np.linalg.eigvalsh(found.part.covariance).min() > 0


@pytest.mark.parametrize("name", sorted(STRANGERS))
def test_a_printed_stranger_is_not_named(name: str) -> None:
    assert named_by_edges(images_of(name), model(), []).named == []


def test_a_patterned_table_alone_is_nothing() -> None:
    assert named_by_edges(images_of(None), model(), []).named == []


def test_where_a_part_was_named_nothing_is_looked_for() -> None:
    known = named_by_edges(images_of("cube"), model(), []).named
    assert named_by_edges(images_of("cube"), model(), known).named == []


def _in_both(facet):
    px = [camera.project(facet.corners_mm) for camera in (straight_rig().left, straight_rig().right)]
    return replace(measured(facet.corners_mm, None), left_px=px[0], right_px=px[1])


@cache
def all_registered(name: str) -> tuple[RegisteredPart, ...]:
    there = scene(name)
    return tuple(register_near(there, hypotheses_from_junctions(there, lambda: 0.0).hypotheses))


def scene(name: str, groups: Sequence[Group] = ()) -> Search:
    images = images_of(name)
    return Search(images, model(), groups, (), (edge_distances(images.left), edge_distances(images.right)), None)


def confidence(one: RegisteredPart, groups: Sequence[Group] = (), tested: int = 1000) -> float:
    return by_edges.probability_of(by_edges.log_odds_of(one, scene("cube", groups), tested))


@pytest.mark.parametrize(
    ("looks_at_the_clock", "told"),
    [
        (0, "straight edges were not looked for"),
        (1, "where taught parts could be was not looked for"),
        (3, "guesses were not tried"),
    ],
)
def test_a_look_whose_time_is_up_tells_what_it_left_out(looks_at_the_clock: int, told: str) -> None:
    spent = chain(repeat(0.0, looks_at_the_clock), repeat(1.5))
    straight = named_by_edges(images_of("cube"), model(), [], lambda: next(spent))
    assert told in "; ".join(straight.left_out)
    assert straight.named == []


def test_where_time_grows_short_the_likeliest_guesses_alone_are_laid(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(search, "FEWEST_LAID", 2)
    spent = chain(repeat(0.0, 2), repeat(0.7))
    straight = named_by_edges(images_of("cube"), model(), [], lambda: next(spent))
    assert len(straight.left_out) == 1
    assert straight.left_out[0].endswith("guesses were not compared with the pictures")
    assert [one.label for one in straight.named] == ["cube"]


def test_a_part_that_shows_the_same_edges_leaves_the_name_open_however_little_it_is_believed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    best = max(all_registered("cube"), key=lambda one: one.evidence.nats if one.label == "cube" else 0.0)
    twin = replace(best, label="pyramid", evidence=best.evidence._replace(nats=0.1 * best.evidence.nats))
    fewer = replace(
        best, label="pyramid", seen=(less(best.seen[0]), less(best.seen[1])), evidence=EdgeEvidence(99.0, 1.0)
    )
    for others, names in (([best], ["cube"]), ([best, twin], []), ([best, fewer], ["cube"])):
        monkeypatch.setattr(by_edges, "register_near", lambda *_, others=others: iter(others))
        assert [one.label for one in named_by_edges(images_of("cube"), model(), []).named] == names


def test_of_two_that_show_nearly_the_same_edges_the_one_that_lies_on_the_table_is_there(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A pyramid lay there whole; the stripes printed on its base were edges of a prism, which hung beside the table."""
    best = max(all_registered("cube"), key=lambda one: one.evidence.nats if one.label == "cube" else 0.0)
    less_of_it = replace(best, seen=(less(best.seen[0]), best.seen[1]))
    rival = replace(best, label="pyramid", evidence=best.evidence._replace(nats=0.5 * best.evidence.nats))
    for lies, other_lies, names in ((True, None, ["cube"]), (True, True, []), (None, None, []), (None, True, [])):
        laid = replace(less_of_it, rests=lies), replace(rival, rests=other_lies)
        monkeypatch.setattr(by_edges, "register_near", lambda *_, laid=laid: iter(laid))
        assert [one.label for one in named_by_edges(images_of("cube"), model(), []).named] == names


def less(seen: EdgeSamples) -> EdgeSamples:
    """Without the edge for which most speaks."""
    kept = np.delete(np.arange(len(seen.surprise)), seen.nats.argmax())
    edges = seen.edges.only(kept, slice(0, None))
    return EdgeSamples(edges, seen.sigmas[kept], seen.surprise[kept], seen.there[kept], seen.visible[kept])


def test_too_little_evidence_refuses_a_name(monkeypatch: pytest.MonkeyPatch) -> None:
    good = max(all_registered("cube"), key=lambda one: one.evidence.nats)
    assert confidence(good) > 0.99
    assert confidence(replace(good, evidence=EdgeEvidence(5.0, 0.8))) == 0.0
    assert confidence(replace(good, evidence=EdgeEvidence(50.0, 0.3))) == 0.0
    monkeypatch.setattr(by_edges, "self_similarity", lambda *_: 9.0)
    assert confidence(replace(good, evidence=EdgeEvidence(50.0, 1.0))) < LEAST_CONFIDENCE


def test_a_part_that_is_sure_beyond_all_digits_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of 144 looks at machined parts two ended in an error: 1 - confidence was nought."""
    good = max(all_registered("cube"), key=lambda one: one.evidence.nats)
    sure = replace(good, evidence=EdgeEvidence(400.0, 1.0))
    assert confidence(sure) == 1.0
    monkeypatch.setattr(by_edges, "register_near", lambda *_: iter([sure]))
    assert [one.label for one in named_by_edges(images_of("cube"), model(), []).named] == [sure.label]


def test_confidence_is_shared_by_all_guesses_that_were_made() -> None:
    """Sixteen times as many parts taught, sixteen times as many chances: the odds are a sixteenth."""
    weak = replace(max(all_registered("cube"), key=lambda one: one.evidence.nats), evidence=EdgeEvidence(45.0, 1.0))
    few, many = confidence(weak, tested=2000), confidence(weak, tested=32000)
    assert few / (1 - few) == pytest.approx(16 * many / (1 - many))
    assert confidence(weak, tested=10**9) == 0.0


def test_what_shows_few_edges_is_named_no_cheaper_and_more_taught_parts_raise_the_bar(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked = list[int]()
    monkeypatch.setattr(by_edges, "hypotheses_from_junctions", lambda *_: RankedHypotheses([], 7))
    monkeypatch.setattr(
        by_edges,
        "accept_hypotheses",
        lambda _, registered, tested, spent: asked.append(tested) or AcceptedHypotheses([], []),
    )
    two = replace(model(), views=tuple(view for view in model().views if view.label in ("cube", "pyramid")))
    for taught in (model(), two):
        named_by_edges(images_of("cube"), taught, [])
    assert asked == [FEWEST_TESTS * 4] * 2 + [FEWEST_TESTS * 2] * 2


def test_a_part_laid_anew_pays_for_every_pose_it_is_tried_at() -> None:
    images, good = images_of("cube"), max(all_registered("cube"), key=lambda one: one.evidence.nats)
    weak = replace(good, evidence=EdgeEvidence(45.0, 0.7), tested=2.0)
    tested = round(np.exp(weak.odds - 1.0))
    anew = by_edges.undecided_poses([weak], tested, images)
    assert len(anew) > 1
    assert {one.tested for one in anew} == {weak.tested * (1 + len(anew))}
    strong = replace(weak, evidence=EdgeEvidence(100.0, 0.7))
    assert by_edges.undecided_poses([strong], 1, images) == [], "this one is sure"


def test_a_turned_pose_widens_the_doubt_of_a_place_no_more_than_the_edges_that_it_has_only_so(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    best = max((one for one in all_registered("pyramid") if one.label == "pyramid"), key=lambda one: one.evidence.nats)

    def doubt(turned_deg: float) -> float:
        pose = best.pose @ frames.rigid(frames.rotation_from_vector(np.radians([turned_deg, 0.0, 0.0])), np.zeros(3))
        return float(np.trace(by_edges.pose_spread(best, [best, replace(best, pose=pose)], best.pose[None])))

    little, turned = doubt(10.0), doubt(60.0)
    assert turned > 30 * little > 0, "as likely there"
    monkeypatch.setattr(by_edges, "lead_by_own_edges", lambda one, other: -60.0)
    assert doubt(10.0) == pytest.approx(little)
    assert doubt(60.0) < 1e-3 * turned


def test_a_picture_that_repeats_itself_refuses_a_name(monkeypatch: pytest.MonkeyPatch) -> None:
    weak = replace(max(all_registered("cube"), key=lambda one: one.evidence.nats), evidence=EdgeEvidence(35.0, 0.9))
    assert confidence(weak) > LEAST_CONFIDENCE
    monkeypatch.setattr(by_edges, "self_similarity", lambda *_: 0.95)
    assert confidence(weak) < LEAST_CONFIDENCE


@pytest.mark.parametrize("promising", [True, False])
def test_other_parts_are_laid_at_a_place_only_where_something_there_may_have_a_name(
    promising: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    good = max(all_registered("cube"), key=lambda one: one.evidence.nats)
    one = good if promising else replace(good, evidence=EdgeEvidence(10.0, 0.3))
    rival = search.EdgeHypothesis("pyramid", good.pose)
    laid = by_edges.with_competing(scene("cube"), [one], [rival], 1000)
    assert [other.label for other in laid] == ([one.label, "pyramid"] if promising else [one.label])


def test_beyond_a_few_at_one_place_others_are_but_rivals(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(search, "PER_PLACE", 1)
    few = hypotheses_from_junctions(scene("cube"), lambda: 0.0)
    assert [one.label for one in few.hypotheses] == [one.label for one in few.competing] == ["cube"]


def test_of_two_parts_that_could_be_at_one_place_both_are_laid_however_many_poses_of_the_first_fit_better(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A rounded block beside the same one with sharp corners was never laid onto the pictures: six poses of the sharp
    one came before it."""
    both = model()
    for body, direction in ((body, direction) for label, body, direction in TAUGHT if label == "cube"):
        seen = view_of(body, pose(np.array(direction), 0.3), np.random.default_rng(5), 0.3)
        both = learn_view(both, seen, "twin")
    here = replace(scene("cube"), model=both)
    monkeypatch.setattr(search, "PER_PLACE", 1)
    assert sorted(one.label for one in hypotheses_from_junctions(here, lambda: 0.0).hypotheses) == ["cube", "twin"]


def test_what_came_nearest_is_told_with_the_edges_that_show_and_those_that_do_not() -> None:
    found = named_by_edges(images_of("steeper pyramid"), model(), [])
    assert not found.named
    for guess in found.guesses:
        assert guess.label in KNOWN
        assert guess.left_px.shape == (len(guess.left_shows), 2, 2)
        assert 0 < guess.share <= 1
    assert found.guesses


def test_little_evidence_names_a_part_that_lies_on_the_table_and_none_that_hangs_above_it() -> None:
    good = max((one for one in all_registered("cube") if one.label == "cube"), key=lambda one: one.evidence.nats)
    weak = replace(good, evidence=EdgeEvidence(34.0, 0.75))
    lies, nobody_knows, hangs = (replace(weak, rests=resting_planes) for resting_planes in (True, None, False))
    assert hangs.odds < nobody_knows.odds < lies.odds
    assert confidence(hangs) == confidence(nobody_knows) == 0.0 < LEAST_CONFIDENCE < confidence(lies)


@pytest.mark.parametrize("seen", [True, False])
def test_a_part_is_held_against_the_table_that_is_seen_and_else_against_the_one_that_is_known(
    seen: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Which is told by the arm, and may have something on it that the part lies on."""
    known, there = (TablePlane(np.array([0.0, 0.0, -1.0]), level_mm) for level_mm in (-395.0, -390.0))
    grounds = []
    monkeypatch.setattr(by_edges, "estimate_table", lambda *_: there if seen else None)
    monkeypatch.setattr(registered, "lies_on_support", lambda ground, solid, pose: grounds.append(ground))
    named_by_edges(images_of("cube"), model(), [], known_table=known)
    assert {(ground.table, ground.seen) for ground in grounds} == {(there, True) if seen else (known, False)}


TABLE = TablePlane(np.array([0.0, 0.0, -1.0]), -352.5)
"""On which no part rests as it does here: what is guessed on it comes to nothing."""


@pytest.mark.parametrize("name", sorted(KNOWN))
def test_a_part_of_which_the_cameras_see_no_corner_together_is_named_where_it_rests(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(by_edges, "hypotheses_from_junctions", lambda *_: RankedHypotheses([], 1000))
    monkeypatch.setattr(by_edges, "estimate_table", lambda *_: None)
    assert named_by_edges(images_of(name), model(), []).named == [], "nobody knows of a table"
    (found,) = named_by_edges(images_of(name), model(), [], known_table=below(name)).named
    corners = frames.apply(WHERE, KNOWN[name].corners_mm)
    off = np.linalg.norm(np.concatenate(found.part.fitted_mm)[:, None] - corners, axis=2).min(1)
    assert (found.label, off.max() < 1.5) == (name, True)


def below(name: str) -> TablePlane:
    """A table on which a part rests where it is."""
    solid = model().metric[name].solid
    pose_of_model = next(one.pose for one in all_registered(name) if one.label == name)
    down = resting_planes(solid)[:, :3] @ pose_of_model[:3, :3].T
    side = down[:, 2].argmax()
    return TablePlane(-down[side], float(resting_planes(solid)[side, 3] * -1 - down[side] @ pose_of_model[:3, 3]))


def test_the_table_is_asked_where_nothing_else_names_a_part(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = list[Search]()
    monkeypatch.setattr(
        by_edges, "hypotheses_on_support", lambda scene, spent: asked.append(scene) or RankedHypotheses([], 0)
    )
    known = named_by_edges(images_of("cube"), model(), [], known_table=TABLE).named
    assert (len(known), asked) == (1, [])
    named_by_edges(images_of(None), model(), known, known_table=TABLE)
    assert asked == []
    named_by_edges(images_of(None), model(), [], known_table=TABLE)
    assert len(asked) == 1


@pytest.mark.parametrize("label", ["cube", "pyramid"])
def test_a_lone_facet_on_a_plain_table_names_the_part_with_no_look_for_corners(
    label: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(by_edges, "hypotheses_from_junctions", lambda *_: pytest.fail("corners were looked for"))
    (found,) = named_by_edges(plain(label), model(), [lone_facet(label)]).named
    corners = frames.apply(WHERE, KNOWN[label].corners_mm)
    off = np.linalg.norm(np.concatenate(found.part.fitted_mm)[:, None] - corners, axis=2).min(1)
    assert (found.label, off.max() < 1.5) == (label, True)


def test_where_that_leaves_something_unnamed_or_the_table_has_a_pattern_corners_are_asked_as_well(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked = list[Search]()
    monkeypatch.setattr(
        by_edges, "hypotheses_from_junctions", lambda scene, spent: asked.append(scene) or RankedHypotheses([], 1)
    )
    (found,) = named_by_edges(plain("cube"), model(), [lone_facet("cube")], enough=lambda new: not new).named
    assert (found.label, len(asked)) == ("cube", 1)
    assert named_by_edges(images_of("cube"), model(), [lone_facet("cube")]).named == []
    assert len(asked) == 2


def test_on_a_patterned_table_a_lone_facet_is_one_guess_among_those_of_corners() -> None:
    (facet,) = lone_facet("cube").group.facets
    alone, with_facet = (
        hypotheses_from_junctions(scene("cube", groups), lambda: 0.0) for groups in ([], [merge_vertices([facet])])
    )
    assert with_facet.tested == alone.tested + len(
        facet_poses(merge_vertices([facet]).polyhedron, model().metric, search.SUSPECT_MM)[0]
    )


@cache
def plain(name: str) -> StereoImages:
    return open_stereo(*print_pair(KNOWN[name], WHERE, printed=False, patterned=False), straight_rig())


def lone_facet(name: str) -> Recognised:
    """The largest facet of a part, seen where it lies."""
    facet = max(
        (_in_both(one) for one in view_of(KNOWN[name], WHERE).facets), key=lambda one: PlanarShape.of(one.left_px).area
    )
    return unnamed(merge_vertices([facet]))


@pytest.mark.parametrize(("nats_less", "least_mm", "most_mm"), [(0.0, 2.0, 4.0), (200.0, 0.0, 0.1)])
def test_a_place_that_its_edges_give_as_well_is_in_the_covariance(
    nats_less: float, least_mm: float, most_mm: float
) -> None:
    best = max((one for one in all_registered("cube") if one.label == "cube"), key=lambda one: one.odds)
    farther = frames.perturb(best.pose, np.array([0.0, 0.0, 4.0, 0.0, 0.0, 0.0]))
    other = replace(
        best, pose=farther, evidence=EdgeEvidence(best.evidence.nats - nats_less, best.evidence.fraction), tested=7.0
    )
    spread = by_edges.pose_spread(best, [best, other], best.pose[None])
    assert np.count_nonzero(np.abs(spread) > 1e-6) <= 1
    assert least_mm <= np.sqrt(spread[2, 2]) <= most_mm


def test_where_a_part_looks_the_same_turned_that_is_no_doubt_of_its_place() -> None:
    best = max((one for one in all_registered("cube") if one.label == "cube"), key=lambda one: one.odds)
    turned = replace(best, pose=best.pose @ frames.rigid(np.diag([-1.0, -1.0, 1.0]), np.zeros(3)))
    equivalent = np.stack([best.pose, turned.pose])
    np.testing.assert_allclose(by_edges.pose_spread(best, [best, turned], equivalent), 0.0, atol=1e-9)


def test_what_came_nearest_says_where_its_print_lies_and_a_look_says_it_is_the_depth(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(by_edges, "LEAST_CONFIDENCE", 1.1)
    monkeypatch.setattr(by_edges, "print_apart_px", lambda *_: 2.0)
    first, *others = named_by_edges(images_of("cube"), model(), []).guesses
    assert first.print_apart_px == 2.0
    assert not any(other.print_apart_px for other in others)
    scene = look(*print_pair(CUBE, WHERE, 0), straight_rig(), model())
    assert any("depth calibration" in note for note in scene.notes)
