"""The person at a simulated cell: shows a part or a board, scatters parts, measures a grasp."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from daemon import frames
from daemon.arrays import Array
from daemon.teaching.trainer import DrawnPart

if TYPE_CHECKING:
    from drivers.simcell.cell import SimulatedCell
    from drivers.simcell.world import PlacedPart

DEFAULT_PARTS = ("cube", "pyramid", "triangular_prism", "pentagonal_prism")
"""Parts on the table by default."""


class SimulatedOperator:
    """See the module."""

    def __init__(self, cell: SimulatedCell) -> None:
        from drivers.simcell.stand import VIEWS

        self.cell = cell
        self._views = {label: len(views) for label, views in VIEWS.items()}
        """Number of characteristic views of each part."""
        self._drawn: dict[str, int] = {}
        self._set_aside: tuple[PlacedPart, ...] | None = None
        """The parts that were on the table before a part or board was shown."""

    @property
    def labels(self) -> tuple[str, ...]:
        return tuple({**self._views, **self._drawn})

    def draw(self, parts: Mapping[str, DrawnPart]) -> dict[str, str]:
        """Make parts from drawings, by label. Returns the reason for each that cannot be made."""
        from drivers.simcell.drawn import DrawnError, drawn_shape
        from drivers.simcell.stand import DRAWN_VIEWS
        from drivers.simcell.surface import DrawnSurface

        shapes, unmade = [], {}
        for label, (solid, looks) in parts.items():
            seen = None
            if looks is not None:
                seen = DrawnSurface(looks.corners_mm, looks.triangles, looks.normals, looks.part_of, looks.flat)
            try:
                shapes.append(drawn_shape(label, solid.corners_mm, solid.facets, seen))
            except DrawnError as error:
                unmade[label] = str(error)
        self.cell.world.draw(shapes)
        self._drawn = {shape.label: len(DRAWN_VIEWS) for shape in shapes}
        return unmade

    def mount(self, kind: str) -> None:
        """Put the gripper of that kind on the arm. Raises ValueError where this cell has none."""
        self.cell.mount("suction" if kind == "suction" else "fingers")

    def show(self, label: str, view: int) -> int:
        """Hold a part before the cameras in a characteristic view, modulo their number. Returns the view."""
        view %= {**self._views, **self._drawn}[label]
        self._set_parts_aside()
        self.cell.place_for_teaching(label, view)
        return view

    def lay(self, label: str) -> None:
        """Put one part alone in the middle of the table."""
        self._set_parts_aside()
        self.cell.lay(label)

    def scatter(self, labels: Sequence[str] = DEFAULT_PARTS, steady: bool = False) -> None:
        self._set_aside = None
        self.cell.scatter(labels, steady=steady)

    def put_back(self) -> None:
        """Put the parts back as they were before a part or a board was shown."""
        self.cell.bring_back(self._set_aside or ())
        self._set_aside = None

    def clear(self) -> None:
        self._set_aside = None
        self.cell.clear()

    def show_board(self, columns: int, rows: int, square_mm: float, charuco: bool, held: bool = False) -> None:
        """Put a calibration board with that many inner corners on the table or into the gripper, in place of the
        parts."""
        from drivers.simcell.boards import BoardPrint

        self._set_parts_aside()
        board = BoardPrint(columns + 1, rows + 1, square_mm, charuco)
        if held:
            self.cell.hold_board(board)
        else:
            self.cell.show_board(board)

    def _set_parts_aside(self) -> None:
        if self._set_aside is None:
            self._set_aside = self.cell.world.parts

    def place_error(
        self, label: str, poses: Sequence[Array], corners: Array, axis: Array | None = None
    ) -> tuple[float, float] | None:
        """How far, mm and degrees, the part of a label that is nearest to its place truly lies from there, or from the
        pose that looks the same and is nearest; None: there is no such part. poses: world_from_part (4, 4) that look
        the same, the first as the place says; of the part, in its frame: corners (N, 3); axis (3,): of a body of
        revolution, which may be turned about it."""
        from drivers.simcell.ground_truth import pose_error

        found = [
            min(
                pose_error(
                    frames.apply(pose, corners),
                    frames.apply(part.pose, part.shape.hull.vertices),
                    None if axis is None else pose[:3, :3] @ axis,
                )
                for pose in poses
            )
            for part in self.cell.world.parts
            if part.label == label and part.where.value == "table"
        ]
        return min(found, default=None)

    def grasp_error(self, grasp: Array, corners: Array) -> tuple[float, float, bool] | None:
        """Error of the last grasp: mm, degrees, whether the part was held; None where the gripper closed on nothing.

        grasp: world_from_tool; corners (N, 3): of the part in the world, as estimated.
        """
        try:
            expected = frames.apply(frames.inverse(grasp), corners)
            error_mm, error_deg = self.cell.truth.grasp_pose_error(expected)
        except ValueError:
            return None
        return error_mm, error_deg, bool(self.cell.truth.grasps[-1].held)
