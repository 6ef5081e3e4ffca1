"""Hostility on demand: what goes wrong on the line and in the machine, scripted beforehand. Deterministic; no clock."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from typing import Literal

import numpy as np


class Mishap(Enum):
    """What may befall the machine in the middle of a move (or at any other moment)."""

    POWER_LOST = "arm power lost"
    EMERGENCY_STOP = "emergency stop"
    ENVELOPE_ERROR = "envelope error"
    POWER_CYCLED = "controller power cycled"
    DEAD = "controller dead"


@dataclass
class LineFault:
    """Harm to the bytes of one direction.

    way: to the host or to the controller. after: how many bytes pass unharmed first. count: how many are harmed then.
    """

    way: Literal["to_host", "to_controller"]
    harm: Literal["drop", "double", "flip", "insert"]
    after: int = 0
    count: int = 1


@dataclass
class Faults:
    """Everything that shall go wrong. Tests add to it at any time; what has happened is taken out."""

    line: list[LineFault] = field(default_factory=list)
    noise_rate: float = 0.0
    """Probability that a byte, either way, is replaced by a random one."""
    refusals: list[str] = field(default_factory=list)
    """Messages (with their asterisks) with which the next motions are refused."""
    in_move: list[tuple[float, Mishap]] = field(default_factory=list)
    """(share of the move's time, what happens), one for each of the next moves."""
    split_prompt_s: float = 0.0
    """Pause between the line end before a prompt and its dot."""
    mute_answers: int = 0
    """How many of the next answers (prompt included) are swallowed."""
    late_answers: int = 0
    """How many of the next answers (prompt included) come only with the answer to the line after."""
    repeated_places: int = 0
    """How many of the next WHEREs print what the WHERE before them printed."""
    pendant_s: float = 0.0
    """How long the person at the pendant takes when CAL needs them."""

    def __post_init__(self) -> None:
        self._rng = np.random.default_rng(0)

    def seed_noise(self, seed: int, rate: float) -> None:
        """Noise from now on, the same for the same seed."""
        self._rng, self.noise_rate = np.random.default_rng(seed), rate

    def harm(self, data: bytes, way: Literal["to_host", "to_controller"]) -> bytes:
        """What arrives of data sent one way."""
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
