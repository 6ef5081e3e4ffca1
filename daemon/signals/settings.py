"""The section `signals` of facetd.yaml: name, number, role and level of each input and output."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Literal, get_args

from msgspec import Meta

from daemon.store.yamlfile import Document

Input = Literal["permit_pick", "permit_place", "cycle_start", "part_present", "part_held", "reset"]
Output = Literal["busy", "part_done", "fault", "vacuum", "blow_off"]
Role = Literal[Input, Output]
VALVES: tuple[str, ...] = ("vacuum", "blow_off")
"""Outputs that work a suction cup: only the gripper switches them."""
PLCRole = Literal["permit_pick", "permit_place", "cycle_start", "part_present", "reset"]
OnStop = Literal["on", "off", "hold"]
INPUTS: tuple[str, ...] = get_args(Input)
ON_STOP: Mapping[str, OnStop] = {"busy": "off", "part_done": "hold"}
"""What an output becomes when the arm is stopped, where the file does not say it."""


@dataclass(frozen=True, kw_only=True)
class SignalSettings:
    """A digital input or output of the controller. At most one signal has each role."""

    number: Annotated[int, Meta(ge=1, le=9999)]
    """Number of the input or output on this controller. On many controllers outputs count from 1, inputs from 1001."""
    role: Role
    """Inputs: `permit_pick` and `permit_place` let the arm move to pick and to set down; `cycle_start` asks for one
    part; `part_present`: a part lies ready; `part_held`, the gripper's own sensor (a vacuum switch, a switch between
    the fingers): a part is in the gripper; `reset` clears a fault. Outputs: `busy` while a part is picked and brought;
    `part_done` from when a part was brought until the line acknowledges it; `fault` while a fault is active; `vacuum`
    and `blow_off`: the valves of a suction cup, in place of CLOSEI and OPENI."""
    level: Literal["high", "low"] = "high"
    """Level at which it counts as on. `low` for an input that is on without current, as a broken wire is."""
    on_stop: OnStop | None = None
    """`busy` and `part_done`: what it becomes when the arm is stopped, a fault is set or facetd ends. Unset: `off` for
    `busy`, `hold` (unchanged) for `part_done`."""

    @property
    def is_input(self) -> bool:
        return self.role in INPUTS


@dataclass(frozen=True, kw_only=True)
class ModbusSettings:
    """Modbus TCP for a PLC, on a socket that systemd hands in (facetd-modbus.socket). Needs the extra `modbus`."""

    roles: tuple[PLCRole, ...] = ()
    """Roles that the PLC sets by coils, in place of inputs of the controller. Without a connected PLC each is off."""
    silence_s: Annotated[float, Meta(ge=0.1, le=60)] = 1.0
    """Longest time between two requests of the PLC, s. After that its coils count as off."""


def check_signals(document: Document, signals: Mapping[str, SignalSettings], modbus: ModbusSettings | None) -> None:
    """Check the signals together. Raises ConfigError."""
    by_plc = () if modbus is None else modbus.roles
    for role in by_plc:
        if by_plc.count(role) > 1 or any(signal.role == role for signal in signals.values()):
            raise document.error(("modbus", "roles"), f"expected {role} once, here or in the section signals")
    roles, numbers = Counter(s.role for s in signals.values()), Counter(s.number for s in signals.values())
    for name, signal in signals.items():
        if roles[signal.role] > 1:
            raise document.error(("signals", name, "role"), f"expected one signal with role {signal.role}, found more")
        if numbers[signal.number] > 1:
            raise document.error(("signals", name, "number"), f"expected its own number, found {signal.number} twice")
        if signal.on_stop is not None and signal.role not in ON_STOP:
            problem = "expected no on_stop: it is for busy and part_done (`fault` is on after a stop; valves stay)"
            raise document.error(("signals", name, "on_stop"), problem)
        if signal.role in ("permit_pick", "permit_place") and signal.level == "low":
            problem = "expected high: a broken wire must not permit motion; invert the permit at the line"
            raise document.error(("signals", name, "level"), problem)
        if signal.role == "blow_off" and not roles["vacuum"]:
            problem = "expected an output with the role vacuum beside blow_off: without it OPENI blows the part off"
            raise document.error(("signals", name, "role"), problem)
        if signal.role == "part_done" and not (roles["cycle_start"] or "cycle_start" in by_plc):
            problem = "expected an input with the role cycle_start beside part_done: it acknowledges the part"
            raise document.error(("signals", name, "role"), problem)
