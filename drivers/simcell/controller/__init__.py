"""Simulated VAL II controller: machine, line (core), commands (monitor, instructions), and its pseudo-terminal
(server)."""

from drivers.simcell.controller.core import Controller
from drivers.simcell.controller.faults import Faults, LineFault, Mishap
from drivers.simcell.controller.machine import Machine
from drivers.simcell.controller.manners import Manners
from drivers.simcell.controller.server import PtyServer
