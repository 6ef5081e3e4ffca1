"""A real printed part of which nothing is known but a drawing: in how many pairs is it named, how near, how steadily?

The cube of ViSP's images (84 mm, printed, moved by hand before a resting camera; Debian's visp-images-data, none of it
kept). Two frames, and how the cube moved between them, are a stereo pair in which all else moved: a plain tracker of
the cube's edges says how, and its error, of a millimetre or so at 500 to 720 mm, is in every figure. Once the drawing
is all that was taught, and once the four parts of the train-B views are taught beside it.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from daemon import frames
from daemon.arrays import Array
from daemon.store.library import load_facets
from daemon.store.pictures import read_grey
from daemon.teaching.solid_from_mesh import solid_drawn
from daemon.vision.geometry.polyhedron import Polyhedron
from daemon.vision.geometry.rig import Camera, moved_rig
from daemon.vision.look import look
from daemon.vision.model import learn_solid
from daemon.vision.model.model import Model, empty_model
from tests.bench.data.packages import debian_package
from tests.bench.recognise import trained
from tests.fakes import rendered
from tests.fakes.drawn import box, obj

Image = NDArray[np.uint8]
FRAMES = "usr/share/visp-images-data/ViSP-images/mbt/cube"
CAMERA = Camera(
    np.array([[547.7367575, 0, 338.7036994], [0, 542.0744058, 234.5083345], [0, 0, 1]]), np.zeros(5), np.eye(4)
)
BEGINS = (22.31950571, 107.1368004, 507.1128378), (2.100485509, 1.146812236, -0.4560126437)
"""Where a corner of the cube is in the first frame, mm, and how it is turned (a vector): the image set's cube.0.pos."""
SIDE_MM, MIDDLE_MM = 84.0, (-42.0, 42.0, 42.0)
"""MIDDLE_MM: seen from that corner; where a drawing that was read has its origin."""
LABEL, SEED, PAIRS, RESTS = "printed_cube", 7, 60, range(31)
"""RESTS: frames of a cube at rest."""
APART_MM, AHEAD, TURNED_DEG = (40.0, 160.0), 0.35, 25.0
"""What two frames may be apart, how much of that along the view, and how much turned, to be taken for a pair."""
RIGHT_MM = 15.0
ON_EDGE, REACH_PX, STEP_PX, STRONG, TUKEY = np.linspace(0.04, 0.96, 40), 8.0, 0.5, 2.0, 4.7


def main() -> None:
    if not rendered.ALL.is_dir():
        print("printed cube: no scenes to teach beside it (set FACETD_SHARED)")
        return
    cv2.setNumThreads(1)
    with tempfile.TemporaryDirectory() as folder:
        root = debian_package("visp-images-data", f"{FRAMES}/image0000.pgm", Path(folder))
        if isinstance(root, str):
            print(f"printed cube: {root}")
            return
        images = [read_grey(path) for path in sorted((root / FRAMES).glob("image[0-9]*.pgm"))]
    solid = solid_drawn("cube.obj", obj(*box(SIDE_MM, SIDE_MM, SIDE_MM)), "mm", load_facets())
    poses = list(tracked(images, solid))
    print(f"{len(images)} frames of {images[0].shape[1]}x{images[0].shape[0]}, the cube at "
          f"{min(p[2, 3] for p in poses):.0f} to {max(p[2, 3] for p in poses):.0f} mm")  # fmt: skip
    pairs = [(i, j) for i in range(len(poses)) for j in range(len(poses)) if _is_pair(poses[i], poses[j])]
    chosen = [pairs[k] for k in sorted(np.random.default_rng(SEED).choice(len(pairs), PAIRS, replace=False))]
    print(f"\n{'taught':<18}{'pairs':>7}{'named':>7}{'wrong':>7}{'corner mm 50 %':>16}{'95 %':>7}{'ms':>6}{'worst':>7}")
    for name, taught in (("the drawing", empty_model(load_facets())),
                         ("and four parts", trained(rendered.rig(rendered.ALL, "B")))):  # fmt: skip
        looks = [_looked((images[i], images[j]), (poses[i], poses[j]), taught, solid) for i, j in chosen]
        off = [np.linalg.norm(corners - solid.corners_mm, axis=1).mean() for corners, _, _ in looks if len(corners)]
        wrong = sum(others for _, others, _ in looks) + sum(mm > RIGHT_MM for mm in off)
        ms = [one[2] for one in looks]
        print(f"{name:<18}{len(looks):>7}{len(off):>7}{wrong:>7}{np.median(off):>16.2f}{np.quantile(off, 0.95):>7.2f}"
              f"{np.median(ms):>6.0f}{max(ms):>7.0f}")  # fmt: skip
    _steady(images, poses, pairs, solid)


def tracked(images: list[Image], solid: Polyhedron) -> Iterator[Array]:
    """(4, 4) camera_from_part in each frame, the first guessed from where it is known to begin, others as the part went
    on; by the grey levels across its edges alone."""
    pose = frames.rigid(frames.rotation_from_vector(np.array(BEGINS[1])), np.array(BEGINS[0]))
    pose = before = pose @ frames.rigid(np.eye(3), np.array(MIDDLE_MM))
    for image in images:
        pose, before = _followed(image, solid, frames.perturb(pose, frames.difference(pose, before))), pose
        yield pose


def _followed(image: Image, solid: Polyhedron, pose: Array) -> Array:
    """Gauss-Newton on how far the steepest grey levels lie from the edges in view, across them, by Tukey's weights."""
    grey = cv2.GaussianBlur(image.astype(np.float32), (0, 0), 1.0)
    for reach_px in np.maximum(REACH_PX * 0.85 ** np.arange(25), 2.5):
        points, along = _edges_in_view(solid, pose)
        at_px, slope = CAMERA.project_with_slope(points)
        way_px = np.einsum("nij,nj->ni", slope, along)
        way_px /= np.linalg.norm(way_px, axis=1, keepdims=True)
        across_px = way_px[:, ::-1] * [-1.0, 1.0]
        off_px, strong = _steepest(grey, at_px, way_px, across_px, float(reach_px))
        to_motion = np.einsum("ni,nij,njk->nk", across_px, slope, frames.point_motion(points - pose[:3, 3]))
        weights = strong.astype(float)
        for _ in range(4):
            motion = np.linalg.lstsq(to_motion * weights[:, None], off_px * weights, rcond=None)[0]
            left = np.abs(off_px - to_motion @ motion)
            usual = max(1.4826 * float(np.median(left[strong])), 0.15)
            weights = strong * (1 - np.minimum(left / (TUKEY * usual), 1.0) ** 2)
        pose = frames.perturb(pose, motion)
    return pose


def _edges_in_view(solid: Polyhedron, pose: Array) -> tuple[Array, Array]:
    """Points (N, 3) of the edges of facets in view, and the way of the edge of each (N, 3), in the camera's frame."""
    front = solid.facing(pose) > 0.08
    ends = np.array(sorted({tuple(sorted(edge)) for edge, (facet, _) in solid.edges.items() if front[facet]}))
    corners = frames.apply(pose, solid.corners_mm)
    start, way = corners[ends[:, 0], None], (corners[ends[:, 1]] - corners[ends[:, 0]])[:, None]
    return (start + ON_EDGE[:, None] * way).reshape(-1, 3), np.repeat(way[:, 0], len(ON_EDGE), axis=0)


def _steepest(
    grey: np.ndarray, at_px: Array, way_px: Array, across_px: Array, reach_px: float
) -> tuple[Array, NDArray[np.bool_]]:
    """(N,) px from each point, across its edge, to where grey levels change most, sub-pixel; whether they do."""
    t = np.arange(-reach_px, reach_px + 0.01, STEP_PX)
    rows = [at_px[:, None] + t[:, None] * across_px[:, None] + k * way_px[:, None] for k in (-2.0, 0.0, 2.0)]
    levels = [cv2.remap(grey, row.astype(np.float32), None, cv2.INTER_LINEAR) for row in rows]
    steep = np.abs(np.gradient(np.mean(levels, axis=0), axis=1))
    k = np.clip(np.argmax(steep * np.exp(-((t / (1.2 * reach_px)) ** 2)), axis=1), 1, len(t) - 2)
    low, peak, high = (np.take_along_axis(steep, (k + d)[:, None], 1)[:, 0] for d in (-1, 0, 1))
    bend = np.minimum(low - 2 * peak + high, -1e-6)
    shift = np.clip(0.5 * (low - high) / bend, -1.0, 1.0)
    inside = np.all((at_px > REACH_PX) & (at_px < np.array(grey.shape[::-1]) - REACH_PX), axis=1)
    return t[k] + STEP_PX * shift, (peak > STRONG) & inside


def _is_pair(left: Array, right: Array) -> bool:
    """Whether cameras that see one part so sit as those of a rig may: the second to the right of the first."""
    motion = frames.difference(frames.inverse(right @ frames.inverse(left)), np.eye(4))
    apart_mm, turned = frames.size(motion)
    beside = motion[0] > 0 and abs(motion[2]) < AHEAD * apart_mm
    return bool(beside and APART_MM[0] < apart_mm < APART_MM[1] and np.degrees(turned) < TURNED_DEG)


def _looked(
    images: tuple[Image, Image], camera_from_part: tuple[Array, Array], taught: Model, solid: Polyhedron
) -> tuple[Array, int, float]:
    """The corners (8, 3) of what is named as the part, where the tracker has them at (8, 3) solid.corners_mm, each
    next to its like, or none (0, 3); how much else is named; and ms of processor."""
    size = (images[0].shape[1], images[0].shape[0])
    rig, part_from_cyclopean = moved_rig(
        CAMERA, size, (frames.inverse(camera_from_part[0]), frames.inverse(camera_from_part[1]))
    )
    model = learn_solid(taught, solid, LABEL)
    scene = look(*images, rig, model, clock=time.process_time)
    named = [p for p in scene.parts if p.named]
    own = [p for p in named if p.recognition.label == LABEL]
    ms = 1000 * sum(scene.seconds.values())
    if not own:
        return np.zeros((0, 3)), len(named), ms
    known = model.metric[LABEL].solid.corners_mm
    corners = frames.apply(part_from_cyclopean @ own[0].cyclopean_from_part, known)
    nearest = np.linalg.norm(corners[:, None] - solid.corners_mm, axis=2).argmin(axis=0)
    return corners[nearest], len(named) - 1, ms


def _steady(images: list[Image], poses: list[Array], pairs: list[tuple[int, int]], solid: Polyhedron) -> None:
    """How far corners move from frame to frame of a cube at rest, which the other camera sees in one frame."""
    middle = RESTS[len(RESTS) // 2]
    pair = max((pair for pair in pairs if middle in pair), key=lambda pair: abs(pair[1] - pair[0]))
    there = poses[pair[0]], poses[pair[1]]
    looks = []
    for frame in RESTS:
        left, right = (images[frame if k == middle else k] for k in pair)
        looks.append(_looked((left, right), there, empty_model(load_facets()), solid)[0])
    named = np.array([corners for corners in looks if len(corners)])
    moved = np.linalg.norm(np.diff(named, axis=0), axis=2)
    print(f"\nat rest, {len(named)} of {len(looks)} named; from frame to frame corners move "
          f"{np.median(moved):.2f} mm, 95 % {np.quantile(moved, 0.95):.2f}, worst {moved.max():.2f}")  # fmt: skip


if __name__ == "__main__":
    main()
