"""A worker process: what it computes comes back whole, and whatever becomes of it is one failed calculation."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import os
import signal
import subprocess
import sys
import time
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from daemon.compute.calls import ByReference, ComputeError
from daemon.compute.wire import LARGE_BYTES, SHARED_BYTES, SharedMemory, pickled, unpickled
from daemon.compute.worker import Worker
from daemon.errors import FacetdError
from tests.fakes.waiting import until_so
from tests.unit.compute import calculations
from tests.unit.compute.calculations import Big

HERE = str(Path(__file__).parents[3])


@pytest.fixture(autouse=True)
def _found_by_the_worker(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", HERE)


@contextlib.asynccontextmanager
async def a_worker(within_s: float = 60.0) -> AsyncIterator[Worker]:
    worker = Worker("the look", within_s)
    try:
        yield worker
    finally:
        worker.close()


def in_a_worker(story: Callable[[Worker], Any]) -> Any:
    async def told() -> Any:
        async with a_worker() as worker:
            return await story(worker)

    return asyncio.run(told())


def alive(pid: int) -> bool:
    """Whether a process is there and no corpse."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    except (FileNotFoundError, ProcessLookupError):  # gone, or gone between opening and reading
        return False


def test_what_is_computed_comes_back_and_so_does_what_it_raises() -> None:
    async def story(worker: Worker) -> None:
        assert await worker(calculations.double, 21) == 42
        with pytest.raises(FacetdError, match="no part is seen"):
            await worker(calculations.refuse)
        with pytest.raises(KeyError) as raised:
            await worker(calculations.bug)
        assert 'raise KeyError("label")' in raised.value.__notes__[0], "where it was raised is kept"
        assert await worker(os.getpid) == worker.pid, "what it raises ends no process"

    in_a_worker(story)


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        (calculations.kill_itself, "SIGKILL"),
        (calculations.exhaust, "out of memory"),
        (calculations.loop_for_ever, "longer than 1 s"),
    ],
)
def test_a_worker_that_is_killed_exhausted_or_never_done_is_one_failed_calculation(
    fault: Callable[[], Any], said: str
) -> None:
    async def story(worker: Worker) -> None:
        big = Big(np.ones(LARGE_BYTES, np.uint8))
        assert await worker(calculations.same, big) is big
        before, patience_s = worker.pid, worker.within_s
        worker.within_s = 1.0 if fault is calculations.loop_for_ever else patience_s
        with pytest.raises(ComputeError, match=said):
            await worker(fault)
        worker.within_s = patience_s
        assert worker.pid != before, "the next one has been started already"
        assert await worker(calculations.same, big) is big, "and what the last one had by number it gets again"
        await until_so(lambda: not alive(before))

    in_a_worker(story)


def test_a_calculation_that_asks_for_too_much_memory_takes_none_of_the_daemon_s() -> None:
    async def story(worker: Worker) -> None:
        with pytest.raises(ComputeError, match="out of memory"):
            await worker(calculations.allocate)
        assert await worker(calculations.double, 1) == 2

    in_a_worker(story)


def test_a_calculation_nobody_waits_for_any_more_ends_with_its_process() -> None:
    async def story(worker: Worker) -> None:
        assert await worker(calculations.double, 1) == 2
        before = worker.pid
        asking = asyncio.create_task(worker(calculations.loop_for_ever))
        await asyncio.sleep(0)
        asking.cancel()
        with pytest.raises(asyncio.CancelledError):
            await asking
        await until_so(lambda: not alive(before))
        assert await worker(calculations.double, 2) == 4

    in_a_worker(story)


def test_what_waits_for_its_turn_and_is_cancelled_ends_no_process() -> None:
    async def story(worker: Worker) -> None:
        first = asyncio.create_task(worker(time.sleep, 0.3))
        await asyncio.sleep(0)
        second = asyncio.create_task(worker(calculations.double, 1))
        await asyncio.sleep(0)
        before = worker.pid
        second.cancel()
        with pytest.raises(asyncio.CancelledError):
            await second
        await first
        assert worker.pid == before

    in_a_worker(story)


def test_the_loop_goes_on_while_a_worker_computes_for_ever() -> None:
    async def story(worker: Worker) -> int:
        await worker(calculations.double, 1)
        worker.within_s, beats = 2.0, 0
        asking = asyncio.create_task(worker(calculations.loop_for_ever))
        while not asking.done():
            await asyncio.sleep(0.01)
            beats += 1
        assert isinstance(asking.exception(), ComputeError)
        return beats

    assert in_a_worker(story) > 20


def test_a_value_by_reference_is_sent_once_and_let_go_of_when_the_daemon_does() -> None:
    async def story(worker: Worker) -> None:
        inner = Big(np.arange(LARGE_BYTES, dtype=np.uint8))
        outer = Big(np.zeros(3, np.uint8), inner)
        assert await worker(calculations.same, outer, [inner]) == (outer, [inner])
        assert await worker(calculations.same_inside, outer, inner), "one value is one there as well"
        sent = worker._process._held
        assert len(sent) == 2
        del outer
        gc.collect()
        assert await worker(calculations.double, 1) == 2
        assert len(sent) == 1, "the outer one is dropped"

    in_a_worker(story)


def test_a_value_sent_ahead_that_cannot_be_taken_in_fails_who_asks_for_it_and_nobody_else() -> None:
    async def story(worker: Worker) -> None:
        broken = calculations.Unreadable()
        worker.prepare(broken)
        assert await worker(calculations.double, 1) == 2
        with pytest.raises(FacetdError, match="cannot be read"):
            await worker(calculations.same, broken)

    in_a_worker(story)


def test_it_gives_way_to_the_daemon_and_hears_none_of_its_signals() -> None:
    async def story(worker: Worker) -> None:
        nice, score = await worker(calculations.manners)
        assert nice >= os.nice(0) + 1
        assert score > int(Path("/proc/self/oom_score_adj").read_text())
        assert worker.pid is not None
        for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
            os.kill(worker.pid, number)
        assert await worker(os.getpid) == worker.pid
        assert await worker(calculations.environment, "NOTIFY_SOCKET") is None

    os.environ["NOTIFY_SOCKET"] = "/run/nothing"
    try:
        in_a_worker(story)
    finally:
        del os.environ["NOTIFY_SOCKET"]


def test_a_worker_ends_with_its_daemon_even_amid_an_endless_loop() -> None:
    script = f"""
import asyncio, sys
sys.path.insert(0, {HERE!r})
from tests.unit.compute import calculations
from daemon.compute.worker import Worker
async def main():
    worker = Worker("the look", 600.0)
    await worker(calculations.double, 1)
    print(worker.pid, flush=True)
    await worker(calculations.loop_for_ever)
asyncio.run(main())
"""
    with subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True) as daemon:
        assert daemon.stdout is not None
        pid = int(daemon.stdout.readline())
        assert alive(pid)
        daemon.kill()
    asyncio.run(until_so(lambda: not alive(pid)))


def test_a_process_that_nobody_needs_for_long_is_ended_and_started_again_when_asked() -> None:
    async def story(worker: Worker) -> None:
        worker.idle_s = 0.05
        assert await worker(calculations.double, 1) == 2
        pid = worker.pid
        assert pid is not None
        await until_so(lambda: worker.pid is None and not alive(pid))
        with pytest.raises(ComputeError):
            await worker(calculations.kill_itself)
        assert worker.pid is None, "one that is kept for a while only is not started before it is needed"
        assert await worker(calculations.double, 2) == 4

    in_a_worker(story)


def test_after_its_end_nothing_is_started_any_more() -> None:
    async def story(worker: Worker) -> None:
        assert await worker(calculations.double, 1) == 2
        pid = worker.pid
        assert pid is not None
        worker.close()
        await until_so(lambda: not alive(pid))
        with pytest.raises(ComputeError, match="ending"):
            await worker(calculations.double, 1)

    in_a_worker(story)


values = st.recursive(
    st.none()
    | st.integers()
    | st.text(max_size=5)
    | arrays.arrays(np.uint8, arrays.array_shapes(max_dims=2, max_side=5))
    | st.just(np.arange(LARGE_BYTES, dtype=np.uint8)),
    lambda inner: st.lists(inner, max_size=3) | st.builds(Big, inner),
    max_leaves=6,
)


def plain(value: Any) -> Any:
    """For comparing."""
    if isinstance(value, Big):
        return "big", plain(value.pixels)
    if isinstance(value, list):
        return [plain(one) for one in value]
    return (value.shape, value.tobytes()) if isinstance(value, np.ndarray) else value


@settings(deadline=None, max_examples=25, suppress_health_check=[HealthCheck.too_slow])
@given(values)
def test_any_value_passes_and_what_passes_by_number_is_the_same_one(value: Any) -> None:
    held = list[ByReference]()

    def number_of(one: ByReference) -> int:
        held.append(one)
        return len(held) - 1

    shared = SharedMemory()
    try:
        back = unpickled(pickled(value, number_of, shared), held.__getitem__, shared)
    finally:
        shared.close()
    assert plain(back) == plain(value)


def test_what_does_not_fit_into_shared_memory_passes_all_the_same() -> None:
    shared = SharedMemory()
    try:
        pictures = [np.full(SHARED_BYTES // 2, k, np.uint8) for k in range(3)]
        back = unpickled(pickled(pictures, lambda _: None, shared), dict[int, object]().__getitem__, shared)
        assert [int(one[-1]) for one in back] == [0, 1, 2]
    finally:
        shared.close()
