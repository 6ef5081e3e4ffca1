"""Every reader of files and every frontend, 20,000 hostile inputs: a value or a named error, never anything else.

`python -m tests.bench.long.hostile` goes on for a million, in children with little memory and a clock.
"""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.fakes.chosen import few
from tests.fakes.hostile import READERS, Reader, attack

FEW_SEEDS, SEEDS, INPUTS = 2, 12, 100


@pytest.mark.parametrize("seeds", few([FEW_SEEDS, SEEDS], 1))
@pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.name)
def test_whatever_is_read_gives_a_value_or_a_named_error(
    reader: Reader, seeds: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("hostile")

    @settings(max_examples=seeds, deadline=None)
    @given(st.integers(0, 2**32))
    def attacked(seed: int) -> None:
        assert [(content, repr(error)) for content, error in attack(reader, seed, INPUTS, folder)] == []

    attacked()


@pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.name)
def test_what_the_inputs_are_made_of_is_read(reader: Reader, tmp_path: Path) -> None:
    files = ("calibration.yaml", "facets.yaml", "parts.yaml")
    for name in files if reader.name == "configuration" else ():
        (tmp_path / name).touch()
    whole = [content for content in reader.valid() if not content.startswith(b"\x89PNG") or len(content) > 200]
    for content in whole:
        reader.read(content, tmp_path)
