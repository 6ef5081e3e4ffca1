"""The model file: what was saved comes back to the byte; what is damaged, foreign or newer is refused in one line."""

from __future__ import annotations

import dataclasses
import io
import json
import os
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon.cli.model_report import check, compare, describe
from daemon.store.folders import HOUSE
from daemon.store.library import load_facets
from daemon.store.model import (
    LARGEST_UNFOLDED,
    ModelError,
    from_bytes,
    load,
    load_file,
    save,
    to_bytes,
)
from daemon.store.npz import unpack
from daemon.store.outside import FileError
from daemon.vision.model.model import Model, TeachError, empty_model, learn_view
from daemon.vision.recognition.group_recognition import recognise_part
from daemon.vision.settings import MemorySettings
from tests.fakes.drawn import block
from tests.fakes.hostile import fitting
from tests.fakes.solids import CUBE, PENTAGONAL, PYRAMID, Body, pose, view_of

VIEWS = (
    ("cube", CUBE, (1.0, 0.1, 0.8)),
    ("pyramid", PYRAMID, (0.05, 0.03, 1.0)),
    ("pentagonal_prism", PENTAGONAL, (0.25, 0.76, 0.5)),
)


def trained(views: tuple[tuple[str, Body, tuple[float, float, float]], ...] = VIEWS) -> Model:
    rng = np.random.default_rng(1)
    model = empty_model(load_facets())
    for label, body, direction in views:
        model = learn_view(model, view_of(body, pose(np.array(direction), 0.1), rng, 0.5), label, f"{label}.png")
    return model


CONTENT = to_bytes(trained(), trained="2026-11-21T10:00:00Z")


def with_header(**changes: object) -> bytes:
    """The file with other words in its header and everything else as it was."""
    arrays = dict(np.load(io.BytesIO(CONTENT)))
    header = json.loads(arrays["header"].tobytes()) | changes
    arrays["header"] = np.frombuffer(json.dumps(header).encode(), dtype=np.uint8)
    out = io.BytesIO()
    np.savez(out, **arrays)
    return out.getvalue()


def test_the_same_views_in_the_same_order_make_the_same_bytes() -> None:
    assert to_bytes(trained()) == to_bytes(trained())
    assert to_bytes(trained()) != to_bytes(trained(VIEWS[::-1]))


def test_a_saved_model_answers_exactly_as_it_did(tmp_path: Path) -> None:
    model = trained()
    save(model, tmp_path / "model.npz")
    again = load(tmp_path / "model.npz")
    rng = np.random.default_rng(7)
    for body in (CUBE, PYRAMID, PENTAGONAL):
        group = view_of(body, pose(rng.normal(size=3), 1.0), rng)
        one, other = recognise_part(group, model), recognise_part(group, again)
        assert vars(one.recognition) == vars(other.recognition)
        np.testing.assert_array_equal(one.cyclopean_from_part, other.cyclopean_from_part)
    assert to_bytes(again) == to_bytes(model)


def test_teaching_goes_on_from_a_file_as_from_memory(tmp_path: Path) -> None:
    rng = np.random.default_rng(9)
    view = view_of(PYRAMID, pose(np.array([0.5, 0.6, -0.5]), 0.0), rng)
    save(trained(), tmp_path / "model.npz")
    assert to_bytes(learn_view(load(tmp_path / "model.npz"), view, "pyramid")) == to_bytes(
        learn_view(trained(), view, "pyramid")
    )


@settings(max_examples=60, deadline=None)
@given(st.integers(0, len(CONTENT) - 1), st.integers(1, 255))
def test_one_altered_byte_is_refused_or_changes_nothing(place: int, by: int) -> None:
    altered = bytearray(CONTENT)
    altered[place] ^= by
    try:
        again = from_bytes(bytes(altered))
    except ModelError as error:
        said = str(error)
    else:
        said = "the same"
        assert to_bytes(again.model, trained=again.trained, codes=again.codes) == CONTENT
    assert "\n" not in said


@settings(max_examples=30, deadline=None)
@given(st.integers(0, len(CONTENT) - 1))
def test_a_file_cut_short_is_refused(length: int) -> None:
    with pytest.raises(ModelError):
        from_bytes(CONTENT[:length])


@pytest.mark.parametrize(
    ("content", "word"),
    [
        (b"", "cut short"),
        (b"hello", "not a facetd model"),
        (with_header(version=3), "version 3, this facetd reads versions 1 and 2: train anew or update"),
        (with_header(format="other"), "not a facetd model"),
        (with_header(parts=["cube"]), "altered"),
        (with_header(sha256="0"), "altered"),
    ],
)
def test_what_is_no_model_of_ours_is_refused_with_the_reason(content: bytes, word: str) -> None:
    with pytest.raises(ModelError, match=word):
        from_bytes(content)


def test_a_pickle_in_the_place_of_a_model_is_never_opened() -> None:
    out = io.BytesIO()
    np.savez(out, header=np.array([{"a": 1}], dtype=object))
    with pytest.raises(ModelError):
        from_bytes(out.getvalue())


def test_an_archive_without_our_header_is_foreign() -> None:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        archive.writestr("readme.txt", "nothing of ours")
    with pytest.raises(ModelError, match="not a facetd model"):
        from_bytes(out.getvalue())


def test_a_missing_file_is_told_by_its_path(tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"none\.npz: cannot be read"):
        load(tmp_path / "none.npz")


def test_an_interrupted_write_leaves_the_old_model(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "model.npz"
    save(trained(VIEWS[:1]), path)
    monkeypatch.setattr("os.replace", _no_replace)
    with pytest.raises(ModelError):
        save(trained(), path)
    assert load(path).labels == ("cube",)
    assert [p.name for p in tmp_path.iterdir()] == ["model.npz"]


def _no_replace(_from: object, _to: object) -> None:
    raise OSError(28, "No space left on device")


def test_a_view_of_one_facet_or_of_two_parts_is_not_learnt() -> None:
    with pytest.raises(TeachError, match="at least two"):
        learn_view(trained(), view_of(CUBE, pose(np.array([0.0, 0.0, 1.0]), 0.0)), "cube")
    with pytest.raises(TeachError, match="unknown"):
        learn_view(trained(), view_of(CUBE, pose(np.array([1.0, 0.1, 0.8]), 0.0)), "unknown")


def test_show_diff_and_check_say_what_a_model_knows(tmp_path: Path) -> None:
    save(trained(), tmp_path / "a.npz", trained="2026-11-21T10:00:00Z")
    save(trained(VIEWS[:2]), tmp_path / "b.npz")
    a, b = load_file(tmp_path / "a.npz"), load_file(tmp_path / "b.npz")
    shown = describe(a)
    assert [p["label"] for p in shown.data["parts"]] == ["cube", "pyramid", "pentagonal_prism"]
    assert [p["code"] for p in shown.data["parts"]] == ["001", "010", "011"]
    assert shown.data["nodes"][0]["views"] == ["cube.png"]
    assert compare(a, b).data["gone"] == ["pentagonal_prism"]
    assert compare(a, a).data["same"]
    assert check(a).data["sound"]


FIRST = HOUSE / "tests" / "data" / "models" / "version_1.npz"
"""As the release before this version wrote it: parts shown, and a brick of 40, 55, 70 mm that was drawn."""


def test_a_model_of_the_version_before_is_learnt_again_from_its_views_and_names_what_it_named() -> None:
    file = load_file(FIRST)
    model = file.model
    assert (file.trained, file.codes["brick"]) == ("2026-11-21T10:00:00Z", "100")
    assert model.labels == ("cube", "pyramid", "pentagonal_prism", "brick")
    assert set(model.artmap.node_labels) == set(model.labels)
    assert model.parameters.vigilance == MemorySettings().vigilance, "which decided nothing then"
    brick = block(40, 55, 70)
    bodies = {"cube": CUBE, "pyramid": PYRAMID, "pentagonal_prism": PENTAGONAL,
              "brick": Body(brick.corners_mm - brick.corners_mm.mean(0), brick.facets)}  # fmt: skip
    places = [(x, y, z) for x in (-0.6, 0.5) for y in (-0.5, 0.7) for z in (-0.8, 0.6)]
    for label, body in bodies.items():
        for k, place in enumerate(places):
            seen = view_of(body, pose(np.array(place), 1.0), np.random.default_rng(k))
            told = recognise_part(seen, model).recognition
            assert told.label == (label if len(seen.facets) > 1 else "unknown"), (label, place, told.reason)
    again = from_bytes(to_bytes(model, trained=file.trained, codes=file.codes))
    assert to_bytes(again.model) == to_bytes(model)
    assert describe(again).data["parts"] == describe(file).data["parts"]


def _first_parts() -> tuple[dict[str, Any], dict[str, Any]]:
    arrays = unpack(FIRST.read_bytes(), LARGEST_UNFOLDED)
    header = json.loads(arrays.pop("header").tobytes())
    del header["sha256"]
    return header, arrays


def _other_first_part(header: dict[str, Any], _: dict[str, Any]) -> None:
    header["metric"][2]["label"] = "cone"


def _first_corners(_: dict[str, Any], arrays: dict[str, Any]) -> None:
    arrays["view1_corners_mm"] = arrays["view1_corners_mm"] * np.nan


def _first_without(_: dict[str, Any], arrays: dict[str, Any]) -> None:
    del arrays["view0_corners_mm"]


def _first_point(_: dict[str, Any], arrays: dict[str, Any]) -> None:
    arrays["view0_corners_mm"] = 0 * arrays["view0_corners_mm"]


@pytest.mark.parametrize(
    ("spoil", "word"),
    [
        (_other_first_part, "its views and its parts have different labels"),
        (_first_corners, "view1: corners, or their uncertainty, beyond"),
        (_first_without, "view0_corners_mm"),
        (_first_point, "a facet with two neighbouring corners at one place"),
    ],
)
def test_of_the_version_before_as_well_what_its_checksum_fits_must_hold_together(
    spoil: Callable[[dict[str, Any], dict[str, Any]], None], word: str
) -> None:
    header, arrays = _first_parts()
    assert from_bytes(fitting(header, arrays)).model.labels == load(FIRST).labels
    spoil(header, arrays)
    with pytest.raises(ModelError, match=f"inconsistent: .*{word}"):
        from_bytes(fitting(header, arrays))


def _parts() -> tuple[dict[str, Any], dict[str, Any]]:
    arrays = unpack(CONTENT, LARGEST_UNFOLDED)
    header = json.loads(arrays.pop("header").tobytes())
    del header["sha256"]
    return header, arrays


def _without_metric(header: dict[str, Any], _: dict[str, Any]) -> None:
    header["metric"] = header["metric"][:2]


def _other_part(header: dict[str, Any], _: dict[str, Any]) -> None:
    header["metric"][2]["label"] = "cone"


def _flat_facet(header: dict[str, Any], _: dict[str, Any]) -> None:
    header["views"][0]["solid"]["facets"][0] = [0, 1, 1]


def _a_side_of_no_length(header: dict[str, Any], _: dict[str, Any]) -> None:
    header["views"][0]["solid"]["facets"][0] = [0, 1, 2, 0]


def _endless_type(header: dict[str, Any], _: dict[str, Any]) -> None:
    header["views"][0]["solid"]["types"][0] = "polygon" + 400 * "9"


def _no_corners(_: dict[str, Any], arrays: dict[str, Any]) -> None:
    arrays["corners_mm"] = arrays["corners_mm"] * np.nan


def _below_nothing(_: dict[str, Any], arrays: dict[str, Any]) -> None:
    arrays["covariance_mm2"] = -arrays["covariance_mm2"]


def _fewer_slots(header: dict[str, Any], _: dict[str, Any]) -> None:
    header["views"][0]["slots"].pop()


def _a_slot_twice(header: dict[str, Any], _: dict[str, Any]) -> None:
    header["views"][0]["slots"].append(header["views"][0]["slots"][0])


def _no_such_slot(header: dict[str, Any], _: dict[str, Any]) -> None:
    header["views"][0]["slots"][0] = header["matrix_size"]


def _no_such_side(header: dict[str, Any], _: dict[str, Any]) -> None:
    header["views"][0]["sides"][0] = 99


def _node(header: dict[str, Any], _: dict[str, Any]) -> None:
    header["views"][0]["node"] = 3


def _no_such_node(_: dict[str, Any], arrays: dict[str, Any]) -> None:
    arrays["relations"][0, 0] = 3


def _fewer_features(_: dict[str, Any], arrays: dict[str, Any]) -> None:
    arrays["lower"] = arrays["lower"][:, 1:]


def _ends_swapped(_: dict[str, Any], arrays: dict[str, Any]) -> None:
    arrays["lower"], arrays["upper"] = arrays["upper"], arrays["lower"]


def _never_resonated(_: dict[str, Any], arrays: dict[str, Any]) -> None:
    arrays["counts"][1] = 0


def _joined(header: dict[str, Any], _: dict[str, Any]) -> None:
    header["metric"][0]["joined"] = [3]


def _large(header: dict[str, Any], _: dict[str, Any]) -> None:
    header["parameters"]["tolerance_mm"] = 1e200


def _no_tolerance(header: dict[str, Any], _: dict[str, Any]) -> None:
    header["library"]["angle_tolerance_rad"] = 0.0


def _ratios(header: dict[str, Any], _: dict[str, Any]) -> None:
    header["library"]["types"][0]["ratios"].pop()


@pytest.mark.parametrize(
    ("spoil", "word"),
    [
        (_ratios, "a facet type with fewer than three angles"),
        (_without_metric, "the number of corners is not that of its views and parts"),
        (_other_part, "its views and its parts have different labels"),
        (_flat_facet, "solid: fewer than two facets, or one without three corners"),
        (_a_side_of_no_length, "a facet with two neighbouring corners at one place"),
        (_endless_type, "Expected `str` of length <= 200"),
        (_no_corners, "solid: corners, or their uncertainty, beyond"),
        (_below_nothing, "solid: a covariance that is not positive semi-definite"),
        (_fewer_slots, "cube: a view's pattern does not match its facets"),
        (_a_slot_twice, "cube: a view's pattern does not match its facets"),
        (_no_such_slot, "cube: a view's pattern does not match its facets"),
        (_no_such_side, "cube: a view's pattern does not match its facets"),
        (_node, "cube: a view's pattern does not match its facets"),
        (_no_such_node, "nodes: a relation of a node or slot that does not exist"),
        (_fewer_features, "nodes: expected 7 values of each relation"),
        (_ends_swapped, "nodes: a lower end above its upper end"),
        (_never_resonated, "nodes: 3, counts"),
        (_joined, "a view that does not exist"),
        (_large, "Expected `float` <= 1000"),
        (_no_tolerance, "Expected `float` > 1e-06"),
    ],
)
def test_what_its_checksum_fits_must_hold_together_as_well(
    spoil: Callable[[dict[str, Any], dict[str, Any]], None], word: str
) -> None:
    """Whoever writes one writes its checksum; each look with such a model ended in a fault of the program."""
    header, arrays = _parts()
    assert from_bytes(fitting(header, arrays)).model.labels == trained().labels
    spoil(header, arrays)
    with pytest.raises(ModelError, match=f"inconsistent: .*{word}"):
        from_bytes(fitting(header, arrays))


def test_a_source_whose_name_is_no_utf8_goes_into_a_model_and_comes_back_legible(tmp_path: Path) -> None:
    known = trained()
    odd = dataclasses.replace(known, views=tuple(dataclasses.replace(v, source="/x/b\udcff.obj") for v in known.views))
    folder = tmp_path / os.fsdecode(b"p\xff")
    folder.mkdir()
    save(odd, folder / "m.npz")
    assert {view.source for view in load(folder / "m.npz").views} == {"/x/b?.obj"}
