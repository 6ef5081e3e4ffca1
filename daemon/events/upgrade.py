"""Upgrade records of earlier releases to today's version, where a line is read.

Version 1 had no codes: its faults, ends and decisions give their causes only in prose, which this module alone reads.
"""

import re
from typing import Any

from daemon.events.codes import BY_UNNAMED, MISSED_BY, CauseCode, DecisionCode, suspected
from daemon.events.outcomes import Outcome

VERSION = 2
"""Of the records that this release writes: `v`."""

Record = dict[str, Any]
BY_A_PERSON = re.compile(r"stopped by|stopped$|by control-C")
OPERATOR = {CauseCode.OPERATOR_ABORT, CauseCode.OPERATOR_NO, CauseCode.OPERATOR_STOP}
FAULT_PROSE: tuple[tuple[str, CauseCode], ...] = (
    (r"^aborted", CauseCode.OPERATOR_ABORT),
    (r"operator refused|answered no to", CauseCode.OPERATOR_NO),
    (r"^stopped by|^by control-C", CauseCode.OPERATOR_STOP),
    (r"[Ee]mergency stop\*|E-?[Ss]top", CauseCode.EMERGENCY_STOP),
    (r"[Aa]rm power", CauseCode.ARM_POWER),
    (r"Envelope error", CauseCode.ENVELOPE_ERROR),
    (r"controller asks|floppy", CauseCode.CONTROLLER_RESTARTED),
    (r"out of range|cannot be reached|out of reach", CauseCode.OUT_OF_REACH),
    (
        r"WHERE is .* (?:off|from the target)|at rest .* from (?:where it was sent|its target)|not at rest within",
        CauseCode.ARM_NOT_THERE,
    ),
    (r"comes back twice|both echo", CauseCode.CONVERTER_ECHOES),
    (
        r"^Garbled|did not come through|arrived damaged|through whole|WHERE (?:did not give|was incomplete)"
        r"|typed '.*', echoed '[^']",
        CauseCode.LINE_NOISE,
    ),
    (r"^(NoAnswer|PortError|Busy|controller:)", CauseCode.CONTROLLER_SILENT),
    (r"(?:suspect|likely cause): hand-eye", CauseCode.HAND_EYE),
    (r"(?:suspect|likely cause): camera|^calibration: (right|left) camera", CauseCode.CAMERA_KNOCKED),
    (r"(?:suspect|likely cause): unclear|cannot be told|cannot tell which", CauseCode.LOOKS_DISAGREE),
    (r"look behind it is|computed from a look", CauseCode.STALE_LOOK),
    (r"not enabled", CauseCode.NOT_ENABLED),
)
"""Expressions in the text of a fault or of a cycle's end, most specific first."""
CLASS_NAME = re.compile(r"^\w*(?:Error|Refused|Elsewhere): ")
OF_CAMERAS = re.compile(r"CameraError|cameras:|NotSettledError")
FINDING = re.compile(r"(left|right|pair): (?:(?!left:|right:|pair:).)*\((\w+) [^()]*limit [^()]*\)")
FINDING_VALUE = re.compile(r"\((\w+) ([\d.]+)[^,()]*, limit ([\d.]+)")
UNMATCHED = re.compile(r"no facet was found in both images \((\d+) and (\d+) outlines\)")
GRASPS = re.compile(r"none of its (\d+) grasps .*\((\d+) blocked")
SUSPECT = re.compile(r"suspect: (.*)")
DISAGREE = re.compile(r"looks \d+ and \d+ disagree(?: \(chi-square (\d+))?")
SLANT = re.compile(r"contacts (\d+) degrees")
UNNAMED_PROSE = {
    "border": "too near the border of the picture",
    "dark": "too dark where it lies",
    "burnt": "burnt out where it lies",
    "hidden": "part of it does not show",
    "alike": "too little of it shows to tell it from another part",
    "patterned": "the pattern of the table runs into its edges",
    "strange": "nothing like it was taught",
}
"""Why a part has no name, in the words of version 1 (vision/values.py: Cause)."""


WORDS: dict[str, dict[str, dict[str, str]]] = {
    "state": {"from": {"place": "bin"}, "to": {"place": "bin"}, "event": {"placed": "binned"}},
    "left": {"state": {"place": "bin"}},
    "cycle_end": {"outcome": {"placed": Outcome.EMPTIED}},
    "refusal": {"rule": {"fault_stands": "fault_active"}},
}
"""Earlier words of records of any version, by kind and field, with today's."""


def upgraded(record: Record) -> Record:
    """Convert a record of version 1 to version 2, and the words of any version to today's."""
    kind = str(record.get("kind"))
    today = {key: words[record[key]] for key, words in WORDS.get(kind, {}).items() if record.get(key) in words}
    record = {**record, **today}
    return {**record, **CHANGES[kind](record)} if record.get("v") == 1 and kind in CHANGES else record


def read_prose(text: str) -> Record:
    """Derive `code`, and `findings` where the text names measures of images, from a text without a code."""
    plain = CLASS_NAME.sub("", text)
    if findings := [f"{measure} {camera}" for camera, measure in FINDING.findall(text)]:
        return {"code": CauseCode.INTERNAL, "findings": findings}
    if OF_CAMERAS.match(text):
        return {"code": CauseCode.MOTION_BLUR if text.startswith("NotSettled") else CauseCode.CAMERA_LOST}
    found = (code for words, code in FAULT_PROSE if re.search(words, plain) or re.search(words, text))
    return {"code": next(found, CauseCode.INTERNAL)}


def _fault(record: Record) -> Record:
    return read_prose(str(record.get("text") or ""))


def _cycle_end(record: Record) -> Record:
    outcome, why = record.get("outcome"), str(record.get("why") or "")
    if outcome in (Outcome.FAULT, Outcome.ABORTED):
        change = read_prose(why)
        by_person = outcome == Outcome.FAULT and BY_A_PERSON.match(why) and change["code"] in OPERATOR
        return {**change, "outcome": Outcome.ABORTED} if by_person else change
    code: CauseCode | DecisionCode | None = None
    if outcome == Outcome.UNREACHABLE:
        code = CauseCode.MOVE_REFUSED
        if "no grasp holds" in why or "give no solid" in why:
            code = CauseCode.NO_GRASP
        elif grasps := GRASPS.search(why):
            code = CauseCode.BLOCKED if 2 * int(grasps[2]) >= int(grasps[1]) else CauseCode.OUT_OF_REACH
    elif outcome == Outcome.AMBIGUOUS:
        code = CauseCode.ALIKE
    elif outcome == Outcome.UNKNOWN:
        code = next((BY_UNNAMED[name] for name, words in UNNAMED_PROSE.items() if words in why), None)
        if code is None and "no facet" in why:
            code = CauseCode.UNMATCHED_OUTLINES
        elif code is None and "fits nothing that was taught" in why:
            code = CauseCode.NOT_TAUGHT
    elif outcome in (Outcome.LOST, Outcome.MISSED):
        code = _decided(why)
    return {} if code is None else {"code": code}


def _decided(why: str) -> DecisionCode | None:
    for words, code in (
        ("came back empty", DecisionCode.CAME_BACK_EMPTY),
        ("knocked away", DecisionCode.KNOCKED_AWAY),
        ("still lies there", DecisionCode.STILL_THERE),
        ("not where the look before", DecisionCode.MOVED_BETWEEN_LOOKS),
        ("not seen where", DecisionCode.NOT_SEEN_AGAIN),
    ):
        if words in why:
            return code
    return None


def _decision(record: Record) -> Record:
    text, why = str(record.get("text") or ""), str(record.get("why") or "")
    if who := SUSPECT.match(text):
        disagree = DISAGREE.match(why)
        return {"code": suspected(who[1])} | ({"chi2": float(disagree[1] or 0)} if disagree else {})
    words = text.split()
    change: Record = {"label": words[1]} if len(words) > 1 else {}
    slants = [float(slant) for slant in SLANT.findall(why)]
    if slants:
        return {"code": DecisionCode.CHOSEN, "slip_deg": max(slants)} | change
    code = _decided(why)
    if text == "missed":
        return {"code": code if code in MISSED_BY else DecisionCode.MISSED}
    return {"code": code} | change if code in (DecisionCode.MOVED_BETWEEN_LOOKS, DecisionCode.NOT_SEEN_AGAIN) else {}


def _look(record: Record) -> Record:
    scene, health = record.get("scene") or {}, record.get("health") or {}
    notes = " ".join(str(note) for note in scene.get("notes") or [])
    change: Record = {}
    unmatched, cause = UNMATCHED.search(notes), UNNAMED_PROSE["patterned"] in notes
    if unmatched or cause:
        counts = [int(count) for count in unmatched.groups()] if unmatched else [0, 0]
        change["scene"] = {**scene, "unmatched": counts, "nothing": "patterned" if cause else None}
    if findings := health.get("findings"):
        values = {}
        for key, finding in findings.items():
            if isinstance(finding, str) and (value := FINDING_VALUE.search(finding)):
                values[key.replace(" ", "_")] = float(value[2])
        change["health"] = {**values, **health}
    return change


CHANGES = {"fault": _fault, "cycle_end": _cycle_end, "decision": _decision, "look": _look}
"""What version 2 adds to a record of version 1, by kind."""
