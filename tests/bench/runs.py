"""What recording a run costs the moves, and how soon the page of a long run is open. Prints a table; judges nothing."""

from __future__ import annotations

import os
import tempfile
import threading
import time
from pathlib import Path

import numpy as np

from daemon.review.page import write_page
from daemon.store.runlog import RunLog
from tests.chromium import chromium
from tests.fakes.made_run import long_run, part

LOOKS, LOOK_EVERY_S = 300, 0.1
CYCLES = 10_000


def record_s(folder: Path, disk_busy: bool) -> np.ndarray:
    """(LOOKS,) s that `record` kept its caller, for looks with two noisy pictures (the hardest to pack), at the pace of
    a fast cell. disk_busy: while somebody else writes and syncs on the same disk without pause."""
    rng = np.random.default_rng(0)
    pair = {camera: rng.normal(120, 2, (480, 640)).astype(np.uint8) for camera in ("left", "right")}
    scene = {"ms": 12.0, "parts": [part("cube")], "rejected": [], "notes": []}
    over = threading.Event()
    hog = threading.Thread(target=_keep_busy, args=(folder / "hog", over))
    if disk_busy:
        hog.start()
    log, kept = RunLog(folder / "run"), []
    for stop in range(LOOKS):
        began_s = time.perf_counter()
        log.record(
            "look", cycle=1, stop=stop, purpose="approach", scene=scene, images=pair, world_from_cyclopean=np.eye(4)
        )
        kept.append(time.perf_counter() - began_s)
        time.sleep(max(0.0, LOOK_EVERY_S - kept[-1]))
    log.close()
    over.set()
    if disk_busy:
        hog.join()
    return np.array(kept)


def _keep_busy(path: Path, over: threading.Event) -> None:
    block = os.urandom(8 << 20)
    while not over.is_set():
        with path.open("wb") as file:
            file.write(block)
            file.flush()
            os.fsync(file.fileno())


def opened_ms(page: Path, times: int = 5) -> np.ndarray | None:
    """(times,) ms from asking for the page to its load event in headless Chromium; None where there is none."""
    browser = chromium()
    if browser is None:
        return None
    try:
        found = []
        for _ in range(times):
            browser.get(page.as_uri())
            found.append(
                browser.execute_script("const t = performance.getEntriesByType('navigation')[0]; return t.loadEventEnd")
            )
        return np.array(found, float)
    finally:
        browser.quit()


def main() -> None:
    with tempfile.TemporaryDirectory() as name:
        for busy in (False, True):
            ms = 1e3 * record_s(Path(name) / f"busy-{busy}", busy)
            print(
                f"record a look with two 640x480 pictures, disk {'busy' if busy else 'idle'}: median "
                f"{np.median(ms):.3f} ms, 99 % {np.quantile(ms, 0.99):.3f} ms, worst {ms.max():.3f} ms of {LOOKS}"
            )
        run = long_run(Path(name) / "20260102T030405Z", CYCLES)
        began_s = time.perf_counter()
        page = write_page(run, Path(name) / "page.html")
        took_s = time.perf_counter() - began_s
        print(f"page of {CYCLES} cycles: {page.stat().st_size / 1e6:.1f} MB, written in {took_s:.1f} s")
        found = opened_ms(page)
        print("opened in Chromium: none here" if found is None else f"opened in Chromium: {np.round(found)} ms")


if __name__ == "__main__":
    main()
