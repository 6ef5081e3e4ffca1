"""Why a part was not picked: what the records say, by weight and time, and what to do about it.

Pure: one cycle in, and the others of its run to compare with; causes out. A rule reads one kind of evidence and says
how much of the miss it would explain (0 to 1). What ended the cycle in its own words weighs most; what was measured
before weighs more than what followed from it; what is said of other parts weighs nothing. Of equal weight the earlier
comes first: it may have brought about the other.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from daemon.pick.pose_fusion import CHI_SQUARE_6
from daemon.review.denied import denied, told_of
from daemon.review.digest import Cycle, Stop
from daemon.review.remedies import KNOWN
from daemon.store.records import Record
from daemon.vision.health import MEASURES, SAID
from daemon.vision.values import Cause as Unnamed

NOTHING_WRONG = frozenset({"picked", "placed", "empty", "dry"})
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


TOLD: tuple[tuple[str, str], ...] = (
    (r"^aborted", "operator's abort"),
    (r"operator refused", "operator's no"),
    (r"^stopped by|^by control-C", "operator's stop"),
    (r"[Ee]mergency stop\*|E-?[Ss]top", "emergency stop"),
    (r"[Aa]rm power", "arm power"),
    (r"Envelope error", "envelope error"),
    (r"controller asks|floppy", "controller restarted"),
    (r"out of range|cannot be reached|out of reach", "out of the arm's reach"),
    (r"WHERE is .* off|at rest .* from where it was sent|not at rest within", "arm not where it was sent"),
    (r"comes back twice", "converter echoes"),
    (r"^Garbled|did not come through|through whole|WHERE did not give|typed '.*', echoed '[^']", "noise on the line"),
    (r"^(NoAnswer|PortError|Busy|controller:)", "controller silent"),
    (r"suspect: hand-eye", "hand-eye"),
    (r"suspect: camera|^calibration: (right|left) camera", "camera knocked"),
    (r"suspect: unclear|cannot be told", "looks disagree"),
    (r"look behind it is", "a look too old"),
    (r"not enabled", "arm not enabled"),
)
"""What the records say of an end in their own words, the telling words first."""
UNTOLD = "a fault in facetd"
"""What else a fault is taken for."""
MEASURED = {
    "covered": "lens covered", "half": "half a frame", "torn": "torn frame", "frozen": "camera frozen",
    "doubled": "one camera for both eyes", "swapped": "eyes swapped", "knocked": "camera knocked",
    "epipolar": "camera knocked", "focus": "lens out of focus or dirty", "motion": "blurred by motion",
    "darkness": "too dark", "saturation": "burnt out",
}  # fmt: skip
"""Measures of the pictures (vision/health/examine.py) by the cause they are signs of."""
UNNAMED = {
    Unnamed.BORDER: "too near the border", Unnamed.DARK: "too dark", Unnamed.BURNT: "burnt out",
    Unnamed.HIDDEN: "hidden", Unnamed.ALIKE: "looks like another", Unnamed.PATTERNED: "ground too patterned",
    Unnamed.STRANGE: "not taught",
}  # fmt: skip
REFUSED = {
    "below_table": "below the table", "outside_workspace": "outside the workspace", "kept_out": "kept out",
    "outside_room": "kept out", "no_way": "kept out", "not_enabled": "arm not enabled", "stale_look": "a look too old",
}  # fmt: skip
FINDING = re.compile(r"(left|right|pair): (?:(?!left:|right:|pair:).)*\((\w+) [^()]*limit [^()]*\)")
VALUE_AND_LIMIT = re.compile(r"\(\w+ ([\d.]+)[^,()]*, limit ([\d.]+)")
UNMATCHED = re.compile(r"no facet was found in both images \((\d+) and (\d+) outlines\)")


@dataclass(frozen=True)
class Cause:
    """name: of KNOWN; weight 0 to 1; evidence: what the records say; at: number of the record that says it."""

    name: str
    weight: float
    evidence: str
    at: int

    @property
    def stage(self) -> str:
        """Where in the cell it is."""
        return KNOWN[self.name].stage

    @property
    def remedy(self) -> str:
        """What to do about it."""
        return KNOWN[self.name].remedy


def causes(cycle: Cycle, others: Sequence[Cycle] = (), going: bool = False) -> list[Cause]:
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
        found = [Cause("cause not known", 0.1, str(cycle.why or cycle.outcome), _last(cycle))]
    first: dict[str, Cause] = {}
    for cause in found:
        first.setdefault(cause.name, cause)
    return list(first.values())


def _ended(cycle: Cycle, _: Sequence[Cycle]) -> Iterator[Cause]:
    """The first fault, or the end itself, in its own words; a later fault follows from the first."""
    fault = next(iter(cycle.of("fault")), None)
    if fault is None and cycle.outcome not in ("fault", "aborted"):
        return
    yield from told(fault or cycle.end or {})


def told(record: Record) -> Iterator[Cause]:
    """What a fault, or the end of a cycle, says in its own words."""
    text, at = str(record.get("text") or record.get("why") or ""), int(record.get("seq") or 0)
    plain = in_plain_words(text)
    if measures := FINDING.findall(text):
        yield from _pictures(measures, plain, at)
    elif re.match(r"CameraError|cameras:|NotSettledError", text):
        yield Cause("blurred by motion" if text.startswith("NotSettled") else "camera cable", 1.0, plain, at)
    else:
        by_words = (name for words, name in TOLD if re.search(words, plain) or re.search(words, text))
        name = next(by_words, UNTOLD)
        yield Cause(name, {"looks disagree": 0.6, UNTOLD: 0.5}.get(name, 1.0), plain, at)


def in_plain_words(text: str) -> str:
    """What a record says, without the name of the program's own class that it begins with."""
    return re.sub(r"^\w*(?:Error|Refused|Elsewhere): ", "", text)


def _pictures(measures: Iterable[tuple[str, str]], text: str, at: int) -> Iterator[Cause]:
    """What was wrong with pictures that nothing could be done on the strength of."""
    by_measure: dict[str, set[str]] = {}
    for eye, measure in measures:
        by_measure.setdefault(measure, set()).add(eye)
    for measure, eyes in by_measure.items():
        both_dark = measure == "covered" and len(eyes) == 2
        yield Cause("light off" if both_dark else MEASURED.get(measure, UNTOLD), 1.0, text, at)


def _refused(cycle: Cycle, _: Sequence[Cycle]) -> Iterator[Cause]:
    """What the guard refused, and why a part was left as out of reach."""
    if cycle.outcome not in ("unreachable", "fault", "unfinished"):
        return
    for record in cycle.of("refusal"):
        rule = str(record.get("rule"))
        if rule != "fault_stands":
            name = REFUSED.get(rule, "a move the guard refused")
            yield Cause(name, 0.9, f"{rule}: {record.get('text')}", int(record.get("seq") or 0))
    if cycle.outcome == "unreachable":
        why, at = str(cycle.why), _last(cycle)
        if "no grasp holds" in why or "give no solid" in why:
            yield Cause("no grasp holds it", 0.9, why, at)
        elif grasps := re.search(r"none of its (\d+) grasps .*\((\d+) blocked", why):
            blocked = 2 * int(grasps[2]) >= int(grasps[1])
            yield Cause("blocked by a neighbour" if blocked else "out of the arm's reach", 0.9, why, at)
        else:
            yield Cause("out of the arm's reach", 0.6, why, at)


def _geometry(cycle: Cycle, others: Sequence[Cycle]) -> Iterator[Cause]:
    """Looks that disagree, and which of hand, eye and part is to blame for it."""
    for record in cycle.of("decision"):
        if suspect := re.match(r"suspect: (.*)", str(record.get("text"))):
            evidence, at = str(record.get("why")), int(record.get("seq") or 0)
            blamed = {"camera": ("camera knocked", 0.9), "hand-eye": ("hand-eye", 0.9), "part": ("part moved", 0.75)}
            if suspect[1] in blamed:
                yield Cause(*blamed[suspect[1]], evidence, at)
            elif any(other.outcome == "picked" for other in others):
                yield Cause("part moved", 0.7, f"{evidence}; other picks of this run went well", at)
            else:
                yield Cause("hand-eye", 0.7, f"{evidence}; nothing was picked in this run", at)
    again = [r for r in cycle.of("decision") if re.match(r"looks \d+ and \d+ disagree", str(r.get("why")))]
    if len(again) > 1:
        evidence = f"{again[0]['why']}; and so {len(again)} times, whatever was approached"
        yield Cause("hand-eye", 0.85, evidence, int(again[1].get("seq") or 0))
    for stop in cycle.stops:
        chi2 = float((stop.estimate or {}).get("chi2") or 0)
        if chi2 > CHI_SQUARE_6:
            evidence = f"look {stop.number} disagrees with those before (chi-square {chi2:.0f} of {CHI_SQUARE_6:.0f})"
            yield Cause("hand-eye" if cycle.outcome == "missed" else "looks disagree", 0.75, evidence, _seq(stop))


def _all_moves(cycle: Cycle, _: Sequence[Cycle]) -> Iterator[Cause]:
    """Not one part but several, or one again and again, lie otherwise whenever the arm looks from elsewhere."""
    shifted = [
        r for r in cycle.of("decision") if re.search(r"not where the look before|not seen where", str(r.get("why")))
    ]
    parts = {str(r.get("text")).split()[1] for r in shifted if len(str(r.get("text")).split()) > 1}
    again = [r for r in shifted if "not where the look before" in str(r.get("why"))]
    if len(again) > 1 or (again and len(parts) > 1):
        evidence = (
            f"{', '.join(sorted(parts))} lay otherwise each time the arm looked from elsewhere ({len(shifted)} times)"
        )
        yield Cause("hand-eye", 0.85, evidence, int(again[-1].get("seq") or 0))


def _eyes_apart(cycle: Cycle, others: Sequence[Cycle]) -> Iterator[Cause]:
    """Both eyes see outlines and they do not meet, although they did before; those of a pattern need not."""
    patterned = sum(map(_patterned, cycle.stops))
    unmatched = [s for s in cycle.stops if _outlines_of(s) >= OUTLINES and not _patterned(s)]
    if patterned and not unmatched and "no facet" in str(cycle.why):
        evidence = f"{patterned} looks: nothing there, or nothing to be told from the table's pattern"
        yield Cause("ground too patterned", 0.7, evidence, _last(cycle))
    if not unmatched:
        return
    met = sum(c.named_looks for c in (cycle, *others))
    evidence = f"{len(unmatched)} looks saw outlines in both eyes that do not fit one another"
    share = len(unmatched) / len(cycle.stops)
    if met and (len(unmatched) > 1 or share == 1.0):
        yield Cause("camera knocked", 0.8, f"{evidence}, and {met} saw parts", _seq(unmatched[0]))
    elif "knocked camera" in str(cycle.why):
        yield Cause("camera knocked", 0.7, str(cycle.why), _seq(unmatched[0]))


def _images(cycle: Cycle, _: Sequence[Cycle]) -> Iterator[Cause]:
    """What was measured of the pictures and beyond its limit: the more looks, the more it explains."""
    shown: Counter[str] = Counter()
    first: dict[str, tuple[str, int]] = {}
    beyond: dict[str, float] = {}
    for stop in cycle.stops:
        findings = ((stop.look.get("health") or {}).get("findings") or {}).items()
        for name in {MEASURED.get(key.split()[0], "") for key, _ in findings} - {""}:
            shown[name] += 1
            texts = [_text(f) for key, f in findings if MEASURED.get(key.split()[0]) == name]
            first.setdefault(name, (texts[0], _seq(stop)))
            beyond[name] = max(beyond.get(name, 1.0), *map(_beyond, texts))
    # A part that was seen and lost otherwise was seen by these very pictures.
    most = {"missed": 0.5, "unreachable": 0.3, "aborted": 0.2, "fault": 0.6}.get(cycle.outcome, 0.95)
    unclear = any(r.get("text") == "suspect: unclear" for r in cycle.of("decision"))
    for name, count in shown.items():
        share = count / len(cycle.stops)
        text, at = first[name]
        evidence = f"{count} of {len(cycle.stops)} looks: {text}"
        # Looks that disagree, and no part's fault: pictures so blurred measure badly, wherever the hand is.
        blurred = unclear and MEASURED["focus"] == name and beyond[name] > FAR_BEYOND
        weight = (BLURRED if blurred else most) * (0.5 + 0.5 * share)
        yield Cause(name, weight * (1.0 - 0.001 / beyond[name]), evidence, at)


def _beyond(text: str) -> float:
    """How many times as much as its limit a finding says; 1 where it says nothing, or too little is what is wrong."""
    said = VALUE_AND_LIMIT.search(text)
    return max(1.0, float(said[1]) / float(said[2])) if said and float(said[2]) > 0.0 else 1.0


def _text(finding: Any) -> str:
    return str(finding.get("advice") or finding.get("text") or finding) if isinstance(finding, dict) else str(finding)


def _unnamed(cycle: Cycle, _: Sequence[Cycle]) -> Iterator[Cause]:
    """Why what lies there has no name, in the words of the end; where it was about a part with a name, nothing."""
    why = str(cycle.why or "")
    if cycle.outcome == "ambiguous":
        yield Cause("looks like another", 0.7, why, _last(cycle))
    elif cycle.outcome == "unknown":
        seen = [p.get("cause") for s in cycle.stops for p in s.parts if p.get("label") == "unknown" and p.get("cause")]
        causes_told = [cause for cause, said in SAID.items() if said.words in why]
        if not causes_told and "fits nothing that was taught" in why:  # so say all looks together
            causes_told = [Unnamed.STRANGE]
        for cause in causes_told or [name for name, _ in Counter(seen).most_common(1) if name in UNNAMED]:
            yield Cause(UNNAMED[cause], 0.7, why, _last(cycle))


def _lost(cycle: Cycle, _: Sequence[Cycle]) -> Iterator[Cause]:
    """It was seen, and then it was not."""
    if cycle.outcome != "lost":
        return
    bare = [s for s in cycle.stops if s.purpose != "survey" and not s.parts]
    if bare and all(_outlines_of(s) < OUTLINES and len(_rejected(s)) < 2 * OUTLINES for s in bare):
        yield Cause("part moved", 0.75, f"{cycle.why}; the table is bare there", _seq(bare[0]))
    elif any(
        p.get("label") == cycle.label
        for s in cycle.stops
        if s.purpose == "approach" and not s.estimate
        for p in s.parts
    ):
        yield Cause("part moved", 0.75, f"{cycle.why}; it is seen elsewhere", _last(cycle))
    elif "not where the look before had them" in str(cycle.why):
        yield Cause("part moved", 0.7, str(cycle.why), _last(cycle))
    else:
        yield Cause("not found again", 0.4, str(cycle.why), _last(cycle))


def _missed(cycle: Cycle, others: Sequence[Cycle]) -> Iterator[Cause]:
    """The hand closed, and it is not in it: how it was grasped, and where it lies now, tell what became of it."""
    tries = [r for r in cycle.of("decision") if r.get("text") == "missed"]
    if cycle.outcome != "missed" and not tries:
        return
    # What it is taken for after it was knocked about follows from the miss.
    weight = 0.6 if cycle.outcome == "missed" else 0.75
    verify = [s for s in cycle.stops if s.purpose == "verify"]
    moved = None if not verify else _moved_mm(cycle, verify[-1])
    at = _seq(verify[0]) if verify else _last(cycle)
    witness = (
        "" if cycle.true_mm is None else f"; the simulated cell's witness has the grasp {cycle.true_mm:.1f} mm off"
    )
    why = str((tries[-1] if tries else cycle.end or {}).get("why"))
    lies = "" if moved is None else f", {moved:.1f} mm from where it lay"
    chosen = " ".join(str(r.get("why")) for r in cycle.of("decision"))
    slant = max(map(float, re.findall(r"contacts (\d+) degrees", chosen)), default=0.0)
    held = sorted({str(c.label) for c in others if c.outcome == "picked"})
    if erred := denied(cycle):
        yield Cause("look after the lift", 0.95, f"{told_of(erred[-1])}{witness}", at)
    elif "came back empty" in why or "knocked away" in why or (moved or 0.0) > SQUEEZED_OUT_MM:
        yield Cause("part slipped", weight + 0.05, f"{why}{lies}{witness}", at)
    elif slant > SLANTED_DEG:
        evidence = f"{why}{lies}: the fingers met it {slant:.0f} degrees off square{witness}"
        yield Cause("part slipped", weight + 0.05, evidence, at)
    elif held and cycle.label not in {c.label for c in others if c.outcome == "picked"}:
        yield Cause(
            "part slipped", weight, f"{why}{lies}, and {', '.join(sorted(map(str, held)))} was held{witness}", at
        )
    else:
        yield Cause("gripper", weight, f"the hand closed, and {why}{lies}{witness}", at)


def _moved_mm(cycle: Cycle, after: Stop) -> float | None:
    """How far the part that was grasped for lies from where it was last thought to."""
    estimates = [s.estimate for s in cycle.stops if s.estimate and _seq(s) < _seq(after)]
    world_from_cyclopean = after.look.get("world_from_cyclopean")
    same = [p for p in after.parts if p.get("label") == cycle.label and p.get("cyclopean_from_part")]
    if not (estimates and same and world_from_cyclopean and estimates[-1].get("world_from_part")):
        return None
    before = np.array(estimates[-1]["world_from_part"], float)[:3, 3]
    places = [(np.array(world_from_cyclopean) @ np.array(p["cyclopean_from_part"]))[:3, 3] for p in same]
    return float(min(np.linalg.norm(place - before) for place in places))


def _released(cycle: Cycle, _: Sequence[Cycle]) -> Iterator[Cause]:
    """The gripper opened above the bin, and what it showed there does not prove that the part fell in."""
    for record in cycle.of("release"):
        showed = record.get("above"), record.get("opened")
        if cycle.outcome == "released":
            slipped, stuck = showed[0] == "empty", showed[1] == "part"
            name = "gripper" if stuck else "part slipped" if slipped else "release not confirmed"
            yield Cause(name, 0.8, str(cycle.why), int(record.get("seq") or 0))


def _uncertain(cycle: Cycle, _: Sequence[Cycle]) -> Iterator[Cause]:
    """It was never known well enough, or the hand went for it although it was not."""
    last = next((s for s in reversed(cycle.stops) if s.estimate), None)
    if last is None or last.estimate is None or cycle.outcome not in ("unsure", "missed"):
        return
    predicted = float(last.estimate.get("predicted_mm") or 0)
    if cycle.outcome == "unsure" or predicted > KNOWN_MM:
        evidence = f"the last estimate was known to {predicted:.1f} mm only"
        yield Cause("estimate too uncertain", 0.7, evidence, _seq(last))


def _cut_off(cycle: Cycle, _: Sequence[Cycle]) -> Iterator[Cause]:
    """The run ends in the middle of it."""
    if cycle.end is None and not cycle.of("fault"):
        evidence = f"the run ends in the middle of the cycle, after `{cycle.records[-1]['kind']}`"
        yield Cause("cut off", 0.95, evidence, _last(cycle))


def _outlines_of(stop: Stop) -> int:
    """How many outlines each eye saw at least, where no facet was made of them."""
    return min(map(int, found.groups())) if (found := UNMATCHED.search(stop.notes)) else 0


def _patterned(stop: Stop) -> bool:
    """Whether its outlines are the table's pattern, and the eyes were measured to stand as calibrated."""
    knocked_px = (stop.look.get("health") or {}).get("knocked_pair")
    stands = isinstance(knocked_px, float) and knocked_px < MEASURES["knocked"].limit
    return stands and SAID[Unnamed.PATTERNED].words in stop.notes


def _rejected(stop: Stop) -> Sequence[Any]:
    rejected: Sequence[Any] = (stop.look.get("scene") or {}).get("rejected") or []
    return rejected


def _seq(stop: Stop) -> int:
    return int(stop.look.get("seq") or 0)


def _last(cycle: Cycle) -> int:
    return int(cycle.records[-1].get("seq") or 0)


Rule = Callable[[Cycle, Sequence[Cycle]], Iterator[Cause]]
RULES: tuple[Rule, ...] = (
    _ended, _refused, _geometry, _all_moves, _eyes_apart, _images, _unnamed, _lost, _missed, _released, _uncertain,
    _cut_off,
)  # fmt: skip
