"""Find camera devices by name and list what they offer. Reads devices, changes nothing.

Numbers change at boot; by-id and by-path links and card names survive unplugging.
"""

import errno
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

from drivers.camera import v4l2
from drivers.camera.controls import Control, list_controls
from drivers.camera.node import LINUX, FileNode, Linux
from drivers.camera.pair import CameraError


@dataclass(frozen=True)
class Offer:
    """One pixel format: code, the driver's description, sizes as text, with the frame rates of discrete sizes."""

    code: str
    description: str
    sizes: tuple[str, ...]

    def __str__(self) -> str:
        """Such as `YUYV 640x480 (30, 15 fps), 320x240 (30 fps)`."""
        return f"{self.code} {', '.join(self.sizes) or 'any size'}"


@dataclass(frozen=True)
class Device:
    """One node that captures video: path, names, formats, controls."""

    path: str
    card: str
    driver: str
    bus: str
    links: tuple[str, ...]
    formats: tuple[Offer, ...] = ()
    controls: tuple[Control, ...] = ()


@contextmanager
def kernel_errors(camera: str, path: str, system: Linux) -> Iterator[None]:
    """Context: raise errors of the kernel as CameraError: what happened and what to do."""
    try:
        yield
    except OSError as error:
        why = f": {error.strerror or error}"
        if error.errno in (errno.EACCES, errno.EPERM):
            why = ": permission denied: add this user to the group `video` (usermod -aG video USER)"
        elif error.errno == errno.ENOSPC:
            why = (
                ": the USB controller lacks the bandwidth for this stream: lower cameras.fps or the size, put MJPEG "
                "first in cameras.formats, or plug one camera into another controller"
            )
        elif error.errno == errno.EBUSY:
            why = f" is busy: {', '.join(system.holders(path)) or 'another program'} has it; stop that first"
        elif error.errno in (errno.ENOENT, errno.ENODEV, errno.ENXIO, errno.EIO, errno.EPROTO, errno.EPIPE):
            why = f" is gone ({error.strerror}): unplugged? facetd looks for it again at the next picture"
        raise CameraError(f"{camera} camera {path}{why}") from error


def _rates(node: FileNode, code: int, width: int, height: int) -> str:
    intervals = [
        i.values[0] for i in v4l2.enumerate_intervals(node, code, width, height) if i.type == v4l2.SIZE_DISCRETE
    ]
    rates = ", ".join(f"{i.denominator / i.numerator:g}" for i in intervals if i.numerator)
    return f" ({rates} fps)" if rates else ""


def _size(node: FileNode, code: int, size: v4l2.FrameSize) -> str:
    v = list(size.values)
    if size.type == v4l2.SIZE_DISCRETE:
        return f"{v[0]}x{v[1]}{_rates(node, code, v[0], v[1])}"
    return f"{v[0]}x{v[3]} to {v[1]}x{v[4]}"


def offers(node: FileNode) -> tuple[Offer, ...]:
    """Every pixel format with its sizes. Raises OSError."""
    found = []
    for entry in v4l2.enumerate_formats(node):
        try:
            sizes = tuple(_size(node, entry.pixelformat, s) for s in v4l2.enumerate_sizes(node, entry.pixelformat))
        except OSError:  # drivers need not list sizes
            sizes = ()
        found.append(Offer(v4l2.code_of(entry.pixelformat), entry.description.decode("utf-8", "replace"), sizes))
    return tuple(found)


def examine(path: str, system: Linux, full: bool = True) -> Device | None:
    """The device at a node; None where it does not capture video. full: with formats and controls. Raises OSError."""
    node = system.open(path)
    try:
        capability = v4l2.query_capability(node)
        if not v4l2.can_capture(capability):
            return None
        named = (capability.card, capability.driver, capability.bus_info)
        card, driver, bus = (name.decode("utf-8", "replace") for name in named)
        found = Device(path, card, driver, bus, tuple(system.links(path)))
        return replace(found, formats=offers(node), controls=tuple(list_controls(node))) if full else found
    finally:
        node.close()


def list_devices(system: Linux, full: bool = True) -> tuple[list[Device], list[str]]:
    """Every node that captures video, and a line for each that could not be read."""
    devices, notes = [], []
    for path in system.nodes():
        try:
            device = examine(path, system, full)
        except OSError as error:
            notes.append(f"{path}: {error.strerror}")
            continue
        if device:
            devices.append(device)
    return devices, notes


def device_rows(system: Linux = LINUX) -> tuple[list[dict[str, Any]], list[str]]:
    """Every capture device as a row for listings and machines, and a line for each node that cannot be read."""
    devices, notes = list_devices(system)
    rows = [
        {
            "path": device.path, "card": device.card, "driver": device.driver, "bus": device.bus,
            "links": list(device.links), "formats": [f"{o}  {o.description}" for o in device.formats],
            "controls": [str(control) for control in device.controls],
        }
        for device in devices
    ]  # fmt: skip
    return rows, notes


def _choices(devices: Iterable[Device], notes: Iterable[str], nodes: Sequence[str] = ()) -> str:
    lines = [f"{d.path} `{d.card}`{''.join(f' {link}' for link in d.links)}" for d in devices]
    idle = f"only {', '.join(nodes)}, which capture no video" if nodes else "no video device at all"
    return "; ".join([*lines, *notes]) or idle


def find(name: str, camera: str, system: Linux) -> str:
    """The node of a device name (see CameraSettings). Raises CameraError, which lists the devices there are."""
    path = system.resolve(f"/dev/video{name}" if name.isdigit() else name)
    if path is not None:
        return path
    devices, notes = list_devices(system, full=False)
    by_link = [d for d in devices if any(link == name or link.endswith(f"/{name}") for link in d.links)]
    matching = by_link or [d for d in devices if d.card == name]
    if len(matching) == 1:
        return matching[0].path
    if matching:
        raise CameraError(
            f"{camera} camera: {len(matching)} devices are called `{name}`; "
            f"name one by its path: {_choices(matching, [])}"
        )
    raise CameraError(f"{camera} camera `{name}` is not there; there is: {_choices(devices, notes, system.nodes())}")
