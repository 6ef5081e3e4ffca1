"""Why a part was not picked: the stages it could have failed in, ranked by evidence, and what to change.

Pure: one cycle in, causes out. A rule reads one kind of evidence and says how much of a miss it would explain (0 to 1).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from daemon.pick.fusion import CHI_SQUARE_6
from daemon.review.digest import Cycle
from daemon.store.records import Record
from daemon.vision.health import SAID
from daemon.vision.values import Cause as Unnamed

NOTHING_WRONG = frozenset({"picked", "placed", "empty", "dry"})


@dataclass(frozen=True)
class Cause:
    """stage: of the pick; weight 0 to 1; evidence: what the records say; remedy: what to do about it."""

    stage: str
    weight: float
    evidence: str
    remedy: str


def causes(cycle: Cycle) -> list[Cause]:
    """Every cause that has evidence, likeliest first; none for a part that was picked or a table that was empty."""
    if cycle.outcome in NOTHING_WRONG:
        return []
    found = [cause for rule in RULES for cause in rule(cycle)]
    if not found and cycle.end is not None:
        remedy = "look at the stops below; nothing in the records stands out"
        found = [Cause("pick", 0.1, str(cycle.end.get("why") or cycle.outcome), remedy)]
    return sorted(found, key=lambda c: -c.weight)


def _faults(cycle: Cycle) -> Iterator[Cause]:
    for record in cycle.of("fault"):
        stage = "arm" if "link" in str(record.get("code")) else "cell"
        evidence = f"fault {record.get('code')}: {record.get('text')}"
        yield Cause(stage, 1.0, evidence, "mend what it names, then `resume`")


def _refusals(cycle: Cycle) -> Iterator[Cause]:
    for record in cycle.of("refusal"):
        evidence = f"{record.get('rule')}: {record.get('text')}"
        yield Cause("guard", 0.9, evidence, "move the part, or widen the rule in facetd.yaml with care")


def _disagreement(cycle: Cycle) -> Iterator[Cause]:
    worst = max((s.estimate for s in cycle.stops if s.estimate), key=_chi2, default=None)
    if worst is not None and (chi2 := _chi2(worst)) > CHI_SQUARE_6:
        by = f"chi-square {chi2:.0f}, at most {CHI_SQUARE_6:.0f}"
        evidence = f"look {worst.get('stop')} disagrees with those before ({by})"
        remedy = "the part moved, or hand-eye or a camera did: `facetctl calibrate verify`"
        yield Cause("estimate", min(0.5 + chi2 / 400, 0.95), evidence, remedy)


def _chi2(estimate: Record) -> float:
    return float(estimate.get("chi2") or 0)


def _uncertain(cycle: Cycle) -> Iterator[Cause]:
    last = next((s.estimate for s in reversed(cycle.stops) if s.estimate), {})
    predicted = float(last.get("predicted_mm") or 0)
    if predicted > 1.0:
        evidence = f"the last estimate was known to {predicted:.1f} mm only"
        remedy = "a nearer last stand-off, better light, or a new hand-eye calibration"
        yield Cause("estimate", min(0.3 + predicted / 10, 0.8), evidence, remedy)


def _missed(cycle: Cycle) -> Iterator[Cause]:
    if cycle.outcome == "missed":
        witness = "" if cycle.true_mm is None else f"; the cell's witness has it {cycle.true_mm:.1f} mm off"
        evidence = f"the hand closed and the part was still there{witness}"
        remedy = "touch test (`facetctl calibrate verify --touch`), fingers, gripper opening in parts.yaml"
        yield Cause("grasp", 0.6, evidence, remedy)


def _recognition(cycle: Cycle) -> Iterator[Cause]:
    approach = [s for s in cycle.stops if s.purpose != "survey"] or list(cycle.stops)
    found = [cause for stop in approach for part in stop.parts for cause in _unnamed(part)]
    if any(not s.parts for s in approach):
        remedy = "light and focus; see the refused outlines"
        found.append(Cause("segmentation", 0.45, "a look found no part at all", remedy))
    first: dict[tuple[str, str], Cause] = {}
    for cause in found:
        first.setdefault((cause.stage, cause.evidence), cause)
    yield from list(first.values())[:4]


def _unnamed(part: dict[str, Any]) -> Iterator[Cause]:
    if part.get("ambiguous"):
        both = " or ".join(part.get("candidates") or []) or "several parts"
        remedy = "teach a view that tells them apart; `try` names the facet that would"
        yield Cause("recognition", 0.5, f"could be {both}: {part.get('reason')}", remedy)
    elif part.get("label") == "unknown":
        remedy = "teach this view if the part is known; light if facets are missing"
        if part.get("cause") in tuple(Unnamed):
            remedy = SAID[Unnamed(part["cause"])].remedy
        yield Cause("recognition", 0.35, str(part.get("reason")), remedy)


def _images(cycle: Cycle) -> Iterator[Cause]:
    findings = [item for s in cycle.stops for item in ((s.look.get("health") or {}).get("findings") or {}).items()]
    for name, finding in findings[:3]:
        yield Cause("images", 0.55, f"{name}: {_text(finding)}", "see the advice of `doctor`; light, lens, cable")


def _text(finding: Any) -> str:
    return str(finding.get("advice") or finding.get("text") or finding) if isinstance(finding, dict) else str(finding)


def _unfinished(cycle: Cycle) -> Iterator[Cause]:
    if cycle.end is None:
        evidence = f"the run ends in the middle of the cycle, after `{cycle.records[-1]['kind']}`"
        remedy = "power cut, kill or crash: the journal of that minute"
        yield Cause("daemon", 0.8, evidence, f"{remedy}; the part in the gripper was asked about at restart")


def _ended(cycle: Cycle) -> Iterator[Cause]:
    if cycle.outcome != "missed" and cycle.why:
        yield Cause("cycle", 0.4, cycle.why, "see the decisions and stops of this cycle")


RULES: tuple[Callable[[Cycle], Iterator[Cause]], ...] = (
    _faults, _refusals, _disagreement, _uncertain, _missed, _recognition, _images, _unfinished, _ended,
)  # fmt: skip
