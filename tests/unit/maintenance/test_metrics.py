"""Metrics as Prometheus reads them over the loopback, and what is said without its library or its port."""

from __future__ import annotations

import contextlib
import math
import socket
import sys
import threading
import urllib.request
from types import SimpleNamespace
from typing import Any

import pytest

from daemon.maintenance.metrics import MOST_SCRAPES, MetricsServer
from daemon.store.yamlfile import ConfigError
from tests.fakes.waiting import until

pytest.importorskip("prometheus_client")


def watched(**state: Any) -> Any:
    """As much of a daemon as is measured."""
    known = {
        "tried": 15,
        "picked": 12,
        "released": 1,
        "failed": 3,
        "aborted": 2,
        "fault": None,
        "enabled": True,
        "doing": None,
        "packml": "Idle",
    } | state
    document = SimpleNamespace(error=lambda key, text: ConfigError(f"facetd.yaml: {'.'.join(key)}: {text}"))
    return SimpleNamespace(
        cycle=SimpleNamespace(status=lambda: known),
        hardware=SimpleNamespace(
            clock=lambda: 100.0, cameras=SimpleNamespace(heard_s=98.5), robot=SimpleNamespace(heard_s=None)
        ),
        troubles=SimpleNamespace(active={"disk": "full"}),
        trainer=SimpleNamespace(model=SimpleNamespace(labels=("cube", "pyramid"))),
        config=SimpleNamespace(document=document),
        started_s=0.0,
    )


@pytest.fixture
def port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        found: int = probe.getsockname()[1]
        return found


def scraped(context: Any, port: int) -> dict[str, float]:
    server = MetricsServer(context, port)
    server.open()
    try:
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics", timeout=5) as answer:
            lines = answer.read().decode().splitlines()
    finally:
        server.close()
        server.close()
    rows = (line.rsplit(" ", 1) for line in lines if not line.startswith("#"))
    return {name: float(value) for name, value in rows}


def test_a_scrape_says_what_status_says(port: int) -> None:
    found = scraped(watched(), port)
    assert [found[f"facetd_{name}_total"] for name in ("picked", "released", "failed")] == [12, 1, 3]
    assert (found["facetd_fault"], found["facetd_enabled"], found["facetd_busy"]) == (0, 1, 0)
    assert (found["facetd_troubles"], found["facetd_parts_taught"]) == (1, 2)
    assert found["facetd_up_seconds"] > 0
    states = ("Stopped", "Idle", "Execute", "Complete", "Aborted")
    assert [found[f'facetd_packml_state{{state="{each}"}}'] for each in states] == [0, 1, 0, 0, 0]


def test_silence_is_counted_from_what_was_heard_and_no_number_where_nothing_was(port: int) -> None:
    found = scraped(watched(), port)
    assert found["facetd_camera_silence_seconds"] == 1.5
    assert math.isnan(found["facetd_controller_silence_seconds"])


def test_a_fault_and_a_job_are_seen(port: int) -> None:
    found = scraped(watched(fault="stopped by ann", enabled=False, doing="pick"), port)
    assert (found["facetd_fault"], found["facetd_enabled"], found["facetd_busy"]) == (1, 0, 1)


def test_a_port_that_is_taken_is_one_line_with_its_key(port: int) -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", port))
        other.listen()
        with pytest.raises(ConfigError, match=rf"metrics\.port: {port}: Address already in use"):
            MetricsServer(watched(), port).open()


def test_without_the_library_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "prometheus_client", None)
    with pytest.raises(ConfigError, match=r"metrics\.port: needs an extra: make -C \S+ extra-metrics"):
        MetricsServer(watched(), 0).open()


def test_a_crowd_that_connects_and_says_nothing_takes_no_more_threads_than_there_is_room_for(port: int) -> None:
    server = MetricsServer(watched(), port)
    server.open()
    before = threading.active_count()
    idle = [socket.create_connection(("127.0.0.1", port), timeout=5) for _ in range(MOST_SCRAPES + 4)]
    try:
        hung_up = sum(one.recv(1) == b"" for one in idle[MOST_SCRAPES:])
        assert hung_up == len(idle) - MOST_SCRAPES
        assert threading.active_count() <= before + MOST_SCRAPES
    finally:
        for one in idle:
            one.close()
        server.close()


def test_who_says_a_byte_now_and_then_keeps_nobody_from_a_scrape_for_ever(
    port: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("daemon.maintenance.metrics.LONGEST_S", 1.0)
    server = MetricsServer(watched(), port)
    server.open()
    try:
        slow = [socket.create_connection(("127.0.0.1", port), 5) for _ in range(MOST_SCRAPES)]

        def scraped() -> bool:
            for one in slow:
                with contextlib.suppress(OSError):
                    one.send(b"G")
            with contextlib.suppress(OSError), urllib.request.urlopen(f"http://127.0.0.1:{port}", timeout=5) as answer:
                return bool(answer.status == 200)
            return False

        until(scraped, "an answer to a scrape")
        for one in slow:
            one.close()
    finally:
        server.close()
