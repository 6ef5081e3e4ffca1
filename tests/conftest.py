"""What tests of more than one room share: a browser to open our pages in."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from tests.chromium import chromium


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """Headless Chromium, its console kept; skips where there is none."""
    driver = chromium()
    if driver is None:
        pytest.skip("no selenium, chromium and chromedriver on this machine")
    yield driver
    driver.quit()
