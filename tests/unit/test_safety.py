"""deploy/SAFETY.md names what is there: every file, every test; and its figures follow from what they are said to."""

from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path

import numpy as np

from daemon.arm import Limits
from daemon.store.folders import HOUSE
from drivers.puma560 import PUMA560
from drivers.simcell.arm import JOINT_ACCELERATION_RAD_S2, JOINT_SPEED_RAD_S, LINE_ACCELERATION_MM_S2, LINE_SPEED_MM_S

PAGE = (HOUSE / "deploy" / "SAFETY.md").read_text(encoding="utf-8")
TESTS = re.findall(r"`([\w/.]+\.py)::(\w+)`", PAGE)
FILES = sorted(set(re.findall(r"`((?:daemon|drivers|tests|deploy|etc)/[\w/.]+\.\w+)(?:::\w+)?`", PAGE)))


@cache
def named_in(file: Path) -> set[str]:
    """The names of the tests in a file."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    kinds = (ast.FunctionDef, ast.AsyncFunctionDef)
    return {node.name for node in ast.walk(tree) if isinstance(node, kinds) and node.name.startswith("test_")}


def test_every_test_it_names_exists() -> None:
    assert len(TESTS) > 200
    assert [f"{file}::{name}" for file, name in sorted(set(TESTS)) if name not in named_in(HOUSE / file)] == []


def test_every_file_it_names_exists() -> None:
    assert len(FILES) > 100
    assert [file for file in FILES if not (HOUSE / file).is_file()] == []


def test_every_hazard_says_what_prevents_it_and_which_test_shows_it() -> None:
    hazards = re.split(r"^### ", PAGE.partition("## The hazards")[2].partition("## Before")[0], flags=re.MULTILINE)
    listed, sections = hazards[0], hazards[1:]
    assert len(sections) > 15
    assert re.findall(r"\[(H\d+)\]", listed) == [section.partition(":")[0] for section in sections]
    for section in sections:
        title, _, text = section.partition("\n")
        assert re.search(r"^Causes: \S", text, re.MULTILINE), title
        measures, _, shown = text.partition("<details><summary>Tests")
        assert re.search(r"^- \S", measures, re.MULTILINE), title
        assert "(and W)" in shown.partition("\n")[0] or "::test_" in shown, title


def test_how_long_a_move_is_at_most_follows_from_limits_and_speeds() -> None:
    ranges = np.ptp(PUMA560.limits_rad, axis=1)
    longest_s = (ranges / JOINT_SPEED_RAD_S + JOINT_SPEED_RAD_S / JOINT_ACCELERATION_RAD_S2).max()
    assert f"| {longest_s:.1f} s at 100 %" in PAGE
    line_s = Limits().max_step_mm / LINE_SPEED_MM_S + LINE_SPEED_MM_S / LINE_ACCELERATION_MM_S2
    assert f"`pick.limits.max_step_mm` ({Limits().max_step_mm:g} mm)" in PAGE
    assert f"a line of {Limits().max_step_mm:g} mm at {LINE_SPEED_MM_S:g} mm/s takes {line_s:.2f} s" in PAGE


def test_the_worked_stop_distance_follows_from_its_figures() -> None:
    reach_mm, delay_s, line_s, brake_s = 900.0, 0.2, 0.01, 0.25
    assert brake_s == JOINT_SPEED_RAD_S[0] / JOINT_ACCELERATION_RAD_S2[0]
    speed = reach_mm * JOINT_SPEED_RAD_S[0]
    assert f"| speed of the tool: 82 degrees/s at 900 mm | {speed:.0f} mm/s | {0.3 * speed:.0f} mm/s |" in PAGE
    waits = [share * speed * (delay_s + line_s) for share in (1.0, 0.3)]
    brakes = [share * speed * share * brake_s / 2 for share in (1.0, 0.3)]
    assert f"0.210 s: {waits[0]:.0f} mm | 0.210 s: {waits[1]:.0f} mm |" in PAGE
    assert f"0.25 s: {brakes[0]:.0f} mm | 0.075 s: {brakes[1]:.0f} mm |" in PAGE
    whole = [f"**{wait + brake:.0f} mm**" for wait, brake in zip(waits, brakes, strict=True)]
    assert f"| **stop distance without the operator** | {whole[0]} | {whole[1]} |" in PAGE
