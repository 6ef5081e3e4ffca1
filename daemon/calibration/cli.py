"""`facetctl calibrate KIND`: the parser of its kinds."""

from __future__ import annotations

import argparse


def register(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add `calibrate` and its kinds to facetctl."""
    from daemon.calibration import board_pdf, interchange, quick, recorded

    parser = subparsers.add_parser(
        "calibrate",
        help="where the cameras are and how they see",
        epilog="With a running daemon: calibrate stereo|by-hand|hand-eye|verify|touch (`facetctl help calibrate`).",
    )
    kinds = parser.add_subparsers(dest="kind", required=True, metavar="KIND")
    board_pdf.register(kinds)
    recorded.register(kinds)
    quick.register(kinds)
    interchange.register(kinds)
