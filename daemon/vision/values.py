"""What flows through recognition: polygons, facets, groups, recognitions, parts. Values only; nothing is decided here.

All corners run anticlockwise as seen from the camera (so that a facet's outward normal, by the right-hand rule, looks
towards the cameras). Frames: px in the distorted image; mm in the cyclopean frame.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import cached_property

import numpy as np

from daemon import frames
from daemon.arrays import Array, Flags
from daemon.vision.geometry import OutlineArc, Polyhedron, united

MeasuredCorners = tuple[Array, Array]
"""Corners (N, 2) px in one image, and their covariance (N, 2, 2)."""

UNKNOWN = "unknown"
"""The label of a part that nothing trained fits."""


@dataclass(frozen=True, eq=False)
class Polygon:
    """The straight-sided border of one closed region in one image.

    corners_px (N, 2); covariance_px2 (N, 2, 2) from the side fits; contrast (N,) grey levels across the side that
    starts at each corner; border_px (K, 2) the traced border it was fitted to.
    """

    corners_px: Array
    covariance_px2: Array
    contrast: Array
    border_px: Array

    @property
    def measured(self) -> MeasuredCorners:
        """The corners and their covariance."""
        return self.corners_px, self.covariance_px2


@dataclass(frozen=True, eq=False)
class Facet:
    """One facet in space, seen by both cameras.

    corners_mm (N, 3) in the cyclopean frame; covariance_mm2 (N, 3, 3); left_px, right_px (N, 2) distorted px, corner by
    corner; epipolar_px (N,) distance of each right corner from its epipolar line; planarity_mm rms distance of the
    corners from their best plane; type is the facet library's name, `polygon<N>` where it has none, or what
    ring_names.py calls an outline with arcs; type_number in (0, 1) (thesis section 4.4.1), 0 while untyped. arcs:
    points (K, 3) mm along each arc of its outline, from end to end; among the corners chords stand for it, as
    OutlineArc says.
    """

    corners_mm: Array
    covariance_mm2: Array
    left_px: Array
    right_px: Array
    epipolar_px: Array
    planarity_mm: float
    type: str = "untyped"
    type_number: float = 0.0
    arcs: tuple[Array, ...] = ()


@dataclass(frozen=True, eq=False)
class Rejected:
    """A candidate that was looked at and refused: where in which image, and why in words. unexplained: both cameras
    outline it, so that something is there, and no facet came of it."""

    corners_px: Array
    camera: str
    reason: str
    unexplained: bool = False


@dataclass(frozen=True, eq=False)
class Group:
    """Facets that share edges, taken as one part. rings: for each facet the numbers of its corners, one number where
    facets share a corner.
    """

    facets: tuple[Facet, ...]
    rings: tuple[tuple[int, ...], ...]

    @cached_property
    def polyhedron(self) -> Polyhedron:
        """The facets with the corners they share united, cyclopean, of the facets' types."""
        corners, covariance = ([getattr(f, name) for f in self.facets] for name in ("corners_mm", "covariance_mm2"))
        solid = united(self.rings, np.concatenate(corners), np.concatenate(covariance), [f.type for f in self.facets])
        arcs = tuple(OutlineArc(k, points) for k, facet in enumerate(self.facets) for points in facet.arcs)
        return replace(solid, arcs=arcs) if arcs else solid

    @property
    def touching(self) -> Flags:
        """(n, n) which facets share an edge."""
        return self.polyhedron.touching

    def only(self, members: Sequence[int]) -> Group:
        """Some of the facets, in this order."""
        return Group(tuple(self.facets[k] for k in members), tuple(self.rings[k] for k in members))


@dataclass(frozen=True, eq=False)
class FacetView:
    """Everything geometry can say of one stereo pair before anything is named."""

    groups: tuple[Group, ...]
    rejected: tuple[Rejected, ...]
    polygons_left: tuple[Polygon, ...]
    polygons_right: tuple[Polygon, ...]
    noise_sigma: float
    notes: tuple[str, ...] = ()
    blur_px: float = 0.0

    @property
    def outlines(self) -> tuple[int, int]:
        """The number of outlines of the left and the right image, used or refused."""
        refused = Counter(r.camera for r in self.rejected)
        return len(self.polygons_left) + refused["left"], len(self.polygons_right) + refused["right"]


class Cause(StrEnum):
    """What stands between a part and its name; daemon/vision/health/cause.py decides, and has the words."""

    BORDER = "border"
    DARK = "dark"
    BURNT = "burnt"
    HIDDEN = "hidden"
    ALIKE = "alike"
    PATTERNED = "patterned"
    STRANGE = "strange"


@dataclass(frozen=True, eq=False)
class Recognition:
    """What a group is taken for, and how sure. label is `unknown` where nothing trained fits or nothing settles it.

    confidence: calibrated probability of being right; match_ratio and activation as the thesis has them (section 5.6);
    runner_up: the next best label, or None; ambiguous: more than one label fits what is seen; reason: one line;
    cause: where it has no name, once the pictures were asked.
    """

    label: str
    confidence: float
    match_ratio: float
    activation: float
    runner_up: str | None
    ambiguous: bool
    reason: str
    candidates: tuple[str, ...] = ()
    cause: Cause | None = None


@dataclass(frozen=True, eq=False)
class Part:
    """A recognised (or unknown) part: cyclopean_from_part (4, 4) mm, covariance (6, 6) as daemon/frames.py has it.

    For an unknown part the pose is that of its facets' centroid with the camera's axes. residual_mm is the rms distance
    of the seen corners from the fitted metric model (nan when unknown). facets are as measured, with their types.
    fitted_mm: for each facet its (N, 3) most likely corners in the cyclopean frame, given the measured ones and what
    the part was taken for. equivalents: (E, 4, 4) every pose that fits as well, because the part is symmetric; the
    first is cyclopean_from_part.
    """

    recognition: Recognition
    facets: tuple[Facet, ...]
    cyclopean_from_part: Array
    covariance: Array
    residual_mm: float
    fitted_mm: tuple[Array, ...] = ()
    equivalents: Array = field(default_factory=lambda: np.zeros((0, 4, 4)))

    @property
    def named(self) -> bool:
        """Whether it was taken for a taught part."""
        return self.recognition.label != UNKNOWN

    def at_pose(self, pose: Array, covariance: Array, fitted_mm: tuple[Array, ...]) -> Part:
        """The part at another pose (4, 4), with its corners there; the poses that fit as well go with it."""
        turn = pose @ frames.inverse(self.cyclopean_from_part)
        return replace(
            self,
            cyclopean_from_part=pose,
            covariance=covariance,
            fitted_mm=fitted_mm,
            equivalents=turn @ self.equivalents,
        )


@dataclass(frozen=True, eq=False)
class NearestGuess:
    """What came nearest to a name and did not get it, laid onto both images.

    left_px, right_px: (N, 2, 2) ends of every edge that should show in that camera, distorted px; left_shows,
    right_shows: (N,) bool, whether the image shows it. print_apart_px: how far from where these edges have it the print
    on its faces lies apart in the cameras, along epipolar lines; 0 where it agrees, or nobody can tell.
    """

    label: str
    left_px: Array
    right_px: Array
    left_shows: Flags
    right_shows: Flags
    print_apart_px: float = 0.0

    @property
    def share(self) -> float:
        """The share of its edges, by length over both cameras, that shows."""
        ends = np.concatenate([self.left_px, self.right_px])
        length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        shows = np.concatenate([self.left_shows, self.right_shows])
        return float(length[shows].sum() / max(length.sum(), 1e-9))


@dataclass(frozen=True, eq=False)
class Scene:
    """The answer of one look: parts nearest first, what was refused, notes for people, seconds by stage, and what the
    unnamed came nearest to.
    """

    parts: tuple[Part, ...]
    rejected: tuple[Rejected, ...]
    view: FacetView
    notes: tuple[str, ...] = ()
    seconds: dict[str, float] = field(default_factory=dict)
    guesses: tuple[NearestGuess, ...] = ()
