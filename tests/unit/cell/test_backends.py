"""Kinds of cell that other distributions bring: the maintainer's guide's own example is installed, and used."""

from __future__ import annotations

import asyncio
import re
import time
from pathlib import Path

import numpy as np
import pytest

from daemon.arm import MoveCommand
from daemon.cell import sections
from daemon.cell.build import build, cameras_alone
from daemon.cell.no_arm import CellError
from daemon.commands import every_command
from daemon.config import Config, load_config
from daemon.store.yamlfile import ConfigError

CHECKOUT = Path(__file__).resolve().parents[3]
EXAMPLE = re.compile(r"```python\n( *\"\"\"A cell of two grey cards.*?)```", re.DOTALL)


def installed(folder: Path, entry: str) -> None:
    """A distribution with one entry point, as pip lays it."""
    described = folder / "facetd_cards-1.0.dist-info"
    described.mkdir()
    (described / "METADATA").write_text("Metadata-Version: 2.1\nName: facetd-cards\nVersion: 1.0\n")
    (described / "entry_points.txt").write_text(f"[facetd.cells]\ncards = {entry}\n")


@pytest.fixture
def cards(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    found = EXAMPLE.search((CHECKOUT / "docs/MAINTAIN.md").read_text(encoding="utf-8"))
    assert found is not None
    (tmp_path / "cards_cell.py").write_text("".join(re.sub(r"^   ", "", line) for line in found[1].splitlines(True)))
    installed(tmp_path, "cards_cell:BACKEND")
    monkeypatch.syspath_prepend(str(tmp_path))
    return tmp_path


def configured(folder: Path, lines: str) -> Config:
    etc = CHECKOUT / "etc"
    files = f"files: {{calibration: {etc}/calibration.yaml, facets: {etc}/facets.yaml, parts: {etc}/parts.yaml}}"
    (folder / "facetd.yaml").write_text(f"version: 1\n{lines}\n{files}\n")
    return load_config(folder / "facetd.yaml")


def test_the_guide_s_cell_is_found_checked_built_and_looks(cards: Path) -> None:
    config = configured(cards, "cell: cards\nbackend: {level: 90}")
    sections.check(config)
    assert not list(sections.out_of_reach(config))

    async def looks() -> tuple[str, int]:
        hardware = build(config, lambda _: None)
        await hardware.open()
        pair = await hardware.cameras.grab(time.monotonic(), 1.0)
        with pytest.raises(CellError):
            await hardware.robot.move(MoveCommand(np.eye(4), True, 10.0, "test"), print, 1.0)
        assert hardware.robot.controller is None
        await hardware.close()
        return hardware.kind, int(pair.left.pixels[3, 4])

    assert asyncio.run(looks()) == ("cards", 90)
    with cameras_alone(config) as camera:
        assert camera.describe() == "two grey cards of level 90"
    assert {one.name for one in every_command("cards")} == {one.name for one in every_command("real")}


def test_settings_of_a_back_end_are_checked_by_it_with_file_line_and_key(cards: Path) -> None:
    with pytest.raises(ConfigError, match=r"yaml:3: backend.level: expected a whole number from 0 to 255, found 999"):
        sections.check(configured(cards, "cell: cards\nbackend: {level: 999}"))


def test_a_cell_that_nobody_brings_is_told_with_those_that_are_there(cards: Path) -> None:
    with pytest.raises(
        ConfigError,
        match=r"facetd\.yaml:2: cell: expected one of real, linuxcnc, recorded, simulated, cards, found 'card'",
    ):
        sections.check(configured(cards, "cell: card"))


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ("cards_cell:BACKENDS", "cards_cell:BACKENDS cannot be loaded: "),
        ("nowhere_cell:BACKEND", "nowhere_cell:BACKEND cannot be loaded: No module named 'nowhere_cell'"),
        ("math:pi", "math:pi is no CellBackend of daemon/cell/backends.py"),
    ],
)
def test_a_back_end_that_is_none_is_told_in_a_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, entry: str, words: str
) -> None:
    (tmp_path / "cards_cell.py").touch()
    installed(tmp_path, entry)
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(ConfigError, match=words) as caught:
        sections.check(configured(tmp_path, "cell: cards"))
    assert "\n" not in str(caught.value)
