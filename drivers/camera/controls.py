"""V4L2 controls (exposure, gain, white balance, focus and others): list, set, read back, freeze automatic ones."""

import re
from collections.abc import Container, Mapping
from dataclasses import dataclass, field

from drivers.camera import v4l2
from drivers.camera.pair import CameraError
from drivers.camera.settings import Wish


@dataclass(frozen=True)
class KnownControl:
    """A control that facetd names with a unit: its V4L2 id, the device's unit in ours, its automatic control's id, and
    the values of that for off and on."""

    control: int
    unit: float
    automatic: int
    off: int
    on: int


KNOWN = {
    # EXPOSURE_ABSOLUTE; EXPOSURE_AUTO manual, aperture first
    "exposure_us": KnownControl(0x009A0902, 100.0, 0x009A0901, 1, 3),
    "gain": KnownControl(0x00980913, 1.0, 0x00980912, 0, 1),
    "white_balance_k": KnownControl(0x0098091A, 1.0, 0x0098090C, 0, 1),
    "focus": KnownControl(0x009A090A, 1.0, 0x009A090C, 0, 1),
}


RENAMED = {
    "exposure_auto": "auto_exposure",
    "exposure_absolute": "exposure_time_absolute",
    "exposure_auto_priority": "exposure_dynamic_framerate",
    "white_balance_temperature_auto": "white_balance_automatic",
    "focus_auto": "focus_automatic_continuous",
    "hue_auto": "hue_automatic",
}
"""Names of UVC controls before Linux 5.16 -> since."""


def renamed(wishes: Mapping[str, Wish], offered: Container[str]) -> dict[str, str]:
    """Wished names that this device offers under their older or newer name: wished name -> its name here."""
    both = RENAMED | {new: old for old, new in RENAMED.items()}
    return {name: both[name] for name in wishes if name not in offered and both.get(name) in offered}


@dataclass(frozen=True)
class Control:
    """One control as the device reports it. value: None where it cannot be read; menu: text by value."""

    id: int
    name: str
    minimum: int
    maximum: int
    step: int
    value: int | None
    writable: bool
    menu: Mapping[int, str] = field(default_factory=dict)

    def __str__(self) -> str:
        """Such as `gain 0..255 step 1 (now 16)`."""
        offer = ", ".join(f"{k} = {v}" for k, v in self.menu.items()) or f"{self.minimum}..{self.maximum}"
        step = f" step {self.step}" if self.step > 1 else ""
        now = "" if self.value is None else f" (now {self.value})"
        return f"{self.name} {offer}{step}{now}"


def _name(text: bytes) -> str:
    """`White Balance, Automatic` -> `white_balance_automatic`, as v4l2-ctl names it."""
    return re.sub(r"[^a-z0-9]+", "_", text.decode("utf-8", "replace").lower()).strip("_")


def _menu(node: v4l2.Node, entry: v4l2.QueryControl) -> dict[int, str]:
    lines = {}
    for index in range(max(0, entry.minimum), entry.maximum + 1):
        try:
            item = v4l2.menu_item(node, entry.id, index)
        except OSError:
            continue  # menus may have holes
        words = bytes(item.item.name).decode("utf-8", "replace")
        lines[index] = words if entry.type == v4l2.MENU else str(item.item.value)
    return lines


def _value(node: v4l2.Node, entry: v4l2.QueryControl) -> int | None:
    readable = not entry.flags & v4l2.CONTROL_WRITE_ONLY and entry.type != v4l2.BUTTON
    try:
        return v4l2.get_control(node, entry.id) if readable else None
    except OSError:
        return None


def _describe(node: v4l2.Node, entry: v4l2.QueryControl, menu: Mapping[int, str]) -> Control:
    writable = not entry.flags & v4l2.CONTROL_READ_ONLY
    value = _value(node, entry)
    return Control(entry.id, _name(entry.name), entry.minimum, entry.maximum, entry.step, value, writable, menu)


def list_controls(node: v4l2.Node) -> list[Control]:
    """All numeric controls of a device. Raises OSError."""
    found = []
    for entry in v4l2.enumerate_controls(node):
        if entry.type in (v4l2.STRING, v4l2.INTEGER64) or entry.type > v4l2.INTEGER_MENU:
            continue
        menu = _menu(node, entry) if entry.type in (v4l2.MENU, v4l2.INTEGER_MENU) else {}
        found.append(_describe(node, entry, menu))
    return found


def _wished(name: str, wish: Wish, offered: Mapping[str, Control], camera: str) -> tuple[Control, int]:
    """The control of a wish and the value to set, in the device's unit. Raises CameraError where the device lacks
    it."""
    known = KNOWN.get(name)
    name_here = renamed({name: wish}, offered).get(name, name)
    control = next((c for c in offered.values() if known and c.id == known.control), offered.get(name_here))
    if control is None:
        have = "; ".join(map(str, offered.values())) or "no controls at all"
        raise CameraError(f"{camera} camera: cannot set {name}: the device does not offer it. It offers: {have}")
    if isinstance(wish, str):
        raise CameraError(
            f"{camera} camera: {name}: expected a number, or `auto` where the camera has an automatic control"
        )
    value = round(wish / known.unit) if known else round(wish)
    if (control.menu and value not in control.menu) or not control.minimum <= value <= control.maximum:
        requested = f"{wish:g}" if not known or known.unit == 1.0 else f"{wish:g} ({value} in the device's unit)"
        raise CameraError(f"{camera} camera: cannot set {name} to {requested}: the device offers {control}")
    return control, value


def _on(node: v4l2.Node, known: KnownControl) -> int:
    """The value that turns an automatic control on: exposure has two modes, and a camera may offer only the full one
    (0)."""
    if known.on > 1:
        try:
            v4l2.menu_item(node, known.automatic, known.on)
        except OSError:
            return 0
    return known.on


def _set(node: v4l2.Node, camera: str, control: Control, value: int) -> int:
    """Set one control and read it back; a difference of less than a step is rounding."""
    try:
        v4l2.set_control(node, control.id, value)
        took = v4l2.get_control(node, control.id)
    except OSError as error:
        raise CameraError(f"{camera} camera: cannot set {control.name} to {value}: {error.strerror}") from error
    if abs(took - value) >= max(control.step, 1):
        raise CameraError(
            f"{camera} camera: {control.name} was set to {value} but reads back {took}; it offers {control}"
        )
    return took


def apply(node: v4l2.Node, camera: str, wishes: Mapping[str, Wish]) -> dict[str, int]:
    """Set the wished controls and read them back: control name -> value in the device's unit. Raises CameraError.

    An automatic control that would override a wished value is turned off first; for the wish `auto` it is turned on.
    """
    took: dict[str, int] = {}
    for name, wish in wishes.items():
        offered = {c.name: c for c in list_controls(node) if c.writable}
        known = KNOWN.get(name)
        automatism = next((c for c in offered.values() if known and c.id == known.automatic), None)
        if known and automatism:
            took[automatism.name] = _set(node, camera, automatism, _on(node, known) if wish == "auto" else known.off)
            if wish == "auto":
                continue
        control, value = _wished(name, wish, offered, camera)
        took[control.name] = _set(node, camera, control, value)
    return took


def brighten(node: v4l2.Node, camera: str, factor: float, longest_s: float) -> float | None:
    """Multiply the exposure time (at most longest_s), or the gain where there is no exposure control, by a factor.

    Turns off the automatic control. Returns the factor that the device accepted; None where it has neither control.
    Raises CameraError, OSError.
    """
    offered = {c.id: c for c in list_controls(node) if c.writable}
    for known in (KNOWN["exposure_us"], KNOWN["gain"]):
        control = offered.get(known.control)
        if control is None or not control.value:
            continue
        longest = longest_s * 1e6 / known.unit if known is KNOWN["exposure_us"] else control.maximum
        if known.automatic in offered:
            _set(node, camera, offered[known.automatic], known.off)
        value = min(max(control.value * factor, control.minimum, control.step), control.maximum, longest)
        return _set(node, camera, control, round(value)) / control.value
    return None


def hold(node: v4l2.Node, wishes: Mapping[str, Wish]) -> None:
    """Freeze every control wished `auto` at its present value, before a look. Raises OSError."""
    for name, wish in wishes.items():
        if wish == "auto":
            reached = v4l2.get_control(node, KNOWN[name].control)
            v4l2.set_control(node, KNOWN[name].automatic, KNOWN[name].off)
            v4l2.set_control(node, KNOWN[name].control, reached)


def release(node: v4l2.Node, wishes: Mapping[str, Wish]) -> None:
    """Turn every control wished `auto` on again, after a look. Raises OSError."""
    for name, wish in wishes.items():
        if wish == "auto":
            v4l2.set_control(node, KNOWN[name].automatic, _on(node, KNOWN[name]))


def exposure_s(node: v4l2.Node) -> float:
    """Exposure time, s; 0 where the device does not report it."""
    known = KNOWN["exposure_us"]
    try:
        return v4l2.get_control(node, known.control) * known.unit * 1e-6
    except OSError:
        return 0.0
