"""What a worker is asked to compute in these tests, the faults among it."""

import os
import signal
from dataclasses import dataclass

import numpy as np

from daemon.compute.calls import ByReference
from daemon.errors import FacetdError


@dataclass(frozen=True, eq=False)
class Big(ByReference):
    pixels: np.ndarray
    within: "Big | None" = None


def double(value):
    return 2 * value


def same(*values):
    return values[0] if len(values) == 1 else values


def refuse():
    raise FacetdError("no part is seen")


def bug():
    raise KeyError("label")


def exhaust():
    raise MemoryError


def allocate():
    """1 GB at most: where the limit does not hold, the machine is not to suffer for it."""
    return len([np.ones(1 << 24) for _ in range(8)])


def kill_itself():
    os.kill(os.getpid(), signal.SIGKILL)


def loop_for_ever():
    while True:
        pass


def same_inside(outer, inner):
    return outer.within is inner


def manners():
    with open("/proc/self/oom_score_adj") as score:
        return os.nice(0), int(score.read())


def environment(name):
    return os.environ.get(name)


def unreadable():
    raise FacetdError("3.npz: cannot be read")


class Unreadable(ByReference):
    def __reduce__(self):
        return unreadable, ()
