"""Plausibility of a stereo rig: units, order and size of its cameras. Pure.

Out: each implausible value with its keys in calibration.yaml and one line with the likely cause and its remedy, an
option of `calibrate import`.
"""

from collections.abc import Iterator

import numpy as np

from daemon.arm import Implausible
from daemon.arrays import Array
from daemon.vision.geometry import Camera, StereoRig

BASELINE_MM = (10.0, 500.0)
"""Limits of the distance between two cameras on a gripper."""
UNITS_MM = {"mm": 1.0, "cm": 10.0, "inch": 25.4, "m": 1000.0}
VIEW_DEG = (6.0, 150.0)
"""Limits of the horizontal field of view."""
OFF_CENTRE = 0.14
"""Largest offset of the principal point from the image centre, as a share of the image."""
SIDES = 1.2
"""fx and fy differ at most by this factor, the two cameras' focal lengths by its cube."""
MIN_ALONG = 0.7
"""Least cosine between a camera's x axis and the baseline, and between the two cameras' views."""


def implausible_rig(rig: StereoRig) -> Iterator[Implausible]:
    """Return what no pair of cameras on a gripper could have, the most specific cause first."""
    yield from _order(rig)
    yield from _baseline(rig)
    for name, camera in (("left", rig.left), ("right", rig.right)):
        yield from _camera(name, camera, rig.image_size)
    ratio = rig.left.matrix[0, 0] / rig.right.matrix[0, 0]
    if not SIDES**-3 < ratio < SIDES**3:
        yield Implausible(
            ("right", "camera_matrix"),
            f"focal lengths of {rig.left.matrix[0, 0]:.0f} and {rig.right.matrix[0, 0]:.0f} px: two cameras of a pair "
            "are alike; files of two image sizes?",
        )


def _order(rig: StereoRig) -> Iterator[Implausible]:
    axes = [camera.cyclopean_from_camera[:3, :3] for camera in (rig.left, rig.right)]
    along = min(float(axis[0, 0]) for axis in axes)
    keys = ("right", "cyclopean_from_camera")
    if max(float(axis[0, 0]) for axis in axes) < -MIN_ALONG:
        problem = "the right camera is to the left of the left one: exchanged; name them the other way round (--swap)"
        yield Implausible(keys, problem)
    elif along < MIN_ALONG:
        turned = np.degrees(np.arccos(np.clip(along, -1, 1)))
        yield Implausible(
            keys,
            f"the baseline is turned by {turned:.0f} degrees against a camera's rows: mount the cameras side by side",
        )
    elif float(axes[0][:, 2] @ axes[1][:, 2]) < MIN_ALONG:
        turned = np.degrees(np.arccos(np.clip(axes[0][:, 2] @ axes[1][:, 2], -1, 1)))
        yield Implausible(
            keys, f"the cameras look {turned:.0f} degrees apart: a rotation that was transposed, or of another pair?"
        )


def _baseline(rig: StereoRig) -> Iterator[Implausible]:
    low, high = BASELINE_MM
    if low <= rig.baseline_mm <= high:
        return
    fits = [
        f"{unit} taken for {taken} (--unit {unit})"
        for unit, mm in UNITS_MM.items()
        for taken, taken_mm in UNITS_MM.items()
        if taken in ("mm", "m") and low <= rig.baseline_mm * mm / taken_mm <= high and unit != taken
    ]
    squares = "squares of a board taken for mm (--unit N, where one is N mm)" if rig.baseline_mm < low else ""
    cause = ", or ".join([*fits, *filter(None, [squares])]) or "a wrong projection matrix"
    yield Implausible(
        ("right", "cyclopean_from_camera"),
        f"a baseline of {rig.baseline_mm:g} mm: cameras on a gripper are {low:g} to {high:g} mm apart; {cause}?",
    )


def _camera(name: str, camera: Camera, size: tuple[int, int]) -> Iterator[Implausible]:
    keys = (name, "camera_matrix")
    (fx, skew, cx), (_, fy, cy) = camera.matrix[0], camera.matrix[1]
    width, height = size
    if not SIDES**-1 < fx / fy < SIDES:
        yield Implausible(keys, f"fx {fx:.0f} and fy {fy:.0f} px: no camera has pixels so far from square")
    if abs(skew) > 1e-3 * fx:
        yield Implausible(keys, f"a skew of {skew:g}: no camera has one, and facetd would ignore it")
    off = max(abs((cx + 0.5) / width - 0.5), abs((cy + 0.5) / height - 0.5))
    if off > OFF_CENTRE:
        exchanged = max(abs((cx + 0.5) / height - 0.5), abs((cy + 0.5) / width - 0.5)) < OFF_CENTRE
        likely = f"{2 * round(cx)}x{2 * round(cy)}"
        cause = f"width and height exchanged (--size {height}x{width})" if exchanged else f"of images of some {likely}"
        yield Implausible(
            keys, f"its centre {cx:.0f}, {cy:.0f} is far from the middle of {width}x{height} px: {cause}?"
        )
    view = float(np.degrees(2 * np.arctan(width / 2 / fx)))
    if not VIEW_DEG[0] <= view <= VIEW_DEG[1]:
        yield Implausible(
            keys,
            f"a focal length of {fx:g} px is a field of view of {view:.1f} degrees across {width} px; lenses have "
            f"{VIEW_DEG[0]:g} to {VIEW_DEG[1]:g}: is it in px, and of this image size?",
        )
    elif _folds(camera, size):
        problem = "the image folds within its corners: coefficients in another order, or of another lens"
        yield Implausible((name, "distortion"), problem)


def _folds(camera: Camera, size: tuple[int, int]) -> bool:
    """Whether the lens model maps two directions to one pixel: the image radius must grow with the angle."""
    k1, k2, _, _, k3 = camera.distortion
    corners = np.array([[-0.5, -0.5], [size[0], -0.5], [-0.5, size[1]], size]) - camera.matrix[:2, 2]
    farthest = float(np.linalg.norm(corners / np.diag(camera.matrix)[:2], axis=1).max())
    r = np.linspace(0.0, 3.0 * farthest, 400)
    bent: Array = r * (1 + k1 * r**2 + k2 * r**4 + k3 * r**6)
    grows = np.diff(bent) > 0
    reach = bent[-1] if grows.all() else bent[int(np.argmin(grows))]
    return bool(reach < farthest)


def changed_parameters(rig: StereoRig, before: StereoRig) -> list[str]:
    """Return what differs from the calibration that is replaced although the same cameras would keep it, a line
    each."""
    lines = []
    if rig.image_size != before.image_size:
        lines.append(
            f"images of {'x'.join(map(str, rig.image_size))} px, {'x'.join(map(str, before.image_size))} before"
        )
    focal = [one.left.matrix[0, 0] / one.image_size[0] for one in (rig, before)]
    for what, now, then, most in (
        ("baseline", rig.baseline_mm, before.baseline_mm, 0.03),
        ("focal length", *focal, 0.1),
    ):
        if abs(now / then - 1) > most:
            lines.append(f"the {what} is {now / then:.3g} times what it was: other cameras, or another unit?")
    return lines
