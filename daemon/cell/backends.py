"""The kinds of cell by name: facetd's own, and those that other distributions bring as entry points. Opens no device.

A back-end is a `CellBackend`. One that is not facetd's own is an entry point of the group `facetd.cells`: its name is
what `cell` in facetd.yaml names, its section there is `backend`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any

from daemon.arm import ArmModel, Beliefs
from daemon.config import Config

if TYPE_CHECKING:
    from daemon.cell.hardware import Hardware

OWN = {
    **{name: f"daemon.cell.own_cells:{name.upper()}" for name in ("real", "linuxcnc", "recorded")},
    "simulated": "daemon.cell.simulated_cell:SIMULATED",
}
GROUP = "facetd.cells"
WireListener = Callable[[dict[str, Any]], None]


@dataclass(frozen=True)
class Surroundings:
    """What the daemon gives to a cell. on_wire: takes every record of a controller's line; clock:
    seconds, monotonic, which stamps frames and answers; beliefs: what is believed of arm and gripper."""

    on_wire: WireListener
    clock: Callable[[], float]
    beliefs: Beliefs


@dataclass(frozen=True)
class CellBackend:
    """A kind of cell. check: its sections of the configuration, raises ConfigError; arm: its arm as data; build: its
    hardware, not yet opened, raises ConfigError, CellError."""

    check: Callable[[Config], None]
    arm: Callable[[Config], ArmModel]
    build: Callable[[Config, Surroundings], "Hardware"]


def backend_of(config: Config) -> CellBackend:
    """The back-end that `cell` names. Raises ConfigError where there is none, or it cannot be loaded."""
    if config.kind in OWN:
        module, name = OWN[config.kind].split(":")
        found: CellBackend = getattr(import_module(module), name)
        return found
    from importlib.metadata import entry_points  # for a back-end of others alone: it takes 10 ms

    others = {one.name: one for one in entry_points(group=GROUP)}
    if config.kind not in others:
        known = ", ".join((*OWN, *sorted(others)))
        raise config.document.error(("cell",), f"expected one of {known}, found {config.kind!r}")
    plug = others[config.kind]
    try:
        loaded = plug.load()
    except (ImportError, AttributeError) as error:
        raise config.document.error(("cell",), f"{plug.value} cannot be loaded: {error}") from error
    if not isinstance(loaded, CellBackend):
        raise config.document.error(("cell",), f"{plug.value} is no CellBackend of daemon/cell/backends.py")
    return loaded
