"""The arithmetic and the categories of Gaussian ART (D'Souza, appendix C): density, match, choice, learning.

What a category stands for is not known here. Everything is in logarithms, so that a sample far from every category
still has an order of preference. Mended against the transcription: (1.27) has the exponent 1/2; (1.35) offers three
variances, see GaussianRule.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from daemon.arrays import Array, Index
from daemon.art.errors import ParameterError, within
from tests.bench.networks.errors import one_of
from tests.bench.networks.search import UNCOMMITTED, MatchTracking

MatchBy = Literal["density", "unit_height"]
Variance = Literal["exact", "new_mean", "old_mean"]

# Elements of (samples, nodes) tables worked through together.
PIECE = 16384


@dataclass(frozen=True)
class GaussianRule:
    """gamma: standard deviation of a new category, in the units of the samples.

    match_by: "density" (default, (1.31), and Williamson's report of 1995) compares log((2 pi)^(M/2) p(I|j)) with rho,
        which then may be any number; "unit_height" (his paper of 1996) compares exp(-d^2 / 2), d the distance in
        standard deviations, so that rho lies in [0, 1] and small categories are not favoured.
    rho: vigilance, None for the least there is (every category resonates).
    variance: which deviation (1.35) squares. "exact" (default, Welford): from the mean before times from the mean
        after, which gives the sample variance; "new_mean": the text taken in its order, which understates it;
        "old_mean": overstates it. The initial gamma^2 counts as one sample in all three.
    least_sigma: no category gets narrower than this, whatever it learns.
    """

    gamma: float = 0.1
    rho: float | None = None
    match_by: MatchBy = "density"
    variance: Variance = "exact"
    least_sigma: float = 1e-4
    match_tracking: MatchTracking = "MT+"
    epsilon: float = 1e-10

    def __post_init__(self) -> None:
        within("gamma", self.gamma, np.nextafter(0.0, 1.0), float("inf"))
        within("least_sigma", self.least_sigma, np.nextafter(0.0, 1.0), self.gamma)
        within("epsilon", self.epsilon, 0.0, float("inf"))
        one_of("match_by", self.match_by, ("density", "unit_height"))
        one_of("variance", self.variance, ("exact", "new_mean", "old_mean"))
        one_of("match_tracking", self.match_tracking, ("MT+", "MT-"))
        if self.rho is not None:
            low, high = (0.0, 1.0) if self.match_by == "unit_height" else (-np.inf, np.inf)
            if not (np.isfinite(self.rho) and low <= self.rho <= high):
                raise ParameterError(f"rho: expected a number in [{low}, {high}], found {self.rho!r}")

    @property
    def baseline(self) -> float:
        return -np.inf if self.rho is None else float(self.rho)

    def match(self, log_density: Array, log_peak: Array) -> Array:
        """The match of (1.31) from g' and g' at the category's centre; shapes broadcast."""
        return log_density if self.match_by == "density" else np.exp(log_density - log_peak)

    def tracked(self, match: float) -> float:
        """The vigilance after a wrong prediction at this match."""
        return match + self.epsilon if self.match_tracking == "MT+" else match - self.epsilon


class Categories:
    """A growing table of J Gaussians. mean, variance (J, M); samples (J,): how many each has coded; log_peak (J,): g'
    at each one's own centre, minus the log of the product of its standard deviations."""

    def __init__(self, mean: Array, variance: Array, samples: Index) -> None:
        self.mean, self.variance, self.samples = mean, variance, samples
        self._weight = -0.5 / variance
        self.log_peak = -0.5 * np.log(variance).sum(axis=1)

    @classmethod
    def none(cls, features: int) -> Categories:
        return cls(np.empty((0, features)), np.empty((0, features)), np.empty(0, dtype=np.int64))

    def __len__(self) -> int:
        return len(self.samples)

    @property
    def features(self) -> int:
        return int(self.mean.shape[1])

    def log_prior(self) -> Array:
        """log P(j), (1.28), (J,)."""
        return np.asarray(np.log(self.samples / max(int(self.samples.sum()), 1)))

    def log_density(self, sample: Array) -> Array:
        """g', (1.31), of one sample (M,) at every category, (J,)."""
        away = sample - self.mean
        away *= away
        away *= self._weight
        return np.asarray(away.sum(axis=1) + self.log_peak)

    def log_densities(self, samples: Array) -> Array:
        """g' of samples (B, M) at every category, (B, J)."""
        result = np.repeat(self.log_peak[None], len(samples), axis=0)
        mean, weight = np.ascontiguousarray(self.mean.T), np.ascontiguousarray(self._weight.T)
        rows = max(1, PIECE // max(len(self), 1))
        for start in range(0, len(samples), rows):
            total = result[start : start + rows]
            for value, centre, scale in zip(samples[start : start + rows].T, mean, weight, strict=True):
                away = value[:, None] - centre
                away *= away
                away *= scale
                total += away
        return result

    def commit(self, sample: Array, rule: GaussianRule) -> int:
        """Add a category at the sample (M,); its index."""
        variance = np.full((1, self.features), rule.gamma**2)
        self.mean = np.concatenate([self.mean, sample[None]])
        self.variance = np.concatenate([self.variance, variance])
        self.samples = np.concatenate([self.samples, np.ones(1, dtype=np.int64)])
        self._weight = np.concatenate([self._weight, -0.5 / variance])
        self.log_peak = np.concatenate([self.log_peak, -0.5 * np.log(variance).sum(axis=1)])
        return len(self) - 1

    def learn(self, node: int, sample: Array, rule: GaussianRule) -> None:
        """(1.33) to (1.35): count, mean and variance of the chosen category."""
        self.samples[node] += 1
        share = 1.0 / float(self.samples[node])
        before = sample - self.mean[node]
        self.mean[node] += share * before
        after = sample - self.mean[node]
        squared = {"exact": before * after, "new_mean": after * after, "old_mean": before * before}[rule.variance]
        variance = np.maximum((1.0 - share) * self.variance[node] + share * squared, rule.least_sigma**2)
        self.variance[node] = variance
        self._weight[node] = -0.5 / variance
        self.log_peak[node] = -0.5 * np.log(variance).sum()

    def at(self, nodes: NDArray[np.bool_]) -> Categories:
        """These categories alone, in their order."""
        return Categories(self.mean[nodes], self.variance[nodes], self.samples[nodes])


def resonating(categories: Categories, sample: Array, rule: GaussianRule, agrees: Callable[[int], bool]) -> int:
    """The category that resonates with one sample (M,), or UNCOMMITTED: (1.30) to (1.32) with match tracking.

    agrees(j) says whether category j may stand for the sample's label. A category once reset stays out.
    """
    density = categories.log_density(sample)
    match = rule.match(density, categories.log_peak)
    remaining = np.where(match >= rule.baseline, density + categories.log_prior(), -np.inf)
    while remaining.size:
        node = int(remaining.argmax())
        if remaining[node] == -np.inf:
            break
        if agrees(node):
            return node
        remaining = np.where(match >= rule.tracked(float(match[node])), remaining, -np.inf)
        remaining[node] = -np.inf
    return UNCOMMITTED
