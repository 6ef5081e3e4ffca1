"""Where a look's time goes: processor ms, Python calls and MiB of new memory by stage, on scenes of ordinary light.

usage: python -m tests.bench.stages

A stage is what runs under one of its functions, and under none of another's that was called from there. Time is
sampled by a timer of the processor's time, which costs the look nothing; calls and memory are counted in a round of
their own, memory as the growth of its peak from one call to the next: a lower bound of what was made.
"""

from __future__ import annotations

import signal
import sys
import time
import tracemalloc
from collections import Counter
from collections.abc import Callable
from functools import partial
from types import CodeType, FrameType
from typing import Any

import cv2
import numpy as np

from daemon.main import tame_malloc
from daemon.vision.evidence import named_by_edges, without_overlaps
from daemon.vision.facets import merge_vertices
from daemon.vision.facets.one_look import candidates, corner_adjustment, reconstruct
from daemon.vision.image import stereo_images
from daemon.vision.look import look
from daemon.vision.recognition import recognise_groups
from daemon.vision.refine import refined_parts
from tests.bench.recognise import test_folders, trained
from tests.fakes import rendered

SETS = ("clean", "shadow", "textured", "multi")
EVERY_S, ROUNDS = 0.001, 5
EYE = stereo_images.CameraImage
BEGINNINGS: dict[str, tuple[Any, ...]] = {
    "pixels": (stereo_images.open_stereo, EYE.noise, EYE.unit, EYE.smooth, EYE.scale, EYE.exposure, EYE.closed_regions),
    "outlines": (stereo_images.outlines_near, EYE.rough),
    "corners": (stereo_images.fitted_outlines,),
    "matching": (candidates.in_both, candidates.match_polygons, candidates.candidates, candidates.choose),
    "welding": (merge_vertices, corner_adjustment.adjust_corners),
    "facets, rest": (
        reconstruct.facets_of_images,
        reconstruct.with_single_camera_outlines,
    ),
    "naming": (recognise_groups,),
    "edges": (named_by_edges, without_overlaps),
    "sharpening": (refined_parts,),
    "rest": (look,),
}


def main() -> None:
    if not rendered.ALL.is_dir():
        print(f"no scenes at {rendered.ALL}: set FACETD_SHARED to the folder that holds scenes/")
        return
    cv2.setNumThreads(1)
    tame_malloc()  # as the daemon does: fresh memory costs a look up to a seventh of its time
    rig = rendered.rig(rendered.ALL, "B")
    model = trained(rig)
    folders = [f for f in test_folders(rendered.ALL) if f.name.startswith(tuple(f"{name}-B" for name in SETS))]
    pairs = [rendered.pair(f) for f in folders]
    looks = [partial(look, left, right, rig, model) for left, right in pairs]
    for name in SETS:
        table([one for one, folder in zip(looks, folders, strict=True) if folder.name.startswith(name)], name)


def table(looks: list[Callable[[], object]], name: str) -> None:
    """Print one set's stages, each by its mean over the looks, and the looks' median and 95 %."""
    for one in looks:
        one()
    codes = {_code(function): stage for stage, own in BEGINNINGS.items() for function in own}
    sampled, spent = _sampled(looks, codes)
    calls, made = _counted(looks, codes)
    mean_ms = 1000 * float(np.mean(spent))
    print(f"\n{name + ', ' + str(len(looks)) + ' looks':<24}{'ms':>8}{'share':>8}{'calls':>8}{'MiB':>8}")
    for stage in BEGINNINGS:
        share = sampled[stage] / max(sampled.total(), 1)
        print(
            f"{stage:<24}{share * mean_ms:>8.2f}{share:>8.0%}{calls[stage] / len(looks):>8.0f}"
            f"{made[stage] / len(looks) / 2**20:>8.2f}"
        )
    print(f"{'all, mean':<24}{mean_ms:>8.2f}{'':>8}{calls.total() / len(looks):>8.0f}"
          f"{made.total() / len(looks) / 2**20:>8.2f}")  # fmt: skip
    print(f"{'median, 95 %':<24}" + "".join(f"{1000 * np.percentile(spent, p):>8.2f}" for p in (50, 95)))


def _code(function: Any) -> CodeType:
    """Of a function, a property or a cached property."""
    plain = getattr(function, "func", None) or getattr(function, "fget", None) or function
    code: CodeType = plain.__code__
    return code


def _stage(frame: FrameType | None, codes: dict[CodeType, str]) -> str | None:
    """The innermost stage that a frame runs under; None outside a look."""
    while frame is not None:
        if frame.f_code in codes:
            return codes[frame.f_code]
        frame = frame.f_back
    return None


def _sampled(looks: list[Callable[[], object]], codes: dict[CodeType, str]) -> tuple[Counter[str], list[float]]:
    """How often each stage was met by the timer; seconds of processor each look took at best."""
    met = Counter[str]()

    def sample(_signal: int, frame: FrameType | None) -> None:
        stage = _stage(frame, codes)
        if stage:
            met[stage] += 1

    spent = np.full((ROUNDS, len(looks)), np.inf)
    before = signal.signal(signal.SIGPROF, sample)
    signal.setitimer(signal.ITIMER_PROF, EVERY_S, EVERY_S)
    try:
        for turn in range(ROUNDS):
            for k, one in enumerate(looks):
                start = time.process_time()
                one()
                spent[turn, k] = time.process_time() - start
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)
    return met, spent.min(0).tolist()


def _counted(looks: list[Callable[[], object]], codes: dict[CodeType, str]) -> tuple[Counter[str], Counter[str]]:
    """Python calls and bytes made, by stage, in one round of all looks."""
    calls, made, last = Counter[str](), Counter[str](), 0

    def count(frame: FrameType, event: str, _argument: object) -> None:
        nonlocal last
        now, peak = tracemalloc.get_traced_memory()
        stage = _stage(frame, codes)
        if stage:
            made[stage] += max(peak - last, 0)
            calls[stage] += event == "call"
        tracemalloc.reset_peak()
        last = now

    tracemalloc.start()
    try:
        for one in looks:
            last = tracemalloc.get_traced_memory()[0]
            tracemalloc.reset_peak()
            sys.setprofile(count)
            one()
            sys.setprofile(None)
    finally:
        sys.setprofile(None)
        tracemalloc.stop()
    return calls, made


if __name__ == "__main__":
    main()
