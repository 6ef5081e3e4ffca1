"""The house itself: whose names its packages are, its rooms' doors, and prose that names only what is there."""

import ast
import io
import os
import pkgutil
import re
import subprocess
import sys
import tokenize
import tomllib
from collections.abc import Iterator
from importlib.metadata import entry_points, packages_distributions
from pathlib import Path

import pytest
import yaml

from daemon.store.folders import HOUSE
from tests.bench import ablation
from tests.bench.long import mutations

NAMED = re.compile(
    r"(?<![\w./*<{-])(?:[\w-]+/)*[\w-]+\.(?:py|sh)\b|(?<![\w./])(?:daemon|drivers|tests|etc)/[\w/]*\w(?!\w|\.\w)"
)
"""A file, with or without its folders; or a folder of ours with its whole path."""
DOTTED = re.compile(r"(?:daemon|drivers)(?:\.\w+)+")
"""A name in a module of ours."""
FROM = re.compile(r"^\s*from (daemon(?:\.\w+)+) import ", re.MULTILINE)
REPLACES = re.compile(r"\b(?:setattr|delattr|object|patch)\(")
ROOM = re.compile(r"`([\w-]+/)`")
"""A room in a table of rooms."""
ARRANGEMENTS = re.compile(r"/wo(?:rk)/|\b(?:HOUSE|DESIGN|STYLE)(?:\.md)|\b[Ii]ssue(?: |-| #)\d")
"""How and by whom work is parted is no business of who reads the code."""


def tracked() -> list[Path]:
    listed = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard"], cwd=HOUSE, capture_output=True, text=True
    )
    if listed.returncode:
        pytest.skip("not a git checkout")
    return [HOUSE / name for name in listed.stdout.splitlines() if (HOUSE / name).is_file()]


def prose(file: Path) -> str:
    """A page's text; of a program its comments and docstrings."""
    text = file.read_text()
    if file.suffix == ".md":
        return text
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    return "\n".join(
        t.string
        for t in tokens
        if t.type == tokenize.COMMENT or (t.type == tokenize.STRING and t.string.lstrip("rf").startswith('"""'))
    )


def test_a_file_or_room_named_in_prose_exists() -> None:
    files = tracked()
    paths = {p.relative_to(HOUSE).parts for f in files for p in (f, *f.parents) if p.is_relative_to(HOUSE)}
    there = {"/".join(parts[k:]) for parts in paths for k in range(len(parts))}
    gone = []
    for file in (f for f in files if f.suffix in (".py", ".md")):
        if all(name.rstrip("/") in there for find in (NAMED, ROOM) for name in find.findall(file.read_text())):
            continue  # nor does its prose: to part it from the code takes long
        said = prose(file)
        names = NAMED.findall(said) + (ROOM.findall(said) if file.name in ("README.md", "ARCHITECTURE.md") else [])
        gone += [(str(file.relative_to(HOUSE)), name) for name in names if name.rstrip("/") not in there]
    assert gone == []


def test_every_room_says_at_its_frontend_what_belongs_in_it() -> None:
    rooms = {
        f.parent for f in tracked() if f.suffix == ".py" and f.relative_to(HOUSE).parts[0] in ("daemon", "drivers")
    }
    for room in sorted(rooms):
        door = room / "__init__.py"
        assert door.is_file(), f"{room} has no door"
        said = ast.get_docstring(ast.parse(door.read_text()))
        assert said, f"{door} says nothing"
        assert 1 <= len(re.findall(r"\.(?:\s|$)", said)) <= 3, f"{door}: one to three sentences"


def test_the_drawing_of_the_floors_is_the_contract_that_imports_are_held_to() -> None:
    drawing = (HOUSE / "docs" / "ARCHITECTURE.md").read_text().split("```")[1].strip().splitlines()
    drawn: dict[str, list[str]] = {"daemon": []}
    for line in drawing[: drawing.index(next(x for x in drawing if x.startswith("arrays"))) + 1]:
        names = re.match(r" *((?:\w+ )*\w+)  ", line)[1].split()
        container = f"daemon.{drawn['daemon'][-1]}" if line.startswith(" ") else "daemon"
        drawn.setdefault(container, []).extend(names)
    contracts = tomllib.loads((HOUSE / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    floors = {
        c["containers"][0]: " ".join(c["layers"]).replace("|", " ").split() for c in contracts if c["type"] == "layers"
    }
    assert drawn == floors
    for container, rooms in floors.items():
        folder = HOUSE / container.replace(".", "/")
        assert all((folder / room).is_dir() or (folder / f"{room}.py").is_file() for room in rooms)


def test_a_room_with_public_names_at_its_frontend_is_entered_by_it() -> None:
    rooms = {str(f.parent.relative_to(HOUSE)).replace("/", "."): f for f in (HOUSE / "daemon").rglob("__init__.py")}
    doors = {room for room, f in rooms.items() if f"\nfrom {room}." in f.read_text()}
    assert {"daemon.vision.geometry", "daemon.arm", "daemon.art"} <= doors
    past = []
    for file in (HOUSE / "daemon").rglob("*.py"):
        own = str(file.parent.relative_to(HOUSE)).replace("/", ".") + "."
        for module in FROM.findall(file.read_text()):
            inside = [d for d in doors if module.startswith(d + ".") and not own.startswith(d + ".")]
            past += [(str(file.relative_to(HOUSE)), module) for d in inside if module not in doors]
    assert past == []


def test_no_file_tells_of_working_arrangements() -> None:
    told = []
    for file in (f for f in tracked() if f.suffix not in (".png", ".jpg", ".npz")):
        told += [(str(file.relative_to(HOUSE)), m[0]) for m in ARRANGEMENTS.finditer(file.read_text())]
    assert told == []


def test_the_packages_daemon_and_drivers_are_facetd_s_alone() -> None:
    """Another distribution that installs a `daemon` (python-daemon does) would silently win, or merge."""
    owners = packages_distributions()
    assert set(owners["daemon"]) == {"facetd"}
    assert set(owners["drivers"]) == {"facetd"}


def replaced() -> Iterator[tuple[str, str]]:
    """The names in strings that tests, fakes and benches replace, which mypy does not see, and the files that do:
    "daemon.a.b"; and "b" with an `a` that was imported."""
    for path in HOUSE.glob("tests/**/*.py"):
        if not REPLACES.search(text := path.read_text(encoding="utf-8")):
            continue
        nodes = list(ast.walk(ast.parse(text)))
        imports = [node for node in nodes if isinstance(node, ast.ImportFrom)]
        imported = {one.asname or one.name: f"{node.module}.{one.name}" for node in imports for one in node.names}
        for node in nodes:
            match node:
                case ast.Constant(value=str(name)) if DOTTED.fullmatch(name):
                    yield name, str(path.relative_to(HOUSE))
                case ast.Call(
                    func=ast.Attribute(attr="setattr" | "delattr" | "object"),
                    args=[ast.Name(id=owner), ast.Constant(value=str(name)), *_],
                    keywords=[],
                ) if DOTTED.fullmatch(imported.get(owner, "")):
                    yield f"{imported[owner]}.{name}", str(path.relative_to(HOUSE))


def test_every_name_that_is_replaced_by_a_string_is_there() -> None:
    """Most tests that replace one would fail; those that seldom run, and benches, would be noticed by whoever runs them
    next."""
    gone, found = [], 0
    for name, file in replaced():
        found += 1
        try:
            pkgutil.resolve_name(name)
        except (AttributeError, ImportError):
            gone.append(f"{file}: {name}")
    assert gone == []
    assert found > 100


def test_every_component_that_the_ablation_leaves_out_is_there() -> None:
    gone = {name for name, without in ablation.COMPONENTS.items() if not hasattr(without.module, without.name)}
    assert gone == set()


def test_both_commands_lead_into_the_house() -> None:
    scripts = {e.name: e.value for e in entry_points(group="console_scripts") if e.name.startswith("facet")}
    assert scripts == {"facetd": "daemon.main:main", "facetctl": "daemon.ctl:main"}


def test_pictures_are_worked_on_in_one_thread() -> None:
    """Of a few hundred pixels each way they are done before a second thread is awake; its core is the cell's."""
    bare = {name: value for name, value in os.environ.items() if not name.endswith(("_NUM_THREADS", "_THREADS_NUM"))}
    ask = [sys.executable, "-c", "import daemon, cv2; print(cv2.getNumThreads())"]
    said = subprocess.run(ask, cwd=HOUSE, env=bare, capture_output=True, text=True, check=True)
    assert said.stdout == "1\n"


def test_each_wrong_known_by_name_can_still_be_put_where_it_was_found() -> None:
    for wrong in yaml.safe_load((HOUSE / "tests/bench/data/mutations.yaml").read_text(encoding="utf-8")):
        assert wrong["before"] in (HOUSE / wrong["file"]).read_text(encoding="utf-8"), wrong["what"]
        assert (HOUSE / wrong["tests"]).exists(), wrong["what"]


def test_the_mutation_bench_names_files_and_tests_that_exist() -> None:
    named = [*mutations.FILES, *(tests for of_package in mutations.WHOLE.values() for tests in of_package)]
    assert [name for name in named if not (HOUSE / name).exists()] == []
