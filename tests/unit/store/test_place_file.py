"""places.yaml: read as it is meant, every fault one line with file, line and key; written as it is read."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from daemon import frames
from daemon.store.place_file import PlaceEntry, load_places, with_place, without_place, write_places
from daemon.store.yamlfile import ConfigError

FLAT = np.eye(4).tolist()
BESIDE = [[1, 0, 0, 30], [0, 1, 0, 0], [0, 0, 1, 25], [0, 0, 0, 1]]
THIN = {"low_mm": [0, 0, 0], "high_mm": [1, 0, 1]}
SKEW = [[2, 0, 0, 0], *FLAT[1:]]
TRAY: dict[str, Any] = {
    "part": "cube",
    "first": [[1, 0, 0, 400], [0, 1, 0, -200], [0, 0, 1, -275], [0, 0, 0, 1]],
    "row_end_mm": [400, -20, -275],
    "column_end_mm": [520, -200, -275],
    "columns": 4,
    "rows": 3,
}


def written(folder: Path, **sections: Any) -> Path:
    path = folder / "places.yaml"
    path.write_text(yaml.safe_dump({"version": 1, **sections}))
    return path


def test_a_cell_without_the_file_has_no_places(tmp_path: Path) -> None:
    assert load_places(tmp_path / "places.yaml").places == ()


def test_a_pose_of_few_digits_is_a_rotation_that_the_guard_takes(tmp_path: Path) -> None:
    """Four digits were none to the guard, and every set-down there was refused."""
    rows = [[0.1381, 0.0, 0.9904, 480.0], [-0.9904, 0.0, 0.1381, 60.0], [0.0, -1.0, 0.0, -275.0], [0.0, 0.0, 0.0, 1.0]]
    place = load_places(written(tmp_path, places={"nest": {"part": "cube", "pose": rows}})).named("nest")
    assert place is not None
    assert place.frame_from_part is not None
    assert frames.not_a_rotation(place.frame_from_part[:3, :3], 1e-9) is None
    assert place.frame_from_part == pytest.approx(np.array(rows), abs=1e-4)


def test_a_place_is_in_the_world_or_in_the_frame_of_its_fixture(tmp_path: Path) -> None:
    path = written(
        tmp_path,
        fixtures={"plate": {"point_mm": [500, 0, -290], "heading_deg": 90}},
        places={
            "nest": {"part": "cube", "fixture": "plate", "pose": BESIDE},
            "bare": {"part": "pyramid", "side_down": 5, "point_mm": [400, 100, -300], "heading_deg": 30},
        },
    )  # fmt: skip
    places = load_places(path)
    nest, bare = places.named("nest"), places.named("bare")
    assert nest is not None
    assert bare is not None
    assert nest.frame_from_part is not None
    assert (nest.world_from_frame @ nest.frame_from_part)[:3, 3] == pytest.approx([500, 30, -265])
    assert (bare.part, bare.side_down, bare.frame_from_part) == ("pyramid", 5, None)
    assert [place.name for place in places.of("cube")] == ["nest"]


@pytest.mark.parametrize(
    ("order", "second", "fifth"),
    [("rows", [400, -140], [460, -200]), ("columns", [460, -200], [460, -140]), ("snake", [400, -140], [460, -20])],
)
def test_a_pattern_is_filled_in_its_order(tmp_path: Path, order: str, second: list[int], fifth: list[int]) -> None:
    places = load_places(written(tmp_path, patterns={"tray": {**TRAY, "order": order}}))
    assert len(places.places) == 12
    for name, at in (("tray.2", second), ("tray.5", fifth)):
        place = places.named(name)
        assert place is not None
        assert place.frame_from_part is not None
        assert place.frame_from_part[:2, 3] == pytest.approx(at)


def test_layers_stand_on_one_another_and_skipped_places_stay_empty(tmp_path: Path) -> None:
    tray = {**TRAY, "layers": 2, "layer_mm": 50, "skip": [2, 15]}
    places = load_places(written(tmp_path, patterns={"tray": tray}))
    assert len(places.places) == 22
    assert places.named("tray.2") is None
    first, above, over_nothing = places.named("tray.1"), places.named("tray.13"), places.named("tray.14")
    assert first is not None
    assert above is not None
    assert over_nothing is not None
    assert (first.on_top_of, above.on_top_of) == (None, "tray.1")
    assert above.frame_from_part is not None
    assert above.frame_from_part[2, 3] == -225


def test_the_fourth_corner_checks_the_other_three(tmp_path: Path) -> None:
    near = {**TRAY, "check_mm": [520.3, -20.4, -275]}
    assert load_places(written(tmp_path, patterns={"tray": near})).residuals_mm["tray"] == pytest.approx(0.5)
    with pytest.raises(ConfigError, match=r"check_mm: 5\.0 mm from where the other three corners put it, 2 at most"):
        load_places(written(tmp_path, patterns={"tray": {**TRAY, "check_mm": [523, -24, -275]}}))


@pytest.mark.parametrize(
    ("sections", "words"),
    [
        ({"places": {"Nest": {"part": "cube", "pose": FLAT}}}, r"places\.Nest: expected a name of small letters"),
        ({"places": {"nest": {"part": "cube"}}}, r"places\.nest: expected pose, or side_down and point_mm"),
        ({"places": {"nest": {"part": "cube", "pose": FLAT, "side_down": 1}}}, "expected either pose, or side_down"),
        ({"places": {"nest": {"part": "cube", "pose": SKEW}}}, "pose: expected the pose of"),
        ({"places": {"nest": {"part": "cube", "pose": FLAT, "fixture": "x"}}}, "fixture: expected a fixture of"),
        ({"places": {"nest": {"part": "cube", "pose": FLAT, "tolerance_mm": 0}}}, "tolerance_mm: expected above 0"),
        ({"places": {"nest": {"part": "cube", "pose": FLAT, "tol_mm": 1}}}, "tol_mm: unknown key"),
        ({"fixtures": {"x": {"solid": [THIN]}}}, r"solid\[0\]: expected low_mm below"),
        ({"patterns": {"tray": {**TRAY, "layers": 2}}}, "layer_mm: expected the distance of the layers"),
        ({"patterns": {"tray": {**TRAY, "row_end_mm": [400, -200, -275]}}}, "row_end_mm: expected the last of 4"),
        ({"patterns": {"tray": {**TRAY, "row_end_mm": [450, -20, -275]}}}, "degrees off square"),
        ({"patterns": {"tray": TRAY}, "places": {"tray": {"part": "a", "pose": FLAT}}}, "has this name already"),
        ({"patterns": {"tray": {**TRAY, "columns": 100, "rows": 100}}}, "expected at most 1000 places, found 10000"),
    ],
)  # fmt: skip
def test_what_cannot_be_meant_is_named_with_its_line_and_key(tmp_path: Path, sections: Any, words: str) -> None:
    with pytest.raises(ConfigError, match=words) as told:
        load_places(written(tmp_path, **sections))
    assert "places.yaml" in str(told.value)
    assert "\n" not in str(told.value)


@given(
    x=st.floats(-900, 900), turn=st.floats(-3, 3), tolerance=st.floats(0.1, 20), equivalents=st.booleans()
)  # fmt: skip
def test_a_place_is_read_as_it_was_written(
    tmp_path_factory: pytest.TempPathFactory, x: float, turn: float, tolerance: float, equivalents: bool
) -> None:
    folder = tmp_path_factory.mktemp("places")
    path = written(folder, patterns={"tray": TRAY})
    c, s = float(np.cos(turn)), float(np.sin(turn))
    pose = ((c, -s, 0.0, x), (s, c, 0.0, 100.0), (0.0, 0.0, 1.0, -280.0), (0.0, 0.0, 0.0, 1.0))
    entry = PlaceEntry(part="cube", pose=pose, tolerance_mm=tolerance, equivalents=equivalents)
    write_places(path, with_place(load_places(path), "nest", entry))
    again = load_places(path)
    assert again.file.places["nest"] == entry
    assert len(again.places) == 13
    write_places(path, without_place(again, "tray"))
    write_places(path, without_place(load_places(path), "nest"))
    assert load_places(path).places == ()


def test_the_corners_of_a_pattern_may_be_places_that_were_taught(tmp_path: Path) -> None:
    """It takes them over: each would otherwise be filled twice."""

    def at(x: float, y: float) -> dict[str, Any]:
        return {"part": "cube", "pose": [[1, 0, 0, x], [0, 1, 0, y], [0, 0, 1, -275], [0, 0, 0, 1]]}

    corners = {"a": at(400, -200), "b": at(400, -20), "c": at(520, -200), "d": at(520.5, -20), "nest": at(300, 0)}
    named = {**TRAY, "first": "a", "row_end_mm": "b", "column_end_mm": "c", "check_mm": "d"}
    found = load_places(written(tmp_path, places=corners, patterns={"tray": named}))
    plain = load_places(written(tmp_path, patterns={"tray": TRAY}))
    assert [place.name for place in found.places] == ["nest", *(place.name for place in plain.places)]
    for ours, theirs in zip(found.places[1:], plain.places, strict=True):
        assert ours.frame_from_part == pytest.approx(theirs.frame_from_part)
    assert found.residuals_mm["tray"] == pytest.approx(0.5)


@pytest.mark.parametrize("place", [None, {"part": "cube", "side_down": 1, "point_mm": [0, 0, 0]},
                                   {"part": "pyramid", "pose": FLAT}])  # fmt: skip
def test_a_corner_that_is_no_taught_place_of_the_part_says_how_to_teach_it(tmp_path: Path, place: Any) -> None:
    places = {} if place is None else {"a": place}
    with pytest.raises(ConfigError, match=r"tray\.first: .*found a: `place teach a cube`"):
        load_places(written(tmp_path, places=places, patterns={"tray": {**TRAY, "first": "a"}}))
