"""The arm over VAL II: the daemon's Robot protocol on a drivers/val2 Link. Matrices in, readings out."""

import contextlib
from collections.abc import AsyncIterator, Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from daemon.arm import (
    Beliefs,
    BeliefSource,
    HeldBackError,
    MotionPermission,
    MoveCommand,
    Reading,
    StopRefusedError,
    VoidingEvent,
)
from daemon.arrays import Array
from daemon.cell.no_arm import CellError
from daemon.cell.puma_arm import PumaArm
from drivers import puma560
from drivers.val2 import commands
from drivers.val2.errors import (
    ControllerError,
    Elsewhere,
    LineHeldBack,
    NoAnswer,
    Preempted,
    StopWordRefused,
    lacks_zero,
)
from drivers.val2.link import Link, MoveStart, NextMove
from drivers.val2.location import apart, location_from_matrix, matrix_from_location
from drivers.val2.wire import Where

REST_S = 5.0
"""How long `wait_until_at_rest` waits for a motion that facetd did not command."""
LEFT_S = 4.0
"""How long what a person began may still move the arm once they have left: one motion that ends, and no program."""
NO_ZERO = "the arm has not found its zero: `enable`, then `robot cal`"
ENDED = f"The arm still moved {LEFT_S:g} s later: facetd has stopped it (a program that went on is ended)."


class Val2Arm:
    """Robot (daemon/arm/robot.py) over VAL II, and its ControllerMonitor: power-up, CAL, any line."""

    moves_the_arm = staticmethod(commands.moves_the_arm)
    turns_over = staticmethod(commands.turns_over)
    works_the_hand = staticmethod(commands.works_the_hand)

    def __init__(self, link: Link, arm: puma560.ArmGeometry, beliefs: Beliefs) -> None:
        """link: not yet open; gets the arm's permission, and the check of its readings by the arm's kinematics."""
        self.link, self.beliefs, self.permission = link, beliefs, MotionPermission()
        self.kinematics = PumaArm(arm)
        link.permission, link.disturbed = self.permission, partial(beliefs.void, VoidingEvent.OTHERS_TYPED)
        link.belongs_together = lambda where: belongs_together(self.kinematics.geometry, where)
        self.heard_s: float | None = None
        """Time of the controller's last answer, on the cell's clock."""
        self.aside = False
        """Whether a task has the line for itself: it talks to the controller, or waits for the end of a motion."""
        self._o_deg = 0.0

    async def open(self) -> None:
        """Claim the port and find the controller's prompt. Raises LinkError."""
        self.beliefs.void(VoidingEvent.RECONNECTED)
        await self.link.open()
        await self._set_tool()
        self._heard()

    @property
    def asks_whether_to_move(self) -> bool:
        """Whether a yes to the controller's question may start a motion: any question (CAL's, a program's) but those
        after power-up."""
        question = self.link.question
        return question is not None and not self.link.dialect.asks_after_power_up(question)

    def use_tool(self, flange_from_tool: Array) -> None:
        """See Robot; the controller's TOOL is set before the next reading. Only while nothing is being done."""
        self.kinematics = PumaArm(replace(self.kinematics.geometry, flange_from_tool=flange_from_tool))
        self.beliefs.void(VoidingEvent.GRIPPER_CHANGED)

    async def close(self) -> None:
        await self.link.close()

    async def where(self) -> Reading:
        """Read WHERE. Sets TOOL first where it may have changed (after a stop, a reopened line, commands typed by
        others)."""
        if self.beliefs.now.tool is None:
            await self._set_tool()
        return self._reading(await self.link.where())

    async def wait_until_at_rest(self) -> Reading:
        """WHERE of the arm at rest, with our TOOL. Raises LinkError; NoAnswer where it still moves after REST_S."""
        if self.beliefs.now.tool is None:
            await self._set_tool()
        return self._reading(await self.link.still(REST_S))

    async def check(self) -> str | None:
        """Check that the controller answers. A stop meanwhile counts as an answer, and so does a refusal of WHERE until
        CAL, which is returned as text. Raises LinkError."""
        try:
            await self.where()
        except ControllerError as refused:
            if not lacks_zero(refused.message):
                raise
            self._heard()
            return f"{NO_ZERO} (it says `{refused.message}`)"
        except Preempted:
            pass
        return None

    async def move(
        self, command: MoveCommand, starts: Callable[[Reading], None], timeout_s: float, then: MoveCommand | None = None
    ) -> Reading:
        """One move; returns the reading at rest, at the target or not. Raises LinkError, and what starts raises."""
        location, ahead = location_from_matrix(command.world_from_tool, self._o_deg), None
        if then is not None:
            next_location = location_from_matrix(then.world_from_tool, location.o_deg)
            ahead = NextMove(next_location, then.straight, then.speed_pct)
        start = MoveStart(command.speed_pct, lambda where: starts(self._reading(where)))
        with self._line_taken(), _refusals():
            await self.link.move(location, timeout_s, start, command.straight)
            try:
                return self._reading(await self.link.wait_until_at_rest(location, timeout_s, ahead))
            except Elsewhere as elsewhere:
                if elsewhere.where is None:
                    raise
                return self._reading(elsewhere.where)

    async def set_gripper(self, closed: bool) -> None:
        with _refusals():
            await self.link.set_hand(closed)
        self._heard()

    async def set_outputs(self, numbers: Sequence[int]) -> None:
        await self.link.set_outputs(numbers)
        self._heard()

    async def work_valves(self, numbers: Sequence[int]) -> None:
        with _refusals():
            await self.link.work_valves(numbers)
        self._heard()

    async def ask_input(self, text: str) -> str:
        printed = await self.link.ask_plainly(text)
        self._heard()
        return " ".join(" ".join(printed).split())

    async def at_rest(self) -> bool:
        """Whether two readings of WHERE agree, or the controller is at its power-up questions. Raises LinkError."""
        if self.link.program_may_run:
            return False
        if self.link.question is not None and not self.asks_whether_to_move:
            return True
        try:
            await self.link.still(0.0, any_place=True)
        except NoAnswer:
            return False
        self._heard()
        return True

    @property
    def connected(self) -> bool:
        return self.link.connected

    async def stop_motion(self) -> None:
        """Stop the arm now and confirm that it is at rest. Raises StopRefusedError at once, LinkError after some
        tries."""
        self.beliefs.void(VoidingEvent.STOPPED)
        with _refusals():
            await self.link.stop_motion()
        self._heard()

    async def test_stop(self) -> None:
        self.beliefs.void(VoidingEvent.STOPPED)
        with _refusals():
            await self.link.test_stop()
        self._heard()

    @property
    def controller(self) -> "Val2Arm":
        """Itself: VAL II has a command line."""
        return self

    @property
    def stopped_on_opening(self) -> bool:
        return self.link.stopped_on_opening

    @property
    def question(self) -> str | None:
        return self.link.question

    @property
    def heard_unasked(self) -> bool:
        return self.link.heard_unasked

    async def power_up(self, replies: Sequence[str]) -> list[str]:
        """Answer the controller's questions, after power-up or others. Returns its output, once the arm is at rest."""
        moves = self.asks_whether_to_move
        with self._person_types():
            answer = await self.link.power_up(tuple(replies))
            self.beliefs.void(VoidingEvent.TURN_TYPED)
            lines = list(answer.lines)
            if moves:
                await self._come_to_rest(lines.append)
        await self._set_tool()
        return lines

    async def calibrate(self, reply: str) -> list[str]:
        """CAL: the arm finds its zeros by a small motion. Returns its output, once the arm is at rest."""
        with self._person_types():
            answer = await self.link.calibrate(reply)
            await self._rest()
        return list(answer.lines)

    def check_typable(self, text: str) -> None:
        if not self.link.dialect.can_type(text):
            most = self.link.dialect.line_limit
            raise CellError(f"the controller takes lines of up to {most} plain characters (ASCII), not {text[:40]!r}")

    async def monitor(self, text: str) -> list[str]:
        """Send any command, as typed at the controller's own terminal. Returns its output, once the arm is at rest.
        Ends a program that the command started."""
        self.beliefs.void(VoidingEvent.TURN_TYPED)
        with self._person_types():
            lines = list((await self.link.command(text)).lines)
            if commands.moves_the_arm(text):
                await self._come_to_rest(lines.append)
        return lines

    @contextlib.asynccontextmanager
    async def terminal(
        self, show: Callable[[bytes], None], tell: Callable[[str], None]
    ) -> AsyncIterator[Callable[[bytes], None]]:
        """Context: the controller's own terminal for a person. Its output goes to `show`; yields the function that
        types. tell: called with where the arm had to be stopped behind them.

        Leaves when the arm is at rest and no program runs, or the controller asks something; then sets TOOL again.
        stop_motion() still works, and ends it.
        """
        self.beliefs.void(VoidingEvent.TURN_TYPED)
        with self._person_types():
            async with self.link.terminal(show) as send:
                yield send
            if self.link.question is None:
                await self._come_to_rest(tell)
        await self._set_tool()

    @contextlib.contextmanager
    def _line_taken(self) -> Iterator[None]:
        """Context: the caller has the line for itself and knows how long to wait."""
        self.aside = True
        try:
            yield
        finally:
            self.aside = False

    @contextlib.contextmanager
    def _person_types(self) -> Iterator[None]:
        """Context: a person types on the line; afterwards TOOL may have changed."""
        with self._line_taken(), _refusals():
            try:
                yield
            finally:
                self.beliefs.void(VoidingEvent.OPERATOR_TYPED)

    async def _rest(self, within_s: float | None = None) -> None:
        """Wait until two readings agree, at any place. Raises NoAnswer."""
        await self.link.still(within_s or self.link.dialect.motion_s, any_place=True)
        self._heard()

    async def _come_to_rest(self, tell: Callable[[str], None]) -> None:
        """Wait until what a person began is over. A program that they may have started is ended, soon where it moves
        the arm on and on, and also where the arm rests: a paused one could resume. Raises LinkError."""
        if not self.link.program_may_run:
            await self._rest()
            return
        late = False
        try:
            await self._rest(LEFT_S)
        except NoAnswer:
            late = True
        except ControllerError as refused:
            if not lacks_zero(refused.message):
                raise
        with _refusals():
            await self.link.test_stop()
        if late:
            tell(ENDED)

    async def _set_tool(self) -> None:
        """Set TOOL on the controller: after power-up it has none, and would move the flange to each target."""
        if self.link.question is None:
            tool = self.kinematics.geometry.tool_for_controller
            await self.link.tool(location_from_matrix(tool))
            self.beliefs.learn(BeliefSource.COMMANDED, tool=tool)

    def _reading(self, where: Where) -> Reading:
        self._heard()
        self._o_deg = where.location.o_deg
        return Reading(matrix_from_location(where.location), np.radians(where.joints_deg))

    def _heard(self) -> None:
        self.heard_s = self.link.clock()


@contextlib.contextmanager
def _refusals() -> Iterator[None]:
    """Context: translate the driver's refusals of a stop and of a motion into errors of daemon.arm."""
    try:
        yield
    except LineHeldBack as held_back:
        raise HeldBackError(held_back.message) from held_back
    except StopWordRefused as refused:
        raise StopRefusedError(refused.message) from refused


def belongs_together(arm: puma560.ArmGeometry, where: Where) -> bool:
    """Whether the pose and the joints of a WHERE agree: within limits wider than rounding, narrower than any garbled
    digit."""
    place = location_from_matrix(puma560.forward(np.radians(where.joints_deg), arm))
    off_mm, off_deg = apart(place, where.location)
    return off_mm < 0.5 and off_deg < 0.2
