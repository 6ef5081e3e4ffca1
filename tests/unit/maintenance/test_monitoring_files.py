"""The alert rules and the dashboard ask for metrics that facetd has."""

from __future__ import annotations

import importlib
import json
import re
import shutil
import subprocess
from pathlib import Path
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


def dashboard() -> dict[str, Any]:
    found: dict[str, Any] = json.loads((MONITORING / "grafana-dashboard.json").read_text())
    return found


def differences(ours: Any, theirs: Any, path: str = "") -> list[str]:
    """Where a value of ours is another one in theirs, or missing there."""
    if isinstance(ours, dict) and isinstance(theirs, dict):
        missing = [f"{path}/{key}" for key in ours.keys() - theirs.keys()]
        return missing + [line for key in ours.keys() & theirs.keys() for line in differences(
            ours[key], theirs[key], f"{path}/{key}"
        )]  # fmt: skip
    if isinstance(ours, list) and isinstance(theirs, list) and len(ours) == len(theirs):
        return [line for k, pair in enumerate(zip(ours, theirs, strict=True)) for line in differences(
            *pair, f"{path}/{k}"
        )]  # fmt: skip
    return [] if ours == theirs else [path]


def as_grafana_reads_it(found: dict[str, Any]) -> Any:
    """The dashboard through Grafana's own types, panels and queries too: they leave out what they do not know."""
    of = "grafana_foundation_sdk"
    models = pytest.importorskip(f"{of}.models.dashboard", reason="grafana-foundation-sdk is not installed")
    plugins, encoder = (importlib.import_module(f"{of}.cog.{name}") for name in ("plugins", "encoder"))
    plugins.register_default_plugins()
    return json.loads(encoder.JSONEncoder(sort_keys=True).encode(models.Dashboard.from_json(found)))


def test_grafana_knows_every_key_of_the_dashboard() -> None:
    found = dashboard()
    assert differences(found, as_grafana_reads_it(found)) == []
    found["panels"][0]["titel"] = found["panels"][0]["options"]["reduceOption"] = "planted"
    found["panels"][0]["targets"][0]["expression"] = "planted"
    assert sorted(differences(found, as_grafana_reads_it(found))) == [
        "/panels/0/options/reduceOption", "/panels/0/targets/0/expression", "/panels/0/titel",
    ]  # fmt: skip


@pytest.mark.skipif(shutil.which("promtool") is None, reason="promtool is not installed: Debian's package prometheus")
def test_every_panel_asks_in_prometheus_own_language(tmp_path: Path) -> None:
    asked = [target["expr"] for panel in dashboard()["panels"] for target in panel["targets"]]
    rules = [{"record": f"panel:{k}", "expr": expr.replace("$instance", ".*")} for k, expr in enumerate(asked)]
    file = tmp_path / "panels.yml"
    file.write_text(yaml.safe_dump({"groups": [{"name": "panels", "rules": rules}]}))
    subprocess.run(["promtool", "check", "rules", str(file)], check=True, timeout=60.0)


def test_the_dashboard_is_imported_as_a_new_one_and_each_panel_has_a_place_of_its_own() -> None:
    found = dashboard()
    assert "id" not in found, "of another server"
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
            assert 'instance=~"$instance"' in target["expr"], panel["title"]
