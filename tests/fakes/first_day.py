"""Cells for arms of several sizes, and whole first days in them: introduced, commissioned, picked from, by commands.

A cell is two files: cell.yaml, what is so (the daemon never reads it), and facetd.yaml, what the person writes who read
deploy/FIRST-DAY.md. What such a person reads off a plate or measures is taken from the truth here, and nothing else.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from daemon import frames
from daemon.arrays import Array
from daemon.cli.starting import daemon_in, wait_until_ready
from drivers.puma560 import ArmGeometry
from drivers.simcell.controller import Manners
from drivers.val2.dialect import SLOWEST_BAUD
from tests.fakes.person import Person
from tests.fakes.strange_controllers import Strange, draw

ETC = Path(__file__).resolve().parents[2] / "etc"
READY_DEG = (0.0, 60.0, -150.0, 0.0, -40.0, 0.0)
"""Elbow and wrist bent, clear of everything."""
INTRODUCED_AT, PICKED_AT = 1.0, 20.0
"""How much faster than real time the cell runs: while the stop is tested in real time, and afterwards."""
PANEL_S = 2.0
INTRODUCING_S, DAY_S = 1800.0, 3000.0
"""The longest that a first contact and all of commissioning take, on a slow and busy computer."""


@dataclass(frozen=True)
class Room:
    """Where an arm that reaches so far to its wrist has its table, seen from where axes 1 and 2 cross, mm: how far
    below and before it is, the area of parts, from how far they are looked at, how long the hand is from the wrist
    centre."""

    reach_mm: float
    below_mm: float
    before_mm: float
    scatter_mm: float
    look_mm: float
    stand_offs_mm: tuple[float, ...]
    hand_mm: float


ROOMS = {
    "PUMA 260": Room(406.4, 250.0, 290.0, 45.0, 330.0, (330.0, 250.0, 200.0), 130.0),
    "PUMA 560": Room(863.6, 300.0, 520.0, 110.0, 480.0, (450.0, 300.0, 200.0), 130.0),
    "PUMA 762": Room(1250.0, 500.0, 750.0, 130.0, 480.0, (450.0, 300.0, 200.0), 200.0),
    "PUMA 761": Room(1500.0, 550.0, 950.0, 130.0, 480.0, (450.0, 300.0, 200.0), 200.0),
}


def room_of(arm: ArmGeometry) -> Room:
    """That of the series whose reach is nearest."""
    return min(ROOMS.values(), key=lambda room: abs(room.reach_mm - arm.a2_mm - arm.d4_mm))


def hand_of(room: Room, rng: np.random.Generator) -> Array:
    """flange_from_tool (4, 4) of a gripper of about that length, turned a little about the flange."""
    turn = float(rng.uniform(-0.4, 0.4))
    shift = np.array([*rng.uniform(-4.0, 4.0, 2), room.hand_mm + rng.uniform(0.0, 15.0)])
    return frames.rigid(frames.rotation_from_vector(np.array([0.0, 0.0, turn])), np.round(shift, 1))


def truth(arm: ArmGeometry, manners: Manners, start_deg: Array, baud: int = 9600, cold: bool = False) -> dict[str, Any]:
    """cell.yaml: that of etc/, with another arm, and the table, light, bin and body that suit it."""
    made: dict[str, Any] = yaml.safe_load((ETC / "simcell.yaml").read_text())
    room, base = room_of(arm), arm.world_from_base[:3, 3]
    table = base + np.array([room.before_mm, 0.0, -room.below_mm])
    moved = table - np.array([*made["table"]["centre_mm"], made["table"]["height_mm"]])
    made["table"] |= {"height_mm": table[2], "centre_mm": table[:2], "scatter_radius_mm": room.scatter_mm}
    made["bin"]["centre_mm"] = bin_mm(arm)[:2]
    for lamp in made["lighting"]["lamps"]:
        lamp["position_mm"] = np.array(lamp["position_mm"]) + moved
    scales = np.array([arm.a2_mm, abs(arm.d3_mm), arm.d4_mm]) / np.array([431.8, 150.05, 431.8])
    safety, large = made["safety"], max(1.0, *scales)
    for side in ("low_mm", "high_mm"):
        safety["room"][side] = base + large * np.array(safety["room"][side])
    for rod in safety["body"]:
        upper, aside, fore = scales
        by = {"forearm": (1.0, 1.0, fore), "upper_arm": (upper, upper, aside), "tool": (1.0, 1.0, 1.0)}[rod["frame"]]
        for end in ("from_mm", "to_mm"):
            rod[end] = np.array(rod[end]) * by
        rod["radius_mm"] *= {"forearm": fore, "upper_arm": min(upper, aside), "tool": 1.0}[rod["frame"]]
    made["arm"] |= {
        "flange_from_tool": arm.flange_from_tool, "world_from_base": arm.world_from_base,
        "controller_flange": arm.controller_flange, "lengths_mm": arm.lengths_mm, "start_deg": start_deg,
        "manners": asdict(replace(manners, arm_power_after_s=PANEL_S)), "baud": baud, "cold": cold,
    }  # fmt: skip
    return plain(made)


def bin_mm(arm: ArmGeometry) -> Array:
    """(3,) mm, world: over the bin, beside the table, where the shoulder's offset is not."""
    room = room_of(arm)
    far = float(np.hypot(250.0, 410.0)) * room.before_mm / 520.0
    left = np.sign(arm.d3_mm) * far * np.sin(np.radians(58.0))
    over = np.array([far * np.cos(np.radians(58.0)), left, 150.0 - room.below_mm])
    return np.asarray(np.round(arm.world_from_base[:3, 3] + over, 1))


def configuration(arm: ArmGeometry, seed: int, file: str | None = None, hand: Array | None = None) -> dict[str, Any]:
    """facetd.yaml of that cell. file: arm.yaml; hand: flange_from_tool as measured."""
    room, base = room_of(arm), arm.world_from_base[:3, 3]
    table = base + np.array([room.before_mm, 0.0, -room.below_mm])
    looked = {"centre_mm": table + np.array([0.0, 0.0, 20.0]), "distance_mm": room.look_mm}
    side = float(np.sign(arm.d3_mm))
    wide = room.before_mm + 2.5 * room.scatter_mm
    home = table + np.array([-0.1 * room.before_mm, 0.0, 0.75 * room.look_mm])
    pick = {
        "limits": {
            "box_low_mm": base + np.array([-0.1 * wide, -wide, -room.below_mm]),
            "box_high_mm": base + np.array([1.3 * wide, wide, 3.0 * room.below_mm]),
            "table_z_mm": table[2],
        },
        "surveys": [{**looked, "heading_deg": heading, "tilt_deg": 45.0} for heading in (50.0, -50.0, 90.0 * side)],
        "last_surveys": [{**looked, "heading_deg": -90.0 * side, "tilt_deg": 35.0}],
        "home": {"point_mm": home, "tilt_deg": 20.0},
        "bin": {"point_mm": bin_mm(arm), "heading_deg": 58.0 * side, "tilt_deg": 10.0},
        "stops": {"stand_offs_mm": room.stand_offs_mm},
    }  # fmt: skip
    simulated = {"truth": "cell.yaml", "time_scale": PICKED_AT, "seed": seed, "verdict": "verdict.jsonl"}
    own = {
        "flange_from_tool": arm.flange_from_tool if hand is None else hand,
        **({} if file is None else {"file": file}),
    }
    return plain({
        "version": 1, "cell": "simulated", "folders": {"state": "state", "runtime": "."}, "arm": own, "pick": pick,
        "simulated": simulated,
    })  # fmt: skip


def plain(value: Any) -> Any:
    """A value converted to YAML's types."""
    if isinstance(value, dict):
        return {name: plain(each) for name, each in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [plain(each) for each in value]
    return value.item() if isinstance(value, np.generic) else value


def arm_yaml(arm: ArmGeometry) -> dict[str, Any]:
    """arm.yaml of an arm that is already known."""
    names = ("a2_mm", "a3_mm", "d3_mm", "d4_mm", "world_from_base", "controller_flange")
    return plain({"version": 1, "geometry": {name: {"value": getattr(arm, name)} for name in names}})


def lay_down(folder: Path, truth: dict[str, Any], configuration: dict[str, Any]) -> None:
    """Make the cell's folder, as installed, with these two files."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in ("calibration.yaml", "facets.yaml", "parts.yaml"):
        (folder / name).write_bytes((ETC / name).read_bytes())
    (folder / "cell.yaml").write_text(yaml.safe_dump(truth, sort_keys=False))
    (folder / "facetd.yaml").write_text(yaml.safe_dump(configuration, sort_keys=False))


# What the person does


Drawing = tuple[float, float, float, float]
"""An arm's lengths a2, a3, d3, d4 (mm) from its maker's drawing."""


def strange_cell(seed: int, drawing: Drawing | None = None) -> tuple[Strange, ArmGeometry]:
    """A controller drawn at random, and its arm (drawing: of these lengths) with a hand of its own.

    It loses no characters that follow closely: a pty hands over at once what piled up on a busy computer. Those are met
    in simulated time. Its line is no slower than facetd works on.
    """
    drawn = draw(seed)
    a2, a3, d3, d4 = drawing or drawn.geometry.lengths_mm
    d3 = float(np.copysign(d3, drawn.geometry.d3_mm))
    geometry = replace(drawn.geometry, a2_mm=a2, a3_mm=a3, d3_mm=d3, d4_mm=d4)
    strange = replace(
        drawn,
        manners=replace(drawn.manners, lost_within_s=0.0),
        geometry=geometry,
        baud=max(drawn.baud, SLOWEST_BAUD),
    )
    hand = hand_of(room_of(geometry), np.random.default_rng([19, seed]))
    return strange, replace(strange.geometry, flange_from_tool=hand)


def limits_deg(strange: Strange) -> list[list[float]]:
    """The joint limits on the plate, in the controller's counting."""
    how = strange.manners
    ends = np.degrees(strange.geometry.limits_rad) - np.array(how.joint_zeros_deg)[:, None]
    limits: list[list[float]] = np.sort(ends * np.array(how.joint_signs)[:, None], axis=1).round(3).tolist()
    return limits


@contextmanager
def controller(folder: Path, time_scale: float) -> Iterator[Path]:
    """The cell's controller on its own serial port."""
    port = folder / "port"
    options = {"pty": port, "truth": folder / "cell.yaml", "time-scale": time_scale}
    with at_work([word for name, value in options.items() for word in (f"--{name}", str(value))]):
        yield port


@contextmanager
def at_work(words: Sequence[str]) -> Iterator[None]:
    """Context: a controller in its own process, started with these arguments; yields once its port exists."""
    process = subprocess.Popen([sys.executable, "-m", "drivers.simcell.controller", *words], stdout=subprocess.PIPE)
    try:
        assert process.stdout is not None
        assert process.stdout.readline().startswith(b"VAL II controller")
        yield
    finally:
        process.terminate()
        process.wait(10.0)
        assert process.stdout is not None
        process.stdout.close()


ANSWERS = (
    (re.compile(r"What shall I answer\?"), "Y"),
    (re.compile(r"How far off are they.*\)"), "0.1 -0.2"),
    (re.compile(r"\[y/n\]"), "y"),
    (re.compile(r"\[more/enough\]"), "enough"),
    (re.compile(r"\(yes or no\)"), "yes"),
)
"""The answers of a person who does what each question asks, as far as this cell allows it."""


FOLDED = re.compile(r"\r?\n {2,}")
"""The continuation of a line that is longer than the terminal."""


def answer_to(asked: str) -> str | None:
    """The person's answer to a question; None where there is no question."""
    return next((answer for question, answer in ANSWERS if question.search(asked)), None)


def lives_through(person: Person, within_s: float) -> str:
    """Answer all questions until facetctl ends; returns the whole screen text."""
    deadline, seen, since = time.monotonic() + within_s, "", 0
    while time.monotonic() < deadline:
        seen += person.sees_for(0.2)
        answer = answer_to(FOLDED.sub(" ", seen[since:]).rsplit("\n", 1)[-1])
        if answer is not None:
            person.types(answer + "\n")
            seen += "\n"
            since = len(seen)
        if person.gone:
            return seen
    raise AssertionError(f"still there after {within_s:g} s: {seen[-2000:]}")


def written_down(folder: Path, strange: Strange, arm: ArmGeometry, seed: int, found: dict[str, Any]) -> None:
    """Write what FIRST-DAY.md requires after the first contact: the limits into arm.yaml, the cell into facetd.yaml."""
    found["geometry"]["limits_deg"] = {"value": limits_deg(strange), "found": "the plate"}
    (folder / "first-day" / "arm.yaml").write_text(yaml.safe_dump(found, sort_keys=False))
    flange = np.array(found["geometry"]["controller_flange"]["value"])
    measured = frames.inverse(arm.controller_flange) @ arm.flange_from_tool
    config = configuration(arm, seed, "first-day/arm.yaml", flange @ measured)
    (folder / "facetd.yaml").write_text(yaml.safe_dump(config, sort_keys=False))


def introduced(folder: Path, strange: Strange, arm: ArmGeometry, seed: int, drawing: Drawing | None = None) -> str:
    """Run `facetctl arm identify`, then write what FIRST-DAY.md requires; returns the screen text."""
    lay_down(folder, truth(arm, strange.manners, strange.joints_deg, strange.baud, strange.cold), {})
    with controller(folder, INTRODUCED_AT) as port:
        lengths = () if drawing is None else ("--lengths", ",".join(f"{length:g}" for length in drawing))
        person = Person(folder, "arm", "identify", str(port), "--out", str(folder / "first-day"), *lengths)
        seen = lives_through(person, INTRODUCING_S)
    written_down(folder, strange, arm, seed, yaml.safe_load((folder / "first-day" / "arm.yaml").read_text()))
    return seen


def typed_from_the_page(folder: Path, seed: int) -> str:
    """What FIRST-DAY.md says to try before the arm is there, typed as it stands at that controller; then its replay,
    and `facetd --check` of a facetd.yaml that names what was found. What is wrong; nothing where all is as told."""
    page = (ETC.parent / "deploy" / "FIRST-DAY.md").read_text(encoding="utf-8")
    first, second = re.findall(r"```\n(python -m drivers.*)\n(facetctl arm identify .*)\n```", page)[0]
    assert "--manners 3" in first, "another number may stand there"
    port, trial = folder / "puma", folder / "trial"
    here = {"/tmp/puma": str(port), "trial": str(trial), "3": str(seed)}
    with at_work([here.get(word, word) for word in first.split()[3:]]):
        seen = lives_through(Person(folder, *(here.get(word, word) for word in second.split()[1:])), INTRODUCING_S)
    missing = [name for name in ("arm.yaml", "arm.txt", "transcript.jsonl") if not (trial / name).exists()]
    if missing or "PUMA 560" not in (trial / "arm.txt").read_text(encoding="utf-8"):
        return f"{missing} missing: {seen[-1500:]}"
    assert "`facetctl arm replay transcript.jsonl`" in page
    arm = ArmGeometry()
    lay_down(folder, truth(arm, Manners(), np.array(READY_DEG)), configuration(arm, seed, "trial/arm.yaml"))
    for words, wanted in (
        (("daemon.ctl", "arm", "replay", str(trial / "transcript.jsonl")), "byte for byte"),
        (("daemon.main", "--check", "--config", str(folder / "facetd.yaml")), "is good"),
    ):
        done = subprocess.run([sys.executable, "-m", *words], capture_output=True, text=True, check=False)
        if wanted not in done.stdout:
            return f"{words}: {done.stdout}{done.stderr}"
    return ""


@dataclass(frozen=True)
class Day:
    """The end of a first day: the screen text, the motion monitor's findings, whether the part is in the bin."""

    seen: str
    judged: tuple[str, ...]

    @property
    def wrong(self) -> str:
        """Everything that went wrong; empty where a part was picked and the monitor found nothing."""
        if self.judged:
            return "; ".join(self.judged)
        return "" if "proven: picked: " in self.seen else self.seen[-1500:]


def commissioned(folder: Path) -> Day:
    """Run `facetd` and `facetctl commission` with the files in the folder."""
    with daemon_in(folder, 30.0) as (daemon, reports):
        wait_until_ready(daemon, reports, print)
        seen = lives_through(Person(folder, "commission", "--keep", str(folder)), DAY_S)
    lines = map(json.loads, (folder / "verdict.jsonl").read_text(encoding="utf-8").splitlines())
    return Day(seen, tuple(f"{line['rule']}: {line['text']} (`{line['by']}`)" for line in lines if "rule" in line))


def first_day(folder: Path, seed: int, drawing: Drawing | None = None) -> Day:
    """Run a whole first day, from an unknown controller and arm to a part in the bin."""
    strange, arm = strange_cell(seed, drawing)
    seen = introduced(folder, strange, arm, seed, drawing)
    day = commissioned(folder)
    return replace(day, seen=seen + day.seen)


__all__ = [
    "PICKED_AT", "READY_DEG", "ROOMS", "Day", "answer_to", "arm_yaml", "commissioned", "configuration", "controller",
    "first_day", "introduced", "lay_down", "lives_through", "room_of", "strange_cell", "truth",
    "typed_from_the_page", "written_down",
]  # fmt: skip
