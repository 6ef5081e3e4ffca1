"""Command `facetctl dashboard`: serve the page on the loopback interface."""

from __future__ import annotations

import argparse
from pathlib import Path

from daemon.quantities import whole

PORT = 8642


def register(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add `dashboard` to facetctl."""
    parser = subparsers.add_parser("dashboard", help="a page for a browser here: what the daemon sees and does")
    parser.add_argument("--port", type=whole, default=PORT, help=f"on 127.0.0.1 ({PORT})")
    parser.add_argument("--socket", type=Path, help="the daemon's socket (the usual places)")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Serve until control-C. Raises FacetdError."""
    from daemon.dashboard.server import serve

    print(f"http://127.0.0.1:{args.port}/   (control-C ends it; nothing can be moved from the page)", flush=True)
    serve(args.port, args.socket)
    return 0
