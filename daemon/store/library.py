"""Read etc/facets.yaml and etc/parts.yaml: the facet library, and the parts' names and grasps."""

import hashlib
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from msgspec import Meta

from daemon.quantities import Length
from daemon.store.folders import ETC
from daemon.store.yamlfile import Document, read
from daemon.vision.model import LARGEST_NUMBER, FacetLibrary, FacetType, Value

FACETS = ETC / "facets.yaml"
PARTS = ETC / "parts.yaml"


class _Tolerance(msgspec.Struct, forbid_unknown_fields=True):
    angle_deg: Annotated[float, Meta(gt=0, lt=90)]
    ratio: Annotated[float, Meta(gt=0, lt=1)]


class _Facet(msgspec.Struct, forbid_unknown_fields=True):
    name: str
    type_number: Annotated[float, Meta(gt=0, lt=LARGEST_NUMBER)]
    angles_deg: list[Annotated[float, Meta(gt=0, lt=360)] | str]
    side_ratios: list[Annotated[float, Meta(gt=0, le=1e6)] | str]


class _Facets(msgspec.Struct, forbid_unknown_fields=True):
    version: Literal[1]
    tolerance: _Tolerance
    facets: list[_Facet]


class Grasp(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """How a part should be grasped, as a person wrote it; lengths in mm."""

    width_mm: Length | None = None
    along: str | None = None


class PartEntry(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """One named part: its name for people, its ART-b code, hints for the gripper."""

    name: str
    code: str
    grasp: Grasp = Grasp()


class _Parts(msgspec.Struct, forbid_unknown_fields=True):
    version: Literal[1]
    parts: dict[str, PartEntry]


def load_facets(path: Path = FACETS) -> FacetLibrary:
    """Read and check facets.yaml. Raises ConfigError."""
    document = read(path)
    file = document.convert(_Facets)
    types = tuple(_facet_type(document, i, f) for i, f in enumerate(file.facets))
    values: dict[str, list[object]] = {"name": [t.name for t in types], "type_number": [t.number for t in types]}
    for key, seen in values.items():
        for i, value in enumerate(seen):
            if value in seen[:i]:
                first = types[seen.index(value)].name
                raise document.error(("facets", i, key), f"{value} is already that of {first}")
    return FacetLibrary(types, float(np.deg2rad(file.tolerance.angle_deg)), file.tolerance.ratio)


def load_parts(path: Path = PARTS) -> dict[str, PartEntry]:
    """Read and check parts.yaml: {label: entry}. Raises ConfigError."""
    document = read(path)
    file = document.convert(_Parts)
    codes: dict[str, str] = {}
    for label, entry in file.parts.items():
        if not entry.code or set(entry.code) - {"0", "1"}:
            raise document.error(("parts", label, "code"), f"expected zeros and ones, found {entry.code!r}")
        if entry.code in codes:
            raise document.error(("parts", label, "code"), f"{entry.code} is already that of {codes[entry.code]}")
        codes[entry.code] = label
    return file.parts


def library_digest(library: FacetLibrary) -> str:
    """sha256 of the library's content, the same on every machine."""
    return hashlib.sha256(msgspec.json.encode(library_plain(library))).hexdigest()


def library_plain(library: FacetLibrary) -> dict[str, Any]:
    """The library as plain JSON values."""
    return {
        "angle_tolerance_rad": library.angle_tolerance_rad,
        "ratio_tolerance": library.ratio_tolerance,
        "types": [[t.name, t.number, list(t.angles_rad), list(t.ratios)] for t in library.types],
    }


def _facet_type(document: Document, index: int, facet: _Facet) -> FacetType:
    if len(facet.angles_deg) < 3 or len(facet.angles_deg) != len(facet.side_ratios):
        raise document.error(
            ("facets", index, "side_ratios"),
            f"expected as many as angles and at least 3, found {len(facet.side_ratios)} and {len(facet.angles_deg)}",
        )
    angles: tuple[Value, ...] = tuple(a if isinstance(a, str) else float(np.deg2rad(a)) for a in facet.angles_deg)
    fixed = [a for a in angles if not isinstance(a, str)]
    if len(fixed) == len(angles) and abs(sum(fixed) - np.pi * (len(angles) - 2)) > 0.01:
        total = 180 * (len(angles) - 2)
        raise document.error(("facets", index, "angles_deg"), f"expected a sum of {total} for {len(angles)} sides")
    return FacetType(facet.name, facet.type_number, angles, tuple(facet.side_ratios))
