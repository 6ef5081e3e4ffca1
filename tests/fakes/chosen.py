"""Cases of a test of which `make test` runs the first few, and `make test-long`, with CI, the others."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest


def few(cases: Iterable[Any], first: int) -> list[Any]:
    """For `parametrize`: the cases, all but the first few marked `long`. For cases that go the same ways through the
    code with other numbers: what one of them would miss is caught before main moves. A tuple: a value for each name."""
    values = (case if isinstance(case, tuple) else (case,) for case in cases)
    return [pytest.param(*each, marks=pytest.mark.long if k >= first else ()) for k, each in enumerate(values)]
