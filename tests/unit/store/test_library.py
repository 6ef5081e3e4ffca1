"""facets.yaml and parts.yaml: read as they are meant, and every fault is one line with file, line and key."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from daemon.store.library import FACETS, PARTS, Grasp, library_digest, load_facets, load_parts
from daemon.store.yamlfile import ConfigError


def broken(path: Path, source: Path, old: str, new: str) -> Path:
    text = source.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    return path


def says(words: str, text: str) -> bool:
    """Whether a message holds these words; a * stands for any."""
    return re.search(re.escape(words).replace(r"\ \*", ".*").replace(r"\*", ".*"), text) is not None


def test_the_house_s_own_facets_are_the_thesis_s_five() -> None:
    library = load_facets()
    assert [t.name for t in library.types] == [
        "square", "rectangle", "equilateral_triangle", "isosceles_triangle", "pentagon",
    ]  # fmt: skip
    assert library.types[0].angles_rad == pytest.approx((np.pi / 2,) * 4)
    assert library.types[1].ratios == ("a", "b", "a", "b")
    assert library.angle_tolerance_rad == pytest.approx(np.radians(0.5))


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("version: 1", "version: 2", "version: expected * 1, found 2"),
        ("type_number: 0.5", "type_number: 0.15", "facets[1].type_number: 0.15 is already that of square"),
        ("name: rectangle", "name: square", "facets[1].name: square is already that of square"),
        ("type_number: 0.75", "type_number: 0.86", "facets[4].type_number: expected * 0.85, found 0.86"),
        ("[1, 1, 1, 1]", "[1, 1, 1]", "facets[0].side_ratios: expected as many as angles and at least 3"),
        ("[1, 1, 1, 1]", "[1, 1, -1, 1]", "facets[0].side_ratios[2]: expected * 0*, found -1"),
        ("[90, 90, 90, 90]", "[90, 90, 90, 100]", "facets[0].angles_deg: expected a sum of 360 for 4 sides"),
        ("angle_deg: 0.5", "angel_deg: 0.5", "angel_deg"),
    ],
)
def test_a_facet_that_cannot_be_is_named_with_its_line_and_key(tmp_path, old, new, words) -> None:
    with pytest.raises(ConfigError) as told:
        load_facets(broken(tmp_path / "facets.yaml", FACETS, old, new))
    assert says(words, str(told.value))
    assert "facets.yaml" in str(told.value)
    assert "\n" not in str(told.value)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('code: "010"', 'code: "001"', "parts.pyramid.code: 001 is already that of cube"),
        ('code: "010"', 'code: "012"', "parts.pyramid.code: expected zeros and ones"),
        ('code: "010"', 'code: ""', "parts.pyramid.code: expected zeros and ones"),
        ("version: 1", "version: 7", "version: expected * 1, found 7"),
    ],
)
def test_a_part_that_cannot_be_is_named_with_its_key(tmp_path, old, new, words) -> None:
    with pytest.raises(ConfigError) as told:
        load_parts(broken(tmp_path / "parts.yaml", PARTS, old, new))
    assert says(words, str(told.value))


def test_a_library_s_digest_changes_with_what_it_says_and_with_nothing_else(tmp_path: Path) -> None:
    same = broken(tmp_path / "same.yaml", FACETS, "version: 1", "version: 1   # a remark")
    other = broken(tmp_path / "other.yaml", FACETS, "ratio: 0.01", "ratio: 0.02")
    assert library_digest(load_facets(same)) == library_digest(load_facets())
    assert library_digest(load_facets(other)) != library_digest(load_facets())


def test_a_part_whose_hints_are_commented_out_has_none(tmp_path: Path) -> None:
    (tmp_path / "parts.yaml").write_text('version: 1\nparts:\n  cube: {name: Cube, code: "001", grasp: }\n')
    assert load_parts(tmp_path / "parts.yaml")["cube"].grasp == Grasp()
