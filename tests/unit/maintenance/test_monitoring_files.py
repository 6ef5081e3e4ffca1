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


CORE_PANELS = {"stat", "timeseries", "state-timeline", "table", "gauge", "bargauge", "barchart", "text", "row"}
UNITS = {"none", "short", "percent", "percentunit", "s", "ms", "dtdurations", "celsius", "lengthmm"}
COLUMNS = 24
OF_GRAFANA = {"__rate_interval", "__interval", "__range"}
TYPES = {
    "title": str, "uid": str, "schemaVersion": int, "version": int, "tags": list, "timezone": str, "refresh": str,
    "time": dict, "templating": dict, "panels": list,
}  # fmt: skip
"""Of Grafana's dashboard schema: the keys that this dashboard has."""


def dashboard() -> dict[str, Any]:
    found: dict[str, Any] = json.loads((MONITORING / "grafana-dashboard.json").read_text())
    return found


def test_the_dashboard_is_as_grafanas_schema_has_it() -> None:
    """Keys and their types, an import without an id of another server, a place of its own for each panel."""
    found = dashboard()
    assert {key: type(value) for key, value in found.items()} == TYPES
    assert "id" not in found
    assert len(found["uid"]) <= 40
    assert found["schemaVersion"] >= 36, "from 36 on a datasource is {type, uid}"
    assert found["timezone"] in ("browser", "utc", "")
    assert re.fullmatch(r"\d+[smh]", found["refresh"])
    panels = found["panels"]
    assert len({panel["id"] for panel in panels}) == len(panels)
    taken: set[tuple[int, int]] = set()
    for panel in panels:
        assert panel["type"] in CORE_PANELS, panel["title"]
        at = panel["gridPos"]
        assert set(at) == {"x", "y", "w", "h"}
        cells = {(x, y) for x in range(at["x"], at["x"] + at["w"]) for y in range(at["y"], at["y"] + at["h"])}
        assert cells, panel["title"]
        assert at["x"] + at["w"] <= COLUMNS, panel["title"]
        assert not cells & taken, panel["title"]
        taken |= cells
        assert panel["fieldConfig"]["defaults"]["unit"] in UNITS
        assert isinstance(panel["fieldConfig"]["overrides"], list)


def test_each_panel_asks_the_chosen_server_and_every_variable_is_defined() -> None:
    found = dashboard()
    variables = {entry["name"]: entry for entry in found["templating"]["list"]}
    assert variables["datasource"]["type"] == "datasource"
    assert variables["datasource"]["query"] == "prometheus"
    for entry in variables.values():
        if entry["type"] == "query":
            assert entry["datasource"] == {"type": "prometheus", "uid": "${datasource}"}
            assert entry["refresh"] in (1, 2), "asked when the page opens, or when its time changes"
    for panel in found["panels"]:
        assert panel["datasource"] == {"type": "prometheus", "uid": "${datasource}"}
        targets = panel["targets"]
        assert len({target["refId"] for target in targets}) == len(targets) > 0
        for target in targets:
            used = set(re.findall(r"\$\{?(\w+)\}?", target["expr"] + target["legendFormat"]))
            assert used <= {*variables, *OF_GRAFANA}, panel["title"]
            assert target["expr"].count("(") == target["expr"].count(")")
            assert 'instance=~"$instance"' in target["expr"], panel["title"]
