"""The installation, the operator's pages and RUNS.md, typed as they are: every command in its order, at a daemon on
a simulated cell, by somebody who also does with their hands what the text around it says; every key, on a pty."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
import yaml

from daemon.commands import every_command
from daemon.commands.step_mode import READ_S
from daemon.console.stop_words import means_stop
from daemon.frontends.client import DaemonLink
from daemon.store import folders
from tests.fakes.daemon_process import write_own_calibration
from tests.fakes.drawn import binary_stl, box, prism
from tests.fakes.first_day import answer_to, lives_through
from tests.fakes.made_run import quiet
from tests.fakes.person import Person
from tests.fakes.running import Running
from tests.fakes.waiting import until

pytestmark = [pytest.mark.long, pytest.mark.timeout(3000)]

SEED = int(os.environ.get("FACETD_SEED", "7"))
"""What the simulated cell's dice begin with: how parts fall, what the cameras' noise is."""
PATIENCE_S = 600.0
"""The longest that a line takes, on a slow and busy computer."""
COMMANDS = {name for command in every_command("simulated") for name in (command.name, *command.aliases)} | {"help"}
PIECE = re.compile(r"^ *```\n(.*?)^ *```|`([^`\n]+)`", re.MULTILINE | re.DOTALL)
TOUR = re.compile(r"(?:facetctl )?calibrate (stereo|hand-eye|verify|touch)(?: 9x6 16)?")
KEY = re.compile(r"\b(Tab|arrows|[Cc]ontrol-[A-Z\]])")
SPAN = re.compile(r"`([^`\n]+)`")
MADE = re.compile(r"<!-- made causes -->.*?<!-- end -->", re.DOTALL)
"""Names commands without their arguments."""

ELSEWHERE = (
    (r"git |sudo |systemctl |udevadm |ls -l /dev|DESTDIR=|make ", "tests/rig/run.py", "the machine's own"),
    (r"journalctl |ssh |eval |FACETD_PIP", "tests/rig/run.py", "the machine's own"),
    (r"facetctl (cameras|stream|snap)\b", "tests/unit/cli/test_cameras.py", "asks for real cameras"),
    (r"facetctl commission", "tests/cell/test_first_day.py", "a day of its own"),
    (r"calibrate camera|facetctl calibrate camera", "tests/cell/test_cell_one_camera.py", "a cell with one camera"),
    (
        r"(facetctl )?calibrate (quick|import|export|stereo --board)",
        "tests/unit/calibration/test_interchange.py",
        "on files",
    ),
    (r"facetctl (train|recognise) --calibration", "tests/unit/teaching/test_taught_from_a_drawing.py", "on files"),
    (r"calibrate by-hand", "tests/unit/calibration/test_guide.py", "a board held by somebody"),
    (r"facetd --sim", "tests/fakes/running.py", "is the daemon here"),
    (r"facetctl runs collect .*s3://", "tests/cell/test_cell_fleet.py", "a bucket"),
    (r"facetctl replay .*--cluster", "tests/cell/test_cell_fleet.py", "a scheduler elsewhere"),
)
"""What is not typed here: how it begins, what tries it instead, why."""
REFUSED = {
    "robot cal": "*Arm power off*",
    "robot power-up": "the controller asks no power-up question",
    "model use": "in use already",
    "notices": "notices appear only at `facetctl console`",
    "calibrate": "kind of calibration",
    "recognise": "the following arguments are required",
    "teach": "LABEL",
    "go": "POSITION",
    "look around": "without a name",
    "replay": " worse; named",
}
"""What may be refused, and in which words: a command named without its word; what is past; what is found and told."""
RUN_ON = {"facetctl dashboard": "http://127.0.0.1", "facetctl tail": "command", "facetctl console": "facetd>"}
"""What does not end by itself, and what it shows first."""
MOVES = ("pick", "look around", "auto on", "auto resume", "auto wait", "go", "jog", "hand", "calibrate", "robot cal",
         "confirm", "refuse")  # fmt: skip

WHILE_IT_WORKS = ("auto off", "auto wait", "status", "pause", "resume", "abort", "confirm", "refuse", "disable", "step",
                  "help", "notices")  # fmt: skip
"""What is typed beside a pick that goes on."""


def typed_in(guide: Path) -> list[tuple[str, str]]:
    """(section, what is to be typed) in the order of the text; a line once a section, a calibration's tour once."""
    found: dict[tuple[str, str], None] = {}
    toured: set[str] = set()
    whole = MADE.sub("", guide.read_text(encoding="utf-8"))
    for part in re.split(r"^(?=##)", whole, flags=re.MULTILINE):
        section = part.splitlines()[0].strip("# ")
        for block, span in PIECE.findall(part):
            for line in block.splitlines() or [span]:
                said, _, comment = line.strip().partition("  #")
                said = re.sub(r" {3,}.*", "", said)  # RUNS.md has what a line does beside it, without a #
                for text in (said, *SPAN.findall(comment)):
                    text = text.strip().removeprefix("facetd> ")
                    tour = TOUR.fullmatch(text)
                    if text and is_typed(text, guide.name) and not (tour and tour[1] in toured):
                        found[section, text] = None
                        toured |= {tour[1]} if tour else set()
    return list(found)


def is_typed(text: str, guide: str) -> bool:
    """Whether it is for a prompt or a shell, and not the name of a file, a key or what somebody sees."""
    first = text.split()[0]
    if first in ("facetctl", "facetd"):
        return len(text.split()) > 1
    if first in ("no", "yes"):  # a message begins so; as an answer it is typed where something is asked
        return False
    if guide == "RUNS.md":  # its tables name records and their fields by the same words
        return False
    return first in COMMANDS or any(re.match(begins, text) for begins, _, _ in ELSEWHERE) or text in ("sto", "STOP!")


def stand_in(text: str) -> tuple[str, str] | None:
    """What tries it instead, and why; None where it is typed here."""
    return next(((test, why) for begins, test, why in ELSEWHERE if re.match(begins, text)), None)


PAGES = ("teach", "train", "calibrate", "pick", "auto", "stop", "one-camera", "knock", "lamp",
         "failed-picks", "controller", "move-cell", "new-computer", "README", "trouble")  # fmt: skip
GUIDES = (
    folders.HOUSE / "docs" / "operate" / "first-hour.md",
    folders.HOUSE / "deploy" / "README.md",
    *(folders.HOUSE / "docs" / "operate" / f"{page}.md" for page in PAGES),
    folders.HOUSE / "deploy" / "RUNS.md",
)
"""In the order in which somebody reads them who first tries it in simulation, and then has a new cell."""


def test_whatever_is_not_typed_here_is_tried_where_it_is_said() -> None:
    for begins, test, _ in ELSEWHERE:
        assert (folders.HOUSE / test).exists()
        assert any(re.match(begins, text) for guide in GUIDES for _, text in typed_in(guide)), begins


@dataclass
class Operator:
    """Somebody with the guide in hand, at a daemon in a simulated cell."""

    daemon: Running
    begun: list[threading.Thread] = field(default_factory=list)

    def does(self, text: str) -> str:
        """What the text around the line says, then the line; what is wrong with what came of it."""
        text = self.filled_in("facetctl robot monitor" if text == "robot monitor" else text)
        self.prepares(text.removeprefix("facetctl "))
        status, said = self.in_a_shell(text) if text.startswith("face") else self.at_the_prompt(text)
        for thread in self.begun:
            thread.join(PATIENCE_S)
        self.begun.clear()
        bare = text.removeprefix("facetctl ")
        refused = any(bare.startswith(line) and words in said for line, words in REFUSED.items())
        if "calibrate touch" in text:  # the fingers are over the board, and in its way
            self.says("step off")
            self.says("go survey")
        if status == 0 or means_stop(bare) or refused:
            return ""
        return f"{status}: {said[-300:]}"

    def filled_in(self, text: str) -> str:
        """With what a person puts where the guide has capitals."""
        models = sorted((self.daemon.folder / "state" / "models").glob("*.npz"))
        runs = sorted(run for run in self.daemon.runs.iterdir() if run.is_dir())
        stands_for = {
            "COMMAND": "status", "FILE": "words.txt", "PART": "cube", "RUN": runs[-1].name,
            "NEW.npz": str(models[-1]) if models else "", "~/pairs": "pairs",
            "/srv/fleet": "fleet", "/srv/north/runs": "state/runs",
        }  # fmt: skip
        for name, value in stands_for.items():
            text = re.sub(rf"(?<![\w/]){re.escape(name)}(?!\w)", value, text)
        return re.sub(r" south=\S+", "", text)

    def at_the_prompt(self, text: str) -> tuple[int, str]:
        with DaemonLink(self.daemon.folder / "facetd.sock") as link:
            done = link.do(text, "console", lambda _: None, lambda asked: answer_to(asked) or "y")
        return done["status"], done["text"]

    def in_a_shell(self, text: str) -> tuple[int, str]:
        program, *words = shlex.split(text)
        if program == "facetd":
            words = ["--config", str(self.daemon.folder / "etc" / "facetd.yaml"), *words]  # a real cell's
        person = Person(self.daemon.folder, *words, program="daemon.main" if program == "facetd" else "daemon.ctl")
        shows = next((sign for line, sign in RUN_ON.items() if text.startswith(line)), None)
        if shows is None and text != "facetctl robot monitor":
            said = lives_through(person, PATIENCE_S)
            return person.leaves(), said
        for sign in (shows,) if shows is not None else ("stops the arm.", "."):  # the controller's own prompt
            person.sees(sign, 60.0)
        person.types("\x04" if text == "facetctl console" else "\x1d" if "monitor" in text else "\x03")
        return (0 if person.leaves() in (0, 1) else 2), ""

    def status(self) -> dict[str, object]:
        return self.daemon.do("status")["data"]

    def says(self, text: str) -> str:
        """A line that must be done, by somebody who says yes to each move where `step` is on."""
        done = self.daemon.do(text, "y")
        assert done["status"] == 0, f"{text}: {done['text']}"
        return str(done["text"])

    def prepares(self, text: str) -> None:
        """Lay parts there, let the arm move, have what the line is about."""
        words = text.split()
        if not (text.startswith(WHILE_IT_WORKS) or means_stop(text)):
            self.waits_until_idle()
        if text.startswith(MOVES) and words[1:2] not in (["list"], ["use"], ["off"]):
            self.lets_it_move()
        if text.startswith("look around"):
            self.says("scatter cube")
        elif words[0] in ("look", "try", "eyes"):
            self.says("show cube")
        if words[0] in ("pick", "auto"):
            self.says(f"scatter {words[1] if words[0] == 'pick' and words[1:] else 'cube'}")
        if text == "auto wait":
            self.says("auto on 1")
        if text == "auto resume":
            self.says("auto on 2")
            self.daemon.do("stop")
            self.lets_it_move()
        if text in ("confirm", "refuse"):
            self.says("step on")
            self.begun.append(threading.Thread(target=self.daemon.do, args=("go home",)))
            self.begun[-1].start()
            self.until(lambda: self.status()["pending"])
            time.sleep(READ_S)  # who agrees to a move has read which
        if text in ("accept", "rollback"):
            self.has_models(2)
            if text == "accept":
                self.says("train")
        if text.startswith("calibrate use") and words[2] != "0":
            while len(self.daemon.do("calibrate list")["data"]["numbers"]) < int(words[2]):
                self.lets_it_move()
                self.says("go survey")
                self.says("calibrate hand-eye")
        if words[:2] == ["positions", "drop"]:
            self.says(f"here {words[2]}")
        if words[0] == "forget" and words[2:]:
            while self.says(f"views {words[1]}").count(f"{words[1]}/") < int(words[2]):
                self.daemon.do(f"teach {words[1]}")
        if text.startswith(("model use", "replay")) and words[-1].isdigit():
            self.has_models(int(words[-1]))

    def has_models(self, count: int) -> None:
        """So many have been in use."""
        while len(self.daemon.do("model list")["data"]["models"]) < count:
            self.says("train")
            self.daemon.do("accept")

    def begins_anew(self, section: str) -> None:
        """A page of the guide is begun with no fault, and with moves that neither wait nor are only planned; the first
        hour, with nothing learnt; many cells, with runs that ended long ago."""
        if section == "Many cells":
            self.daemon.end()
            quiet(self.daemon.runs)
            self.daemon.start()
        if section == "The first hour":
            self.daemon.end()
            shutil.rmtree(self.daemon.folder / "state")
            self.daemon.start()
            for line in ("robot power-up", "enable", "robot cal", "resume", "enable", "robot cal"):
                self.daemon.do(line)
        for line in ("resume", "step off", "dry off"):
            self.daemon.do(line)
        if section.startswith("A cell with one camera"):  # it begins with a restart, which forgets `cameras right`
            for line in ("disable", "show cube", "cameras both"):
                self.says(line)

    def lets_it_move(self) -> None:
        """Nothing is done, no fault stands; enabled."""
        self.waits_until_idle()
        self.daemon.do("resume")
        if self.status().get("holding", False) is None:
            self.says("holding no")
        if not self.status()["enabled"]:
            self.says("enable")

    def waits_until_idle(self) -> None:
        if self.status()["doing"]:
            self.daemon.do("auto off")
            self.says("abort")
            self.until(lambda: not self.status()["doing"])

    def until(self, so: Callable[[], object]) -> None:
        until(so, "what it is to come to", PATIENCE_S)


@pytest.fixture
def operator(monkeypatch: pytest.MonkeyPatch) -> Iterator[Operator]:
    folder = Path(tempfile.mkdtemp(prefix="facetd-"))
    daemon = Running(folder, "", seed=SEED)
    truth = yaml.safe_load((folder / "simcell.yaml").read_text())
    truth["arm"] |= {"cold": True, "manners": {"arm_power_after_s": 1.0}}  # somebody presses the button, once asked
    (folder / "simcell.yaml").write_text(yaml.safe_dump(truth, sort_keys=False))
    (folder / "docs").symlink_to(folders.HOUSE / "docs")
    shutil.copytree(folders.HOUSE / "etc", folder / "etc")
    write_own_calibration(folder / "etc")
    (folder / "words.txt").write_text("status\npositions\n")
    (folder / "cube.stl").write_bytes(binary_stl(*box()))
    hexagon = [(0.8 * np.cos(a), 0.8 * np.sin(a)) for a in np.linspace(0.0, 2.0 * np.pi, 7)[:-1]]
    (folder / "hex_bolt.stl").write_bytes(binary_stl(*prism(hexagon, 1.8)))  # inches
    for name, value in (("PYTHONPATH", folders.HOUSE), ("FACETD_CONFIG", folder / "facetd.yaml"),
                        ("FACETD_RUNS", folder / "state" / "runs"), ("STATE_DIRECTORY", folder / "state")):  # fmt: skip
        monkeypatch.setenv(name, str(value))
    monkeypatch.chdir(folder)
    daemon.start()
    yield Operator(daemon)
    daemon.kill()
    monkeypatch.chdir(folders.HOUSE)
    shutil.rmtree(folder, ignore_errors=True)


def test_every_command_of_the_guide_is_done_in_its_order(operator: Operator) -> None:
    wrong, before = [], ""
    for guide in GUIDES:
        for section, text in typed_in(guide):
            if stand_in(text) is not None:
                continue
            if section != before:
                before = section
                operator.begins_anew(section)
            began = time.monotonic()
            try:
                said = operator.does(text)
            except AssertionError as error:
                said = f"!! {error}"
            print(f"{time.monotonic() - began:5.1f}  {section[:20]:20} {text:40} {said}", flush=True)
            if said:
                wrong.append(f"{guide.name}, {section}: `{text}`: {said}")
    assert wrong == [], "\n".join(wrong)


def test_every_key_of_the_guide_does_what_it_is_there_for(operator: Operator) -> None:
    named = {key.lower() for guide in GUIDES for key in KEY.findall(guide.read_text(encoding="utf-8"))}
    assert named == {"tab", "arrows", "control-c", "control-d", "control-]"}
    operator.says("robot power-up")
    person = Person(operator.daemon.folder, "console")
    person.sees("facetd>", PATIENCE_S)
    person.types("stat\t\r")
    person.sees("so far", PATIENCE_S)
    person.types("\x1b[A\r")
    person.sees("so far", PATIENCE_S)
    for level in ("faults", "all"):
        person.types(f"notices {level}\r")
        person.sees(f"notices {level}", PATIENCE_S)
    person.types("robot monitor\r")
    for sign in ("stops the arm.", "."):
        person.sees(sign, PATIENCE_S)
    person.types("\x1d")
    person.sees("Back at the console", PATIENCE_S)
    person.types("\x03")
    person.sees("Nothing moves.", PATIENCE_S)
    person.types("\x04")
    assert person.leaves() == 0
