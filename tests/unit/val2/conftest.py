"""What the tests of the arm's line share: a controller on a pseudo-terminal, a link to it, the fuzz of the bench."""

import asyncio
import importlib.util
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

from drivers.puma560 import READY_RAD
from drivers.simcell.arm import Arm
from drivers.simcell.controller import Controller, Faults, Manners, PtyServer
from drivers.val2.link import Dialect, Link

BENCH = Path(__file__).parents[2] / "bench" / "fuzz_val2.py"


@pytest.fixture(scope="session")
def fuzz() -> Callable[[int, int], tuple[int, bool]]:
    """The bench's fuzz, for a number of bytes and a seed: what came out, whether the arm moved."""
    spec = importlib.util.spec_from_file_location("fuzz_val2", BENCH)
    assert spec is not None
    assert spec.loader is not None
    bench = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(bench)

    def run(count: int, seed: int) -> tuple[int, bool]:
        noise = bench.pieces(count, seed)
        printed, moved = bench.fuzz_controller(noise, seed)
        return bench.fuzz_reader(noise, seed) + printed, moved

    return run


class PickContext:
    """A controller on a pseudo-terminal in scaled time, and what a link to it wrote into its ledger."""

    def __init__(self, server: PtyServer, faults: Faults, hand: list[bool]) -> None:
        self.server, self.faults, self.hand = server, faults, hand
        self.records: list[dict[str, Any]] = []

    @asynccontextmanager
    async def link(self, dialect: Dialect | None = None) -> AsyncIterator[Link]:
        """An open link; closed afterwards, and no task left behind."""
        link = Link(self.server.port, dialect or QUICK, on_wire=self.records.append)
        await link.open()
        try:
            yield link
        finally:
            await link.close()
            assert asyncio.all_tasks() == {asyncio.current_task()}

    def joints(self) -> Any:
        """(6,) rad, now."""
        with self.server.controller() as controller:
            return controller.arm.joints_at(controller.now_s)

    def sent(self) -> str:
        """Everything typed so far."""
        return "".join(record["bytes"] for record in self.records if record["way"] == "out")


QUICK = Dialect(resync_s=0.4, typing_s=0.4, answer_s=1.0, stall_s=0.3)


@pytest.fixture
def bench() -> Iterator[Callable[..., PickContext]]:
    """Builds benches: bench(manners, cold=False, time_scale=20, joints_rad=READY_RAD)."""
    servers: list[PtyServer] = []

    def build(
        manners: Manners | None = None, cold: bool = False, time_scale: float = 20.0, joints_rad: Any = READY_RAD
    ) -> PickContext:
        faults, hand = Faults(), list[bool]()
        controller = Controller(Arm(joints_rad=joints_rad), manners, hand.append, faults, cold)
        servers.append(PtyServer(controller, time_scale=time_scale))
        return PickContext(servers[-1], faults, hand)

    yield build
    for server in servers:
        server.stop()
