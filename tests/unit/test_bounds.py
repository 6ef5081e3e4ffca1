"""Every key of facetd.yaml has two ends: what lies outside, nan and infinity among it, is refused with its line."""

from __future__ import annotations

import dataclasses
import functools
import json
import math
import re
import shutil
import typing
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest
import yaml

from daemon.cell import sections
from daemon.cell.linuxcnc_arm import LinuxcncSettings
from daemon.config import OBSOLETE, ConfigFile, load_config
from daemon.store.yamlfile import UNIONS, ConfigError, Key, dotted
from drivers.camera.settings import CameraSettings
from drivers.val2.dialect import Dialect
from tests.fakes.chosen import few

ETC = Path(__file__).resolve().parents[2] / "etc"
Keys = tuple[Key, ...]
TYPED_BY_DRIVERS: dict[Keys, type] = {
    ("cameras",): CameraSettings,
    ("arm", "dialect"): Dialect,
    ("backend",): LinuxcncSettings,
}


@dataclasses.dataclass(frozen=True)
class Leaf:
    """One value of the file: where it is, its type and its ends."""

    keys: Keys
    kind: type
    low: float | None = None
    above: float | None = None
    high: float | None = None

    @property
    def name(self) -> str:
        """pick.stops.stand_offs_mm[0]."""
        return dotted(self.keys)

    @property
    def least(self) -> float:
        """The least value that is taken."""
        return self.low if self.low is not None else math.nextafter(self.above or 0.0, math.inf)


def leaves(kind: Any, keys: Keys) -> Iterator[Leaf]:
    """Every value below a type; of a list its first."""
    kind = TYPED_BY_DRIVERS.get(keys, kind)
    kinds = typing.get_args(kind)
    if dataclasses.is_dataclass(kind):
        for name, inner in typing.get_type_hints(kind, include_extras=True).items():
            yield from leaves(inner, (*keys, name))
    elif typing.get_origin(kind) in UNIONS:
        for option in kinds:
            yield from () if option is type(None) else leaves(option, keys)
    elif tuple in (typing.get_origin(kind), typing.get_origin(kinds[0]) if kinds else None):
        yield from leaves(kinds[0], (*keys, 0) if typing.get_origin(kind) is tuple else keys)
    else:
        meta = kinds[1] if typing.get_origin(kind) is typing.Annotated else None
        ends = (meta.ge, meta.gt, meta.le) if meta is not None else ()
        yield Leaf(keys, kinds[0] if meta is not None else kind, *ends)


ALL = [leaf for leaf in leaves(ConfigFile, ()) if leaf.name.partition("[")[0] not in OBSOLETE]
NUMBERS = [leaf for leaf in ALL if leaf.kind in (int, float)]
NAMES = [leaf for leaf in ALL if leaf.kind is str and leaf.name != "cameras.formats[0]"]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("facetd.yaml", "calibration.yaml", "facets.yaml", "parts.yaml", "simcell.yaml"):
        shutil.copy(ETC / name, tmp_path)
    return tmp_path


def read(folder: Path, text: str) -> None:
    (folder / "facetd.yaml").write_text(text)
    sections.check(load_config(folder / "facetd.yaml"))


def trouble(folder: Path, text: str) -> str:
    try:
        read(folder, text)
    except ConfigError as error:
        return str(error)
    return ""


def told(folder: Path, text: str) -> str:
    with pytest.raises(ConfigError) as error:
        read(folder, text)
    assert "\n" not in str(error.value)
    return str(error.value)


def file_with(leaf: Leaf, value: str) -> tuple[str, int]:
    """A facetd.yaml with this value and all others of its section as they are by default, and the line it is in."""
    text, number = marked_file(leaf)
    return text.replace(MARK, value), number


@functools.cache
def marked_file(leaf: Leaf) -> tuple[str, int]:
    """The same with MARK in place of the value."""
    data: Any = json.loads(msgspec.json.encode(ConfigFile(version=1)))
    data["cameras"] = json.loads(msgspec.json.encode(CameraSettings("a", "b")))
    data["arm"]["dialect"] = data["modbus"] = {}
    data["backend"] = json.loads(msgspec.json.encode(LinuxcncSettings()))
    data["console"]["tty"] = {"device": "d"}
    data["vision"]["depth_readings_mm"] = [[600.0, 1.0]]
    data["pick"]["limits"]["keep_out"] = [{"name": "a post", "low_mm": [0, 0, 0], "high_mm": [1, 1, 1]}]
    for name in OBSOLETE:
        *above, key = name.split(".")
        section = data
        for part in above:
            section = section[part]
        section.pop(key, None)
    data["cell"] = "linuxcnc" if leaf.keys[0] == "backend" else "real"
    data = {key: data[key] for key in ("version", "cell", "cameras", leaf.keys[0])}
    place: Any = data
    for step in leaf.keys[:-1]:
        if isinstance(step, str) and step not in place:
            place[step] = [0.0] * 6
        place = place[step]
    place[leaf.keys[-1]] = MARK
    text = yaml.dump(data, Dumper=yaml.CSafeDumper)
    return text, next(number for number, line in enumerate(text.splitlines(), 1) if MARK in line)


MARK = "the_value_to_be_tried"


def test_every_number_has_two_ends() -> None:
    assert len(ALL) > 120
    assert len(NUMBERS) > 85
    for leaf in NUMBERS:
        assert leaf.low is not None or leaf.above is not None, leaf.name
        assert leaf.high is not None, leaf.name
        assert math.isfinite(leaf.least), leaf.name


@pytest.mark.parametrize("leaf", NUMBERS, ids=lambda leaf: leaf.name)
def test_a_value_outside_its_ends_is_refused_with_its_line_and_one_on_them_is_not(folder: Path, leaf: Leaf) -> None:
    assert leaf.high is not None
    low = leaf.above if leaf.low is None else leaf.low
    assert low is not None
    if leaf.kind is int:
        outside = [low - 1, leaf.high + 1]
    else:
        below = low if leaf.low is None else math.nextafter(low, -math.inf)
        outside = [below, math.nextafter(leaf.high, math.inf), math.nan, math.inf, -math.inf]
    for value in outside:
        text, line = file_with(leaf, as_yaml(leaf.kind(value)))
        answer = told(folder, text)
        assert answer.startswith(f"{folder}/facetd.yaml:{line}: {leaf.name}: expected "), (value, answer)
        assert re.search(r"(from|above) \S+ to \S+, found ", answer), answer
    for end in (leaf.least, leaf.high):
        text, _ = file_with(leaf, as_yaml(leaf.kind(end)))
        assert not re.search(r"(from|above) \S+ to ", trouble(folder, text))  # other keys may be contradicted


def as_yaml(number: float) -> str:
    """A number as YAML writes it (1e-09 would be a word)."""
    text: str = yaml.safe_dump(number)
    return text.partition("\n")[0]


@pytest.mark.parametrize("leaf", NAMES, ids=lambda leaf: leaf.name)
def test_no_name_is_empty(folder: Path, leaf: Leaf) -> None:
    text, line = file_with(leaf, "''")
    assert told(folder, text).startswith(f"{folder}/facetd.yaml:{line}: {leaf.name}: expected")


@pytest.mark.parametrize("bad", few([".nan", ".inf", "-.inf"], 1))
def test_any_number_of_the_shipped_file_that_is_none_is_refused_by_line(folder: Path, bad: str) -> None:
    lines = (ETC / "facetd.yaml").read_text().splitlines()
    tried = 0
    for number, line in enumerate(lines):
        said = line.split("#")[0]
        for found in re.finditer(r"(?<=[ \[])-?\d+(\.\d+)?(?=[,\]}\s]|$)", said):
            changed = said[: found.start()] + bad + said[found.end() :]
            text = "\n".join([*lines[:number], changed, *lines[number + 1 :]])
            answer = told(folder, text)
            assert answer.startswith(f"{folder}/facetd.yaml:{number + 1}:"), (line, answer)
            tried += 1
    assert tried >= 60


@pytest.mark.parametrize(
    ("section", "want"),
    [
        ("pick: {stops: {stand_offs_mm: []}}", "stand_offs_mm: expected a list of length >= 1, found []"),
        ("pick: {stops: {stand_offs_mm: [200, 300]}}", "far to near, found [200.0, 300.0]"),
        ("pick: {stops: {stand_offs_mm: [300, -5]}}", "stand_offs_mm[1]: expected above 0 to 5000, found -5"),
        ("pick: {stops: {least_looks: 4, most_looks: 3}}", "expected at least as many looks, found 3, less than"),
        ("pick: {surveys: []}", "surveys: expected a list of length >= 1, found []"),
        ("pick: {limits: {box_low_mm: [4000, 0, 0]}}", "expected x below box_high_mm's 900, found 4000"),
        ("vision: {depth_range_mm: [300, 200]}", "depth_range_mm: expected the near end first, found 300 and 200"),
        ("vision: {min_side_px: -5}", ":2: vision.min_side_px: expected above 0 to 100, found -5"),
    ],
)
def test_what_would_leave_a_pick_without_a_way_is_refused(folder: Path, section: str, want: str) -> None:
    assert want in told(folder, f"version: 1\n{section}\n")


@pytest.mark.parametrize("name", OBSOLETE)
def test_a_key_that_is_gone_is_passed_over_and_told_with_its_line(folder: Path, name: str) -> None:
    *above, key = name.split(".")
    opening = "".join(f"{section}: {{" for section in above)
    (folder / "facetd.yaml").write_text(f"version: 1\n{opening}{key}: anything{'}' * len(above)}\n")
    config = load_config(folder / "facetd.yaml")
    (note,) = config.notes
    assert note.startswith(f"{folder}/facetd.yaml:2: {name}: no longer a key")
    assert "delete the line" in note
    (folder / "facetd.yaml").write_text("version: 1\n")
    assert config.values == load_config(folder / "facetd.yaml").values
