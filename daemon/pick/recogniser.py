"""The recogniser that the service uses: one model and one rig, what turns images into named parts.

Recognition itself is daemon/vision/look.py's, which the worker process loads and the daemon does not. Which model is
in use is daemon/teaching/trainer.py's.
"""

from pathlib import Path
from time import thread_time
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from daemon.compute.calls import ByReference
from daemon.store.model import ModelFile, load_file
from daemon.vision.facets import TablePlane
from daemon.vision.geometry import Polyhedron, StereoRig
from daemon.vision.model import Model
from daemon.vision.recognition import CandidatePose, candidate_poses, recognise_groups
from daemon.vision.report import scene_json
from daemon.vision.settings import VisionSettings
from daemon.vision.values import Group, Part, Scene

Image = NDArray[np.uint8]


class PartRecogniser(Protocol):
    """What turns images into parts: ModelRecogniser, or a test's own."""

    def see(self, left: Image, right: Image, table: TablePlane | None, rig: StereoRig | None = None) -> Scene:
        """Parts in a stereo pair, in the cyclopean frame; table: where it is; rig: this pair's, where it is not the
        usual one. Takes up to a second: a Compute's."""

    def recognise(self, group: Group) -> tuple[Part, ...]:
        """Facets that hang together, of one look or of many, as parts, in the frame they are in."""

    def candidate_poses(self, group: Group) -> tuple[CandidatePose, ...]:
        """Every taught part and pose that facets which hang together allow, the likeliest first."""

    def shape(self, label: str) -> Polyhedron | None:
        """The taught part's corners and facets, or None where there is no such part."""

    def report(self, scene: Scene) -> dict[str, object]:
        """The scene as JSON values, for the run log."""

    @property
    def labels(self) -> tuple[str, ...]:
        """What was taught."""


class ModelRecogniser(ByReference):
    """A PartRecogniser. Never changed; another model is another one. file: the one that has the model, if one has."""

    def __init__(
        self, model: Model, rig: StereoRig, settings: VisionSettings | None = None, file: ModelFile | None = None
    ) -> None:
        self.model, self.rig, self.settings, self.file = model, rig, settings, file

    def __reduce__(self) -> tuple[Any, ...]:
        """Another process reads a stored model itself: to pickle a large one would hold up this one. Where it starts
        anew during a pick, and somebody has replaced the file, it refuses the other model."""
        if self.file is None:
            return ModelRecogniser, (self.model, self.rig, self.settings)
        return of_file, (self.file.path, self.file.sha256, self.rig, self.settings)

    def see(self, left: Image, right: Image, table: TablePlane | None = None, rig: StereoRig | None = None) -> Scene:
        """Parts in a stereo pair, in the cyclopean frame; what lies in the table is none; rig: this pair's, where it is
        not the usual one. Raises VisionError."""
        from daemon.vision.look import look

        return look(left, right, rig or self.rig, self.model, self.settings, thread_time, table)

    def recognise(self, group: Group) -> tuple[Part, ...]:
        """Facets that hang together, as parts."""
        return tuple(found.part for found in recognise_groups((group,), self.model))

    def candidate_poses(self, group: Group) -> tuple[CandidatePose, ...]:
        """Every taught part and pose that facets which hang together allow."""
        return candidate_poses(group, self.model)

    def report(self, scene: Scene) -> dict[str, object]:
        return scene_json(scene)

    def shape(self, label: str) -> Polyhedron | None:
        """The taught part's corners and facets, or None."""
        metric = self.model.metric.get(label)
        return None if metric is None else metric.solid

    @property
    def labels(self) -> tuple[str, ...]:
        return self.model.labels


def of_file(path: Path, sha256: str, rig: StereoRig, settings: VisionSettings | None) -> ModelRecogniser:
    """The recogniser with the model of a file whose sha256 is this, ready to look. Raises ModelError."""
    import daemon.vision.look  # noqa: F401

    file = load_file(path, sha256)
    return ModelRecogniser(file.model, rig, settings, file)
