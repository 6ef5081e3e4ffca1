"""Steps of commissioning, from an identified arm to the first pick, in the order of STEPS.

Each step sends console commands to the running daemon, checks their results, and asks the person where needed. Nothing
here calibrates or moves by itself.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from daemon.console.phrases import is_no, is_yes
from daemon.errors import DONE, FacetdError
from daemon.events.codes import CauseCode
from daemon.events.outcomes import Outcome
from daemon.frontends.client import DaemonLink

HAND_EYE_MM = 0.5
"""A hand-eye with a larger sigma is calibrated once more on its own; the guide has the same number."""
TABLE_MM = 4.0
"""Largest error of the table's height in pick.limits: less than the fingertips' clearance."""
TEACHING_TRIES, PICKING_TRIES = 6, 3
PLACES = re.compile(r"home|bin|survey\d*")
"""The positions of facetd.yaml."""


class NotProvenError(FacetdError):
    """A step is not proven: what was seen instead."""


@dataclass(frozen=True)
class CommissioningDialogue:
    """The person at the terminal: `tell` shows a line, `answer` asks a question and returns the answer."""

    tell: Callable[[str], None]
    answer: Callable[[str], str]


@dataclass(frozen=True)
class CommissioningPlan:
    """The board (inner corners, square and thickness in mm) and the first part."""

    board: str
    square_mm: float
    board_mm: float
    part: str
    charuco: bool = False

    @property
    def calibrate(self) -> str:
        """The board as an argument of `calibrate`."""
        return f"{self.board} {self.square_mm:g}" + " charuco" * self.charuco


class CommissioningSession:
    """The running daemon and the person, for the steps."""

    def __init__(self, link: DaemonLink, person: CommissioningDialogue, order: CommissioningPlan) -> None:
        self._link, self.person, self.order = link, person, order
        self.hand_eye: dict[str, Any] | None = None
        """The hand-eye that `calibrate stereo` found in this session."""

    def send(self, command: str) -> dict[str, Any]:
        """Send a command and show it; returns its result. The person answers its questions. Raises NotProvenError after
        a control-C, even where nothing moved: the next step may move."""
        self.person.tell(f"  facetd> {command}")
        done = self._link.do(command, "commission", lambda line: self.person.tell(f"  {line}"), self.person.answer)
        if "interrupted" in done:
            raise NotProvenError(f"control-C was pressed at `{command}`: {done['text']}")
        return done

    def do(self, command: str) -> dict[str, Any]:
        """Send a command that must succeed; returns its data. Raises NotProvenError."""
        done = self.send(command)
        if done["status"] != DONE:
            raise NotProvenError(done["text"])
        return dict(done["data"])

    def need(self, question: str) -> None:
        """Ask the person for a yes. Raises NotProvenError."""
        answer = self.person.answer(f"{question} [y/n]")
        while answer.strip() and not (is_yes(answer) or is_no(answer)):
            answer = self.person.answer(f"`{answer.strip()}` is not y or n. {question} [y/n]")
        if not is_yes(answer):
            raise NotProvenError(f"not confirmed: {question}")

    def enable(self) -> None:
        """Enable the arm, after the person has removed the cause of an active fault. Raises NotProvenError."""
        self.clear(None)
        self.do("enable")

    @property
    def fault(self) -> str | None:
        fault: str | None = self.status()["fault"]
        return fault

    def clear(self, expected: str | None) -> None:
        """`resume` after a fault that the person knows (expected). Another fault, such as a stop since, or a pause by
        another operator, needs their yes first. Raises NotProvenError."""
        may_go_on = False
        while True:  # the answer does not clear what came while they thought
            status = self.status()
            if status["paused"] and not may_go_on:
                self.need("The arm is paused by another operator. Resume it?")
                may_go_on = True
            elif status["fault"] not in (None, expected):
                expected = status["fault"]
                self.need(f"A fault is active: {expected}. Is its cause removed?")
            else:
                break
        if status["fault"] is not None or status["paused"]:
            self.do("resume")

    def fault_of(self, text: str) -> str | None:
        """The active fault, where it is the one that this result reported; None after a stop since."""
        return text if self.fault == text else None

    @property
    def simulated(self) -> bool:
        """Whether the cell is simulated, where nobody can put a part down by hand."""
        return bool(self.status()["cell"] == "simulated")

    def facts(self) -> tuple[int, int | None]:
        """The calibration and the model in use, by number."""
        listed = self._link.do("calibrate list", "commission", lambda _: None)["data"]
        return int(listed.get("current", 0)), self.status()["model"]["version"]

    def status(self) -> dict[str, Any]:
        """The daemon's `status` as values."""
        return dict(self._link.do("status", "commission", lambda _: None)["data"])


def _arm(talk: CommissioningSession) -> str:
    where = talk.send("where")
    if where["status"] != DONE and where["data"].get("code") == CauseCode.CONTROLLER_RESTARTED:
        talk.need(f"The controller was just switched on: {where['text']}. Answer Y to all its questions?")
        talk.do("robot power-up")
        where = talk.send("where")
    if where["status"] != DONE:
        raise NotProvenError(where["text"])
    x, y, z = (row[3] for row in where["data"]["world_from_tool"][:3])
    talk.need(f"The controller reports the tool at x {x:.0f}, y {y:.0f}, z {z:.0f} mm. Is that plausible?")
    return f"the tool is at {x:.0f}, {y:.0f}, {z:.0f} mm"


def _stop(talk: CommissioningSession) -> str:
    talk.need(
        "Is everybody out of the arm's reach, a hand on the emergency stop? The arm is enabled next, and stays at rest."
    )
    talk.enable()
    return "the controller accepts the stop word"


def _doctor(talk: CommissioningSession) -> str:
    findings = talk.do("doctor")["findings"]
    cameras = [finding for finding in findings if finding["what"] == "cameras"]
    return "; ".join(finding["found"] for finding in cameras)


def calibrate_zero(talk: CommissioningSession) -> None:
    """Calibrate the arm's zero (CAL), where the controller has none."""
    while True:
        done = talk.send("robot cal")
        if done["status"] == DONE:
            return
        if done["data"].get("code") != CauseCode.ARM_POWER:
            raise NotProvenError(done["text"])
        fault = talk.fault_of(done["text"])
        talk.need(f"{done['text']}. Switch arm power on. Is it on now?")
        talk.clear(fault)


def go_to_survey(talk: CommissioningSession) -> None:
    """Go to the survey position, where the board is in view."""
    talk.enable()
    there = talk.send("go survey")
    if there["status"] != DONE and there["data"].get("code") in (CauseCode.NOT_CALIBRATED, CauseCode.ARM_POWER):
        talk.clear(talk.fault_of(there["text"]))
        calibrate_zero(talk)
        there = talk.send("go survey")
    if there["status"] != DONE:
        raise NotProvenError(there["text"])


def _go_to_board(talk: CommissioningSession, next_move: str = "The arm moves next.") -> None:
    talk.need(f"Is the board still on the table? {next_move}")
    go_to_survey(talk)


def _light(talk: CommissioningSession) -> str:
    talk.need("Are board or parts on the table, in the usual light? The arm moves for the first time, step by step.")
    if talk.simulated:
        talk.do(f"scatter {talk.order.part}")
    talk.do("step on")
    try:
        go_to_survey(talk)
    finally:
        talk.send("step off")
    ill = [f for f in talk.do("look")["health"] if not f["good"]]
    if ill:
        measured = (f"{f['name']}, {f['eye']} camera: {f['value']:.3g} {f['unit']}, limit {f['limit']:g}" for f in ill)
        raise NotProvenError("; ".join(measured))
    return "both images are sharp, even and bright enough"


def _stereo(talk: CommissioningSession) -> str:
    if talk.status().get("mounting") == "world":
        raise NotProvenError(
            "from here on commissioning moves cameras on the gripper, and these are fixed over the table"
        )
    talk.need(
        f"Is the board of {talk.order.calibrate} mm flat on the table, and the way of the arm free? The arm moves next."
    )
    go_to_survey(talk)
    found = talk.do(f"calibrate stereo {talk.order.calibrate}")
    talk.hand_eye = found["hand_eye"]
    return f"the cameras agree to {found['stereo']['rms_px']:.2f} px"


def _hand_eye(talk: CommissioningSession) -> str:
    found = talk.hand_eye
    if found is None or _is_doubtful(found):
        _go_to_board(talk)
        found = talk.do(f"calibrate hand-eye {talk.order.calibrate}")["hand_eye"]
    result = f"standard deviation {found['sigma_mm']:.2f} mm and {found['sigma_deg']:.3f} degrees"
    result += f", arm accuracy {found['arm_mm']:.2f} mm and {found['arm_deg']:.3f} degrees an axis"
    if _is_doubtful(found):
        raise NotProvenError(f"{result}; the limit is {HAND_EYE_MM:g} mm. {found['warning'] or ''}")
    return result


def _is_doubtful(found: dict[str, Any]) -> bool:
    return bool(found["warning"] or found["sigma_mm"] > HAND_EYE_MM)


def _verify(talk: CommissioningSession) -> str:
    _go_to_board(talk)
    found = talk.do(f"calibrate verify {talk.order.calibrate}")
    return f"{found['poses']} poses: lengths {found['length_mm']:.2f} mm off, corners {found['spread_mm']:.2f} mm apart"


def _table(talk: CommissioningSession) -> str:
    _go_to_board(talk, "The finger tips move above its first corner next.")
    found = talk.do(f"calibrate touch {talk.order.calibrate}")
    low, high = (z - talk.order.board_mm for z in found["board_z_mm"])
    result = f"the table is at z {low:.1f} to {high:.1f} mm, pick.limits.table_z_mm is {found['table_z_mm']:g}"
    if not max(abs(low - found["table_z_mm"]), abs(high - found["table_z_mm"])) <= TABLE_MM:
        raise NotProvenError(result)
    return result


def _workspace(talk: CommissioningSession) -> str:
    talk.need("Is the table clear? The arm moves to home, bin and survey next.")
    talk.enable()
    places = [name for name in talk.do("positions")["places"] if PLACES.fullmatch(name)]
    for place in places:
        talk.do(f"go {place}")
    return f"{', '.join(places)} are reachable, and the guard allows the paths between them"


def _gripper(talk: CommissioningSession) -> str:
    talk.need("Are the fingers free, with nothing between them? y: they close and open next.")
    talk.enable()
    for word in ("close", "open"):
        talk.do(f"hand {word}")
        talk.need(f"Did the gripper {word}?")
    return "it closes and opens"


def _teach(talk: CommissioningSession) -> str:
    part = talk.order.part
    talk.need(f"Is one {part} alone in view of the cameras at `go survey`? The arm moves next.")
    go_to_survey(talk)
    taught: list[str] = []
    for _ in range(TEACHING_TRIES):
        done = talk.send(f"teach {part}")
        talk.person.tell(f"  {done['text']}")
        if done["status"] != DONE:
            talk.need("Try again?")
            continue
        taught.append(done["data"]["view"])
        if not talk.person.answer("Turn the part for another view, or is this enough? [more/enough]").startswith("m"):
            break
    if not taught:
        raise NotProvenError(done["text"])
    talk.do("train")
    talk.send("accept")
    return f"the {part} is taught in {', '.join(taught)}"


def _pick(talk: CommissioningSession) -> str:
    part = talk.order.part
    if talk.simulated:
        talk.do(f"scatter {part}")
    else:
        talk.need(f"Is one {part} on the table, in any pose? The arm moves next.")
    talk.enable()
    for _ in range(PICKING_TRIES):
        done = talk.send(f"pick {part}")
        outcome = str(done["text"]).splitlines()[0]
        if done["status"] == DONE:
            return outcome
        talk.person.tell(f"  {done['text']}")
        if done["data"].get("outcome") == Outcome.RELEASED:  # the cameras could not prove it; a person near the bin can
            talk.need(f"Is the {part} in the bin?")
            return outcome
        talk.need("Try again?")
    raise NotProvenError(done["text"])


@dataclass(frozen=True)
class CommissioningStep:
    """A step. do: returns what was shown, raises NotProvenError. with_what: `calibration`, `model`: the proof is valid
    while these stay the same; None: the step only looks and is repeated every time."""

    name: str
    proves: str
    mend: str
    do: Callable[[CommissioningSession], str]
    with_what: tuple[str, ...] | None = ()


STEPS = (
    CommissioningStep("arm", "serial line, dialect and arm.yaml belong to this arm",
         "look it up in docs/operate/trouble.md; for another arm: `facetctl arm identify`", _arm, None),
    CommissioningStep("camera", "both cameras deliver images, and the rest of the cell is in order",
         "do what the BAD lines say; `facetctl stream` shows the images while the daemon is stopped",
         _doctor, None),
    CommissioningStep("stop", "the arm can be stopped before it is ever moved",
         "set arm.dialect.abort_word to the word that the manual of the controller names", _stop, None),
    CommissioningStep("light", "the images are good enough to measure in",
         "light evenly from above, focus and clean the lenses; a refusal names its rule",
         _light, None),
    CommissioningStep("stereo", "the calibration of both cameras",
         "put the board whole in both images; measure its square; give a rough hand_eye in calibration.yaml; "
         "fixed cameras: go on with docs/operate/fixed-cameras.md",
         _stereo),
    CommissioningStep("hand-eye", "the position of the cameras on the arm",
         "tighten the bracket; correct arm.flange_from_tool; put the board nearer, so that the poses differ more",
         _hand_eye),
    CommissioningStep("verify", "given lengths and one point measure the same from new poses",
         "correct what the FAILED lines say; then `facetctl commission stereo`", _verify, ("calibration",)),
    CommissioningStep("table",
         "the finger tips are where TOOL says, and the table is where the guard assumes it",
         "set arm.flange_from_tool to the gripper's real pose, then `facetctl commission stereo`; "
         "the board's thickness (--board-mm); pick.limits.table_z_mm, then `facetctl reload`",
         _table, ("calibration",)),
    CommissioningStep("workspace", "home, bin and survey positions are reachable, and the paths between them are free",
         "the refusal names the rule: pick.limits, pick.home, pick.bin, pick.surveys in facetd.yaml; `facetctl reload`",
         _workspace, ("calibration",)),
    CommissioningStep("gripper", "OPENI opens and CLOSEI closes the gripper",
         "air, valves, the wires to the controller's gripper outputs", _gripper),
    CommissioningStep("teach", "the first part is taught",
         "turn the part so that three faces are visible; improve the light; show it alone", _teach),
    CommissioningStep("pick", "everything together: recognise, reach, grasp, put into the bin",
         "see the cause: `facetctl review latest`", _pick, ("calibration", "model")),
)  # fmt: skip
