"""Commands `facetctl cameras`, `snap` and `stream`: the cameras without a daemon.

Exit status: 0 done, 1 the cameras do not work (one line with the reason), 2 unusable arguments or files.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import sys
import time
from collections import deque
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from daemon.quantities import decimal, whole, within
from daemon.store import folders

if TYPE_CHECKING:
    from daemon.cell.cameras import StereoCamera, StereoPair
    from daemon.cli.preview import Shot
    from daemon.config import Config

GRAB_S = 5.0
"""Longest wait for one pair."""


def register(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add `cameras`, `snap` and `stream` to facetctl."""
    cameras = subparsers.add_parser("cameras", help="list the cameras; rate, skew and drops of the configured pair")
    cameras.add_argument("--seconds", type=within(decimal, 0.0), default=3.0, help="time to measure (3; 0: only list)")
    snap = subparsers.add_parser("snap", help="save stereo pairs as left.png and right.png")
    snap.add_argument("folder", type=Path, metavar="DIR", help="the folder to write to")
    snap.add_argument("--count", type=within(whole, 1, 100_000), default=1, help="more than one: DIR/1, DIR/2, ...")
    snap.add_argument("--every", type=within(decimal, 0.0), default=1.0, metavar="SECONDS", help="time in between (1)")
    stream = subparsers.add_parser("stream", help="a live image for a browser on this machine, with the facets found")
    stream.add_argument("--port", type=within(whole, 0, 65535), default=8080, help="on 127.0.0.1 (default 8080)")
    stream.add_argument("--fps", type=within(decimal, 0.1), default=5.0, help="most images a second (default 5)")
    stream.add_argument("--plain", action="store_true", help="the images only: without recognition")
    for parser, run in ((cameras, _cameras), (snap, _snap), (stream, _stream)):
        parser.add_argument("--config", type=Path, default=folders.config_file(), metavar="FILE", help="configuration")
        parser.add_argument("--sim", action="store_true", help="the simulated cell's cameras")
        parser.add_argument("--json", action="store_true", help="JSON for programs")
        parser.set_defaults(run=_guarded(run))


def _guarded(run: Callable[[argparse.Namespace], int]) -> Callable[[argparse.Namespace], int]:
    """Wrap a command: an error of the cameras is one line and status 1."""

    def guarded(args: argparse.Namespace) -> int:
        from daemon.cell.hardware import EXPECTED_ERRORS

        try:
            return run(args)
        except EXPECTED_ERRORS as error:
            print(f"facetctl: {error}", file=sys.stderr)
            return 1

    return guarded


@contextlib.contextmanager
def _open(args: argparse.Namespace) -> Iterator[tuple[StereoCamera, Config]]:
    from daemon.cell.build import cameras_alone
    from daemon.config import load_config

    config = load_config(args.config, args.sim)
    with cameras_alone(config) as camera:
        yield camera, config


def _cameras(args: argparse.Namespace) -> int:
    from daemon.cell.cameras import device_rows
    from daemon.cell.hardware import EXPECTED_ERRORS

    devices, notes = device_rows()
    measured: dict[str, Any] | None = None
    trouble = None
    if args.seconds > 0:
        try:
            with _open(args) as (camera, _):
                measured = measure(camera, args.seconds, time.monotonic)
        except EXPECTED_ERRORS as error:
            trouble = str(error)
    if args.json:
        print(json.dumps({"devices": devices, "notes": notes, "pair": measured, "trouble": trouble}))
    else:
        print("\n".join([*_listing(devices, notes), *_pair_lines(measured)]))
        if trouble:
            print(f"facetctl: {trouble}", file=sys.stderr)
    return int(trouble is not None)


def _listing(devices: list[dict[str, Any]], notes: list[str]) -> Iterator[str]:
    for device in devices:
        yield f"{device['path']}  `{device['card']}`  ({device['driver']}, {device['bus']})"
        yield from (f"    {link}" for link in device["links"])
        yield from (f"    {line}" for line in device["formats"])
        yield from (f"    {line}" for line in device["controls"])
    yield from notes
    if not devices:
        yield "No device here captures video."


def _pair_lines(measured: dict[str, Any] | None) -> Iterator[str]:
    if measured is None:
        return
    yield f"The configured pair: {measured['cameras']}"
    yield (
        f"    {measured['pairs']} pairs in {measured['seconds']:.1f} s: {measured['rate_hz']:.1f} a second, "
        f"skew median {measured['skew_ms']:.1f} ms, worst {measured['worst_skew_ms']:.1f} ms, "
        f"age at delivery {measured['age_ms']:.0f} ms"
    )
    for one in measured["eyes"]:
        took = ", ".join(f"{k} {v}" for k, v in one["controls"].items()) or "as found"
        yield f"    {one['line']}: {one['frames']} frames, {one['dropped']} dropped, {one['damaged']} damaged; {took}"
        yield from (f"        {old} is called {new} here: use that name" for old, new in one["renamed"].items())
    for camera, found in measured["steadiness"].items():
        yield from (f"    {camera} camera: {line}" for line in (*found["faults"], found["shutter"]) if line)
    if any(found["shutter"] is None for found in measured["steadiness"].values()):
        yield (
            "    Rolling shutter: not measured, as nothing moved to and fro. Repeat with --seconds 5; meanwhile move "
            "the arm with its pendant, or a newspaper that fills the view."
        )


def measure(camera: StereoCamera, seconds: float, clock: Callable[[], float]) -> dict[str, Any]:
    """Grab pairs for a while: rate, skew and age, the frames that each camera lost, and what it does not hold."""
    from daemon.cell.cameras import camera_rows
    from daemon.vision.health import MAX_IMAGES

    camera.grab(clock(), GRAB_S)
    began_s = clock()
    skews: list[float] = []
    ages = []
    kept: deque[StereoPair] = deque(maxlen=MAX_IMAGES)
    while not skews or clock() - began_s < seconds:
        pair = camera.grab(clock(), GRAB_S)
        kept.append(pair)
        skews.append(abs(pair.skew_ms))
        ages.append((clock() - pair.right.taken_s) * 1000.0)
    took_s = clock() - began_s
    middle = len(skews) // 2
    return {
        "cameras": camera.describe(), "seconds": took_s, "pairs": len(skews), "rate_hz": len(skews) / took_s,
        "skew_ms": sorted(skews)[middle], "worst_skew_ms": max(skews), "age_ms": sorted(ages)[middle],
        "eyes": camera_rows(camera), "steadiness": _steadiness(kept),
    }  # fmt: skip


def _steadiness(pairs: Collection[StereoPair]) -> dict[str, dict[str, Any]]:
    """What each camera does not hold, and how long it takes to read out its rows, as rows for people and JSON."""
    from daemon.arm import CAMERA_NAMES
    from daemon.cell.camera_trial import steadiness

    found: dict[str, dict[str, Any]] = {}
    for camera in CAMERA_NAMES:
        one = steadiness(pairs, camera)
        readout_ms = None if math.isnan(one.readout_s) else round(1000 * one.readout_s, 1)
        found[camera] = {"faults": one.faults(), "shutter": one.shutter, "readout_ms": readout_ms}
    return found


def _snap(args: argparse.Namespace) -> int:
    with _open(args) as (camera, config):
        rig = _rig(config)
        for number in range(args.count):
            if number:
                time.sleep(args.every)
            folder = args.folder / str(number + 1) if args.count > 1 else args.folder
            taken = _save(camera, folder, rig)
            print(json.dumps(taken) if args.json else "\n".join([f"{folder}: {taken['cameras']}", *taken["troubles"]]))
    return 0


def _save(camera: StereoCamera, folder: Path, rig: Any) -> dict[str, Any]:
    """Write one pair into a folder: left.png, right.png, and snap.json with times, skew and measures of the images."""
    import cv2

    from daemon.vision.health import examine, findings_json, troubles

    pair = camera.grab(time.monotonic(), GRAB_S)
    findings = examine((pair.left.pixels, pair.right.pixels), None, rig)
    folder.mkdir(parents=True, exist_ok=True)
    for name, frame in (("left", pair.left), ("right", pair.right)):
        done, png = cv2.imencode(".png", frame.pixels)
        assert done
        (folder / f"{name}.png").write_bytes(png.tobytes())
    taken = {
        "folder": str(folder), "cameras": camera.describe(), "skew_ms": round(pair.skew_ms, 3),
        "taken_s": [pair.left.taken_s, pair.right.taken_s], "sequence": [pair.left.sequence, pair.right.sequence],
        "health": findings_json(findings), "troubles": list(troubles(findings)),
    }  # fmt: skip
    (folder / "snap.json").write_text(json.dumps(taken, indent=1) + "\n")
    return taken


def _stream(args: argparse.Namespace) -> int:
    from daemon.cell.hardware import EXPECTED_ERRORS
    from daemon.cli.preview import Preview

    with _open(args) as (camera, config):
        try:
            preview = Preview(_shooter(camera, config, args.plain), args.port, args.fps, EXPECTED_ERRORS)
        except OSError as error:
            raise OSError(error.errno, f"{error.strerror}: choose another --port", f"127.0.0.1:{args.port}") from None
        served = {"address": preview.address, "cameras": camera.describe()}
        print(json.dumps(served) if args.json else f"{preview.address}  (control-C ends it)", flush=True)
        with contextlib.suppress(KeyboardInterrupt):
            preview.serve()
    return 0


def _shooter(camera: StereoCamera, config: Config, plain: bool) -> Callable[[], Shot]:
    """A function that makes one image of the preview: the pair with its facets, and some lines of text."""
    import cv2
    import numpy as np

    from daemon.store.model_store import ModelStore
    from daemon.vision.draw import draw_scene
    from daemon.vision.health import drift, examine, troubles
    from daemon.vision.image import VisionError
    from daemon.vision.look import look

    rig = None if plain else _rig(config)
    model_store = ModelStore(config.state)
    model = model_store.load(model_store.current).model if rig and model_store.current is not None else None
    before: list[tuple[Any, Any]] = []

    def shoot() -> Shot:
        pair = camera.grab(time.monotonic(), GRAB_S)
        images = (pair.left.pixels, pair.right.pixels)
        lines, scene = [], None
        if rig is not None:
            try:
                scene = look(*images, rig, model, config.values.vision)
                lines = [f"{p.recognition.label} ({p.recognition.confidence:.2f})" for p in scene.parts]
            except VisionError as error:
                lines = [str(error)]
        findings = examine(images, before[-1] if before and config.kind != "recorded" else None, rig)
        wrong = troubles((*findings, *drift(scene)) if scene else findings)
        before[:] = [images]
        picture = draw_scene(*images, scene) if scene is not None else np.hstack(images)
        jpeg = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 80])[1].tobytes()
        text = "\n".join([f"{camera.describe()}; skew {pair.skew_ms:.1f} ms", *lines, *wrong])
        return jpeg, {"text": text, "troubles": list(wrong), "skew_ms": pair.skew_ms}

    return shoot


def _rig(config: Config) -> Any:
    """The calibrated rig; None, with a line on stderr, without a usable calibration, which images do not need."""
    from daemon.calibration.file import load_calibration
    from daemon.store.outside import FileError

    try:
        return load_calibration(config.calibration).rig
    except FileError as error:
        print(f"facetctl: no facets are shown: {error}", file=sys.stderr)
        return None
