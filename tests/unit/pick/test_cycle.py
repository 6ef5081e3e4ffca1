"""The cycle on a fake cell: picks, what is skipped and named, retries, second views, disagreements."""

import asyncio
from dataclasses import replace

import numpy as np
import pytest

from daemon import frames
from daemon.arm.motion import MoveRefusedError
from daemon.arm.operators import RefusedError
from daemon.events.pick_order import PickOrder
from daemon.pick import find
from daemon.pick.settings import Settings
from daemon.vision.values import Cause, Polygon, Recognition, Rejected
from drivers.simcell import parts
from tests.fakes.fake_cell import ON_HAND, World, cycle_of, one_part
from tests.fakes.waiting import until_so


def cleared(world: World, settings: Settings | None = None, **options):
    cycle = cycle_of(world, settings)
    return cycle, asyncio.run(cycle.auto(PickOrder(**options)))


def picked(world: World, label=None, settings: Settings | None = None):
    cycle = cycle_of(world, settings)
    return cycle, asyncio.run(cycle.pick(label))


def four_parts(seed: int) -> World:
    rng = np.random.default_rng(seed)
    world = World(rng)
    for label, (x, y) in zip(parts.TAUGHT, ((430, -100), (430, 100), (590, -90), (590, 90)), strict=True):
        world.put(label, x, y, rng.uniform(0, 6.28), int(rng.integers(len(parts.part_shape(label).rests))))
    return world


@pytest.mark.parametrize("seed", range(2))
def test_a_table_of_four_parts_is_cleared(seed):
    world = four_parts(seed)
    _, ends = cleared(world)
    assert sorted(world.binned) == sorted(parts.TAUGHT), [(e.outcome, e.why) for e in ends]
    assert [e.outcome for e in ends] == ["picked"] * 4 + ["empty"]


def test_the_label_asked_for_is_the_one_picked():
    world = four_parts(0)
    _, end = picked(world, "pyramid")
    assert (end.outcome, end.label, world.binned) == ("picked", "pyramid", ["pyramid"])


def test_auto_ends_after_the_count_asked_for():
    world = four_parts(1)
    _, ends = cleared(world, count=2)
    assert [e.outcome for e in ends] == ["picked", "picked"]
    assert len(world.lying) == 2


def test_an_empty_table_is_told_and_the_arm_goes_home():
    world = World(np.random.default_rng(0))
    cycle, end = picked(world)
    assert end.outcome == "empty"
    assert np.allclose(world.at[:3, 3], cycle.settings.home.point_mm, atol=1)


@pytest.mark.parametrize("used", [True, False])
@pytest.mark.parametrize("patterned", [True, False])
def test_a_table_with_outlines_that_make_no_facet_is_not_called_empty_unless_they_are_a_patterns(
    monkeypatch, used, patterned
):
    world = World(np.random.default_rng(0))
    cycle = cycle_of(world)
    see = cycle.recogniser.see
    corners = np.array([[20.0, 20.0], [30.0, 20.0], [20.0, 35.0]])
    outline = Polygon(corners, np.tile(np.eye(2), (3, 1, 1)), np.ones(3), corners)

    def outlined(left, right, table=None, rig=None):
        scene = see(left, right, table)
        if used:
            return replace(scene, view=replace(scene.view, polygons_left=(outline,), polygons_right=(outline,)))
        alone = tuple(Rejected(corners, camera, "no partner") for camera in ("left", "right"))
        return replace(scene, view=replace(scene.view, rejected=alone))

    cycle.recogniser.see = outlined
    monkeypatch.setattr(find, "cause_of_nothing", lambda _: Cause.PATTERNED if patterned else None)
    end = asyncio.run(cycle.pick())
    assert end.outcome == ("empty" if patterned else "unknown")
    assert ("the patterned table" if patterned else "knocked camera") in end.why


def test_an_empty_table_is_looked_at_again_at_the_interval():
    world = World(np.random.default_rng(0))
    cycle = cycle_of(world)

    async def wait_then_lay_a_part():
        task = asyncio.create_task(cycle.auto(PickOrder(1, 0.01)))
        await until_so(lambda: world.said("cycle_end"))
        world.put("cube", 520, 0, 0.3)
        return await asyncio.wait_for(task, 60)

    ends = asyncio.run(wait_then_lay_a_part())
    assert ends[0].outcome == "empty"
    assert ends[-1].outcome == "picked"


def test_looks_are_fused_and_their_number_falls_when_the_first_is_good():
    sharp = replace(Settings(), doubt=replace(Settings().doubt, pixels=0.02, hand_eye_mm=0.05, hand_eye_deg=0.01))
    _, good = picked(one_part(), settings=sharp)
    _, usual = picked(one_part())
    assert good.stops == 1
    assert usual.stops > 1


def test_a_part_that_no_look_makes_sure_enough_is_skipped_and_named():
    strict = replace(Settings(), stops=replace(Settings().stops, enough_mm=0.01))
    world = one_part()
    _, end = picked(world, settings=strict)
    assert end.outcome == "unsure"
    assert "cube" in end.why
    assert end.stops == strict.stops.most_looks
    assert not world.binned


def test_a_missed_grasp_is_noticed_by_looking_again_and_tried_again():
    world = one_part()
    world.slippery = 1
    _, end = picked(world)
    assert end.outcome == "picked"
    assert [r["text"] for r in world.said("decision")].count("missed") == 1


def test_a_part_missed_too_often_is_given_up_with_the_hand_open():
    world = one_part()
    world.slippery = 9
    _, end = picked(world)
    assert end.outcome == "missed"
    assert not world.closed
    assert world.lying


def test_a_pick_that_is_refused_lets_no_auto_try_again_what_it_had_left_alone():
    """Whoever asked was told `busy`, and the arm went back for the part that had slipped out of the hand too often."""
    world = one_part("cube")
    world.put("pyramid", 400, 90, 1.0)
    world.slippery = 2
    cycle, asked = cycle_of(world), []

    def ask(name: str) -> None:
        if name == "moving" and cycle.skipped:
            asked.append(asyncio.get_running_loop().create_task(cycle.pick()))

    async def story():
        world.before = ask
        ends = await cycle.auto()
        return ends, await asyncio.gather(*asked, return_exceptions=True)

    ends, answers = asyncio.run(story())
    assert any("busy: auto" in str(answer) for answer in answers)
    assert [s.label for s in ends[0].skipped] == ["cube"]
    assert world.binned == ["pyramid"]
    assert "cube" in world.lying


def test_a_part_knocked_away_by_the_closing_hand_is_not_taken_for_picked():
    world = one_part()
    knocked = []

    def knock(act):
        if act == "hand" and world.wire and world.wire[-1][0] == "move" and not knocked and near_hand(world):
            knocked.append(act)
            world.lying["cube"][:2, 3] += (70.0, -60.0)

    world.before = knock
    _, end = picked(world)
    assert knocked
    (why,) = (r["why"] for r in world.said("decision") if r["text"] == "missed")
    assert why.startswith("cube was knocked away; the gripper opens over the bin")
    assert (end.outcome, world.binned) == ("picked", ["cube"])


def near_hand(world):
    """Whether the hand is around the cube."""
    return np.linalg.norm(world.lying["cube"][:3, 3] - world.at[:3, 3]) < 40.0


def test_a_part_out_of_reach_is_skipped_and_named_and_the_others_are_picked():
    world = one_part("cube")
    world.put("pyramid", 400, 90, 1.0)
    world.unreached = world.lying["cube"][:3, 3]
    _, ends = cleared(world)
    assert world.binned == ["pyramid"]
    assert any(s.label == "cube" and s.outcome == "unreachable" for e in ends for s in e.skipped)


@pytest.mark.slow
@pytest.mark.parametrize("lasts", [False, True])
def test_a_lone_facet_that_bars_the_way_must_show_again(lasts):
    world = World(np.random.default_rng(0))
    world.put("cube", 520, 0, 0.4)
    cycle = cycle_of(world)
    see, looks = cycle.recogniser.see, []
    upright = np.array([[48.0, -30, -20], [48, 30, -20], [48, 30, 30], [48, -30, 30]])

    def with_walls(left, right, table=None, rig=None):
        scene, looks[len(looks) :] = see(left, right, table), [1]
        if not scene.parts or (len(looks) > 1 and not lasts):
            return scene
        cyclopean_from_world = frames.inverse(world.at @ world.tool_from_cyclopean)
        walls = []
        for k in range(6):
            turn = frames.rigid(
                frames.rotation_from_vector(np.array([0, 0, k * np.pi / 3])), np.array([520.0, 0, -275])
            )
            corners = frames.apply(cyclopean_from_world @ turn, upright)
            wall = replace(scene.parts[0].facets[0], corners_mm=corners)
            unknown = Recognition("unknown", 0.9, 0.0, 0.0, None, False, "fits nothing that was taught")
            walls.append(replace(scene.parts[0], recognition=unknown, facets=(wall,)))
        return replace(scene, parts=(*scene.parts, *walls))

    cycle.recogniser.see = with_walls
    end = asyncio.run(cycle.pick())
    assert "is the facet that blocks the grasp really there?" in [r["why"] for r in world.said("decision")]
    barred = [s.why for s in cycle.skipped if s.label == "cube" and s.outcome == "unreachable"]
    assert any("blocked by a neighbour" in why for why in barred) == lasts
    assert (end.outcome == "picked") == (not lasts), end.why


def test_a_blocked_part_waits_until_its_neighbour_is_gone():
    world = World(np.random.default_rng(2))
    world.put("cube", 520, 0, 0.0)
    world.put("pyramid", 520, 58, 0.0)
    world.put("triangular_prism", 520, -62, np.pi / 2, 1)
    cleared(world)
    assert "cube" in world.binned


def test_an_unknown_part_is_looked_at_from_other_sides_then_left_alone_and_listed():
    world = one_part()
    world.put("pyramid", 430, -100, 0.4)
    world.labels["pyramid"] = Recognition("unknown", 0.9, 0.0, 0.0, None, False, "fits nothing taught")
    cycle, ends = cleared(world)
    assert world.binned == ["cube"]
    assert [s.outcome for s in cycle.skipped] == ["unknown"]
    assert "pyramid" in world.lying
    looks = [r for r in world.said("look") if r["purpose"] == "another view"]
    assert len(looks) == cycle.settings.views_of_doubtful
    assert ends[-1].outcome == "unknown"


def test_an_ambiguous_part_is_settled_by_a_second_computed_view():
    world = one_part("triangular_prism")
    world.labels["triangular_prism"] = Recognition(
        "unknown", 0.5, 0.5, 0.5, "cube", True, "either", ("triangular_prism", "cube")
    )

    def settle(name):
        if name == "see" and any(r["text"].startswith("another view") for r in world.said("decision")):
            world.labels.clear()

    world.before = settle
    _, end = picked(world)
    assert (end.outcome, end.label) == ("picked", "triangular_prism")


def test_a_part_taken_away_during_the_approach_is_named_lost():
    world = one_part()

    def take_away(name):
        if name == "grab" and len(world.said("estimate")) == 1:
            world.lying.clear()

    world.before = take_away
    _, end = picked(world)
    assert end.outcome == "lost"
    assert not world.closed


def test_a_part_pushed_during_the_approach_is_suspected_and_picked_where_it_now_lies():
    world = one_part()
    world.put("pyramid", 430, -100, 0.4)

    def push(name):
        if name == "grab" and len(world.said("estimate")) == 1 and "pushed" not in world.lying:
            world.lying["cube"] = frames.perturb(world.lying["cube"], np.array([5.0, 4.0, 0, 0, 0, 0]))
            world.before = lambda name: None

    world.before = push
    _, end = picked(world, "cube")
    assert end.outcome == "picked"
    assert any(r["text"].startswith("suspect") for r in world.said("decision"))


def test_a_hand_eye_calibration_that_is_no_longer_so_stops_the_cycle_and_is_named():
    world = one_part()
    for label, x, y in (("pyramid", 440, -60), ("pentagonal_prism", 600, 60)):
        world.put(label, x, y, 0.4)

    def knock(name):
        if name == "grab" and len(world.said("estimate")) == 1:
            twist = np.array([4.0, 3.0, 0, 0, 0, 0.0])
            world.tool_from_cyclopean = frames.perturb(ON_HAND.tool_from_cyclopean, twist)

    world.before = knock
    cycle, end = picked(world, "cube")
    assert end.outcome == "fault"
    assert "hand-eye" in end.why
    assert cycle.state == "fault"
    assert world.wire[-1][0] == "abort"


def test_a_knocked_camera_is_named_by_its_epipolar_error():
    world = one_part()

    def knock(name):
        if name == "grab" and len(world.said("estimate")) == 1:
            world.epipolar = 3.0
            world.lying["cube"] = frames.perturb(world.lying["cube"], np.array([5.0, 0, 0, 0, 0, 0]))
            world.before = lambda name: None

    world.before = knock
    _, end = picked(world)
    assert end.outcome == "fault"
    assert "camera" in end.why


def test_picking_is_refused_with_what_to_do_before_enable_in_fault_and_without_a_model():
    world = one_part()
    cycle = cycle_of(world)
    asyncio.run(cycle.supervisor.disable())
    with pytest.raises(RefusedError, match="enable"):
        asyncio.run(cycle.pick())
    cycle.supervisor.enable()
    asyncio.run(cycle.supervisor.stop())
    with pytest.raises(RefusedError, match="resume"):
        asyncio.run(cycle.pick())
    cycle.supervisor.resume()
    cycle.use(None)
    with pytest.raises(RefusedError, match="teach"):
        asyncio.run(cycle.pick())
    assert all(name == "abort" for name, _ in world.wire)


def acts_of(world: World) -> list[str]:
    """What the cameras and the arm are asked, in order, from now on."""
    acts: list[str] = []
    world.before = acts.append
    return acts


@pytest.mark.parametrize("light", [(1.0, 0.5), (0.4, 0.4), (2.6, 2.6)])
def test_cameras_of_unequal_or_wrong_exposure_are_set_in_the_survey_and_never_on_an_approach(light):
    world = one_part()
    world.light = light
    exposed_at = []

    def note(name):
        if name == "expose":
            exposed_at.append(world.said("move")[-1]["purpose"])

    world.before = note
    _, end = picked(world)
    assert end.outcome == "picked"
    assert world.light[0] == pytest.approx(world.light[1], rel=0.1)
    assert set(exposed_at) == {"survey 1"}
    assert "exposure x" in world.said("decision")[0]["text"]


def test_an_approach_is_not_held_up_by_light_that_goes_wrong_on_it():
    world = one_part()
    looks = []

    def dim(name):
        looks.append(name)
        if name == "moving" and world.said("move")[-1]["purpose"].startswith("stand-off"):
            world.light = (1.0, 0.4)

    world.before = dim
    _, end = picked(world)
    assert end.outcome == "picked"
    assert "expose" not in looks


def test_light_that_will_do_is_not_touched_and_cameras_that_cannot_be_set_are_looked_through_as_they_are():
    world = one_part()
    acts = acts_of(world)
    assert picked(world)[1].outcome == "picked"
    assert "expose" not in acts
    world = one_part()
    world.light = (1.0, 0.5)
    cycle = cycle_of(world)

    async def fixed(left, right):
        return None

    cycle.cell.cameras.expose = fixed
    assert asyncio.run(cycle.pick()).outcome == "picked"
    assert world.light == (1.0, 0.5)


def test_a_look_that_is_asked_for_is_lit_too():
    world = one_part()
    world.light = (0.4, 1.0)
    seen = asyncio.run(cycle_of(world).look())
    left, right = (float(p.pixels.mean()) for p in (seen.pictures.left, seen.pictures.right))
    assert left == pytest.approx(right, rel=0.1)


def test_the_way_down_to_a_place_from_over_it_is_a_straight_and_slow_one():
    world = World(np.random.default_rng(0))
    cycle = cycle_of(world)
    over, down = (frames.rigid(np.diag([-1.0, 1.0, -1.0]), np.array([500.0, 20.0, z])) for z in (-226.0, -284.0))
    with pytest.raises(
        MoveRefusedError, match=r"a part perhaps in the gripper would come to -\d+\.. mm above.*`holding no`"
    ):
        asyncio.run(cycle.go_down(over, down, "touch"))
    cycle.holding(False)
    asyncio.run(cycle.go_down(over, down, "touch"))
    *_, before, last = world.said("move")
    assert np.array_equal(before["target"], over)
    assert (last["how"], last["speed_pct"]) == ("straight", cycle.settings.near_pct)
    assert np.array_equal(last["target"], down)
    assert before["speed_pct"] > last["speed_pct"]
