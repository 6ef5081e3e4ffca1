"""Facets of rendered scenes: soft shadows, a textured table, a cylinder, two parts, nothing at all."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml
from numpy.typing import NDArray

from daemon.vision.data import FacetView
from daemon.vision.facets import find_facets
from daemon.vision.rig import Camera, StereoRig

SCENES = Path(__file__).parents[2] / "data" / "scenes"


def load(name: str) -> tuple[FacetView, dict[str, Any]]:
    truth = json.loads((SCENES / name / "truth.json").read_text())
    data = yaml.safe_load((SCENES / f"calibration-{truth['rig']}.yaml").read_text())
    keys = ("camera_matrix", "distortion", "cyclopean_from_camera")
    left, right = (Camera(*(np.array(data[eye][k], float) for k in keys)) for eye in ("left", "right"))
    images = [np.asarray(cv2.imread(str(SCENES / name / f"{eye}.png"), -1)) for eye in ("left", "right")]
    return find_facets(images[0], images[1], StereoRig(left, right, tuple(data["image_size"]))), truth


def visible(truth: dict[str, Any]) -> list[NDArray[np.float64]]:
    every = [f for o in truth["objects"] for f in o["facets"]]
    return [np.array(f["corners_mm"]) for f in every if f["left"]["visible"] and f["right"]["visible"]]


@pytest.mark.parametrize("name", ["clean-B-003", "clean-B-020", "clean-A0-004", "shadow-B-004", "textured-B-000"])
def test_every_visible_facet_is_found_where_it_is(name: str) -> None:
    view, truth = load(name)
    found = [f.corners_mm for g in view.groups for f in g.facets]
    for facet in visible(truth):
        away = [
            np.linalg.norm(p[:, None] - facet[None], axis=2).min(1).max() if len(p) == len(facet) else np.inf
            for p in found
        ]
        assert min(away) < 2.0


def test_two_parts_are_two_groups() -> None:
    view, truth = load("multi-B-004")
    assert len([g for g in view.groups if len(g.facets) > 1]) == len(truth["objects"])


def test_an_empty_table_shows_no_facet() -> None:
    assert load("empty-B-000")[0].groups == ()


def test_a_cylinder_does_no_harm() -> None:
    view, _ = load("unknown-B-002")
    for facet in (f for g in view.groups for f in g.facets):
        assert np.all(np.isfinite(facet.corners_mm))
