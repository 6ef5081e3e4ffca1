"""The section `signals`: what cannot be meant is one line with the key and what to do."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

from daemon.config import load_config
from daemon.store.folders import HOUSE
from daemon.store.yamlfile import ConfigError

START = {"number": 1003, "role": "cycle_start"}


def config_with(folder: Path, signals: Any, **sections: Any) -> Any:
    values = yaml.safe_load((HOUSE / "etc" / "facetd.yaml").read_text())
    values["files"] = {name: str(HOUSE / "etc" / file) for name, file in values["files"].items()}
    values |= {"signals": signals, "folders": {"state": str(folder)}, **sections}
    path = folder / "facetd.yaml"
    path.write_text(yaml.safe_dump(values))
    return load_config(path).values.signals


def test_a_signal_has_a_number_a_role_a_level_and_what_a_stop_makes_of_it(tmp_path: Path) -> None:
    found = config_with(tmp_path, {"start": START, "done": {"number": 2, "role": "part_done", "on_stop": "off"}})
    assert (found["start"].is_input, found["done"].is_input) == (True, False)
    assert (found["start"].level, found["done"].on_stop) == ("high", "off")


@pytest.mark.parametrize(
    ("signals", "words"),
    [
        ({"a": START, "b": {**START, "number": 1}}, r"signals\.a\.role: expected one signal with role cycle_start"),
        ({"a": START, "b": {"number": 1003, "role": "reset"}}, r"signals\.a\.number: expected its own number"),
        ({"a": {**START, "on_stop": "off"}}, r"signals\.a\.on_stop: expected no on_stop"),
        ({"a": {"number": 3, "role": "fault", "on_stop": "off"}}, r"signals\.a\.on_stop: expected no on_stop"),
        ({"a": {"number": 1001, "role": "permit_pick", "level": "low"}}, r"signals\.a\.level: expected high: a broken"),
        ({"a": {"number": 2, "role": "part_done"}}, r"signals\.a\.role: expected an input with the role cycle_start"),
        ({"a": {"number": 11, "role": "vacuum"}}, r"signals\.a\.role: expected a gripper with `kind: suction`"),
        (
            {"a": {"number": 12, "role": "blow_off"}},
            r"signals\.a\.role: expected an output with the role vacuum beside",
        ),
        ({"a": {"number": 0, "role": "reset"}}, r"signals\.a\.number: expected .* found 0"),
        ({"a": {"number": 1, "role": "brake"}}, r"signals\.a\.role: expected one of .* found 'brake'"),
    ],
)
def test_what_cannot_be_meant_is_refused_with_line_and_key(tmp_path: Path, signals: Any, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        config_with(tmp_path, signals)


def test_a_role_is_the_plc_s_or_an_input_s_and_part_done_may_wait_for_either(tmp_path: Path) -> None:
    done = {"done": {"number": 2, "role": "part_done"}}
    assert config_with(tmp_path, done, modbus={"roles": ["cycle_start"]})
    for signals, roles in (({"a": START}, ["cycle_start"]), ({}, ["reset", "reset"])):
        with pytest.raises(
            ConfigError, match=rf"modbus\.roles: expected {roles[0]} once, here or in the section signals"
        ):
            config_with(tmp_path, signals, modbus={"roles": roles})
    with pytest.raises(ConfigError, match=r"modbus\.roles.*part_held"):
        config_with(tmp_path, {}, modbus={"roles": ["part_held"]})
