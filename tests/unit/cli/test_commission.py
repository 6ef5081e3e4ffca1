"""From a known arm to the first pick: the order of the checks, what is kept between sittings, what ends one."""

import json
from pathlib import Path

import pytest

from daemon.cli.commission import FILE, commission, read_proofs, run, write_proofs
from daemon.cli.commission_steps import (
    STEPS,
    CommissioningDialogue,
    CommissioningPlan,
    CommissioningSession,
    NotProvenError,
    calibrate_zero,
    go_to_survey,
)
from daemon.commands.controller_terminal import CAL
from daemon.frontends.client import DaemonLink
from daemon.store.outside import FileError

WHERE = {"world_from_tool": [[1, 0, 0, 420.0], [0, 1, 0, 0.0], [0, 0, 1, 60.0], [0, 0, 0, 1]]}
HAND_EYE = {"sigma_mm": 0.2, "sigma_deg": 0.05, "arm_mm": 0.05, "arm_deg": 0.01, "warning": None}
SAYS = {
    "where": WHERE,
    "doctor": {"findings": [{"what": "cameras", "found": "a pair"}]},
    "look": {"health": [{"name": "blur", "eye": "left", "value": 1.0, "good": True, "limit": 2.0, "unit": "px"}]},
    "calibrate stereo 9x6 16": {"stereo": {"rms_px": 0.1}, "hand_eye": HAND_EYE},
    "calibrate hand-eye 9x6 16": {"hand_eye": HAND_EYE},
    "calibrate verify 9x6 16": {"poses": 9, "length_mm": 0.1, "spread_mm": 0.2},
    "calibrate touch 9x6 16": {"board_z_mm": [-296.2, -295.9], "table_z_mm": -300.0},
    "positions": {"places": {"home": [], "bin": [], "survey": [], "survey2": [], "mine": []}},
    "teach cube": {"view": "cube/1"},
}


class ToldLink(DaemonLink):
    """A daemon as far as commissioning knows one. fails: what it does not do, and what it says then."""

    def __init__(self, **fails: str) -> None:
        self.fails = {command.replace("_", " "): text for command, text in fails.items()}
        self.said, self.calibration, self.paused = list[str](), 0, False
        self.model: int | None = None
        self.fault: str | None = None

    def do(self, text, frontend, say, ask=None):
        if text == "status":
            model = {"version": self.model}
            return done(data={"cell": "real", "model": model, "fault": self.fault, "paused": self.paused})
        if text == "calibrate list":
            return done(data={"current": self.calibration})
        self.said.append(text)
        self.fault = None if text == "resume" else self.fault
        self.paused &= text != "resume"
        if text in self.fails:
            return done(self.fails[text], status=1)
        self.calibration += text.startswith("calibrate stereo")
        self.model = 1 if text == "accept" else self.model
        return done(f"{text}: done", SAYS.get(text, {}))


def done(text="", data=None, status=0):
    return {"text": text, "data": data or {}, "status": status}


def sitting(link, proofs=None, answer="y"):
    """One: whether all is proven, what was told, the proofs."""
    told, proofs = [], {} if proofs is None else proofs
    talk = CommissioningSession(
        link, CommissioningDialogue(told.append, lambda _: answer), CommissioningPlan("9x6", 16.0, 4.0, "cube")
    )
    return commission(talk, proofs, lambda _: None), "\n".join(told), proofs


def test_every_check_comes_in_order_and_the_stop_before_the_first_motion() -> None:
    link = ToldLink()
    all_proven, told, proofs = sitting(link)
    assert all_proven
    assert list(proofs) == [step.name for step in STEPS]
    moving = [text for text in link.said if text.split()[0] in ("go", "calibrate", "hand", "pick")]
    assert link.said.index("enable") < link.said.index(moving[0])
    assert link.said.index("step on") < link.said.index(moving[0]) < link.said.index("step off")
    assert [text for text in moving if text.startswith("go ")][-4:] == [
        "go bin",
        "go survey",
        "go survey2",
        "go survey",
    ]
    assert moving[-1] == "pick cube"
    assert all(f"{step.name}: {step.proves}" in told for step in STEPS)


@pytest.mark.parametrize(
    "step", ["where", "enable", "go survey", "look", "calibrate stereo 9x6 16", "hand close", "train"]
)
def test_what_is_not_done_ends_it_there_with_what_to_do(step: str) -> None:
    link = ToldLink(**{step: "no: this and that"})
    all_proven, told, _ = sitting(link)
    assert not all_proven
    assert "NOT PROVEN: no: this and that" in told
    assert "To do: " in told
    after = link.said[link.said.index(step) + 1 :]
    assert [text for text in after if text not in ("step off", "stop")] == []


def test_without_a_yes_nothing_is_said_that_could_move() -> None:
    link = ToldLink()
    all_proven, told, _ = sitting(link, answer="n")
    assert not all_proven
    assert "not confirmed" in told
    assert link.said == ["where"]


def test_a_second_sitting_goes_on_where_the_first_was_left_and_asks_again_what_only_looks() -> None:
    link = ToldLink(teach_cube="two things are seen")
    all_proven, _, proofs = sitting(link)
    assert not all_proven
    link.fails.clear()
    link.said.clear()
    all_proven, told, _ = sitting(link, proofs)
    assert all_proven
    assert not any(text.startswith("calibrate") for text in link.said)
    assert {"where", "doctor", "look", "enable", "teach cube", "pick cube"} <= set(link.said)
    assert "done " in told


def test_what_was_proven_with_another_calibration_is_proven_again() -> None:
    link = ToldLink()
    sitting(link, proofs := {})
    link.said.clear()
    link.calibration += 1
    assert sitting(link, proofs)[0]
    tours = [text for text in link.said if text.startswith(("calibrate", "pick"))]
    assert tours == ["calibrate verify 9x6 16", "calibrate touch 9x6 16", "pick cube"]


def test_a_table_elsewhere_than_the_guard_has_it_is_told_with_both_heights(monkeypatch) -> None:
    monkeypatch.setitem(SAYS, "calibrate touch 9x6 16", {"board_z_mm": [-281.0, -280.0], "table_z_mm": -300.0})
    all_proven, told, _ = sitting(ToldLink())
    assert not all_proven
    assert "the table is at z -285.0 to -284.0 mm, pick.limits.table_z_mm is -300" in told


def test_a_board_whose_thickness_is_no_number_proves_no_table() -> None:
    told: list[str] = []
    talk = CommissioningSession(
        ToldLink(),
        CommissioningDialogue(told.append, lambda _: "y"),
        CommissioningPlan("9x6", 16.0, float("nan"), "cube"),
    )
    assert not commission(talk, {}, lambda _: None)
    assert "NOT PROVEN: the table is at z nan" in told[-1]


def test_a_doubtful_hand_eye_has_a_tour_of_its_own(monkeypatch) -> None:
    doubtful = {**HAND_EYE, "sigma_mm": 0.9}
    monkeypatch.setitem(SAYS, "calibrate stereo 9x6 16", {"stereo": {"rms_px": 0.1}, "hand_eye": doubtful})
    link = ToldLink()
    assert sitting(link)[0]
    assert "calibrate hand-eye 9x6 16" in link.said


def test_a_controller_that_was_switched_on_is_answered_and_finds_its_zero() -> None:
    class Cold(ToldLink):
        asks, power, zero = True, False, False

        def do(self, text, frontend, say, ask=None):
            if text == "robot power-up":
                self.asks = False
            if text == "where" and self.asks:
                return done("the controller asks 'Initialize (Y/N)?'", {"code": "controller_restarted"}, status=1)
            if text == "robot cal":
                self.said.append(text)
                assert ask(f"{CAL}. Send it? [y/n]") == "y", "the person's own yes"
                self.zero, self.power = self.power, True
                return done("calibrated") if self.zero else done("*ARM POWER OFF*", {"code": "arm_power"}, status=1)
            if text == "go survey" and not self.zero:
                return done("*Not calibrated*", {"code": "not_calibrated"}, status=1)
            return super().do(text, frontend, say, ask)

    link, asked = Cold(), []
    person = CommissioningDialogue(lambda _: None, lambda question: asked.append(question) or "y")
    assert commission(
        CommissioningSession(link, person, CommissioningPlan("9x6", 16.0, 4.0, "cube")), {}, lambda _: None
    )
    assert link.said.count("robot cal") == 2
    assert asked.count(f"{CAL}. Send it? [y/n]") == 2, "no motion is confirmed for somebody"


def test_a_part_is_shown_from_as_many_sides_as_the_person_wants() -> None:
    link, told = ToldLink(), []
    left = ["more, please", "more", "enough"]

    def answer(question: str) -> str:
        return left.pop(0) if "another view" in question else "y"

    proofs = {}
    assert commission(
        CommissioningSession(
            link, CommissioningDialogue(told.append, answer), CommissioningPlan("9x6", 16.0, 4.0, "cube")
        ),
        proofs,
        lambda _: None,
    )
    assert link.said.count("teach cube") == 3
    assert proofs["teach"].shown == "the cube is taught in cube/1, cube/1, cube/1"


def test_another_word_is_neither_a_yes_nor_a_no() -> None:
    asked: list[str] = []

    def answer(question: str) -> str:
        asked.append(question)
        return ["what?", "ja"][len(asked) - 1]

    CommissioningSession(
        ToldLink(), CommissioningDialogue(asked.append, answer), CommissioningPlan("9x6", 16.0, 4.0, "cube")
    ).need("Is it clear?")
    assert asked == ["Is it clear? [y/n]", "`what?` is not y or n. Is it clear? [y/n]"]
    with pytest.raises(NotProvenError):
        CommissioningSession(
            ToldLink(), CommissioningDialogue(asked.append, lambda _: ""), CommissioningPlan("9x6", 16.0, 4.0, "cube")
        ).need("Is it clear?")


def test_a_fault_that_stands_is_for_the_person_to_put_right() -> None:
    link = ToldLink()
    link.fault = "*Envelope error* Joint 2"
    assert sitting(link)[0]
    assert link.said.index("resume") < link.said.index("enable")
    link.fault, link.said[:] = "*Envelope error* Joint 2", []
    assert not sitting(link, answer="n")[0]
    assert "resume" not in link.said


@pytest.mark.parametrize("meanwhile", ["a stop", "a pause", "nothing"])
def test_a_stop_or_a_pause_of_somebody_else_is_not_lifted_behind_their_back(meanwhile: str) -> None:
    """Who was sent to switch arm power on said `stop` there: it was cleared, and the arm went to find its zero."""

    class NoPower(ToldLink):
        def do(self, text, frontend, say, ask=None):
            if text == "robot cal" and "robot cal" not in self.said:
                self.said.append(text)
                self.fault = "*Arm power off*"
                return done("*Arm power off*", {"code": "arm_power"}, status=1)
            return super().do(text, frontend, say, ask)

    link, asked = NoPower(), []

    def answer(question: str) -> str:
        asked.append(question)
        if "Switch arm power on" in question and meanwhile != "nothing":
            link.fault = "*Arm power off*; then stopped by bob" if meanwhile == "a stop" else link.fault
            link.paused = meanwhile == "a pause"
        return "n" if "removed?" in question or "paused" in question else "y"

    talk = CommissioningSession(
        link, CommissioningDialogue(asked.append, answer), CommissioningPlan("9x6", 16.0, 4.0, "cube")
    )
    if meanwhile == "nothing":
        calibrate_zero(talk)
    else:
        with pytest.raises(NotProvenError, match="stopped by bob" if meanwhile == "a stop" else "is paused"):
            calibrate_zero(talk)
    assert ("resume" in link.said) is (meanwhile == "nothing")


def test_a_stop_that_somebody_says_while_a_fault_is_asked_about_is_not_lifted_by_the_answer() -> None:
    """The yes was to the fault that stood before: with it the stop of whoever had gone to the arm was cleared, and the
    arm was enabled."""
    link, asked = ToldLink(), []
    link.fault = "*Envelope error* Joint 2"

    def answer(question: str) -> str:
        asked.append(question)
        link.fault = "*Envelope error* Joint 2; then stopped by bob"
        return "n" if "bob" in question else "y"

    with pytest.raises(NotProvenError, match="stopped by bob"):
        CommissioningSession(
            link, CommissioningDialogue(asked.append, answer), CommissioningPlan("9x6", 16.0, 4.0, "cube")
        ).enable()
    assert link.said == []


def test_a_stop_right_behind_what_told_that_the_arm_has_no_zero_is_asked_about() -> None:
    class Stopped(ToldLink):
        def do(self, text, frontend, say, ask=None):
            if text == "go survey":
                self.fault = "*Not calibrated*; then stopped by bob"
                return done("*Not calibrated*", {"code": "not_calibrated"}, status=1)
            return super().do(text, frontend, say, ask)

    link = Stopped()
    talk = CommissioningSession(
        link, CommissioningDialogue(lambda _: None, lambda question: "n"), CommissioningPlan("9x6", 16.0, 4.0, "cube")
    )
    with pytest.raises(NotProvenError, match="stopped by bob"):
        go_to_survey(talk)
    assert link.said == ["enable"]


def test_the_file_is_read_back_and_a_spoilt_one_is_told_in_one_line(tmp_path: Path, capsys) -> None:
    _, _, proofs = sitting(ToldLink())
    write_proofs(tmp_path / FILE, proofs)
    assert read_proofs(tmp_path / FILE) == proofs
    assert read_proofs(tmp_path / "none.json") == {}
    for damaged in (json.dumps({"version": 1, "steps": {"arm": 3}}).encode(), b'{"steps\xff": 1}', b'{"a":' * 5000):
        (tmp_path / FILE).write_bytes(damaged)
        with pytest.raises(FileError, match="move it away"):
            read_proofs(tmp_path / FILE)
    assert run(ToldLink(), ["--keep", str(tmp_path)]) == 2
    assert capsys.readouterr().out.count("\n") == 1
