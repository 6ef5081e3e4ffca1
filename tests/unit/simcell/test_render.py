"""Rendered pictures: edges where projection puts them, nearer parts before farther ones."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from daemon.arrays import Array
from drivers.rigid import apply, rigid, turn
from drivers.simcell.optics import Array32
from drivers.simcell.parts import part_shape
from drivers.simcell.render import RenderedSolid
from tests.fakes.pictures import STARK, TRUTH, looking, picture, projected


def edge_offsets(image: Array32, line_px: Array, half_px: float = 4.0) -> Array:
    """How far (px) the image shows each point of a projected edge off; only where there is one clear step.

    The levels on both sides are taken as straight lines over the distance; what is left of the sum over the profile is
    the step times the offset.
    """
    along = np.gradient(line_px, axis=0)
    normal = np.column_stack([-along[:, 1], along[:, 0]]) / np.linalg.norm(along, axis=1)[:, None]
    steps = np.linspace(-half_px, half_px, 160, endpoint=False) + half_px / 160
    where = (line_px[:, None] + steps[None, :, None] * normal[:, None]).astype(np.float32)
    profile = cv2.remap(image, where[..., 0], where[..., 1], cv2.INTER_LINEAR).astype(float)
    model = np.zeros_like(profile)
    step, misfit = np.zeros(len(profile)), np.zeros(len(profile))
    for sign in (-1, 1):
        side, beside = sign * steps > 0, sign * steps > 1.5
        slope, level = np.polyfit(steps[beside], profile[:, beside].T, 1)
        model[:, side] = level[:, None] + slope[:, None] * steps[side]
        misfit += np.abs(profile - model)[:, beside].max(axis=1)
        step += sign * level
    offset = -(profile - model).mean(axis=1) * 2 * half_px / step
    return np.asarray(offset[(np.abs(step) > 20) & (misfit < 0.02 * np.abs(step))])


@pytest.mark.parametrize("label", ["cube", "triangular_prism", "pentagonal_prism", "pyramid"])
@pytest.mark.parametrize("stand_off_mm", [200.0, 450.0])
def test_edges_lie_within_five_thousandths_of_a_pixel_of_where_projection_puts_them(
    label: str, stand_off_mm: float
) -> None:
    shape, camera = part_shape(label), TRUTH.left.lens()
    rest = rigid(turn([0, 0, 1], 0.3), [520.0, 0.0, -300.0]) @ shape.rests[0]
    pose = looking([520 - 0.6 * stand_off_mm, -0.3 * stand_off_mm, -280 + 0.742 * stand_off_mm], [520, 0, -280], 0.2)
    image = picture([RenderedSolid(shape.hull, rest, STARK.facet_albedo)], pose, camera)
    corners = apply(rest, shape.hull.vertices)
    to_camera = pose[:3, 3] - corners.mean(axis=0)
    normals = shape.hull.normals @ rest[:3, :3].T
    sides = {
        tuple(sorted(pair))
        for face, normal in zip(shape.hull.faces, normals, strict=True)
        if normal @ to_camera > 0.3 * np.linalg.norm(to_camera)
        for pair in zip(face, (*face[1:], face[0]), strict=True)
    }
    offsets = []
    for a, b in sides:
        share = np.linspace(0.2, 0.8, 120)[:, None]
        found = edge_offsets(image, projected(camera, pose, corners[a] * (1 - share) + corners[b] * share))
        if len(found) == 120:
            offsets.append(found.mean())
            assert np.sqrt(np.mean(found**2)) < 0.06
    assert len(offsets) >= 4
    assert np.max(np.abs(offsets)) < 0.005


def test_a_nearer_part_hides_a_farther_one() -> None:
    cube, camera = part_shape("cube"), TRUTH.left.lens()
    front = RenderedSolid(cube.hull, rigid(np.eye(3), [480.0, 0.0, -275.0]), 0.8)
    back = RenderedSolid(cube.hull, rigid(np.eye(3), [560.0, 0.0, -275.0]), 0.2)
    pose = looking([150.0, 0.0, -220.0], [520.0, 0.0, -280.0])
    both, alone = picture([front, back], pose, camera), picture([front], pose, camera)
    assert np.allclose(both, picture([back, front], pose, camera)), "whichever is named first"
    middle = np.round(projected(camera, pose, np.array([[455.0, 0.0, -265.0]]))[0]).astype(int)
    patch = np.s_[middle[1] - 5 : middle[1] + 5, middle[0] - 5 : middle[0] + 5]
    assert np.allclose(both[patch], alone[patch])
    assert not np.allclose(both, alone)
