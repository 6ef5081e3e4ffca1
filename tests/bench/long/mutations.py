"""Small wrongs put into what keeps the arm from surprising, or into files and frontends: does a test notice each?

usage: python -m tests.bench.long.mutations [--count N] [--seed N] [--only TEXT] [--each TEXT] [--named]
                                            [--rooms ROOM ...] [--from N] [--kept FILE]

All tests are run once as they are: how long each takes, and which functions it runs; but for those of the whole daemon,
which take long and run nearly all. Each mutation of a function is then made in what is loaded, in a process forked for
it, and the tests that run the function are tried, the quickest first, up to the first that fails, and those of the
whole daemon where none does. One of a module's value or a class's default is made in the file as it is imported,
in a process forked before anything was: all tests run there, those that run something of the file first. One that no
test notices is printed with its line. --rooms: arm, val2, pick and calibration unless said otherwise; --only: those of
the sample whose description (`file:line: kind: text`) holds the text; --each: all there are whose description does,
instead of a sample; --from: the sample without its first so many; --kept: what is known of each test, and what became
of each mutation, is added to this file. A mutation that was noticed is not tried again; a test is run again once its
own file, or one that it runs something of, has changed: functions may have other names now.

A comparison of counts (an int literal, len(), a range, count ...) changes at its boundary, `<` to `<=`. One of measured
floats is negated instead: their equality never comes about, so that no test could notice its boundary.
"""

from __future__ import annotations

import argparse
import ast
import copy
import gc
import hashlib
import importlib
import inspect
import json
import multiprocessing
import os
import random
import re
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Container, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import _lru_cache_wrapper, cache, partial
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import spec_from_file_location
from itertools import zip_longest
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from types import CodeType, FrameType, FunctionType, ModuleType
from typing import Any

import pytest
import yaml

FORK = multiprocessing.get_context("fork")
ROOT = Path(__file__).resolve().parents[3]
SAFETY = ("arm", "val2", "pick", "calibration")
"""Rooms whose every file is tried, and by the tests of the room alone (but for what the manual says of settings)."""
FILES = (
    *(str(path.relative_to(ROOT)) for room in SAFETY for path in sorted(ROOT.glob(f"d*/{room}/**/*.py"))),
    *(f"daemon/store/{name}.py" for name in (
        "outside", "recovery_state", "runs", "runlog", "files", "npz", "pictures", "model_store", "yamlfile")),
    *(f"daemon/events/{name}.py" for name in ("records", "outcomes", "upgrade")),
    *(f"daemon/frontends/{name}.py" for name in ("socket_server", "rights", "command_queue", "client", "line_editor")),
    *(f"daemon/review/{name}.py" for name in ("digest", "page", "pagedata", "replay", "export", "failure_causes")),
)  # fmt: skip
STORIES = "tests/unit/service/"
"""Whose tests live with the whole daemon: most of it runs in each."""
ALL = frozenset({("", "")})
"""What a test runs that nobody looked at: whatever there is."""
CODE = (f"{ROOT}/daemon/", f"{ROOT}/drivers/")
SETTINGS = "tests/unit/test_manuals.py"
"""Holds defaults and ranges of all rooms' settings against the manual."""
WHOLE = {
    **{room: (f"tests/unit/{room}", SETTINGS) for room in SAFETY},
    "val2": ("tests/unit/val2", SETTINGS, "tests/unit/cell"),  # how a controller is identified is told there
    "store": ("tests/unit/store", "tests/unit/test_config.py", "tests/unit/test_hostile.py"),
    "frontends": ("tests/unit/frontends", "tests/unit/console"),
    "events": ("tests/unit/events", "tests/unit/review", "tests/unit/store"),
    "review": ("tests/unit/review", "tests/unit/store/test_records.py", "tests/unit/store/test_bombs.py"),
}
"""What runs, by room, where the file's own tests notice nothing."""
TOLD = "not the_property_notices"
"""Tests of a test take a rule away themselves, and notice no other wrong."""
STEPS = "1000"
"""Of the whole daemon's random ones."""
AT_ONCE = 2
LONGEST, LEAST_S = 30.0, 120.0
"""A test that takes so many times as long as without a wrong, and not less than this, is taken to hang; a hang is
noticed."""
ANEW_S = 3600.0
"""All tests together, where nobody knows yet how long each takes."""
NAMED = ROOT / "tests/bench/data/mutations.yaml"
OTHER_WAY = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In,
}  # fmt: skip
TURNED = {ast.Lt: ast.Gt, ast.LtE: ast.GtE, ast.Gt: ast.Lt, ast.GtE: ast.LtE}
NEGATED = {ast.Lt: ast.GtE, ast.LtE: ast.Gt, ast.Gt: ast.LtE, ast.GtE: ast.Lt}
COUNTS = frozenset({"len", "range", "count", "int", "round", "ord", "bit_count", "count_nonzero", "randrange"})
"""Functions and methods that give whole numbers."""
COUNTED = frozenset({"ndim", "size"})
MEASURED = re.compile(r"_(s|ms|mm|m|px|deg|rad|pct|g|n)$")
"""Of a name: the unit of what was measured."""


@dataclass(frozen=True)
class Mutation:
    """One wrong: the file, its line, what was made of what, and the whole file with it."""

    file: str
    line: int
    kind: str
    text: str
    source: str

    def __str__(self) -> str:
        return f"{self.file}:{self.line}: {self.kind}: {self.text}"


Change = tuple[int, str, str, Callable[[], None], Callable[[], None]]
"""Line, kind, description, and how to make and unmake it in the tree."""


def mutations(file: str) -> Iterator[Mutation]:
    """Every mutation of a file there is."""
    tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))
    for line, kind, text, make, unmake in _changes(tree):
        make()
        yield Mutation(file, line, kind, text, ast.unparse(tree))
        unmake()


def _changes(tree: ast.Module) -> Iterator[Change]:
    left_over = set(_left_over(tree))
    for function in _functions(tree):
        for node in [node for node in ast.walk(function) if node not in left_over]:
            yield from _of_expression(node)
        yield from _of_body(function)
    for body in (tree.body, *(c.body for c in ast.walk(tree) if isinstance(c, ast.ClassDef))):
        for statement in body:
            if isinstance(statement, ast.Assign | ast.AnnAssign) and statement.value is not None:
                for node in ast.walk(statement.value):
                    yield from _of_expression(node)


def _left_over(tree: ast.Module) -> Iterator[ast.AST]:
    """The 1 of each -1 that reshape is given: numpy takes any number below zero for what is left over."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and ast.unparse(node.func).endswith("reshape"):
            for part in (part for given in node.args for part in ast.walk(given)):
                if isinstance(part, ast.UnaryOp) and isinstance(part.op, ast.USub):
                    yield part.operand


def _functions(tree: ast.Module) -> Iterator[ast.FunctionDef | ast.AsyncFunctionDef]:
    """Functions and methods with something in them; those of a protocol hold only their docstring, those that each kind
    of a thing must have say that they are missing."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            work = _work(node.body)
            if work and ast.unparse(work[0]) != "raise NotImplementedError":
                yield node


def _work(body: Sequence[ast.stmt]) -> list[ast.stmt]:
    """What is done; docstrings are not."""
    return [s for s in body if not (isinstance(s, ast.Expr) and isinstance(s.value, ast.Constant))]


def _of_expression(node: ast.AST) -> Iterator[Change]:
    if isinstance(node, ast.Compare) and len(node.ops) >= 1:
        for k, op in enumerate(node.ops):
            sides = (node.left, *node.comparators)[k : k + 2]
            whole = type(op) not in TURNED or _counts(sides)
            for table, kind in ((OTHER_WAY, "flipped"), (TURNED, "turned")) if whole else ((NEGATED, "negated"),):
                if type(op) in table:
                    yield _swapped(node, kind, node.ops, k, table[type(op)]())
    elif isinstance(node, ast.BoolOp):
        other = ast.Or() if isinstance(node.op, ast.And) else ast.And()
        yield _attribute(node, "and/or", "op", other)
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
        yield _attribute(node, "not dropped", "op", ast.UAdd(), shown=node.operand)
    elif isinstance(node, ast.Constant) and isinstance(node.value, bool | int | float):
        yield _attribute(node, "constant", "value", _other(node.value))


def _counts(sides: Sequence[ast.expr]) -> bool:
    """Whether what is compared are whole numbers, as far as their words say."""
    parts = [part for side in sides for part in ast.walk(side)]
    names = {n for part in parts for n in (getattr(part, "id", ""), getattr(part, "attr", "")) if n}
    if any(MEASURED.search(name.lower()) for name in names):
        return False
    if any(isinstance(p, ast.Div) or (isinstance(p, ast.Constant) and isinstance(p.value, float)) for p in parts):
        return False
    literal = any(isinstance(p, ast.Constant) and isinstance(p.value, int) and p in sides for p in parts)
    one_of_shape = any(isinstance(p, ast.Subscript) and getattr(p.value, "attr", "") == "shape" for p in parts)
    return literal or one_of_shape or not names.isdisjoint(COUNTS | COUNTED)


def _other(value: bool | int | float) -> bool | int | float:
    """Small numbers grow by one, others halve."""
    if isinstance(value, bool):
        return not value
    return value + 1 if value < 2 else value // 2 if isinstance(value, int) else value / 2


def _swapped(node: ast.Compare, kind: str, ops: list[ast.cmpop], k: int, op: ast.cmpop) -> Change:
    before, old = ast.unparse(node), ops[k]
    ops[k] = op
    after = ast.unparse(node)
    ops[k] = old
    return node.lineno, kind, f"{before} -> {after}", lambda: ops.__setitem__(k, op), lambda: ops.__setitem__(k, old)


def _attribute(node: ast.expr, kind: str, name: str, value: object, shown: ast.expr | None = None) -> Change:
    old, before = getattr(node, name), ast.unparse(node)
    changed = copy.deepcopy(node)
    setattr(changed, name, value)
    after = ast.unparse(shown or changed)
    if kind == "not dropped":
        value, name = ast.Not(), "op"
        operand = node.operand  # type: ignore[attr-defined]
        return (node.lineno, kind, f"{before} -> {after}",
                lambda: setattr(node, "operand", ast.UnaryOp(ast.Not(), operand)),
                lambda: setattr(node, "operand", operand))  # fmt: skip
    return (
        node.lineno,
        kind,
        f"{before} -> {after}",
        lambda: setattr(node, name, value),
        lambda: setattr(node, name, old),
    )


def _of_body(function: ast.FunctionDef | ast.AsyncFunctionDef) -> Iterator[Change]:
    """Each statement removed; and, where the function gives nothing, an end before it."""
    gives = any(isinstance(n, ast.Return) and n.value is not None for n in ast.walk(function))
    for body in _bodies(function):
        for statement in _work(body):
            place = body.index(statement)
            if isinstance(
                statement, ast.Expr | ast.Assign | ast.AugAssign | ast.Raise | ast.If | ast.Return | ast.Delete
            ):
                yield _replaced(body, place, [ast.Pass()], "removed", statement)
            if not gives and place > 0 and not isinstance(statement, ast.Return):
                yield _replaced(body, place, [ast.Return(None), statement], "early return", statement)


def _bodies(function: ast.FunctionDef | ast.AsyncFunctionDef) -> Iterator[list[ast.stmt]]:
    for node in ast.walk(function):
        for name in ("body", "orelse", "finalbody"):
            body = getattr(node, name, None)
            if isinstance(body, list) and body and isinstance(body[0], ast.stmt):
                yield body


def _replaced(body: list[ast.stmt], place: int, new: list[ast.stmt], kind: str, statement: ast.stmt) -> Change:
    old, text = list(body), ast.unparse(statement).splitlines()[0]

    def make() -> None:
        body[place : place + 1] = new

    def unmake() -> None:
        body[:] = old

    return statement.lineno, kind, text, make, unmake


def room_of(file: str) -> str:
    """The room of a file: daemon/<room>/..., drivers/<room>/..."""
    return Path(file).parts[1]


def every(rooms: Container[str]) -> list[Mutation]:
    """All there are in some rooms."""
    files = [file for file in FILES if room_of(file) in rooms]
    return list({m.source: m for file in files for m in mutations(file)}.values())


def sample(mutations: Iterable[Mutation], count: int, seed: int) -> list[Mutation]:
    """So many of them, each kind as often as the others while it lasts, in a random order: the first of them
    are a sample as well."""
    kinds: dict[str, list[Mutation]] = {}
    for mutation in mutations:
        kinds.setdefault(mutation.kind, []).append(mutation)
    rng = random.Random(seed)
    for of_kind in kinds.values():
        rng.shuffle(of_kind)
    rounds = [mutation for one_each in zip_longest(*kinds.values()) for mutation in one_each if mutation is not None]
    return rounds[:count]


def named() -> list[tuple[Mutation, str]]:
    """The wrongs known by name, each with the tests that must notice it."""
    found = []
    for wrong in yaml.safe_load(NAMED.read_text(encoding="utf-8")):
        what, file, before = wrong["what"], wrong["file"], wrong["before"]
        text = (ROOT / file).read_text(encoding="utf-8")
        assert before in text, f"{what}: {file} no longer reads {before!r}"
        line = text[: text.index(before)].count("\n") + 1
        found.append((Mutation(file, line, "named", what, text.replace(before, wrong["after"], 1)), wrong["tests"]))
    return found


def own_tests(file: str) -> list[str]:
    """The tests of a file by layout: tests/unit/<room>/test_<file>*.py."""
    room, name = room_of(file), Path(file).stem
    return sorted(str(path.relative_to(ROOT)) for path in (ROOT / "tests/unit" / room).glob(f"test_{name}*.py"))


@dataclass(eq=False)
class Watch:
    """A plugin of pytest: collects the tests once, and then runs `then` with them instead of one after the other."""

    then: Callable[[list[pytest.Item]], None]
    told: Callable[[pytest.TestReport], None] = lambda _: None

    def pytest_configure(self) -> None:
        """Properties try the same examples each time, and need not say why they failed."""
        from hypothesis import Phase, settings  # not before pytest has asked for it

        settings.register_profile("quick", phases=[Phase.explicit, Phase.generate], database=None, derandomize=True)
        settings.load_profile("quick")

    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """In place of pytest's own."""
        assert not session.testsfailed, "a file of tests cannot be imported"
        gc.unfreeze()  # what tests/conftest.py froze is not found by gc.get_objects
        self.then(session.items)
        return True

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Each of the three parts of a test: set up, called, taken down."""
        self.told(report)


@dataclass(frozen=True)
class Known:
    """What a test does without any wrong: how long it takes, s, and which functions (file, qualified name) it runs."""

    took_s: float
    runs: frozenset[tuple[str, str]]


def digest_of(nodeid: str, known: Known) -> str:
    """Of the text of the file of a test, and of those that it runs something of."""
    files = {nodeid.partition("::")[0], *(file for file, _ in known.runs)} - {""}
    digest = hashlib.sha256()
    for path in [ROOT / file for file in sorted(files)]:
        digest.update(_content(path) if path.exists() else b"")
    return digest.hexdigest()[:16]


@cache
def _content(path: Path) -> bytes:
    return hashlib.sha256(path.read_bytes()).digest()


def _forked(work: Callable[[Connection], None]) -> tuple[Connection, BaseProcess]:
    """A process like this one, its end of a pipe given to `work`; what it prints is nobody's."""
    mine, its = FORK.Pipe(duplex=False)

    def inside() -> None:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, 1)
        os.dup2(nowhere, 2)
        work(its)

    process = FORK.Process(target=inside)
    process.start()
    its.close()
    return mine, process


Found = tuple[str, str, str]
"""A mutation's description, "own", "others" or "LIVES", and which test noticed it."""


@dataclass(frozen=True)
class Kept:
    """What earlier runs found, each line of the file a test or a mutation; None: nobody wants to know."""

    file: Path | None

    def tests(self) -> dict[str, Known | None]:
        """None of a test that fails without any wrong. Only of those whose files are as they were then."""
        found = {}
        for nodeid, took_s, runs, digest in self._lines("test"):
            known = Known(took_s or 0.0, frozenset((file, name) for file, name in runs))
            if digest == digest_of(nodeid, known):
                found[nodeid] = None if took_s is None else known
        return found

    def mutations(self) -> list[Found]:
        """What became of each."""
        return [(text, by, test) for text, by, test in self._lines("mutation")]

    def add(self, kind: str, *values: object) -> None:
        """One more."""
        if self.file is not None:
            with self.file.open("a", encoding="utf-8") as lines:
                lines.write(json.dumps([kind, *values]) + "\n")

    def _lines(self, kind: str) -> list[list[Any]]:
        if self.file is None or not self.file.exists():
            return []
        lines = [json.loads(line) for line in self.file.read_text(encoding="utf-8").splitlines()]
        return [values for first, *values in lines if first == kind]


@dataclass(eq=False)
class Trial:
    """Of one mutation: where it is, until when that may take, and what noticed the mutation ("": nothing), once that is
    known."""

    mutation: Mutation
    process: BaseProcess
    until_s: float
    at: str = "putting it in"
    by: str | None = None


class Trials:
    """Tests of a mutation, each mutation in a process forked from this one, where all is imported and collected."""

    def __init__(self, watch: Watch, items: Sequence[pytest.Item], known: dict[str, Known]) -> None:
        self.watch, self.items, self.known = watch, {item.nodeid: item for item in items}, known

    def learn(self, answer: Connection, but: Container[str]) -> None:
        """Run every test as it is but for some, and say of each its id, whether it fails, what is known of it."""
        took_s, failed, runs = 0.0, False, set[tuple[str, str]]()

        def told(report: pytest.TestReport) -> None:
            nonlocal took_s, failed
            took_s, failed = took_s + report.duration, failed or report.failed

        def called(frame: FrameType, *_: object) -> None:
            code = frame.f_code
            runs.add((code.co_filename, code.co_qualname))

        self.watch.told, caches = told, _caches()
        for nodeid, item in [(nodeid, item) for nodeid, item in self.items.items() if nodeid not in but]:
            took_s, failed, traced = 0.0, False, not nodeid.startswith(STORIES)
            runs.clear()
            _forget(caches)
            if traced:
                sys.settrace(called)
                threading.settrace(called)
            item.ihook.pytest_runtest_protocol(item=item, nextitem=None)
            sys.settrace(None)
            threading.settrace(None)
            ours = frozenset((path.removeprefix(f"{ROOT}/"), name) for path, name in runs if path.startswith(CODE))
            answer.send((nodeid, failed, Known(took_s, ours if traced else ALL)))

    def noticed(self, mutations: Iterable[Mutation]) -> Iterator[tuple[Mutation, str]]:
        """Which test notices each, "" where none does: of those that run its function, the quickest first. Some are
        tried beside each other, as most tests wait for a clock."""
        left, tried = deque(mutations), dict[Connection, Trial]()
        while left or tried:
            while left and len(tried) < AT_ONCE:
                mutation = left.popleft()
                assert loaded(mutation), f"nothing to put it into, so that it would seem to live: {mutation}"
                mine, process = _forked(partial(self._tried, mutation, self._those_of(mutation)))
                tried[mine] = Trial(mutation, process, time.monotonic() + LEAST_S)
            for ready in wait(list(tried), 1.0):
                assert isinstance(ready, Connection)
                mine = ready
                self._hear(mine, tried[mine])
            for mine, trial in list(tried.items()):
                if trial.by is None and time.monotonic() > trial.until_s:
                    trial.by = f"{trial.at} hangs"
                if trial.by is not None:
                    trial.process.kill()
                    trial.process.join()
                    del tried[mine]
                    yield trial.mutation, trial.by

    def _hear(self, mine: Connection, trial: Trial) -> None:
        try:
            kind, told = mine.recv()
        except EOFError:
            trial.by = f"{trial.at} ends the process"
            return
        if kind == "begins":
            trial.at = told
            trial.until_s = time.monotonic() + max(LEAST_S, LONGEST * self.known[told].took_s)
        else:
            trial.by = told

    def _those_of(self, mutation: Mutation) -> list[str]:
        names = {(mutation.file, name) for name in changed(mutation)} | ALL
        those = [nodeid for nodeid, known in self.known.items() if nodeid in self.items and names & known.runs]
        return sorted(those, key=lambda nodeid: (self.known[nodeid].runs == ALL, self.known[nodeid].took_s))

    def _tried(self, mutation: Mutation, those: Sequence[str], answer: Connection) -> None:
        def told(report: pytest.TestReport) -> None:
            if report.failed:
                answer.send(("failed", report.nodeid))
                os._exit(0)

        self.watch.told = told
        put_in(mutation)
        for nodeid in those:
            answer.send(("begins", nodeid))
            self.items[nodeid].ihook.pytest_runtest_protocol(item=self.items[nodeid], nextitem=None)
        answer.send(("none", ""))


def _functions_of(tree: ast.Module) -> dict[str, ast.FunctionDef | ast.AsyncFunctionDef]:
    """Functions and methods by qualified name."""
    found = {}
    owners: list[ast.Module | ast.ClassDef] = [tree, *(c for c in tree.body if isinstance(c, ast.ClassDef))]
    for owner in owners:
        prefix = "" if isinstance(owner, ast.Module) else f"{owner.name}."
        found |= {prefix + f.name: f for f in owner.body if isinstance(f, ast.FunctionDef | ast.AsyncFunctionDef)}
    return found


def _both(mutation: Mutation) -> tuple[ast.Module, ast.Module]:
    """The file as it is, and with the wrong."""
    return ast.parse((ROOT / mutation.file).read_text(encoding="utf-8")), ast.parse(mutation.source)


def changed(mutation: Mutation) -> set[str]:
    """The qualified names of the functions it changes; none where it is in no function."""
    old, new = (_functions_of(tree) for tree in _both(mutation))
    return {name for name in old if ast.dump(old[name]) != ast.dump(new[name])}


def put_in(mutation: Mutation) -> None:
    """Change what is loaded: the code and the defaults of functions, wherever they are known."""
    module, (_, new) = importlib.import_module(_module(mutation.file)), _both(mutation)
    codes = dict(_codes(compile(new, str(ROOT / mutation.file), "exec")))
    for function in loaded(mutation):
        name = function.__code__.co_qualname
        given = _functions_of(new)[name].args
        function.__code__ = codes[name]
        function.__defaults__ = tuple(_value(d, module) for d in given.defaults) or None
        by_name = {a.arg: d for a, d in zip(given.kwonlyargs, given.kw_defaults, strict=True) if d is not None}
        function.__kwdefaults__ = {key: _value(d, module) for key, d in by_name.items()} or None
    _forget(_caches())


def loaded(mutation: Mutation) -> list[FunctionType]:
    """The functions that it changes, as they are loaded."""
    importlib.import_module(_module(mutation.file))
    path, names = str(ROOT / mutation.file), changed(mutation)
    every = [found for found in gc.get_objects() if isinstance(found, FunctionType)]
    return [f for f in every if f.__code__.co_filename == path and f.__code__.co_qualname in names]


def _caches() -> list[Any]:
    """Functions of ours that keep what they gave: a test that is given that again does not run them."""
    kept = [found for found in gc.get_objects() if isinstance(found, _lru_cache_wrapper)]
    return [found for found in kept if isinstance(what := inspect.unwrap(found), FunctionType)
            and what.__code__.co_filename.startswith(CODE)]  # fmt: skip


def _forget(caches: Iterable[Any]) -> None:
    for kept in caches:
        kept.cache_clear()


def _module(file: str) -> str:
    return file.removesuffix(".py").replace("/", ".")


@dataclass(frozen=True)
class Imported(MetaPathFinder, Loader):
    """A mutation's file, found with the wrong in it by whoever imports it."""

    mutation: Mutation

    def find_spec(self, name: str, path: object = None, target: object = None) -> ModuleSpec | None:
        """See MetaPathFinder."""
        if name != _module(self.mutation.file):
            return None
        return spec_from_file_location(name, ROOT / self.mutation.file, loader=self)

    def exec_module(self, module: ModuleType) -> None:
        """See Loader."""
        exec(compile(self.mutation.source, str(module.__file__), "exec"), vars(module))


def learnt(tests: Sequence[str], kept: Kept) -> dict[str, Known]:
    """What is known of the tests, by their ids. One that fails would notice anything, and is left out. Only from a
    process that imported nothing of ours, and is to stay so."""
    found = kept.tests()

    def each(answer: Connection) -> None:
        watch = Watch(lambda items: Trials(watch, items, {}).learn(answer, found))
        _pytest(watch, tests)
        answer.send(None)

    mine, process = _forked(each)
    while (told := mine.recv()) is not None:
        nodeid, failed, known = told
        found[nodeid] = None if failed else known
        kept.add("test", nodeid, None if failed else known.took_s, sorted(known.runs), digest_of(nodeid, known))
    process.join()
    assert found, "the tests cannot be run: whatever is tried then seems to be noticed"
    for nodeid in [nodeid for nodeid, known in found.items() if known is None]:
        print(f"left out, fails without any wrong: {nodeid}", flush=True)
    sound = {nodeid: known for nodeid, known in found.items() if known is not None}
    print(f"{len(sound)} tests, {sum(known.took_s for known in sound.values()):.0f} s", flush=True)
    return sound


def noticed_anew(mutation: Mutation, tests: Sequence[str], known: dict[str, Known]) -> str:
    """Which of the tests notices a wrong that is there from the import on, "" where none does: those that run
    something of the file first, the quickest first. Only from a process that imported nothing of ours."""

    def order(item: pytest.Item) -> tuple[bool, bool, float]:
        of_it = known[item.nodeid]
        others = mutation.file not in {file for file, _ in of_it.runs}
        return of_it.runs == ALL, others, of_it.took_s

    def tried(answer: Connection) -> None:
        def told(report: pytest.TestReport) -> None:
            if report.failed:
                answer.send(report.nodeid)
                os._exit(0)

        def each(items: list[pytest.Item]) -> None:
            for item in sorted([item for item in items if item.nodeid in known], key=order):
                item.ihook.pytest_runtest_protocol(item=item, nextitem=None)
            answer.send("")

        sys.meta_path.insert(0, Imported(mutation))
        _pytest(Watch(each, told), tests)

    mine, process = _forked(tried)
    try:
        return str(mine.recv()) if mine.poll(ANEW_S) else "hangs"
    except EOFError:
        return "its tests cannot be imported"
    finally:
        process.kill()
        process.join()


def _pytest(watch: Watch, tests: Iterable[str]) -> None:
    os.environ |= {"FACETD_STEPS": STEPS}
    pytest.main(
        ["-s", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", "-o", "timeout=0", "-k", TOLD, *tests], [watch]
    )


def _value(expression: ast.expr, module: ModuleType) -> object:
    return eval(compile(ast.Expression(expression), str(module.__file__), "eval"), vars(module))


def _codes(code: CodeType) -> Iterator[tuple[str, CodeType]]:
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield constant.co_qualname, constant
            yield from _codes(constant)


def run(chosen: Sequence[Mutation], tests: Callable[[Mutation], Sequence[str]], kept: Kept) -> list[Found]:
    """What becomes of each, or became; tests: of a mutation, the file's own first."""
    of_these = {str(mutation) for mutation in chosen}
    found = [one for one in kept.mutations() if one[0] in of_these and one[1] != "LIVES"]
    chosen = [m for m in chosen if str(m) not in {text for text, _, _ in found}]

    def judged(mutation: Mutation, test: str) -> None:
        by = "LIVES" if not test else "own" if test.startswith(tuple(own_tests(mutation.file))) else "others"
        print(f"{by:6} {mutation}    {test}", flush=True)
        found.append((str(mutation), by, test))
        kept.add("mutation", *found[-1])

    those = sorted({test for mutation in chosen for test in tests(mutation)})
    known = learnt(those, kept) if those else {}
    in_functions = [mutation for mutation in chosen if changed(mutation)]

    def tried(answer: Connection) -> None:
        def each(items: list[pytest.Item]) -> None:
            for mutation, test in Trials(watch, items, known).noticed(in_functions):
                answer.send((in_functions.index(mutation), test))

        watch = Watch(each)
        _pytest(watch, those)
        answer.send(None)

    if in_functions:
        mine, process = _forked(tried)
        while (told := mine.recv()) is not None:
            judged(in_functions[told[0]], told[1])
        process.join()
    for mutation in [m for m in chosen if m not in in_functions]:
        judged(mutation, noticed_anew(mutation, tests(mutation), known))
    return found


def report(found: Sequence[Found], seconds: float) -> None:
    """Print the table by file."""
    print(f"{'':32} tried own others live")
    for file in (*FILES, ""):
        by = [by for text, by, _ in found if text.startswith(file)]
        if by:
            print(f"{file or 'all':32} {len(by):5} {by.count('own'):3} {by.count('others'):6} {by.count('LIVES'):4}"
                  f" ({100 * by.count('LIVES') / len(by):.1f} %)")  # fmt: skip
    print(f"{seconds:.0f} s")


def _those_of(mutation: Mutation) -> list[str]:
    """All tests that may notice it, the file's own first."""
    return [*own_tests(mutation.file), *WHOLE[room_of(mutation.file)]]


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench.long.mutations")
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--seed", type=int, default=14)
    parser.add_argument("--from", type=int, default=0, dest="skip")
    parser.add_argument("--rooms", nargs="+", default=SAFETY, choices=WHOLE)
    parser.add_argument("--only", default="")
    parser.add_argument("--each", default="")
    parser.add_argument("--kept", type=Path)
    parser.add_argument("--named", action="store_true", help="only those that nobody noticed once")
    args = parser.parse_args()
    began_s = time.monotonic()
    if args.named:
        by_name = dict(named())
        chosen = list(by_name)
    else:
        there_are = [m for m in every(args.rooms) if args.each in str(m)]
        picked = there_are if args.each else sample(there_are, args.count, args.seed)[args.skip :]
        chosen = [m for m in picked if args.only in str(m)]
        by_name = {}
    report(
        run(chosen, lambda m: [by_name[m]] if m in by_name else _those_of(m), Kept(args.kept)),
        time.monotonic() - began_s,
    )


if __name__ == "__main__":
    main()
