"""Chi-square limits and tails, to the accuracy decisions need. Numbers only; no statistics package at run time."""

from __future__ import annotations

import math


def chi_square_tail(chi2: float, dof: int) -> float:
    """Probability that a chi-square variable of `dof` degrees of freedom exceeds chi2; 1 for dof 0.

    Source: closed series for whole and half-whole gamma (Abramowitz & Stegun 26.4.4, 26.4.5).
    """
    if dof <= 0 or chi2 <= 0:
        return 1.0
    half = chi2 / 2
    if half > 700:
        return 0.0
    if dof % 2:
        tail = math.erfc(math.sqrt(half))
        term, start = math.exp(-half) * math.sqrt(half) / math.gamma(1.5), 1.5
    else:
        tail, term, start = 0.0, math.exp(-half), 1.0
    for k in range(dof // 2):
        tail += term
        term *= half / (start + k)
    return min(tail, 1.0)


def chi_square_limit(dof: int, probability: float) -> float:
    """The value a chi-square variable of `dof` exceeds with this small probability; 0 for dof 0. By bisection."""
    if dof <= 0:
        return 0.0
    low, high = 0.0, 20.0 * dof + 60.0  # beyond any tail that is told from 0
    for _ in range(60):
        middle = (low + high) / 2
        if chi_square_tail(middle, dof) > probability:
            low = middle
        else:
            high = middle
    return high
