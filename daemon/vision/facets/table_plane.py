"""What lies in a known table plane is no part: its shadow, a mark, a scratch. Geometry on values only.

Where the table is, the arm knows (whoever looks says so); a look without that knowledge keeps every facet.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from daemon.arrays import Array
from daemon.vision.facets.grouping import connected, nearest_first
from daemon.vision.values import Facet, FacetView, Rejected

FLAT_MM = 3.0
SIGMAS = 4.0


@dataclass(frozen=True, eq=False)
class TablePlane:
    """The table in the cyclopean frame: up (3,) its unit normal, height of a point = up . p - level_mm."""

    up: Array
    level_mm: float

    def holds(self, facet: Facet) -> bool:
        """Whether every corner lies in the table, to what is measured (4 sigma) and at least 3 mm."""
        heights = facet.corners_mm @ self.up - self.level_mm
        sigma = np.sqrt(np.einsum("i,nij,j->n", self.up, facet.covariance_mm2, self.up))
        return bool(np.all(np.abs(heights) < FLAT_MM + SIGMAS * sigma))

    def json(self) -> dict[str, Any]:
        """Return the plane as JSON values; `table_of` reads them."""
        return {"up": self.up.tolist(), "level_mm": self.level_mm}


def table_of(json: Mapping[str, Any] | None) -> TablePlane | None:
    """Read what `TablePlane.json` wrote; None where nobody knew of a table."""
    return TablePlane(np.array(json["up"], float), float(json["level_mm"])) if json else None


def table_at(height_mm: float, world_from_cyclopean: Array) -> TablePlane:
    """The table at a height in the world, as cameras at (4, 4) mm see it."""
    return TablePlane(world_from_cyclopean[2, :3], height_mm - float(world_from_cyclopean[2, 3]))


def without_table(view: FacetView, table: TablePlane) -> FacetView:
    """The view without the facets that lie in the table; groups they held together fall apart."""
    groups, dropped = [], []
    for group in view.groups:
        lying = np.array([table.holds(facet) for facet in group.facets], bool)
        if not lying.any():
            groups.append(group)
            continue
        dropped += [
            Rejected(f.left_px, "left", "lies in the table")
            for f, flat in zip(group.facets, lying, strict=True)
            if flat
        ]
        rest = group.only(np.flatnonzero(~lying).tolist())
        groups += [rest.only(members) for members in connected(rest.touching)] if rest.facets else []
    return replace(view, groups=nearest_first(groups), rejected=(*view.rejected, *dropped))
