"""A stereo pair -> facets in space, grouped into parts: the order of the steps, and nothing else."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from statistics import median
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daemon.arrays import Flags
from daemon.vision.facets.grouping import connected, lying_under, merge_vertices, nearest_first
from daemon.vision.facets.one_look.arc_rings import is_hole_in, round_facets
from daemon.vision.facets.one_look.candidates import Candidate, choose, find_candidates, outlines_of, triangulate
from daemon.vision.facets.one_look.corner_adjustment import adjust_corners
from daemon.vision.geometry import Baseline, StereoRig, rings
from daemon.vision.image import Outline, StereoImages, open_stereo
from daemon.vision.settings import VisionSettings
from daemon.vision.thesis import by_formula, converging, find_corners
from daemon.vision.values import Facet, FacetView, Group, Polygon, Rejected

_DETECTED_PX = 0.7
UNMATCHED = "no polygon of the other camera fits along its epipolar lines"
STOOD_ON = "the part would stand on this facet: it is a shadow or a mark on the table"
CandidateGroup = tuple[list[Candidate], Group]
"""Candidates that hang together by shared edges, and their facets as a group."""


def find_facets(
    left: NDArray[Any], right: NDArray[Any], rig: StereoRig, settings: VisionSettings | None = None
) -> FacetView:
    """Everything geometry can say of one stereo pair.

    left, right: (H, W) uint8, or what `as_grey` takes. Facets come untyped, corners anticlockwise as seen.
    Raises VisionError where an image cannot be used; an image with nothing in it gives an empty view.
    """
    images, chosen = open_stereo(left, right, rig), settings or VisionSettings()
    return with_single_camera_outlines(facets_of_images(images, chosen, round_facets(images, chosen)), images, chosen)


def facets_of_images(images: StereoImages, settings: VisionSettings, rounded: Sequence[Candidate] = ()) -> FacetView:
    """The facets that both cameras outline, of images already opened, which make nothing twice. rounded: those with
    arcs in their outline."""
    outlines = outlines_of(images, settings, in_one=False)
    straight = find_candidates(outlines, images, settings)
    outer = [one for one in rounded if not any(is_hole_in(one, other) for other in (*straight, *rounded))]
    chosen, refused = choose([*outer, *straight], settings)
    return _with_unmatched(_grouped(chosen, refused, images, settings), outlines)


def with_single_camera_outlines(view: FacetView, images: StereoImages, settings: VisionSettings) -> FacetView:
    """The view with what one camera alone outlines as well among what is refused: a shock to the rig shows by it."""
    return _with_unmatched(view, outlines_of(images, settings, in_one=True))


def _with_unmatched(view: FacetView, outlines: Sequence[Sequence[Outline]]) -> FacetView:
    """The view with these of the left and the right camera's outlines that no facet uses among what is refused."""
    alone = _unmatched(outlines[0], view.polygons_left, "left") + _unmatched(outlines[1], view.polygons_right, "right")
    return replace(view, rejected=(*alone, *(r for r in view.rejected if r.reason != UNMATCHED)))


def _grouped(
    chosen: list[Candidate],
    refused: list[tuple[Candidate, str]],
    images: StereoImages,
    settings: VisionSettings,
) -> FacetView:
    """The chosen candidates as groups of facets, less those that a part stands on; these, and those refused, with the
    reason."""
    if settings.corner_detector != "line_fit":
        chosen = [_with_detected_corners(c, images, settings) for c in chosen]
    groups, under_parts = list[Group](), list[Candidate]()
    for members, group in _merge_candidates(chosen):
        whole = _with_adjusted_corners(members, group, images.geometry, settings)
        under = lying_under(whole.facets)
        if not under:
            groups.append(whole)
            continue
        under_parts += [members[k] for k in under]
        for rest, own in _merge_candidates([c for k, c in enumerate(members) if k not in under]):
            groups.append(_with_adjusted_corners(rest, own, images.geometry, settings))
    if settings.stereo_formula != "exact":
        groups = [replace(g, facets=tuple(_by_formula(g.facets, images.rig, settings))) for g in groups]
    polygons = tuple(c.left.polygon for c in chosen), tuple(c.right.polygon for c in chosen)
    rejected = (
        *(Rejected(c.facet.left_px, "left", why, unexplained=True) for c, why in refused),
        *(Rejected(c.facet.left_px, "left", STOOD_ON) for c in under_parts),
    )
    sigma, blur = _noise_at_parts(images, chosen)
    return FacetView(nearest_first(groups), rejected, *polygons, sigma, blur_px=blur)


def _merge_candidates(candidates: list[Candidate]) -> list[CandidateGroup]:
    """Sets of candidates that hang together by shared edges, each with its facets as a group."""
    if not candidates:
        return []
    whole = merge_vertices([c.facet for c in candidates])
    sets = connected(whole.touching)
    if len(sets) == 1:
        return [(candidates, whole)]
    return [([candidates[k] for k in members], whole.only(members)) for members in sets]


def _with_adjusted_corners(
    members: list[Candidate], group: Group, geometry: Baseline, settings: VisionSettings
) -> Group:
    """The group, its corners estimated together unless they are to stay where a detector put them; what turns out to be
    one corner only then is estimated as one."""
    if settings.corner_detector != "line_fit":
        return group
    whole = adjust_corners(members, group, geometry)
    if 2 * len(group.polyhedron.seams) == len(members) * (len(members) - 1):
        return whole
    again = merge_vertices(whole.facets)
    fewer = len(set().union(*again.rings)) < len(set().union(*whole.rings))
    return adjust_corners(members, again, geometry) if fewer else whole


def _noise_at_parts(images: StereoImages, chosen: list[Candidate]) -> tuple[float, float]:
    """Noise sigma at the grey level of the facets (mid grey without any), grey levels; and the edges' blur, px."""
    if not chosen:
        return float(np.mean([view.noise.sigma[128] for view in images.views])), 0.0
    sigma = []
    for c in chosen:
        for view, corners in zip(images.views, (c.facet.left_px, c.facet.right_px), strict=True):
            (x, y), (height, width) = corners.mean(0).tolist(), view.grey.shape
            level = view.grey[int(min(max(y, 0.0), height - 1.0)), int(min(max(x, 0.0), width - 1.0))]
            sigma.append(float(view.noise.sigma[level]))
    return median(sigma), median(float(c.left.sides.blur[0]) for c in chosen)


def _with_detected_corners(c: Candidate, images: StereoImages, settings: VisionSettings) -> Candidate:
    """The candidate with its corners from one of D'Souza's detectors; where that finds none, the met lines stay."""
    polygons = []
    for view, fitted in zip(images.views, (c.left, c.right), strict=True):
        p = fitted.polygon
        sigma = float(view.noise.sigma[128])
        found = find_corners(view.grey.astype(np.float32), p.corners_px, settings.corner_detector, sigma)
        corners = np.where(np.isnan(found), p.corners_px, found)
        covariance = np.repeat(_DETECTED_PX**2 * np.eye(2)[None], len(corners), 0)
        polygons.append(replace(p, corners_px=corners, covariance_px2=covariance))
    left, right = replace(c.left, polygon=polygons[0]), replace(c.right, polygon=polygons[1])
    (facet,) = triangulate([(polygons[0].measured, polygons[1].measured)], images.geometry)
    return replace(c, facet=facet, left=left, right=right)


def _by_formula(facets: Iterable[Facet], rig: StereoRig, settings: VisionSettings) -> list[Facet]:
    constants = converging(rig, settings.depth_readings_mm)
    compensated = settings.stereo_formula == "thesis_compensated"
    return [replace(f, corners_mm=by_formula(f.left_px, f.right_px, rig, constants, compensated)) for f in facets]


def _unmatched(outlines: Sequence[Outline], used: tuple[Polygon, ...], camera: str) -> tuple[Rejected, ...]:
    """Outlines well away from every polygon that was used."""
    if not outlines:
        return ()
    shape = rings([o.corners for o in outlines])
    middles = (shape.sums(shape.corners) / shape.count[:, None])[:, None]
    low = np.array([p.corners_px.min(0) for p in used]).reshape(-1, 2)
    high = np.array([p.corners_px.max(0) for p in used]).reshape(-1, 2)
    beyond: Flags = np.asarray(((middles <= low) | (middles >= high)).any(2))
    return tuple(Rejected(outlines[k].corners, camera, UNMATCHED) for k in np.flatnonzero(beyond.all(1)).tolist())
