"""Parts that recognition could not name, named by their edges where these prove it."""

from __future__ import annotations

import asyncio
from dataclasses import replace

from daemon.pick.following import eyes_of
from daemon.pick.looking import Look
from daemon.pick.seen import Seen, seen_parts
from daemon.pick.world import PickContext
from daemon.vision.registration.proving import Proved, proved

BY_EDGES = 0.9
"""Confidence in a name that edges proved: below what recognition is sure of, which is then picked first."""


async def named_parts(context: PickContext, look: Look) -> list[Seen]:
    """The parts of a look; those without a name get one from their edges, where these prove it."""
    seen, recogniser = seen_parts(look), context.recogniser
    if all(part.named for part in seen):
        return seen
    shapes = {n: shape for n in recogniser.labels if (shape := recogniser.shape(n)) is not None}

    def prove() -> list[Proved | None]:
        eyes = eyes_of(look, context.cell)
        return [None if part.named else proved(part.facets, shapes, eyes) for part in seen]

    found = await asyncio.to_thread(prove)
    return [part if proof is None else _by_edges(context, part, proof) for part, proof in zip(seen, found, strict=True)]


def _by_edges(context: PickContext, part: Seen, proof: Proved) -> Seen:
    why = f"{100 * proof.share:.0f} % of its outline lies where its facets say"
    context.decide(f"name {proof.label} by its edges", why)
    pose = part.look.world_from_cyclopean @ proof.cyclopean_from_part
    named = replace(part, label=proof.label, confidence=BY_EDGES, ambiguous=False, candidates=(proof.label,))
    return replace(named, reason=why, world_from_part=pose)
