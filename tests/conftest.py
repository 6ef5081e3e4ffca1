"""What tests of more than one room share: a browser to open our pages in; properties without a deadline."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import settings

from tests.chromium import chromium

# A deadline in wall time fails on a busy machine and says nothing of the product; pytest's own timeout ends what hangs.
settings.register_profile("house", deadline=None)
settings.load_profile("house")


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """Headless Chromium, its console kept; skips where there is none."""
    driver = chromium()
    if driver is None:
        pytest.skip("no selenium, chromium and chromedriver on this machine")
    yield driver
    driver.quit()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The longest test of all begins first: nobody waits for it at the end."""
    items.sort(key=lambda item: item.path.name != "test_whole_daemon.py")
