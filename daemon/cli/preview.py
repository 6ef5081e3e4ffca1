"""Serve a live image over http on the loopback interface, to aim, focus and light the cameras.

One thread makes images, any number of browsers show the newest (MJPEG as multipart/x-mixed-replace). Nothing is stored,
and no command can be given.
"""

import http.server
import json
import threading
import time
from collections.abc import Callable
from importlib.resources import files
from typing import Any

Shot = tuple[bytes, dict[str, Any]]
"""A JPEG and its status."""


class Preview:
    """Serves the images that `shoot` makes. Where it raises one of `errors`, the page shows that text."""

    def __init__(self, shoot: Callable[[], Shot], port: int, fps: float, errors: tuple[type[Exception], ...]) -> None:
        self._shoot, self._period_s, self._errors = shoot, 1.0 / fps, errors
        self._fresh = threading.Condition()
        self._jpeg, self._number = b"", 0
        self.status: dict[str, Any] = {"text": "waiting for the cameras", "troubles": []}
        """Of the newest image, or why there is none."""
        self._ending = threading.Event()
        preview = self

        class Handler(PreviewHandler):
            source = preview

        self._server = http.server.ThreadingHTTPServer(("127.0.0.1", port), Handler)
        self._server.daemon_threads = True
        self._worker = threading.Thread(target=self._work, name="preview", daemon=True)

    @property
    def address(self) -> str:
        return f"http://127.0.0.1:{self._server.server_address[1]}/"

    def serve(self) -> None:
        """Serve until close() or an interrupt; afterwards no image is made any more."""
        self._worker.start()
        try:
            self._server.serve_forever(poll_interval=0.2)
        finally:
            self.close()
            self._worker.join()

    def close(self) -> None:
        """Stop; safe to call twice and from another thread."""
        if not self._ending.is_set():
            self._ending.set()
            with self._fresh:
                self._fresh.notify_all()
            threading.Thread(target=self._server.shutdown, daemon=True).start()
            self._server.server_close()

    def after(self, number: int, timeout_s: float = 5.0) -> tuple[int, bytes] | None:
        """Wait for an image newer than `number`; None at the end or on timeout."""
        with self._fresh:
            self._fresh.wait_for(lambda: self._number > number or self._ending.is_set(), timeout_s)
            return (self._number, self._jpeg) if self._number > number and not self._ending.is_set() else None

    def _work(self) -> None:
        while not self._ending.is_set():
            started_s = time.monotonic()
            try:
                jpeg, status = self._shoot()
            except self._errors as error:
                self.status = {"text": str(error), "troubles": [str(error)]}
                self._ending.wait(1.0)
                continue
            with self._fresh:
                self._jpeg, self.status, self._number = jpeg, status, self._number + 1
                self._fresh.notify_all()
            self._ending.wait(max(0.0, self._period_s - (time.monotonic() - started_s)))


class PreviewHandler(http.server.BaseHTTPRequestHandler):
    """One browser."""

    source: Preview
    timeout = 30.0

    def do_GET(self) -> None:
        """Serve the page, its stream, one image, or the status."""
        if self.headers.get("Host", "").rpartition(":")[0] not in ("127.0.0.1", "localhost"):
            self.send_error(403, "only for this machine")  # DNS rebinding: another site must not reach this server
        elif self.path == "/":
            self._answer("text/html; charset=utf-8", (files("daemon.cli") / "assets" / "preview.html").read_bytes())
        elif self.path == "/status.json":
            self._answer("application/json", json.dumps(self.source.status).encode())
        elif self.path == "/picture.jpg":
            shot = self.source.after(0)
            if shot:
                self._answer("image/jpeg", shot[1])
            else:
                self.send_error(503, "no picture yet")
        elif self.path == "/stream.mjpg":
            self._stream()
        else:
            self.send_error(404)

    def _answer(self, kind: str, body: bytes) -> None:
        self.send_response(200)
        for name, value in (("Content-Type", kind), ("Content-Length", str(len(body))), ("Cache-Control", "no-store")):
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(body)

    def _stream(self) -> None:
        self.send_response(200)
        self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=picture")
        self.send_header("Cache-Control", "no-store")
        self.end_headers()
        number = 0
        try:
            while shot := self.source.after(number):
                number, jpeg = shot
                head = f"--picture\r\nContent-Type: image/jpeg\r\nContent-Length: {len(jpeg)}\r\n\r\n"
                self.wfile.write(head.encode() + jpeg + b"\r\n")
        except OSError:
            pass  # the browser closed the connection

    def log_message(self, format: str, *args: Any) -> None:
        """Requests are not logged."""
