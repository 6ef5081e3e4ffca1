"""The simulated VAL II controller: what it says and does (core, monitor), and a pseudo-terminal for it (server)."""

from drivers.simcell.controller.core import Controller, Manners
from drivers.simcell.controller.faults import Faults, LineFault, Mishap
from drivers.simcell.controller.server import PtyServer

__all__ = ["Controller", "Faults", "LineFault", "Manners", "Mishap", "PtyServer"]
