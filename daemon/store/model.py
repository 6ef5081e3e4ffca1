"""Save and load a trained model: one .npz of plain arrays with a JSON header, never a pickle."""

import hashlib
import json
import re
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np
from msgspec import Meta

from daemon.arrays import Array
from daemon.art import ArtError, RelationARTMAP
from daemon.errors import spelt_throughout
from daemon.store.files import failing_as, write_atomically
from daemon.store.library import library_digest, library_plain
from daemon.store.npz import ArchiveError, Arrays, one_line, pack, unpack
from daemon.store.outside import FileError, read_file
from daemon.vision.geometry import Hole, OutlineArc, Polyhedron
from daemon.vision.model import (
    FEATURES,
    LARGEST_NUMBER,
    FacetLibrary,
    FacetType,
    MetricModel,
    Model,
    TaughtView,
    relearnt,
    with_types_of_arcs,
)
from daemon.vision.settings import MemorySettings

FORMAT = "facetd-model"
VERSION = 2
EARLIER_ARC = re.compile(r"arc\d+")
"""Name of a facet with arcs in models of earlier releases, by the degrees of the longest."""
LARGEST_MM = 1e5
"""Farthest corner from a part's centre."""
LARGEST_FILE = 32_000_000
LARGEST_UNFOLDED = 256_000_000
"""Bytes of all arrays together. Ten parts of ten views each are 0.4 MB, a thousand drawn ones 20 MB."""
LARGEST_MEMORY = 1_000_000_000
"""Bytes of all nodes' matrices, of which a file has only the filled elements; a thousand drawn parts need 50 MB."""


class ModelError(FileError):
    """A model file cannot be read or written: one line, path first, then what is wrong."""


class _HoleHeader(msgspec.Struct, forbid_unknown_fields=True):
    facet: int
    ring_mm: list[tuple[float, float, float]]


class _ArcHeader(msgspec.Struct, forbid_unknown_fields=True):
    facet: int
    points_mm: list[tuple[float, float, float]]


class _SolidHeader(msgspec.Struct, forbid_unknown_fields=True):
    facets: list[list[int]]
    types: list[Annotated[str, Meta(max_length=200)]]
    smooth: list[tuple[int, int]] = []
    covers: list[list[tuple[float, float, float]]] = []
    holes: list[_HoleHeader] = []
    arcs: list[_ArcHeader] = []


class _ViewHeader(msgspec.Struct, forbid_unknown_fields=True):
    label: str
    sides: list[int]
    node: int
    slots: list[int]
    source: str
    solid: _SolidHeader | None


class _FirstViewHeader(msgspec.Struct, forbid_unknown_fields=True):
    label: str
    solid: _SolidHeader
    node: int
    source: str


class _MetricHeader(msgspec.Struct, forbid_unknown_fields=True):
    label: str
    solid: _SolidHeader
    joined: list[int]


class _TypeHeader(msgspec.Struct, forbid_unknown_fields=True):
    name: str
    number: Annotated[float, Meta(gt=0, lt=LARGEST_NUMBER)]
    angles_rad: list[Annotated[float, Meta(gt=0, le=7)] | str]
    ratios: list[Annotated[float, Meta(gt=0, le=1e6)] | str]


class _LibraryHeader(msgspec.Struct, forbid_unknown_fields=True):
    angle_tolerance_rad: Annotated[float, Meta(gt=1e-6, lt=2)]
    ratio_tolerance: Annotated[float, Meta(gt=1e-6, lt=1)]
    types: list[_TypeHeader]
    sha256: str


class _AnyHeader(msgspec.Struct, forbid_unknown_fields=True):
    """The header fields of every version."""

    format: str
    version: int
    trained: str
    matrix_size: Annotated[int, Meta(ge=0, le=1000)]
    parts: list[str]
    codes: dict[str, str]
    library: _LibraryHeader
    metric: list[_MetricHeader]
    sha256: str


class _ModelHeader(_AnyHeader, forbid_unknown_fields=True):
    parameters: dict[str, Annotated[float, Meta(ge=0, le=1000)]]
    views: list[_ViewHeader]


class _FirstHeader(_AnyHeader, forbid_unknown_fields=True):
    """Header of version 1, whose nodes have types only: its views are learnt again."""

    parameters: dict[str, Annotated[float, Meta(ge=0, le=1000)] | bool]
    views: list[_FirstViewHeader]


@dataclass(frozen=True, eq=False)
class ModelFile:
    """A model and the rest of its file. trained: ISO time, UTC, or empty; codes: {label: ART-b bits}; sha256: of all
    that the file says, the same wherever it lies; path: where it was read."""

    model: Model
    trained: str
    codes: dict[str, str]
    sha256: str
    path: Path = Path()


def save(model: Model, path: Path, *, trained: str = "", codes: dict[str, str] | None = None) -> None:
    """Write the model, whole or not at all. trained: when; codes: of each part, its ART-b bits. Raises ModelError."""
    content = to_bytes(model, trained=trained, codes=codes)
    with failing_as(ModelError, f"{path}: cannot be written"):
        write_atomically(path, content)


def load(path: Path) -> Model:
    """Read a model. Raises FileError; ModelError where it is cut short, altered, foreign or newer."""
    return load_file(path).model


def load_file(path: Path, expected: str | None = None) -> ModelFile:
    """Load a model with the rest of the file. expected: its sha256, else ModelError. Raises as `load`."""
    content = read_file(path, LARGEST_FILE)
    try:
        file = replace(from_bytes(content), path=path)
    except ModelError as error:
        raise ModelError(f"{path}: {error}") from None
    if expected not in (None, file.sha256):
        raise ModelError(f"{path}: replaced while it was in use: put the file back, or restart facetd to use this one")
    return file


def to_bytes(model: Model, *, trained: str = "", codes: dict[str, str] | None = None) -> bytes:
    """Encode a model as the file's content; the same model gives the same bytes."""
    arrays = _arrays(model)
    header = {
        "format": FORMAT,
        "version": VERSION,
        "trained": trained,
        "parameters": asdict(model.parameters),
        "matrix_size": model.artmap.slots,
        "parts": model.labels,
        "codes": codes if codes is not None else _counted_codes(model.labels),
        "library": {**_library_header(model.library), "sha256": library_digest(model.library)},
        "views": [
            {
                "label": v.label,
                "sides": v.sides,
                "node": v.node,
                "slots": v.slots,
                "source": v.source,
                "solid": None if v.solid is None else _solid_header(v.solid),
            }
            for v in model.views
        ],
        "metric": [{"label": k, "solid": _solid_header(m.solid), "joined": m.joined} for k, m in model.metric.items()],
    }
    header = spelt_throughout(header)  # sources are files' names, which need not be UTF-8
    header["sha256"] = checksum_of(header, arrays)
    arrays["header"] = np.frombuffer(canonical_header(header), dtype=np.uint8)
    return pack(arrays)


def from_bytes(content: bytes) -> ModelFile:
    """Check and decode a file's content. Raises ModelError, without the path."""
    try:
        arrays = unpack(content, LARGEST_UNFOLDED)
    except ArchiveError as error:
        raise ModelError(f"not a facetd model: {error}") from None
    header_array = arrays.pop("header", None)
    if header_array is None or header_array.dtype != np.uint8:
        raise ModelError("not a facetd model: it has no header")
    try:
        plain = msgspec.json.decode(header_array.tobytes())
    except (msgspec.MsgspecError, RecursionError, ValueError):
        raise ModelError("not a facetd model: its header is not JSON") from None
    if not isinstance(plain, dict) or plain.get("format") != FORMAT:
        raise ModelError("not a facetd model: its header names another format")
    if plain.get("version") not in (1, VERSION):
        raise ModelError(
            f"version {plain.get('version')!r:.40}, this facetd reads versions 1 and {VERSION}: train anew or update"
        )
    checksum = plain.pop("sha256", None)
    if checksum != checksum_of(plain, arrays):
        raise ModelError("altered or damaged: its checksum does not match its content")
    try:
        if plain["version"] == 1:
            first = msgspec.convert({**plain, "sha256": checksum}, _FirstHeader)
            return ModelFile(_first_model(first, arrays), first.trained, first.codes, str(checksum))
        header = msgspec.convert({**plain, "sha256": checksum}, _ModelHeader)
        return ModelFile(_model(header, arrays), header.trained, header.codes, str(checksum))
    except (msgspec.ValidationError, ArtError, ArithmeticError, LookupError, TypeError, ValueError) as error:
        raise ModelError(f"inconsistent: {one_line(error)}") from None


def _arrays(model: Model) -> Arrays:
    """The memory's nodes, only their taught elements; and the corners of all solids in a row: views, then parts."""
    node, a, b = np.nonzero(model.artmap.upper[:, 0] > 0)
    solids = [v.solid for v in model.views if v.solid is not None] + [m.solid for m in model.metric.values()]
    return {
        "relations": np.stack([node, a, b], 1).astype(np.int32),
        "lower": model.artmap.lower[node, :, a, b],
        "upper": model.artmap.upper[node, :, a, b],
        "counts": model.artmap.counts,
        "corners": np.array([len(solid.corners_mm) for solid in solids], np.int32),
        "corners_mm": np.concatenate([np.zeros((0, 3)), *(solid.corners_mm for solid in solids)]),
        "covariance_mm2": np.concatenate([np.zeros((0, 3, 3)), *(solid.covariance_mm2 for solid in solids)]),
    }


def _solid_header(solid: Polyhedron) -> dict[str, Any]:
    header: dict[str, Any] = {"facets": solid.facets, "types": solid.types}
    if solid.smooth:
        header["smooth"] = sorted(solid.smooth)
    if len(solid.covers):
        header["covers"] = solid.covers.round(4).tolist()
    if solid.holes:
        header["holes"] = [{"facet": one.facet, "ring_mm": one.ring_mm.round(4).tolist()} for one in solid.holes]
    if solid.arcs:
        header["arcs"] = [{"facet": one.facet, "points_mm": one.points_mm.round(4).tolist()} for one in solid.arcs]
    return header


def _library_header(library: FacetLibrary) -> dict[str, Any]:
    plain = library_plain(library)
    names = ("name", "number", "angles_rad", "ratios")
    return {**plain, "types": [dict(zip(names, t, strict=True)) for t in plain["types"]]}


def _library(header: _LibraryHeader) -> FacetLibrary:
    if any(len(t.angles_rad) < 3 or len(t.angles_rad) != len(t.ratios) for t in header.types):
        raise ValueError("a facet type with fewer than three angles, or another number of ratios")
    types = tuple(FacetType(t.name, t.number, tuple(t.angles_rad), tuple(t.ratios)) for t in header.types)
    return FacetLibrary(types, header.angle_tolerance_rad, header.ratio_tolerance)


def _model(header: _ModelHeader, arrays: Arrays) -> Model:
    parameters = MemorySettings(**header.parameters)
    headers = [v.solid for v in header.views if v.solid is not None] + [m.solid for m in header.metric]
    ends = np.cumsum(arrays["corners"]).tolist()
    if (
        len(ends) != len(headers)
        or any(n < 0 for n in arrays["corners"].tolist())
        or (ends and ends[-1] != len(arrays["corners_mm"]))
    ):
        raise ValueError("the number of corners is not that of its views and parts")
    every = np.split(np.asarray(arrays["corners_mm"], float), ends)[:-1]
    spreads = np.split(np.asarray(arrays["covariance_mm2"], float), ends)[:-1]
    solids = iter([_solid("solid", *one) for one in zip(headers, every, spreads, strict=True)])
    views = tuple(
        TaughtView(v.label, tuple(v.sides), v.node, tuple(v.slots), v.source, next(solids) if v.solid else None)
        for v in header.views
    )
    metric = {m.label: MetricModel(next(solids), tuple(m.joined)) for m in header.metric}
    artmap = _memory(header, parameters, arrays)
    _check_parts(header, views, metric, artmap)
    return _named_by_rings(Model(_library(header.library), parameters, views, artmap, metric))


def _named_by_rings(model: Model) -> Model:
    """Give the facets with arcs of an earlier release, named `arc90`, today's names; learn its views again."""
    measured = [view.solid for view in model.views if view.solid is not None]
    solids = [*measured, *(one.solid for one in model.metric.values())]
    if not any(EARLIER_ARC.fullmatch(one.types[arc.facet]) for one in solids for arc in one.arcs):
        return model
    named = {id(one): with_types_of_arcs(one, model.library) for one in solids}
    views = tuple(v if v.solid is None else replace(v, solid=named[id(v.solid)]) for v in model.views)
    metric = {label: replace(one, solid=named[id(one.solid)]) for label, one in model.metric.items()}
    return relearnt(replace(model, views=views, metric=metric))


def _memory(header: _ModelHeader, parameters: MemorySettings, arrays: Arrays) -> RelationARTMAP:
    relations, counts = np.asarray(arrays["relations"], np.intp), np.asarray(arrays["counts"], np.int64)
    size = len(counts), 1 + FEATURES, header.matrix_size, header.matrix_size
    if relations.shape != (len(relations), 3) or not all(
        arrays[name].shape == (len(relations), 1 + FEATURES) for name in ("lower", "upper")
    ):
        raise ValueError(f"nodes: expected {1 + FEATURES} values of each relation, found {arrays['lower'].shape}")
    if len(relations) and not ((relations >= 0).all() and (relations < [size[0], size[2], size[3]]).all()):
        raise ValueError("nodes: a relation of a node or slot that does not exist")
    _bounded(len(counts), header.matrix_size)
    lower, upper = np.zeros((2, *size))
    for end, name in ((lower, "lower"), (upper, "upper")):
        end[relations[:, 0], :, relations[:, 1], relations[:, 2]] = arrays[name]
    labels = tuple(header.parts) if len(counts) else ()
    return RelationARTMAP(lower, upper, counts, labels, parameters.rho, parameters.alpha, parameters.beta)


def _bounded(nodes: int, slots: int) -> None:
    """Check that the matrices of so many nodes fit into memory. Raises ValueError."""
    if 2 * 8 * nodes * (1 + FEATURES) * slots**2 > LARGEST_MEMORY:
        raise ValueError(f"nodes: {nodes} of {slots} slots need more than {LARGEST_MEMORY // 1_000_000} MB")


def _first_model(header: _FirstHeader, arrays: Arrays) -> Model:
    """Convert a file of version 1: learn its views again; shapes stay as they are."""
    given = {name: float(value) for name, value in header.parameters.items() if name != "complement"}
    parameters = MemorySettings(**{**given, "vigilance": MemorySettings().vigilance})  # version 1 did not use it

    def solid(name: str, shape: _SolidHeader) -> Polyhedron:
        corners, covariance = arrays[f"{name}_corners_mm"], arrays[f"{name}_covariance_mm2"]
        return _solid(name, shape, np.asarray(corners, float), np.asarray(covariance, float))

    views = tuple(
        TaughtView(v.label, (-1,) * len(v.solid.facets), v.node, (), v.source, solid(f"view{i}", v.solid))
        for i, v in enumerate(header.views)
    )
    metric = {m.label: MetricModel(solid(f"metric{i}", m.solid), tuple(m.joined)) for i, m in enumerate(header.metric)}
    _check_labels(header, views)
    _bounded(len(views), max((len(view.sides) for view in views), default=0))
    return relearnt(Model(_library(header.library), parameters, views, metric=metric))


def _check_labels(header: _AnyHeader, views: tuple[TaughtView, ...]) -> None:
    """Check that views and parts have the same labels, each part once. Raises ValueError."""
    known = {metric.label for metric in header.metric}
    if {view.label for view in views} != known or len(header.metric) != len(known) or known != set(header.parts):
        raise ValueError("its views and its parts have different labels")


def _check_parts(
    header: _ModelHeader, views: tuple[TaughtView, ...], metric: dict[str, MetricModel], artmap: RelationARTMAP
) -> None:
    """Check that views, parts and nodes fit each other, before a look fails on it. Raises ValueError."""
    _check_labels(header, views)
    for view in views:
        facets = len(view.sides if view.solid is None else view.solid.facets)
        most, least = len(metric[view.label].solid.facets), 0 if view.solid is None else -1
        if (
            len(view.sides) != facets
            or not len(view.slots) == len(set(view.slots)) == facets
            or not all(least <= side < most for side in view.sides)
            or not all(0 <= slot < artmap.slots for slot in view.slots)
            or not 0 <= view.node < len(artmap.lower)
        ):
            raise ValueError(f"{view.label}: a view's pattern does not match its facets")
    if any(not 0 <= k < len(views) for m in metric.values() for k in m.joined):
        raise ValueError("a part is made of a view that does not exist")


def _solid(name: str, header: _SolidHeader, corners: Array, covariance: Array) -> Polyhedron:
    if corners.shape != (len(corners), 3) or covariance.shape != (len(corners), 3, 3):
        raise ValueError(f"{name}: corners {corners.shape}, covariance {covariance.shape}")
    facets = tuple(tuple(f) for f in header.facets)
    if any(not 0 <= k < len(corners) for f in (*facets, *header.smooth) for k in f):
        raise ValueError(f"{name}: a facet names a corner that does not exist")
    if len(facets) < 2 or any(len(set(f)) < 3 for f in facets) or len(header.types) != len(facets):
        raise ValueError(f"{name}: fewer than two facets, or one without three corners or a type")
    if any((corners[list(f)] == corners[[*f[1:], f[0]]]).all(axis=1).any() for f in facets):
        raise ValueError(f"{name}: a facet with two neighbouring corners at one place")
    if not (np.abs(corners).max(initial=0.0) <= LARGEST_MM and np.abs(covariance).max(initial=0.0) <= LARGEST_MM**2):
        raise ValueError(f"{name}: corners, or their uncertainty, beyond {LARGEST_MM:g} mm")
    if len(corners) and np.linalg.eigvalsh(covariance).min() < -1e-6:
        raise ValueError(f"{name}: a covariance that is not positive semi-definite")
    covers = np.array(header.covers, float).reshape(-1, 4, 3)
    if not np.abs(covers).max(initial=0.0) <= LARGEST_MM:
        raise ValueError(f"{name}: a curved surface beyond {LARGEST_MM:g} mm")
    holes = tuple(Hole(one.facet, _round(name, one.facet, one.ring_mm, len(facets))) for one in header.holes)
    arcs = tuple(OutlineArc(one.facet, _round(name, one.facet, one.points_mm, len(facets))) for one in header.arcs)
    return Polyhedron(corners, facets, covariance, tuple(header.types), frozenset(header.smooth), covers, holes, arcs)


def _round(name: str, facet: int, along_mm: list[tuple[float, float, float]], facets: int) -> Array:
    """(N, 3) points along a hole's rim or an arc of one of so many facets. Raises ValueError."""
    points = np.array(along_mm, float).reshape(-1, 3)
    if not 0 <= facet < facets or len(points) < 3 or not np.abs(points).max() <= LARGEST_MM:
        raise ValueError(f"{name}: a hole or arc of no facet, of fewer than three points or beyond {LARGEST_MM:g} mm")
    return points


def _counted_codes(labels: tuple[str, ...]) -> dict[str, str]:
    """ART-b bits by order of teaching: 001, 010, ... (three bits, more where there are more parts)."""
    width = max(3, len(labels).bit_length())
    return {label: format(i + 1, f"0{width}b") for i, label in enumerate(labels)}


def checksum_of(header: dict[str, Any], arrays: Arrays) -> str:
    """sha256 over the header (without its checksum) and every array: name, type, shape and bytes."""
    digest = hashlib.sha256(canonical_header(header))
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        digest.update(f"{name} {array.dtype.str} {array.shape}".encode())
        digest.update(array.tobytes())
    return digest.hexdigest()


def canonical_header(header: dict[str, Any]) -> bytes:
    """A header as its checksum has it: JSON with sorted keys, without blanks."""
    return json.dumps(header, sort_keys=True, separators=(",", ":"), ensure_ascii=False).encode()
