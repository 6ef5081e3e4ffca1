"""Cases of a test of which `make test` runs the first few, and `make test-long`, with CI, the others."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest


def few(cases: Iterable[Any], first: int) -> list[Any]:
    """For `parametrize`: the first cases as they are, the others marked `long`. For cases that go the same ways through
    the code with other numbers: what one of them would miss is caught before main moves."""
    cases = list(cases)
    rest = (case if isinstance(case, tuple) else (case,) for case in cases[first:])
    return [*cases[:first], *(pytest.param(*case, marks=pytest.mark.long) for case in rest)]
