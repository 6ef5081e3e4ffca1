"""Every way in which a seen solid may be a taught part, each fitted and weighed by its chi-square.

In: what is seen, the taught metric models. Out: hypotheses, best first. Which one is believed is said in recognise.py.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from daemon.arrays import Array
from daemon.vision.geometry import Fits, Polyhedron, chi_square_tail, fit_poses, rough_rms
from daemon.vision.model import Correspondence, MetricModel, correspondences

Way = tuple[str, Correspondence]
SIGMA_SCALE = 1.3  # how much larger than predicted the corner errors may be, taken together
ROUGH_MM = 4.0  # an unweighted fit may be this bad where the weighted one is good: depth is what errs
SECOND_CHANCES = 8  # how many hypotheses are tried again without one corner
ASTRAY_MM = 12.0  # how far a corner may lie off that is left out: farther, and it is another shape
EQUAL_CHI2 = 9.0  # poses of one label this close in chi-square are equally good


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """The seen facets are those of `label`, in this pose.

    facets: the taught facet behind each seen one, or -1; corners (K,): the taught corner behind each seen one, or -1.
    tail: probability that a right hypothesis fits this badly or worse. rms_mm: distance of matched corners.
    astray: the one seen corner that the fit leaves out because it was measured wrongly, or -1.
    """

    label: str
    facets: tuple[int, ...]
    corners: NDArray[np.intp]
    pose: Array
    covariance: Array
    chi2: float
    dof: int
    rms_mm: float
    astray: int = -1

    @property
    def explained(self) -> int:
        """How many seen facets have a taught counterpart."""
        return len(self.facets) - self.facets.count(-1)

    @property
    def tail(self) -> float:
        """Probability of a chi-square this large when the hypothesis is right."""
        return chi_square_tail(self.chi2 / SIGMA_SCALE**2, self.dof)


def hypotheses(seen: Polyhedron, metric: Mapping[str, MetricModel], tolerance_mm: float) -> tuple[Hypothesis, ...]:
    """Every label in every numbering, most facets explained first, then the smallest chi-square. May be empty."""
    ways = [
        (label, way)
        for label, known in metric.items()
        for way in correspondences(seen, known.solid)
        if (way.corners >= 0).sum() >= 3
    ]
    if not ways:
        return ()
    ways = _promising(seen, metric, ways)
    fits = fit_poses(*_matched(seen, metric, ways), tolerance_mm)
    found = [_hypothesis(way, fits, i) for i, way in enumerate(ways)]
    return tuple(sorted(found, key=lambda h: (-h.explained, h.chi2)))


def without_one_corner(
    seen: Polyhedron, metric: Mapping[str, MetricModel], near: tuple[Hypothesis, ...], tolerance_mm: float
) -> tuple[Hypothesis, ...]:
    """The best hypotheses again, each without any one corner: a side fitted to the wrong edge spoils one corner.

    Only corners without which every facet still has three, and that lie no farther off than a wrong edge would put
    them. Those of each hypothesis that fit best come back, smallest chi-square first.
    """
    ways, left_out = [], []
    for h in near[:SECOND_CHANCES]:
        for k in np.nonzero(h.corners >= 0)[0]:
            if all(len(ring) > 3 for ring in seen.facets if k in ring):
                ways.append((h.label, Correspondence(h.facets, h.corners)))
                left_out.append(int(k))
    if not ways:
        return ()
    matched = _matched(seen, metric, ways)
    used = matched[4].copy()
    used[np.arange(len(ways)), left_out] = False
    fits = fit_poses(*matched[:4], used, tolerance_mm)
    turned = matched[2] @ fits.poses[:, :3, :3].transpose(0, 2, 1) + fits.poses[:, None, :3, 3]
    off = np.linalg.norm(seen.corners_mm - turned, axis=2)[np.arange(len(ways)), left_out]
    found = [replace(_hypothesis(way, fits, i), astray=left_out[i]) for i, way in enumerate(ways) if off[i] < ASTRAY_MM]
    return tuple(sorted(found, key=lambda h: (-h.explained, h.chi2)))


def _hypothesis(way: Way, fits: Fits, i: int) -> Hypothesis:
    label, laid = way
    return Hypothesis(
        label, laid.facets, laid.corners, fits.poses[i], fits.covariance[i],
        float(fits.chi2[i]), int(fits.dof[i]), float(fits.rms_mm[i]),
    )  # fmt: skip


def equivalents(best: Hypothesis, others: tuple[Hypothesis, ...]) -> Array:
    """(E, 4, 4) the poses of the same label that fit as well, the best first."""
    same = [
        h.pose
        for h in others
        if h is not best and h.label == best.label and h.explained == best.explained and h.chi2 < best.chi2 + EQUAL_CHI2
    ]
    return np.stack([best.pose, *same])


def _promising(seen: Polyhedron, metric: Mapping[str, MetricModel], ways: list[Way]) -> list[Way]:
    """Of each label the numberings that could still fit, at least one."""
    seen_mm, seen_covariance, corners, _, used = _matched(seen, metric, ways)
    rms = rough_rms(seen_mm, seen_covariance, corners, used)
    unsure = 3 * float(np.sqrt(np.trace(seen_covariance, axis1=1, axis2=2).mean()))
    least: dict[str, float] = {}
    for (label, _), value in zip(ways, rms, strict=True):
        least[label] = min(value, least.get(label, np.inf))
    return [w for w, r in zip(ways, rms, strict=True) if r <= max(least[w[0]], ROUGH_MM, unsure)]


def _matched(
    seen: Polyhedron, metric: Mapping[str, MetricModel], ways: list[Way]
) -> tuple[Array, Array, Array, Array, NDArray[np.bool_]]:
    """What fit_poses wants: seen corners, their covariance, their counterparts in each way, their covariance, which."""
    corners = np.stack([metric[label].solid.corners_mm[way.corners] for label, way in ways])
    covariance = np.stack([metric[label].solid.covariance_mm2[way.corners] for label, way in ways])
    used = np.stack([way.corners >= 0 for _, way in ways])
    return seen.corners_mm, seen.covariance_mm2, corners, covariance, used
