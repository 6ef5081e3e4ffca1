"""How a replay by many workers scales: one and two of them in earnest, up to 200 with the work slept. Prints a table.

usage: python -m tests.bench.replays STORE
In earnest every look of STORE is replayed, in pieces of a few looks, so that there are enough of them, by one worker
process and by two, each held to a core of its own. How much faster two are than one is told twice: by the clock, which
is true on a computer that does nothing else; and by the processor time of the busier worker, which counts what sharing
memory costs and how evenly the pieces were dealt out, whatever else the computer does. Then scheduler,
messages and files are as they are, in one process, and each piece sleeps as long as one of usual size would take: what
is lost is what sending and taking back costs. Its processor time, which a loaded computer does not change, says how
many workers can be kept busy: their pieces may not end faster than that.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path

import dask
import distributed

from daemon.fleet import replay_many
from daemon.fleet.replay_many import LOOKS_A_JOB, ReplayJob, ReplayWith, jobs_of, runs_in_store, work
from daemon.fleet.store import open_store

WORKERS = (1, 2, 20, 50, 100, 200)
PIECES_A_WORKER = 8
PATIENT = {"distributed.logging.distributed": "critical", "distributed.comm.timeouts.connect": "300s",
           "distributed.scheduler.worker-ttl": "600s"}  # fmt: skip
"""All workers are threads of this process: they begin one after the other."""
LOOKS = 2


@dataclass(frozen=True)
class Replayed:
    """wall_s, own_s: of the clock, and of the scheduler's and client's processor; workers_s: of each worker's."""

    wall_s: float
    own_s: float
    workers_s: tuple[float, ...]
    looks: int
    pieces: int


def in_earnest(store: str, workers: int) -> Replayed:
    """Every look, once the workers are there and have done a piece each."""
    replay_many.LOOKS_A_JOB = LOOKS
    runs = runs_in_store(open_store(store))
    with (
        tempfile.TemporaryDirectory() as out,
        distributed.LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address="127.0.0.1:0") as cluster,
        distributed.Client(cluster) as client,
    ):
        client.wait_for_workers(workers)
        for core, address in enumerate(client.scheduler_info(n_workers=-1)["workers"]):
            client.run(os.sched_setaffinity, 0, {sorted(os.sched_getaffinity(0))[core]}, workers=[address])
        jobs = jobs_of(runs, ReplayWith(), out)
        client.run(work, replace(jobs[0], out=f"{out}/first"))
        before, began, own = client.run(time.process_time), time.perf_counter(), time.process_time()
        results, failed = replay_many.replay_many(jobs, workers, cluster.scheduler_address)
        wall_s, own_s, after = time.perf_counter() - began, time.process_time() - own, client.run(time.process_time)
        assert not failed, failed
        spent = tuple(after[address] - before[address] for address in before)
        return Replayed(wall_s, own_s, spent, sum(len(r["looks"]) for _, r in results), len(jobs))


def slept(job: ReplayJob, seconds: float) -> str:
    """A piece whose work is sleeping; its result is written as a real one."""
    time.sleep(seconds)
    open_store(job.out).write(json.dumps({"looks": [{}] * 40}).encode(), "done", f"{job.key}.json")
    return job.key


def simulated(store: str, workers: int, seconds: float) -> tuple[float, float]:
    """Wall s and processor time s for PIECES_A_WORKER pieces a worker, once they are there."""
    run = runs_in_store(open_store(store))[0]
    with (
        tempfile.TemporaryDirectory() as out,
        dask.config.set(PATIENT),
        distributed.LocalCluster(
            n_workers=workers, threads_per_worker=1, processes=False, dashboard_address="127.0.0.1:0", memory_limit=0
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        client.wait_for_workers(workers)
        jobs = [
            ReplayJob(f"{k:024x}", run, run.looks, out, ReplayWith(), "0") for k in range(workers * PIECES_A_WORKER)
        ]
        began, spent = time.perf_counter(), time.process_time()
        futures = client.map(slept, jobs, [seconds] * len(jobs), key=[f"slept-{job.key}" for job in jobs])
        for future in distributed.as_completed(futures):
            future.release()
        assert len(list((Path(out) / "done").iterdir())) == len(jobs)
        return time.perf_counter() - began, time.process_time() - spent


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("store")
    parser.add_argument("--seconds", type=float, help="of a piece; else measured in earnest with one worker")
    args = parser.parse_args()
    seconds = args.seconds
    if seconds is None:
        one, two = (in_earnest(args.store, workers) for workers in (1, 2))
        for done in (one, two):
            print(f"{len(done.workers_s)} at work: {done.looks} looks in {done.pieces} pieces, {done.wall_s:.1f} s; "
                  f"processor: workers {', '.join(f'{each:.1f}' for each in done.workers_s)} s, "
                  f"scheduler and client {done.own_s:.1f} s")  # fmt: skip
        print(f"two are {one.wall_s / two.wall_s:.2f} times as fast as one by the clock, "
              f"{max(one.workers_s) / max(two.workers_s):.2f} by the busier worker's processor; a look costs "
              f"{sum(two.workers_s) / sum(one.workers_s):.2f} times as much there; load {os.getloadavg()[0]:.1f} on "
              f"{os.cpu_count()} processors")  # fmt: skip
        seconds = sum(one.workers_s) / one.looks * LOOKS_A_JOB
    print(f"the largest worker took {resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1e3:.0f} MB")
    print(f"{'workers':>8} {'pieces':>7} {'wall s':>7} {'ideal s':>8} {'used':>6} {'CPU ms/piece':>13}"
          f"   pieces of {seconds:.1f} s, slept")  # fmt: skip
    for workers in WORKERS:
        pieces, ideal = workers * PIECES_A_WORKER, seconds * PIECES_A_WORKER
        wall, spent = simulated(args.store, workers, seconds)
        print(f"{workers:8} {pieces:7} {wall:7.1f} {ideal:8.1f} {ideal / wall:6.0%} {1e3 * spent / pieces:13.1f}")


if __name__ == "__main__":
    main()
