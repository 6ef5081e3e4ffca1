"""Schema of the tables of many cells: each column with type, unit and meaning. Values only.

tests/manuals/data.py makes docs/DATA.md from it. Add a column at the end of its table with the version that adds it,
and never change a meaning: readers combine files of every release, with null for absent columns.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from daemon.review.measures import AXES
from daemon.vision.health import MEASURES

VERSION = 5
"""Written into every file as `facetd.schema`. Version 1 had only cycles and looks, and a file a run; 2 did not have the
cameras used; 3 had a person's stop as a fault that counted as tried, and not the pace of a simulated cell; 4 did
not have set-downs."""
Kind = Literal["text", "integer", "real", "flag", "time", "day"]
OF_PAIR = ("frozen", "doubled", "swapped", "knocked", "epipolar")
"""Measures of both images together; the others are of each image."""
MEANINGS: Mapping[str, str] = {
    "saturation": "share of pixels that are too bright to measure",
    "darkness": "brightness that 1 % of the pixels exceed: low in the dark",
    "covered": "contrast: low where a lens is covered or the light is off",
    "focus": "blur in every direction",
    "motion": "blur along one direction",
    "half": "share of the rows that repeat the row above: part of the frame is missing",
    "torn": "grey levels by which a row differs from the row above where two frames meet",
    "frozen": "images that are the same as in the pair before",
    "doubled": "1: both images are the same",
    "swapped": "1: left and right are exchanged",
    "knocked": "distance of matched points from their epipolar lines",
    "epipolar": "median distance of matched corners from their epipolar lines",
}
"""Of each measure of the images."""


@dataclass(frozen=True)
class Column:
    """since: the version of the schema that added it."""

    name: str
    kind: Kind
    meaning: str
    unit: str = ""
    since: int = 2


@dataclass(frozen=True)
class TableSchema:
    """A table of the fleet. row: what one row is."""

    row: str
    columns: tuple[Column, ...]


def _where(*more: Column) -> tuple[Column, ...]:
    """The columns that begin every table, and more."""
    return (
        Column("day", "day", "of its start, in UTC", since=1),
        Column("run", "text", "the run folder's name", since=1),
        *more,
    )


SEQ = Column("seq", "integer", "number of its record in run.jsonl", since=1)
CYCLE = Column("cycle", "integer", "the pick it belongs to, counted within its run; null or 0: none", since=1)
TIME = Column("t", "time", "when, in UTC")
MODEL = Column("model", "text", "first digits of the hash of the model in use", since=1)
CALIBRATION = Column("calibration", "text", "first digits of the hash of the calibration in use", since=1)


def _health() -> tuple[Column, ...]:
    columns = []
    for name, measure in MEASURES.items():
        side = f"limit {measure.limit:g} {'at most' if measure.above else 'at least'}"
        for camera in ("pair",) if name in OF_PAIR else ("left", "right"):
            of = "" if camera == "pair" else f"{camera} image: "
            columns.append(Column(f"{name}_{camera}", "real", f"{of}{MEANINGS[name]}; {side}", measure.unit))
    for axis in AXES:
        columns.append(Column(f"{axis}_deg", "real", f"{axis} of the right camera against its calibration", "degrees"))
        columns.append(Column(f"{axis}_sigma_deg", "real", f"standard deviation of this {axis}", "degrees"))
    return tuple(columns)


def _place(what: str) -> tuple[Column, ...]:
    return tuple(Column(f"{axis}_mm", "real", f"{what} in world coordinates", "mm") for axis in "xyz")


TABLES: Mapping[str, TableSchema] = {
    "runs": TableSchema("a run", _where(
        TIME,
        Column("release", "text", "version of facetd"),
        Column("kind", "text", "real, recorded or simulated"),
        Column("computer", "text", "name of the cell's computer"),
        Column("utc_offset_s", "integer", "of the cell's clock", "s"),
        Column("seconds", "real", "from its first record to its last", "s"),
        Column("records", "integer", "lines in run.jsonl"),
        Column("cycles", "integer", "picks begun"),
        Column("interventions", "integer", "how often a person had to act while a pick or an auto went on"),
        Column("ended", "flag", "true: the daemon ended the run; false: a crash or a power cut did"),
        MODEL,
        CALIBRATION,
        Column("config", "text", "first digits of the hash of the configuration"),
        Column("times_life", "real", "pace of a simulated cell: other than 1, its times are not comparable", since=4),
    )),
    "cycles": TableSchema("a pick", _where(
        CYCLE,
        TIME,
        Column("seconds", "real", "from its first record to its last", "s", 1),
        Column("target", "text", "the requested part; null: any"),
        Column("label", "text", "the chosen part", since=1),
        Column("tried", "flag", "whether it counts as tried: there was a part to pick, and no person ended it"),
        Column("outcome", "text", "picked, released, missed, lost, unknown, aborted, fault, unfinished", since=1),
        Column("cause", "text", "the likeliest cause of a failure, as on the run's page"),
        Column("why", "text", "its end in words", since=1),
        Column("looks", "integer", "looks at the chosen part", since=1),
        Column("predicted_mm", "real", "error expected at the grasp", "mm", 1),
        Column("predicted_deg", "real", "the same in angle", "degrees", 1),
        Column("true_mm", "real", "true error, from a simulated cell; null on a real one", "mm", 1),
        Column("true_deg", "real", "the same in angle", "degrees", 1),
        MODEL,
        CALIBRATION,
        Column("eyes", "text", "cameras used: both, left or right, or several in turn", since=3),
        Column("place", "text", "where the part was set down; null: not at a place", since=5),
        Column("place_status", "text", "seen right, off or missing, by the look there; set: no look was made", since=5),
        Column("place_off_mm", "real", "how far from its place the part was seen", "mm", 5),
        Column("place_off_deg", "real", "the same in angle", "degrees", 5),
    )),
    "looks": TableSchema("a look: a pair of pictures", _where(
        SEQ,
        CYCLE,
        TIME,
        Column("stop", "integer", "number of the look within its pick", since=1),
        Column("purpose", "text", "survey, approach, verify, teach", since=1),
        Column("whole", "flag", "false: the look sought only the expected part, by its edges"),
        Column("ms", "real", "processor time of the recogniser; null where it was not timed", "ms", 1),
        Column("parts", "integer", "parts seen", since=1),
        Column("named", "integer", "of them with a name", since=1),
        Column("predicted_mm", "real", "error at the grasp expected from the looks so far", "mm", 1),
        Column("chi2", "real", "disagreement with the looks before, 6 degrees of freedom", since=1),
        Column("noise", "real", "of the images", "grey levels", 1),
        Column("left", "text", "file of the left picture in the run folder"),
        Column("right", "text", "file of the right picture in the run folder"),
        MODEL,
        Column("eyes", "text", "cameras used: both; or left or right, from two places", since=3),
    )),
    "parts": TableSchema("a part in a look", _where(
        SEQ,
        CYCLE,
        TIME,
        Column("part", "integer", "its number in the look, from 0"),
        Column("label", "text", "its name, or unknown"),
        Column("picked_as", "text", "the name that the part proved to have when this pick held it; null: not proved"),
        Column("confidence", "real", "of the name, 0 to 1"),
        Column("match_ratio", "real", "share of the taught facets' relations that were found"),
        Column("activation", "real", "of the ARTMAP node"),
        Column("runner_up", "text", "the next best name"),
        Column("ambiguous", "flag", "whether two names fit equally well"),
        Column("cause", "text", "why it has no name"),
        Column("facets", "integer", "facets seen"),
        Column("residual_mm", "real", "worst distance of a corner to the taught part", "mm"),
        Column("sigma_mm", "real", "standard deviation of its position", "mm"),
        Column("depth_mm", "real", "distance from the cameras", "mm"),
        *_place("of its origin"),
    )),
    "moves": TableSchema("a move of the arm", _where(
        SEQ,
        CYCLE,
        TIME,
        Column("how", "text", "joint or straight"),
        Column("purpose", "text", "where to: stand-off, grasp, bin, home, ..."),
        Column("sent", "flag", "false: only planned, or withdrawn while typed"),
        Column("speed_pct", "real", "of full speed", "%"),
        *_place("of the gripper's target"),
        Column("seconds", "real", "until the arm was at rest; null: it did not arrive", "s"),
        Column("error_mm", "real", "WHERE against the target", "mm"),
        Column("error_deg", "real", "the same in angle", "degrees"),
    )),
    "faults": TableSchema("a fault, a refusal of the guard, a gap in the log, or a jump of the clock", _where(
        SEQ,
        CYCLE,
        TIME,
        Column("kind", "text", "fault, refusal, gap or clock"),
        Column("code", "text", "of the fault, or the guard's rule"),
        Column("text", "text", "in words"),
    )),
    "health": TableSchema("a look, as a measurement of light, lens and mounting", _where(SEQ, CYCLE, TIME, *_health())),
}  # fmt: skip
"""Tables by name. The folders' names give `cell` and `month`, which precede these columns."""
