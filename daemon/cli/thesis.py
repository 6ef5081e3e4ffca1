"""Command `facetctl thesis silhouettes`: the thesis's first experiment (section 4.1) on pictures of one's own."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from daemon.errors import DONE, FacetdError, spelt
from daemon.quantities import decimal, within


def register(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add `thesis` to facetctl."""
    thesis = subparsers.add_parser("thesis", help="experiments of the thesis on pictures of your own")
    experiments = thesis.add_subparsers(required=True, metavar="EXPERIMENT")
    silhouettes = experiments.add_parser(
        "silhouettes", help="ART 1 sorts outlines of dark objects on a light background (section 4.1)"
    )
    silhouettes.add_argument("pictures", type=Path, nargs="+", metavar="PICTURE", help="one object each, in this order")
    silhouettes.add_argument(
        "--vigilance", type=within(decimal, 0.0, 1.0), default=0.4, help="0 to 1 (default 0.4, as the thesis)"
    )
    silhouettes.add_argument("--show", action="store_true", help="print each pattern of 20 x 20 too")
    silhouettes.add_argument("--json", action="store_true", help="one line for machines")
    silhouettes.set_defaults(run=_silhouettes)


def _silhouettes(args: argparse.Namespace) -> int:
    """Raises FileError, FacetdError."""
    import numpy as np

    from daemon.art import ART1
    from daemon.store.pictures import read_grey
    from daemon.vision.image import VisionError
    from daemon.vision.thesis import silhouette

    patterns = []
    for path in args.pictures:
        try:
            patterns.append(silhouette(read_grey(path)))
        except VisionError as error:
            raise FacetdError(f"{spelt(str(path))}: {error}") from error
    nodes = ART1(rho=args.vigilance).learn(np.stack(patterns)).tolist()
    if args.json:
        print(json.dumps({"categories": [n + 1 for n in nodes]}))
        return DONE
    for path, pattern, node in zip(args.pictures, patterns, nodes, strict=True):
        print(f"category {node + 1}: {spelt(str(path))}")
        if args.show:
            print("\n".join("  " + "".join("#" if cell else " " for cell in row) for row in pattern.reshape(20, 20)))
    return DONE
