"""Why a part was not picked: what the records say, by weight and time, and what to do about it.

Pure: one cycle in, and the others of its run to compare with; causes out. A rule reads one kind of evidence and says
how much of the miss it would explain (0 to 1). What ended the cycle in its own words weighs most; what was measured
before weighs more than what followed from it; what is said of other parts weighs nothing. Of equal weight the earlier
comes first: it may have brought about the other.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from daemon.events.codes import (
    BY_MEASURE,
    BY_RULE,
    BY_UNNAMED,
    MISSED_BY,
    CauseCode,
    DecisionCode,
    cause_code,
)
from daemon.events.outcomes import NOTHING_TO_PICK, UNFINISHED, Outcome, is_success
from daemon.events.records import Record
from daemon.pick.pose_fusion import CHI_SQUARE_6
from daemon.review.digest import Cycle, LookStep
from daemon.review.not_counted import not_counted_text, picks_not_counted
from daemon.vision.health import MEASURES

NOTHING_WRONG = NOTHING_TO_PICK | {Outcome.PICKED}
KNOWN_MM = 1.0
"""An estimate that was known to this is not what made the hand miss."""
SQUEEZED_OUT_MM = 10.0
"""Fingers that strike a part push it by less than it jumps from between them."""
SLANTED_DEG = 10.0
"""Fingers that meet a part so far off square hold it by friction alone."""
BLURRED, FAR_BEYOND = 0.8, 2.0
"""What pictures blurred by so many times the limit weigh where looks disagree for no reason that is known."""
OUTLINES = 4
"""So many outlines in each eye and no facet of them: the eyes do not fit one another."""


CLASS_ENDS = ("Error", "Refused", "Elsewhere")
"""Of the names of exceptions that a fault's text may begin with."""
WEIGHTS = {CauseCode.LOOKS_DISAGREE: 0.6, CauseCode.INTERNAL: 0.5}
"""Of a cause that a fault itself names, where it is not certain; else 1."""
UNNAMED = frozenset(BY_UNNAMED.values())


SUSPECTED: Mapping[str, tuple[CauseCode, float]] = {
    DecisionCode.SUSPECT_CAMERA: (CauseCode.CAMERA_KNOCKED, 0.9),
    DecisionCode.SUSPECT_HAND_EYE: (CauseCode.HAND_EYE, 0.9),
    DecisionCode.SUSPECT_PART: (CauseCode.PART_MOVED, 0.75),
}
SUSPICIONS = frozenset({*SUSPECTED, DecisionCode.SUSPECT_UNCLEAR})


@dataclass(frozen=True)
class LikelyCause:
    """A cause of the catalogue (daemon/events/codes.py) that a cycle's records speak for.

    weight: 0 to 1; evidence: what the records say; at: number of the record that says it.
    """

    code: CauseCode
    weight: float
    evidence: str
    at: int

    @property
    def name(self) -> str:
        """As the pages show it."""
        return self.code.summary

    @property
    def stage(self) -> str:
        """Where in the cell it is."""
        return self.code.stage

    @property
    def remedy(self) -> str:
        """What to do about it."""
        return self.code.remedy


def causes(cycle: Cycle, others: Sequence[Cycle] = (), going: bool = False) -> list[LikelyCause]:
    """Every cause that has evidence, each once, likeliest first; none for a part that was picked, a table that was
    empty, and a cycle that is still going on.

    others: the other cycles of the run; going: the run has not ended, and nothing says that it will not go on.
    """
    if cycle.outcome in NOTHING_WRONG or (cycle.end is None and going):
        return []
    found = sorted(
        (c for rule in RULES for c in rule(cycle, others)),
        key=lambda c: (-c.weight, c.at),
    )
    if not found:
        found = [LikelyCause(CauseCode.NOT_KNOWN, 0.1, str(cycle.why or cycle.outcome), _last(cycle))]
    first: dict[CauseCode, LikelyCause] = {}
    for cause in found:
        first.setdefault(cause.code, cause)
    return list(first.values())


def _ended(cycle: Cycle, _: Sequence[Cycle]) -> Iterator[LikelyCause]:
    """The first fault, or the end itself, by its code; a later fault follows from the first."""
    fault = next(iter(cycle.of("fault")), None)
    if fault is None and cycle.outcome not in (Outcome.FAULT, Outcome.ABORTED):
        return
    yield from causes_of_record(fault or cycle.end or {})


def causes_of_record(record: Record) -> Iterator[LikelyCause]:
    """What a fault, or the end of a cycle, is caused by, by its code and by the measures of the images it names."""
    evidence, at = in_plain_words(str(record.get("text") or record.get("why") or "")), _number(record)
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
    """What a record says, without the name of the program's own class that it begins with."""
    name, colon, words = text.partition(": ")
    return words if colon and name.isidentifier() and name.endswith(CLASS_ENDS) else text


def _refused(cycle: Cycle, _: Sequence[Cycle]) -> Iterator[LikelyCause]:
    """What the guard refused, and why a part was left as out of reach."""
    if cycle.outcome not in (Outcome.UNREACHABLE, Outcome.FAULT, UNFINISHED):
        return
    for record in cycle.of("refusal"):
        rule = str(record.get("rule"))
        if rule != "fault_stands":
            code = BY_RULE.get(rule, CauseCode.MOVE_REFUSED)
            yield LikelyCause(code, 0.9, f"{rule}: {record.get('text')}", _number(record))
    if cycle.outcome == Outcome.UNREACHABLE:
        planned = cycle.code in (CauseCode.NO_GRASP, CauseCode.BLOCKED, CauseCode.OUT_OF_REACH)
        code = cause_code(cycle.code) if planned else CauseCode.OUT_OF_REACH
        yield LikelyCause(code, 0.9 if planned else 0.6, str(cycle.why), _last(cycle))


def _geometry(cycle: Cycle, others: Sequence[Cycle]) -> Iterator[LikelyCause]:
    """Looks that disagree, and which of hand, eye and part is to blame for it."""
    for record in cycle.of("decision"):
        evidence, at = str(record.get("why")), _number(record)
        if blamed := SUSPECTED.get(str(record.get("code"))):
            yield LikelyCause(*blamed, evidence, at)
        elif record.get("code") == DecisionCode.SUSPECT_UNCLEAR:
            if any(is_success(other.outcome) for other in others):
                yield LikelyCause(CauseCode.PART_MOVED, 0.7, f"{evidence}; other picks of this run went well", at)
            else:
                yield LikelyCause(CauseCode.HAND_EYE, 0.7, f"{evidence}; nothing was picked in this run", at)
    again = [r for r in cycle.of("decision") if r.get("code") in SUSPICIONS and r.get("chi2") is not None]
    if len(again) > 1:
        evidence = f"{again[0]['why']}; and so {len(again)} times, whatever was approached"
        yield LikelyCause(CauseCode.HAND_EYE, 0.85, evidence, _number(again[1]))
    for stop in cycle.stops:
        chi2 = float((stop.estimate or {}).get("chi2") or 0)
        if chi2 > CHI_SQUARE_6:
            evidence = f"look {stop.number} disagrees with those before (chi-square {chi2:.0f} of {CHI_SQUARE_6:.0f})"
            code = CauseCode.HAND_EYE if cycle.outcome == Outcome.MISSED else CauseCode.LOOKS_DISAGREE
            yield LikelyCause(code, 0.75, evidence, _seq(stop))


def _all_moves(cycle: Cycle, _: Sequence[Cycle]) -> Iterator[LikelyCause]:
    """Not one part but several, or one again and again, lie otherwise whenever the arm looks from elsewhere."""
    otherwise = (DecisionCode.MOVED_BETWEEN_LOOKS, DecisionCode.NOT_SEEN_AGAIN)
    shifted = [r for r in cycle.of("decision") if r.get("code") in otherwise]
    parts = {str(r["label"]) for r in shifted if r.get("label")}
    again = [r for r in shifted if r["code"] == DecisionCode.MOVED_BETWEEN_LOOKS]
    if len(again) > 1 or (again and len(parts) > 1):
        evidence = (
            f"{', '.join(sorted(parts))} lay otherwise each time the arm looked from elsewhere ({len(shifted)} times)"
        )
        yield LikelyCause(CauseCode.HAND_EYE, 0.85, evidence, _number(again[-1]))


def _eyes_apart(cycle: Cycle, others: Sequence[Cycle]) -> Iterator[LikelyCause]:
    """Both eyes see outlines and they do not meet, although they did before; those of a pattern need not."""
    patterned = sum(map(_patterned, cycle.stops))
    unmatched = [s for s in cycle.stops if _outlines_of(s) >= OUTLINES and not _patterned(s)]
    if patterned and not unmatched and cycle.code == CauseCode.UNMATCHED_OUTLINES:
        evidence = f"{patterned} looks: nothing there, or nothing to be told from the table's pattern"
        yield LikelyCause(CauseCode.PATTERNED_TABLE, 0.7, evidence, _last(cycle))
    if not unmatched:
        return
    met = sum(c.named_looks for c in (cycle, *others))
    evidence = f"{len(unmatched)} looks saw outlines in both eyes that do not fit one another"
    share = len(unmatched) / len(cycle.stops)
    if met and (len(unmatched) > 1 or share == 1.0):
        yield LikelyCause(CauseCode.CAMERA_KNOCKED, 0.8, f"{evidence}, and {met} saw parts", _seq(unmatched[0]))
    elif cycle.code == CauseCode.UNMATCHED_OUTLINES:
        yield LikelyCause(CauseCode.CAMERA_KNOCKED, 0.7, str(cycle.why), _seq(unmatched[0]))


def _images(cycle: Cycle, _: Sequence[Cycle]) -> Iterator[LikelyCause]:
    """What was measured of the pictures and beyond its limit: the more looks, the more it explains."""
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
            first.setdefault(code, (_text(health["findings"][keys[0]]), _seq(stop)))
            beyond[code] = max(beyond.get(code, 1.0), *(_beyond(health, key) for key in keys))
    # A part that was seen and lost otherwise was seen by these very pictures.
    most = {"missed": 0.5, "unreachable": 0.3, "aborted": 0.2, "fault": 0.6}.get(cycle.outcome, 0.95)
    unclear = any(r.get("code") == DecisionCode.SUSPECT_UNCLEAR for r in cycle.of("decision"))
    for code, count in shown.items():
        share = count / len(cycle.stops)
        text, at = first[code]
        evidence = f"{count} of {len(cycle.stops)} looks: {text}"
        # Looks that disagree, and no part's fault: pictures so blurred measure badly, wherever the hand is.
        blurred = unclear and code is CauseCode.OUT_OF_FOCUS and beyond[code] > FAR_BEYOND
        weight = (BLURRED if blurred else most) * (0.5 + 0.5 * share)
        yield LikelyCause(code, weight * (1.0 - 0.001 / beyond[code]), evidence, at)


def _beyond(health: Mapping[str, Any], finding: str) -> float:
    """How many times its limit a measure (`focus left`) is; 1 where it is not known, or too little is what is wrong."""
    value, limit = health.get(finding.replace(" ", "_")), MEASURES[finding.split()[0]].limit
    return max(1.0, value / limit) if isinstance(value, (int, float)) and limit > 0.0 else 1.0


def _text(finding: Any) -> str:
    return str(finding.get("advice") or finding.get("text") or finding) if isinstance(finding, dict) else str(finding)


def _unnamed(cycle: Cycle, _: Sequence[Cycle]) -> Iterator[LikelyCause]:
    """Why what lies there has no name, in the words of the end; where it was about a part with a name, nothing."""
    why = str(cycle.why or "")
    if cycle.outcome == Outcome.AMBIGUOUS:
        yield LikelyCause(CauseCode.ALIKE, 0.7, why, _last(cycle))
    elif cycle.outcome == Outcome.UNKNOWN:
        seen = [p.get("cause") for s in cycle.stops for p in s.parts if p.get("label") == "unknown" and p.get("cause")]
        most = [BY_UNNAMED[str(name)] for name, _ in Counter(seen).most_common(1) if name in BY_UNNAMED]
        for code in [cause_code(cycle.code)] if cycle.code in UNNAMED else most:
            yield LikelyCause(code, 0.7, why, _last(cycle))


def _lost(cycle: Cycle, _: Sequence[Cycle]) -> Iterator[LikelyCause]:
    """It was seen, and then it was not."""
    if cycle.outcome != Outcome.LOST:
        return
    bare = [s for s in cycle.stops if s.purpose != "survey" and not s.parts]
    if bare and all(_outlines_of(s) < OUTLINES and len(_rejected(s)) < 2 * OUTLINES for s in bare):
        yield LikelyCause(CauseCode.PART_MOVED, 0.75, f"{cycle.why}; the table is bare there", _seq(bare[0]))
    elif any(
        p.get("label") == cycle.label
        for s in cycle.stops
        if s.purpose == "approach" and not s.estimate
        for p in s.parts
    ):
        yield LikelyCause(CauseCode.PART_MOVED, 0.75, f"{cycle.why}; it is seen elsewhere", _last(cycle))
    elif cycle.code == DecisionCode.MOVED_BETWEEN_LOOKS:
        yield LikelyCause(CauseCode.PART_MOVED, 0.7, str(cycle.why), _last(cycle))
    else:
        yield LikelyCause(CauseCode.NOT_FOUND_AGAIN, 0.4, str(cycle.why), _last(cycle))


def _missed(cycle: Cycle, others: Sequence[Cycle]) -> Iterator[LikelyCause]:
    """The hand closed, and it is not in it: how it was grasped, and where it lies now, tell what became of it."""
    tries = [r for r in cycle.of("decision") if r.get("code") in MISSED_BY]
    if cycle.outcome != Outcome.MISSED and not tries:
        return
    # What it is taken for after it was knocked about follows from the miss.
    weight = 0.6 if cycle.outcome == Outcome.MISSED else 0.75
    verify = [s for s in cycle.stops if s.purpose == "verify"]
    moved = None if not verify else _moved_mm(cycle, verify[-1])
    at = _seq(verify[0]) if verify else _last(cycle)
    witness = (
        "" if cycle.true_mm is None else f"; the simulated cell's witness has the grasp {cycle.true_mm:.1f} mm off"
    )
    last: Record = tries[-1] if tries else cycle.end or {}
    why = str(last.get("why"))
    lies = "" if moved is None else f", {moved:.1f} mm from where it lay"
    slant = round(max((float(r.get("slip_deg") or 0.0) for r in cycle.of("decision")), default=0.0))
    held = sorted({str(c.label) for c in others if is_success(c.outcome)})
    let_slip = last.get("code") in (DecisionCode.CAME_BACK_EMPTY, DecisionCode.KNOCKED_AWAY)
    if erred := picks_not_counted(cycle):
        yield LikelyCause(CauseCode.LOOK_AFTER_LIFT, 0.95, f"{not_counted_text(erred[-1])}{witness}", at)
    elif let_slip or (moved or 0.0) > SQUEEZED_OUT_MM:
        yield LikelyCause(CauseCode.PART_SLIPPED, weight + 0.05, f"{why}{lies}{witness}", at)
    elif slant > SLANTED_DEG:
        evidence = f"{why}{lies}: the fingers met it {slant:.0f} degrees off square{witness}"
        yield LikelyCause(CauseCode.PART_SLIPPED, weight + 0.05, evidence, at)
    elif held and cycle.label not in {c.label for c in others if is_success(c.outcome)}:
        evidence = f"{why}{lies}, and {', '.join(held)} was held{witness}"
        yield LikelyCause(CauseCode.PART_SLIPPED, weight, evidence, at)
    else:
        yield LikelyCause(CauseCode.GRIPPER, weight, f"the hand closed, and {why}{lies}{witness}", at)


def _moved_mm(cycle: Cycle, after: LookStep) -> float | None:
    """How far the part that was grasped for lies from where it was last thought to."""
    estimates = [s.estimate for s in cycle.stops if s.estimate and _seq(s) < _seq(after)]
    world_from_cyclopean = after.look.get("world_from_cyclopean")
    same = [p for p in after.parts if p.get("label") == cycle.label and p.get("cyclopean_from_part")]
    if not (estimates and same and world_from_cyclopean and estimates[-1].get("world_from_part")):
        return None
    before = np.array(estimates[-1]["world_from_part"], float)[:3, 3]
    places = [(np.array(world_from_cyclopean) @ np.array(p["cyclopean_from_part"]))[:3, 3] for p in same]
    return float(min(np.linalg.norm(place - before) for place in places))


def _released(cycle: Cycle, _: Sequence[Cycle]) -> Iterator[LikelyCause]:
    """The gripper opened above the bin, and what it showed there does not prove that the part fell in."""
    if cycle.outcome != Outcome.RELEASED:
        return
    for record in cycle.of("release"):
        slipped, stuck = record.get("above") == "empty", record.get("opened") == "part"
        code = CauseCode.PART_SLIPPED if slipped else CauseCode.RELEASE_UNCONFIRMED
        yield LikelyCause(CauseCode.GRIPPER if stuck else code, 0.8, str(cycle.why), _number(record))


def _uncertain(cycle: Cycle, _: Sequence[Cycle]) -> Iterator[LikelyCause]:
    """It was never known well enough, or the hand went for it although it was not."""
    last = next((s for s in reversed(cycle.stops) if s.estimate), None)
    if last is None or last.estimate is None or cycle.outcome not in ("unsure", "missed"):
        return
    predicted = float(last.estimate.get("predicted_mm") or 0)
    if cycle.outcome == "unsure" or predicted > KNOWN_MM:
        evidence = f"the last estimate was known to {predicted:.1f} mm only"
        yield LikelyCause(CauseCode.UNCERTAIN, 0.7, evidence, _seq(last))


def _cut_off(cycle: Cycle, _: Sequence[Cycle]) -> Iterator[LikelyCause]:
    """The run ends in the middle of it."""
    if cycle.end is None and not cycle.of("fault"):
        evidence = f"the run ends in the middle of the cycle, after `{cycle.records[-1]['kind']}`"
        yield LikelyCause(CauseCode.CUT_OFF, 0.95, evidence, _last(cycle))


def _outlines_of(stop: LookStep) -> int:
    """How many outlines each camera saw at least, where no facet was made of them."""
    unmatched = (stop.look.get("scene") or {}).get("unmatched")
    return min(unmatched) if unmatched else 0


def _patterned(stop: LookStep) -> bool:
    """Whether its outlines are the table's pattern, and the eyes were measured to stand as calibrated."""
    knocked_px = (stop.look.get("health") or {}).get("knocked_pair")
    stands = isinstance(knocked_px, float) and knocked_px < MEASURES["knocked"].limit
    return stands and (stop.look.get("scene") or {}).get("nothing") == "patterned"


def _rejected(stop: LookStep) -> Sequence[Any]:
    rejected: Sequence[Any] = (stop.look.get("scene") or {}).get("rejected") or []
    return rejected


def _number(record: Record) -> int:
    """Of a record in its run."""
    return int(record.get("seq") or 0)


def _seq(stop: LookStep) -> int:
    return _number(stop.look)


def _last(cycle: Cycle) -> int:
    return _number(cycle.records[-1])


Rule = Callable[[Cycle, Sequence[Cycle]], Iterator[LikelyCause]]
RULES: tuple[Rule, ...] = (
    _ended, _refused, _geometry, _all_moves, _eyes_apart, _images, _unnamed, _lost, _missed, _released, _uncertain,
    _cut_off,
)  # fmt: skip
