"""The trained model on disk: one .npz of plain arrays with a JSON header. Never pickled.

In: a path and a Model. Out: the same Model, or a ModelError that says what is wrong and where. What a model means is
said in daemon/vision/model/model.py.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np
from msgspec import Meta

from daemon.art import ArtError, FuzzyARTMAP
from daemon.store.files import write_atomically
from daemon.store.library import library_digest, library_plain
from daemon.store.npz import ArchiveError, Arrays, one_line, pack, unpack
from daemon.store.outside import FileError, read_file
from daemon.vision.geometry import Polyhedron
from daemon.vision.model import LARGEST_NUMBER, FacetLibrary, FacetType, MetricModel, Model, Parameters, TaughtView

FORMAT = "facetd-model"
VERSION = 1
LARGEST_MM = 1e5
"""From a part's middle; its corners are known to a fraction of a millimetre."""
LARGEST_FILE = 8_000_000
LARGEST_UNFOLDED = 64_000_000
"""Bytes of all arrays together. Ten parts of ten views each are 0.4 MB."""


class ModelError(FileError):
    """A model file cannot be used, or not be written: the message is one line, path first, then what is wrong."""


class _SolidHeader(msgspec.Struct, forbid_unknown_fields=True):
    facets: list[list[int]]
    types: list[str]


class _ViewHeader(msgspec.Struct, forbid_unknown_fields=True):
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


class _Header(msgspec.Struct, forbid_unknown_fields=True):
    format: str
    version: int
    trained: str
    parameters: dict[str, Annotated[float, Meta(ge=0, le=1000)] | bool]
    matrix_size: Annotated[int, Meta(ge=0, le=1000)]
    parts: list[str]
    codes: dict[str, str]
    library: _LibraryHeader
    views: list[_ViewHeader]
    metric: list[_MetricHeader]
    sha256: str


@dataclass(frozen=True, eq=False)
class ModelFile:
    """A model with what the file says about its making: trained (ISO UTC, or empty), codes {label: ART-b bits}."""

    model: Model
    trained: str
    codes: dict[str, str]
    sha256: str


def save(model: Model, path: Path, *, trained: str = "", codes: dict[str, str] | None = None) -> None:
    """Write the model so that a power cut leaves the old file or the new one. Raises ModelError.

    trained: when and by whom, for people; codes: each part's ART-b bits.
    """
    content = to_bytes(model, trained=trained, codes=codes)
    try:
        write_atomically(path, content)
    except OSError as error:
        raise ModelError(f"{path}: cannot be written: {error.strerror}") from None


def load(path: Path) -> Model:
    """The model in a file. FileError: it cannot be read; ModelError: it is cut short, altered, foreign or newer."""
    return load_file(path).model


def load_file(path: Path) -> ModelFile:
    """As `load`, with what the file says about its making."""
    content = read_file(path, LARGEST_FILE)
    try:
        return from_bytes(content)
    except ModelError as error:
        raise ModelError(f"{path}: {error}") from None


def to_bytes(model: Model, *, trained: str = "", codes: dict[str, str] | None = None) -> bytes:
    """The file's content; the same model gives the same bytes."""
    arrays = _arrays(model)
    header = {
        "format": FORMAT,
        "version": VERSION,
        "trained": trained,
        "parameters": asdict(model.parameters),
        "matrix_size": model.matrix_size,
        "parts": list(model.labels),
        "codes": codes if codes is not None else _counted_codes(model.labels),
        "library": {**_library_header(model.library), "sha256": library_digest(model.library)},
        "views": [_view_header(v) for v in model.views],
        "metric": [
            {"label": label, "solid": _solid_header(m.solid), "joined": list(m.joined)}
            for label, m in model.metric.items()
        ],
    }
    header["sha256"] = _checksum(header, arrays)
    arrays["header"] = np.frombuffer(_canonical(header), dtype=np.uint8)
    return pack(arrays)


def from_bytes(content: bytes) -> ModelFile:
    """Check and read a file's content. Raises ModelError without the path."""
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
        raise ModelError("not a facetd model: its header does not say so")
    if plain.get("version") != VERSION:
        raise ModelError(
            f"version {plain.get('version')!r:.40}, this facetd reads version {VERSION}: train anew or update"
        )
    told = plain.pop("sha256", None)
    if told != _checksum(plain, arrays):
        raise ModelError("altered or damaged: its checksum does not fit its content")
    try:
        header = msgspec.convert({**plain, "sha256": told}, _Header)
        return ModelFile(_model(header, arrays), header.trained, header.codes, str(told))
    except (msgspec.ValidationError, ArtError, ArithmeticError, LookupError, TypeError, ValueError) as error:
        raise ModelError(f"does not hold together: {one_line(error)}") from None


def _arrays(model: Model) -> Arrays:
    found: Arrays = dict(model.artmap.state()) if model.artmap is not None else {}
    for i, view in enumerate(model.views):
        found |= _solid_arrays(f"view{i}", view.solid)
        found[f"view{i}_numbers"] = view.numbers
        found[f"view{i}_touching"] = view.touching
    for i, metric in enumerate(model.metric.values()):
        found |= _solid_arrays(f"metric{i}", metric.solid)
    return found


def _solid_arrays(name: str, solid: Polyhedron) -> Arrays:
    return {f"{name}_corners_mm": solid.corners_mm, f"{name}_covariance_mm2": solid.covariance_mm2}


def _solid_header(solid: Polyhedron) -> dict[str, Any]:
    return {"facets": [list(f) for f in solid.facets], "types": list(solid.types)}


def _view_header(view: TaughtView) -> dict[str, Any]:
    return {"label": view.label, "solid": _solid_header(view.solid), "node": view.node, "source": view.source}


def _library_header(library: FacetLibrary) -> dict[str, Any]:
    plain = library_plain(library)
    names = ("name", "number", "angles_rad", "ratios")
    return {**plain, "types": [dict(zip(names, t, strict=True)) for t in plain["types"]]}


def _model(header: _Header, arrays: Arrays) -> Model:
    if any(len(t.angles_rad) < 3 or len(t.angles_rad) != len(t.ratios) for t in header.library.types):
        raise ValueError("a facet type of other ratios than angles, or fewer than three")
    types = tuple(FacetType(t.name, t.number, tuple(t.angles_rad), tuple(t.ratios)) for t in header.library.types)
    library = FacetLibrary(types, header.library.angle_tolerance_rad, header.library.ratio_tolerance)
    parameters = Parameters(**header.parameters)  # type: ignore[arg-type]
    views = tuple(
        TaughtView(
            v.label,
            _solid(f"view{i}", v.solid, arrays),
            np.asarray(arrays[f"view{i}_numbers"], float),
            np.asarray(arrays[f"view{i}_touching"], bool),
            v.node,
            v.source,
        )
        for i, v in enumerate(header.views)
    )
    artmap = None
    if views:
        p = parameters
        artmap = FuzzyARTMAP(p.rho, p.alpha, p.beta, complement=p.complement)
        artmap.restore({name: arrays[name] for name in ("weights", "map_counts")}, header.parts)
        wanted = header.matrix_size**2 * (2 if p.complement else 1)
        if arrays["weights"].shape[1] != wanted:
            raise ValueError(f"weights: expected {wanted} a node, found {arrays['weights'].shape[1]}")
    metric = {
        m.label: MetricModel(_solid(f"metric{i}", m.solid, arrays), tuple(m.joined))
        for i, m in enumerate(header.metric)
    }
    _check_parts(header, views, 0 if artmap is None else len(arrays["weights"]))
    return Model(library, parameters, views, artmap, header.matrix_size, metric)


def _check_parts(header: _Header, views: tuple[TaughtView, ...], nodes: int) -> None:
    """Raises ValueError where views, parts and nodes do not belong to each other: each look would find it out."""
    known = {metric.label for metric in header.metric}
    if {view.label for view in views} != known or len(header.metric) != len(known) or known != set(header.parts):
        raise ValueError("its views are of other parts than those that it knows")
    for view in views:
        facets = len(view.solid.facets)
        if view.numbers.shape != (facets,) or view.touching.shape != (facets, facets) or not 0 <= view.node < nodes:
            raise ValueError(f"{view.label}: a view's pattern is not one of its facets")
    if any(not 0 <= k < len(views) for metric in header.metric for k in metric.joined):
        raise ValueError("a part is made of a view that is not there")


def _solid(name: str, header: _SolidHeader, arrays: Arrays) -> Polyhedron:
    corners = np.asarray(arrays[f"{name}_corners_mm"], float)
    covariance = np.asarray(arrays[f"{name}_covariance_mm2"], float)
    if corners.shape != (len(corners), 3) or covariance.shape != (len(corners), 3, 3):
        raise ValueError(f"{name}: corners {corners.shape}, covariance {covariance.shape}")
    facets = tuple(tuple(f) for f in header.facets)
    if any(not 0 <= k < len(corners) for f in facets for k in f):
        raise ValueError(f"{name}: a facet names a corner that is not there")
    if len(facets) < 2 or any(len(set(f)) < 3 for f in facets) or len(header.types) != len(facets):
        raise ValueError(f"{name}: fewer than two facets, or one without three corners or a type")
    if not (np.abs(corners).max(initial=0.0) <= LARGEST_MM and np.abs(covariance).max(initial=0.0) <= LARGEST_MM**2):
        raise ValueError(f"{name}: corners, or what is not known of them, beyond {LARGEST_MM:g} mm")
    if len(corners) and np.linalg.eigvalsh(covariance).min() < -1e-6:
        raise ValueError(f"{name}: a covariance below nothing")
    return Polyhedron(corners, facets, covariance, tuple(header.types))


def _counted_codes(labels: tuple[str, ...]) -> dict[str, str]:
    """ART-b bits by order of teaching: 001, 010, ... (three bits, more where there are more parts)."""
    width = max(3, len(labels).bit_length())
    return {label: format(i + 1, f"0{width}b") for i, label in enumerate(labels)}


def _checksum(header: dict[str, Any], arrays: Arrays) -> str:
    """sha256 over the header (without its checksum) and every array: name, type, shape and bytes."""
    digest = hashlib.sha256(_canonical(header))
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        digest.update(f"{name} {array.dtype.str} {array.shape}".encode())
        digest.update(array.tobytes())
    return digest.hexdigest()


def _canonical(header: dict[str, Any]) -> bytes:
    return json.dumps(header, sort_keys=True, separators=(",", ":"), ensure_ascii=False).encode()
