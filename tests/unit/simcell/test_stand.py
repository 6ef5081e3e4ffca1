"""The stand shows a part's characteristic views, for teaching."""

from __future__ import annotations

import numpy as np
import pytest

from daemon.store import folders
from drivers.rigid import apply, rigid, turn
from drivers.simcell.parts import part_shape
from drivers.simcell.stand import VIEWS, NoViewError, teaching_pose
from drivers.simcell.truth import load_truth

TRUTH = load_truth(folders.HOUSE / "etc" / "simcell.yaml")


@pytest.mark.parametrize(("label", "view"), [(label, v) for label, views in VIEWS.items() for v in range(len(views))])
def test_the_stand_shows_both_cameras_just_the_facets_of_the_characteristic_view(label: str, view: int) -> None:
    shape = part_shape(label)
    world_from_cyclopean = rigid(turn([1, 0.1, 0], 2.9), [480.0, 20.0, 100.0])
    cameras = [camera.lens().cyclopean_from_camera[:3, 3] for camera in (TRUTH.left, TRUTH.right)]
    pose = teaching_pose(part_shape(label), view, world_from_cyclopean, cameras, TRUTH.lighting)
    normals = shape.hull.normals @ pose[:3, :3].T
    for camera in cameras:
        to_camera = apply(world_from_cyclopean, camera) - apply(pose, np.zeros(3))
        offsets = shape.hull.offsets
        seen = normals @ to_camera > offsets
        sides = sorted(len(f) for f, s in zip(shape.hull.faces, seen, strict=True) if s)
        assert sides == sorted(VIEWS[label][view])


def test_a_view_that_does_not_exist_is_refused_by_number() -> None:
    with pytest.raises(NoViewError, match="numbered 0 to 0, not 1"):
        teaching_pose(part_shape("cube"), 1, np.eye(4), [np.zeros(3)], TRUTH.lighting)


@pytest.mark.parametrize("turned_deg", range(0, 180, 30))
@pytest.mark.parametrize(("label", "view"), [("cube", 0), ("pyramid", 0), ("triangular_prism", 0)])
def test_no_edge_lies_along_the_line_between_the_cameras_from_where_no_distance_is_seen_along_it(
    label: str, view: int, turned_deg: int
) -> None:
    """A pyramid held with its edges level was seen as two things most of the times."""
    shape, lean = part_shape(label), turn([1, 0, 0], np.radians(135.0))
    world_from_cyclopean = rigid(turn([0, 0, 1], np.radians(turned_deg)) @ lean, [236.7, -150.0, 331.0])
    cameras = [camera.lens().cyclopean_from_camera[:3, 3] for camera in (TRUTH.left, TRUTH.right)]
    pose = teaching_pose(part_shape(label), view, world_from_cyclopean, cameras, TRUTH.lighting)
    ends = apply(pose, shape.hull.vertices) @ world_from_cyclopean[:3, :2]  # right and down, as the cameras have it
    sight = world_from_cyclopean[:3, 2]
    for face, normal in zip(shape.hull.faces, shape.hull.normals @ pose[:3, :3].T, strict=True):
        if normal @ sight < -0.1:
            edges = ends[[*face[1:], face[0]]] - ends[list(face)]
            assert np.abs(edges[:, 1] / np.linalg.norm(edges, axis=1)).min() > 0.12
