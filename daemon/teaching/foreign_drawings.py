"""Convert drawings that facetd does not read itself (PLY, 3MF, STEP) into an OBJ file in mm, by the extra
`drawings`.

The OBJ is what is kept and learned from: a daemon without the extra trains on it as well. STEP's curved surfaces come
out cut into strips, as they do from a program that writes STL.
"""

import io
import zipfile
from typing import Any

import numpy as np

from daemon.teaching.mesh import UNITS_MM, MeshError

KINDS = {"ply": None, "3mf": "3mf", "step": "step", "stp": "step"}
"""File name endings; and the rules by which such a file gives its unit, None where it gives none."""
EXTRA = "facetd[drawings]"
LARGEST_UNPACKED = 64_000_000
"""Size limit of an unpacked 3MF, which is a zip archive, in bytes."""
STRIP_RAD = 0.25
"""Turn from strip to strip of a STEP's curved surfaces: half of what curved_surfaces.py needs."""
MM_IN = {"millimeter": 1.0, "meter": 1000.0, "meters": 1000.0, "centimeter": 10.0, "micron": 0.001, "inch": 25.4,
         "foot": 304.8}  # fmt: skip


def in_own_format(name: str, content: bytes, unit: str) -> tuple[str, bytes, str]:
    """A drawing in a format of facetd: name, content and unit; STL and OBJ unchanged. Raises MeshError."""
    kind = name.lower().rpartition(".")[2]
    if kind not in KINDS:
        return name, content, unit
    corners, triangles, own = _read(name, kind, content)
    if KINDS[kind] is not None and own not in MM_IN:
        raise MeshError(f"{name}: its unit is {str(own)[:20]!r}; export it in mm")
    scale = UNITS_MM[unit] if KINDS[kind] is None else MM_IN[str(own)]
    lines = [f"# {kind} read by trimesh, in mm"]
    lines += [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in (corners * scale).tolist()]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in triangles.tolist()]
    return f"{name}.obj", "\n".join(lines).encode(), "mm"


def _read(name: str, kind: str, content: bytes) -> tuple[Any, Any, str | None]:
    """Corners (K, 3) in the file's unit, triangles (T, 3), and the name of the unit in the file."""
    try:
        import trimesh
    except ImportError:
        raise MeshError(f"{name}: to read .{kind} facetd needs its extra: pip install '{EXTRA}'") from None
    if kind == "3mf":
        _check_archive(name, content)
    options: dict[str, Any] = {"tol_angular": STRIP_RAD} if KINDS[kind] == "step" else {}
    try:
        scene = trimesh.load_scene(io.BytesIO(content), file_type=KINDS[kind] or kind, process=False, **options)
        mesh = scene.to_mesh()
        corners, triangles = np.asarray(mesh.vertices, float), np.asarray(mesh.faces)
    except ImportError as error:
        raise MeshError(f"{name}: {error.name or error} is missing: pip install '{EXTRA}'") from None
    except Exception as error:  # whatever a reader of somebody else's does with a file that is none of its kind
        raise MeshError(f"{name}: no {kind.upper()} that trimesh can read: {_one_line(error)}") from None
    if not len(triangles):
        raise MeshError(f"{name}: contains no facet")
    return corners, triangles, scene.units


def _check_archive(name: str, content: bytes) -> None:
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            size = sum(one.file_size for one in archive.infolist())
    except (zipfile.BadZipFile, ValueError, NotImplementedError, EOFError):
        raise MeshError(f"{name}: no 3MF: not a zip archive, or a damaged one") from None
    if size > LARGEST_UNPACKED:
        raise MeshError(f"{name}: unfolds to {size / 1e6:.0f} MB; at most {LARGEST_UNPACKED / 1e6:.0f}")


def _one_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0][:120]
