"""The simulated VAL II controller: the device (machine), its line (core) with the commands typed at it (monitor,
instructions), and a pseudo-terminal for it (server)."""

from drivers.simcell.controller.core import Controller
from drivers.simcell.controller.faults import Faults, LineFault, Mishap
from drivers.simcell.controller.machine import Machine
from drivers.simcell.controller.manners import Manners
from drivers.simcell.controller.server import PtyServer

__all__ = ["Controller", "Faults", "LineFault", "Machine", "Manners", "Mishap", "PtyServer"]
