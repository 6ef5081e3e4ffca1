"""The simulated VAL II controller: the device (machine), its line (core) with the commands typed at it (monitor,
instructions), and what carries its bytes: a pseudo-terminal (server), or memory alone (memory_line).
"""

from drivers.simcell.controller.core import Controller
from drivers.simcell.controller.faults import Faults, LineFault, Mishap
from drivers.simcell.controller.machine import PENDANT, Machine
from drivers.simcell.controller.manners import Manners
from drivers.simcell.controller.memory_line import MemoryLine
from drivers.simcell.controller.server import PtyServer

__all__ = ["PENDANT", "Controller", "Faults", "LineFault", "Machine", "Manners", "MemoryLine", "Mishap", "PtyServer"]
