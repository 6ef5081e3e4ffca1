"""Chi-square tails and limits against scipy's."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import chdtrc, chdtri

from daemon.vision.geometry.robust_least_squares import chi_square_limit, chi_square_tail

dofs = st.integers(1, 120)


@given(st.floats(0, 600), dofs)
def test_the_tail_is_scipy_s(value: float, dof: int) -> None:
    assert chi_square_tail(value, dof) == pytest.approx(chdtrc(dof, value), rel=1e-9, abs=1e-300)


@given(dofs, st.floats(1e-6, 0.5))
def test_the_limit_is_scipy_s_and_its_tail_is_what_was_asked(dof: int, probability: float) -> None:
    limit = chi_square_limit(dof, probability)
    assert limit == pytest.approx(chdtri(dof, probability), rel=1e-6)
    assert chi_square_tail(limit, dof) == pytest.approx(probability, rel=1e-6)


def test_nothing_to_measure_is_never_unlikely() -> None:
    assert chi_square_tail(5.0, 0) == 1.0
    assert chi_square_limit(0, 0.01) == 0.0
    assert chi_square_tail(1e6, 3) == 0.0
