"""Random actions of operators, line, controller and clock on the whole daemon, checked by the motion monitor.

A hypothesis state machine over tests/fakes/whole_daemon.py. A story is recorded as calls of the rules below. A failing
one is shortened by leaving out calls while it still fails alike (a few dozen runs; hypothesis, which only sees the
draws, took minutes for less). Run by tests/unit/service/test_whole_daemon.py and tests/bench/long/surprises.py.
"""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable
from functools import wraps
from typing import Any

import yaml
from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    invariant,
    rule,
    run_state_machine_as_test,
)

from daemon.commands import every_command
from drivers.simcell.controller import LineFault, Mishap
from tests.fakes.whole_daemon import FASTEST, SLOWEST, Story

STEPS = 100
"""The number of steps of a story."""
HOUSE = settings(
    stateful_step_count=STEPS, deadline=None, suppress_health_check=list(HealthCheck), phases=[Phase.generate],
    report_multiple_bugs=False, database=None,
)  # fmt: skip
LEAVING_OUT_S = 120.0
"""How long a failing story may be shortened."""
NAMES = sorted({command.name for command in every_command("simulated")} | {"help"})
LABELS = ("cube", "pyramid", "triangular_prism", "pentagonal_prism")
USUAL = (
    *["enable", "resume", "go home", "go bin", "go survey", "pick", "auto on", "hand open", "hand close"] * 3,
    *["stop", "abort", "disable", "pause", "step on", "step off", "confirm", "refuse"] * 2,
    "pick cube", "look around", "cameras left", "cameras both", "auto on 2", "auto on every 9",
    "auto off", "auto resume", "holding no", "holding yes", "dry on",
    "dry off", "reload", "status", "where", "look", "scatter cube", "clear", "robot power-up", "robot cal", "here spot",
    "go spot", "positions drop spot", "place show", "place clear all",
)  # fmt: skip
GOES = (*["go home", "go bin", "go survey"] * 2, "pick", "hand open", "hand close", "robot cal")
MONITOR = ("WHERE", "STATUS", "SPEED 100", "SPEED 5", "TOOL TRANS(0,0,0,0,0,0)", "DO READY", "DO OPENI", "DO CLOSEI",
           "CAL", "CALI", "D MOVE TRANS(420,0,60,0,90,0)", "DO MOVE TRANS(420,0,0,0,90,0)", "EXEC PROG", "ABORT",
           "DO BREAK", "Y", "DO DRIVE 1,20,100", "DO SPEED 300 ALWAYS", "BASE 0,0,100", "!!")  # fmt: skip
KEYS = (*[line + "\r" for line in MONITOR if line != "!!"], *["y", "Y\r"] * 8, "n", "N\r", "DO READY", "\x15", "\x7f",
        "\r", "Y")  # fmt: skip
LEAVES = "\x1d"
"""Control-]."""
ARGUMENTS = ("", "", "on", "off", "home", "bin", "survey", "cube", "open", "close", "yes", "no", "wait", "2", "every 3",
             "resume", "monitor WHERE", "x", "'", "\\", "# stop", "; enable")  # fmt: skip
SLOW = ("train", "bundle", "doctor", "calibrate", "preview")
"""Commands that take seconds of real time and cause no motion that others do not cause."""
HEARD_S = 0.02
"""The time in which an operator reads, after control-C, whether there was anything to stop."""
CAL_S = 20.0
"""The longest duration of CAL."""
END_OF_STOP_S = 5.0
"""How long a moving arm may take to be reported at rest."""
CLEAR_MM = -150.0
"""So high a cube in the gripper, which is guarded as if it held none until the next pick has opened it, is clear of
everything on the table."""
SECONDS = st.sampled_from([0.0, 0.02, 0.1, 0.3, 0.7, 1.5, 4.0, 10.0])
ODD = (b"\x00", b"\x15", b"\x1b[A", b"\xff\xfe", b"{", b'{"do"', b"[]\n", b"null\n", b'{"answer": 1}\n',
       b'{"keys": "DO READY\\r"}\n', b'{"do": "stop \\u0000"}\n', b"\x1d", b"\t", b"\r\r")  # fmt: skip


def words() -> st.SearchStrategy[str]:
    """A line that an operator types: mostly a usual one, else any command, an abbreviation, or a typing error."""
    table = st.builds(
        "{} {}".format, st.sampled_from([n for n in NAMES if n not in SLOW]), st.sampled_from(ARGUMENTS)
    ).map(str.strip)
    begun = st.builds(lambda name, n: name[:n], st.sampled_from([n for n in NAMES if n not in SLOW]), st.integers(1, 6))
    monitor = st.sampled_from(MONITOR).map("robot monitor {}".format)
    shouted = st.sampled_from(USUAL).map(str.upper)
    spoiled = st.builds(
        "{}{}".format, st.sampled_from(USUAL), st.sampled_from(["'", " \u0000", "\u00e9", " # x", "\\", '"'])
    )
    usual = st.sampled_from(USUAL)
    return st.one_of(usual, usual, usual, usual, table, begun, monitor, shouted, spoiled)


BESIDE = ("SPEED 100", "SPEED 300", "TOOL TRANS(0,0,0,0,0,0)", "DO SPEED 300 ALWAYS", "WHERE", "", "DO DRIVE 1,85,90",
          "DO DRIVE 4,-30,100", "DO MOVE TRANS(380,100,120,0,90,0)", "DO CLOSEI", "DO OPENI", "EXEC PROG",
          "EXECUTE SWEEP")  # fmt: skip
"""Lines that another terminal types."""
SWEEP = ("DRIVE 1,40,100", "SPEED 300 ALWAYS", "DRIVE 2,-10,100", "DRIVE 1,45,100")
"""A program that the controller keeps until it is switched off."""
FAR_MM = [0.0, 0.0, 1e4]
"""A position that no place can have."""
JOGS_DEG = st.sampled_from([-90.0, -40.0, -12.0, -3.0, -0.5, 0.5, 3.0, 12.0, 40.0, 90.0])
FRONTEND, AT_WORK = st.integers(0, 3), st.sampled_from([True, True, False])
GOING = st.one_of(st.none(), st.none(), st.tuples(st.sampled_from(GOES), SECONDS))
"""The command that set the arm to work, and how long ago."""
STOPS = ("stop", "STOP", "sto", "stop now", "stop '", "stop \u00e9", "control-C", "disable", "abort", "SIGTERM")


Call = tuple[str, dict[str, Any]]
Going = tuple[str, float] | None


def kept(act: Callable[..., None]) -> Callable[..., None]:
    """A rule whose calls are recorded in the story's script."""

    @wraps(act)
    def keeping(machine: Surprises, **values: Any) -> None:
        machine.script.append((act.__name__, values))
        act(machine, **values)

    return keeping


class Surprises(RuleBasedStateMachine):
    """The state machine. Frontends 0 to 2 are at the socket, 3 is the serial terminal."""

    story: Story | None = None
    steps = 0
    """The number of steps of all stories."""
    last: list[Call]
    """The calls of the last story."""

    def __init__(self) -> None:
        super().__init__()
        type(self).last = self.script = []

    @initialize(
        may=st.sampled_from(["all", "all", "look"]), holds=st.booleans(), parts=st.integers(0, 9), at_end=st.booleans(),
        ready=st.booleans(),
    )  # fmt: skip
    @kept
    def begin(self, may: str, holds: bool, parts: int, at_end: bool, ready: bool) -> None:
        """Make a cell and a daemon; ready: already enabled."""
        self.story = Story(may, holds, parts=parts == 9 and not holds, prompt_at_end=at_end)
        self.story.cell.controller.machine.memory.programs["SWEEP"] = SWEEP
        if ready:
            self.there.frontends[0].say("enable")
            self.there.wait(0.5)

    @rule(frontend=FRONTEND, text=words(), seconds=SECONDS, first=AT_WORK)
    @kept
    def do(self, frontend: int, text: str, seconds: float, first: bool) -> None:
        """An operator types a line."""
        self.set_to_work(first)
        self.there.frontends[frontend].say(text)
        self.there.wait(seconds)

    @rule(
        frontend=FRONTEND,
        texts=st.lists(st.sampled_from(USUAL), min_size=2, max_size=4),
        seconds=SECONDS,
        first=AT_WORK,
    )
    @kept
    def do_at_once(self, frontend: int, texts: list[str], seconds: float, first: bool) -> None:
        """An operator types several lines at once."""
        self.set_to_work(first)
        for text in texts:
            self.there.frontends[frontend].say(text)
        self.there.wait(seconds)

    @rule(frontend=FRONTEND, how=st.sampled_from(STOPS), going=GOING)
    @kept
    def stop_on_the_way(self, frontend: int, how: str, going: Going) -> None:
        """The arm moves and is stopped, mostly before it arrives."""
        self.send_off(going)
        if how == "control-C":
            self.there.frontends[frontend].interrupt()
            self.there.wait(HEARD_S)
        elif how == "SIGTERM":
            self.end_and_start()
        else:
            self.there.frontends[frontend].say(how)
        self.there.wait(1.0)

    @rule(
        frontend=st.integers(0, 1), keys=st.lists(st.sampled_from(KEYS), min_size=1, max_size=8), seconds=SECONDS,
        first=AT_WORK, leaves=AT_WORK,
    )  # fmt: skip
    @kept
    def talk_to_the_controller(self, frontend: int, keys: list[str], seconds: float, first: bool, leaves: bool) -> None:
        """An operator uses the controller's own terminal, and mostly leaves it again."""
        self.set_to_work(first)
        self.there.cell.controller.faults.line.clear()  # what is spoiled is no line that anybody typed
        here = self.there.sockets[frontend]
        here.say("robot monitor")
        for pressed in keys:
            self.there.wait(0.4)
            here.press(pressed)
        self.there.wait(seconds)
        if leaves:
            here.press(LEAVES)
            self.there.wait(0.1)

    @rule(
        frontend=FRONTEND,
        text=st.sampled_from(["y", "y", "y", "n", "", "stop", "stop now", "yes", "maybe", "disable", "abort"]),
        seconds=SECONDS,
    )
    @kept
    def answer(self, frontend: int, text: str, seconds: float) -> None:
        """An operator types an answer, whether or not there is a question."""
        self.there.frontends[frontend].answer(text)
        self.there.wait(seconds)

    @rule(frontend=FRONTEND, seconds=SECONDS, going=GOING)
    @kept
    def interrupt(self, frontend: int, seconds: float, going: Going) -> None:
        """Control-C."""
        self.send_off(going)
        self.there.frontends[frontend].interrupt()
        self.there.wait(max(seconds, HEARD_S))

    @rule(frontend=FRONTEND, data=st.one_of(st.sampled_from(ODD), st.binary(max_size=6)), going=GOING)
    @kept
    def odd_bytes(self, frontend: int, data: bytes, going: Going) -> None:
        """Send random bytes and a line end, so that no rest precedes the next line."""
        self.send_off(going)
        if b"\x03" not in data:
            self.there.frontends[frontend].throw(data + (b"\n" if frontend < 3 else b"\x15"))
            self.there.wait(0.02)

    @rule(frontend=st.integers(0, 2), going=GOING)
    @kept
    def come_again(self, frontend: int, going: Going) -> None:
        """An operator disconnects and reconnects."""
        self.send_off(going)
        self.there.frontends[frontend].close()
        self.there.wait(0.05)
        self.there.frontends[frontend].open()

    @rule(
        way=st.sampled_from(["to_host", "to_controller"]),
        harm=st.sampled_from(["drop", "double", "flip", "insert"]),
        after=st.integers(0, 40),
        count=st.integers(1, 3),
        going=GOING,
    )
    @kept
    def spoil(self, way: Any, harm: Any, after: int, count: int, going: Going) -> None:
        """Damage some of the next bytes on the line."""
        self.send_off(going)
        self.there.harm(lambda: self.there.cell.controller.faults.line.append(LineFault(way, harm, after, count)))

    @rule(seed=st.integers(0, 99), seconds=st.sampled_from([1.0, 5.0]), going=GOING)
    @kept
    def noise(self, seed: int, seconds: float, going: Going) -> None:
        """Noise on the line for a while."""
        self.send_off(going)
        faults = self.there.cell.controller.faults
        self.there.harm(lambda: faults.seed_noise(seed, 0.01))
        self.there.wait(seconds)
        faults.noise_rate = 0.0

    @rule(what=st.sampled_from(list(Mishap)), share=st.sampled_from([None, 0.1, 0.5, 0.9]), going=GOING)
    @kept
    def mishap(self, what: Mishap, share: float | None, going: Going) -> None:
        """Power, emergency stop, controller: now, or in the next move."""
        self.send_off(going)
        if share is None:
            self.there.mishap(what)
        else:
            faults = self.there.cell.controller.faults
            self.there.harm(lambda: faults.in_move.append((share, what)))

    @rule(text=st.sampled_from(BESIDE), going=GOING)
    @kept
    def type_beside(self, text: str, going: Going) -> None:
        """Another terminal types on the arm's line; the daemon receives its echoes and answers."""
        self.send_off(going)
        self.there.type_beside(text)

    @rule(joint=st.integers(0, 5), degrees=JOGS_DEG, seconds=SECONDS, at_rest=AT_WORK, going=GOING)
    @kept
    def take_the_pendant(self, joint: int, degrees: float, seconds: float, at_rest: bool, going: Going) -> None:
        """A person turns a joint with the teach pendant: at once, which brakes a moving arm, or once it is at rest."""
        self.send_off(going)
        self.there.by_pendant(joint, degrees, at_rest)
        self.there.wait(seconds)

    @rule(how=st.sampled_from(["stop", "abort", "disable"]), seconds=SECONDS, going=GOING)
    @kept
    def close_the_gripper_by_the_pendant(self, how: str, seconds: float, going: Going) -> None:
        """The arm is stopped, somebody closes the gripper on a part at the teach pendant, and a pick is asked for."""
        self.send_off(going)
        here = self.there.sockets[0]
        here.say(how)
        self.there.wait_for(here, END_OF_STOP_S)
        if self.there.cell.world_from_tool()[2, 3] > CLEAR_MM:
            self.there.close_by_pendant()
        self.set_to_work()
        here.say("pick")
        self.there.wait(seconds)

    @rule(joint=st.integers(0, 2), degrees=JOGS_DEG, going=GOING)
    @kept
    def exchange_the_arm(self, joint: int, degrees: float, going: Going) -> None:
        """Plug the adapter into another controller, which has just started and whose arm is elsewhere."""
        self.send_off(going)
        self.there.exchange_arm(joint, degrees)

    @rule(what=st.sampled_from(["slips", "is pushed", "is taken"]), seconds=SECONDS, going=GOING)
    @kept
    def move_a_part(self, what: str, seconds: float, going: Going) -> None:
        """What the gripper holds slips out of it, or a part on the table is pushed or taken away."""
        self.send_off(going)
        self.there.move_part(what)
        self.there.wait(seconds)

    @rule(
        camera=st.sampled_from(["left", "right"]),
        how=st.sampled_from(["away", "frozen", "stale", "half", None]),
        going=GOING,
    )
    @kept
    def harm_a_camera(self, camera: str, how: Any, going: Going) -> None:
        """A camera disappears, freezes (with or without fresh noise), delivers incomplete images, or recovers."""
        self.send_off(going)
        self.there.cell.camera.set_fault(camera, how)

    @rule(seconds=st.sampled_from([0.5, 5.0]), every=st.integers(1, 3), going=GOING)
    @kept
    def fill_the_disk(self, seconds: float, every: int, going: Going) -> None:
        """For a while all writes to files fail, or some."""
        self.send_off(going)
        self.there.fill_disk(seconds, every)

    @rule(empty=st.booleans(), going=GOING)
    @kept
    def replace_the_model(self, empty: bool, going: Going) -> None:
        """Another model is taken into use."""
        self.send_off(going)
        self.there.replace_model(empty)

    @rule(what=st.sampled_from(["refusal", "mute", "split", "late", "repeated"]), going=GOING)
    @kept
    def odd_controller(self, what: str, going: Going) -> None:
        """The controller refuses the next motion; its next answer is lost, or comes with the one after; its prompt
        comes in two halves; or it says again where the arm was when that was last asked."""
        self.send_off(going)
        faults = self.there.cell.controller.faults
        if what == "refusal":
            faults.refusals.append("*Location out of range*")
        else:
            harm = {"mute": ("mute_answers", 1), "split": ("split_prompt_s", 0.3), "late": ("late_answers", 1),
                    "repeated": ("repeated_places", 1)}  # fmt: skip
            self.there.harm(lambda: setattr(faults, *harm[what]))

    @rule(going=GOING)
    @kept
    def unplug(self, going: Going) -> None:
        """Unplug the line's adapter."""
        self.send_off(going)
        self.there.harm(self.there.line.unplug)

    @rule()
    @kept
    def repair(self) -> None:
        """Somebody puts line and controller right, and says what is to be said then; where nothing is wrong, nothing.
        A rule that could not be chosen then would leave other draws to a story lived again, in which a terminal was
        slower by a moment."""
        self.set_to_work()

    def send_off(self, going: Going) -> None:
        """Set the arm to work, and let some time pass."""
        if going is not None:
            self.set_to_work()
            self.there.frontends[0].say(going[0])
            self.there.wait(going[1])

    def set_to_work(self, wanted: bool = True) -> None:
        """Set the arm to work; a rule as `repair` is."""
        if not wanted or self.there.at_work:
            return
        self.there.repair()
        frontend, machine = self.there.sockets[0], self.there.cell.controller.machine
        for text in ("refuse", "robot power-up", "resume", "enable", "robot cal", "step off", "dry off"):
            if text == "robot cal" and machine.calibrated:
                continue
            frontend.say(text)
            self.there.wait_for(frontend, 2.0)
            frontend.answer("y")
            self.there.wait_for(frontend, CAL_S if text == "robot cal" else 2.0)

    @rule(seconds=st.sampled_from([0.5, 3.0, 30.0]), going=GOING)
    @kept
    def hang(self, seconds: float, going: Going) -> None:
        """Stall the computer for a while."""
        self.send_off(going)
        self.there.hang(seconds)

    @rule(seconds=st.sampled_from([-1e5, -3.0, 3.0, 1e5]), going=GOING)
    @kept
    def set_clock(self, seconds: float, going: Going) -> None:
        """Somebody sets the computer's clock."""
        self.send_off(going)
        self.there.set_by_s += seconds

    @rule(
        what=st.sampled_from(["same", "slow", "tool", "box", "home", "bad", "no hand-eye"]),
        signal=st.booleans(),
        going=GOING,
    )
    @kept
    def reload(self, what: str, signal: bool, going: Going) -> None:
        """Reload with another configuration or calibration."""
        self.send_off(going)
        story = self.there
        changes: Any = {
            "slow": {"travel_pct": SLOWEST},
            "tool": {"gripper": {"opening_mm": 80}},
            "box": {"limits": {"box_low_mm": [0, -600, -300], "max_speed_pct": FASTEST}},
            "home": {"home": {"point_mm": [400, 60, 80], "heading_deg": 90, "tilt_deg": 20}},
            "bad": {"order": "biggest"},
        }.get(what, {})
        story.write_config(**changes)
        calibration = story.folder / "calibration.yaml"
        good = calibration.read_bytes()
        if what == "no hand-eye":
            content = yaml.safe_load(good)
            del content["hand_eye"]
            calibration.write_bytes(yaml.safe_dump(content).encode())
        if signal:
            story.hang_up()
        else:
            story.frontends[0].say("reload")
        story.wait(0.3)
        calibration.write_bytes(good)
        if what == "bad":
            story.write_config()

    @rule(
        at_mm=st.dictionaries(
            st.sampled_from(["nest", "tray"]),
            st.sampled_from([[400.0, -250.0, -300.0], [450.0, 250.0, -300.0], [520.0, 0.0, -300.0], FAR_MM]),
        ),
        signal=st.booleans(),
        going=GOING,
    )
    @kept
    def change_the_places(self, at_mm: dict[str, list[float]], signal: bool, going: Going) -> None:
        """Write other places for the cubes, and reload."""
        self.send_off(going)
        self.there.write_places(**at_mm)
        if signal:
            self.there.hang_up()
        else:
            self.there.frontends[0].say("reload")
        self.there.wait(0.3)
        if FAR_MM in at_mm.values():  # which no daemon starts with
            self.there.write_places()

    @rule(text=st.sampled_from(["here spot", "positions drop spot"]), going=GOING)
    @kept
    def name_a_position(self, text: str, going: Going) -> None:
        """Another frontend names the arm's present position, also while it moves, or removes a name."""
        self.send_off(going)
        self.there.frontends[1].say(text)
        self.there.wait(0.3)
        self.there.frontends[1].answer("y")
        self.there.wait(0.3)

    @rule(going=GOING)
    @kept
    def terminate(self, going: Going) -> None:
        """Send SIGTERM, wait for the end, and start again."""
        self.send_off(going)
        self.end_and_start()

    def end_and_start(self) -> None:
        """See terminate."""
        status = self.there.terminate()
        assert status in (0, 2), f"it ended with status {status}"
        self.there.repair()
        self.there.start()
        assert self.there.alive, "it does not start again"

    @rule(seconds=st.sampled_from([1.0, 5.0, 20.0]))
    @kept
    def wait(self, seconds: float) -> None:
        """Let time pass without an action."""
        self.there.wait(seconds)

    @property
    def there(self) -> Story:
        """The present story."""
        assert self.story is not None
        return self.story

    @invariant()
    def nothing_surprises(self) -> None:
        """Check the motion monitor after every step."""
        type(self).steps += 1
        if self.story is not None:
            found = self.story.violations()
            assert not found, "\n".join(map(str, found))
            assert self.story.alive, "the daemon is no more"

    def teardown(self) -> None:
        """End the story and check it."""
        if self.story is not None:
            story, self.story = self.story, None
            found = story.close()
            assert not found, "\n".join(map(str, found))


def live(machine: type[Surprises], options: settings) -> None:
    """Run stories up to the first failure. Raises AssertionError with the shortest script that reproduces it."""
    try:
        run_state_machine_as_test(machine, settings=options)
    except Exception as error:
        script, once = machine.last, _told(error)
    else:
        return
    told = surprise(script)
    if told:
        script = shortest(script, lambda tried: kind(surprise(tried)) == kind(told))
        told = surprise(script)
    calls = "\n".join(f"    ({name!r}, {values})," for name, values in script)
    raise AssertionError(f"{told or f'once, and not when it was lived again: {once}'}\n{calls}")


def surprise(script: list[Call]) -> str:
    """The failure of a story with these calls; "" for none."""
    machine = Surprises()
    try:
        try:
            for name, values in script:
                getattr(machine, name)(**values)
                machine.nothing_surprises()
        finally:
            machine.teardown()
    except Exception as error:
        return _told(error)
    return ""


def _told(error: Exception) -> str:
    return "".join(traceback.format_exception_only(error)).strip()


def kind(told: str) -> str:
    """The kind of a failure: its text without times and lengths."""
    return told.partition(" at ")[0]


def shortest(script: list[Call], fails: Callable[[list[Call]], bool]) -> list[Call]:
    """Leave out calls while the story still fails, halves first, single ones last; the first call makes the cell."""
    until_s, size = time.monotonic() + LEAVING_OUT_S, len(script) // 2
    while size and time.monotonic() < until_s:
        start, before = 1, len(script)
        while start < len(script) and time.monotonic() < until_s:
            without = script[:start] + script[start + size :]
            if fails(without):
                script = without
            else:
                start += size
        if size > 1 or len(script) == before:
            size //= 2
    return script
