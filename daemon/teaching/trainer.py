"""From taught views to the model in use: store a view, train a candidate, accept it, go back.

daemon/vision/model/model.py learns, daemon/store/model_store.py has the files. Nothing here talks to people.
"""

import contextlib
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import Any, Literal, NamedTuple

import numpy as np

from daemon import frames
from daemon.pick.moved_pair import Places, places_of, with_arm_errors
from daemon.pick.recogniser import Image, ModelRecogniser
from daemon.store.library import PartEntry
from daemon.store.model import ModelFile
from daemon.store.model_store import ModelStore, StoredView
from daemon.store.outside import FileError, read_below
from daemon.teaching.mesh import LARGEST_BYTES, MeshError
from daemon.teaching.part_from_looks import solid_from, solid_json, stl_of
from daemon.teaching.solid_from_mesh import ShadedSurface, read_drawing, solid_drawn
from daemon.teaching.view_coverage import ViewCoverage, assess_coverage, simulated_group
from daemon.vision.facets import TablePlane, table_of
from daemon.vision.geometry import Polyhedron, StereoRig
from daemon.vision.image import VisionError
from daemon.vision.model import (
    FacetLibrary,
    Model,
    TeachError,
    aspects,
    empty_model,
    learn_solid,
    learn_solids,
    learn_view,
    merge_views,
)
from daemon.vision.recognition import recognise_part
from daemon.vision.settings import MemorySettings, VisionSettings
from daemon.vision.values import UNKNOWN, Facet, Group, Part

ROUND = "around"
"""Key of a view's note, and of its solid, for a view learnt from all round (`teach --around`)."""
SAME_SIZE_MM = 2.0
"""Largest difference between the lengths of one part in its drawing and as seen."""
SAME_SIDE_MM = 5.0
"""Largest distance of a side in view from where the recognised part has it."""


@dataclass(frozen=True)
class ViewVerdict:
    """How a trained model recognises a view that it was taught: the name, the confidence, and the reason."""

    view: str
    label: str
    named: str
    confidence: float
    runner_up: str | None
    reason: str

    @property
    def right(self) -> bool:
        """Whether it agrees with the operator."""
        return self.label == self.named


@dataclass(frozen=True)
class TrainedCandidate:
    """A trained candidate: its version, its verdict on every stored view, and the views that could not be learnt with
    the reason."""

    version: int
    verdicts: tuple[ViewVerdict, ...]
    left_out: tuple[str, ...]
    seconds: float


class DrawnPart(NamedTuple):
    """A part with a drawing: its solid and its surface for pictures, None for a part learnt from all round."""

    solid: Polyhedron
    surface: ShadedSurface | None


class Trainer:
    """Teaching in one daemon: the store, the model in use, and the candidate.

    Whatever reads views or trains takes long: it is called in a worker process (daemon/compute), on a copy of this.
    """

    def __init__(
        self,
        model_store: ModelStore,
        rig: StereoRig,
        library: FacetLibrary,
        parts: Mapping[str, PartEntry],
        settings: VisionSettings | None = None,
        start: Model | None = None,
        *,
        memory: MemorySettings | None = None,
    ) -> None:
        """start: the model in use until one is accepted here; memory: how the next one learns. Raises ModelError,
        FileError."""
        self.model_store, self.rig, self.library, self.parts, self.settings = model_store, rig, library, parts, settings
        self.memory = memory or MemorySettings()
        self.model = start or empty_model(library)
        self._file: ModelFile | None = None
        if model_store.current is not None:
            self._take(model_store.load(model_store.current))
        self._in_use: ModelRecogniser | None = None

    def __getstate__(self) -> dict[str, Any]:
        """Return what a worker process needs: all but the model in use."""
        return {key: value for key, value in vars(self).items() if key not in ("model", "_file", "_in_use")}

    @property
    def in_use(self) -> ModelRecogniser:
        """The recogniser with the model in use; the same object until that changes."""
        now = self._in_use
        if now is None or (now.model, now.rig, now.settings) != (self.model, self.rig, self.settings):
            now = self._in_use = ModelRecogniser(self.model, self.rig, self.settings, self._file)
        return now

    def version(self, version: int) -> ModelRecogniser:
        """The recogniser with that version of the model. Raises ModelError."""
        file = self.model_store.load(version)
        return ModelRecogniser(file.model, self.rig, self.settings, file)

    def _take(self, file: ModelFile) -> None:
        self.model, self._file = file.model, file

    def untaught(self) -> list[str]:
        """Parts of parts.yaml without a view or drawing that the model in use does not know either."""
        shown = {*self.model.labels, *self.model_store.labels()}
        return [label for label in self.parts if label not in shown]

    def untrained_views(self) -> list[StoredView]:
        """Stored views that the model in use was not trained on, by their names, which are never reused. Time stamps
        would not do: the clock may have been set."""
        known = {view.source for view in self.model.views}
        return [view for view in self.model_store.views() if view.name not in known]

    def check(
        self, label: str, left: Image, right: Image, table: TablePlane | None, moved: Places | None = None
    ) -> tuple[Group, tuple[Group, ...]]:
        """The facets of the one part in view, and of other objects. Raises TeachError or VisionError where a view
        cannot be learnt."""
        group, others = self.single_part(left, right, table, moved)
        learn_view(empty_model(self.library), group, label)
        return group, others

    def store(self, label: str, left: Image, right: Image, note: dict[str, Any]) -> StoredView:
        """Store a view. Raises FileError, and TeachError or VisionError as check does."""
        self.check(label, left, right, table_of(note.get("table")), places_of(note.get("moved")))
        return self.model_store.add_view(label, left, right, note)

    def drawing_conflict(self, label: str, name: str, content: bytes, unit: str) -> str | None:
        """Return what to ask a person before a drawing is stored under a label: it exists already, under this label or
        another, or differs from the known shape. Raises MeshError, FileError."""
        for view in self.model_store.views():
            with contextlib.suppress(FileError):  # one that cannot be read any more is not this one
                if view.mesh is not None and view.note.get("unit", "mm") == unit and _drawing(view) == content:
                    return f"this drawing is stored already, as {view.name}"
        known = self.learn_all()[0].metric.get(label)
        if known is None:
            return None
        return _another_shape(label, known.solid, solid_drawn(name, content, unit, self.library))

    def store_mesh(self, label: str, name: str, content: bytes, unit: str, note: dict[str, Any]) -> StoredView:
        """Store a part's drawing, an STL or OBJ. Raises FileError, MeshError, TeachError."""
        solid = solid_drawn(name, content, unit, self.library)
        learn_solid(empty_model(self.library), solid, label)
        kind: Literal["stl", "obj"] = "stl" if name.lower().endswith(".stl") else "obj"
        note = {"mesh": name, "unit": unit, "facets": [list(solid.types)], **note}
        return self.model_store.add_mesh(label, kind, content, note)

    def store_learnt_part(self, label: str, learnt: Polyhedron, note: dict[str, Any]) -> StoredView:
        """Store a part learnt from all round, with an STL of it. Raises FileError, TeachError."""
        learn_solid(empty_model(self.library), learnt, label)
        note = {"mesh": "mesh.stl", "facets": [list(learnt.types)], ROUND: solid_json(learnt), **note}
        return self.model_store.add_mesh(label, "stl", stl_of(learnt), note)

    def single_part(
        self, left: Image, right: Image, table: TablePlane | None, moved: Places | None = None
    ) -> tuple[Group, tuple[Group, ...]]:
        """The only part in view, whatever it is, found with full effort. moved: where one camera took both images.
        Raises TeachError for none or several, VisionError."""
        from daemon.vision.look import look

        rig = self.rig if moved is None else moved.rig(self.rig)
        scene = look(left, right, rig, None, self.settings, table=table)
        groups = (scene if moved is None else with_arm_errors(scene, rig, moved.arm)).view.groups
        if not groups:
            raise TeachError("no part is seen: put it where both cameras see it, lit from above, nothing else near")
        most = max(len(g.facets) for g in groups)
        largest = [g for g in groups if len(g.facets) == most]
        if len(groups) > 1 and most == 1:
            raise TeachError(
                f"{len(groups)} facets are seen, and none meets another: turn the part a little until the edge between "
                "two of them shows, and remove other objects"
            )
        if len(largest) > 1:
            raise TeachError(f"{len(groups)} parts are in view; show the one to be taught alone")
        return largest[0], tuple(g for g in groups if g is not largest[0])

    def preview_view(self, label: str, group: Group) -> tuple[tuple[Facet, ...], list[int | None]]:
        """The facets of a view with their types, and the part's side that each will be, None where ambiguous. Raises
        TeachError."""
        model = learn_view(self.learn_all()[0], group, label)
        seen = recognise_part(group, model)
        if seen.recognition.label != label:  # as much like another part: how it lies is not known
            return seen.facets, [None] * len(seen.facets)
        return seen.facets, _sides(seen, model.metric[label].solid)

    def learn_all(self) -> tuple[Model, list[str]]:
        """A model of every stored view, in order, and one line for each view that could not be learnt.

        Drawings come last: the shape they give a part is not changed by what was measured. Before them comes what was
        walked round, all of one part joined: it may have lain on another side each time.
        """
        model, left_out, walked = empty_model(self.library, self.memory), [], dict[str, tuple[Polyhedron, ...]]()
        solids = list[tuple[str, Polyhedron, str]]()
        for view in sorted(self.model_store.views(), key=lambda view: (view.mesh is not None, _is_drawn(view))):
            try:
                if view.damage:
                    raise FileError(view.damage)
                if ROUND in view.note:
                    walked[view.label] = (*walked.get(view.label, ()), self._solid(view))
                    whole = merge_views(walked[view.label], self.library).solid
                    solids.append((view.label, whole, view.name))
                elif view.mesh is not None:
                    solids.append((view.label, self._solid(view), view.name))
                else:
                    group, _ = self.single_part(
                        *view.images(), table_of(view.note.get("table")), places_of(view.note.get("moved"))
                    )
                    model = learn_view(model, group, view.label, source=view.name)
            except (TeachError, VisionError, FileError, MeshError) as error:
                left_out.append(f"{view.name}: {error}")
        return learn_solids(model, solids), left_out

    def drawings(self) -> dict[str, DrawnPart]:
        """Each part with a drawing, by its newest one; unreadable ones are left out."""
        parts = {}
        for view in self.model_store.views():
            if _is_drawn(view):
                with contextlib.suppress(FileError, MeshError):
                    parts[view.label] = self._drawn(view)
        return parts

    def _solid(self, view: StoredView) -> Polyhedron:
        """The solid of a stored drawing, or of a part learnt from all round. Raises FileError, MeshError,
        TeachError."""
        return self._drawn(view).solid

    def _drawn(self, view: StoredView) -> DrawnPart:
        assert view.mesh is not None
        if ROUND in view.note:
            return DrawnPart(solid_from(view.note[ROUND]), None)
        unit = str(view.note.get("unit", "mm"))
        drawing = read_drawing(view.mesh.name, _drawing(view), unit, self.library)
        return DrawnPart(drawing.solid, drawing.surface)

    def train(self) -> TrainedCandidate:
        """Train a candidate on every stored view and try it on each. The model in use stays unchanged.

        Raises TeachError where there is nothing to train on, FileError.
        """
        began = perf_counter()
        model, left_out = self.learn_all()
        if not model.views:
            raise TeachError(
                "there are no views to train on: `teach LABEL` first" + "".join(f"; {x}" for x in left_out)
            )
        version = self.model_store.put_candidate(model, self._codes(model))
        tried = ModelRecogniser(model, self.rig, (self.settings or VisionSettings()).without_time_limit())
        unlearnt = {line.split(":")[0] for line in left_out}
        verdicts = [self._verdict(tried, view) for view in self.model_store.views() if view.name not in unlearnt]
        return TrainedCandidate(version, tuple(verdicts), tuple(left_out), perf_counter() - began)

    def accept(self, version: int | None) -> int:
        """Put this candidate into use; returns its version. Raises FileError (nothing changes)."""
        accepted, file = self.model_store.accept(version)
        self._take(file)
        return accepted

    def rollback(self) -> int:
        """Return to the model used before; returns its version. Raises FileError (nothing changes)."""
        version, file = self.model_store.rollback()
        self._take(file)
        return version

    def take(self, version: int) -> None:
        """Put any version into use. Raises FileError (nothing changes)."""
        self._take(self.model_store.use(version))

    def _codes(self, model: Model) -> dict[str, str] | None:
        """The ART-b bits of parts.yaml; None where it does not name every part."""
        known = {label: self.parts[label].code for label in model.labels if label in self.parts}
        return known if len(known) == len(model.labels) else None

    def coverages_of_version(self, version: int) -> tuple[ViewCoverage, ...]:
        """Assess the view coverage of every part that a version knows. Raises ModelError."""
        model = self.model_store.load(version).model
        return tuple(assess_coverage(model, label, self.rig) for label in model.labels)

    def coverage(self, label: str) -> ViewCoverage | None:
        """Assess the coverage of a part by its stored views; None where none of them can be learnt."""
        model, _ = self.learn_all()
        return assess_coverage(model, label, self.rig) if label in model.metric else None

    def drawing(self, label: str) -> Polyhedron | None:
        """The solid of a part's newest drawing; None without one."""
        drawn = self.drawings().get(label)
        return None if drawn is None else drawn.solid

    def _verdict(self, tried: ModelRecogniser, view: StoredView) -> ViewVerdict:
        if view.mesh is not None:
            return self._drawing_verdict(tried, view)
        moved = places_of(view.note.get("moved"))
        rig = None if moved is None else moved.rig(self.rig)
        parts = tried.see(*view.images(), table_of(view.note.get("table")), rig).parts
        if not parts:
            return ViewVerdict(view.name, view.label, "nothing", 0.0, None, "no part was seen in it")
        best = max(parts, key=lambda p: len(p.facets)).recognition
        return ViewVerdict(view.name, view.label, best.label, best.confidence, best.runner_up, best.reason)

    def _drawing_verdict(self, tried: ModelRecogniser, view: StoredView) -> ViewVerdict:
        """The worst verdict over the directions of the drawing's characteristic views."""
        solid = self._solid(view)
        learnt = {taught.sides for taught in tried.model.views if taught.source == view.name}
        every = aspects(solid)
        shown = [one for one in every if one.facets in learnt] or every  # another shape has taken the place of this one
        groups = (simulated_group(solid, one.facets, one.towards, self.rig) for one in shown)
        answers = [recognise_part(group, tried.model).recognition for group in groups]
        named = [one for one in answers if one.label == view.label]
        others = [one for one in answers if one.label not in (view.label, UNKNOWN)]
        worst = (others or sorted(named, key=lambda one: one.confidence) or answers)[0]
        return ViewVerdict(view.name, view.label, worst.label, worst.confidence, worst.runner_up, worst.reason)


def teaching_note(
    who: str, calibration: str, table: TablePlane | None, facets: Sequence[Facet], moved: Places | None = None
) -> dict[str, Any]:
    """The note stored with a taught view: who showed it, the calibration's sha256, the table, the facets seen, and
    where one camera took each image."""
    return ({} if moved is None else {"moved": moved.json()}) | {
        "who": who,
        "calibration": calibration,
        "table": None if table is None else table.json(),
        "facets": [[facet.type for facet in facets]],
    }


def _sides(part: Part, taught: Polyhedron) -> list[int | None]:
    """Return for each facet of a part the side of the taught one at that place; None where there is none."""
    centres = frames.apply(part.cyclopean_from_part, taught.centres_mm)
    apart = [np.linalg.norm(centres - facet.corners_mm.mean(axis=0), axis=1) for facet in part.facets]
    return [int(np.argmin(mm)) if mm.min() < SAME_SIDE_MM else None for mm in apart]


def _another_shape(label: str, taught: Polyhedron, drawn: Polyhedron) -> str | None:
    """Say how a drawing differs from the known part: more facets of one kind were seen than are drawn, or corners were
    seen farther apart. None where it may be the same."""
    lacking = Counter(taught.types) - Counter(drawn.types)
    sizes = taught.size_mm, drawn.size_mm
    sizes_text = (
        f"{len(taught.types)} facets, {sizes[0]:.0f} mm across; this drawing has {len(drawn.types)}, {sizes[1]:.0f} mm"
    )
    if lacking:
        return f"{label} was taught with {sizes_text}, and no {' or '.join(sorted(lacking))}"
    larger = sizes[0] > sizes[1] + SAME_SIZE_MM
    closed = len(taught.types) == len(drawn.types) and abs(sizes[0] - sizes[1]) > SAME_SIZE_MM
    return f"{label} was taught with {sizes_text}" if larger or closed else None


def _is_drawn(view: StoredView) -> bool:
    return view.mesh is not None and ROUND not in view.note


def _drawing(view: StoredView) -> bytes:
    """The drawing of a stored view. Raises FileError."""
    assert view.mesh is not None
    return read_below(view.folder, view.mesh.name, LARGEST_BYTES)
