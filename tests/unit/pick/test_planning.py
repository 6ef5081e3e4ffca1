"""What is decided before anything moves cannot move anything."""

import inspect
import pkgutil
from collections.abc import Iterator
from importlib import import_module
from types import ModuleType

import pytest

from daemon.arm import Mover
from daemon.pick import grippers, planning


def awaited(value: object) -> Iterator[str]:
    """The coroutine functions of a value: itself, or its methods."""
    methods = vars(value).values() if inspect.isclass(value) else [value]
    yield from (m.__qualname__ for m in methods if inspect.iscoroutinefunction(m))


MODULES = [
    import_module(f"{package.__name__}.{found.name}")
    for package in (planning, grippers)
    for found in pkgutil.iter_modules(package.__path__)
]


@pytest.mark.parametrize("module", MODULES, ids=lambda module: str(module.__name__))
def test_nothing_that_a_plan_is_made_with_moves_the_arm_or_waits(module: ModuleType) -> None:
    assert [name for value in vars(module).values() for name in awaited(value)] == []


def test_the_mover_would_be_noticed() -> None:
    assert list(awaited(Mover))
