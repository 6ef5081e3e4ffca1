"""Small wrongs put into what keeps the arm from surprising, or into files and doors: does a test notice each?

usage: python -m tests.bench.long.mutations [--count N] [--seed N] [--workers N] [--only TEXT] [--each TEXT] [--named]
                                            [--rooms ROOM ...]

Each mutation is made in a copy of the tree; first the file's own tests run (by layout), then all of its room's (and of
the arm's the daemon as a whole), the quickest first, up to the first that fails. One that no test notices is printed
with its line. --rooms: arm and val2 unless said otherwise; --only: those of the sample whose description
(`file:line: kind: text`) holds the text; --each: all there are whose description does, instead of a sample.
"""

from __future__ import annotations

import argparse
import ast
import copy
import multiprocessing
import os
import random
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import zip_longest
from multiprocessing.connection import Connection
from pathlib import Path

import cv2  # noqa: F401  (what the tests import of others is loaded once, before each of their processes is forked)
import msgspec  # noqa: F401
import numpy as np  # noqa: F401
import pytest
import yaml

FORK = multiprocessing.get_context("fork")
ROOT = Path(__file__).resolve().parents[3]
FILES = (
    *(f"daemon/arm/{name}.py" for name in ("guard", "mover", "supervisor", "sweep", "route", "body")),
    *(f"drivers/val2/{name}.py" for name in ("link", "wire", "session", "conversation")),
    *(f"daemon/store/{name}.py" for name in (
        "outside", "standing", "records", "runs", "runlog", "files", "npz", "pictures", "model_store", "yamlfile")),
    *(f"daemon/doors/{name}.py" for name in ("socket", "rights", "turns", "client", "lineedit")),
    *(f"daemon/review/{name}.py" for name in ("digest", "page", "pagedata", "replay", "export", "why", "tables")),
)  # fmt: skip
DAEMON = (
    *("tests/unit/pick/test_cycle_stops.py", "tests/unit/pick/test_take.py"),
    *("tests/unit/service/test_surprises_found.py", "tests/unit/service/test_whole_daemon.py"),
)
WHOLE = {
    "arm": ("tests/unit/arm", *DAEMON),
    "val2": ("tests/unit/val2", "tests/unit/cell", *DAEMON),
    "store": ("tests/unit/store", "tests/unit/test_config.py", "tests/unit/test_hostile.py"),
    "doors": ("tests/unit/doors", "tests/unit/console"),
    "review": ("tests/unit/review", "tests/unit/store/test_records.py", "tests/unit/store/test_bombs.py"),
}
"""What runs, by room, where the file's own tests notice nothing."""
TOLD = "not the_property_notices"
"""Tests of a test take a rule away themselves, and notice no other wrong."""
STEPS = "1000"
"""Of the whole daemon's random ones."""
OURS = ("daemon", "drivers", "tests")
LONGEST, LEAST_S = 4.0, 60.0
"""Tests that take so many times as long as without a wrong, and not less than this, are taken to hang; a hang is
noticed."""
NAMED = ROOT / "tests/bench/data/mutations.yaml"
OTHER_WAY = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In,
}  # fmt: skip
TURNED = {ast.Lt: ast.Gt, ast.LtE: ast.GtE, ast.Gt: ast.Lt, ast.GtE: ast.LtE}


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
    for function in _functions(tree):
        for node in ast.walk(function):
            yield from _of_expression(node)
        yield from _of_body(function)
    for statement in tree.body:
        if isinstance(statement, ast.Assign | ast.AnnAssign) and statement.value is not None:
            for node in ast.walk(statement.value):
                yield from _of_expression(node)


def _functions(tree: ast.Module) -> Iterator[ast.FunctionDef | ast.AsyncFunctionDef]:
    """Functions and methods with something in them; those of a protocol hold only their docstring."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and _work(node.body):
            yield node


def _work(body: Sequence[ast.stmt]) -> list[ast.stmt]:
    """What is done; docstrings are not."""
    return [s for s in body if not (isinstance(s, ast.Expr) and isinstance(s.value, ast.Constant))]


def _of_expression(node: ast.AST) -> Iterator[Change]:
    if isinstance(node, ast.Compare) and len(node.ops) >= 1:
        for k, op in enumerate(node.ops):
            for table, kind in ((OTHER_WAY, "flipped"), (TURNED, "turned")):
                if type(op) in table:
                    yield _swapped(node, kind, node.ops, k, table[type(op)]())
    elif isinstance(node, ast.BoolOp):
        other = ast.Or() if isinstance(node.op, ast.And) else ast.And()
        yield _attribute(node, "and/or", "op", other)
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
        yield _attribute(node, "not dropped", "op", ast.UAdd(), shown=node.operand)
    elif isinstance(node, ast.Constant) and isinstance(node.value, bool | int | float):
        yield _attribute(node, "constant", "value", _other(node.value))


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
            if not gives and place > 0:
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


def every() -> list[Mutation]:
    """All there are."""
    return list({m.source: m for file in FILES for m in mutations(file)}.values())


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
    room, name = Path(file).parent.name, Path(file).stem
    return sorted(str(path.relative_to(ROOT)) for path in (ROOT / "tests/unit" / room).glob(f"test_{name}*.py"))


@dataclass(eq=False)
class Watch:
    """A plugin of pytest: the quickest tests first, how long each takes, which failed first; by no shortest example."""

    known_s: Mapping[str, float]
    took_s: dict[str, float] = field(default_factory=dict)
    failed: str = ""

    def pytest_configure(self) -> None:
        """Properties need not say why they failed."""
        from hypothesis import Phase, settings  # not before pytest has asked for it

        settings.register_profile("quick", phases=[Phase.explicit, Phase.generate], database=None)
        settings.load_profile("quick")

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """The quickest first; what is not known at the end."""
        items.sort(key=lambda item: self.known_s.get(item.nodeid, float("inf")))

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """How long it took, and whether it failed."""
        self.took_s[report.nodeid] = self.took_s.get(report.nodeid, 0.0) + report.duration
        if report.failed:
            self.failed = self.failed or report.nodeid

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        """A file that cannot even be imported."""
        if report.failed:
            self.failed = self.failed or report.nodeid


class Tests:
    """The tests of a tree, each time in a process of their own, forked from this one."""

    def __init__(self, tree: Path, known_s: Mapping[str, float]) -> None:
        self.tree, self.known_s = tree, known_s

    def run(self, tests: Sequence[str]) -> tuple[str, dict[str, float]]:
        """("" where all pass, else which failed first; what each took, s)."""
        mine, its = FORK.Pipe(duplex=False)
        process = FORK.Process(target=self._inside, args=(tests, its))
        process.start()
        its.close()
        longest_s = max(LEAST_S, LONGEST * sum(s for name, s in self.known_s.items() if name.startswith(tuple(tests))))
        told = mine.recv() if mine.poll(longest_s if self.known_s else None) else ("hangs", {})
        process.kill()
        process.join()
        failed, took_s = told
        return str(failed), dict(took_s)

    def _inside(self, tests: Sequence[str], answer: Connection) -> None:
        """Nothing of ours that is loaded already counts: all of it is imported from the tree."""
        try:
            os.chdir(self.tree)
            os.environ |= {"PYTHONPATH": str(self.tree), "FACETD_STEPS": STEPS}
            sys.path[:] = [str(self.tree), *(p for p in sys.path if Path(p).resolve() != ROOT)]
            for name in [name for name in sys.modules if name.partition(".")[0] in OURS]:
                del sys.modules[name]
            sys.stdout = sys.stderr = open(os.devnull, "w")  # noqa: SIM115
            watch = Watch(self.known_s)
            status = pytest.main(["-x", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", "-k", TOLD, *tests], [watch])
            answer.send((watch.failed or ("" if status == 0 else f"pytest ends with {status}"), watch.took_s))
        except BaseException as error:
            answer.send((f"{type(error).__name__}: {error}", {}))


Chosen = tuple[Mutation, Sequence[str], Sequence[str]]
"""A mutation, the tests of its own, and those that run where they notice nothing."""
Found = tuple[Mutation, str, str]
"""A mutation, "own", "others" or "LIVES", and which test noticed it."""


def copied(to: Path) -> Path:
    """The tree, to be spoiled."""
    left_out = shutil.ignore_patterns(".git", ".venv", "__pycache__", ".hypothesis", ".mypy_cache")
    shutil.copytree(ROOT, to, ignore=left_out)
    return to


def noticed(chosen: Chosen, tests: Tests) -> Found:
    """Which tests noticed it."""
    mutation, own, others = chosen
    file = tests.tree / mutation.file
    original = file.read_text(encoding="utf-8")
    file.write_text(mutation.source, encoding="utf-8")
    try:
        for by, those in (("own", own), ("others", others)):
            failed = tests.run(those)[0] if those else ""
            if failed:
                return mutation, by, failed
        return mutation, "LIVES", ""
    finally:
        file.write_text(original, encoding="utf-8")


def run(chosen: Sequence[Chosen], workers: int) -> list[Found]:
    """What became of each. A worker has a tree, and every so-manieth mutation."""
    # A wrong that is as long as what it replaces, in the same second, would be taken for the file compiled before.
    sys.dont_write_bytecode = True
    every_test = sorted({name for _, own, others in chosen for name in (*own, *others)})
    with tempfile.TemporaryDirectory(prefix="facetd-mutations-") as folder:
        failed, known_s = Tests(copied(Path(folder) / "whole"), {}).run(every_test)
        assert not failed, f"without any wrong {failed} fails: it would notice anything"
        queue = FORK.Queue()

        def work(k: int) -> None:
            tests = Tests(copied(Path(folder) / str(k)), known_s)
            for each in chosen[k::workers]:
                queue.put(noticed(each, tests))

        for k in range(workers):
            FORK.Process(target=work, args=(k,)).start()
        found = []
        for _ in chosen:
            mutation, by, test = queue.get()
            print(f"{by:6} {mutation}    {test}", flush=True)
            found.append((mutation, by, test))
    return found


def report(found: Sequence[Found], seconds: float) -> None:
    """Print the table by file."""
    print(f"{'':32} tried own others live")
    for file in (*FILES, ""):
        by = [by for mutation, by, _ in found if mutation.file.startswith(file)]
        if by:
            print(f"{file or 'all':32} {len(by):5} {by.count('own'):3} {by.count('others'):6} {by.count('LIVES'):4}"
                  f" ({100 * by.count('LIVES') / len(by):.1f} %)")  # fmt: skip
    print(f"{seconds:.0f} s")


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench.long.mutations")
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--seed", type=int, default=14)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--rooms", nargs="+", default=("arm", "val2"), choices=WHOLE)
    parser.add_argument("--only", default="")
    parser.add_argument("--each", default="")
    parser.add_argument("--named", action="store_true", help="only those that nobody noticed once")
    args = parser.parse_args()
    began_s = time.monotonic()
    chosen: list[Chosen] = [(mutation, [tests], ()) for mutation, tests in named() if args.named]
    if not args.named:
        there_are = [m for m in every() if Path(m.file).parent.name in args.rooms and args.each in str(m)]
        picked = there_are if args.each else sample(there_are, args.count, args.seed)
        picked = [m for m in picked if args.only in str(m)]
        chosen = [(m, own_tests(m.file), WHOLE[Path(m.file).parent.name]) for m in picked]
    report(run(chosen, args.workers), time.monotonic() - began_s)


if __name__ == "__main__":
    main()
