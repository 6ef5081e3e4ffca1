"""The line's signals while the daemon runs: inputs read between moves, outputs set where they differ, hand-shakes.

One owner of what is known of them. Each reading and each setting is one turn of the arm's own line, so that none falls
into a move. What cannot be read permits nothing: the error ends the job, and the arm is stopped as for any other.
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
"""How often inputs are read that somebody waits for."""
FAILED_S = 2.0
"""How long after a failure the outputs are tried again."""
IN_WORDS = {
    "permit_pick": "the permit to pick",
    "permit_place": "the permit to place",
    "cycle_start": "the cycle start",
    "part_present": "a part",
}


class SignalIO(Protocol):
    """The controller's digital inputs and outputs, each call one turn of its line."""

    async def set_outputs(self, numbers: Sequence[int]) -> None:
        """Switch outputs: n on, -n off."""

    async def work_valves(self, numbers: Sequence[int]) -> None:
        """The same of outputs that work the gripper: not while nothing may move."""

    async def ask_input(self, text: str) -> str:
        """What the controller prints to a line that reads an input."""


@dataclass(frozen=True)
class SignalLevel:
    """Whether a signal is on, and since when that is known, on the daemon's clock."""

    on: bool
    at_s: float


class LineSignals:
    """See the module. waits_for: what is awaited of the line, in words; done: a part was brought, and the line has not
    taken note; form: how inputs are read, None where nobody found that yet."""

    def __init__(
        self,
        signals: Mapping[str, SignalSettings],
        io: SignalIO,
        form: InputForm | None,
        clock: Callable[[], float],
        record: Callable[..., None],
        plc: PLCInputs = NO_PLC,
    ) -> None:
        """plc: gives its roles in place of inputs of the controller."""
        self.signals, self.form, self.plc = dict(signals), form, plc
        self.levels: dict[str, SignalLevel] = {}
        self.waits_for: str | None = None
        self.waits_to_begin = False
        self.done = False
        self._io, self._clock, self._record = io, clock, record
        self._by_role: dict[str, str] = {signal.role: name for name, signal in signals.items()}
        self._by_role |= {role: f"PLC's {role}" for role in plc.roles}
        self._start_armed = self._reset_armed = False
        """Whether it was seen off since the last one that counted: one that was on before is none."""
        self._start_at_done = False
        self._blows = False
        self._stop_seen = 0
        self._line = asyncio.Lock()

    @property
    def there(self) -> bool:
        """Whether the cell has a line."""
        return bool(self.signals or self.plc.roles)

    @property
    def unreadable(self) -> str | None:
        """Why no input can be read, where there is one; what to do."""
        inputs = self.names(inputs=True)
        if not inputs or self.form is not None:
            return None
        return f"nobody has found yet how an input is read on this controller: `signal find {inputs[0]}` at a console"

    def names(self, inputs: bool) -> list[str]:
        """Of the inputs, or of the outputs."""
        return [name for name, signal in self.signals.items() if signal.is_input is inputs]

    def has(self, role: str) -> bool:
        """Whether there is a signal of that role."""
        return role in self._by_role

    async def read(self, name: str) -> bool:
        """Read an input now. Raises SignalError, and what the line raises. Of a PLC that is not heard it is off, and no
        change that counts as the line's."""
        if name not in self.signals:
            return self._read_plc(name)
        signal = self.signals[name]
        if self.form is None:
            raise SignalError(f"{name}: {self.unreadable}")
        high = self.form.high(signal.number, await self._io.ask_input(self.form.line(signal.number)))
        on = high == (signal.level == "high")
        self._take(name, signal.role, on)
        return on

    def _read_plc(self, name: str) -> bool:
        role = next(role for role in self.plc.roles if self._by_role[role] == name)
        on = self.plc.on(role)
        if on is not None:
            self._take(name, role, on)
        elif role == "cycle_start":
            self._start_armed = False
        elif role == "reset":
            self._reset_armed = False
        return bool(on)

    def _readable(self, role: str) -> bool:
        return role in self._by_role and (self.form is not None or role in self.plc.roles)

    async def permit(self, role: str | None) -> bool:
        """Wait for a permit, where the line has one. Gives whether it had to be waited for."""
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

    async def wanted(self, goes_on: Callable[[], bool]) -> bool:
        """Wait until the line wants a part: it permits one to be picked, one lies ready, and it asks for one anew.
        False where it does not go on."""
        roles = [role for role in ("permit_pick", "part_present", "cycle_start") if role in self._by_role]
        self.waits_to_begin = True
        try:
            while goes_on():
                lacking = [role for role in roles if not await self.read(self._by_role[role])]
                if "cycle_start" in roles and not self._start_armed:
                    lacking = [*lacking, "cycle_start"]
                if not lacking:
                    self._start_armed = False
                    return True
                self.waits_for = f"{IN_WORDS[lacking[0]]} ({self._by_role[lacking[0]]})"
                await asyncio.sleep(POLL_S)
            return False
        finally:
            self.waits_for, self.waits_to_begin = None, False

    async def part_held(self) -> bool | None:
        """What the gripper's sensor says now; None: it has none. Raises SignalError, and what the line raises."""
        name = self._by_role.get("part_held")
        return None if name is None else await self.read(name)

    @property
    def valves_at_outputs(self) -> bool:
        """Whether outputs work the valves of a suction cup."""
        return self.has("vacuum")

    async def work_cup(self, closed: bool, works_s: float) -> None:
        """Switch the vacuum on and wait; or switch it off and the blow-off on, wait, and that off again. Where the wait
        is cut off, `watch` switches the blow-off off; the vacuum stays as it was switched last. Raises what the line
        raises; then nobody knows how they are."""
        on_by_name = {self._by_role["vacuum"]: closed}
        if "blow_off" in self._by_role:
            on_by_name[self._by_role["blow_off"]] = not closed
        try:
            async with self._line:
                self._blows = not closed
                await self._switched(on_by_name, self._io.work_valves)
            await asyncio.sleep(works_s)
        finally:
            self._blows = False
        if "blow_off" in self._by_role and not closed:
            await self.switch({self._by_role["blow_off"]: False})

    async def brought(self) -> None:
        """A part was brought: part_done goes on until the line takes note, by a change of its cycle start."""
        if self.has("part_done") or "cycle_start" in self.plc.roles:
            self._start_at_done = await self.read(self._by_role["cycle_start"])
            self.done = True

    async def watch(self, state: PackMLState, stop_seen: int = 0) -> bool:
        """Read what a hand-shake waits for, set the outputs that differ. Gives whether the line asks for a reset.

        stop_seen: of the permit; another one means that the controller may have been switched off, its outputs with it.
        """
        reset = False
        if stop_seen != self._stop_seen:
            self._stop_seen = stop_seen
            self.forget()
        aborted = state is PackMLState.ABORTED
        if self._readable("cycle_start") and self.done and not self.waits_to_begin:
            await self.read(self._by_role["cycle_start"])
        if self._readable("reset"):
            if aborted:
                on = await self.read(self._by_role["reset"])
                heard = "reset" not in self.plc.roles or self.plc.heard
                reset, self._reset_armed = on and self._reset_armed, heard and not on
            else:
                self._reset_armed = False
        await self.set_outputs(state)
        return reset

    async def set_outputs(self, state: PackMLState) -> None:
        """Set the outputs that differ from what they are to be. Raises what the line raises."""
        async with self._line:
            followed = [n for n in self.names(inputs=False) if self.signals[n].role not in VALVES]
            wanted = {name: self._wanted(name, state) for name in followed}
            if "blow_off" in self._by_role:
                wanted[self._by_role["blow_off"]] = self._blows
            changed = {n: on for n, on in wanted.items() if n not in self.levels or self.levels[n].on is not on}
            if changed:
                await self.switch(changed)

    async def switch(self, on_by_name: Mapping[str, bool]) -> None:
        """Switch outputs. Raises what the line raises; then nobody knows how they are, and they are set again."""
        await self._switched(on_by_name, self._io.set_outputs)

    async def _switched(self, on_by_name: Mapping[str, bool], send: Callable[[Sequence[int]], Awaitable[None]]) -> None:
        for name in on_by_name:
            self.levels.pop(name, None)
        numbers = [
            self.signals[name].number if on is (self.signals[name].level == "high") else -self.signals[name].number
            for name, on in on_by_name.items()
        ]
        await send(numbers)
        for name, on in on_by_name.items():
            self._take(name, self.signals[name].role, on)

    def forget(self) -> None:
        """Nobody knows any more how the signals are: outputs are set again."""
        self.levels.clear()

    def _wanted(self, name: str, state: PackMLState) -> bool:
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

    def _take(self, name: str, role: str, on: bool) -> None:
        before = self.levels.get(name)
        self.levels[name] = SignalLevel(on, self._clock())
        if role == "cycle_start":
            self._start_armed |= not on
            if self.done and on != self._start_at_done:
                self.done = False
        if before is None or before.on is not on:
            self._record("signal", name=name, role=role, on=on)


async def keep_watch(
    line: LineSignals,
    state: Callable[[], PackMLState],
    stop_seen: Callable[[], int],
    reset: Callable[[], None],
    trouble: Callable[[str | None], None],
    failures: tuple[type[Exception], ...],
    sleep: Callable[[float], Awaitable[None]] = asyncio.sleep,
) -> None:
    """Follow the cell until cancelled. stop_seen: see watch; reset: called as the line asks to clear a fault; trouble:
    called with the reason where the signals could not be served twice in a row (a stop cuts one command off), None
    once they are; failures: of the line."""
    failed = False
    while line.there:
        try:
            if await line.watch(state(), stop_seen()):
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


class NoSignals:
    """A cell without a line: nothing is read, nothing set."""

    async def set_outputs(self, numbers: Sequence[int]) -> None:
        """Never called."""

    async def work_valves(self, numbers: Sequence[int]) -> None:
        """Never called."""

    async def ask_input(self, text: str) -> str:
        """Never called."""
        return ""


def no_line() -> LineSignals:
    """The signals of a cell that has none."""
    return LineSignals({}, NoSignals(), None, lambda: 0.0, lambda *_, **__: None)
