"""Simulated VAL II controller: machine, line (core), commands (monitor, instructions), and its transports: a
pseudo-terminal (server) or memory (memory_line)."""

from drivers.simcell.controller.core import Controller
from drivers.simcell.controller.faults import Faults, LineFault, Mishap
from drivers.simcell.controller.machine import Machine
from drivers.simcell.controller.manners import Manners
from drivers.simcell.controller.memory_line import MemoryLine
from drivers.simcell.controller.server import PtyServer

__all__ = ["Controller", "Faults", "LineFault", "Machine", "Manners", "MemoryLine", "Mishap", "PtyServer"]
