"""Prometheus metrics on the loopback interface (extra `metrics`), off unless metrics.port is set."""

import contextlib
import socket
import threading
import time
from collections.abc import Iterator
from socketserver import ThreadingMixIn
from typing import Any
from wsgiref.simple_server import WSGIRequestHandler, WSGIServer, make_server

from daemon.events.outcomes import DEFINITION
from daemon.maintenance.troubles import WatchedDaemon
from daemon.signals.packml import PackMLState
from daemon.store.folders import how_to_add
from daemon.store.yamlfile import ConfigError

LOOPBACK = "127.0.0.1"
MOST_SCRAPES, SILENCE_S, LONGEST_S = 8, 5.0, 10.0
"""Most simultaneous scrapes; longest silence of one, and its longest duration."""


COUNTERS = {
    "tried": f"picks tried. {DEFINITION}",
    "picked": "picks tried that succeeded: the cameras confirmed the part in the gripper",
    "released": "picks tried whose part was released over the bin without confirmation",
    "failed": "picks tried without success",
    "aborted": "picks that a person ended; they do not count as tried",
}
"""Key in the status of the pick cycle -> meaning."""


class MetricsHandler(WSGIRequestHandler):
    timeout = SILENCE_S

    def log_message(self, *_: Any) -> None:
        """Scrapes are not logged."""


class MetricsHTTPServer(ThreadingMixIn, WSGIServer):
    """One thread a scrape, at most MOST_SCRAPES; further connections are closed."""

    daemon_threads = True

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._slots = threading.BoundedSemaphore(MOST_SCRAPES)
        self._began_s: dict[Any, float] = {}

    def service_actions(self) -> None:
        """Close connections that take too long; called twice a second."""
        for request, began_s in list(self._began_s.items()):
            if time.monotonic() - began_s > LONGEST_S:
                with contextlib.suppress(OSError):
                    request.shutdown(socket.SHUT_RDWR)

    def process_request(self, request: Any, client_address: Any) -> None:
        """Start an answer if a slot is free."""
        if self._slots.acquire(blocking=False):
            self._began_s[request] = time.monotonic()
            super().process_request(request, client_address)
        else:
            self.shutdown_request(request)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """Answer, then free the slot."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            del self._began_s[request]
            self._slots.release()

    def handle_error(self, *_: Any) -> None:
        """Broken and silent connections are not errors."""


class MetricsServer:
    """Answers scrapes on one port, in its own thread; reads values only."""

    def __init__(self, context: WatchedDaemon, port: int) -> None:
        self._context, self._port = context, port
        self._server: Any = None

    def open(self) -> None:
        """Listen. Raises ConfigError without the library, or where the port is in use."""
        try:
            from prometheus_client import CollectorRegistry, make_wsgi_app
        except ImportError:
            where = self._context.config.document
            raise where.error(("metrics", "port"), f"needs an extra: {how_to_add('metrics')}") from None
        registry = CollectorRegistry()
        registry.register(MetricsCollector(self._context))
        try:
            self._server = make_server(LOOPBACK, self._port, make_wsgi_app(registry), MetricsHTTPServer, MetricsHandler)
        except OSError as error:
            raise ConfigError(f"metrics.port: {self._port}: {error.strerror}") from None
        threading.Thread(target=self._server.serve_forever, name="metrics", daemon=True).start()

    def close(self) -> None:
        """Stop listening; safe to call twice."""
        if self._server is not None:
            self._server.shutdown()
            self._server.server_close()
            self._server = None


class MetricsCollector:
    def __init__(self, context: WatchedDaemon) -> None:
        self._context = context

    def collect(self) -> Iterator[Any]:
        """Every metric as it is now."""
        from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily

        context = self._context
        state = context.cycle.status()
        now = context.hardware.clock()
        for name, text in COUNTERS.items():
            yield CounterMetricFamily(f"facetd_{name}", text, value=float(state[name]))
        gauges = {
            "facetd_fault": ("1 while a fault is active", state["fault"] is not None),
            "facetd_enabled": ("1 while the arm may move", state["enabled"]),
            "facetd_busy": ("1 while a job is running", state["doing"] is not None),
            "facetd_troubles": ("active troubles", len(context.troubles.active)),
            "facetd_up_seconds": ("seconds since start", time.monotonic() - context.started_s),
            "facetd_camera_silence_seconds": ("since the last pair", _since(now, context.hardware.cameras.heard_s)),
            "facetd_controller_silence_seconds": ("since its last answer", _since(now, context.hardware.robot.heard_s)),
            "facetd_parts_taught": ("parts of the model in use", len(context.trainer.model.labels)),
        }
        packml = GaugeMetricFamily("facetd_packml_state", "1 at PackML's state of the cell", labels=["state"])
        for each in PackMLState:
            packml.add_metric([each.value], float(each == state["packml"]))
        yield packml
        for name, (text, value) in gauges.items():
            yield GaugeMetricFamily(name, text, value=float(value))


def _since(now: float, heard_s: float | None) -> float:
    return float("nan") if heard_s is None else now - heard_s
