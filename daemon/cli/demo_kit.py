"""Values of the kit at the end of the demo: a plate with four nests, and how each part lies in its nest."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from daemon.events.records import Record
from daemon.store.place_status import PlaceStatus

PLATE, PLATE_MM = "plate", (460.0, -300.0, -300.0)
"""The fixture, and where its middle is on the table, world mm."""
WALLS = (((-100.0, -3.0, 0.0), (100.0, 3.0, 12.0)), ((-3.0, -100.0, 0.0), (3.0, 100.0, 12.0)))
"""Lowest and highest corner of each wall, mm from the plate's middle."""


@dataclass(frozen=True)
class Nest:
    """Where one part belongs: middle of its lower side on the plate, and direction of that side's longest edge."""

    part: str
    point_mm: tuple[float, float]
    heading_deg: float

    @property
    def name(self) -> str:
        return f"nest_{self.part}"

    @property
    def drawing(self) -> str:
        return f"{self.part}.obj"


NESTS = (
    Nest("cube", (-70.0, 70.0), 20.0),
    Nest("pyramid", (70.0, 70.0), 45.0),
    Nest("triangular_prism", (-70.0, -70.0), 90.0),
    Nest("pentagonal_prism", (70.0, -70.0), 0.0),
)
"""In the order in which places.yaml names them. Each part lies on a side of four corners."""
CORNERS_DOWN = 4


def write_truth(cell: Path, out: Path) -> None:
    """Write the truth of a simulated cell with the plate on its table: its walls, in the world. Raises OSError."""

    def in_world(corner: tuple[float, float, float]) -> list[float]:
        return [at + each for at, each in zip(PLATE_MM, corner, strict=True)]

    truth = yaml.safe_load(cell.read_text(encoding="utf-8"))
    walls = [{"low_mm": in_world(low), "high_mm": in_world(high)} for low, high in WALLS]
    out.write_text(yaml.safe_dump({**truth, "fixture": walls}), encoding="utf-8")


def places_yaml(edges_mm: Mapping[str, Sequence[Sequence[float]]]) -> str:
    """places.yaml of the kit. edges_mm: for each label taught, the lengths of the edges of each side in order."""
    solid = [{"low_mm": list(low), "high_mm": list(high)} for low, high in WALLS]
    places = {nest.name: _entry(nest, edges_mm[nest.part]) for nest in NESTS if nest.part in edges_mm}
    plate = {"point_mm": list(PLATE_MM), "solid": solid}
    return yaml.safe_dump({"version": 1, "fixtures": {PLATE: plate}, "places": places}, sort_keys=False)


def _entry(nest: Nest, sides: Sequence[Sequence[float]]) -> dict[str, object]:
    """A place; its heading is that of the side's first edge."""
    number = next(k for k, edges in enumerate(sides, start=1) if len(edges) == CORNERS_DOWN)
    first, second = sides[number - 1][:2]
    heading_deg = nest.heading_deg + (90.0 if second > first + 1.0 else 0.0)
    return {
        "part": nest.part,
        "fixture": PLATE,
        "side_down": number,
        "point_mm": [*nest.point_mm, 0.0],
        "heading_deg": heading_deg,
    }


@dataclass(frozen=True)
class KitResult:
    """By place: seen, its last record; true_off, the true error (mm, degrees) of the part there."""

    seen: Mapping[str, Record]
    true_off: Mapping[str, tuple[float, float]]

    @property
    def right(self) -> int:
        return sum(record["status"] == PlaceStatus.RIGHT for record in self.seen.values())

    @property
    def lines(self) -> list[str]:
        """A table, and the result in a line."""
        rows = [f"{'part':18}{'nest':14}{'seen off by':>20}{'truly off by':>23}"]
        for nest in NESTS:
            record = self.seen.get(nest.name, {})
            seen = error_text(record.get("off_mm"), record.get("off_deg"))
            true = error_text(*self.true_off.get(nest.name, (None, None)))
            status = str(record.get("status", PlaceStatus.FREE))
            rows.append(f"{nest.part:18}{status:14}{seen:>20}{true:>23}")
        most = map(max, zip(*self.true_off.values(), strict=True))
        truth = f", truly off by at most {error_text(*most)}" if self.true_off else ""
        return [*rows, f"kit: {self.right} of {len(NESTS)} parts seen right in their nests{truth}"]


def kit_result(records: Sequence[Record]) -> KitResult:
    """The nests as a run's records leave them."""
    nests = {nest.name for nest in NESTS}
    seen: dict[str, Record] = {}
    cycles: dict[Any, str] = {}
    true_off: dict[str, tuple[float, float]] = {}
    for record in records:
        if record["kind"] == "place" and record["place"] in nests:
            seen[record["place"]] = record
            cycles[record.get("cycle")] = record["place"]
        elif record["kind"] == "truth" and record.get("place_mm") is not None and record["cycle"] in cycles:
            true_off[cycles[record["cycle"]]] = record["place_mm"], record["place_deg"]
    return KitResult(seen, true_off)


def error_text(mm: float | None, deg: float | None) -> str:
    """An error as text; None: it was not measured."""
    return "-" if mm is None or deg is None else f"{mm:.2f} mm {deg:.2f} deg"
