"""`facetctl`: the operator's tool. Here: which module serves which command, and nothing of what they do."""

from __future__ import annotations

import argparse
import importlib
import sys

MODULES = ("daemon.offline",)


def main(arguments: list[str] | None = None) -> int:
    """Run one command; returns its exit status."""
    parser = argparse.ArgumentParser(prog="facetctl", description="Recognise parts, train models, talk to facetd.")
    subparsers = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name in MODULES:
        importlib.import_module(name).register(subparsers)
    args = parser.parse_args(arguments)
    status: int = args.run(args)
    return status


if __name__ == "__main__":
    sys.exit(main())
