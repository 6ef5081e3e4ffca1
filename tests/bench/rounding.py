"""Makes the constants of daemon/vision/evidence/by_rounding.py again: where borders are at rounded corners.

Blocks with sharp corners and the same with rounded ones, in pictures of the simulated cell, from far and near; of each
corner where the two differ, at the true pose, where a camera has the border and where it should have it of either. The
seeds are none of `python -m tests.bench.thesis rounded`. `--dump` makes tests/data/corner_borders.csv anew.

usage: python -m tests.bench.rounding [--dump]
"""

from __future__ import annotations

import csv
import sys
from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np

from daemon.arrays import Array
from daemon.vision.evidence import by_rounding
from daemon.vision.evidence.by_rounding import APART, BorderSeen, borders_seen, nats_of
from daemon.vision.facets import facets_of_images
from daemon.vision.image import open_stereo
from daemon.vision.settings import VisionSettings
from tests.bench.simulated_looks import true_rig
from tests.fakes.holed import Holed, rounded_pair
from tests.fakes.photographed import cell, photograph

KEPT = Path(__file__).resolve().parents[1] / "data" / "corner_borders.csv"
SEEDS, RADII_MM = range(100, 112), (3.0, 6.0)
FAR_MM, NEAR_MM = (500.0, 560.0), (250.0, 280.0)


class Fit(NamedTuple):
    """The constants of the code, as it has them."""

    SPREAD_PX: float
    COMMON_PX: float
    MOST_NATS: float


class Look(NamedTuple):
    """The borders that one look has at corners that only one of two blocks has so: radius, seed, distance; which of
    the two lay there (0: sharp), and the borders, of which one_px is its own."""

    key: tuple[str, ...]
    borders: list[BorderSeen]


def main(arguments: list[str] | None = None) -> None:
    if "--dump" in (sys.argv[1:] if arguments is None else arguments):
        write(looks())
    print(verdict(read()))


def looks() -> Iterator[Look]:
    """Every block that lies there, once from far and once from near."""
    rig = true_rig(cell())
    for radius, seed, distance in product(RADII_MM, SEEDS, (FAR_MM, NEAR_MM)):
        pair = rounded_pair(radius, seed)
        for lies, part in enumerate(pair):
            shown = photograph(part.shape, np.random.default_rng([seed, lies]), distance_mm=distance)
            cameras = open_stereo(shown.left, shown.right, rig)
            facets_of_images(cameras, VisionSettings().coarse())  # which measures the blur of edges
            pose = shown.cyclopean_from_part @ _part_from_solid(part)
            seen = borders_seen(part.drawing.solid, pair[1 - lies].drawing.solid, np.eye(4), pose, cameras)
            yield Look((f"{radius:g}", str(seed), f"{distance[0]:g}", str(lies)), seen)


def _part_from_solid(one: Holed) -> Array:
    """Where the simulated cell's frame of a part has its solid."""
    assert one.shape.surface is not None
    shift = np.eye(4)
    shift[:3, 3] = (one.shape.surface.corners_mm - one.drawing.surface.corners_mm).mean(0)
    return shift


def write(found: Iterator[Look]) -> None:
    """The kept table made anew: a line a border."""
    every = list(found)
    with KEPT.open("w", newline="") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(["radius_mm", "seed", "from_mm", "lies", *BorderSeen._fields])
        for look in every:
            rows.writerows([*look.key, *(f"{value:.3f}" for value in one)] for one in look.borders)


def read() -> list[Look]:
    """The kept table."""
    found = dict[tuple[str, ...], list[BorderSeen]]()
    with KEPT.open(newline="") as file:
        for row in list(csv.reader(file))[1:]:
            found.setdefault(tuple(row[:4]), []).append(BorderSeen(*map(float, row[4:])))
    return [Look(*one) for one in found.items()]


def fitted(found: list[Look]) -> Fit:
    """SPREAD_PX: the spread of borders about the usual one of their look; COMMON_PX: of the usual ones; MOST_NATS: the
    log of how seldom a border is nearer to where the other part has it (Laplace's rule of succession)."""
    off = [np.array([b.seen_px - b.one_px for b in look.borders]) for look in found if len(look.borders) > 2]
    spread_px = 1.4826 * float(np.median(np.abs(np.concatenate([one - np.median(one) for one in off]))))
    common_px = 1.4826 * float(np.median([abs(np.median(one)) for one in off]))
    shares = np.array([b.share for look in found for b in look.borders])
    return Fit(spread_px, common_px, float(np.log((len(shares) + 2) / ((shares > 0.5).sum() + 1))))


def in_code() -> Fit:
    """The constants of the code."""
    return Fit(*(getattr(by_rounding, name) for name in Fit._fields))


def verdict(found: list[Look]) -> str:
    """The fitted constants beside the code's, and what the code's say of the looks."""
    fit, code = fitted(found), in_code()
    nats = np.array([nats_of(look.borders) for look in found])
    lines = [f"{len(found)} looks, {sum(len(look.borders) for look in found)} borders",
             f"for the part that lay there {(nats > APART).sum()}, for the other {(nats < -APART).sum()}, for neither "
             f"{(np.abs(nats) <= APART).sum()}",
             f"{'':<12}{'fitted':>8}{'in code':>9}"]  # fmt: skip
    lines += [f"{name:<12}{getattr(fit, name):>8.2f}{getattr(code, name):>9.2f}" for name in Fit._fields]
    return "\n".join(lines)


if __name__ == "__main__":
    main()
