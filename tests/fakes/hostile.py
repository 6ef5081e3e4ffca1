"""Hostile inputs for every reader of files and every frontend: valid input, spoiled at random, and allowed answers.

A seed damages a valid input in a few places (bits, cuts, repetitions, foreign words, values of other types). A reader
may return a value or raise one of its named errors; anything else is a finding.
"""

from __future__ import annotations

import asyncio
import io
import json
import random
import tempfile
import zipfile
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from daemon.calibration.file import load_calibration
from daemon.commands import every_command
from daemon.config import load_config
from daemon.console.interpreter import Interpreter
from daemon.dashboard.state import DashboardState
from daemon.errors import FacetdError
from daemon.fleet.layout import rows_of
from daemon.fleet.soundness import damages
from daemon.frontends.line_editor import LineEditor
from daemon.frontends.socket_server import parse_message
from daemon.review.brief import read_brief
from daemon.review.cli import record_line
from daemon.review.digest import digest
from daemon.review.export import tables
from daemon.review.pagedata import page_data
from daemon.review.replay import compare
from daemon.review.week import week_data
from daemon.store.folders import HOUSE
from daemon.store.library import load_facets, load_parts
from daemon.store.model import (
    LARGEST_UNFOLDED,
    ModelError,
    canonical_header,
    checksum_of,
    from_bytes,
    load,
    to_bytes,
)
from daemon.store.model_store import ModelStore
from daemon.store.named_positions import NamedPositions
from daemon.store.npz import Arrays, pack, unpack
from daemon.store.outside import FileError
from daemon.store.pictures import read_grey
from daemon.store.recovery_state import RecoveryFile, RecoveryState, read_interrupted_state
from daemon.store.runs import check_wire, read_run
from daemon.teaching.mesh import MeshError, read_mesh
from daemon.vision.model import empty_model, learn_view
from daemon.vision.recognition.group_recognition import recognise_part
from tests.fakes.fake_context import FakeFrontend, fake_context
from tests.fakes.made_run import MadeRun
from tests.fakes.solids import CUBE, PYRAMID, pose, view_of

ETC = HOUSE / "etc"
WORDS = (
    *(bytes([k]) for k in b"[]{}\"':,-\n\0\xff"),
    *(b"- ", b"&a ", b"*a", b"<<: ", b"!!binary ", b"!!python/object:os.system ", b"0777", b"1:30", b"a: {" * 500),
    *(b"null", b"true", b"NaN", b"Infinity", b"-1", b"1e999", b"9" * 400, b"[" * 2000, b'{"a":' * 2000, b" " * 3000),
    *(b"../../etc/hostname", b"/etc/hostname", b"/dev/zero", b"\x1b[2J", b"\xed\xa0\x80", b"stop", b"\x03"),
    *(b"vertex 1 2 3\n", b"f 1 2 3\n", b"f -1 -2 -9\n", b"v nan inf 0\n"),
)
PLACES = b"".join(
    b'{"v": 1, "t": "2026-01-01", "who": "w", "name": "%s", "world_from_tool": '
    b"[[1.0, 0, 0, 500], [0, 1, 0, 0], [0, 0, 1, 300], [0, 0, 0, 1]]}\n" % name
    for name in (b"a", b"b", b"a")
)
VALUES: tuple[Any, ...] = (
    None,
    True,
    -1,
    2**70,
    1e308,
    "",
    "x" * 50,
    "\x1b]0;t\x07\n",
    [],
    [[]],
    {},
    {"a": {}},
    [1, "2"],
)


@dataclass(frozen=True)
class Reader:
    """valid: inputs that are read without complaint; read: gives anything, or raises one of `errors`."""

    name: str
    valid: Callable[[], tuple[bytes, ...]]
    read: Callable[[bytes, Path], object]
    errors: tuple[type[Exception], ...] = (FileError,)


def spoiled(content: bytes, chance: random.Random) -> bytes:
    """The content with one to four defects."""
    for _ in range(chance.randint(1, 4)):
        content = chance.choice(SPOILINGS)(content, chance)
    return content[:200_000]


def _flip(content: bytes, chance: random.Random) -> bytes:
    if not content:
        return content
    at = chance.randrange(len(content))
    return content[:at] + bytes([content[at] ^ 1 << chance.randrange(8)]) + content[at + 1 :]


def _cut(content: bytes, chance: random.Random) -> bytes:
    return content[: chance.randint(0, len(content))]


def _without(content: bytes, chance: random.Random) -> bytes:
    at, length = chance.randint(0, len(content)), chance.randint(1, 60)
    return content[:at] + content[at + length :]


def _doubled(content: bytes, chance: random.Random) -> bytes:
    at, length = chance.randint(0, len(content)), chance.randint(1, 200)
    return content[:at] + content[at : at + length] * chance.randint(1, 30) + content[at:]


def _with_word(content: bytes, chance: random.Random) -> bytes:
    at = chance.randint(0, len(content))
    return content[:at] + chance.choice(WORDS) + content[at + chance.choice((0, 0, 1, 4)) :]


def _other_value(content: bytes, chance: random.Random) -> bytes:
    """The content with a value of another type somewhere in one of its JSON lines."""
    lines = content.split(b"\n")
    at = chance.randrange(len(lines))
    try:
        found = json.loads(lines[at])
    except (ValueError, RecursionError):
        return content
    lines[at] = json.dumps(_changed(found, chance)).encode()
    return b"\n".join(lines)


def _changed(value: Any, chance: random.Random) -> Any:
    if isinstance(value, dict) and value and chance.random() < 0.85:
        key = chance.choice(list(value))
        return {**value, key: _changed(value[key], chance)}
    if isinstance(value, list) and value and chance.random() < 0.85:
        at = chance.randrange(len(value))
        return [*value[:at], _changed(value[at], chance), *value[at + 1 :]]
    return chance.choice(VALUES)


SPOILINGS = (_flip, _cut, _without, _doubled, _with_word, _with_word, _other_value, _other_value)


def _file(read: Callable[[Path], object], content: bytes, folder: Path, name: str = "file") -> object:
    (folder / name).write_bytes(content)
    return read(folder / name)


def _yaml(name: str) -> Callable[[], tuple[bytes, ...]]:
    def valid() -> tuple[bytes, ...]:
        lines = [line for line in (ETC / name).read_bytes().splitlines() if line.strip() and line.strip()[:1] != b"#"]
        return (b"\n".join(lines[:40]),)

    return valid


def _configuration() -> tuple[bytes, ...]:
    return (
        b"version: 1\ncell: simulated\nfolders: {state: s}\npick: {limits: {table_z_mm: -300}}\nlog: {quota_mb: 10}\n",
        b"version: 1\nconsole: {tty: {device: /dev/x, may: look}}\nhealth: {arm_check_s: 3}\nmetrics: {port: 9000}\n",
    )


@cache
def _models() -> tuple[bytes, ...]:
    model = to_bytes(empty_model(load_facets()))
    return model, _stored(model)


def _stored(archive: bytes) -> bytes:
    """The archive with its members uncompressed, so that defects reach their content."""
    out = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(archive)) as before, zipfile.ZipFile(out, "w") as after:
        for name in before.namelist():
            after.writestr(name, before.read(name))
    return out.getvalue()


@cache
def _pictures() -> tuple[bytes, ...]:
    image = np.random.default_rng(1).integers(0, 255, (24, 32), np.uint8)
    found = tuple(cv2.imencode(kind, image)[1].tobytes() for kind in (".png", ".jpg", ".bmp", ".pgm"))
    return (*found, *(claiming(side) for side in (4000, 30_000, 2**31 - 1)))


def claiming(side: int) -> bytes:
    """A PNG whose header claims this size but that holds a few bytes."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return len(data).to_bytes(4, "big") + kind + data + zlib.crc32(kind + data).to_bytes(4, "big")

    header = side.to_bytes(4, "big") * 2 + b"\x08\0\0\0\0"
    return (
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(bytes(99))) + chunk(b"IEND", b"")
    )


def _meshes() -> tuple[bytes, ...]:
    obj = b"v 0 0 0\nv 50 0 0\nv 0 50 0\nv 0 0 50\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    facet = b"facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 50 0 0\nvertex 0 50 0\nendloop\nendfacet\n"
    binary = bytes(80) + (2).to_bytes(4, "little") + np.arange(100, dtype=np.uint8).tobytes()
    return obj, b"solid x\n" + facet * 3 + b"endsolid x\n", binary


def _mesh(content: bytes, _: Path) -> object:
    return [_one_mesh(name, content) for name in ("x.obj", "x.stl")]


def _one_mesh(name: str, content: bytes) -> object:
    try:
        return read_mesh(name, content)
    except MeshError as error:
        return error


@cache
def _runs() -> tuple[bytes, ...]:
    with tempfile.TemporaryDirectory() as folder:
        made = MadeRun(Path(folder) / "run")
        made.pick("missed")
        made.write("fault", code="link", text="the cable", **{"while": "moving"})
        made.close()
        return ((made.folder / "run.jsonl").read_bytes(),)


def _run(content: bytes, folder: Path) -> object:
    (folder / "run.jsonl").write_bytes(content)
    run = read_run(folder)
    found = digest("run", run.records, run.skipped)
    json.dumps(page_data(found), allow_nan=False)
    tables(found, "cell")
    return found.statistics(), [record_line(record) for record in run.records]


def _wire(content: bytes, folder: Path) -> object:
    (folder / "wire.jsonl").write_bytes(content)
    return check_wire(folder)


@cache
def _standings() -> tuple[bytes, ...]:
    with tempfile.TemporaryDirectory() as folder:
        file = RecoveryFile(Path(folder) / "standing")
        for standing in (RecoveryState("a"), RecoveryState("a", cycle=1, label="cube", hand_closed=True)):
            file.write(standing)
        file.close()
        return (file.path.read_bytes(),)


def _view(content: bytes, folder: Path) -> object:
    view = folder / "views" / "cube" / "1"
    view.mkdir(parents=True, exist_ok=True)
    (view / "view.json").write_bytes(content)
    (found,) = ModelStore(folder).views()
    return found.damage or found.note


def _state(content: bytes, folder: Path) -> object:
    (folder / "models").mkdir(exist_ok=True)
    (folder / "models" / "state.json").write_bytes(content)
    return ModelStore(folder).current


def _said(content: bytes, folder: Path) -> object:
    """A line at the socket, and what the interpreter makes of it; a fault in facetd itself is none that is named."""
    message = parse_message(content)
    context = fake_context(folder)
    context.log.records.clear()
    if not isinstance(message.do, str):
        return message
    frontend = FakeFrontend(may="look")
    answer = asyncio.run(Interpreter(context, every_command()).interpret(message.do, frontend))
    if answer.data.get("why") == "internal":
        raise AssertionError(answer.text)
    return answer


def _typed(content: bytes, _: Path) -> object:
    editor = LineEditor("> ", lambda typed: [typed])
    return [editor.feed(content[at : at + 7]).events for at in range(0, min(len(content), 4000), 7)]


@cache
def _model_parts() -> tuple[dict[str, Any], Arrays]:
    """A model of two views: its header without the checksum, and its arrays."""
    model = empty_model(load_facets())
    chance = np.random.default_rng(1)
    for label, body in (("cube", CUBE), ("pyramid", PYRAMID)):
        model = learn_view(model, view_of(body, pose(np.array([1.0, 0.1, 0.8]), 0.1), chance, 0.5), label)
    arrays = unpack(to_bytes(model), LARGEST_UNFOLDED)
    header = json.loads(arrays.pop("header").tobytes())
    return {key: value for key, value in header.items() if key != "sha256"}, arrays


def fitting(header: dict[str, Any], arrays: Arrays) -> bytes:
    """A model file whose checksum matches its content. Raises where the header is invalid."""
    told = header | {"sha256": checksum_of(header, arrays)}
    return pack(arrays | {"header": np.frombuffer(canonical_header(told), np.uint8)})


def _fitting_model(content: bytes, _: Path) -> object:
    """Of a header that somebody spoiled, the model whose checksum fits; whoever writes one writes its checksum. What is
    taken for one answers, too."""
    arrays = _model_parts()[1]
    try:
        file = fitting(json.loads(content), arrays)
    except (ValueError, TypeError, RecursionError, UnicodeError) as error:
        raise ModelError("no header") from error
    model = from_bytes(file).model
    return recognise_part(view_of(CUBE, pose(np.array([0.3, 0.2, 0.9]), 1.0), np.random.default_rng(2)), model)


def _places(content: bytes, folder: Path) -> object:
    (folder / "places.jsonl").write_bytes(content)
    return NamedPositions(folder).now()


def _made_again(content: bytes, folder: Path) -> object:
    """A run as pages of many runs read it, the live page, tables, and a replay before it begins."""
    (folder / "run.jsonl").write_bytes(content)
    run, brief, now = read_run(folder), read_brief(folder), DashboardState()
    json.dumps(week_data([brief], ["x"]), allow_nan=False)
    for record in run.records:
        now.recorded(record)
    json.dumps(now.json(), default=str, allow_nan=False)
    rows_of(digest("run", run.records))
    return damages(folder, run), [
        compare(look.get("scene") or {}, {}) for look in run.records if look["kind"] == "look"
    ]


READERS = (
    Reader("configuration", _configuration, partial(_file, load_config)),
    Reader("calibration", _yaml("calibration.yaml"), partial(_file, load_calibration)),
    Reader("facets", _yaml("facets.yaml"), partial(_file, load_facets)),
    Reader("parts", _yaml("parts.yaml"), partial(_file, load_parts)),
    Reader("model", _models, partial(_file, load)),
    Reader("picture", _pictures, partial(_file, read_grey)),
    Reader("drawing", _meshes, _mesh),
    Reader("run", _runs, _run),
    Reader("run, for many", _runs, _made_again),
    Reader("model that fits", lambda: (json.dumps(_model_parts()[0]).encode(),), _fitting_model),
    Reader("places", lambda: (PLACES,), _places),
    Reader("wire", lambda: (b'{"seq": 1, "chain": ""}\n{"seq": 2, "chain": "x"}',), _wire),
    Reader("standing", _standings, partial(_file, partial(read_interrupted_state, ran_before=True))),
    Reader("view", lambda: (b'{"v": 1, "table": {"up": [0, 0, 1], "level_mm": 3}, "facets": [["square"]]}',), _view),
    Reader("models in use", lambda: (b'{"current": 3, "candidate": null, "history": [1, 2]}',), _state),
    Reader(
        "socket",
        lambda: (b'{"do": "status", "door": "x", "id": 3}', b'{"answer": "y"}', b'{"do": "views cube"}'),
        _said,
        (ValueError,),
    ),
    Reader("terminal", lambda: (b"status\r", b"\x1b[A\x1b[Dpick cube\x15\t\r", b"help teach\r\n"), _typed, ()),
)  # fmt: skip


def attack(reader: Reader, seed: int, count: int, folder: Path) -> Iterator[tuple[bytes, Exception]]:
    """Try many inputs from a seed; returns each that caused anything but a value or a named error."""
    chance = random.Random(f"{reader.name} {seed}")
    valid = reader.valid()
    for _ in range(count):
        content = spoiled(chance.choice(valid), chance)
        try:
            reader.read(content, folder)
        except reader.errors as error:
            if isinstance(error, FacetdError) and "\n" in str(error):
                yield content, error
        except Exception as error:
            yield content, error
