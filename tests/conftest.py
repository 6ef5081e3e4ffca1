"""What tests of more than one room share: a browser to open our pages in; properties without a deadline."""

from __future__ import annotations

import gc
import os
from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import settings

from tests.chromium import chromium

# A deadline in wall time fails on a busy machine and says nothing of the product; pytest's own timeout ends what hangs.
# Drawn alike each time: what the tests say of a commit they say again. `--hypothesis-profile fresh` draws anew, for
# whoever hunts; so does `make bench-faults`.
settings.register_profile("fresh", deadline=None)
settings.register_profile("house", deadline=None, derandomize=True)
settings.load_profile("house")


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """Headless Chromium, its console kept; skips where there is none."""
    driver = chromium()
    if driver is None:
        pytest.skip("no selenium, chromium and chromedriver on this machine")
    yield driver
    driver.quit()


LONGEST = ("test_guide_typed.py", "test_cell_picks.py")
"""The longest of `make test-long`, and of `make test`."""


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """What is slow comes last at each of pytest-xdist's workers, who begin with a share each of the whole list: the
    others have answered before. Of the slow ones the longest begin first: no worker waits for them at the end."""
    items.sort(key=lambda item: item.path.name not in LONGEST)
    slow = [item for item in items if item.get_closest_marker("slow")]
    others = [item for item in items if not item.get_closest_marker("slow")]
    workers = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
    items[:] = [item for k in range(workers) for kind in (others, slow) for item in _share(kind, k, workers)]


def _share(items: list[pytest.Item], k: int, of: int) -> list[pytest.Item]:
    return items[len(items) * k // of : len(items) * (k + 1) // of]


def pytest_collection_finish() -> None:
    """What was collected stays to the end: the garbage collector need not go through it again and again."""
    gc.collect()
    gc.freeze()
