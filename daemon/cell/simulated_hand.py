"""What a person does at a real cell, done in a simulated one: show a part, strew parts, measure a grasp.

The simulated cell itself is built in daemon/cell/build.py, and only where the cell is to be simulated.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

from daemon import frames
from daemon.arrays import Array
from daemon.vision.geometry import Polyhedron

if TYPE_CHECKING:
    from drivers.simcell.boards import BoardPrint
    from drivers.simcell.cell import SimulatedCell
    from drivers.simcell.world import PlacedPart

USUAL = ("cube", "pyramid", "triangular_prism", "pentagonal_prism")
"""What lies on the table unless somebody says otherwise."""


class SimulatedHand:
    """See the module. views: how many characteristic views each part has; board: makes a calibration board."""

    def __init__(self, cell: SimulatedCell, views: Mapping[str, int], board: Callable[..., BoardPrint]) -> None:
        self.cell = cell
        self._views, self._board = views, board
        self._drawn: dict[str, int] = {}
        self._set_aside: tuple[PlacedPart, ...] | None = None
        """The parts as they lay before something else was shown."""

    @property
    def labels(self) -> tuple[str, ...]:
        """The parts there are."""
        return tuple({**self._views, **self._drawn})

    def draw(self, solids: Mapping[str, Polyhedron]) -> dict[str, str]:
        """Have parts made from these drawings, by their labels; gives why for each that cannot be made."""
        from drivers.simcell.drawn import DrawnError, drawn_shape
        from drivers.simcell.stand import DRAWN_VIEWS

        shapes, unmade = [], {}
        for label, solid in solids.items():
            try:
                shapes.append(drawn_shape(label, solid.corners_mm, solid.facets))
            except DrawnError as error:
                unmade[label] = str(error)
        self.cell.world.draw(shapes)
        self._drawn = {shape.label: len(DRAWN_VIEWS) for shape in shapes}
        return unmade

    def show(self, label: str, view: int) -> int:
        """Hold a part before the cameras in a characteristic view, counted round; gives the view it is in."""
        view %= {**self._views, **self._drawn}[label]
        self._remember()
        self.cell.place_for_teaching(label, view)
        return view

    def lay(self, label: str) -> None:
        """Lay one part alone amid the table."""
        self._remember()
        self.cell.lay(label)

    def scatter(self, labels: Sequence[str] = USUAL) -> None:
        """Strew parts over the table."""
        self._set_aside = None
        self.cell.scatter(labels)

    def put_back(self) -> None:
        """After showing a part or a board: everything again where it was before."""
        self.cell.bring_back(self._set_aside or ())
        self._set_aside = None

    def clear(self) -> None:
        """Take all parts away."""
        self._set_aside = None
        self.cell.clear()

    def show_board(self, columns: int, rows: int, square_mm: float, charuco: bool) -> None:
        """Lay a calibration board with that many inner corners on the table, instead of the parts."""
        self._remember()
        self.cell.show_board(self._board(columns + 1, rows + 1, square_mm, charuco))

    def _remember(self) -> None:
        if self._set_aside is None:
            self._set_aside = self.cell.world.parts

    def grasp_error(self, grasp: Array, corners: Array) -> tuple[float, float, bool] | None:
        """mm, degrees, held: where the part truly was in the hand that closed last, against where it was expected.

        grasp: world_from_tool; corners (N, 3) of the part in the world, as estimated. None where nothing was closed on.
        """
        try:
            expected = frames.apply(frames.inverse(grasp), corners)
            error_mm, error_deg = self.cell.truth.grasp_pose_error(expected)
        except ValueError:
            return None
        return error_mm, error_deg, bool(self.cell.truth.grasps[-1].held)
