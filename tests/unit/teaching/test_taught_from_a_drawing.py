"""A part taught from a drawing, by the trainer and at the console."""

from __future__ import annotations

import asyncio
from pathlib import Path

import numpy as np
import pytest

from daemon.commands.teaching import teach
from daemon.errors import NOT_UNDERSTOOD, CommandError
from daemon.store.library import load_facets, load_parts
from daemon.teaching.mesh import MeshError, read_mesh
from daemon.teaching.trainer import Trainer
from daemon.teaching.view_coverage import simulated_group
from daemon.vision.model import aspects
from daemon.vision.recognition.group_recognition import recognise_part
from tests.fakes import drawn, rendered
from tests.fakes.drawn import block, solid

RIG = rendered.rig(rendered.HERE, "B")
LIBRARY = load_facets()


CUBE = drawn.box()
GAP = drawn.obj(CUBE[0], CUBE[1][:5])


def test_a_drawing_is_kept_trained_on_and_names_the_part_in_a_real_picture(trainer: Trainer) -> None:
    for label, drawing in (("cube", drawn.box(50, 50, 50)), ("brick", drawn.box(40, 50, 60))):
        view = trainer.store_mesh(label, f"{label}.stl", drawn.binary_stl(*drawing), "mm", {"who": "tester"})
        assert view.mesh is not None
        assert view.note["facets"][0] == list(solid("x.obj", drawn.obj(*drawing)).types)
    trained = trainer.train()
    assert trained.left_out == ()
    assert [(v.view, v.named) for v in trained.verdicts] == [("brick/1", "brick"), ("cube/1", "cube")]
    trainer.accept(trainer.model_store.candidate)
    assert trainer.untrained_views() == []
    scenes = [f.parent for f in sorted(rendered.HERE.glob("*/truth.json")) if _holds(f.parent, "cube")]
    assert scenes, "a scene with a cube belongs to the test data"
    for scene in scenes:
        rig = rendered.rig(rendered.HERE, rendered.truth(scene)["rig"])
        scenery = Trainer(trainer.model_store, rig, LIBRARY, load_parts()).in_use.see(*rendered.pair(scene))
        named = [p.recognition.label for p in scenery.parts]
        assert "brick" not in named
        assert "cube" in named, (scene.name, [p.recognition.reason for p in scenery.parts])
    assert trainer.model_store.drop_views("cube") == 1
    assert trainer.learn_all()[0].labels == ("brick",)


def _holds(scene: Path, label: str) -> bool:
    return any(one["label"] == label for one in rendered.truth(scene)["objects"])


def test_shown_views_and_a_drawing_of_one_part_go_together(trainer: Trainer) -> None:
    cube = block(50, 50, 50)
    richest = aspects(cube)[0]
    view = simulated_group(cube, richest.facets, richest.towards, RIG)
    trainer.store_mesh("cube", "cube.obj", drawn.obj(*drawn.box()), "mm", {})
    model, left_out = trainer.learn_all()
    assert left_out == []
    assert recognise_part(view, model).recognition.label == "cube"


def test_a_drawing_that_a_newer_one_of_the_part_has_replaced_is_tried_all_the_same(trainer: Trainer) -> None:
    trainer.store_mesh("brick", "brick.obj", drawn.obj(*drawn.box(40, 50, 60)), "mm", {})
    trainer.store_mesh("brick", "brick.obj", drawn.obj(*drawn.box(40, 50, 80)), "mm", {})
    verdicts = {verdict.view: verdict.named for verdict in trainer.train().verdicts}
    assert verdicts == {"brick/1": "unknown", "brick/2": "brick"}


def test_a_damaged_drawing_on_the_shelf_is_left_out_and_named(trainer: Trainer) -> None:
    view = trainer.store_mesh("cube", "cube.obj", drawn.obj(*drawn.box()), "mm", {})
    trainer.store_mesh("brick", "brick.obj", drawn.obj(*drawn.box(40, 50, 60)), "mm", {})
    assert view.mesh is not None
    view.mesh.write_bytes(b"v 1\n")
    trained = trainer.train()
    assert [line.split(":")[0] for line in trained.left_out] == ["cube/1"]
    assert [verdict.label for verdict in trained.verdicts] == ["brick"]


class Reader:
    """A frontend whose operator has some files."""

    name, who, may, asks = "test", "tester", "all", False

    def __init__(self, **files: bytes) -> None:
        self.files = {name.replace("_", "."): content for name, content in files.items()}

    async def say(self, text: str) -> None:
        assert "along the drawing's x, y, z" in text

    async def ask(self, question: str) -> str:
        raise AssertionError(question)

    async def fetch(self, path: str) -> bytes:
        if path not in self.files:
            raise CommandError(f"{path}: No such file or directory", NOT_UNDERSTOOD)
        return self.files[path]


@pytest.mark.parametrize(
    ("text", "want"),
    [
        ("cube --mesh", "FILE is missing: teach LABEL --mesh"),
        ("cube --mesh none.stl", "none.stl: No such file or directory"),
        ("--mesh cube.stl", "LABEL is missing"),
        ("cube --mesh cube.stl mile", "mile: no such unit; choose from: cm, inch, m, mm"),
        ("cube --mesh cube.stl mm mm", "mm: one word too many"),
        ("cube --mesh bad.obj", "bad.obj: not closed"),
        ("brick --mesh bad.obj", "bad.obj: not closed"),
        ("brick --mesh cube.txt", "cube.txt: expected a name that ends in .stl, .obj"),
        ("brick --mesh cube.stl", "To add a new part, teach it at a console"),
    ],
)
def test_a_drawing_that_cannot_be_taught_is_an_answer_and_nothing_is_kept(
    trainer: Trainer, text: str, want: str
) -> None:
    from tests.fakes import fake_context

    context = fake_context.fake_context(trainer.model_store.folder)
    context.trainer = trainer
    frontend = Reader(cube_stl=drawn.binary_stl(*CUBE), bad_obj=GAP, cube_txt=b"")
    with pytest.raises(CommandError) as told:
        asyncio.run(teach.run(context, text.split(), frontend))  # type: ignore[arg-type]
    assert want in str(told.value)
    assert told.value.status == NOT_UNDERSTOOD
    assert trainer.model_store.views() == []


class Answering(Reader):
    """One who is asked, and answers the same each time."""

    asks = True

    def __init__(self, answer: str, **files: bytes) -> None:
        super().__init__(**files)
        self.answer, self.asked, self.said = answer, list[str](), ""

    async def say(self, text: str) -> None:
        self.said += text

    async def ask(self, question: str) -> str:
        self.asked.append(question)
        return self.answer


def teaching(trainer: Trainer, text: str, frontend: Reader) -> str:
    from tests.fakes import fake_context

    context = fake_context.fake_context(trainer.model_store.folder)
    context.trainer = trainer
    return asyncio.run(teach.run(context, text.split(), frontend)).text  # type: ignore[arg-type]


def test_whether_it_is_in_mm_is_a_question_that_takes_an_answer(trainer: Trainer) -> None:
    inches = {"cube_stl": drawn.binary_stl(*drawn.box(2, 2, 2))}
    asked = Answering("inch", **inches)
    told = teaching(trainer, "cube --mesh cube.stl", asked)
    assert asked.asked == ["cube.stl: 2 mm long: is it in mm? Answer cm, m, inch: "]
    assert told.startswith("Stored as cube/1")
    (view,) = trainer.model_store.views()
    assert view.note["unit"] == "inch"
    for frontend in (Answering("n", **inches), Reader(**inches)):
        with pytest.raises(CommandError, match="is it in mm"):
            teaching(trainer, "cube --mesh cube.stl", frontend)


def test_what_was_mended_is_said_and_a_name_that_is_no_utf8_is_kept(trainer: Trainer) -> None:
    name = b"w\xfcrfel.stl".decode(errors="surrogateescape")
    frontend = Answering("y")
    frontend.files[name] = drawn.binary_stl(CUBE[0], CUBE[1] * 2)
    told = teaching(trainer, f"cube --mesh {name}", frontend)
    assert "In the file: 12 doubled triangles are left out." in frontend.said
    assert told.encode()
    (view,) = trainer.model_store.views()
    assert view.note["mesh"] == "w?rfel.stl"


def test_a_drawing_that_is_odd_under_its_label_is_asked_about(trainer: Trainer) -> None:
    cube = drawn.binary_stl(*CUBE)
    assert trainer.drawing_conflict("cube", "cube.stl", cube, "mm") is None
    trainer.store_mesh("cube", "cube.stl", cube, "mm", {})
    for label in ("cube", "block"):
        assert trainer.drawing_conflict(label, "again.stl", cube, "mm") == "this drawing is stored already, as cube/1"
    ring = [(20 * np.cos(a), 20 * np.sin(a)) for a in np.arange(24) * 2 * np.pi / 24]
    round_one = drawn.obj(*drawn.prism(ring, 40.0))
    told = trainer.drawing_conflict("cube", "cylinder.obj", round_one, "mm")
    assert told is not None
    assert told.startswith("cube was taught with 6 facets, 87 mm across; this drawing has 2, 57 mm, and no square")
    larger = trainer.drawing_conflict("cube", "cube.obj", drawn.obj(*drawn.box(80, 80, 80)), "mm")
    assert larger is not None
    assert "139 mm" in larger


def test_a_drawing_that_cannot_be_read_any_more_keeps_nobody_from_teaching_another(trainer: Trainer) -> None:
    cube = drawn.binary_stl(*CUBE)
    mesh = trainer.store_mesh("block", "block.stl", cube, "mm", {}).mesh
    assert mesh is not None
    mesh.unlink()
    mesh.mkdir()
    assert trainer.drawing_conflict("cube", "cube.stl", cube, "mm") is None


def test_a_line_is_counted_as_a_persons_editor_counts_it() -> None:
    content = "# drawn by \u00c5ngstr\u00f6m\nv 1 2\n".encode()
    with pytest.raises(MeshError, match=r"p\.obj:2: expected 3 numbers"):
        read_mesh("p.obj", content)
