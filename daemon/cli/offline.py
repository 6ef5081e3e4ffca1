"""Commands `facetctl recognise`, `train` and `model`: the recogniser on files, without a daemon."""

from __future__ import annotations

import argparse
import json
import shutil
import sys
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from daemon.console.phrases import plural
from daemon.errors import DONE, NOT_UNDERSTOOD, FacetdError, spelt
from daemon.store.outside import FileError
from daemon.store.yamlfile import read

if TYPE_CHECKING:
    from daemon.calibration.file import Calibration
    from daemon.vision.model import Model
    from daemon.vision.values import Scene


CALIBRATION: Mapping[str, Any] = {
    "type": Path, "required": True, "metavar": "FILE", "help": "calibration.yaml of the pictures"
}  # fmt: skip


class ListedView(msgspec.Struct, forbid_unknown_fields=True):
    left: str
    right: str
    label: str


def register(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add `recognise`, `train` and `model` to facetctl."""
    _register_recognise(subparsers)
    train = subparsers.add_parser("train", help="teach views from image files, and drawings, and write a model")
    train.add_argument("--calibration", **CALIBRATION)
    train.add_argument("--views", type=Path, metavar="YAML", help="a list of {left, right, label}")
    train.add_argument(
        "--mesh",
        action="append",
        default=[],
        metavar="LABEL=FILE",
        help="a part's drawing, STL or OBJ (extra `drawings`: PLY, 3MF, STEP); may be repeated",
    )
    train.add_argument("--unit", default="mm", help="of the drawings: mm (default), cm, m or inch")
    train.add_argument("--out", type=Path, required=True, metavar="MODEL", help="the model to write, .npz")
    train.add_argument("--facets", type=Path, metavar="YAML", help="the facet library (default: etc/facets.yaml)")
    train.add_argument("--parts", type=Path, metavar="YAML", help="names and ART-b codes (default: etc/parts.yaml)")
    train.set_defaults(run=_train)
    model = subparsers.add_parser("model", help="the parts of a model: show, compare, check")
    kinds = model.add_subparsers(dest="what", required=True, metavar="show|diff|check")
    for name, files, text in (
        ("show", 1, "parts, views and nodes"),
        ("diff", 2, "the differences of two models"),
        ("check", 1, "whether the file is sound, and which parts could be confused"),
    ):
        kind = kinds.add_parser(name, help=text)
        kind.add_argument("files", type=Path, nargs=files, metavar="MODEL", help="a file, or 3, or latest")
        kind.add_argument("--json", action="store_true", help="JSON for programs")
        kind.set_defaults(run=_model)


def _register_recognise(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    recognise = subparsers.add_parser("recognise", help="name and locate parts in stored stereo pairs")
    recognise.add_argument("--calibration", **CALIBRATION)
    recognise.add_argument("--model", type=Path, required=True, metavar="MODEL", help="a file, or 3, or latest")
    recognise.add_argument("--json", action="store_true", help="one JSON object a line (the default)")
    recognise.add_argument("--draw", type=Path, metavar="PNG", help="draw what was seen; with several pairs PNG-<name>")
    recognise.add_argument("pairs", nargs="+", metavar="DIR", help="a folder with left.png and right.png")
    recognise.set_defaults(run=_recognise)


def _recognise(args: argparse.Namespace) -> int:
    """Print one JSON line a pair; unusable pairs are reported on stderr and the others still done."""
    from time import thread_time

    from daemon.calibration.file import load_calibration
    from daemon.store.model import load
    from daemon.store.model_store import model_file
    from daemon.store.pictures import read_as_stored
    from daemon.vision.image import VisionError
    from daemon.vision.look import look
    from daemon.vision.report import scene_json

    calibration, model = load_calibration(args.calibration), load(model_file(args.model))
    status = DONE
    for name in args.pairs:
        try:
            left, right = (read_as_stored(Path(name) / f"{camera}.png") for camera in ("left", "right"))
            scene = look(left, right, calibration.rig, model, clock=thread_time)
            print(json.dumps({"pair": name, **scene_json(scene)}), flush=True)
            if args.draw:
                path, several = args.draw, len(args.pairs) > 1
                own = path.with_name(f"{path.stem}-{Path(name).resolve().name}{path.suffix}") if several else path
                _draw(own, left, right, scene)
        except (FileError, VisionError) as error:
            print(f"facetctl {args.command}: {name}: {error}", file=sys.stderr)
            status = NOT_UNDERSTOOD
    return status


def _draw(path: Path, left: Any, right: Any, scene: Scene) -> None:
    import cv2

    from daemon.store.files import failing_as, write_atomically
    from daemon.vision.draw import draw_scene

    with failing_as(FacetdError, f"{path}: cannot be written"):
        write_atomically(path, cv2.imencode(".png", draw_scene(left, right, scene))[1].tobytes())


def _train(args: argparse.Namespace) -> int:
    """Learn every view in the order of the file, then every drawing. A drawing that cannot be learnt is reported on
    stderr and the others still learnt; a view that cannot be learnt ends the training."""
    from daemon.calibration.file import load_calibration
    from daemon.store.library import FACETS, PARTS, load_facets, load_parts
    from daemon.store.model import save
    from daemon.teaching.mesh import UNITS_MM
    from daemon.vision.model import empty_model

    if not args.views and not args.mesh:
        raise FacetdError("nothing to learn from: give --views YAML, or --mesh LABEL=FILE")
    if args.unit not in UNITS_MM:
        raise FacetdError(f"--unit {args.unit}: expected one of {', '.join(UNITS_MM)}")
    calibration = load_calibration(args.calibration)
    model = empty_model(load_facets(args.facets or FACETS))
    parts = load_parts(args.parts or PARTS) if args.parts or PARTS.exists() else {}
    if args.views:
        model = _with_views(model, args.views, calibration)
    model, refused = _with_drawings(model, args.mesh, args.unit)
    if len(refused) == 1 and not model.labels:
        raise FacetdError(refused[0])
    for line in refused:
        print(f"facetctl {args.command}: not learned: {line}", file=sys.stderr)
    if not model.labels:
        raise FacetdError(f"none of {plural(len(refused), 'drawing')} can be learned")
    codes = {label: parts[label].code for label in model.labels} if set(model.labels) <= set(parts) else None
    save(model, args.out, trained=datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ"), codes=codes)
    taught, views = plural(len(model.labels), "part"), plural(len(model.views), "view")
    print(f"{spelt(str(args.out))}: {taught} from {views}, {plural(len(model.artmap.node_labels), 'node')}")
    return NOT_UNDERSTOOD if refused else DONE


def _with_drawings(model: Model, words: list[str], unit: str) -> tuple[Model, list[str]]:
    """The model with every drawing that can be learnt, and a line for each that cannot. Raises FacetdError."""
    from daemon.pick.grippers import TwoFingers
    from daemon.store.outside import read_file
    from daemon.teaching.drawing_summary import describe_drawing
    from daemon.teaching.foreign_drawings import in_own_format
    from daemon.teaching.mesh import LARGEST_BYTES, MeshError, UnitError
    from daemon.teaching.solid_from_mesh import read_drawing
    from daemon.vision.model import TeachError, learn_solid

    refused = []
    for label, file in [_label_and_path(word) for word in words]:
        name = spelt(str(file))
        try:
            drawing = read_drawing(*in_own_format(name, read_file(file, LARGEST_BYTES), unit), model.library)
            model = learn_solid(model, drawing.solid, label, source=name)
        except UnitError as error:
            refused.append(f"{error.question} give --unit {error.others}")
        except (FileError, MeshError) as error:
            refused.append(spelt(str(error)))
        except TeachError as error:
            refused.append(f"{name}: {error}")
        else:
            for line in describe_drawing(drawing, TwoFingers().opening_mm):
                print(f"{label}: {line}")
    return model, refused


def _label_and_path(word: str) -> tuple[str, Path]:
    label, _, file = word.partition("=")
    if not label or not file:
        raise FacetdError(f"--mesh {spelt(word)}: expected LABEL=FILE, such as cube=cube.stl")
    return label, Path(file)


def _with_views(model: Model, path: Path, calibration: Calibration) -> Model:
    from daemon.vision.image import VisionError
    from daemon.vision.model import TeachError

    document = read(path)
    views = document.convert(list[ListedView])
    if not views:
        raise document.error((), "expected at least one view, found an empty list")
    for index, view in enumerate(views):
        try:
            model = _with_view(model, view, path.parent, calibration)
        except (FileError, TeachError, VisionError) as error:
            raise FacetdError(str(document.error((index,), f"{view.label}: {error}"))) from None
    return model


def _with_view(model: Model, view: ListedView, base: Path, calibration: Calibration) -> Model:
    from daemon.store.pictures import read_as_stored
    from daemon.vision.facets import find_facets
    from daemon.vision.model import TeachError, learn_view

    left, right = (_existing_path(base, name) for name in (view.left, view.right))
    seen = find_facets(read_as_stored(left), read_as_stored(right), calibration.rig)
    if not seen.groups:
        raise TeachError("no facet was found in both images")
    largest = max(seen.groups, key=lambda g: (len(g.facets), sum(len(f.corners_mm) for f in g.facets)))
    if sum(len(g.facets) == len(largest.facets) for g in seen.groups) > 1:
        raise TeachError("more than one part is in view; show one alone")
    return learn_view(model, largest, view.label, source=str(left))


def _existing_path(base: Path, name: str) -> Path:
    """An image named in a list of views: relative to the list, or else to the working directory."""
    return base / name if (base / name).exists() else Path(name)


def _model(args: argparse.Namespace) -> int:
    from daemon.cli.model_report import ModelReport, check, compare, describe
    from daemon.console.text_layout import fold
    from daemon.store.model import load_file
    from daemon.store.model_store import model_file

    files = [load_file(model_file(path)) for path in args.files]
    reports: Mapping[str, Callable[..., ModelReport]] = {"show": describe, "diff": compare, "check": check}
    report = reports[args.what](*files)
    if args.json:
        print(json.dumps(report.data))
    elif sys.stdout.isatty():
        print("\n".join(fold(report.text, shutil.get_terminal_size().columns)))
    else:
        print(report.text)
    return DONE
