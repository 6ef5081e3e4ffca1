"""The command language: what is meant is found, what is wrong is said in one line, who said what is kept."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon.arm import Fault, RefusedError
from daemon.commands import every_command
from daemon.commands.controller_terminal import ROBOT_USAGE
from daemon.commands.moving import AUTO_USAGE
from daemon.console.interpreter import CommandResult, Interpreter, command
from daemon.events.pick_order import PickOrder
from tests.fakes.fake_context import FakeFrontend, fake_context


def say(context: Any, text: str, frontend: FakeFrontend | None = None) -> CommandResult:
    console = Interpreter(context, every_command("simulated"))
    return asyncio.run(console.interpret(text, frontend or FakeFrontend()))


@pytest.fixture
def context(tmp_path: Path) -> Any:
    return fake_context(tmp_path)


@pytest.mark.parametrize(
    ("text", "want", "status"),
    [
        ("", "", 0),
        ("   # a comment", "", 0),
        ("hlep", "hlep: no such command; did you mean help?", 2),
        ("tech cube", "tech: no such command; did you mean teach?", 2),
        ("review latest", "review: not a console command; run it in a shell: `facetctl review`", 2),
        ("facetctl status", "type the command without `facetctl`", 2),
        ("facetd> status", "type the command without the prompt `facetd>`", 2),
        ("flurb", "flurb: no such command; `help all` lists every command", 2),
        ("pick cub", "cub: no such taught part; did you mean cube?", 2),
        ("pick sphere", "sphere: no such taught part; choose from: cube", 2),
        ("pick cube now", "now: one word too many; usage: pick [LABEL]", 2),
        ("go", "position is missing: go POSITION; choose from: bin, home, survey", 2),
        ("go hom", "hom: no such position; did you mean home?", 2),
        ("auto on many", "N: expected a whole number from 1 to 1000000, found many", 2),
        ("auto on 0", "N: expected a whole number from 1 to 1000000, found 0", 2),
        ("auto on 3 evry 5", "evry: no such word; did you mean every?", 2),
        ("auto on every", "S is missing: auto on [N] [every S|signal] | auto resume | auto off | auto wait", 2),
        ("step maybe", "maybe: expected on or off; usage: step on|off", 2),
        ("teach", "LABEL is missing: `teach LABEL`; known labels: cube, pyramid", 2),
        ("teach Cube!", "Cube!: a label is small letters, digits and _, as in hex_bolt", 2),
        ("teach 'cube", "teach 'cube: No closing quotation", 2),
        ("confirm", "no move is waiting for confirmation", 1),
        ("robot dance", f"dance: expected cal, monitor or power-up; usage: {ROBOT_USAGE}", 2),
        ("auto", f"off, on, resume or wait is missing: {AUTO_USAGE}", 2),
        ("look banana", "banana: expected around; usage: look [around [N]]", 2),
    ],
)
def test_what_is_not_understood_is_said_in_one_line_with_the_right_word(
    context: Any, text: str, want: str, status: int
) -> None:
    answer = say(context, text)
    assert answer.text == want
    assert answer.status == status


def test_a_pick_before_anything_is_taught_says_how_to_teach(context: Any) -> None:
    context.trainer.model.labels = ()
    answer = say(context, "pick cube")
    assert (answer.text, answer.status) == ("no part is taught yet: `teach LABEL`, then `train`", 1)


@pytest.mark.parametrize(
    ("typed", "held"), [("y", True), ("n", False), ("enable", None), ("holding yes", None), ("", None)]
)
def test_only_a_yes_or_a_no_says_what_is_in_the_gripper_after_a_restart(
    context: Any, typed: str, held: bool | None
) -> None:
    """Somebody who types on takes nothing for empty that may hold a part."""
    context.cycle.fault, context.cycle.held = Fault("restarted: the daemon ended in verify"), None
    text = say(context, "resume", FakeFrontend(answers=[typed])).text
    assert context.cycle.held is held
    assert ("`holding yes` or `holding no`" in text) is (held is None)


@pytest.mark.parametrize(
    ("answers", "goes_on"), [(["n", "y"], True), (["n", "n"], False), (["n", "status"], False), (["what?"], False)]
)
def test_resume_goes_on_with_an_auto_that_was_cut_off_only_after_a_plain_yes(
    context: Any, answers: list[str], goes_on: bool
) -> None:
    begun: list[PickOrder] = []

    async def begin_auto(order: PickOrder) -> None:
        begun.append(order)

    context.begin_auto = begin_auto
    context.cycle.fault, context.cycle.held, context.cycle.pick_order = (
        Fault("restarted: the daemon ended in looking"),
        None,
        PickOrder(13),
    )
    frontend = FakeFrontend(answers=list(answers))
    text = say(context, "resume", frontend).text
    assert begun == ([PickOrder(13)] if goes_on else [])
    assert ("enable" in context.cycle.told) is goes_on
    answered = answers != ["n", "status"]
    assert ("resume" in context.cycle.told) is answered, "a no clears the fault, and no answer does not"
    assert ("`auto resume` continues it" in text) is (answered and not goes_on)
    assert all(said.startswith("Ignored: ") for said in frontend.said)
    assert len(frontend.asked) == len(answers) + len(frontend.said), (
        "what is no answer is told so, and it is asked again"
    )


def test_a_stop_while_resume_waits_for_its_answer_is_not_cleared_by_it(context: Any) -> None:
    context.cycle.fault, context.cycle.held = Fault("stopped by ann"), None

    class Stopping(FakeFrontend):
        async def ask(self, question: str) -> str:
            await context.cycle.stop("by bob")
            return await super().ask(question)

    assert say(context, "resume", Stopping(answers=["n"])).status == 1
    assert context.cycle.fault_text == "stopped by bob"


def test_resume_at_a_frontend_that_cannot_ask_moves_nothing(context: Any) -> None:
    context.cycle.fault, context.cycle.pick_order = Fault("stopped by ann"), PickOrder(2)
    assert "`auto resume` continues it" in say(context, "resume").text
    assert context.cycle.told == ["resume"]


@pytest.mark.parametrize("word", ["status", "STATUS", "stat", " status  # now"])
def test_case_and_unambiguous_abbreviations_are_accepted(context: Any, word: str) -> None:
    assert "2 of 3 picked" in say(context, word).text


def test_an_ambiguous_abbreviation_is_asked_back_not_guessed(context: Any) -> None:
    answer = say(context, "res")
    assert answer.status == 0, "only resume begins so"
    answer = say(context, "st")
    assert answer.status == 2
    assert "no such command" in answer.text


def test_help_names_every_command_and_help_of_one_tells_its_usage(context: Any) -> None:
    every = say(context, "help all").text
    for one in every_command("simulated"):
        assert one.usage in " ".join(every.split())
        assert one.usage in " ".join(say(context, f"help {one.name}").text.split())
    assert max(len(line) for line in every.splitlines()) <= 100
    assert "did you mean teach" in say(context, "help tech").text


def test_the_first_screen_of_help_is_ten_lines_on_any_terminal(context: Any) -> None:
    first = say(context, "help").text.splitlines()
    assert len(first) <= 10
    assert max(map(len, first)) < 40, "no line folds on forty columns"
    assert [line.split()[0] for line in first[:8]] == [c.name for c in every_command("simulated") if c.first]
    assert say(context, "?").text == say(context, "h").text == say(context, "help").text


def test_a_long_help_of_one_command_is_shown_page_by_page(context: Any) -> None:
    """On a serial terminal of 24 lines the usage of `calibrate` had scrolled away."""
    frontend = FakeFrontend(answers=[" "] * 5, columns=40, rows=24)
    answer = say(context, "help calibrate", frontend)
    assert frontend.said[0].startswith("calibrate stereo|")
    assert all(len(page.splitlines()) <= 22 for page in frontend.said)
    assert "9x6" in answer.text


@pytest.mark.parametrize(("columns", "rows"), [(80, 24), (40, 24), (79, 10)])
def test_help_all_is_shown_page_by_page_and_no_page_is_higher_than_the_terminal(
    context: Any, columns: int, rows: int
) -> None:
    frontend = FakeFrontend(answers=[" "] * 50, columns=columns, rows=rows)
    answer = say(context, "help all", frontend)
    pages = [*frontend.said, answer.text]
    assert len(pages) > 2
    assert all(len(page.splitlines()) <= rows - 2 for page in pages[:-1]), "its first line scrolls out of sight"
    assert len(pages[-1].splitlines()) <= rows - 1
    assert max(len(line) for page in pages for line in page.splitlines()) <= columns
    assert set(frontend.asked) == {"-- more (Enter, q) --"}
    if columns >= 60:
        (beside,) = {
            len(line) - len(line.lstrip()) for page in pages for line in page.splitlines() if line[:12] == " " * 12
        }
        assert beside > 12, "what is said of a word stays in its column where it is folded"
    told = " ".join(" ".join(pages).split())
    assert all(" ".join(c.summary.split()) in told for c in every_command("simulated"))
    left = FakeFrontend(answers=["q"], columns=columns, rows=rows)
    assert say(context, "help all", left).text == ""
    assert len(left.said) == 1


@pytest.mark.parametrize("name", [c.name for c in every_command("simulated") if c.name != "stop"])
def test_help_and_version_behind_any_word_do_nothing_else(context: Any, name: str) -> None:
    for asked in (f"{name} --help", f"{name} -h", f"{name} cube --help"):
        answer = say(context, asked)
        assert answer.status == 0
        assert answer.text.startswith(name)
    assert say(context, f"{name} --version").text.startswith("facetd ")
    assert context.cycle.told == context.log.records == []


@pytest.mark.parametrize(("word", "on"), [("step", False), ("dry", False)])
def test_a_switch_without_on_or_off_tells_how_it_is_and_switches_nothing(context: Any, word: str, on: bool) -> None:
    assert say(context, word).text == f"`{word}` is off; `{word} on` switches it on."
    assert context.cycle.told == []


def test_auto_wait_without_an_auto_says_so(context: Any) -> None:
    answer = say(context, "auto wait")
    assert (answer.text, answer.status) == ("auto is not running; `auto on` starts it", 1)


@pytest.mark.parametrize("word", ["accept", "rollback", "model use 2"])
def test_another_model_amid_an_auto_is_asked_about_and_refused_where_nobody_can_be_asked(
    context: Any, word: str
) -> None:
    taken: list[str] = []
    context.cycle.auto = True
    context.trainer.model_store.history, context.trainer.model_store.candidate = (1, 2), 4
    context.trainer.model_store.versions = lambda: [1, 2, 3, 4]
    for name in ("accept", "rollback", "take"):
        setattr(context.trainer, name, lambda *_, name=name: taken.append(name) or 2)
    context.trainer.coverages_of_version = lambda _: ()
    context.use_model = lambda *_: None
    assert "auto is on" in say(context, word).text
    assert say(context, word, FakeFrontend(answers=["n"])).status == 1
    assert taken == []
    assert say(context, word, FakeFrontend(answers=["y"])).status == 0
    assert len(taken) == 1


def test_every_answer_is_json_too(context: Any) -> None:
    for text in ("status", "help", "parts", "help pick", "enable", "nonsense"):
        answer = say(context, text)
        json.dumps(answer.data)


def test_who_moves_the_arm_or_changes_a_model_is_kept_and_who_looks_is_not(context: Any) -> None:
    say(context, "enable", FakeFrontend(name="terminal", who="anna"))
    say(context, "status")
    assert context.log.records == [("command", {"who": "anna", "door": "terminal", "text": "enable"})]


@pytest.mark.parametrize(
    "text", ["pick cube", "enable", "teach cube", "train", "go home", "robot monitor WHERE", "reload"]
)
def test_a_frontend_that_may_only_look_moves_nothing_and_changes_nothing(context: Any, text: str) -> None:
    answer = say(context, text, FakeFrontend(may="look"))
    assert answer.status == 1
    assert "is read-only" in answer.text
    assert context.cycle.told == []
    assert context.log.records == []


@pytest.mark.parametrize("text", ["disable", "pause"])
def test_a_frontend_that_may_only_look_may_take_motion_away(context: Any, text: str) -> None:
    assert "is read-only" not in say(context, text, FakeFrontend(may="look")).text


@pytest.mark.parametrize("text", ["resume", "enable"])
def test_and_gives_none_back_be_it_after_its_own_pause(context: Any, text: str) -> None:
    say(context, "pause", FakeFrontend(may="look"))
    assert "is read-only" in say(context, text, FakeFrontend(may="look")).text


def test_stop_is_heard_at_every_frontend_and_whatever_else_is_on_the_line(context: Any) -> None:
    answer = say(context, "stop at once please!!", FakeFrontend(may="look"))
    assert answer.status == 0
    assert context.cycle.told == ["stop by tester"]


def test_what_the_cycle_refuses_is_an_answer_with_its_words(context: Any) -> None:
    context.cycle.refuse_with = "the arm is not enabled: type `enable`"
    answer = say(context, "go home")
    assert (answer.status, answer.text) == (1, "the arm is not enabled: type `enable`")
    assert answer.data["error"] == answer.text


def test_a_fault_in_the_program_itself_is_an_answer_too_and_the_console_lives(context: Any) -> None:
    context.trainer.model_store.views = None
    answer = say(context, "views")
    assert answer.status == 1
    assert "internal error in facetd: TypeError" in answer.text
    assert say(context, "status").status == 0


@pytest.mark.parametrize(
    "text",
    ["go hostop", "go home stop", "jog z 2STOP!", "hostop", "pick custop", "status stop", "robot monitor x stop."],
)
def test_a_stop_typed_behind_half_of_another_line_is_one(context: Any, text: str) -> None:
    """In four of four tries at a console no stop was typed to the controller: the line was refused as no position."""
    answer = say(context, text, FakeFrontend(may="look"))
    assert answer.text == "Stopped. Nothing moves until `resume`."
    assert context.cycle.told == ["stop by tester"]


@pytest.mark.parametrize(
    "text",
    ["help stop", "note the belt had to stop", "teach doorstop", "here backstop", "pick cube # stop", "go stopper"],
)
def test_a_word_that_ends_in_stop_and_is_asked_for_is_none(context: Any, text: str) -> None:
    say(context, text)
    assert "stop by tester" not in context.cycle.told


def test_a_name_that_ends_in_stop_is_a_name(context: Any) -> None:
    say(context, "here backstop")
    say(context, "go backstop")
    say(context, "positions drop backstop")
    assert "stop by tester" not in context.cycle.told
    say(context, "go backstop")
    assert "stop by tester" in context.cycle.told


def test_a_name_that_only_a_commands_second_word_offers_is_a_name_and_a_list_that_cannot_be_read_holds_none() -> None:
    broken = False

    def acts(_: object) -> tuple[str, ...]:
        if broken:
            raise RefusedError("the list cannot be read")
        return ("show", "drop")

    @command("kit show|drop NAME", most=2, choices=acts, further=lambda _, word: ("doorstop",) * (word == "show"))
    async def kit(_: object, __: list[str], ___: object) -> CommandResult:
        """Of kits."""
        return CommandResult("")

    console = Interpreter(None, [kit])
    assert not console.means_stop("kit show doorstop")
    assert console.means_stop("kit show hostop")
    assert console.means_stop("kit drop doorstop")
    broken = True
    assert console.means_stop("kit show doorstop")


@pytest.mark.parametrize("text", ["stop '", 'stop "', "stop\xfc", "st\x00op", "\x1bstop", "STOP!", "sto", "halt\udcff"])
def test_no_line_is_too_odd_to_stop(context: Any, text: str) -> None:
    answer = say(context, text, FakeFrontend(who="o\ud800dd\x00", may="look"))
    assert (answer.status, answer.text) == (0, "Stopped. Nothing moves until `resume`.")
    assert context.cycle.told == ["stop by o\ud800dd\x00"]


def test_the_arm_is_stopped_before_anything_is_logged_and_though_nothing_can_be(context: Any) -> None:
    def full(*_: object, **__: object) -> None:
        assert context.cycle.told == ["stop by tester"]
        raise OSError(28, "No space left on device")

    context.log.record = full
    assert say(context, "stop").status == 0
    assert context.cycle.told == ["stop by tester"]


@pytest.mark.parametrize("word", ["stop", "abort", "disable"])
def test_a_stop_that_is_not_confirmed_is_not_called_done(context: Any, word: str) -> None:
    alarm = "stopped; NOT CONFIRMED: no answer: press the emergency stop"

    async def unconfirmed(*_: object) -> str:
        return alarm

    setattr(context.cycle, word, unconfirmed)
    answer = say(context, word)
    assert (answer.status, answer.text) == (1, alarm)


def test_enable_is_refused_by_a_controller_that_does_not_take_the_word_that_stops(context: Any) -> None:
    context.cycle.stop_refused_with = "the controller does not accept HALT (it answers `*Illegal command*`)"
    answer = say(context, "enable")
    assert answer.status == 1
    assert "does not accept HALT" in answer.text
    assert "arm.dialect.abort_word" in answer.text
    assert context.cycle.told == []


def test_an_enable_is_void_where_the_arm_was_stopped_while_its_stop_was_tried(context: Any) -> None:
    async def test_stop() -> None:
        await context.cycle.stop("by bob")

    context.cycle.test_stop = test_stop
    assert say(context, "enable").status == 1
    assert context.cycle.told == ["stop by bob"]


def test_an_enable_judges_the_calibration_that_there_is_once_the_stop_was_tried(context: Any) -> None:
    async def test_stop() -> None:
        context.calibration.hand_eye = None

    context.cycle.test_stop = test_stop
    answer = say(context, "enable")
    assert (answer.status, context.cycle.told) == (1, [])
    assert "no hand_eye" in answer.text


@pytest.mark.parametrize(("answers", "told"), [([], []), (["n"], []), (["y"], ["enable typed lines"])])
def test_without_a_hand_eye_the_arm_is_enabled_for_words_by_hand_only_and_after_a_yes(
    context: Any, answers: list[str], told: list[str]
) -> None:
    context.calibration.hand_eye = None
    answer = say(context, "enable", FakeFrontend(answers=answers))
    assert answer.status == (not told)
    assert context.cycle.told == told
    if not told:
        assert "has no hand_eye yet" in answer.text
    else:
        assert answer.text == "The arm is enabled for `robot` only."


@pytest.mark.parametrize(("said", "told"), [("y", "confirm"), ("n", "refuse"), ("", "refuse")])
def test_in_step_mode_the_move_is_shown_and_sent_only_after_a_yes(context: Any, said: str, told: str) -> None:
    context.cycle.slow, context.cycle.pending = True, "home: joints to 420 0 60 at 100 %"
    frontend = FakeFrontend(answers=[said, "n"])
    say(context, "go home", frontend)
    assert frontend.asked == ["home: joints to 420 0 60 at 100 %. Send it? [y/n]"]
    assert context.cycle.told == ["go home", told]


def test_a_view_that_is_not_there_is_told_before_anybody_is_asked_whether_to_remove_it(context: Any) -> None:
    context.trainer.model_store.labels = lambda: ["cube"]
    context.trainer.model_store.views = lambda _: [SimpleNamespace(number=n) for n in (1, 3)]
    frontend = FakeFrontend(answers=["y"])
    answer = say(context, "forget cube 2", frontend)
    assert (answer.status, answer.text) == (1, "there is no view cube/2; of cube there are 1, 3")
    assert frontend.asked == []


def test_completion_offers_commands_and_then_what_they_can_be_given(context: Any) -> None:
    console = Interpreter(context, every_command())
    assert console.complete("ste") == ["step"]
    assert console.complete("teach cube --") == ["teach cube --around", "teach cube --mesh"]
    context.trainer.model_store.views = lambda _: [SimpleNamespace(number=n) for n in (1, 2, 11)]
    assert console.complete("forget cube 1") == ["forget cube 1", "forget cube 11"]
    assert console.complete("model u") == ["model use"]
    assert console.complete("pick ") == ["pick cube"]
    assert console.complete("go s") == ["go survey"]
    assert console.complete("teach p") == ["teach pyramid"]
    assert console.complete("flurb x") == []
    assert "scatter" not in console.complete(""), "a real cell has no simulated hand"


@given(text=st.text(max_size=60))
def test_no_line_whatever_it_holds_ends_in_an_exception(text: str) -> None:
    context = fake_context(Path("/nonexistent"))
    answer = say(context, f"help {text}")
    assert answer.status in (0, 1, 2)
    assert say(context, f"q{text}").status in (0, 1, 2)


ENDS_MOTION = ("stop", "disable", "abort", "pause")
"""Of what moves or changes something, all that a frontend that may only look may say."""


@pytest.mark.parametrize(
    "name", [c.name for c in every_command("simulated") if c.does([]) != "look" and c.name not in ENDS_MOTION]
)
def test_a_frontend_that_may_only_look_is_refused_whatever_does_more_than_end_motion(context: Any, name: str) -> None:
    assert "is read-only" in say(context, name, FakeFrontend(may="look")).text
    assert context.cycle.told == []


@pytest.mark.parametrize(("stopping", "told"), [(True, "not confirmed at rest yet"), (False, "nothing moves until")])
def test_status_says_of_an_arm_that_is_being_stopped_no_sooner_that_nothing_moves(
    context: Any, stopping: bool, told: str
) -> None:
    """Beside `NOT CONFIRMED: press the emergency stop` it said that nothing moves."""
    standing = {
        **context.cycle.status(),
        "fault": "stopped by ann",
        "fault_code": "operator_stop",
        "stopping": stopping,
    }
    context.cycle.status = lambda: standing
    first = say(context, "status").text.splitlines()[0]
    assert f"STOPPED by ann ({'stopping: ' * stopping}{told}" in first


@pytest.mark.parametrize("word", ["open", "close"])
def test_a_hand_in_a_dry_run_is_not_said_to_have_moved(context: Any, word: str) -> None:
    context.cycle.dry = True
    assert say(context, f"hand {word}").text == "Dry run: planned, not sent."


def test_a_yes_that_comes_together_with_somebody_elses_ends_nothing_here(context: Any) -> None:
    """Who had begun the motion was told `no move waits`, and of its other moves nothing more."""
    context.cycle.slow, context.cycle.pending = True, "home: joints to 420 0 60 at 100 %"

    def decided() -> None:
        context.cycle.pending = context.cycle.doing = None
        raise RefusedError("no move is waiting for confirmation")

    context.cycle.confirm = decided
    assert say(context, "go home", FakeFrontend(answers=["y", "n"])).text == "At home."


@pytest.mark.parametrize(("word", "done"), [("y", "confirm"), ("Yes", "confirm"), ("n", "refuse"), ("no", "refuse")])
def test_y_and_n_answer_a_waiting_move_wherever_they_are_typed(context: Any, word: str, done: str) -> None:
    context.cycle.pending = "go home"
    assert say(context, word).status == 0
    assert context.cycle.told == [done]
    assert say(context, word).text == "no move is waiting for confirmation"


def test_a_y_typed_as_the_move_came_up_is_none_to_it(context: Any) -> None:
    context.cycle.pending, context.cycle.pending_s = "go home", 0.5
    assert "less than 1 s ago" in say(context, "y").text
    assert context.cycle.told == []


def test_a_frontend_that_may_only_look_confirms_nothing(context: Any) -> None:
    context.cycle.pending = "go home"
    assert "is read-only" in say(context, "y", FakeFrontend(may="look")).text
    assert context.cycle.told == []
