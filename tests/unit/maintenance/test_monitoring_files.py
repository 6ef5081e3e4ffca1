"""The alert rules and the dashboard ask for metrics that facetd has."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from typing import Any

import pytest
import yaml

from daemon.maintenance.metrics import COUNTERS
from daemon.store.folders import HOUSE

MONITORING = HOUSE / "deploy" / "monitoring"
RULES, TESTS = MONITORING / "prometheus-alerts.yml", MONITORING / "prometheus-alerts.test.yml"
SOURCE = (HOUSE / "daemon" / "maintenance" / "metrics.py").read_text()
KNOWN = {f"facetd_{name}_total" for name in COUNTERS} | set(re.findall(r"\bfacetd_[a-z_]+\b", SOURCE))


def expressions() -> list[str]:
    rules: Any = yaml.safe_load(RULES.read_text())
    panels = json.loads((MONITORING / "grafana-dashboard.json").read_text())["panels"]
    asked = [rule["expr"] for group in rules["groups"] for rule in group["rules"]]
    return asked + [target["expr"] for panel in panels for target in panel["targets"]]


def test_no_rule_and_no_panel_asks_for_a_metric_that_is_not_there() -> None:
    asked = {name for expression in expressions() for name in re.findall(r"\bfacetd_[a-z_]+\b", expression)}
    assert len(asked) > 8
    assert asked <= KNOWN


def test_every_alert_says_where_what_and_what_to_do() -> None:
    for group in yaml.safe_load(RULES.read_text())["groups"]:
        for rule in group["rules"]:
            assert "$labels.instance" in rule["annotations"]["summary"], rule["alert"]
            assert rule["annotations"]["action"], rule["alert"]


@pytest.mark.skipif(shutil.which("promtool") is None, reason="promtool is not installed: Debian's package prometheus")
def test_the_alerts_fire_as_planted() -> None:
    subprocess.run(["promtool", "test", "rules", TESTS.name], cwd=MONITORING, check=True, timeout=60.0)
