"""Devices and running cameras as plain rows for listings and machines. Reads only."""

from __future__ import annotations

from typing import Any

from drivers.camera.find import list_devices
from drivers.camera.node import LINUX, System
from drivers.camera.pair import StereoCamera
from drivers.camera.stereo import V4L2StereoCamera


def device_rows(system: System = LINUX) -> tuple[list[dict[str, Any]], list[str]]:
    """Every device that captures video, with what it offers in words, and a line for each that cannot be looked at."""
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


def eye_rows(camera: StereoCamera) -> list[dict[str, Any]]:
    """What each eye of open V4L2 cameras took of the wished controls and delivered; nothing for other cameras."""
    reports = camera.reports() if isinstance(camera, V4L2StereoCamera) else ()
    return [
        {
            "line": report.line, "controls": report.controls, "renamed": report.renamed, "frames": report.tally.frames,
            "dropped": report.tally.dropped, "damaged": report.tally.damaged,
        }
        for report in reports
    ]  # fmt: skip
