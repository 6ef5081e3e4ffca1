"""What a running command may wait for, and what a command is. Values only."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass


@dataclass(frozen=True)
class Wait:
    """A command waits for a moment."""

    until_s: float


@dataclass(frozen=True)
class Ask:
    """A command waits for an answer."""

    question: str


Command = Generator[Wait | Ask, str | None, None]
