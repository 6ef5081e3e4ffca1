"""The likeliest cause of each miss: planted causes, each among other oddities, and what is named first."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, get_args, get_type_hints

import numpy as np
import pytest
import yaml

from daemon import frames
from daemon.commands import every_command
from daemon.commands.calibrating import KINDS
from daemon.commands.controller_terminal import ROBOT
from daemon.commands.placing import ACTS
from daemon.config import Config
from daemon.ctl import OFFLINE
from daemon.events.codes import CauseCode
from daemon.events.upgrade import VERSION
from daemon.review.brief import read_brief
from daemon.review.digest import digest
from daemon.review.failure_causes import (
    PLANNED,
    all_seem_to_move,
    causes,
    in_plain_words,
    run_context,
    text_of,
    times_its_limit,
)
from daemon.review.not_counted import picks_not_counted
from daemon.review.page import read_digest
from daemon.review.pagedata import page_data
from daemon.review.production import production
from daemon.store.folders import HOUSE
from daemon.store.runs import read_run
from daemon.store.yamlfile import kinds_of
from daemon.vision.health import ADVICE, MEASURES
from drivers.camera.controls import KNOWN as CONTROLS
from drivers.camera.settings import CameraSettings
from drivers.val2.dialect import Dialect
from tests.fakes.made_run import MadeRun, part

UNMATCHED = "no facet was found in both images (13 and 11 outlines)"
FOCUS = "left: out of focus: focus the lens at the working distance, or clean it (focus 3.13 px, limit 1.5)"
AWAY = frames.rigid(np.eye(3), np.array([200.0, 0.0, 0.0])).tolist()
STRANGER = part("unknown", ambiguous=True, candidates=["cube", "pyramid"], reason="one square", cause="alike")


def begin(made: MadeRun, *, good: bool = False) -> None:
    """A pick as far as its second look; beside the part lies something that could be two, and the first estimate is a
    poor one. good: another pick of the run went well before."""
    if good:
        made.pick(label="pyramid")
    made.cycle += 1
    made.write("cycle_start", cycle=made.cycle, target=None)
    made.look("survey", part("cube"), STRANGER)
    made.write("decision", cycle=made.cycle, text="pick cube", why="surest: confidence 0.98; grasp 50 mm wide")
    made.look("approach", part("cube"), stop=1)
    estimate(made, 1, 2.3)


def estimate(made: MadeRun, stop: int, mm: float, chi2: float = 1.0) -> None:
    made.write("estimate", cycle=made.cycle, stop=stop, label="cube", world_from_part=np.eye(4), covariance=np.eye(6),
               predicted_mm=mm, predicted_deg=0.2, chi2=chi2)  # fmt: skip


def end(made: MadeRun, outcome: str, why: str) -> None:
    made.write("cycle_end", cycle=made.cycle, outcome=outcome, label="cube", stops=2, why=why, predicted=None)


def fault(text: str, code: str = "") -> Callable[[MadeRun], None]:
    def plant(made: MadeRun) -> None:
        begin(made)
        made.write("fault", cycle=made.cycle, code=code or text.split(":")[0], text=text, **{"while": "pick"})
        made.write("fault", cycle=made.cycle, code="NoAnswer", text="NoAnswer: no prompt", **{"while": "pick"})
        end(made, "fault", text)

    return plant


def ended(outcome: str, why: str) -> Callable[[MadeRun], None]:
    def plant(made: MadeRun) -> None:
        begin(made)
        end(made, outcome, why)

    return plant


def measured(findings: dict[str, str], cause: str = "hidden") -> Callable[[MadeRun], None]:
    """Nothing can be named, and pictures have a reason."""

    def plant(made: MadeRun) -> None:
        made.cycle += 1
        made.write("cycle_start", cycle=made.cycle, target=None)
        for k in range(3):
            nameless = part("unknown", cause=cause, reason="part of it does not show (one square)")
            made.look("survey", nameless, findings=findings if k else {})
        end(made, "unknown", "unknown: fits nothing that was taught: part of it does not show (one square)")

    return plant


def nameless(cause: str) -> Callable[[MadeRun], None]:
    words = next(said.words for unnamed, said in ADVICE.items() if unnamed == cause)

    def plant(made: MadeRun) -> None:
        made.cycle += 1
        made.write("cycle_start", cycle=made.cycle, target=None)
        made.look("survey", part("unknown", cause=cause, reason=f"{words} (x)"), findings={"motion left": "left: ..."})
        for _ in range(4):
            made.look("another view", part("unknown", cause=cause, reason=f"{words} (x)"))
        end(made, "unknown", f"unknown: fits nothing that was taught: {words} (x)")

    return plant


def cameras_do_not_meet(made: MadeRun) -> None:
    begin(made)
    for stop in (2, 3):
        made.look("approach", stop=stop, notes=[UNMATCHED])
    end(made, "lost", "cube: not seen where it was at look 1")


def cameras_never_meet(made: MadeRun) -> None:
    made.cycle += 1
    made.write("cycle_start", cycle=made.cycle, target=None)
    for _ in range(3):
        made.look("survey", notes=[UNMATCHED])
    end(made, "unknown", "outlines in both images, but no facet: light, focus, a knocked camera?")


def suspect(who: str, good: bool = False) -> Callable[[MadeRun], None]:
    def plant(made: MadeRun) -> None:
        begin(made, good=good)
        text = "looks 1 and 2 disagree (chi-square 501, 22.46 is the most)"
        made.write("decision", cycle=made.cycle, text=f"suspect: {who}", why=text)
        if who == "part":
            end(made, "lost", "cube: its corners are not where the look before had them")
            return
        text = f"SuspectError: {text}; suspect: {who}"
        made.write("fault", cycle=made.cycle, code="SuspectError", text=text)
        end(made, "fault", text)

    return plant


def blurred(made: MadeRun) -> None:
    """Seen, named, and measured badly."""
    made.cycle += 1
    made.write("cycle_start", cycle=made.cycle, target="cube")
    blur = {
        f"focus {camera}": f"{camera}: out of focus: clean it (focus 3.4 px, limit 1.5)" for camera in ("left", "right")
    }
    smear = {"motion left": "left: blurred by motion: settle (motion 7.2 px, limit 6)"}
    for stop in (1, 2):
        made.look("approach", part("cube"), stop=stop, findings=smear | blur)
    made.write("decision", cycle=made.cycle, text="suspect: unclear", why="looks 1 and 2 disagree (chi-square 34)")
    text = "SuspectError: a part moved, or the cameras were knocked: with no other part in view it cannot be told"
    made.write("fault", cycle=made.cycle, code="SuspectError", text=text)
    end(made, "fault", text)


def another_part(made: MadeRun) -> None:
    """Single looks thought it hidden; all together fit nothing."""
    made.cycle += 1
    made.write("cycle_start", cycle=made.cycle, target=None)
    for _ in range(3):
        made.look("survey", part("unknown", cause="hidden", reason="part of it does not show (a rectangle)"))
    end(made, "unknown", "unknown: fits nothing that was taught: only 3 of 6 facets could belong to cube")


def disagreeing_again(made: MadeRun) -> None:
    """The pick itself blamed the part each time."""
    begin(made, good=True)
    for _ in range(3):
        text = "looks 1 and 2 disagree (chi-square 490, 22.46 is the most)"
        made.write("decision", cycle=made.cycle, text="suspect: unclear", why=text)
        made.write("decision", cycle=made.cycle, text="suspect: part", why="the whole table was looked at again")
    text = "SuspectError: a part moved, or the cameras were knocked: with no other part in view it cannot be told"
    made.write("fault", cycle=made.cycle, code="SuspectError", text=text)
    end(made, "fault", text)


def everything_moves(made: MadeRun) -> None:
    begin(made)
    for label in ("cube", "pyramid", "pyramid"):
        made.look("approach", part(label), stop=1)
        why = "its corners are not where the look before had them"
        made.write("decision", cycle=made.cycle, text=f"plan {label} again", why=why)
    end(made, "lost", "pyramid: its corners are not where the look before had them")


def taken_away(made: MadeRun) -> None:
    begin(made)
    made.look("approach", stop=2)
    end(made, "lost", "cube: not seen where it was at look 1")


def lost_among_outlines(made: MadeRun) -> None:
    begin(made)
    made.look("approach", stop=2, refused=8)
    end(made, "lost", "cube: not seen where it was at look 1")


def missed(why: str, off_mm: float = 0.3, *, chi2: float = 1.0, mm: float = 0.6) -> Callable[[MadeRun], None]:
    def plant(made: MadeRun) -> None:
        begin(made)
        made.look("approach", part("cube"), stop=2)
        estimate(made, 2, mm, chi2)
        made.write("hand", cycle=made.cycle, closed=True)
        lies = np.eye(4)
        lies[0, 3] = off_mm
        seen = () if "gone" in why else (part("cube", cyclopean_from_part=lies.tolist()),)
        made.look("verify", *seen, stop=3)
        end(made, "missed", why)

    return plant


def released(above: str, opened: str) -> Callable[[MadeRun], None]:
    """The gripper opened above the bin, and looks at it showed this before and after."""

    def plant(made: MadeRun) -> None:
        begin(made)
        made.write("hand", cycle=made.cycle, closed=True)
        made.look("verify", part("cube"), stop=2)
        made.write("hand", cycle=made.cycle, closed=False)
        made.write("release", cycle=made.cycle, label="cube", above=above, opened=opened)
        end(made, "released", "what is known")

    return plant


def look_errs(again: Sequence[dict[str, Any]] = (), purpose: str = "bin") -> Callable[[MadeRun], None]:
    """The look after the lift denies a part that is held. again: what the table shows when it is looked at once more;
    purpose: of the move before the hand opens."""

    def plant(made: MadeRun) -> None:
        begin(made)
        made.write("hand", cycle=made.cycle, closed=True)
        made.look("verify", part("cube"), stop=2)
        made.write("decision", cycle=made.cycle, text="missed", why="cube still lies there")
        made.write("move", cycle=made.cycle, how="joint", purpose=purpose, target=None, speed_pct=100)
        made.write("hand", cycle=made.cycle, closed=False)
        made.look("survey", *again)
        end(made, "missed", "cube still lies there")

    return plant


def bare_patterned_table(made: MadeRun) -> None:
    """The end of every auto there: the weave's outlines do not meet, and a camera was said to be knocked."""
    made.pick()
    made.cycle += 1
    made.write("cycle_start", cycle=made.cycle, target=None)
    notes = [UNMATCHED, "the pattern of the table runs into its edges; light it better"]
    for survey in ("survey 1", "survey 2"):
        made.look(survey, notes=notes, knocked_pair=0.1)
    end(made, "unknown", "outlines in both images, but no facet: light, focus, a knocked camera?")


def slanted(made: MadeRun) -> None:
    """Knocked about by two tries, it is no longer known for what it is."""
    begin(made)
    made.write(
        "decision", cycle=made.cycle, text="pick cube", why="surest; grasp 52 mm wide, contacts 25 degrees off square"
    )
    made.look("verify", part("cube"), stop=3)
    made.write("decision", cycle=made.cycle, text="missed", why="cube still lies there")
    made.look("survey", part("unknown", cause="strange", reason="nothing like it was taught"))
    end(made, "unknown", "unknown: fits nothing that was taught: nothing like it was taught (square)")


def one_part_slips(made: MadeRun) -> None:
    made.pick(label="pyramid")
    missed("cube still lies there")(made)


def refused(rule: str, text: str) -> Callable[[MadeRun], None]:
    def plant(made: MadeRun) -> None:
        begin(made)
        made.write("refusal", cycle=made.cycle, rule=rule, text=text)
        end(made, "unreachable", f"cube: {text}")

    return plant


def cut_off(made: MadeRun) -> None:
    begin(made)
    made.write("move", cycle=made.cycle, how="straight", purpose="stand-off 200 mm", target=None, speed_pct=30)


DARK = "left: nothing to see: is the lens covered, or the light off? (covered 0.656 grey levels, limit 4)"
PLANTED: dict[str, tuple[str, Callable[[MadeRun], None]]] = {
    "an operator types stop": ("operator's stop", fault("stopped by the operator", "stopped by the operator")),
    "control-C": ("operator's stop", fault("stopped by control-C of ann (process 7), socket")),
    "abort": ("operator's abort", ended("aborted", "aborted")),
    "no in step mode": (
        "operator refused a move",
        ended("aborted", "the operator refused: stand-off 300 mm: straight to 1 2 3"),
    ),
    "emergency stop": ("emergency stop", fault("ControllerError: *Emergency stop*")),
    "arm power lost": ("arm power", fault("ControllerError: *Arm power off*")),
    "envelope error": ("envelope error", fault("ControllerError: *Envelope error* Joint 2")),
    "controller's power failed": (
        "controller restarted",
        fault("ControllerError: the controller asks 'Load VAL-II from floppy (Y/N)?': answer that first"),
    ),
    "torn serial cable": ("controller silent", fault("NoAnswer: no echo of 'DO BREAK' within 2.0 s; then no prompt")),
    "serial adapter pulled": ("controller silent", fault("PortError: /dev/facetd-arm: gone", "controller")),
    "noise that leaves nothing of a word": (
        "noise on the line",
        fault("NoAnswer: typed 'DO OPENI', echoed 'D\xd3'; then no prompt after 3 attempts"),
    ),
    "a line that carries nothing back": (
        "controller silent",
        fault("NoAnswer: typed 'DO OPENI', echoed ''; then no prompt after 3 attempts"),
    ),
    "converter on the line": (
        "converter echoes",
        fault("NoAnswer: what is typed comes back twice: the converter on the line echoes by itself"),
    ),
    "noise on the line": ("noise on the line", fault("Garbled: 'WHERF' came back for 'WHERE'")),
    "drifting arm": (
        "arm not where it was sent",
        fault("NotThereError: grasp: sent, but WHERE is 3.12 mm and 0.41 degrees off"),
    ),
    "arm stalls": ("arm not where it was sent", fault("Elsewhere: at rest 41 mm and 2 degrees from where it was sent")),
    "torn camera cable": (
        "camera not connected",
        fault("CameraError: left camera /dev/facetd-left is gone (No such device)"),
    ),
    "camera lost between picks": ("camera not connected", fault("cameras: no frame within 5.00 s")),
    "lens covered": ("lens covered", fault(f"VisionError: {DARK}")),
    "light off": ("light off", fault(f"VisionError: {DARK}; {DARK.replace('left', 'right')}")),
    "USB bandwidth": (
        "half a frame",
        fault("VisionError: left: half a frame: USB bandwidth (MJPEG needs least) (half 40 % of rows, limit 4)"),
    ),
    "camera hangs": (
        "camera frozen",
        fault("VisionError: pair: frozen: the camera repeats its last frame (frozen 1 same pairs, limit 0)"),
    ),
    "camera knocked by much": (
        "camera knocked",
        fault("VisionError: pair: a camera was knocked: fasten it (knocked 9.1 px, limit 3.5)"),
    ),
    "camera drifts": ("camera knocked", fault("calibration: right camera pitched by +0.21 degrees against the left")),
    "camera knocked in mid-approach": ("camera knocked", cameras_do_not_meet),
    "camera knocked before the first look": ("camera knocked", cameras_never_meet),
    "camera suspect": ("camera knocked", suspect("camera")),
    "hand-eye knocked": ("hand-eye calibration off", suspect("hand-eye")),
    "hand-eye knocked, several tries": ("hand-eye calibration off", disagreeing_again),
    "arm's zero drifted": ("hand-eye calibration off", everything_moves),
    "hand-eye knocked, one part alone": ("hand-eye calibration off", suspect("unclear")),
    "hand-eye knocked, hand misses": ("hand-eye calibration off", missed("cube still lies there", chi2=80.0)),
    "part fell on the way to the bin": ("part slipped", released("empty", "unclear")),
    "part sticks to a finger": ("gripper does not open or close", released("part", "part")),
    "part out of the cameras' view above the bin": ("release not confirmed", released("unclear", "unclear")),
    "one part alone pushed": ("part moved", suspect("unclear", good=True)),
    "part pushed": ("part moved", suspect("part")),
    "part taken away": ("part moved", taken_away),
    "dirty lens": ("lens out of focus or dirty", measured({"focus left": FOCUS})),
    "dirty lens, looks that disagree": ("lens out of focus or dirty", blurred),
    "vibrating mount": ("blurred by motion", measured({"motion left": "left: blurred by motion"})),
    "dusk": ("too dark", measured({"darkness left": "left: too dark", "darkness right": "right: too dark"})),
    "sun": ("overexposed", measured({"saturation right": "right: too bright"})),
    "dark corner": ("too dark", nameless("dark")),
    "wrong part": ("not taught", nameless("strange")),
    "wrong part, seen from all round": ("not taught", another_part),
    "outlines, and no part": ("not found again", lost_among_outlines),
    "hidden part": ("hidden", nameless("hidden")),
    "part at the border": ("too near the border", nameless("border")),
    "two alike": ("looks like another", ended("ambiguous", "unknown: fits cube or pyramid: one square")),
    "patterned table with nothing on it": ("table too patterned", bare_patterned_table),
    "patterned table": ("table too patterned", nameless("patterned")),
    "slippery part": ("part slipped", missed("cube is gone, and the hand came back empty")),
    "part squirts away": ("part slipped", missed("cube still lies there", 11.0)),
    "slanted faces": ("part slipped", slanted),
    "only this part slips": ("part slipped", one_part_slips),
    "a part denied that was held": ("the look after the lift was wrong", look_errs()),
    "gripper does not open": ("gripper does not open or close", missed("cube: still lies there after 2 tries")),
    "hand went too early": ("estimate too uncertain", missed("cube still lies there", mm=2.1)),
    "estimate never good": ("estimate too uncertain", ended("unsure", "cube: 2.30 mm predicted after 8 looks")),
    "neighbours too near": (
        "blocked by a neighbour",
        ended("unreachable", "cube: none of its 12 grasps can be reached all the way (6 blocked by a neighbour)"),
    ),
    "out of reach": (
        "out of the arm's reach",
        ended("unreachable", "cube: none of its 12 grasps can be reached all the way (5 blocked by a neighbour)"),
    ),
    "too large to grasp": ("no grasp fits it", ended("unreachable", "cube: no grasp holds it as it lies")),
    "table height wrong": ("below the table", refused("below_table", "the tool would be 0.4 mm above the table")),
    "slow computer": ("a look too old", refused("stale_look", "the look behind it is 31.0 s old, 20 is the most")),
    "power cut": ("interrupted by a crash or power cut", cut_off),
}  # fmt: skip


@pytest.fixture
def made(tmp_path: Path) -> MadeRun:
    """Records only."""
    return MadeRun(tmp_path / "20260102T030405Z", pictures=False)


@pytest.mark.parametrize("planted", PLANTED)
def test_a_planted_cause_is_named_first(planted: str, made: MadeRun) -> None:
    name, plant = PLANTED[planted]
    plant(made)
    cycles = read_digest(made.close(1)).cycles
    cycle, run = cycles[-1], run_context(cycles)
    found = causes(cycle, run)
    assert found[0].code.summary == name, [(c.code.summary, round(c.weight, 2), c.evidence) for c in found]
    assert found[0].evidence
    assert len({c.code.summary for c in found}) == len(found)


PROSE = ("fault", "decision", "cycle_end")


def without_notes(record: dict[str, Any]) -> dict[str, Any]:
    scene = record.get("scene")
    return record if scene is None else {**record, "scene": {**scene, "notes": []}}


TOLD = yaml.safe_load((HOUSE / "tests/data/causes.yaml").read_text(encoding="utf-8"))
"""Every cause that is told of each, looked over line by line when it was written down."""


@pytest.mark.parametrize("planted", PLANTED)
def test_what_is_told_of_it_is_told_so_to_the_word(planted: str, made: MadeRun) -> None:
    PLANTED[planted][1](made)
    cycles = read_digest(made.close(1)).cycles
    cycle, run = cycles[-1], run_context(cycles)
    told = [f"{c.weight:.2f} {c.code.summary} (record {c.at}): {c.evidence}" for c in causes(cycle, run)]
    assert told == TOLD[planted]


@pytest.mark.parametrize("planted", PLANTED)
def test_the_codes_of_its_records_alone_say_so(planted: str, made: MadeRun) -> None:
    """Whatever its prose says: words belong to the catalogue, and may be written anew."""
    PLANTED[planted][1](made)
    records = read_run(made.close(1)).records
    mute = [{**r, **({"text": "x", "why": "x"} if r["kind"] in PROSE else {})} for r in map(without_notes, records)]
    after, before = digest("mute", mute).cycles, digest("told", records).cycles
    cycle, run = after[-1], run_context(after)
    codes = [(c.code, round(c.weight, 2), c.at) for c in causes(before[-1], run_context(before))]
    assert [(c.code, round(c.weight, 2), c.at) for c in causes(cycle, run)] == codes


@pytest.mark.parametrize("version", [1, VERSION])
@pytest.mark.parametrize("planted", PLANTED)
def test_a_week_counts_the_same_cause_of_it_as_its_own_page(planted: str, version: int, made: MadeRun) -> None:
    """Read in brief, a run had lost what its looks refused: a part that was not found again had moved."""
    PLANTED[planted][1](made)
    folder = made.close(version)
    assert production([read_brief(folder)])["stops"] == production([read_digest(folder)])["stops"]


def test_a_cause_and_a_measure_of_a_newer_release_are_told_as_far_as_they_are_known(made: MadeRun) -> None:
    nameless = part("unknown", cause="melted", reason="it has run into the table")
    made.cycle = 1
    made.write("cycle_start", cycle=1, target=None)
    made.look("survey", nameless)
    end(made, "unknown", "unknown: it has run into the table")
    made.cycle = 2
    made.write("cycle_start", cycle=2, target=None)
    end(made, "fault", "ImagesError: left: too blue: change the lamp (blueness 3, limit 2)")
    stranger, unfit = read_digest(made.close(1)).cycles
    assert [c.code.summary for c in causes(stranger)] == ["unknown cause"]
    assert [c.code.summary for c in causes(unfit)] == ["a fault in facetd"]


def test_a_cycle_that_is_still_going_on_is_not_said_to_have_been_killed(made: MadeRun) -> None:
    cut_off(made)
    made.log.settle()
    (cycle,) = read_digest(made.folder).cycles
    assert causes(cycle, going=True) == []
    made.close()


def test_a_refused_move_is_told_with_what_led_to_it(made: MadeRun) -> None:
    made.cycle = 1
    made.write("cycle_start", cycle=1, target="cube")
    made.write("move", cycle=1, how="joint", purpose="stand-off 300 mm", target=None, speed_pct=50.0)
    made.write("refusal", cycle=1, rule="below_table", text="the tool would be 3 mm above the table")
    end(made, "unreachable", "cube: the tool would be 3 mm above the table")
    events = [e for e in page_data(read_digest(made.close()))["events"] if e["kind"] == "refusal"]
    assert events[0]["after"] == "move stand-off 300 mm: joint move at 50 %"
    assert events[0]["cycle"] == 1


def test_a_picked_part_and_an_empty_table_need_no_cause(made: MadeRun) -> None:
    made.pick()
    made.pick("empty", why="nothing on the table")
    assert [causes(c) for c in read_digest(made.close()).cycles] == [[], []]


# What a person is told to do can be done.

REMEDIES = [
    *(cause.remedy for cause in CauseCode),
    *(said.remedy for said in ADVICE.values()),
    *(measure.advice for measure in MEASURES.values()),
]
CHOICES = {"calibrate": KINDS, "robot": ROBOT, "place": ACTS, "step": ("on", "off"), "go": ("home", "bin", "survey")}
SECTIONS = ("cameras", "arm", "pick", "vision", "files", "folders", "console", "log", "health", "metrics")


def test_no_advice_names_a_command_that_does_not_exist() -> None:
    known = {c.name: c for c in every_command()} | dict.fromkeys(OFFLINE)
    named = [words for advice in REMEDIES for words in re.findall(r"`([^`]+)`", advice)]
    assert len(named) > 20
    for words in named:
        first, *more = words.removeprefix("facetctl ").split()
        assert first in known, words
        if more:
            assert more[0] in CHOICES[first], words


def test_no_advice_names_a_key_that_does_not_exist() -> None:
    named = [key for advice in REMEDIES for key in re.findall(rf"\b(?:{'|'.join(SECTIONS)})(?:\.\w+)+", advice)]
    assert len(named) > 10
    for key in named:
        assert _is_key(key), key
    loose = {w for advice in REMEDIES for w in re.findall(r"(?<![\w.])[a-z]+_[a-z_]+\b", advice)}
    limits = {f.name for f in fields(get_type_hints(_kind("pick"))["limits"])}
    assert loose <= {*CONTROLS, *limits}


def _is_key(key: str) -> bool:
    section, *names = key.split(".")
    here: Any = {"cameras": CameraSettings}.get(section) or _kind(section)
    if key.startswith("arm.dialect."):
        here, names = Dialect, names[1:]
    for name in names:
        kinds = [hints for hints in map(get_type_hints, kinds_of(here).values()) if name in hints]
        if not kinds and (not is_dataclass(here) or name not in {f.name for f in fields(here)}):
            return False
        here = (kinds[0] if kinds else get_type_hints(here))[name]
    return True


def _kind(section: str) -> Any:
    """The dataclass of a section of facetd.yaml."""
    values = get_type_hints(Config)["values"]
    kind = get_type_hints(values)[section]
    return kind if is_dataclass(kind) else get_args(kind)[0]


ELSEWHERE, NOT_SEEN = "moved_between_looks", "not_seen_again"


@pytest.mark.parametrize(
    ("decisions", "named"),
    [
        ([("cube", ELSEWHERE)], None),
        ([("cube", ELSEWHERE), ("cube", ELSEWHERE)], "cube"),
        ([("cube", ELSEWHERE), ("pyramid", NOT_SEEN)], "cube, pyramid"),
        ([("cube", ELSEWHERE), ("cube", NOT_SEEN)], None),
        ([("cube", NOT_SEEN), ("pyramid", NOT_SEEN)], None),
        ([(None, ELSEWHERE), (None, ELSEWHERE)], ""),
        ([("cube", "chosen"), ("cube", ELSEWHERE)], None),
    ],
)
def test_the_hand_eye_is_blamed_where_parts_lie_otherwise_from_everywhere(
    decisions: list[tuple[str | None, str]], named: str | None
) -> None:
    records = [
        {"kind": "decision", "seq": 10 + k, "label": label, "code": code} for k, (label, code) in enumerate(decisions)
    ]
    cycle: Any = SimpleNamespace(of=lambda kind: records)
    blamed = [
        (cause.code.summary, cause.evidence.split(" seemed")[0], cause.at)
        for cause in all_seem_to_move(cycle, run_context([]))
    ]
    last = max((k for k, (_, code) in enumerate(decisions) if code == ELSEWHERE), default=0)
    assert blamed == ([] if named is None else [("hand-eye calibration off", named, 10 + last)])


def test_where_no_cause_is_known_the_end_of_the_pick_is_shown(made: MadeRun) -> None:
    made.pick("as nobody knows", why="")
    made.close()
    run = read_digest(made.folder)
    (cycle,) = run.cycles
    unknown = [cause for cause in causes(cycle) if cause.code.summary == "unknown cause"]
    assert [cause.at for cause in unknown] == [cycle.end["seq"]]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("SuspectError: looks 1 and 2 disagree", "looks 1 and 2 disagree"),
        ("looks 1 and 2 disagree: why?", "looks 1 and 2 disagree: why?"),
        ("an OSError: gone", "an OSError: gone"),
    ],
)
def test_a_class_of_the_program_is_nothing_to_tell_people(text: str, said: str) -> None:
    assert in_plain_words(text) == said


@pytest.mark.parametrize(
    ("again", "purpose", "why_not"),
    [
        ([part("cube"), STRANGER], "bin", "it lies there"),
        ([part("unknown")], "bin", "something lies there"),
        (
            [STRANGER, part("cube", cyclopean_from_part=frames.rigid(np.eye(3), np.array([200.0, 0, 0])).tolist())],
            "bin",
            "it was pushed",
        ),
        ([], "lift", "the hand did not open over the bin"),
    ],
)
def test_a_look_is_not_said_to_have_erred_where(
    again: list[dict[str, Any]], purpose: str, why_not: str, made: MadeRun
) -> None:
    look_errs(again, purpose)(made)
    (cycle,) = read_digest(made.close(1)).cycles
    assert picks_not_counted(cycle) == [], why_not
    assert "the look after the lift was wrong" not in [cause.code.summary for cause in causes(cycle)]


@pytest.mark.parametrize(("slant", "name"), [(10, "gripper does not open or close"), (11, "part slipped")])
def test_fingers_that_meet_a_part_no_more_than_ten_degrees_off_square_hold_it(
    slant: int, name: str, made: MadeRun
) -> None:
    missed("cube: still lies there after 2 tries")(made)
    (cycle,) = read_digest(made.close(1)).cycles
    decision = {"kind": "decision", "cycle": 1, "text": "pick", "code": "chosen", "slip_deg": slant + 0.4}
    assert causes(replace(cycle, records=(*cycle.records, decision)))[0].code.summary == name


def test_a_finding_is_told_by_its_advice_or_its_text_or_as_it_is() -> None:
    for finding in ({"advice": "clean it", "text": "dark"}, {"text": "clean it"}, {"advice": "clean it"}, "clean it"):
        assert text_of(finding) == "clean it"
    assert text_of({"px": 3}) == "{'px': 3}"


def test_pictures_are_hardly_to_blame_for_a_part_that_was_seen_and_cannot_be_reached(made: MadeRun) -> None:
    measured({"focus left": FOCUS})(made)
    made.cycle += 1
    made.write("cycle_start", cycle=made.cycle, target=None)
    made.look("survey", part("cube"), findings={"focus left": FOCUS})
    end(made, "unreachable", "cube: none of its 12 grasps can be reached all the way (6 blocked by a neighbour)")
    unseen, seen = (
        next(c.weight for c in causes(cycle) if c.code.summary == "lens out of focus or dirty")
        for cycle in read_digest(made.close(1)).cycles
    )
    assert unseen > 0.7
    assert 0.2 < seen <= 0.3


@pytest.mark.parametrize(
    ("finding", "value", "times"),
    [("focus left", 3.0, 2.0), ("focus left", 1.0, 1.0), ("darkness left", 60.0, 2.0), ("focus left", None, 1.0)],
)
def test_a_finding_goes_beyond_its_limit_or_counts_as_at_it(finding: str, value: float | None, times: float) -> None:
    assert times_its_limit({finding.replace(" ", "_"): value}, finding) == times


@pytest.mark.parametrize(("rejected", "bare"), [(7, True), (8, False)])
def test_a_table_with_eight_outlines_that_came_to_nothing_is_not_bare(rejected: int, bare: bool, made: MadeRun) -> None:
    taken_away(made)
    (cycle,) = read_digest(made.close(1)).cycles
    cycle.stops[-1].look["scene"]["rejected"] = [{"eye": "left", "reason": "small"}] * rejected
    assert any("the table is empty there" in cause.evidence for cause in causes(cycle)) is bare


def test_an_estimate_that_says_no_place_denies_nothing(made: MadeRun) -> None:
    look_errs()(made)
    records = read_run(made.close(1)).records
    (cycle,) = digest("r", [{k: v for k, v in r.items() if k != "world_from_part"} for r in records]).cycles
    assert picks_not_counted(cycle) == []


def test_a_night_of_misses_is_explained_in_time_that_grows_with_its_looks(made: MadeRun) -> None:
    """What every other look of the night named was asked anew of each miss."""
    for _ in range(20):
        made.look("survey", notes=[UNMATCHED])
    look = read_run(made.close()).records[-2]
    asked = Counter[str]()

    class Counted(dict[str, Any]):
        def get(self, key: str, default: Any = None) -> Any:
            asked[key] += 1
            return super().get(key, default)

    def asked_for(nights: int) -> int:
        records = [
            Counted({**look, "kind": kind, "seq": 3 * n + k, "cycle": n, "outcome": "unknown", "why": "no facet"})
            for n in range(nights)
            for k, kind in enumerate(("cycle_start", "look", "cycle_end"))
        ]
        cycles = digest("r", records).cycles
        asked.clear()
        for cycle in cycles:
            causes(cycle, run_context(cycles))
        return asked["scene"]

    assert asked_for(80) == 2 * asked_for(40)


@pytest.mark.parametrize("code", PLANNED)
def test_a_part_for_which_no_grasp_was_planned_has_the_planners_own_cause(made: MadeRun, code: CauseCode) -> None:
    """A part that no grasp brings to its place was said to be out of the arm's reach."""
    made.cycle += 1
    made.write("cycle_start", cycle=made.cycle, target=None)
    made.look("survey")
    made.write(
        "cycle_end", cycle=made.cycle, outcome="unreachable", code=code, label=None, stops=0, why="pyramid: none"
    )
    cycles = read_digest(made.close()).cycles
    cycle, run = cycles[-1], run_context(cycles)
    assert causes(cycle, run)[0].code is code
