"""How well trouble with the images is told: false alarms, planted faults found, time; and reading frames.

Reads the rendered scenes of $FACETD_SHARED/scenes (default ../shared); a bench script, run by `make bench`.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator

import cv2
import numpy as np

from daemon.vision.health.blur import measure_blur
from daemon.vision.health.camera_order import Assignment, assignment
from daemon.vision.health.cause import unevenness
from daemon.vision.health.examination import examine
from drivers.camera.pixels import Layout, read_grey
from tests.fakes import rendered

Image = np.ndarray


def planted() -> dict[str, Callable[[Image], Image]]:
    """Fault -> what it does to a good image."""
    random = np.random.default_rng(1)

    def noisy(image: Image) -> Image:
        return np.clip(image + random.normal(0, 2, image.shape), 0, 255).astype(np.uint8)

    def broken(image: Image) -> Image:
        return np.vstack([image[:300], np.zeros_like(image[300:])])

    return {
        "covered": lambda image: noisy(np.full_like(image, 3)),
        "darkness": lambda image: noisy(image // 10),
        "saturation": lambda image: noisy(np.minimum(image.astype(int) * 4, 255)),
        "focus": lambda image: noisy(cv2.GaussianBlur(image, (0, 0), 2.0)),
        "motion": lambda image: noisy(cv2.filter2D(image, -1, np.ones((1, 13)) / 13)),
        "half": broken,
        "torn": lambda image: np.vstack([image[:240], np.roll(image, 25, axis=1)[240:]]),
    }


def scenes() -> Iterator[tuple[str, Image, Image]]:
    """(rig, left, right) of every scene."""
    for scene in sorted(path for path in rendered.ALL.iterdir() if path.is_dir()):
        yield rendered.truth(scene)["rig"], *rendered.pair(scene)


def alarms() -> None:
    """False alarms, faults found, swapped cameras told, and blur measured against what was planted."""
    rigs = {name: rendered.rig(rendered.ALL, name) for name in ("A0", "B")}
    false, found, told, seconds, blurs, count = Counter(), Counter(), Counter(), 0.0, [], 0
    for rig, left, right in scenes():
        count += 1
        began_s = time.process_time()
        findings = examine((left, right), None, rigs[rig])
        seconds += time.process_time() - began_s
        false.update(f.name for f in findings if not f.good)
        for name, harm in planted().items():
            found[name] += any(f.name == name and not f.good for f in examine((harm(left), right)))
        told["right way round: " + assignment(left, right, rigs[rig])[0].value] += 1
        told["swapped: " + assignment(right, left, rigs[rig])[0].value] += 1
        blurs.append(measure_blur(np.asarray(cv2.GaussianBlur(left, (0, 0), 2.0), np.uint8)).least_px)
    print(f"{count} scenes; false alarms: {dict(false) or 'none'}; {1000 * seconds / count:.0f} ms of processor a pair")
    for name in planted():
        print(f"  planted {name:<11} found in {found[name] / count:6.1%}")
    for line, times in sorted(told.items()):
        print(f"  eyes {line:<27} {times / count:6.1%}" + ("  WRONG" if line in WRONG and times else ""))
    spread = np.nanpercentile(blurs, [5, 50, 95])
    print(
        "  blur planted 2.00 px (on the scenes' own 0.4 to 0.8), "
        f"measured {spread[1]:.2f}, 5..95 % {spread[0]:.2f}..{spread[2]:.2f}"
    )


WRONG = {f"right way round: {way.value}" for way in (Assignment.SWAPPED, Assignment.NEITHER)} | {
    f"swapped: {Assignment.RIGHT.value}"
}


def reading() -> None:
    """Processor time from a driver's buffer to a grey image, 640x480."""
    grey = cv2.GaussianBlur(np.random.default_rng(2).integers(0, 256, (480, 640), np.uint8), (0, 0), 3)
    sizes = {"GREY": (640, 480), "Y16": (1280, 480), "YUYV": (1280, 480), "NV12": (640, 720)}
    frames = {code: (bytes(width * height), Layout(code, 640, 480, width)) for code, (width, height) in sizes.items()}
    frames["MJPEG"] = (cv2.imencode(".jpg", grey)[1].tobytes(), Layout("MJPEG", 640, 480, 0))
    for code, (data, layout) in frames.items():
        began_s = time.process_time()
        for _ in range(200):
            read_grey(data, layout)
        took_ms = (time.process_time() - began_s) / 200 * 1000
        print(f"  reading a frame of {code:<6} {took_ms:6.3f} ms; 2 cameras at 15 fps: {took_ms * 3:5.2f} % of a core")


def uneven() -> None:
    """How uneven the pictures of each set are: what tells a patterned table from a plain one."""
    by_set: dict[str, list[float]] = {}
    for home in (rendered.ALL, *rendered.MORE):
        for scene in sorted(path.parent for path in home.glob("*/truth.json")):
            by_set.setdefault(rendered.truth(scene)["tags"][0], []).append(max(map(unevenness, rendered.pair(scene))))
    print("unevenness, grey levels: least, median, most of each set")
    for name, values in sorted(by_set.items()):
        print(f"  {name:<16}" + "".join(f"{np.percentile(values, percent):7.2f}" for percent in (0, 50, 100)))


def main() -> None:
    """Print the tables."""
    cv2.setNumThreads(1)
    reading()
    if rendered.ALL.is_dir():
        alarms()
        uneven()
    else:
        print("image_health: no scenes (set FACETD_SHARED)")


if __name__ == "__main__":
    main()
