"""Fault injection: scripted faults of the line and the machine. Deterministic; no clock."""

from dataclasses import dataclass, field
from enum import Enum
from typing import Literal

import numpy as np


class Mishap(Enum):
    """Mishaps of the machine, during a move or at any other moment."""

    POWER_LOST = "arm power lost"
    EMERGENCY_STOP = "emergency stop"
    ENVELOPE_ERROR = "envelope error"
    POWER_CYCLED = "controller power cycled"
    DEAD = "controller dead"


@dataclass
class LineFault:
    """Damage to the bytes of one direction. after: bytes that pass undamaged first; count: bytes damaged then."""

    way: Literal["to_host", "to_controller"]
    harm: Literal["drop", "double", "flip", "insert"]
    after: int = 0
    count: int = 1


@dataclass
class Faults:
    """The pending faults. Tests add to them at any time; each is removed when it has happened."""

    line: list[LineFault] = field(default_factory=list)
    noise_rate: float = 0.0
    """Probability that a byte, either way, is replaced by a random one."""
    refusals: list[str] = field(default_factory=list)
    """Messages (with asterisks) that refuse the next motions."""
    in_move: list[tuple[float, Mishap]] = field(default_factory=list)
    """(share of the move's time, mishap), one for each of the next moves."""
    split_prompt_s: float = 0.0
    """Pause between the line end before a prompt and its dot."""
    mute_answers: int = 0
    """Number of the next answers (with prompt) that are lost."""
    late_answers: int = 0
    """Number of the next answers (with prompt) that are delayed until the answer to the next line."""
    repeated_places: int = 0
    """Number of the next WHEREs that repeat the output of the one before."""
    pendant_s: float = 0.0
    """Time that the person at the pendant takes when CAL needs them."""

    def __post_init__(self) -> None:
        self._rng = np.random.default_rng(0)

    def seed_noise(self, seed: int, rate: float) -> None:
        """Start noise, reproducible by the seed."""
        self._rng, self.noise_rate = np.random.default_rng(seed), rate

    def harm(self, data: bytes, way: Literal["to_host", "to_controller"]) -> bytes:
        """The bytes that arrive of data sent one way."""
        if not self.line and not self.noise_rate:
            return data
        return b"".join(self._harm_byte(byte, way) for byte in data)

    def _harm_byte(self, byte: int, way: str) -> bytes:
        if self.noise_rate and self._rng.random() < self.noise_rate:
            return bytes([int(self._rng.integers(256))])
        for fault in self.line:
            if fault.way != way:
                continue
            if fault.after > 0:
                fault.after -= 1
                continue
            fault.count -= 1
            if fault.count <= 0:
                self.line.remove(fault)
            return {
                "drop": b"",
                "double": bytes([byte, byte]),
                "flip": bytes([byte ^ 0x01]),
                "insert": bytes([byte, 0x23]),
            }[fault.harm]
        return bytes([byte])
