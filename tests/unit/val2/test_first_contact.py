"""The first contact as a dialogue, without a line and without time: what each manner of a controller is found to be."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.val2.contact_findings import (
    CAREFUL_S,
    Consult,
    ContactFindings,
    Exchange,
    Heard,
    Speed,
    Tell,
    UnclearError,
)
from drivers.val2.first_contact import APART_DEG, BAUDS, ENDS, MARGIN, PACES_S, STRAIGHT_DEG, introduce
from drivers.val2.first_contact_moves import ROUNDS, STEP_DEG

USUAL_JOINTS = (10.125, 60.25, -150.375, 20.5, -40.625, 30.75)


@dataclass
class Terminal:
    """A controller by its manners, each a field; takes an Exchange and gives what is heard."""

    baud: int = 9600
    end: bytes = b"\r"
    newline: str = "\r\n"
    prompt: str = "."
    asks: Sequence[str] = ()
    echo: bool = True
    one_header: bool = False
    decimals: tuple[int, int] = (2, 3)
    lower_case: bool = True
    abbreviations: bool = True
    cancels: bool = True
    both_end: bool = False
    knows_break: bool = True
    needs_pace_s: float = 0.0
    takes: Sequence[str] = ("ABORT",)
    stops: Sequence[str] = ("ABORT",)
    prompts_at_start: bool = False
    calibrated: bool = True
    at_end: Sequence[int] = ()
    joints: list[float] = field(default_factory=lambda: list(USUAL_JOINTS))
    lines: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.speed, self.line, self.ahead = 0, "", list[str](self.asks)
        self.going: tuple[int, float] | None = None
        self.waiting = bool(self.asks)

    def hears(self, step: Exchange) -> Heard:
        """What is heard of it."""
        if self.speed != self.baud:
            return Heard((), step.most_s)
        data = step.data.decode("latin-1")
        if step.pace_s < self.needs_pace_s and len(data) > 3:
            data = data[0] + data[2:]
        said = ""
        for letter in data:
            said += letter if self.echo and letter not in "\r\n\x15" else ""
            ends = letter == self.end.decode()[-1] and (self.line + letter).endswith(self.end.decode())
            if ends or (self.both_end and letter in "\r\n"):
                line, self.line = self.line.strip("\r\n"), ""
                said += self.answers(line)
            elif letter == "\x15" and self.cancels:
                self.line = ""
            else:
                self.line += letter
        return Heard(((0.1, said.encode("latin-1")),) if said else (), step.quiet_s if said else step.most_s)

    def answers(self, line: str) -> str:
        """All that is printed after a line."""
        if self.ahead:
            question = self.ahead.pop(0) if not self.waiting or line.strip("!") == "" else None
            self.waiting = False
            if question:
                return f"{self.newline}{question} "
        self.lines.append(line)
        text = self.carried_out(line)
        return self.newline + (text + self.newline if text else "") + self.prompt

    def carried_out(self, line: str) -> str:
        """What is said to it."""
        going, self.going = self.going, None
        if going is not None:
            joint, degrees = going
            self.joints[joint] += degrees / 2 if line in self.stops else degrees
        said = line.upper() if self.lower_case else line
        if said == "" or said in self.takes or (said == "DO BREAK" and self.knows_break) or said.startswith("SPEED "):
            return ""
        if said == "WHERE" or (self.abbreviations and said == "WHER"):
            return self.table()
        if said == "CAL" and not self.calibrated:
            self.calibrated = True
            return ""
        if said.startswith("DO DRIVE ") and "!" not in said:
            number, turn, _ = said.removeprefix("DO DRIVE ").split(",")
            if not self.calibrated:
                return "*Arm not calibrated*"
            if int(number) in self.at_end and float(turn) > 0:
                return f"*Joint {number} out of range*"
            self.going = int(number) - 1, float(turn)
            return ""
        return "*Illegal command*"

    def table(self) -> str:
        """WHERE."""
        mm, deg = self.decimals
        place = [f"{v:.{mm}f}" for v in (self.joints[0] * 10 + 0.125, 100.125, -50.375)]
        place += [f"{v:.{deg}f}" for v in (10.125, 80.25, 20.375)]
        joints = [f"{v:.{deg}f}" for v in self.joints]
        if self.one_header:
            return self.newline.join(["X/JT1 Y/JT2 Z/JT3 O/JT4 A/JT5 T/JT6", " ".join(place), " ".join(joints)])
        return self.newline.join(["X Y Z O A T", " ".join(place), "JT1 JT2 JT3 JT4 JT5 JT6", " ".join(joints)])


@dataclass
class SlowTerminal(Terminal):
    """One that takes almost as long as it is given: seconds to its answer by what a line begins with."""

    takes_s: dict[str, float] = field(
        default_factory=lambda: {"WHERE": 4.5, "where": 4.5, "WHER": 4.5, "Y": 45.0, "DO DRIVE": 20.0, "CAL": 150.0}
    )
    late_s: float = 0.0
    late: bytes = b""

    def hears(self, step: Exchange) -> Heard:
        """See Terminal: what is not due yet comes to a later exchange, behind nothing else."""
        heard = super().hears(step)
        self.late += heard.data
        self.late_s -= step.most_s
        if self.late_s > 0.0 or not self.late:
            return Heard((), step.most_s)
        due_s, self.late_s, said, self.late = max(self.late_s + step.most_s, 0.1), 0.0, self.late, b""
        return Heard(((due_s, said),), min(due_s + step.quiet_s, step.most_s))

    def answers(self, line: str) -> str:
        """See Terminal."""
        takes_s = next((s for begins, s in self.takes_s.items() if line.startswith(begins)), 2.5)
        self.late_s = max(self.late_s, takes_s)
        return super().answers(line)


def met(
    terminal: Terminal, says: Callable[[Consult], str], pendant: bool = False
) -> tuple[ContactFindings, list[Consult], list[str]]:
    """Carry a first contact through: what is known, what the person was asked, and what she was told."""
    known, asked, told = ContactFindings(), list[Consult](), list[str]()
    steps = introduce(known, pendant=pendant)
    came: Any = None
    while True:
        try:
            step: Any = steps.send(came)
        except StopIteration:
            return known, asked, told
        came = None
        if isinstance(step, Speed):
            terminal.speed = step.baud
        elif isinstance(step, Exchange):
            assert step.quiet_s <= step.most_s, "silence ends it before its time is up"
            came = terminal.hears(step)
        elif isinstance(step, Tell):
            told.append(step.text)
        else:
            asked.append(step)
            came = says(step)


def no_moves(consult: Consult) -> str:
    return "Y" if consult.about == "power-up" else "no"


def yes(consult: Consult) -> str:
    return "no" if consult.about == "pendant" else "yes"


@settings(max_examples=25)
@given(
    baud=st.sampled_from(BAUDS),
    end=st.sampled_from(ENDS),
    newline=st.sampled_from(["\r\n", "\n\r", "\r", "\n"]),
    prompt=st.sampled_from([".", ". "]),
    asks=st.sampled_from([(), ("Boot now (Y/N)?",), ("Boot now (Y/N)?", "Initialize (Y/N)?")]),
    manners=st.fixed_dictionaries(dict.fromkeys(
        ("echo", "one_header", "lower_case", "abbreviations", "cancels", "knows_break"), st.booleans())),
    decimals=st.sampled_from([(2, 3), (1, 2), (2, 2), (3, 1), (1, 1)]),
    pace_s=st.sampled_from(PACES_S),
    takes=st.sampled_from([("ABORT",), ("PANIC",), ("ABORT", "PANIC")]),
)  # fmt: skip
def test_each_manner_of_a_controller_is_found_to_be_what_it_is(
    baud: int, end: bytes, newline: str, prompt: str, asks: tuple[str, ...], manners: dict[str, Any],
    decimals: tuple[int, int], pace_s: float, takes: tuple[str, ...],
) -> None:  # fmt: skip
    terminal = Terminal(
        baud, end, newline, prompt, asks, decimals=decimals, needs_pace_s=pace_s, takes=takes, **manners
    )
    known, asked, _ = met(terminal, no_moves)
    found = {name: finding.value for name, finding in known.findings.items()}
    assert [consult.about for consult in asked] == ["power-up"] * len(asks) + ["move"]
    assert {name: found[name] for name in ("baud", "line_end", "newline", "prompt", "power_up", "echo")} == {
        "baud": baud, "line_end": end.decode(), "newline": newline, "prompt": prompt, "power_up": list(asks),
        "echo": manners["echo"],
    }  # fmt: skip
    assert ("power_up_asks" in found) is bool(asks)
    assert found["where"] == ("one header" if manners["one_header"] else "two headers")
    assert (found["lower_case"], found["abbreviations"]) == (manners["lower_case"], manners["abbreviations"])
    assert found.get("calibrate_word") == (None if manners["abbreviations"] else "CALIBRATE")
    assert found["cancel_line"] == ("\x15" if manners["cancels"] else "")
    assert found["break_after_move"] is manners["knows_break"]
    assert found["digits"] == decimals
    assert found.get("same_place_mm") == (None if decimals[0] >= 2 else 0.2)
    assert found.get("same_place_deg") == {1: 0.2, 2: 0.02, 3: None}[decimals[1]]
    assert found["character_pause_s"] == pytest.approx(min(MARGIN * pace_s, CAREFUL_S))
    assert ("adapters" in known.findings["character_pause_s"].found) is (pace_s > 0.0)
    assert (found["abort_word"], found["stop_words"], found["errors"]) == (takes[0], takes, "*Illegal command*")
    assert known.stop_bytes.split(end)[:2] == [b"!!", takes[0].encode()]
    assert sorted(known.stop_bytes.split(end)[1:-1]) == [b"ABORT", b"PANIC"]
    assert not any("DRIVE" in line for line in terminal.lines)


@pytest.mark.parametrize("both_end", [False, True])
def test_cr_lf_that_is_two_ends_gives_two_prompts(both_end: bool) -> None:
    found = met(Terminal(both_end=both_end), no_moves)[0].findings
    assert found["two_prompts"].value is both_end


@settings(max_examples=15)
@given(
    prompts_at_start=st.booleans(),
    stops=st.sampled_from([("ABORT",), ("PANIC",)]),
    coarse=st.booleans(),
    calibrated=st.booleans(),
    at_end=st.sets(st.integers(1, 6)),
)
def test_the_first_moves_are_there_and_back_by_the_word_that_stops(
    prompts_at_start: bool, stops: tuple[str, ...], coarse: bool, calibrated: bool, at_end: set[int]
) -> None:
    terminal = Terminal(
        takes=("ABORT", "PANIC"), stops=stops, decimals=(1, 1) if coarse else (2, 3), calibrated=calibrated,
        at_end=tuple(at_end),
    )  # fmt: skip
    known, asked, told = met(terminal, yes)
    assert [consult.about for consult in asked] == ["move", *([] if calibrated else ["calibrate"])]
    assert known.findings["abort_word"].value == stops[0]
    assert known.findings["abort_word"].sure == "certain"
    assert ("ABORT let the motion finish: that is not a stop." in told) is (stops[0] == "PANIC")
    assert known.moved
    rounds = len(ROUNDS) * (1 + coarse)
    assert len(known.readings) == 1 + 6 * rounds
    turned = [abs(b - a) for one, two in zip(known.readings, known.readings[1:], strict=False)
              for a, b in zip(one.joints_deg, two.joints_deg, strict=True)]  # fmt: skip
    assert sum(t > 0.5 for t in turned) == 6 * rounds
    assert max(turned) == pytest.approx(STEP_DEG, abs=0.11)


def test_where_no_word_stops_it_or_a_joint_does_not_turn_it_ends_with_what_to_do() -> None:
    with pytest.raises(UnclearError, match="ABORT did not stop a moving joint"):
        met(Terminal(stops=()), yes)
    with pytest.raises(UnclearError, match="takes none of ABORT, PANIC"):
        met(Terminal(takes=()), yes)
    with pytest.raises(UnclearError, match="not calibrated, and nothing was moved"):
        met(Terminal(calibrated=False), lambda c: "no" if c.about == "calibrate" else yes(c))
    with pytest.raises(UnclearError, match="asks again and again"):
        met(Terminal(asks=["Why (Y/N)?"] * 12), no_moves)
    with pytest.raises(UnclearError, match="prints whole numbers"):
        met(Terminal(decimals=(0, 0)), no_moves)


def test_a_controller_that_takes_its_time_is_met_all_the_same() -> None:
    """Seconds for WHERE, half a minute for a step, most of one after power-up, minutes until it is calibrated."""
    terminal = SlowTerminal(asks=("Boot now (Y/N)?", "Initialize (Y/N)?"), calibrated=False)
    known, asked, told = met(terminal, lambda c: "Y" if c.about == "power-up" else yes(c))
    assert [consult.about for consult in asked] == ["power-up", "power-up", "move", "calibrate"]
    assert "calibrated: CAL was carried out" in told
    assert len(known.readings) == 1 + 6 * len(ROUNDS)
    assert known.findings["lower_case"].value is known.findings["abbreviations"].value is True
    assert (known.findings["cancel_line"].value, known.findings["character_pause_s"].value) == ("\x15", 0.0)


def test_a_controller_that_refuses_to_calibrate_is_asked_what_it_needs() -> None:
    class PowerOff(Terminal):
        def carried_out(self, line: str) -> str:
            return "*High power is off*" if line == "CAL" else super().carried_out(line)

    with pytest.raises(UnclearError, match=r"CAL was answered by \*High power is off\*. What does the controller need"):
        met(PowerOff(calibrated=False), yes)


@pytest.mark.parametrize("mended", [2, 3, 99])
def test_what_keeps_the_arm_from_its_first_motion_is_mended_one_thing_after_the_other_but_not_for_ever(
    mended: int,
) -> None:
    """Arm power, then a limit switch or an air supply: each is only told once the one before is mended."""

    class Wants(Terminal):
        def carried_out(self, line: str) -> str:
            refused = len([consult for consult in asked if consult.about == "power"])
            if line.upper().startswith("DO DRIVE") and refused < mended:
                return f"*Fault {refused}*"
            return super().carried_out(line)

    asked = list[Consult]()

    def mends(consult: Consult) -> str:
        asked.append(consult)
        return yes(consult)

    if mended == 99:
        with pytest.raises(UnclearError, match=r"the arm does not move: the controller says \*Fault \d\*"):
            met(Wants(), mends)
        return
    known, _, _ = met(Wants(), mends)
    told = [consult.text for consult in asked if consult.about == "power"]
    assert [f"*Fault {k}*" in text for k, text in enumerate(told)] == [True] * mended
    assert len(known.readings) == 1 + 6 * len(ROUNDS)


def test_a_wrist_is_bent_by_the_person_until_it_is_no_longer_straight() -> None:
    terminal, bent = Terminal(), iter([STRAIGHT_DEG - 0.1, -STRAIGHT_DEG])
    terminal.joints[4] = 0.0

    def bends(consult: Consult) -> str:
        if consult.about == "pendant":
            terminal.joints[4] = next(bent)
        return "yes"

    _, asked, _ = met(terminal, bends)
    assert [consult.about for consult in asked] == ["move", "pendant", "pendant"]
    assert "Joint 5 reads 9.9 degrees" in asked[2].text
    stays = Terminal()
    stays.joints[4] = 0.0
    assert [consult.about for consult in met(stays, yes)[1]] == ["move", "pendant"]


def test_places_by_the_pendant_count_once_and_only_far_from_the_others() -> None:
    terminal = Terminal()
    by = iter([0.0, APART_DEG - 0.1, APART_DEG, 2 * APART_DEG])

    def brings(consult: Consult) -> str:
        if consult.about != "pendant":
            return "no"
        if (far := next(by, None)) is None:
            return "no"
        terminal.joints[1] = USUAL_JOINTS[1] + far
        return "yes"

    known, asked, told = met(terminal, brings, pendant=True)
    assert len(known.readings) == 3
    assert [f": {taken} so far" in consult.text for taken, consult in zip([0, 0, 0, 1, 2], asked[1:], strict=True)] == [
        True
    ] * 5
    assert told == [f"all joints are within {near:.1f} degrees of an earlier pose: move the arm farther away"
                    for near in (0.0, APART_DEG - 0.1)]  # fmt: skip


class Says(Terminal):
    """One that answers some lines otherwise: the text, or what makes it."""

    def __init__(self, others: dict[str, str | Callable[[], str]], **manners: Any) -> None:
        super().__init__(**manners)
        self.others = others

    def carried_out(self, line: str) -> str:
        """See Terminal."""
        said = self.others.get(line)
        return super().carried_out(line) if said is None else said if isinstance(said, str) else said()


def creeping() -> Says:
    """An arm that moves between any two WHEREs."""
    terminal = Says({})

    def moved_on() -> str:
        terminal.joints[1] += 0.5
        return terminal.table()

    terminal.others["WHERE"] = moved_on
    return terminal


@pytest.mark.parametrize(
    ("terminal", "told"),
    [
        (Terminal(baud=12345), "nothing answers at any speed: is the controller on"),
        (
            Says({"WHERE": "*Undefined value*"}),
            r"WHERE was answered by b'.*Undefined value.*': six numbers under X Y Z",
        ),
        (creeping(), "two WHERE in a row differ: the arm moves, or the line spoils digits"),
        (
            Says({"!!": "what?"}),
            "is not a command of VAL, but was answered by .* instead of an error between asterisks",
        ),
        (Says({"!!": ""}), "instead of an error between asterisks"),
        (
            Terminal(prompt=""),
            "it answers b'.*' and gives no prompt: its data bits, parity or stop bits are not 8, none and 1",
        ),
    ],
    ids=["silent", "no table", "moves", "no asterisks", "no answer", "no prompt"],
)
def test_what_a_first_contact_cannot_make_out_ends_it_with_what_was_seen_and_nothing_moved(
    terminal: Terminal, told: str
) -> None:
    with pytest.raises(UnclearError, match=told):
        met(terminal, yes)
    assert not any("DRIVE" in line for line in terminal.lines)


def test_each_speed_is_tried_with_each_end_of_a_line_once_and_in_order() -> None:
    tried = list[tuple[int, bytes]]()

    class Silent(Terminal):
        def hears(self, step: Exchange) -> Heard:
            """Nothing."""
            if step.data:
                tried.append((self.speed, step.data.removeprefix(b"!!")))
            return Heard((), step.most_s)

    with pytest.raises(UnclearError, match="nothing answers at any speed"):
        met(Silent(), yes)
    assert tried == [(baud, end) for baud in BAUDS for end in ENDS]


def test_a_converter_that_echoes_beside_an_echoing_controller_is_told() -> None:
    class Doubled(Terminal):
        def hears(self, step: Exchange) -> Heard:
            """Each letter comes twice as it is typed; what is printed, once."""
            heard = super().hears(step)
            typed = step.data.rstrip(b"\r\n")
            twice = bytes(letter for letter in typed for _ in range(2))
            return Heard(tuple((at_s, said.replace(typed, twice, 1)) for at_s, said in heard.pieces), heard.seconds)

    with pytest.raises(UnclearError, match="the serial converter and the controller both echo"):
        met(Doubled(), yes)


def test_only_where_the_person_agrees_does_a_joint_turn_and_only_where_asked_for_are_places_taken_by_the_pendant() -> (
    None
):
    for agrees, pendant in ((False, False), (True, False), (False, True), (True, True)):
        terminal = Terminal()
        known, asked, _ = met(terminal, yes if agrees else no_moves, pendant)
        assert any("DRIVE" in line for line in terminal.lines) == known.moved == agrees
        assert [consult.about for consult in asked] == ["move", *(["pendant"] if pendant else [])]
        assert known.findings["digits"].value == (2, 3)


@given(late_s=st.integers(5, 250).map(lambda hundredths: hundredths / 100))
def test_a_prompt_that_comes_late_is_waited_for_twice_as_long(late_s: float) -> None:
    class Late(Terminal):
        def hears(self, step: Exchange) -> Heard:
            """The prompt comes by itself, so long after what was said before it."""
            heard = super().hears(step)
            if not heard.data.endswith(b"."):
                return heard
            pieces = ((0.1, heard.data[:-1]), (0.1 + late_s, b"."))
            return Heard(pieces, 0.1 + late_s + step.quiet_s)

    found = met(Late(), no_moves)[0].findings
    assert found["prompt_late_s"].value == round(late_s, 2)
    assert found["resync_s"].value == round(max(1.0, 2 * late_s + 0.5), 1)


class Drives(Terminal):
    """One whose joints turn otherwise than they are told to, by what `drive` makes of joint and degrees: an error, or
    by how many degrees which joint turns."""

    drive: Callable[[int, float], str | tuple[int, float]]

    def carried_out(self, line: str) -> str:
        """See Terminal."""
        if not line.startswith("DO DRIVE "):
            return super().carried_out(line)
        joint, degrees, _ = line.removeprefix("DO DRIVE ").split(",")
        turns = type(self).drive(int(joint), float(degrees))
        if isinstance(turns, str):
            return turns
        self.going = turns[0] - 1, turns[1]
        return ""


@pytest.mark.parametrize(
    ("drive", "told"),
    [
        (lambda joint, _: (joint, 0.0), r"joint \d does not turn; is the arm held, or its brake on"),
        (lambda joint, degrees: (joint, degrees / 2 if joint == 3 else degrees), r"joint 3 was to turn by \+2 degrees"),
        (lambda joint, degrees: (5 if joint == 4 else joint, degrees), r"joint 4 was to turn by \+2 degrees, and the"),
        (
            lambda joint, degrees: "*Joint 4 out of range*" if joint == 4 else (joint, degrees),
            r"joint 4 cannot be turned: the controller says \*Joint 4 out of range\*. What does it need",
        ),
        (lambda *_: "*Illegal command*", r"typed slowly, are answered by \*Illegal command\*: another system"),
    ],
    ids=["held", "half the way", "another joint", "neither way", "unknown"],
)  # fmt: skip
def test_a_joint_that_does_not_turn_as_told_ends_it_with_what_turned(
    drive: Callable[[int, float], str | tuple[int, float]], told: str
) -> None:
    with pytest.raises(UnclearError, match=told):
        met(type("OtherDrives", (Drives,), {"drive": staticmethod(drive)})(), yes)


def test_a_line_that_comes_back_spoilt_three_times_is_never_ended() -> None:
    class Noisy(Terminal):
        def hears(self, step: Exchange) -> Heard:
            """What moves is echoed with a letter too few."""
            heard = super().hears(step)
            return Heard(tuple((at_s, said.replace(b"DRIVE", b"DIVE")) for at_s, said in heard.pieces), heard.seconds)

    terminal = Noisy()
    with pytest.raises(UnclearError, match=r"'DO DRIVE .*' came back as b'DO DIVE .*', three times, and was not ended"):
        met(terminal, yes)
    assert terminal.going is None
    assert not any("DRIVE" in line and "!!" not in line for line in terminal.lines)


@pytest.mark.parametrize("asks", [False, True])
def test_an_arm_is_calibrated_by_the_word_that_its_controller_wants_and_a_yes_where_it_asks(asks: bool) -> None:
    class Asking(Terminal):
        def answers(self, line: str) -> str:
            """See Terminal."""
            if asks and line == "CALIBRATE":
                self.lines.append(line)
                return f"{self.newline}Are you sure (Y/N)? "
            return super().answers("CAL" if line == ("Y" if asks else "CALIBRATE") else line)

    terminal = Asking(calibrated=False, abbreviations=False)
    known, asked, told = met(terminal, yes)
    assert terminal.calibrated
    assert [consult.about for consult in asked] == ["move", "calibrate"]
    assert "May I type CALIBRATE?" in asked[1].text
    assert "calibrated: CALIBRATE was carried out" in told
    assert known.moved
