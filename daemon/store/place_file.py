"""places.yaml: where each part belongs. Fixtures, places, and patterns of places, as people write them and `place
teach` keeps them.

In: the file in the state folder. Out: frozen values with every place in the world, or a ConfigError that names file,
line and key. A cell without the file has no places: its parts go to the bin. How a place is on the disk once parts come
to it is place_status.py's.
"""

import os
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import yaml
from msgspec import Meta

from daemon import frames
from daemon.arrays import Array
from daemon.quantities import Coordinate, Direction, Length
from daemon.store.files import failing_as, write_atomically
from daemon.store.outside import FileError
from daemon.store.yamlfile import Document, Key, read

FILE = "places.yaml"
"""File name in the state folder."""
NAME = re.compile(r"[a-z][a-z0-9_]{0,29}")
BIN = "bin"
"""The name that a job uses for the bin."""
MAX_PLACES = 1000
RESIDUAL_MM = 2.0
"""Largest distance, mm, of a pattern's fourth corner from where the other three put it."""
SQUARE_DEG = 5.0
"""Largest angle, degrees, of the two directions of a pattern from a right angle before that counts as a mistake."""

Point = tuple[Coordinate, Coordinate, Coordinate]
Row4 = tuple[float, float, float, float]
Matrix = tuple[Row4, Row4, Row4, Row4]
Release = Annotated[float, Meta(ge=0, le=20)]
Tolerance = Annotated[float, Meta(gt=0, le=50)]
Side = Annotated[int, Meta(ge=1, le=500)]
Count = Annotated[int, Meta(ge=1, le=100)]


@dataclass(frozen=True, kw_only=True)
class SolidBox:
    """A box of a fixture that arm and gripper keep away from. The space between boxes is open: that is where a part
    enters."""

    low_mm: Point
    """Lowest corner, frame of the fixture, mm."""
    high_mm: Point
    """Highest corner, frame of the fixture, mm."""


@dataclass(frozen=True, kw_only=True)
class FixtureEntry:
    """Something that holds parts: its frame, z up, and its boxes."""

    point_mm: Point = (0.0, 0.0, 0.0)
    """Origin of its frame, world frame, mm."""
    heading_deg: Direction = 0.0
    """Direction of its x, degrees from world x."""
    solid: tuple[SolidBox, ...] = ()
    """Boxes that it is made of."""

    @property
    def world_from_fixture(self) -> Array:
        """(4, 4) mm."""
        return frames.rigid(about_vertical(self.heading_deg), np.array(self.point_mm))


@dataclass(frozen=True, kw_only=True)
class PlaceSettings:
    """How a part comes to lie at a place, or at each place of a pattern."""

    part: str
    """Label of the part."""
    fixture: str | None = None
    """Fixture in whose frame the place is given. Unset: the world."""
    tolerance_mm: Tolerance = 1.0
    """How far a part may lie from its place, mm."""
    tolerance_deg: Tolerance = 1.0
    """How far a part may be turned from its place, degrees."""
    equivalents: bool = True
    """Whether a part may be turned so that it looks the same."""
    any_turn: bool = False
    """Whether a part may be turned any way about the vertical."""
    approach_mm: Length = 60.0
    """Height over the place from which the part is lowered straight, mm."""
    release_mm: Release = 0.5
    """Height over its support at which the gripper opens, mm."""


@dataclass(frozen=True, kw_only=True)
class PlaceEntry(PlaceSettings):
    """One place: the pose of the part; or which side is down, where, and how it is turned."""

    pose: Matrix | None = None
    """fixture_from_part, or world_from_part where no fixture is given, rows of a 4x4, mm."""
    side_down: Side | None = None
    """Number of the side that is down, from 1 (`place show` lists the sides of a part)."""
    point_mm: Point | None = None
    """Where the middle of that side is, mm."""
    heading_deg: Direction = 0.0
    """Direction of the first edge of that side, degrees from x."""


@dataclass(frozen=True, kw_only=True)
class PatternEntry(PlaceSettings):
    """A grid of places: three corners and the number of rows and columns; a fourth corner is a check. Each corner may
    be the name of a place in this file, as `place teach` stores it: the pattern then replaces that place."""

    first: Matrix | str
    """Pose of the part in the first place, as `pose` of a place; or the name of a place."""
    row_end_mm: Point | str
    """Where the origin of the part is in the last place of the first row, mm; or the name of a place."""
    column_end_mm: Point | str
    """Where the origin of the part is in the last place of the first column, mm; or the name of a place."""
    check_mm: Point | str | None = None
    """Where it is in the place opposite of the first: compared with what the other three say, mm; or the name of a
    place."""

    @property
    def corners(self) -> dict[str, str]:
        """The places that it uses as corners, by key."""
        keys = ("first", "row_end_mm", "column_end_mm", "check_mm")
        return {key: value for key in keys if isinstance(value := getattr(self, key), str)}

    columns: Count
    """Places in a row."""
    rows: Count
    """Rows."""
    layers: Count = 1
    """Layers on top of one another."""
    layer_mm: Length | None = None
    """Distance from layer to layer, mm."""
    order: Literal["rows", "columns", "snake"] = "rows"
    """Row by row, column by column, or row by row with every second row backwards; layer by layer."""
    skip: tuple[Annotated[int, Meta(ge=1, le=MAX_PLACES)], ...] = ()
    """Numbers of places that stay empty, counted from 1 in that order."""


@dataclass(frozen=True, kw_only=True)
class PlacesFile:
    """The file's version and its sections."""

    version: Literal[1]
    """Version of the file's format."""
    fixtures: dict[str, FixtureEntry] = field(default_factory=dict)
    places: dict[str, PlaceEntry] = field(default_factory=dict)
    patterns: dict[str, PatternEntry] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Place:
    """Where a part belongs, in the world. name: those of a pattern are `tray.1` and so on; settings: its entry in the
    file; world_from_frame (4, 4) mm: of its fixture; on_top_of: the place in the layer below.

    frame_from_part (4, 4) mm, or None where side_down, point_mm and heading_deg say it: that needs the part's shape
    (daemon/pick/planning/place_goals.py).
    """

    name: str
    settings: PlaceSettings
    world_from_frame: Array
    frame_from_part: Array | None = None
    side_down: int | None = None
    point_mm: Point | None = None
    heading_deg: float = 0.0
    on_top_of: str | None = None

    @property
    def part(self) -> str:
        return self.settings.part


@dataclass(frozen=True, eq=False)
class Fixture:
    """A fixture in the world: name, world_from_fixture (4, 4) mm, its boxes in its own frame."""

    name: str
    entry: FixtureEntry


@dataclass(frozen=True, eq=False)
class CellPlaces:
    """The content of the file. places: in the order in which they are filled; residuals_mm: distance of each pattern's
    fourth corner, where given, from where the other three put it."""

    file: PlacesFile = field(default_factory=lambda: PlacesFile(version=1))
    places: tuple[Place, ...] = ()
    fixtures: tuple[Fixture, ...] = ()
    residuals_mm: Mapping[str, float] = field(default_factory=dict)

    def of(self, label: str, name: str | None = None) -> tuple[Place, ...]:
        """The places of a part, of one place or pattern if `name` is given; a part without one goes to the bin."""
        of_part = (place for place in self.places if place.part == label)
        return tuple(p for p in of_part if name is None or name in (p.name, pattern_of(p.name)))

    def named(self, name: str) -> Place | None:
        return next((place for place in self.places if place.name == name), None)


def pattern_of(name: str) -> str:
    """`tray` of `tray.3`; the name itself of a place outside of patterns."""
    return name.partition(".")[0]


def load_places(path: Path) -> CellPlaces:
    """Read and check the file; a missing file has no places. Raises ConfigError, FileError."""
    if not os.path.lexists(path):
        return CellPlaces()
    document = read(path)
    file = document.convert(PlacesFile)
    _check_names(document, file)
    places: list[Place] = []
    residuals_mm: dict[str, float] = {}
    corners = {name for pattern in file.patterns.values() for name in pattern.corners.values()}
    for name, entry in file.places.items():
        place = _place(document, file, name, entry)
        places += [] if name in corners else [place]
    for name, pattern in file.patterns.items():
        of_pattern, off_mm = _pattern(document, file, name, pattern)
        places += of_pattern
        if off_mm is not None:
            residuals_mm[name] = off_mm
    if len(places) > MAX_PLACES:
        raise document.error((), f"expected at most {MAX_PLACES} places, found {len(places)}")
    fixtures = tuple(Fixture(name, entry) for name, entry in file.fixtures.items())
    return CellPlaces(file, tuple(places), fixtures, residuals_mm)


def with_place(places: CellPlaces, name: str, entry: PlaceEntry) -> PlacesFile:
    """The file with a place added or replaced."""
    return replace(places.file, places={**places.file.places, name: entry})


def without_place(places: CellPlaces, name: str) -> PlacesFile:
    """The file without a place or pattern."""
    file = places.file
    return replace(
        file,
        places={key: entry for key, entry in file.places.items() if key != name},
        patterns={key: entry for key, entry in file.patterns.items() if key != name},
    )


def write_places(path: Path, file: PlacesFile) -> None:
    """Write the file; comments in it are lost. Raises FileError."""
    with failing_as(FileError, f"{path}: not kept"):
        write_atomically(path, yaml.safe_dump(_plain(file), sort_keys=False).encode())


def about_vertical(heading_deg: float) -> Array:
    """(3, 3) rotation about the vertical."""
    return frames.rotation_from_vector(np.array([0.0, 0.0, np.radians(heading_deg)]))


def _plain(value: Any) -> Any:
    """A structure of the file as YAML values, without keys that have their default."""
    if hasattr(value, "__dataclass_fields__"):
        default = {name: f.default for name, f in value.__dataclass_fields__.items()}
        values = {name: getattr(value, name) for name in default}
        return {name: _plain(v) for name, v in values.items() if v != default[name] and v not in ({}, ())}
    if isinstance(value, Mapping):
        return {key: _plain(v) for key, v in value.items()}
    return [_plain(v) for v in value] if isinstance(value, tuple | list) else value


def _check_names(document: Document, file: PlacesFile) -> None:
    for section in ("fixtures", "places", "patterns"):
        for name in getattr(file, section):
            if not NAME.fullmatch(name):
                problem = "expected a name of small letters, digits and _, as in nest_2"
                raise document.error((section, name), problem)
            if name == BIN:
                raise document.error((section, name), "expected another name: parts without a place go to the bin")
            if section == "patterns" and name in file.places:
                raise document.error((section, name), "a place has this name already")
    for name, fixture in file.fixtures.items():
        for number, box in enumerate(fixture.solid):
            if any(low >= high for low, high in zip(box.low_mm, box.high_mm, strict=True)):
                keys: tuple[Key, ...] = ("fixtures", name, "solid", number)
                raise document.error(keys, "expected low_mm below high_mm along each axis")


def _frame(document: Document, file: PlacesFile, keys: tuple[Key, ...], entry: PlaceSettings) -> Array:
    if entry.fixture is None:
        return np.eye(4)
    if entry.fixture not in file.fixtures:
        known = ", ".join(file.fixtures) or "none"
        raise document.error((*keys, "fixture"), f"expected a fixture of this file ({known}), found {entry.fixture}")
    return file.fixtures[entry.fixture].world_from_fixture


def _rigid(document: Document, keys: tuple[Key, ...], rows: Matrix) -> Array:
    matrix = np.array(rows, float)
    wrong = frames.not_rigid(matrix)
    if wrong is not None:
        raise document.error(keys, f"expected the pose of a part, a 4x4 in mm: {wrong}")
    return frames.rigid(frames.nearest_rotation(matrix[None, :3, :3])[0], matrix[:3, 3])


def _place(document: Document, file: PlacesFile, name: str, entry: PlaceEntry) -> Place:
    keys: tuple[Key, ...] = ("places", name)
    frame = _frame(document, file, keys, entry)
    if entry.pose is not None:
        if entry.side_down is not None or entry.point_mm is not None:
            raise document.error(keys, "expected either pose, or side_down and point_mm, found both")
        return Place(name, entry, frame, _rigid(document, (*keys, "pose"), entry.pose))
    if entry.side_down is None or entry.point_mm is None:
        raise document.error(keys, "expected pose, or side_down and point_mm")
    return Place(name, entry, frame, None, entry.side_down, entry.point_mm, entry.heading_deg)


def _pattern(document: Document, file: PlacesFile, name: str, entry: PatternEntry) -> tuple[list[Place], float | None]:
    keys: tuple[Key, ...] = ("patterns", name)
    frame = _frame(document, file, keys, entry)
    first = _corner_pose(document, file, name, "first", entry.first)
    along_row = _corner(document, file, name, "row_end_mm", entry.row_end_mm) - first[:3, 3]
    along_column = _corner(document, file, name, "column_end_mm", entry.column_end_mm) - first[:3, 3]
    _check_grid(document, keys, entry, along_row, along_column)
    off = None
    if entry.check_mm is not None:
        fourth = _corner(document, file, name, "check_mm", entry.check_mm)
        off = float(np.linalg.norm(first[:3, 3] + along_row + along_column - fourth))
        if off > RESIDUAL_MM:
            problem = f"{off:.1f} mm from where the other three corners put it, {RESIDUAL_MM:g} at most"
            raise document.error((*keys, "check_mm"), problem)
    places: list[Place] = []
    named: dict[tuple[int, int, int], str] = {}
    for number, (layer, row, column) in enumerate(_cells(entry), start=1):
        if number in entry.skip:
            continue
        pose = first.copy()
        pose[:3, 3] += along_row * _share(column, entry.columns) + along_column * _share(row, entry.rows)
        pose[2, 3] += layer * (entry.layer_mm or 0.0)
        named[layer, row, column] = f"{name}.{number}"
        places.append(Place(f"{name}.{number}", entry, frame, pose, on_top_of=named.get((layer - 1, row, column))))
    return places, off


def _corner_pose(document: Document, file: PlacesFile, name: str, key: str, corner: Matrix | str) -> Array:
    """(4, 4) mm: pose of the part at a corner of a pattern, in the pattern's frame."""
    keys: tuple[Key, ...] = ("patterns", name, key)
    if not isinstance(corner, str):
        return _rigid(document, keys, corner)
    pattern, place = file.patterns[name], file.places.get(corner)
    if place is None or place.pose is None or (place.part, place.fixture) != (pattern.part, pattern.fixture):
        wanted = f"a pose or a place of {pattern.part} that has a pose, in the world or in the same fixture"
        raise document.error(keys, f"expected {wanted}, found {corner}: `place teach {corner} {pattern.part}`")
    return _rigid(document, ("places", corner, "pose"), place.pose)


def _corner(document: Document, file: PlacesFile, name: str, key: str, corner: Point | str) -> Array:
    """(3,) mm: origin of the part at a corner of a pattern, in the pattern's frame."""
    if isinstance(corner, str):
        pose: Array = _corner_pose(document, file, name, key, corner)
        return pose[:3, 3]
    return np.array(corner)


def _check_grid(document: Document, keys: tuple[Key, ...], entry: PatternEntry, row: Array, column: Array) -> None:
    if entry.layers > 1 and entry.layer_mm is None:
        raise document.error((*keys, "layer_mm"), "expected the distance of the layers, found nothing")
    for key, count, along in (("row_end_mm", entry.columns, row), ("column_end_mm", entry.rows, column)):
        if count > 1 and np.linalg.norm(along) < 1.0:
            raise document.error((*keys, key), f"expected the last of {count} places, found the first")
    if entry.columns > 1 and entry.rows > 1:
        cosine = float(row @ column / (np.linalg.norm(row) * np.linalg.norm(column)))
        off_deg = abs(90.0 - float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))))
        if off_deg > SQUARE_DEG:
            raise document.error(keys, f"rows and columns are {off_deg:.1f} degrees off square, {SQUARE_DEG:g} at most")


def _share(number: int, count: int) -> float:
    return number / (count - 1) if count > 1 else 0.0


def _cells(entry: PatternEntry) -> Iterator[tuple[int, int, int]]:
    """(layer, row, column) of each place, in the order of the pattern."""
    for layer in range(entry.layers):
        if entry.order == "columns":
            yield from ((layer, row, column) for column, row in product(range(entry.columns), range(entry.rows)))
            continue
        for row in range(entry.rows):
            step = -1 if entry.order == "snake" and row % 2 == 1 else 1
            yield from ((layer, row, column) for column in range(entry.columns)[::step])
