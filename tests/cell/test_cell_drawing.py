"""A part that was never shown, taught from its drawing alone, is recognised and picked by the daemon."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
import pytest

from drivers.simcell.parts import part_shape
from tests.fakes.running import Running, judged_daemon

pytestmark = pytest.mark.long


@pytest.fixture
def daemon() -> Iterator[Running]:
    with judged_daemon(seed=11, time_scale=20.0) as daemon:
        yield daemon


def stl(label: str) -> bytes:
    """The simulated part's own shape as a drawing office would hand it over."""
    solid = part_shape(label).hull
    fans = [solid.vertices[[f[0], b, c]] for f in solid.faces for b, c in pairwise(f[1:])]
    body = b"".join(bytes(12) + np.asarray(fan, "<f4").tobytes() + bytes(2) for fan in fans)
    return bytes(80) + len(fans).to_bytes(4, "little") + body


@pytest.mark.timeout(300)
def test_parts_taught_by_mesh_are_picked_as_if_they_had_been_shown(daemon: Running) -> None:
    for label in ("cube", "pentagonal_prism"):
        (daemon.folder / f"{label}.stl").write_bytes(stl(label))
        taught = daemon.do(f"teach {label} --mesh {daemon.folder}/{label}.stl")
        assert taught["status"] == 0, taught["text"]
        assert taught["data"]["sufficiency"]["unseen"] == 0
    trained = daemon.do("train")
    assert (trained["status"], trained["data"]["accepted"]) == (0, True)
    assert daemon.do("views")["text"].count("drawing") == 2
    daemon.do("enable")
    daemon.do("scatter cube pentagonal_prism")
    daemon.do("auto on")
    ends = daemon.do("auto wait")["data"]["ends"]
    assert sorted(end["label"] for end in ends if end["outcome"] == "picked") == ["cube", "pentagonal_prism"]
