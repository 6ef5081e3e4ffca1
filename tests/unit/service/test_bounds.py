"""No number of the configuration can switch a safety rule off: nan and infinity are refused, bounds are held to."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import pytest

from daemon.cell import sections
from daemon.config import ConfigError, load_config
from daemon.pick.settings import Settings
from daemon.store.bounds import BOUNDS, DIALECT_BOUNDS

ETC = Path(__file__).resolve().parents[3] / "etc"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("facetd.yaml", "calibration.yaml", "facets.yaml", "parts.yaml", "simcell.yaml"):
        shutil.copy(ETC / name, tmp_path)
    return tmp_path


def told(folder: Path, text: str) -> str:
    (folder / "facetd.yaml").write_text(text)
    with pytest.raises(ConfigError) as error:
        sections.check(load_config(folder / "facetd.yaml"))
    assert "\n" not in str(error.value)
    return str(error.value)


@pytest.mark.parametrize("bad", [".nan", ".inf", "-.inf"])
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
    assert tried > 60


@pytest.mark.parametrize("name", BOUNDS)
def test_each_bound_refuses_what_lies_beyond_it_and_takes_what_lies_on_it(folder: Path, name: str) -> None:
    *sections, key = name.split(".")
    low, high = BOUNDS[name]
    opening = "".join(f"{section}: {{" for section in sections[:1]) + "".join(f"{s}: {{" for s in sections[1:])
    for value in (low - 1, high + 1):
        answer = told(folder, f"version: 1\n{opening}{key}: {value:g}{'}' * len(sections)}\n")
        assert answer.startswith(f"{folder}/facetd.yaml:2: {name}: expected"), answer


@pytest.mark.parametrize("name", DIALECT_BOUNDS)
def test_so_do_those_of_the_controllers_dialect(folder: Path, name: str) -> None:
    for value in (DIALECT_BOUNDS[name][0] - 1, DIALECT_BOUNDS[name][1] + 1):
        answer = told(folder, f"version: 1\narm: {{dialect: {{{name}: {value:.10g}}}}}\n")
        assert answer.startswith(f"{folder}/facetd.yaml:2: arm.dialect.{name}: expected"), answer


@pytest.mark.parametrize(
    ("pick", "want"),
    [
        ("stops: {stand_offs_mm: []}", "stand_offs_mm: expected distances, far to near, found []"),
        ("stops: {stand_offs_mm: [200, 300]}", "far to near, found [200.0, 300.0]"),
        ("stops: {stand_offs_mm: [300, -5]}", "stand_offs_mm[1]: expected above 0 to 5000, found -5"),
        ("stops: {least_looks: 4, most_looks: 3}", "expected at least as many looks, found 3, less than"),
        ("surveys: []", "surveys: expected at least one place"),
        ("limits: {box_low_mm: [9000, 0, 0]}", "expected x below box_high_mm's 900, found 9000"),
    ],
)
def test_what_would_leave_a_pick_without_a_way_is_refused(folder: Path, pick: str, want: str) -> None:
    assert want in told(folder, f"version: 1\npick: {{{pick}}}\n")


def test_the_bounds_are_of_keys_that_exist_and_the_defaults_lie_within() -> None:
    known = dict(numbers(Settings(), "pick"))
    for name, (low, high) in BOUNDS.items():
        assert low <= known[name] <= high, name
    unbound = {name for name in known if name.split(".")[1] in ("stops", "arrival", "limits")} - set(BOUNDS)
    assert unbound == {"pick.limits.table_z_mm"}, "a new limit needs a bound"


def numbers(value: Any, name: str) -> Iterator[tuple[str, float]]:
    for field in fields(value):
        inner, key = getattr(value, field.name), f"{name}.{field.name}"
        if is_dataclass(inner):
            yield from numbers(inner, key)
        elif isinstance(inner, int | float):
            yield key, inner
