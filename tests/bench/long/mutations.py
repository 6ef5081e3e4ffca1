"""Small wrongs put into what keeps the arm from surprising, one at a time: does a test notice each?

usage: python -m tests.bench.long.mutations [--count N] [--seed N] [--workers N] [--minutes N] [--only WORD]
                                            [--each TEXT] [--named]

Each mutation is made in a copy of the tree; first the file's own tests run (by layout), then all of its room's and
the daemon as a whole. One that no test notices is printed with its line. --only: files whose path holds the word;
--each: the mutations whose description holds the text, all of them instead of a sample.
"""

from __future__ import annotations

import argparse
import ast
import copy
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from queue import SimpleQueue

import yaml

ROOT = Path(__file__).resolve().parents[3]
FILES = (
    *(f"daemon/arm/{name}.py" for name in ("guard", "mover", "supervisor", "sweep", "route", "body")),
    *(f"drivers/val2/{name}.py" for name in ("link", "wire", "session", "conversation")),
)
DAEMON = (
    *("tests/unit/pick/test_cycle_stops.py", "tests/unit/pick/test_take.py"),
    *("tests/unit/service/test_surprises_found.py", "tests/unit/service/test_whole_daemon.py"),
)
WHOLE = {"arm": ("tests/unit/arm", *DAEMON), "val2": ("tests/unit/val2", "tests/unit/cell", *DAEMON)}
"""What runs, by room, where the file's own tests notice nothing."""
TOLD = "not the_property_notices"
"""Tests of a test take a rule away themselves, and notice no other wrong."""
STEPS = "1000"
"""Of the whole daemon's random ones."""
LONGEST_S = 900.0
"""Tests that take longer are taken to hang, and a hang is noticed."""
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


def sample(count: int, seed: int, only: str = "", text: str = "") -> list[Mutation]:
    """So many of all there are, each kind as often as the others while it lasts, in a random order: the first of them
    are a sample as well."""
    every = [m for file in FILES if only in file for m in mutations(file) if text in str(m)]
    kinds: dict[str, list[Mutation]] = {}
    for mutation in {m.source: m for m in every}.values():
        kinds.setdefault(mutation.kind, []).append(mutation)
    rng = random.Random(seed)
    for of_kind in kinds.values():
        rng.shuffle(of_kind)
    rounds = [mutation for one_each in zip_longest(*kinds.values()) for mutation in one_each if mutation is not None]
    return rounds if text else rounds[:count]


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


def noticed(mutation: Mutation, tree: Path, own: Sequence[str], whole: Sequence[str]) -> str:
    """Which tests noticed it: its own, the whole, or "" for none."""
    file = tree / mutation.file
    original = file.read_text(encoding="utf-8")
    file.write_text(mutation.source, encoding="utf-8")
    try:
        if own and not _pass(tree, own):
            return "own"
        return "" if not whole or _pass(tree, whole) else "whole"
    finally:
        file.write_text(original, encoding="utf-8")


def _pass(tree: Path, tests: Sequence[str]) -> bool:
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", "-n", "2", "-k", TOLD, *tests]
    environment = {**os.environ, "PYTHONPATH": str(tree), "PYTHONDONTWRITEBYTECODE": "1", "FACETD_STEPS": STEPS}
    try:
        done = subprocess.run(command, cwd=tree, env=environment, capture_output=True, timeout=LONGEST_S, check=False)
    except subprocess.TimeoutExpired:
        return False
    return done.returncode == 0


Chosen = tuple[Mutation, Sequence[str], Sequence[str]]
"""A mutation, the tests of its own, and those that run where they notice nothing."""


def run(chosen: Sequence[Chosen], workers: int, most_s: float) -> dict[str, list[Mutation]]:
    """{"own" | "whole" | "": mutations}, as far as time allows."""
    found: dict[str, list[Mutation]] = {"own": [], "whole": [], "": []}
    until_s = time.monotonic() + most_s
    trees: SimpleQueue[Path] = SimpleQueue()
    with tempfile.TemporaryDirectory(prefix="facetd-mutations-") as folder:
        for k in range(workers):
            tree = Path(folder) / str(k)
            left_out = shutil.ignore_patterns(".git", ".venv", "__pycache__", ".hypothesis", ".mypy_cache")
            shutil.copytree(ROOT, tree, ignore=left_out)
            trees.put(tree)

        every = sorted({name for _, own, whole in chosen for name in (*own, *whole)})
        assert _pass(Path(folder) / "0", every), "the tests fail as it is: they would notice anything"

        def one(each: Chosen) -> None:
            mutation = each[0]
            if time.monotonic() > until_s:
                return
            tree = trees.get()
            try:
                by = noticed(mutation, tree, *each[1:])
            finally:
                trees.put(tree)
            found[by].append(mutation)
            print(f"{by or 'LIVES':6} {mutation}", flush=True)

        with ThreadPoolExecutor(workers) as pool:
            list(pool.map(one, chosen))
    return found


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench.long.mutations")
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--seed", type=int, default=14)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--minutes", type=float, default=10_000)
    parser.add_argument("--only", default="")
    parser.add_argument("--each", default="")
    parser.add_argument("--named", action="store_true", help="only those that nobody noticed once")
    args = parser.parse_args()
    chosen: list[Chosen] = [(mutation, [tests], ()) for mutation, tests in named() if args.named]
    if not args.named:
        picked = sample(args.count, args.seed, args.only, args.each)
        chosen = [(m, own_tests(m.file), WHOLE[Path(m.file).parent.name]) for m in picked]
    found = run(chosen, args.workers, 60 * args.minutes)
    tried = sum(map(len, found.values()))
    lives = len(found[""])
    print(f"{tried} mutations of {len(chosen)} chosen: {len(found['own'])} noticed by their file's own tests, "
          f"{len(found['whole'])} by others, {lives} live ({100 * lives / max(tried, 1):.1f} %)")  # fmt: skip


if __name__ == "__main__":
    main()
