"""Prometheus metrics on the loopback interface, through the well-kept client library; an extra, off unless asked."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

from daemon.config import ConfigError
from daemon.store.places import how_to_add
from daemon.upkeep.watched import Watched

LOOPBACK = "127.0.0.1"


class MetricsServer:
    """Answers scrapes on one port, in a thread of its own; reads values only."""

    def __init__(self, context: Watched, port: int) -> None:
        self._context, self._port = context, port
        self._server: Any = None

    def open(self) -> None:
        """Listen. Raises ConfigError without the library, OSError where the port is taken."""
        try:
            from prometheus_client import CollectorRegistry, start_http_server
        except ImportError:
            where = self._context.config.document
            raise where.error(("metrics", "port"), f"needs an extra: {how_to_add('metrics')}") from None
        registry = CollectorRegistry()
        registry.register(_Collector(self._context))
        try:
            self._server, _ = start_http_server(self._port, LOOPBACK, registry)
        except OSError as error:
            raise ConfigError(f"metrics.port: {self._port}: {error.strerror}") from None

    def close(self) -> None:
        """Stop listening; safe to call twice."""
        if self._server is not None:
            self._server.shutdown()
            self._server.server_close()
            self._server = None


class _Collector:
    def __init__(self, context: Watched) -> None:
        self._context = context

    def collect(self) -> Iterator[Any]:
        """Every metric as it is now."""
        from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily

        context = self._context
        state = context.cycle.status()
        now = context.hardware.clock()
        for name, key, text in (("picked", "picked", "parts picked"), ("failed", "failed", "picks that failed")):
            yield CounterMetricFamily(f"facetd_{name}", text, value=float(state[key]))  # type: ignore[arg-type]
        gauges = {
            "facetd_fault": ("1 while a fault stands", state["fault"] is not None),
            "facetd_enabled": ("1 while the arm may move", state["enabled"]),
            "facetd_busy": ("1 while something is being done", state["doing"] is not None),
            "facetd_troubles": ("troubles that stand", len(context.troubles.standing)),
            "facetd_up_seconds": ("seconds since start", time.monotonic() - context.started_s),
            "facetd_camera_silence_seconds": ("since the last pair", _since(now, context.hardware.eyes.heard_s)),
            "facetd_controller_silence_seconds": ("since its last answer", _since(now, context.hardware.robot.heard_s)),
            "facetd_parts_taught": ("labels the model in use knows", len(context.trainer.model.labels)),
        }
        for name, (text, value) in gauges.items():
            yield GaugeMetricFamily(name, text, value=float(value))  # type: ignore[arg-type]


def _since(now: float, heard_s: float | None) -> float:
    return float("nan") if heard_s is None else now - heard_s
