"""The dashboard's web server: loopback, GET only, with starlette and uvicorn (extra `dashboard`)."""

from __future__ import annotations

import asyncio
import contextlib
import json
from collections.abc import AsyncIterator
from importlib import resources
from pathlib import Path
from typing import Any

from daemon.dashboard.follow import RunFollower, follow_daemon
from daemon.dashboard.state import DashboardState
from daemon.errors import FacetdError
from daemon.review.space import arm_of
from daemon.store.folders import how_to_add, needing

LOOPBACK = "127.0.0.1"
SEND_S, ALIVE_S = 0.3, 10.0
"""Shortest period between updates to a viewer, and longest period between signs of life."""
PICTURE_S = 5.0
"""How long to wait for an image that a record names before its file is written."""
CONTENT_POLICY = "; ".join(
    (
        "default-src 'none'",
        *(f"{kind}-src 'self'" for kind in ("script", "style", "connect")),
        "img-src 'self' data:",
        "frame-ancestors 'none'",
    )
)


SPACE_POLICY = CONTENT_POLICY.replace("script-src 'self'", "script-src 'self' 'unsafe-eval'").replace(
    "style-src 'self'", "style-src 'self' 'unsafe-inline'"
)
"""For the 3-D page alone: plotly compiles its drawing code and sets styles in the page."""


def serve(port: int, socket_path: Path | None) -> None:
    """Serve until control-C. Raises FacetdError without the libraries, or where the port is in use."""
    with needing("dashboard", "the dashboard"):
        import uvicorn
    config = uvicorn.Config(
        app(socket_path), LOOPBACK, port, log_level="error", access_log=False, timeout_graceful_shutdown=1
    )
    with contextlib.suppress(KeyboardInterrupt):
        try:
            uvicorn.Server(config).run()
        except SystemExit:
            raise FacetdError(f"port {port} is not available; choose another with --port") from None


def app(socket_path: Path | None) -> Any:
    """The dashboard as an ASGI application. Raises FacetdError without the libraries."""
    with needing("dashboard", "the dashboard"):
        from starlette.applications import Starlette
        from starlette.middleware import Middleware
        from starlette.middleware.trustedhost import TrustedHostMiddleware
        from starlette.requests import Request
        from starlette.responses import Response, StreamingResponse
        from starlette.routing import Route
    now = DashboardState()
    run = RunFollower(now)

    @contextlib.asynccontextmanager
    async def lifespan(_: Any) -> AsyncIterator[None]:
        following = asyncio.create_task(follow_daemon(now, run, socket_path))
        yield
        following.cancel()

    def asset(content: str, kind: str, policy: str = CONTENT_POLICY) -> Any:
        async def answer(_: Request) -> Response:
            headers = {"Content-Security-Policy": policy, "Cache-Control": "no-cache"}
            return Response(content, media_type=kind, headers=headers)

        return answer

    async def events(_: Request) -> Response:
        return StreamingResponse(changes(now), media_type="text/event-stream", headers={"Cache-Control": "no-store"})

    async def picture(request: Request) -> Response:
        content = await picture_once_written(run, request.path_params["seq"], request.path_params["camera"])
        if content is None:
            return Response(status_code=404)
        return Response(content, media_type="image/png", headers={"Cache-Control": "no-store"})

    async def space(_: Request) -> Response:
        content = json.dumps(await space_now(now, run), default=str)
        return Response(content, media_type="application/json", headers={"Cache-Control": "no-store"})

    pages, review = resources.files("daemon.dashboard") / "assets", resources.files("daemon.review") / "assets"
    routes = [
        Route("/", asset((pages / "dashboard.html").read_text(), "text/html")),
        Route("/shared.js", asset((review / "shared.js").read_text(), "text/javascript")),
        Route("/dashboard.js", asset((pages / "dashboard.js").read_text(), "text/javascript")),
        Route("/space", asset((pages / "space.html").read_text(), "text/html", SPACE_POLICY)),
        Route("/space.js", asset((review / "space.js").read_text(), "text/javascript")),
        Route("/space-now.js", asset((pages / "space-now.js").read_text(), "text/javascript")),
        Route("/space.json", space),
        Route("/plotly.js", asset(plotly_js(), "text/javascript")),
        Route("/style.css", asset((review / "style.css").read_text(), "text/css")),
        Route("/events", events),
        Route("/picture/{seq:int}/{camera}", picture),
    ]
    hosts = Middleware(TrustedHostMiddleware, allowed_hosts=["localhost", LOOPBACK], www_redirect=False)
    return Starlette(routes=routes, lifespan=lifespan, middleware=[hosts])


def plotly_js() -> str:
    """The library that draws in 3-D; a line that asks for it where the extra `plots` is not installed."""
    try:
        from plotly.offline import get_plotlyjs
    except ImportError:
        missing = f"the 3-D view needs the library plotly: {how_to_add('plots')}; then start the dashboard again"
        return f"const missing = {json.dumps(missing)};\n"
    return str(get_plotlyjs())


async def space_now(now: DashboardState, run: RunFollower) -> dict[str, Any]:
    """What the 3-D page shows; trouble: why the arm is not drawn."""
    if run.folder is None:
        return now.space(None) | {"trouble": "No daemon answers yet."}
    arm, trouble = await asyncio.to_thread(arm_of, run.folder, now.start)
    try:
        return now.space(arm) | {"trouble": trouble}
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError):
        return DashboardState().space(None) | {"trouble": "The run was written by another version of facetd."}


async def picture_once_written(run: RunFollower, seq: int, camera: str) -> bytes | None:
    """Wait for an image of one of the last looks: a look's record comes before its files."""
    ends_s = asyncio.get_running_loop().time() + PICTURE_S
    while (content := run.picture(seq, camera)) is None:
        if not run.expects(seq, camera) or asyncio.get_running_loop().time() > ends_s:
            return None
        await asyncio.sleep(SEND_S)
    return content


async def changes(now: DashboardState) -> AsyncIterator[str]:
    """Server-Sent Events: the whole state after each change; comments in between detect a closed page."""
    sent, idle_s = -1, 0.0
    while True:
        if now.version != sent:
            sent, idle_s = now.version, 0.0
            yield f"data: {json.dumps(now.json(), default=str)}\n\n"
        elif idle_s >= ALIVE_S:
            idle_s = 0.0
            yield ": still here\n\n"
        await asyncio.sleep(SEND_S)
        idle_s += SEND_S
