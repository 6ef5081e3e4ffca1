"""Replay through today's recogniser: what changed, and what of it is worse."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daemon.calibration.file import load_calibration, save_calibration
from daemon.review import replay
from daemon.review.digest import Digest
from daemon.review.page import read_digest
from daemon.review.replay import (
    ReplayChange,
    ReplayInputs,
    apart_mm,
    compare,
    paired,
    replayed_looks,
)
from daemon.store.folders import ETC
from daemon.store.library import FACETS, load_facets
from daemon.store.model import save
from daemon.store.runlog import RunLog
from daemon.store.runs import RunError
from daemon.vision.facets import table_of
from daemon.vision.look import look
from daemon.vision.model import empty_model
from tests.fakes.made_run import FACET, part


def scene(*parts: dict[str, object]) -> dict[str, object]:
    return {"parts": list(parts)}


def test_replay_tells_what_changed_and_what_of_it_is_worse() -> None:
    then = scene(part("cube"))
    assert compare(then, scene(part("cube"))) == []
    assert compare(then, scene())[0][2]
    lost_name = compare(then, scene(part("unknown", reason="one facet")))
    assert lost_name == [("cube", "now unknown: one facet", True)]
    gained = compare(scene(part("unknown")), scene(part("cube")))
    assert gained == [("unknown", "now cube: 3 facets fit to 0.10 mm rms", False)]


def test_replay_takes_a_pose_within_three_sigma_for_the_same_and_one_beyond_for_worse() -> None:
    def shifted(mm: float) -> dict[str, object]:
        pose = [[1.0, 0, 0, mm], [0, 1.0, 0, 0], [0, 0, 1.0, 0], [0, 0, 0, 1.0]]
        return part("cube", cyclopean_from_part=pose)

    assert compare(scene(part("cube")), scene(shifted(0.29))) == []
    assert compare(scene(part("cube")), scene(shifted(0.35)))[0][2]


def beside(mm: float) -> dict[str, object]:
    """A cube whose corners lie so far off, and that is said to lie another way round."""
    turned = [[0.0, -1.0, 0, 30.0], [1.0, 0, 0, 0], [0, 0, 1.0, 0], [0, 0, 0, 1.0]]
    facet = {**FACET, "corners_mm": np.add(np.array(FACET["corners_mm"], float), [mm, 0.0, 0.0]).tolist()}
    return part("cube", cyclopean_from_part=turned, facets=[facet])


def test_a_look_that_only_followed_a_part_is_held_against_a_whole_one_by_the_corners() -> None:
    """Which of several ways that show the same it lies, the look before had told it."""
    then = scene(part("cube"))
    assert compare(then, scene(beside(0.41)), whole=False) == []
    assert compare(then, scene(beside(0.44)), whole=False)[0][2]
    assert compare(then, scene(part("unknown", reason="one facet")), whole=False) == []
    assert compare(then, scene(part("pyramid")), whole=False)[0][2]
    assert compare(then, scene(), whole=False) == []


def test_a_part_of_another_model_is_held_against_the_old_by_its_corners_not_by_its_pose() -> None:
    """Another model's part has another origin: where the part lies is the same, its pose is not."""
    then = scene(part("cube"))
    assert compare(then, scene(beside(0.0)))[0][2]
    assert compare(then, scene(beside(0.0)), one_model=False) == []
    assert compare(then, scene(beside(0.4)), one_model=False) == []
    assert "moved by 0.45 mm at its corners" in compare(then, scene(beside(0.45)), one_model=False)[0][1]


def test_without_corners_or_without_a_covariance_nothing_is_told_of_how_far_a_part_moved() -> None:
    then, far = part("cube"), beside(9.0)
    for bare in ({**far, "covariance": None}, {**far, "facets": []}):
        assert replay.corners_moved(then, bare) is None
        assert replay.corners_moved(bare, then) is None
    for bare in ({**far, "covariance": None}, {**far, "cyclopean_from_part": None}):
        assert replay.part_moved(then, bare) is None
        assert replay.part_moved(bare, then) is None
    assert replay.corners_moved(then, far)
    assert replay.part_moved(then, far)


def test_how_far_a_part_moved_is_told_in_its_place_and_in_its_turn() -> None:
    aside = [[0.0, -1.0, 0, 0.0], [1.0, 0, 0, 30.0], [0, 0, 1.0, 40.0], [0, 0, 0, 1.0]]
    told = replay.part_moved(part("cube"), part("cube", cyclopean_from_part=aside))
    assert str(told).startswith("moved by 50.00 mm and 90.00 degrees")


def test_how_far_apart_two_parts_lie_is_told_by_the_corners_that_both_show() -> None:
    fewer = part("cube", facets=[{**FACET, "corners_mm": [[0.3, 0, 300], [0.3, 50, 300]]}])
    assert apart_mm(part("cube"), fewer) == apart_mm(fewer, part("cube")) == pytest.approx(0.3)
    assert apart_mm(part("cube"), part("cube", facets=[])) is None


def test_parts_belong_together_that_lie_within_so_much_and_each_has_one_other() -> None:
    near, far = beside(25.0), beside(25.1)
    then = scene(part("cube"))
    assert paired(then, scene(near)) == [(then["parts"][0], near)]  # type: ignore[index]
    assert paired(then, scene(far)) == [(then["parts"][0], None), (None, far)]  # type: ignore[index]
    two = paired(scene(part("cube"), beside(1.0)), scene(beside(0.9)))
    assert [match is None for _, match in two] == [False, True]
    bare = part("cube", facets=[])
    assert paired(scene(bare), scene(bare))[0][1] is None
    assert replay.centre_distance_mm(bare, near) == replay.centre_distance_mm(near, bare) == np.inf, (
        "what has no corners is nowhere near"
    )


def test_what_is_new_or_gone_is_told_only_where_all_was_looked_for_and_it_has_a_name() -> None:
    named, nameless = scene(part("cube")), scene(part("unknown"))
    assert compare(named, scene()) == [("cube", "no longer found", True)]
    assert compare(scene(), named) == [("cube", "was not found before", False)]
    assert compare(nameless, scene()) == compare(scene(), nameless) == []
    assert compare(scene(), named, whole=False) == []


def test_the_table_of_a_look_is_the_one_it_was_taken_over() -> None:
    table = table_of({"up": [0, 0, 1], "level_mm": 3})
    assert table is not None
    assert (table.up.tolist(), table.level_mm) == ([0, 0, 1], 3.0)
    assert table_of({}) is table_of(None) is None


LIBRARY = load_facets(FACETS)
USUAL = ReplayInputs()


def recorded(tmp_path: Path, *looks: dict[str, Any], calibration: bool = True) -> tuple[Path, Digest]:
    """A run of looks at nothing: its folder, and what a review reads."""
    log = RunLog(tmp_path / "run")
    kept = {"calibration": log.keep(ETC / "calibration.yaml")} if calibration else {}
    log.record("run_start", **kept)
    nothing = np.full((480, 640), 90, np.uint8)
    for more in looks:
        log.record(
            "look", cycle=1, stop=0, purpose="survey",
            **({"images": {"left": nothing, "right": nothing}, "scene": scene()} | more),
        )  # fmt: skip
    log.close()
    return log.folder, read_digest(log.folder)


def looked(tmp_path: Path, *looks: dict[str, Any], using: ReplayInputs = USUAL, chosen: Any = None) -> list[Any]:
    folder, run = recorded(tmp_path, *looks)
    return list(replayed_looks(folder, run, LIBRARY, using, chosen))


def test_a_part_that_was_there_and_is_not_is_told_by_look_and_cycle(tmp_path: Path) -> None:
    empty, full = looked(tmp_path, {"scene": scene()}, {"scene": scene(part("cube"))})
    assert (empty.changes, empty.record["seq"], empty.now["parts"]) == ((), 1, [])
    (change,) = full.changes
    assert change == ReplayChange(2, 1, "cube", "no longer found", True)
    assert (full.identical, full.then) == (False, scene(part("cube")))


def test_a_look_that_only_followed_a_part_is_held_against_nothing(tmp_path: Path) -> None:
    (followed,) = looked(tmp_path, {"whole": False, "scene": scene(part("cube"))})
    assert (followed.changes, followed.identical) == ((), True)


def test_pictures_of_the_board_in_which_nothing_was_looked_for_are_left_out(tmp_path: Path) -> None:
    assert [seen.record["seq"] for seen in looked(tmp_path, {"scene": None}, {})] == [2]


def test_looks_are_chosen_by_number_and_one_without_pictures_is_a_line(tmp_path: Path) -> None:
    found = looked(tmp_path, {"images": {}}, {}, {"images": None}, chosen={1, 3})
    assert found == [f"look {k}: its pictures are not in the run folder" for k in (1, 3)]


def test_without_a_calibration_a_run_is_replayed_only_with_another(tmp_path: Path) -> None:
    folder, run = recorded(tmp_path, {}, calibration=False)
    with pytest.raises(RunError, match="no calibration was kept with this run"):
        list(replayed_looks(folder, run, LIBRARY, USUAL))
    other = ReplayInputs(rig=load_calibration(ETC / "calibration.yaml").rig)
    assert len(list(replayed_looks(folder, run, LIBRARY, other))) == 1


def test_a_pair_of_one_camera_is_seen_with_the_arms_errors_and_one_of_two_is_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    added: list[Any] = []
    monkeypatch.setattr(replay, "with_arm_errors", lambda seen, rig, arm: added.append((rig, arm)) or seen)
    aside = np.eye(4)
    aside[0, 3] = 60.0
    moved = {"eye": "left", "left": np.eye(4), "right": aside, "arm_mm": 0.2, "arm_deg": 0.1}
    looked(tmp_path, {}, {"moved": moved}, {})
    ((rig, arm),) = added
    assert arm.shape == (6, 6)
    assert rig.right.cyclopean_from_camera[0, 3] - rig.left.cyclopean_from_camera[0, 3] == pytest.approx(60.0)


def test_each_look_has_the_model_and_the_calibration_that_were_in_use_then(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    used: list[tuple[Any, float]] = []

    def looked_at(left: Any, right: Any, rig: Any, model: Any, *_: Any) -> Any:
        used.append((model, rig.left.matrix[0, 0]))
        return look(left, right, rig)

    monkeypatch.setattr(replay, "look", looked_at)
    log = RunLog(tmp_path / "run")
    files = []
    for number in (1, 2):
        save(empty_model(LIBRARY), tmp_path / f"{number}.npz", trained=f"2026-11-2{number}T10:00:00Z")
        files.append(log.keep(tmp_path / f"{number}.npz"))
    usual = load_calibration(ETC / "calibration.yaml")
    other = replace(usual.rig.left, matrix=usual.rig.left.matrix * [[2.0], [2.0], [1.0]])
    save_calibration(replace(usual, rig=replace(usual.rig, left=other)), tmp_path / "other.yaml")
    nothing = np.full((480, 640), 90, np.uint8)

    def looked_so(purpose: str) -> None:
        log.record("look", purpose=purpose, scene=scene(), images={"left": nothing, "right": nothing})

    log.record("run_start", calibration=log.keep(ETC / "calibration.yaml"))
    looked_so("before there was a model")
    for more in ({"file": files[0]}, {}, {"file": files[1]}, {"file": files[0]}):
        log.record("model", action="accept", version=1, **more)
        looked_so("with one")
    log.record("run_start", reloaded=True, calibration=log.keep(tmp_path / "other.yaml"), model=files[1])
    looked_so("calibrated anew")
    log.close()
    list(replayed_looks(log.folder, read_digest(log.folder), LIBRARY, USUAL))
    before, *found = [model for model, _ in used]
    assert found[0] is found[1] is found[3]
    assert found[2] is found[4]
    assert len({id(model) for model in (before, found[0], found[2])}) == 3
    focal = usual.rig.left.matrix[0, 0]
    assert [f for _, f in used] == [focal] * 5 + [2 * focal]
