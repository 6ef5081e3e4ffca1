"""Serve the line's signals: read inputs between moves, set outputs that differ, do the hand-shakes.

One object owns the known levels. Each reading and each setting takes one turn of the controller's line, so that none
comes in the middle of a move. An input that cannot be read permits nothing: its error ends the job and stops the arm,
as any other does.
"""

import asyncio
from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

from daemon.signals.input_form import InputForm, SignalError
from daemon.signals.modbus import PLCInputs
from daemon.signals.packml import PackMLState
from daemon.signals.settings import ON_STOP, VALVES, SignalSettings

NO_PLC = PLCInputs()
POLL_S = 0.2
"""Interval between readings of an input that a job waits for."""
FAILED_S = 2.0
"""Time after a failure until the outputs are set again."""
IN_WORDS = {
    "permit_pick": "the permit to pick",
    "permit_place": "the permit to place",
    "cycle_start": "the cycle start",
    "part_present": "a part",
}


class SignalIO(Protocol):
    """The controller's digital inputs and outputs; each call takes one turn of its line."""

    async def set_outputs(self, numbers: Sequence[int]) -> None:
        """Switch outputs: n on, -n off."""

    async def work_valves(self, numbers: Sequence[int]) -> None:
        """Switch outputs that work the gripper; refused while nothing may move."""

    async def ask_input(self, text: str) -> str:
        """The controller's answer to a command that reads an input."""


@dataclass(frozen=True)
class SignalLevel:
    """Whether a signal is on, and when that was read or set, on the daemon's clock."""

    on: bool
    at_s: float


class ProductionLine:
    """See the module. waits_for: the signal that a job waits for, as text; done: a part was brought, and the line has
    not acknowledged it; form: how inputs are read, None before `signal find`."""

    def __init__(
        self,
        signals: Mapping[str, SignalSettings],
        io: SignalIO,
        form: InputForm | None,
        clock: Callable[[], float],
        record: Callable[..., None],
        plc: PLCInputs = NO_PLC,
    ) -> None:
        """plc: provides its roles in place of inputs of the controller."""
        self.signals, self.form, self.plc = dict(signals), form, plc
        self.levels: dict[str, SignalLevel] = {}
        self.waits_for: str | None = None
        self.waits_to_begin = False
        self.done = False
        self._io, self._clock, self._record = io, clock, record
        self._by_role: dict[str, str] = {signal.role: name for name, signal in signals.items()}
        self._by_role |= {role: f"PLC's {role}" for role in plc.roles}
        self._start_seen_off = self._reset_seen_off = False
        """Whether the signal was seen off since it last counted: one that stays on does not count again."""
        self._start_at_done = False
        self._blowing = False
        self._stop_tests = 0
        self._line = asyncio.Lock()

    @property
    def has_line(self) -> bool:
        return bool(self.signals or self.plc.roles)

    @property
    def unreadable(self) -> str | None:
        """Why inputs cannot be read, and what to do; None where they can."""
        inputs = self.names(inputs=True)
        if not inputs or self.form is not None:
            return None
        return f"it is unknown how this controller reads an input: type `signal find {inputs[0]}` at a console"

    def names(self, inputs: bool) -> list[str]:
        return [name for name, signal in self.signals.items() if signal.is_input is inputs]

    def has(self, role: str) -> bool:
        return role in self._by_role

    async def read(self, name: str) -> bool:
        """Read an input; one of a PLC that is not connected is off. Raises SignalError, errors of the line."""
        if name not in self.signals:
            return self._read_plc(name)
        signal = self.signals[name]
        if self.form is None:
            raise SignalError(f"{name}: {self.unreadable}")
        high = self.form.high(signal.number, await self._io.ask_input(self.form.line(signal.number)))
        on = high == (signal.level == "high")
        self._update(name, signal.role, on)
        return on

    def _read_plc(self, name: str) -> bool:
        role = next(role for role in self.plc.roles if self._by_role[role] == name)
        on = self.plc.on(role)
        if on is not None:
            self._update(name, role, on)
        elif role == "cycle_start":
            self._start_seen_off = False
        elif role == "reset":
            self._reset_seen_off = False
        return bool(on)

    def _readable(self, role: str) -> bool:
        return role in self._by_role and (self.form is not None or role in self.plc.roles)

    async def wait_for_permit(self, role: str | None) -> bool:
        """Wait for a permit, where the line gives one; returns whether it had to wait."""
        if role is None or role not in self._by_role:
            return False
        waited = False
        try:
            while not await self.read(self._by_role[role]):
                waited, self.waits_for = True, f"{IN_WORDS[role]} ({self._by_role[role]})"
                await asyncio.sleep(POLL_S)
        finally:
            self.waits_for = None
        return waited

    async def wanted(self, continues: Callable[[], bool]) -> bool:
        """Wait until the line wants a part; False where `continues` ends that."""
        roles = [role for role in ("permit_pick", "part_present", "cycle_start") if role in self._by_role]
        self.waits_to_begin = True
        try:
            while continues():
                lacking = [role for role in roles if not await self.read(self._by_role[role])]
                if "cycle_start" in roles and not self._start_seen_off:
                    lacking = [*lacking, "cycle_start"]
                if not lacking:
                    self._start_seen_off = False
                    return True
                self.waits_for = f"{IN_WORDS[lacking[0]]} ({self._by_role[lacking[0]]})"
                await asyncio.sleep(POLL_S)
            return False
        finally:
            self.waits_for, self.waits_to_begin = None, False

    async def part_held(self) -> bool | None:
        """What the gripper's sensor reports; None without one. Raises as `read`."""
        name = self._by_role.get("part_held")
        return None if name is None else await self.read(name)

    async def work_cup(self, closed: bool, work_time_s: float) -> None:
        """Switch the vacuum on and wait; or switch it off, and blow off for work_time_s. Where the wait is cancelled,
        `watch` ends the blow-off. Raises the errors of the controller's line; the levels are then unknown."""
        on_by_name = {self._by_role["vacuum"]: closed}
        if "blow_off" in self._by_role:
            on_by_name[self._by_role["blow_off"]] = not closed
        try:
            async with self._line:
                self._blowing = not closed
                await self._set_levels(on_by_name, self._io.work_valves)
            await asyncio.sleep(work_time_s)
        finally:
            self._blowing = False
        if "blow_off" in self._by_role and not closed:
            await self.switch({self._by_role["blow_off"]: False})

    async def brought(self) -> None:
        """A part was brought: part_done is on until the line acknowledges it by a change of its cycle start."""
        if self.has("part_done") or "cycle_start" in self.plc.roles:
            self._start_at_done = await self.read(self._by_role["cycle_start"])
            self.done = True

    async def watch(self, state: PackMLState, stop_tests: int = 0) -> bool:
        """Read the inputs that a hand-shake waits for, and set the outputs that differ; returns whether the line asks
        for a reset. stop_tests: another number means that the controller may have been off, and its outputs with it."""
        reset = False
        if stop_tests != self._stop_tests:
            self._stop_tests = stop_tests
            self.forget()
        aborted = state is PackMLState.ABORTED
        if self._readable("cycle_start") and self.done and not self.waits_to_begin:
            await self.read(self._by_role["cycle_start"])
        if self._readable("reset"):
            if aborted:
                on = await self.read(self._by_role["reset"])
                heard = "reset" not in self.plc.roles or self.plc.heard
                reset, self._reset_seen_off = on and self._reset_seen_off, heard and not on
            else:
                self._reset_seen_off = False
        await self.set_outputs(state)
        return reset

    async def set_outputs(self, state: PackMLState) -> None:
        """Set the outputs that differ from the state. Raises the errors of the controller's line."""
        async with self._line:
            followed = [n for n in self.names(inputs=False) if self.signals[n].role not in VALVES]
            wanted = {name: self._level_for(name, state) for name in followed}
            if "blow_off" in self._by_role:
                wanted[self._by_role["blow_off"]] = self._blowing
            changed = {n: on for n, on in wanted.items() if n not in self.levels or self.levels[n].on is not on}
            if changed:
                await self.switch(changed)

    async def switch(self, on_by_name: Mapping[str, bool]) -> None:
        """Switch outputs. Raises the errors of the controller's line; the levels are then unknown."""
        await self._set_levels(on_by_name, self._io.set_outputs)

    async def _set_levels(self, wanted: Mapping[str, bool], send: Callable[[Sequence[int]], Awaitable[None]]) -> None:
        for name in wanted:
            self.levels.pop(name, None)
        numbers = [
            self.signals[name].number if on is (self.signals[name].level == "high") else -self.signals[name].number
            for name, on in wanted.items()
        ]
        await send(numbers)
        for name, on in wanted.items():
            self._update(name, self.signals[name].role, on)

    def forget(self) -> None:
        """Mark all levels as unknown: outputs are set again."""
        self.levels.clear()

    def _level_for(self, name: str, state: PackMLState) -> bool:
        signal, aborted = self.signals[name], state is PackMLState.ABORTED
        if signal.role == "fault":
            return aborted
        if aborted and (then := signal.on_stop or ON_STOP[signal.role]) != "hold":
            if signal.role == "part_done":
                self.done = then == "on"
            return then == "on"
        if aborted and signal.role == "busy":
            return self.levels[name].on if name in self.levels else False
        return self.done if signal.role == "part_done" else state is PackMLState.EXECUTE

    def _update(self, name: str, role: str, on: bool) -> None:
        before = self.levels.get(name)
        self.levels[name] = SignalLevel(on, self._clock())
        if role == "cycle_start":
            self._start_seen_off |= not on
            if self.done and on != self._start_at_done:
                self.done = False
        if before is None or before.on is not on:
            self._record("signal", name=name, role=role, on=on)


async def keep_watch(
    line: ProductionLine,
    state: Callable[[], PackMLState],
    stop_tests: Callable[[], int],
    reset: Callable[[], None],
    trouble: Callable[[str | None], None],
    failures: tuple[type[Exception], ...],
    sleep: Callable[[float], Awaitable[None]] = asyncio.sleep,
) -> None:
    """Serve the line until cancelled. stop_tests: see watch; reset: called when the line asks to clear a fault;
    trouble: called with the reason after two failures in a row (a stop makes one command fail), with None when the line
    works again; failures: errors of the controller's line."""
    failed = False
    while line.has_line:
        try:
            if await line.watch(state(), stop_tests()):
                reset()
            failed = False
            trouble(None)
            await sleep(POLL_S)
        except failures as error:
            line.forget()
            if failed:
                trouble(f"signals: {error}")
            await sleep(FAILED_S if failed else POLL_S)
            failed = True
