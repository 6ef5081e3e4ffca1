"""Which of two parts laid at one place the images speak for: the edges that both have say nothing of it.

In: what both show, stretch by stretch. Out: nats. A part of which one face shows has few edges, all of them another
part's; a part with an edge more, which is there, is the likelier one, however much the others weigh in either.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from daemon.vision.registration.stretches import BESIDE_PX, Stretches

ALONG = np.cos(np.radians(12.0))  # an edge that lies on another one points so nearly the same way
PLACES = (np.arange(8) + 0.5) / 8


def by_own_edges(one: Sequence[Stretches], other: Sequence[Stretches]) -> float:
    """By how many nats the edges that only one has, in either eye, speak more for it than those that only the other has
    speak for that."""
    return sum(_alone(a, b) - _alone(b, a) for a, b in zip(one, other, strict=True))


def _alone(one: Stretches, other: Stretches) -> float:
    """Nats of the edges of one, as far as none of the other lies there."""
    edges, others = one.edges, other.edges
    way, along = (each.end - each.start for each in (edges, others))
    way_unit, unit = (each / np.linalg.norm(each, axis=1)[:, None] for each in (way, along))
    at = edges.start[:, None] + PLACES[:, None] * way[:, None]
    away = at[:, :, None] - others.start
    ahead, aside = (away * unit).sum(3), away[..., 0] * unit[:, 1] - away[..., 1] * unit[:, 0]
    on = (ahead > -BESIDE_PX) & (ahead < others.lengths_px + BESIDE_PX) & (np.abs(aside) < BESIDE_PX)
    shared = (on & (np.abs(way_unit @ unit.T) > ALONG)[:, None]).any(2).mean(1)
    return float((1 - shared) @ one.nats)
