"""The memory decides: on pictures, facets give no right name without it, nor with the labels of its nodes permuted."""

from __future__ import annotations

import pytest

from tests.bench.ablation import Named, ablated
from tests.fakes import rendered
from tests.fakes.ablated import four_drawn


@pytest.fixture(scope="module")
def rows() -> dict[str, Named]:
    return ablated(rendered.HERE, four_drawn())


def named_by_facets(row: Named) -> int:
    return sum(facets and name == label for label, name, facets in row.given.values())


def test_with_the_memory_facets_name_the_parts_of_the_kept_scenes(rows: dict[str, Named]) -> None:
    assert named_by_facets(rows["nothing"]) >= 6


@pytest.mark.parametrize("left_out", ["recall", "its labels"])
def test_without_what_the_memory_knows_facets_name_none_of_them(rows: dict[str, Named], left_out: str) -> None:
    assert named_by_facets(rows[left_out]) == 0
