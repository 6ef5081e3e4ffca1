"""The dashboard's server: loopback, GET alone, through starlette and uvicorn (extra `dashboard`)."""

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
from daemon.store.folders import how_to_add

LOOPBACK = "127.0.0.1"
SEND_S, ALIVE_S = 0.3, 10.0
"""How often a viewer is told what changed, at most; and that the server lives, at least."""
PICTURE_S = 5.0
"""A picture that was told of and is not there by then never will be."""
ONLY_OURS = "; ".join(
    (
        "default-src 'none'",
        *(f"{kind}-src 'self'" for kind in ("script", "style", "connect")),
        "img-src 'self' data:",
        "frame-ancestors 'none'",
    )
)


class DashboardError(FacetdError):
    """The page cannot be served; the message says why and what to do."""


def serve(port: int, socket_path: Path | None) -> None:
    """Serve until told to end. Raises DashboardError without the libraries or where the port is taken."""
    try:
        import uvicorn
    except ImportError:
        raise DashboardError(f"needs an extra: {how_to_add('dashboard')}") from None
    config = uvicorn.Config(
        app(socket_path), LOOPBACK, port, log_level="error", access_log=False, timeout_graceful_shutdown=1
    )
    with contextlib.suppress(KeyboardInterrupt):
        try:
            uvicorn.Server(config).run()
        except SystemExit:
            raise DashboardError(f"port {port} cannot be had; --port takes another") from None


def app(socket_path: Path | None) -> Any:
    """The page as an ASGI application. Raises DashboardError without the libraries."""
    try:
        from starlette.applications import Starlette
        from starlette.middleware import Middleware
        from starlette.middleware.trustedhost import TrustedHostMiddleware
        from starlette.requests import Request
        from starlette.responses import Response, StreamingResponse
        from starlette.routing import Route
    except ImportError:
        raise DashboardError(f"needs an extra: {how_to_add('dashboard')}") from None
    now = DashboardState()
    run = RunFollower(now)

    @contextlib.asynccontextmanager
    async def lifespan(_: Any) -> AsyncIterator[None]:
        following = asyncio.create_task(follow_daemon(now, run, socket_path))
        yield
        following.cancel()

    def asset(content: str, kind: str) -> Any:
        async def answer(_: Request) -> Response:
            headers = {"Content-Security-Policy": ONLY_OURS, "Cache-Control": "no-cache"}
            return Response(content, media_type=kind, headers=headers)

        return answer

    async def events(_: Request) -> Response:
        return StreamingResponse(changes(now), media_type="text/event-stream", headers={"Cache-Control": "no-store"})

    async def picture(request: Request) -> Response:
        content = await written(run, request.path_params["seq"], request.path_params["eye"])
        if content is None:
            return Response(status_code=404)
        return Response(content, media_type="image/png", headers={"Cache-Control": "no-store"})

    pages, review = resources.files("daemon.dashboard") / "assets", resources.files("daemon.review") / "assets"
    routes = [
        Route("/", asset((pages / "dashboard.html").read_text(), "text/html")),
        Route("/shared.js", asset((review / "shared.js").read_text(), "text/javascript")),
        Route("/dashboard.js", asset((pages / "dashboard.js").read_text(), "text/javascript")),
        Route("/style.css", asset((review / "style.css").read_text(), "text/css")),
        Route("/events", events),
        Route("/picture/{seq:int}/{eye}", picture),
    ]
    hosts = Middleware(TrustedHostMiddleware, allowed_hosts=["localhost", LOOPBACK], www_redirect=False)
    return Starlette(routes=routes, lifespan=lifespan, middleware=[hosts])


async def written(run: RunFollower, seq: int, eye: str) -> bytes | None:
    """One of the last looks' pictures. A look is told of before they are on the disk: they are waited for."""
    ends_s = asyncio.get_running_loop().time() + PICTURE_S
    while (content := run.picture(seq, eye)) is None:
        if not run.told_of(seq, eye) or asyncio.get_running_loop().time() > ends_s:
            return None
        await asyncio.sleep(SEND_S)
    return content


async def changes(now: DashboardState) -> AsyncIterator[str]:
    """Server-Sent Events: everything as it is now, again when it has changed; a comment now and then, so that a viewer
    who is gone is noticed."""
    told, quiet_s = -1, 0.0
    while True:
        if now.version != told:
            told, quiet_s = now.version, 0.0
            yield f"data: {json.dumps(now.json(), default=str)}\n\n"
        elif quiet_s >= ALIVE_S:
            quiet_s = 0.0
            yield ": still here\n\n"
        await asyncio.sleep(SEND_S)
        quiet_s += SEND_S
