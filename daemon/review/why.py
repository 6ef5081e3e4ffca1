"""Why a part was not picked: the stages it could have failed in, ranked by evidence, and what to change.

Pure: one cycle in, causes out. A rule reads one kind of evidence and says how much of a miss it would explain (0 to 1).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from daemon.pick.fusion import CHI_SQUARE_6
from daemon.review.digest import Cycle

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
        said = str(cycle.end.get("why") or cycle.outcome)
        found = [Cause("pick", 0.1, said, "look at the stops below; nothing in the records stands out")]
    return sorted(found, key=lambda c: -c.weight)


def _faults(cycle: Cycle) -> list[Cause]:
    return [
        Cause(
            "arm" if "link" in str(r.get("code")) else "cell",
            1.0,
            f"fault {r.get('code')}: {r.get('text')}",
            "mend what it names, then `resume`",
        )
        for r in cycle.of("fault")
    ]


def _refusals(cycle: Cycle) -> list[Cause]:
    return [
        Cause(
            "guard",
            0.9,
            f"{r.get('rule')}: {r.get('text')}",
            "move the part, or widen the rule in facetd.yaml with care",
        )
        for r in cycle.of("refusal")
    ]


def _disagreement(cycle: Cycle) -> list[Cause]:
    worst = max((s.estimate for s in cycle.stops if s.estimate), key=lambda e: float(e.get("chi2") or 0), default=None)
    chi2 = float(worst.get("chi2") or 0) if worst else 0.0
    if worst is None or chi2 <= CHI_SQUARE_6:
        return []
    return [
        Cause(
            "estimate",
            min(0.5 + chi2 / 400, 0.95),
            f"look {worst.get('stop')} disagrees with those before (chi-square {chi2:.0f}, at most {CHI_SQUARE_6:.0f})",
            "the part moved, or hand-eye or a camera did: `facetctl calibrate verify`",
        )
    ]


def _uncertain(cycle: Cycle) -> list[Cause]:
    last = next((s.estimate for s in reversed(cycle.stops) if s.estimate), None)
    predicted = float(last.get("predicted_mm") or 0) if last else 0.0
    if predicted <= 1.0:
        return []
    return [
        Cause(
            "estimate",
            min(0.3 + predicted / 10, 0.8),
            f"the last estimate was known to {predicted:.1f} mm only",
            "a nearer last stand-off, better light, or a new hand-eye calibration",
        )
    ]


def _missed(cycle: Cycle) -> list[Cause]:
    if cycle.outcome != "missed":
        return []
    truth = cycle.truth.get("error_mm") if cycle.truth else None
    said = "" if truth is None else f"; the cell's witness has it {truth:.1f} mm off"
    return [
        Cause(
            "grasp",
            0.6,
            f"the hand closed and the part was still there{said}",
            "touch test (`facetctl calibrate verify --touch`), fingers, gripper opening in parts.yaml",
        )
    ]


def _recognition(cycle: Cycle) -> list[Cause]:
    found = []
    approach = [s for s in cycle.stops if s.purpose != "survey"] or list(cycle.stops)
    for stop in approach:
        for part in stop.parts:
            if part.get("ambiguous"):
                both = " or ".join(part.get("candidates") or []) or "several parts"
                found.append(
                    Cause(
                        "recognition",
                        0.5,
                        f"could be {both}: {part.get('reason')}",
                        "teach a view that tells them apart; `try` names the facet that would",
                    )
                )
            elif part.get("label") == "unknown":
                found.append(
                    Cause(
                        "recognition",
                        0.35,
                        str(part.get("reason")),
                        "teach this view if the part is known; light if facets are missing",
                    )
                )
    if any(not s.parts for s in approach):
        found.append(
            Cause("segmentation", 0.45, "a look found no part at all", "light and focus; see the refused outlines")
        )
    best: dict[tuple[str, str], Cause] = {}
    for cause in found:
        best.setdefault((cause.stage, cause.evidence), cause)
    return list(best.values())[:4]


def _images(cycle: Cycle) -> list[Cause]:
    found = []
    for stop in cycle.stops:
        for name, finding in ((stop.look.get("health") or {}).get("findings") or {}).items():
            found.append(
                Cause("images", 0.55, f"{name}: {_text(finding)}", "see the advice of `doctor`; light, lens, cable")
            )
    return found[:3]


def _text(finding: Any) -> str:
    return str(finding.get("advice") or finding.get("text") or finding) if isinstance(finding, dict) else str(finding)


def _unfinished(cycle: Cycle) -> list[Cause]:
    if cycle.end is not None:
        return []
    last = cycle.records[-1]
    return [
        Cause(
            "daemon",
            0.8,
            f"the run ends in the middle of the cycle, after `{last['kind']}`",
            "power cut, kill or crash: the journal of that minute; the part in the gripper was asked about at restart",
        )
    ]


def _ended(cycle: Cycle) -> list[Cause]:
    if cycle.end is None or cycle.outcome == "missed" or not cycle.end.get("why"):
        return []
    return [Cause("cycle", 0.4, str(cycle.end["why"]), "see the decisions and stops of this cycle")]


RULES: tuple[Callable[[Cycle], list[Cause]], ...] = (
    _faults,
    _refusals,
    _disagreement,
    _uncertain,
    _missed,
    _recognition,
    _images,
    _unfinished,
    _ended,
)
