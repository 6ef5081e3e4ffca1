"""The simulated cell: an arm behind a VAL II controller on a pty, a stereo camera on its wrist, parts.

The daemon uses `port` and `camera`, as of a real cell; tests and demos also set the scene and read the truth.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path
from typing import Protocol
from zlib import crc32

import numpy as np
from msgspec import structs

from drivers.arrays import Array
from drivers.puma560 import forward
from drivers.rigid import apply, rigid
from drivers.simcell.arm import SimulatedArm
from drivers.simcell.boards import BoardPrint, rendered_board
from drivers.simcell.camera import SimulatedPair, SimulatedScene
from drivers.simcell.controller import Controller, Faults, Machine, Manners, PtyServer
from drivers.simcell.gripper import finger_rods, fingers
from drivers.simcell.ground_truth import GroundTruth
from drivers.simcell.history import DropRecord, GraspRecord, GripperRecord, MotionRecord, ReleaseRecord
from drivers.simcell.motion_monitor import ArmSpheres, MotionMonitor, Violation
from drivers.simcell.parts import box, hull
from drivers.simcell.render import RenderedSolid, rendered
from drivers.simcell.stand import DISTANCE_MM, teaching_pose
from drivers.simcell.suction import cup_rods, cup_shown
from drivers.simcell.textures import PartsKind, Pattern, TableKind, printed_faces
from drivers.simcell.truth import GripperKind, load_truth, rigid_matrix
from drivers.simcell.verdict import VerdictFile
from drivers.simcell.world import PartPlace, PlacedPart, World

PATH_CHECKED_S = np.linspace(3.0, 0.0, 40)
"""Cell seconds before the gripper closes in which its path is checked for collisions."""
BOARD_IN_GRIPPER = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""Tool axes of a board that the gripper holds by its edge: its rows across the fingers, its face away from the tip."""
HELD_BOARD_MM = 60.0
"""Distance of its first square from the tool's axis, so that the fingers hide none."""
FINGER_ALBEDO = 0.3
HOLD_CHECKS = 8
"""How often during a motion, or its part since the last check, it is checked whether the vacuum still holds. At rest
nothing changes."""
HELD_UP = 0.73
"""Where a part is held up for teaching: this share of the distance from fixed cameras to the table."""
BOARD_ON_TABLE = np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
"""World axes of a board face up on the table, its rows across the arm's reach and its top farthest out."""


class LineServer(Protocol):
    """Serves the controller's line at `port`."""

    port: str

    def now_s(self) -> float:
        """The controller's time."""

    def controller(self) -> AbstractContextManager[Controller]:
        """Context: the controller at the present moment, to read or change it."""

    def stop(self) -> None:
        """End; safe to call twice."""


class CellLoop(Protocol):
    """An event loop with a time of its own, on which a cell can run."""

    def time(self) -> float:
        """Seconds."""

    def sleep(self, seconds: float) -> None:
        """Advance the time."""

    def serve(self, controller: Controller) -> LineServer:
        """Serve a controller's line in this time."""


class SimulatedCell:
    """A running simulated cell; `stop` ends it. Also a context manager.

    truth_path: etc/simcell.yaml; seed: of noise, scatter and repeatability; time_scale: cell seconds a real second.
    Raises TruthError for an unusable file.
    """

    def __init__(
        self,
        truth_path: Path | str,
        seed: int = 0,
        time_scale: float = 1.0,
        manners: Manners | None = None,
        faults: Faults | None = None,
        cold: bool = False,
        loop: CellLoop | None = None,
        table: TableKind = "plain",
        parts: PartsKind = "plain",
        verdict: Path | None = None,
    ) -> None:
        """loop: runs the cell on its own time, without pty or thread (None: real time); verdict: file to which
        the motion monitor writes its findings for another process (verdict.py).

        Patterns and prints are on the table and the parts there; a part held up for teaching is bare, over a plain
        cloth.
        """
        self._both = load_truth(truth_path)
        self._settings = self._both.with_gripper(self._both.grippers[0])
        self._time_scale, self._clock = time_scale, time.monotonic if loop is None else loop.time
        noise, scattering, settling = (np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(3))
        self._scattering = scattering
        self._seed, self._printed = seed, parts == "printed"
        self._prints: dict[str, tuple[Pattern, ...]] = {}
        settings = self._settings.arm
        self.arm = SimulatedArm(
            settings.geometry(),
            np.radians(settings.start_deg),
            joint_offsets_rad=np.radians(settings.joint_offset_deg),
            repeatability_mm=settings.repeatability_mm,
            rng=settling,
        )
        self.world = World(self._settings, self._on_held)
        self._board: tuple[RenderedSolid, ...] = ()
        self._held_board: tuple[RenderedSolid, ...] = ()
        self._machine = Machine(
            self.arm, manners or settings.controller_manners(), self._on_gripper, faults, cold or settings.cold
        )
        self.controller = Controller(self._machine)
        cup = self._both.suction
        self.switch = "works" if cup is None else cup.switch
        """Whether the vacuum switch works, or is stuck on or off."""
        self.valve = "works" if cup is None else cup.valve
        """Whether the vacuum's valve works, or sticks where it is on, or off."""
        self._valve_open = False
        """Whether the valve that the outputs operate is open."""
        self._closed_by_a_hand = False
        self._hold_checked_s, self._hold_read = 0.0, 0
        """Until when the vacuum's hold was checked, and the first event of the history that may last longer."""
        self._machine.before_input, self._machine.after_outputs = self._vacuum_switch, self._outputs_switched
        safety = self._settings.safety
        barred = structs.replace(safety, keep_out=[*safety.keep_out, *self._settings.fixture])
        self.motion_monitor = MotionMonitor(self._machine.history, self._body(), barred, self._settings.table)
        boxes = [hull(box(each.low_mm, each.high_mm)) for each in self._settings.fixture]
        self._fixture = tuple(RenderedSolid(each, np.eye(4), self._settings.lighting.table_albedo) for each in boxes)
        self.server: LineServer
        if loop is None:
            self.server = PtyServer(self.controller, settings.baud, time_scale)
        else:
            self.server = loop.serve(self.controller)
        self.port = self.server.port
        sleep = time.sleep if loop is None else loop.sleep
        pattern = np.random.default_rng([seed, 1]) if table == "patterned" else None
        self.camera = SimulatedPair(self._settings, self._scene_at, noise, time_scale, self._clock, sleep, pattern)
        self._verdict = None
        if verdict is not None:
            self._verdict = VerdictFile(
                verdict, self.motion_monitor, self._machine.history, self.server.now_s, self._to_clock_s
            )
        self.truth = GroundTruth(self._settings, self.world, self._machine, self.world_from_tool)

    def _body(self) -> ArmSpheres:
        settings, cup = self._settings, self._settings.suction
        gripper = finger_rods(settings.gripper) if cup is None else cup_rods(cup)
        return ArmSpheres([*settings.safety.body, *gripper], self.arm.true_geometry, self.arm.joint_offsets_rad)

    @property
    def mounted(self) -> GripperKind:
        """Which gripper is on the arm."""
        return "fingers" if self._settings.suction is None else "suction"

    def mount(self, kind: GripperKind) -> None:
        """Change the gripper on an arm at rest, for another of the cell's. Raises ValueError where it has none."""
        if kind == self.mounted:
            return
        with self.server.controller() as controller:
            self._settings = self._both.with_gripper(kind)
            tool = rigid_matrix(self._settings.arm.flange_from_tool)
            self.arm.true_geometry = replace(self.arm.true_geometry, flange_from_tool=tool)
            self.motion_monitor.change_body(controller.now_s, self._body())
            self.world.mount(self._settings)
            self.truth.settings = self._settings

    def stop(self) -> None:
        """End the controller's thread and close the camera; safe to call twice."""
        self.camera.close()
        if self._verdict is not None:
            self._verdict.close()
        self.server.stop()

    def __enter__(self) -> SimulatedCell:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def world_from_tool(self, real_s: float | None = None) -> Array:
        """The true pose of the gripper (4, 4), now or at a moment of the cameras' clock, whatever TOOL is."""
        since = 0.0 if real_s is None else real_s - self._clock()
        return self.arm.pose_at(self.server.now_s() + since * self._time_scale)

    def world_from_cyclopean(self) -> Array:
        """The true pose of the cameras (4, 4), now."""
        return self._settings.world_from_cyclopean_at(self.world_from_tool())

    def violations(self) -> tuple[Violation, ...]:
        """Violations found by the motion monitor up to now."""
        with self.server.controller() as controller:
            self._watch_hold(controller.now_s)
            return self.motion_monitor.violations(controller.now_s)

    def scatter(self, labels: Sequence[str], rng: np.random.Generator | None = None, steady: bool = False) -> None:
        """Clear the table and scatter parts over it at random, each on a stable face; steady: see World.scatter."""
        self.clear()
        self.world.scatter(labels, self._scattering if rng is None else rng, steady=steady)

    def lay(self, label: str) -> PlacedPart:
        """Clear the table and put one part in its middle, on a random stable face. Raises KeyError."""
        self.clear()
        x_mm, y_mm = self._settings.table.centre_mm
        rest = int(self._scattering.integers(len(self.world.shape(label).rests)))
        return self.world.stand(label, rest, x_mm, y_mm, float(self._scattering.uniform(0, 2 * np.pi)))

    def clear(self) -> None:
        self._board = self._held_board = ()
        self.world.clear()

    def bring_back(self, parts: Sequence[PlacedPart]) -> None:
        """Clear the cell and put these parts back in their places."""
        self.clear()
        self.world.bring_back(parts)

    def place_for_teaching(self, label: str, view: int) -> PlacedPart:
        """Clear the cell and hold one part before the cameras in a characteristic view.

        Views are numbered from 0 (stand.VIEWS). Raises NoViewError, KeyError.
        """
        self.clear()
        at = self.world_from_cyclopean()
        centres = [side.lens().cyclopean_from_camera[:3, 3] for side in (self._settings.left, self._settings.right)]
        lighting, away_mm = self._settings.lighting, DISTANCE_MM
        if self._settings.world_from_cyclopean is not None:
            away_mm = HELD_UP * float((self._settings.table.height_mm - at[2, 3]) / at[2, 2])
        shape, drawn = self.world.shape(label), self.world.drawn(label)
        pose = teaching_pose(shape, view, at, centres, lighting, away_mm, drawn)
        return self.world.put(label, pose, PartPlace.STAND)

    def show_board(self, board: BoardPrint | None = None, world_from_board: Array | None = None) -> Array:
        """Clear the cell and show a board (default 9x6 inner corners), by default face up in the middle of the table.

        Returns world_from_board (4, 4); boards.py defines the board's frame.
        """
        self.clear()
        board = board or BoardPrint()
        if world_from_board is None:
            table = self._settings.table
            middle = np.array([*table.centre_mm, table.height_mm + 4.0])
            half = np.array([board.columns, board.rows, 0.0]) * board.square_mm / 2
            world_from_board = rigid(BOARD_ON_TABLE, middle - BOARD_ON_TABLE @ half)
        self._board = (rendered_board(board, world_from_board),)
        self.world.changes += 1
        return world_from_board

    def hold_board(self, board: BoardPrint | None = None) -> Array:
        """Clear the cell, put a board into the gripper, its face away from the tip. Returns tool_from_board (4, 4)."""
        self.clear()
        board = board or BoardPrint()
        half = np.array([board.columns, board.rows, 0.0]) * board.square_mm / 2
        middle = np.array([-HELD_BOARD_MM - half[1], 0.0, 0.0])
        tool_from_board = rigid(BOARD_IN_GRIPPER, middle - BOARD_IN_GRIPPER @ half)
        self._held_board = (rendered_board(board, tool_from_board),)
        self.world.changes += 1
        return tool_from_board

    def _prints_on(self, part: PlacedPart) -> tuple[Pattern, ...]:
        """Prints of a part, the same in every place; parts of several pieces are bare."""
        if not self._printed or part.where is PartPlace.STAND or len(part.shape.pieces) > 1:
            return ()
        if part.name not in self._prints:
            rng = np.random.default_rng([self._seed, 2, crc32(part.name.encode())])
            self._prints[part.name] = printed_faces(part.shape.hull, self._settings.lighting.facet_albedo, rng)
        return self._prints[part.name]

    def _to_clock_s(self, moment_s: float) -> float:
        """A moment of the controller's time on the cameras' clock."""
        return self._clock() + (moment_s - self.server.now_s()) / self._time_scale

    def switch_input(self, number: int, high: bool) -> None:
        """Switch a digital input of the controller, as the production line does; at the vacuum switch's input: close
        the cup with a hand, as a person would."""
        cup = self._both.suction
        with self.server.controller() as controller:
            if cup is not None and number == cup.switch_input:
                self._closed_by_a_hand = high
            (controller.machine.inputs.add if high else controller.machine.inputs.discard)(number)

    def _vacuum_switch(self) -> None:
        cup, machine = self._both.suction, self._machine
        if cup is None:
            return
        self._watch_hold(machine.now_s)
        closed = self._closed_by_a_hand or (self.mounted == "suction" and self.world.held is not None)
        on = self.switch == "stuck on" or (self.switch == "works" and closed)
        (machine.inputs.add if on else machine.inputs.discard)(cup.switch_input)

    def _watch_hold(self, now_s: float) -> None:
        """Drop a part that the vacuum has lost since the last check, at the point of the path where that happened. The
        caller must hold the controller."""
        since_s, self._hold_checked_s = self._hold_checked_s, max(now_s, self._hold_checked_s)
        if self._settings.suction is None:
            return
        first, events = self._machine.history.since(self._hold_read)
        lasts = (k for k, event in enumerate(events) if isinstance(event, MotionRecord) and event.motion.ends_s > now_s)
        self._hold_read = first + next(lasts, len(events))
        if self.world.held is None:
            return
        motions = [event.motion for event in events if isinstance(event, MotionRecord)]
        for motion in motions:
            first_s, last_s = max(motion.started_s, since_s), min(motion.ends_s, now_s)
            if last_s <= first_s:
                continue
            for at_s in np.linspace(first_s, last_s, HOLD_CHECKS):
                tool = forward(motion.joints_at(at_s) + self.arm.joint_offsets_rad, self.arm.true_geometry)
                if self.world.why_lost(tool) and (fallen := self.world.lose(tool)) is not None:
                    self._fell(float(at_s), fallen)
                    return

    def _fell(self, at_s: float, fallen: tuple[str, float, PartPlace]) -> None:
        label, fell_mm, where = fallen
        over_bin, by_others = where is PartPlace.BIN, self._machine.by_others
        self._machine.history.add(DropRecord(at_s, self._machine.by, label, fell_mm, over_bin, by_others))

    def _outputs_switched(self) -> None:
        """Work the valve that outputs work, where the cup has one."""
        cup, machine = self._settings.suction, self._machine
        if cup is None or cup.vacuum_output is None:
            return
        on = cup.vacuum_output in machine.outputs
        on = (self._valve_open and self.valve == "stuck on") or (on and self.valve != "stuck off")
        blown = cup.blow_off_output is None or cup.blow_off_output in machine.outputs
        if on is self._valve_open or not (on or blown):
            return
        self._valve_open = on
        machine.history.add(GripperRecord(machine.now_s, machine.by, machine.received_s, on, machine.by_others))
        self._operate_gripper(on)

    def _on_gripper(self, closed: bool) -> None:
        """Operate the controller's gripper valves; they have no effect on a cup whose valve is at outputs."""
        cup = self._settings.suction
        if cup is None or cup.vacuum_output is None:
            self._operate_gripper(closed)

    def _operate_gripper(self, closed: bool) -> None:
        now_s = self._machine.now_s
        tool = self.arm.pose_at(now_s)
        self._watch_hold(now_s)
        if closed:
            self.world.close_hand(tool, [self.arm.pose_at(now_s - back_s) for back_s in PATH_CHECKED_S])
        elif (fallen := self.world.open_hand(tool)) is not None:
            self._fell(now_s, fallen)

    def _on_held(self, held: PlacedPart | None) -> None:
        now_s, by = self.server.now_s(), self._machine.by
        if held is None:
            self._machine.history.add(ReleaseRecord(now_s, by))
        else:
            corners = apply(held.pose, held.shape.hull.vertices)
            self._machine.history.add(GraspRecord(now_s, by, held.label, corners))

    def _scene_at(self, real_s: float) -> SimulatedScene:
        if self._settings.suction is not None:
            with self.server.controller() as controller:
                self._watch_hold(controller.now_s)
        tool = self.world_from_tool(real_s)
        parts = [part for part in self.world.parts if part.where in (PartPlace.TABLE, PartPlace.STAND, PartPlace.HAND)]
        albedo = self._settings.lighting.facet_albedo
        solids = [
            solid
            for part in parts
            for solid in rendered(
                part.shape, part.world_from_part(tool), albedo, [self._prints_on(part)] * len(part.shape.pieces)
            )
        ]
        carried = tool.tobytes() if self.world.held or self._held_board else b""
        boards = (*self._board, *(replace(b, world_from_solid=tool @ b.world_from_solid) for b in self._held_board))
        cup = self._settings.suction
        shown = fingers(self._settings.gripper, self.world.gap_mm) if cup is None else (cup_shown(cup),)
        gripper = tuple(RenderedSolid(each, tool, FINGER_ALBEDO) for each in shown)
        teaching = any(part.where is PartPlace.STAND for part in parts)
        fixture = () if teaching else self._fixture  # the cloth lies over it
        state = self.world.changes, carried
        cameras = self._settings.world_from_cyclopean_at(tool)
        return SimulatedScene(cameras, (*solids, *boards, *fixture), state, gripper, teaching)
