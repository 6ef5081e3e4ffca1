"""The arm over VAL II as the daemon calls it: matrices in, readings out. The bytes are drivers/val2's."""

from __future__ import annotations

import contextlib
from collections.abc import AsyncIterator, Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from daemon.arm import Beliefs, BeliefSource, HeldBackError, MotionPermit, Reading, StopRefusedError, VoidingEvent
from daemon.arrays import Array
from daemon.cell.no_arm import CellError
from drivers import puma560
from drivers.val2.commands import moves_the_arm as moves_the_arm
from drivers.val2.commands import turns_over as turns_over
from drivers.val2.commands import works_the_hand as works_the_hand
from drivers.val2.dialect import Dialect
from drivers.val2.errors import Elsewhere, HeldBack, NoAnswer, Preempted, StopRefused
from drivers.val2.link import Link, Start
from drivers.val2.location import apart, location_from_matrix, matrix_from_location
from drivers.val2.wire import Where

WireListener = Callable[[dict[str, Any]], None]

REST_S = 5.0
"""How long an arm that was told nothing by us may go on moving before what was asked of it is refused."""
NEAR_SINGULAR_RAD = float(np.radians(3.0))
"""A wrist this near to straight is kept out of: joints 4 and 6 would turn far for little. On a line it is asked at
places no part of the hand goes farther than 6 mm between (sweep.py): there it may come nearer by tenths of a degree."""


@dataclass(frozen=True)
class PumaKinematics:
    """daemon/arm/workcell.py's Kinematics of a PUMA with these lengths."""

    arm: puma560.ArmGeometry

    def reachable(self, world_from_tool: Array, joints_rad: Array) -> Array | None:
        """Joints (6,) rad that reach the pose as the arm is configured now, clear of a singular wrist, or None."""
        configuration = puma560.configuration_of(joints_rad, self.arm)
        try:
            joints = puma560.inverse(world_from_tool, configuration, self.arm, joints_rad)
        except puma560.UnreachableError:
            return None
        return None if puma560.wrist_is_singular(joints, within_rad=NEAR_SINGULAR_RAD) else joints

    def between(self, joints_rad: Array, to_rad: Array, share: float) -> Array:
        """Where the tool is a share of the way of a joint-interpolated move."""
        return puma560.forward(joints_rad + share * (to_rad - joints_rad), self.arm)

    def frames(self, joints_rad: Array) -> Array:
        """Where base, links and tool are, (N, 8, 4, 4)."""
        return puma560.link_frames(joints_rad, self.arm)

    def along(self, world_from_tool: Array, joints_rad: Array) -> Array:
        """Joints (N, 6) along a straight way from (6,), or near to others (N, 6); nan where it leaves reach or comes
        near a singular wrist."""
        joints = puma560.inverse_along(world_from_tool, joints_rad, self.arm)
        joints[np.abs(np.sin(joints[:, 4])) < np.sin(NEAR_SINGULAR_RAD)] = np.nan
        return joints


class ArmOnLink:
    """daemon/arm/workcell.py's Robot over VAL II, and what only an operator does: power-up, CAL, the monitor."""

    def __init__(self, link: Link, arm: puma560.ArmGeometry, beliefs: Beliefs) -> None:
        self.link = link
        self.beliefs, self.permit = beliefs, MotionPermit()
        link.permit = self.permit
        self.heard_s: float | None = None
        """When the controller last answered, on the cell's clock."""
        self.aside = False
        """Somebody talks to the controller, or waits for the end of a motion; nobody else is to ask it anything."""
        self.arm = arm
        self._o_deg = 0.0
        link.disturbed = self._others_type

    async def open(self) -> None:
        """Claim the port and find the controller's prompt. Raises LinkError."""
        self.beliefs.void(VoidingEvent.RECONNECTED)
        await self.link.open()
        await self._introduce_tool()
        self._heard()

    @property
    def asks_whether_to_move(self) -> bool:
        """Whether a yes to what the controller asks may begin a motion: CAL's question, or that of a program; any but
        those it asks when it was switched on."""
        question = self.link.question
        return question is not None and not self.link.dialect.asks_after_power_up(question)

    async def close(self) -> None:
        """Let go of the port; does not stop the arm."""
        await self.link.close()

    async def where(self) -> Reading:
        """Ask the controller where the arm is; where its tool may not be ours (after a stop, a reopened line, words of
        others), tell it of ours first."""
        if self.beliefs.now.tool is None:
            await self._introduce_tool()
        return self._reading(await self.link.where())

    async def rest(self) -> Reading:
        """Where the arm is at rest, its tool ours. Raises LinkError, NoAnswer where it still moves after a while."""
        if self.beliefs.now.tool is None:
            await self._introduce_tool()
        return self._reading(await self.link.still(REST_S))

    async def check(self) -> None:
        """Does the controller answer? Raises LinkError where it does not; being stopped meanwhile is an answer."""
        with contextlib.suppress(Preempted):
            await self.where()

    async def move(
        self,
        world_from_tool: Array,
        *,
        starts: Callable[[Reading], None],
        straight: bool,
        speed_pct: float,
        timeout_s: float,
    ) -> Reading:
        """One move; returns when the arm is at rest, there or elsewhere. Raises LinkError, and what starts raises."""
        location = location_from_matrix(world_from_tool, self._o_deg)
        start = Start(speed_pct, lambda where: starts(self._reading(where)))
        with self._line_taken(), _refusals():
            await (self.link.move_straight if straight else self.link.move)(location, timeout_s, start)
            try:
                return self._reading(await self.link.rest(location, timeout_s))
            except Elsewhere as elsewhere:
                if elsewhere.where is None:
                    raise
                return self._reading(elsewhere.where)

    async def hand(self, closed: bool) -> None:
        """CLOSEI or OPENI."""
        with _refusals():
            await (self.link.close_hand if closed else self.link.open_hand)()
        self._heard()

    async def at_rest(self) -> bool:
        """Whether two WHERE, now, agree; a controller at its power-up questions moves nothing. Raises LinkError."""
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
        """Whether there is a line to the controller."""
        return self.link.connected

    async def abort(self) -> None:
        """Stop the arm now, and see it at rest. Raises StopRefusedError at once, LinkError after some tries."""
        self.beliefs.void(VoidingEvent.STOPPED)
        with _refusals():
            await self.link.abort()
        self._heard()

    async def prove_stop(self) -> None:
        """See that the controller accepts the stop word. Raises StopRefusedError, LinkError."""
        self.beliefs.void(VoidingEvent.STOPPED)
        with _refusals():
            await self.link.prove_stop()
        self._heard()

    @property
    def kinematics(self) -> PumaKinematics:
        """See Robot."""
        return PumaKinematics(self.arm)

    @property
    def stopped_on_opening(self) -> bool:
        """Whether the arm was found at work when the port was opened last, and was stopped."""
        return self.link.stopped_on_opening

    @property
    def question(self) -> str | None:
        """What the controller asks since it was switched on, or None."""
        return self.link.question

    async def power_up(self, replies: Sequence[str]) -> list[str]:
        """Answer what the controller asks after it was switched on, or asks else; gives what it said, once the arm is
        at rest."""
        moves = self.asks_whether_to_move
        with self._words_of_others():
            answer = await self.link.power_up(tuple(replies))
            if moves:
                await self._rest()
                await self._end_program()
        await self._introduce_tool()
        return list(answer.lines)

    async def calibrate(self, reply: str) -> list[str]:
        """CAL: the arm finds its zero (it moves a little); over when it is at rest."""
        with self._words_of_others():
            answer = await self.link.calibrate(reply)
            await self._rest()
        return list(answer.lines)

    def check_typable(self, text: str) -> None:
        """Raise CellError where a line cannot be typed to this controller."""
        if not self.link.dialect.can_type(text):
            most = self.link.dialect.line_limit
            raise CellError(f"the controller takes lines of up to {most} plain characters (ASCII), not {text[:40]!r}")

    async def monitor(self, text: str) -> list[str]:
        """Any command, as typed at the controller's own terminal; gives what it said, once the arm is at rest. A
        program that it began, and that only pauses then, is ended."""
        with self._words_of_others():
            answer = await self.link.command(text)
            if moves_the_arm(text):
                await self._rest()
                await self._end_program()
        return list(answer.lines)

    @contextlib.asynccontextmanager
    async def terminal(self, show: Callable[[bytes], None]) -> AsyncIterator[Callable[[bytes], None]]:
        """The controller's own terminal for a person: what it says goes to show, what they type to the function given.

        Over when the arm is at rest, and no program runs any more, or where the controller asks something; its TOOL is
        ours again, whatever was typed. abort() still works, and ends it.
        """
        with self._words_of_others():
            async with self.link.terminal(show) as send:
                yield send
            if self.link.question is None:
                await self._rest()
                await self._end_program()
        await self._introduce_tool()

    @contextlib.contextmanager
    def _line_taken(self) -> Iterator[None]:
        """Stand aside: whoever has the line knows how long to wait for what."""
        self.aside = True
        try:
            yield
        finally:
            self.aside = False

    @contextlib.contextmanager
    def _words_of_others(self) -> Iterator[None]:
        """Stand aside; afterwards TOOL may be theirs."""
        with self._line_taken(), _refusals():
            try:
                yield
            finally:
                self.beliefs.void(VoidingEvent.OPERATOR_TYPED)

    def _others_type(self) -> None:
        self.beliefs.void(VoidingEvent.OTHERS_TYPED)

    async def _rest(self) -> None:
        """Wait until two readings agree, wherever that is and whatever TOOL is. Raises NoAnswer."""
        await self.link.still(self.link.dialect.motion_s, any_place=True)
        self._heard()

    async def _end_program(self) -> None:
        """One that a person may have begun: waiting, it would go on, with an arm that is thought to be at rest."""
        if self.link.program_may_run:
            with _refusals():
                await self.link.prove_stop()

    async def _introduce_tool(self) -> None:
        """Tell the controller of our tool: switched on, it knows none, and would bring the bare wrist to each place."""
        if self.link.question is None:
            await self.link.tool(location_from_matrix(self.arm.tool_for_controller))
            self.beliefs.learn(BeliefSource.COMMANDED, tool=self.arm.tool_for_controller)

    def _reading(self, where: Where) -> Reading:
        self._heard()
        self._o_deg = where.location.o_deg
        return Reading(matrix_from_location(where.location), np.radians(where.joints_deg))

    def _heard(self) -> None:
        self.heard_s = self.link.clock()


def arm_on_link(
    port: str,
    dialect: Dialect,
    arm: puma560.ArmGeometry,
    on_wire: WireListener,
    clock: Callable[[], float],
    beliefs: Beliefs,
) -> ArmOnLink:
    """The arm at a serial port, not yet opened. on_wire: called with every record of the wire ledger."""
    link = Link(port, dialect, clock=clock, on_wire=on_wire, belongs_together=partial(belongs_together, arm))
    return ArmOnLink(link, arm, beliefs)


@contextlib.contextmanager
def _refusals() -> Iterator[None]:
    """The driver's refusal of a stop, and of what is held back, as the house's."""
    try:
        yield
    except HeldBack as held_back:
        raise HeldBackError(held_back.message) from held_back
    except StopRefused as refused:
        raise StopRefusedError(refused.message) from refused


def belongs_together(arm: puma560.ArmGeometry, where: Where) -> bool:
    """Whether a WHERE's joints put our tool at its place, to more than its digits and less than any spoiled one."""
    place = location_from_matrix(puma560.forward(np.radians(where.joints_deg), arm))
    off_mm, off_deg = apart(place, where.location)
    return off_mm < 0.5 and off_deg < 0.2
