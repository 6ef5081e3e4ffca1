"""Why a part was not picked: likely causes from the records of a cycle, by weight, each with its remedy. Pure.

Each rule reads one kind of evidence and weighs how much of the failure it would explain (0 to 1). The recorded end of
the cycle weighs most; measures from before weigh more than consequences; other parts weigh nothing. Of equal weights
the earlier record comes first: it may have caused the other.
"""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from daemon.events.codes import BY_MEASURE, BY_RULE, BY_UNNAMED, MISSED_BY, CauseCode, DecisionCode, cause_code
from daemon.events.outcomes import NOTHING_TO_PICK, UNFINISHED, Outcome, is_success
from daemon.events.records import Record
from daemon.pick.pose_fusion import CHI_SQUARE_6
from daemon.review.digest import Cycle, LookStep, place_mm, seq_of
from daemon.review.not_counted import not_counted_text, picks_not_counted
from daemon.vision.health import MEASURES

NOTHING_WRONG = NOTHING_TO_PICK | {Outcome.PICKED}
CERTAIN_MM = 1.0
"""An estimate this certain did not cause a miss."""
SQUEEZED_OUT_MM = 10.0
"""A part squeezed out between the fingers jumps farther than one that they push."""
SLANTED_DEG = 10.0
"""Fingers this far off square hold a part by friction only."""
BLURRED, FAR_BEYOND = 0.8, 2.0
"""Weight of images blurred beyond so many times the limit, where looks disagree for no other reason."""
OUTLINES = 4
"""Least number of outlines in each image without a facet at which the cameras do not fit each other."""


CLASS_ENDS = ("Error", "Refused", "Elsewhere")
"""Ends of the class names with which a fault's text may begin."""
WEIGHTS = {CauseCode.LOOKS_DISAGREE: 0.6, CauseCode.INTERNAL: 0.5}
"""Weights of causes that a fault names without certainty; of any other: 1."""
UNNAMED = frozenset(BY_UNNAMED.values())


SUSPECTED: Mapping[str, tuple[CauseCode, float]] = {
    DecisionCode.SUSPECT_CAMERA: (CauseCode.CAMERA_KNOCKED, 0.9),
    DecisionCode.SUSPECT_HAND_EYE: (CauseCode.HAND_EYE, 0.9),
    DecisionCode.SUSPECT_PART: (CauseCode.PART_MOVED, 0.75),
}
SUSPICIONS = frozenset({*SUSPECTED, DecisionCode.SUSPECT_UNCLEAR})


@dataclass(frozen=True)
class LikelyCause:
    """A cause with evidence in a cycle's records. weight: 0 to 1; at: number of the record."""

    code: CauseCode
    weight: float
    evidence: str
    at: int


class RunContext(NamedTuple):
    """What the cycles of a run say about a failed one: labels that were picked; looks that named a part."""

    picked: frozenset[str]
    named_looks: int


def run_context(cycles: Sequence[Cycle]) -> RunContext:
    """What all cycles of a run say about each of them."""
    picked = frozenset(str(c.label) for c in cycles if is_success(c.outcome))
    return RunContext(picked, sum(c.named_looks for c in cycles))


def causes(cycle: Cycle, run: RunContext | None = None, going: bool = False) -> list[LikelyCause]:
    """The causes with evidence, likeliest first; none for a picked part, an empty table, or a cycle in progress. Where
    something stopped the arm after that, that alone.

    run: `run_context` of all its cycles, None where it is the only one; going: the run is still being written.
    """
    run = run or run_context([cycle])
    if cycle.end is None and going:
        return []
    if cycle.outcome in NOTHING_WRONG:
        return [*_ended(cycle, run)] if cycle.stopped else []
    found = sorted((c for rule in RULES for c in rule(cycle, run)), key=lambda c: (-c.weight, c.at))
    if not found:
        found = [LikelyCause(CauseCode.NOT_KNOWN, 0.1, str(cycle.why or cycle.outcome), _last(cycle))]
    first: dict[CauseCode, LikelyCause] = {}
    for cause in found:
        first.setdefault(cause.code, cause)
    return list(first.values())


def _ended(cycle: Cycle, _: RunContext) -> Iterator[LikelyCause]:
    """The first fault, or the recorded end, by its code; later faults follow from the first."""
    fault = next(iter(cycle.of("fault")), None)
    if fault is None and cycle.outcome not in (Outcome.FAULT, Outcome.ABORTED) and cycle.stopped is None:
        return
    end = cycle.end or {}
    yield from causes_of_record(fault or {**end, "code": cycle.stopped or cycle.code})


def causes_of_record(record: Record) -> Iterator[LikelyCause]:
    """The causes of a fault, or of the end of a cycle, by its code or by the measures of images that it names."""
    evidence, at = in_plain_words(str(record.get("text") or record.get("why") or "")), seq_of(record)
    cameras: dict[str, set[str]] = {}
    for finding in record.get("findings") or []:
        measure, _, camera = finding.partition(" ")
        cameras.setdefault(measure, set()).add(camera)
    for measure, which in cameras.items():
        both_dark = measure == "covered" and len(which) == 2
        code = CauseCode.LIGHT_OFF if both_dark else BY_MEASURE.get(measure, CauseCode.INTERNAL)
        yield LikelyCause(code, WEIGHTS[code] if code is CauseCode.INTERNAL else 1.0, evidence, at)
    if not cameras:
        code = cause_code(record.get("code"))
        yield LikelyCause(code, WEIGHTS.get(code, 1.0), evidence, at)


def in_plain_words(text: str) -> str:
    """The text of a record without a leading class name of the program."""
    name, colon, words = text.partition(": ")
    return words if colon and name.isidentifier() and name.endswith(CLASS_ENDS) else text


PLANNED = (CauseCode.NO_GRASP, CauseCode.BLOCKED, CauseCode.OUT_OF_REACH, CauseCode.NO_WAY_TO_PLACE)
"""Why no grasp was planned, as the planner says."""


def _refused(cycle: Cycle, _: RunContext) -> Iterator[LikelyCause]:
    """Find what the guard refused, and why a part was unreachable."""
    if cycle.outcome not in (Outcome.UNREACHABLE, Outcome.FAULT, UNFINISHED):
        return
    for record in cycle.of("refusal"):
        rule = str(record.get("rule"))
        if rule != "fault_active":
            code = BY_RULE.get(rule, CauseCode.MOVE_REFUSED)
            yield LikelyCause(code, 0.9, f"{rule}: {record.get('text')}", seq_of(record))
    if cycle.outcome == Outcome.UNREACHABLE:
        planned = cycle.code in PLANNED
        code = cause_code(cycle.code) if planned else CauseCode.OUT_OF_REACH
        yield LikelyCause(code, 0.9 if planned else 0.6, str(cycle.why), _last(cycle))


def _geometry(cycle: Cycle, run: RunContext) -> Iterator[LikelyCause]:
    """Looks that disagree: whether the hand-eye, a camera or the part is the cause."""
    for record in cycle.of("decision"):
        evidence, at = str(record.get("why")), seq_of(record)
        if blamed := SUSPECTED.get(str(record.get("code"))):
            yield LikelyCause(*blamed, evidence, at)
        elif record.get("code") == DecisionCode.SUSPECT_UNCLEAR:
            if run.picked:
                yield LikelyCause(CauseCode.PART_MOVED, 0.7, f"{evidence}; other picks of this run went well", at)
            else:
                yield LikelyCause(CauseCode.HAND_EYE, 0.7, f"{evidence}; nothing was picked in this run", at)
    again = [r for r in cycle.of("decision") if r.get("code") in SUSPICIONS and r.get("chi2") is not None]
    if len(again) > 1:
        evidence = f"{again[0]['why']}; the same {len(again)} times, for every part"
        yield LikelyCause(CauseCode.HAND_EYE, 0.85, evidence, seq_of(again[1]))
    for stop in cycle.stops:
        chi2 = float((stop.estimate or {}).get("chi2") or 0)
        if chi2 > CHI_SQUARE_6:
            evidence = f"look {stop.number} disagrees with those before (chi-square {chi2:.0f} of {CHI_SQUARE_6:.0f})"
            code = CauseCode.HAND_EYE if cycle.outcome == Outcome.MISSED else CauseCode.LOOKS_DISAGREE
            yield LikelyCause(code, 0.75, evidence, stop.seq)


def all_seem_to_move(cycle: Cycle, _: RunContext) -> Iterator[LikelyCause]:
    """Several parts, or one repeatedly, seem to move whenever the arm looks from another place."""
    otherwise = (DecisionCode.MOVED_BETWEEN_LOOKS, DecisionCode.NOT_SEEN_AGAIN)
    shifted = [r for r in cycle.of("decision") if r.get("code") in otherwise]
    parts = {str(r["label"]) for r in shifted if r.get("label")}
    again = [r for r in shifted if r["code"] == DecisionCode.MOVED_BETWEEN_LOOKS]
    if len(again) > 1 or (again and len(parts) > 1):
        elsewhere = f"seemed to be elsewhere in each look from a new viewpoint ({len(shifted)} times)"
        evidence = f"{', '.join(sorted(parts))} {elsewhere}"
        yield LikelyCause(CauseCode.HAND_EYE, 0.85, evidence, seq_of(again[-1]))


def _cameras_disagree(cycle: Cycle, run: RunContext) -> Iterator[LikelyCause]:
    """Find outlines of both cameras that do not match, although they did before; a table's pattern need not match."""
    patterned = sum(map(_patterned, cycle.stops))
    unmatched = [s for s in cycle.stops if _outlines_of(s) >= OUTLINES and not _patterned(s)]
    if patterned and not unmatched and cycle.code == CauseCode.UNMATCHED_OUTLINES:
        evidence = f"{patterned} looks: nothing distinguishable from the table's pattern"
        yield LikelyCause(CauseCode.PATTERNED_TABLE, 0.7, evidence, _last(cycle))
    if not unmatched:
        return
    evidence = f"{len(unmatched)} looks have outlines in both images that do not match"
    share, at = len(unmatched) / len(cycle.stops), unmatched[0].seq
    if run.named_looks and (len(unmatched) > 1 or share == 1.0):
        yield LikelyCause(CauseCode.CAMERA_KNOCKED, 0.8, f"{evidence}, and {run.named_looks} looks found parts", at)
    elif cycle.code == CauseCode.UNMATCHED_OUTLINES:
        yield LikelyCause(CauseCode.CAMERA_KNOCKED, 0.7, str(cycle.why), at)


def _images(cycle: Cycle, _: RunContext) -> Iterator[LikelyCause]:
    """Measures of the images beyond their limits: the more looks have them, the more they explain."""
    shown: Counter[CauseCode] = Counter()
    first: dict[CauseCode, tuple[str, int]] = {}
    beyond: dict[CauseCode, float] = {}
    for stop in cycle.stops:
        health = stop.look.get("health") or {}
        found: dict[CauseCode, list[str]] = {}
        for key in health.get("findings") or {}:
            if code := BY_MEASURE.get(key.split()[0]):
                found.setdefault(code, []).append(key)
        for code, keys in found.items():
            shown[code] += 1
            first.setdefault(code, (text_of(health["findings"][keys[0]]), stop.seq))
            beyond[code] = max(beyond.get(code, 1.0), *(times_its_limit(health, key) for key in keys))
    # A part that was found and then lost was found in these same images.
    most = {"missed": 0.5, "unreachable": 0.3, "aborted": 0.2, "fault": 0.6}.get(cycle.outcome, 0.95)
    unclear = any(r.get("code") == DecisionCode.SUSPECT_UNCLEAR for r in cycle.of("decision"))
    for code, count in shown.items():
        share = count / len(cycle.stops)
        text, at = first[code]
        evidence = f"{count} of {len(cycle.stops)} looks: {text}"
        # Looks disagree without a suspect: images this blurred measure badly from everywhere.
        blurred = unclear and code is CauseCode.OUT_OF_FOCUS and beyond[code] > FAR_BEYOND
        weight = (BLURRED if blurred else most) * (0.5 + 0.5 * share)
        yield LikelyCause(code, weight * (1.0 - 0.001 / beyond[code]), evidence, at)


def times_its_limit(health: Mapping[str, Any], finding: str) -> float:
    """A measure (`focus left`) as a multiple of its limit; 1 where it is absent, or where its limit is a minimum."""
    value, limit = health.get(finding.replace(" ", "_")), MEASURES[finding.split()[0]].limit
    return max(1.0, value / limit) if isinstance(value, (int, float)) and limit > 0.0 else 1.0


def text_of(finding: Any) -> str:
    """The text of a finding, as a record keeps it: the advice, or else the finding itself."""
    return str(finding.get("advice") or finding.get("text") or finding) if isinstance(finding, dict) else str(finding)


def _unnamed(cycle: Cycle, _: RunContext) -> Iterator[LikelyCause]:
    """Why a part has no name, from the recorded end of the cycle; nothing for a named part."""
    why = str(cycle.why or "")
    if cycle.outcome == Outcome.AMBIGUOUS:
        yield LikelyCause(CauseCode.ALIKE, 0.7, why, _last(cycle))
    elif cycle.outcome == Outcome.UNKNOWN:
        seen = [p.get("cause") for s in cycle.stops for p in s.parts if p.get("label") == "unknown" and p.get("cause")]
        most = [BY_UNNAMED[str(name)] for name, _ in Counter(seen).most_common(1) if name in BY_UNNAMED]
        for code in [cause_code(cycle.code)] if cycle.code in UNNAMED else most:
            yield LikelyCause(code, 0.7, why, _last(cycle))


def _lost(cycle: Cycle, _: RunContext) -> Iterator[LikelyCause]:
    """The part was found, and then no longer."""
    if cycle.outcome != Outcome.LOST:
        return
    bare = [s for s in cycle.stops if s.purpose != "survey" and not s.parts]
    if bare and all(_outlines_of(s) < OUTLINES and len(s.scene.get("rejected") or []) < 2 * OUTLINES for s in bare):
        yield LikelyCause(CauseCode.PART_MOVED, 0.75, f"{cycle.why}; the table is empty there", bare[0].seq)
    elif any(
        p.get("label") == cycle.label
        for s in cycle.stops
        if s.purpose == "approach" and not s.estimate
        for p in s.parts
    ):
        yield LikelyCause(CauseCode.PART_MOVED, 0.75, f"{cycle.why}; it is seen at another place", _last(cycle))
    elif cycle.code == DecisionCode.MOVED_BETWEEN_LOOKS:
        yield LikelyCause(CauseCode.PART_MOVED, 0.7, str(cycle.why), _last(cycle))
    else:
        yield LikelyCause(CauseCode.NOT_FOUND_AGAIN, 0.4, str(cycle.why), _last(cycle))


def _missed(cycle: Cycle, run: RunContext) -> Iterator[LikelyCause]:
    """The gripper closed without the part: how it was grasped, and where it is now, indicate the cause."""
    tries = [r for r in cycle.of("decision") if r.get("code") in MISSED_BY]
    if cycle.outcome != Outcome.MISSED and not tries:
        return
    # What the part is recognised as afterwards is a consequence of the miss.
    weight = 0.6 if cycle.outcome == Outcome.MISSED else 0.75
    verify = [s for s in cycle.stops if s.purpose == "verify"]
    moved = None if not verify else _moved_mm(cycle, verify[-1])
    at = verify[0].seq if verify else _last(cycle)
    true = "" if cycle.true_mm is None else f"; the true error was {cycle.true_mm:.1f} mm"
    last: Record = tries[-1] if tries else cycle.end or {}
    why = str(last.get("why"))
    away = "" if moved is None else f", {moved:.1f} mm from its place"
    slant = round(max((float(r.get("slip_deg") or 0.0) for r in cycle.of("decision")), default=0.0))
    let_slip = last.get("code") in (DecisionCode.CAME_BACK_EMPTY, DecisionCode.KNOCKED_AWAY)
    if erred := picks_not_counted(cycle):
        yield LikelyCause(CauseCode.LOOK_AFTER_LIFT, 0.95, f"{not_counted_text(erred[-1])}{true}", at)
    elif let_slip or (moved or 0.0) > SQUEEZED_OUT_MM:
        yield LikelyCause(CauseCode.PART_SLIPPED, weight + 0.05, f"{why}{away}{true}", at)
    elif slant > SLANTED_DEG:
        evidence = f"{why}{away}: the fingers touched it {slant:.0f} degrees off perpendicular{true}"
        yield LikelyCause(CauseCode.PART_SLIPPED, weight + 0.05, evidence, at)
    elif run.picked and cycle.label not in run.picked:
        evidence = f"{why}{away}, and the gripper held {', '.join(sorted(run.picked))}{true}"
        yield LikelyCause(CauseCode.PART_SLIPPED, weight, evidence, at)
    else:
        yield LikelyCause(CauseCode.GRIPPER, weight, f"the gripper closed, and {why}{away}{true}", at)


def _moved_mm(cycle: Cycle, after: LookStep) -> float | None:
    """Distance of the chosen part from its last estimated place, mm."""
    estimates = [s.estimate for s in cycle.stops if s.estimate and s.seq < after.seq]
    same = [place_mm(part, after.look) for part in after.parts if part.get("label") == cycle.label]
    places = [place for place in same if place is not None]
    if not (estimates and places and estimates[-1].get("world_from_part")):
        return None
    before = np.array(estimates[-1]["world_from_part"], float)[:3, 3]
    return float(min(np.linalg.norm(place - before) for place in places))


def _released(cycle: Cycle, _: RunContext) -> Iterator[LikelyCause]:
    """The gripper opened above the bin, and the images there do not prove that the part fell in."""
    if cycle.outcome != Outcome.RELEASED:
        return
    for record in cycle.of("release"):
        slipped, stuck = record.get("above") == "empty", record.get("opened") == "part"
        code = CauseCode.PART_SLIPPED if slipped else CauseCode.RELEASE_UNCONFIRMED
        yield LikelyCause(CauseCode.GRIPPER if stuck else code, 0.8, str(cycle.why), seq_of(record))


def _uncertain(cycle: Cycle, _: RunContext) -> Iterator[LikelyCause]:
    """The estimate stayed too uncertain, or the grasp was tried in spite of it."""
    last = next((s for s in reversed(cycle.stops) if s.estimate), None)
    if last is None or last.estimate is None or cycle.outcome not in ("unsure", "missed"):
        return
    predicted = float(last.estimate.get("predicted_mm") or 0)
    if cycle.outcome == "unsure" or predicted > CERTAIN_MM:
        evidence = f"the last estimate had an expected error of {predicted:.1f} mm"
        yield LikelyCause(CauseCode.UNCERTAIN, 0.7, evidence, last.seq)


def _run_cut_off(cycle: Cycle, _: RunContext) -> Iterator[LikelyCause]:
    if cycle.end is None and not cycle.of("fault"):
        evidence = f"the run ends during the cycle, after `{cycle.records[-1]['kind']}`"
        yield LikelyCause(CauseCode.CUT_OFF, 0.95, evidence, _last(cycle))


def _outlines_of(stop: LookStep) -> int:
    """Number of outlines that each camera saw at least, where none became a facet."""
    unmatched = stop.scene.get("unmatched")
    return min(unmatched) if unmatched else 0


def _patterned(stop: LookStep) -> bool:
    """Whether the outlines are the table's pattern, with the cameras measured to be as calibrated."""
    knocked_px = (stop.look.get("health") or {}).get("knocked_pair")
    as_calibrated = isinstance(knocked_px, float) and knocked_px < MEASURES["knocked"].limit
    return as_calibrated and stop.scene.get("nothing") == "patterned"


def _last(cycle: Cycle) -> int:
    return seq_of(cycle.records[-1])


Rule = Callable[[Cycle, RunContext], Iterator[LikelyCause]]
RULES: tuple[Rule, ...] = (
    _ended, _refused, _geometry, all_seem_to_move, _cameras_disagree, _images, _unnamed, _lost, _missed, _released,
    _uncertain, _run_cut_off,
)  # fmt: skip
