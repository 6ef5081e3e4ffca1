"""Clients as they were written for this robot elsewhere: lower case, LF CR, no look at the echo, numbers counted from
the end. Served over a real pseudo-terminal by `python -m drivers.simcell.controller`.
"""

import os
import re
import select
import signal
import subprocess
import sys
import termios
import time
import tty
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import serial
import yaml

from daemon.store import folders
from drivers.puma560 import NEST_RAD, READY_RAD, forward
from drivers.val2.location import Location, apart, location_from_matrix
from tests.fakes.waiting import PATIENCE_S, until

NUMBER = re.compile(rb"-?\d+(?:\.\d*)?")
SILENCE_S = 0.1


class PlainClient:
    """Opens the terminal without any library, types, and reads until a dot and then silence."""

    def __init__(self, path: Path) -> None:
        self._descriptor = os.open(path, os.O_RDWR | os.O_NOCTTY)
        tty.setraw(self._descriptor, termios.TCSANOW)
        attributes = termios.tcgetattr(self._descriptor)
        attributes[4] = attributes[5] = termios.B9600
        termios.tcsetattr(self._descriptor, termios.TCSANOW, attributes)
        termios.tcflush(self._descriptor, termios.TCIOFLUSH)

    def close(self) -> None:
        os.close(self._descriptor)

    def types(self, text: str) -> bytes:
        self.sends(text)
        return self.reads()

    def sends(self, text: str) -> None:
        os.write(self._descriptor, text.encode() + b"\n\r")

    def reads_up_to(self, end: bytes, patience_s: float = 15.0) -> None:
        """Character by character, without a look at silence."""
        heard, deadline_s = b"", time.monotonic() + patience_s
        while not heard.endswith(end):
            assert time.monotonic() < deadline_s, f"no {end!r}; heard {heard!r}"
            if select.select([self._descriptor], [], [], SILENCE_S)[0]:
                heard += os.read(self._descriptor, 1)

    def reads(self, until: bytes = b".?", patience_s: float = 15.0) -> bytes:
        heard, deadline_s = b"", time.monotonic() + patience_s
        while time.monotonic() < deadline_s:
            ready, _, _ = select.select([self._descriptor], [], [], SILENCE_S)
            if ready:
                heard += os.read(self._descriptor, 1)
            elif heard.rstrip()[-1:] and heard.rstrip()[-1] in until:
                return heard
        raise AssertionError(f"no prompt; heard {heard!r}")

    def where(self) -> tuple[Location, list[float]]:
        """The place and the joints: of all numbers, six, the six digits of the joints' names, six."""
        numbers = [float(number) for number in NUMBER.findall(self.types("where"))]
        assert numbers[-12:-6] == [1, 2, 3, 4, 5, 6]
        return Location(*numbers[-18:-12]), numbers[-6:]

    def travels_to(self, location: Location, patience_s: float = 10.0) -> None:
        deadline_s = time.monotonic() + patience_s
        while apart(self.where()[0], location)[0] > 0.02:
            assert time.monotonic() < deadline_s


class Program:
    """The simulated controller as a program of its own."""

    def __init__(self, path: Path, *options: str) -> None:
        self.path = path
        command = [sys.executable, "-m", "drivers.simcell.controller", "--pty", str(path), *options]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        assert self.process.stdout is not None
        self.first_line = self.process.stdout.readline()

    def ends(self, by: int = signal.SIGTERM) -> int:
        if self.process.poll() is None:
            self.process.send_signal(by)
        self.process.communicate(timeout=PATIENCE_S)
        return self.process.returncode


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "puma"


@pytest.fixture
def program(path: Path) -> Iterator[Program]:
    running = Program(path, "--time-scale", "20")
    yield running
    running.ends()


def test_a_client_written_elsewhere_moves_the_arm_and_reads_where_it_is(program: Program) -> None:
    client = PlainClient(program.path)
    client.types("speed 50")
    client.types("do ready")
    client.travels_to(location_from_matrix(forward(READY_RAD)))
    assert client.types("do move trans(520,0,-100,0,90,0)").endswith(b"\r\n.")
    client.travels_to(Location(520, 0, -100, 0, 90, 0))
    place, joints = client.where()
    np.testing.assert_allclose(forward(np.radians(joints))[:3, 3], [place.x_mm, place.y_mm, place.z_mm], atol=0.03)
    client.close()


def test_a_client_written_elsewhere_calibrates(program: Program) -> None:
    client = PlainClient(program.path)
    assert client.types("cal").rstrip().endswith(b"Are you sure (Y/N)?")
    assert client.types("y").endswith(b"\r\n.")
    client.close()


def test_a_client_written_elsewhere_sees_errors_between_asterisks(program: Program) -> None:
    client = PlainClient(program.path)
    assert client.types("do move trans(5000,0,0,0,0,0)").endswith(b"*Location out of range*\r\n.")
    client.close()


def test_a_client_written_elsewhere_teaches_a_precision_point_without_waiting_for_the_questions(
    program: Program,
) -> None:
    client = PlainClient(program.path)
    client.types("point #x\n\r10, 100, -190, 0, -30, 5\n\r")
    client.types("do move #x")
    client.types("do break")
    np.testing.assert_allclose(client.where()[1], [10, 100, -190, 0, -30, 5])
    client.types("do drive 6, -5.5, 30")
    client.types("do break")
    np.testing.assert_allclose(client.where()[1], [10, 100, -190, 0, -30, -0.5])
    client.close()


def test_the_terminal_survives_clients_coming_and_going(program: Program) -> None:
    for speed in (10, 20, 30):
        client = PlainClient(program.path)
        assert client.types(f"speed {speed}").removeprefix(b".") == f"speed {speed}\r\n.".encode()
        client.close()


def test_nothing_is_echoed_but_by_the_controller_whatever_the_client_sets_up(program: Program) -> None:
    descriptor = os.open(program.path, os.O_RDWR | os.O_NOCTTY)
    os.write(descriptor, b"where\n\r")
    heard = b""
    while select.select([descriptor], [], [], 0.3)[0]:
        heard += os.read(descriptor, 4096)
    assert heard.count(b"where") == 1
    assert heard.endswith(b".")
    os.close(descriptor)


def test_a_cold_start_is_brought_up_as_a_client_written_elsewhere_does(path: Path) -> None:
    program = Program(path, "--time-scale", "20", "--cold")
    client = PlainClient(path)
    assert b"?" in client.types("cal")
    assert b"?" in client.types("y")
    assert client.types("y").endswith(b".")
    client.types("cal")
    answer = client.types("y")
    assert b"*Arm power off*" in answer
    until(lambda: client.types("cal") and b"*" not in client.types("y"), "arm power")
    client.types("do ready")
    client.types("do break")
    np.testing.assert_allclose(client.where()[1], np.degrees(READY_RAD), atol=1e-3)
    client.close()
    assert program.ends() == 0


def test_a_public_driver_s_start_up_comes_to_its_end(path: Path) -> None:
    """`cal`, `y`, `do ready`, LF CR behind each; over when a dot stands directly behind a dot."""
    program = Program(path, "--time-scale", "20", "--line-ends", "both")
    client = PlainClient(path)
    for text, last in (("cal", b"? "), ("y", b".."), ("do ready", b"..")):
        client.sends(text)
        client.reads_up_to(last)
    client.travels_to(location_from_matrix(forward(READY_RAD)))
    client.close()
    program.ends()


def test_the_line_keeps_the_pace_of_its_baud(path: Path) -> None:
    program = Program(path)
    client = PlainClient(path)
    began_s = time.monotonic()
    answer = client.types("where")
    seconds = time.monotonic() - began_s - SILENCE_S
    assert seconds >= (len("where") + len(answer)) / 960.0 * 0.9
    np.testing.assert_allclose(client.where()[1], np.degrees(NEST_RAD), atol=1e-3)
    client.close()
    program.ends()


@pytest.mark.parametrize("by", [signal.SIGTERM, signal.SIGINT])
def test_the_path_is_a_link_to_the_terminal_and_is_gone_at_exit(path: Path, by: int) -> None:
    program = Program(path)
    assert str(path) in program.first_line
    assert path.is_symlink()
    assert Path(os.readlink(path)).is_char_device()
    assert program.ends(by) == 0
    assert not path.is_symlink()


def test_a_stale_link_is_replaced_and_a_file_is_not(path: Path) -> None:
    path.symlink_to("/dev/pts/99999")
    program = Program(path)
    assert path.exists()
    program.ends()
    path.write_text("mine")
    program = Program(path)
    assert program.ends() == 2
    assert path.read_text() == "mine"


def test_a_path_that_cannot_be_made_is_told_in_one_line(tmp_path: Path) -> None:
    program = Program(tmp_path / "no" / "such" / "folder")
    _, said = program.process.communicate(timeout=PATIENCE_S)
    assert program.process.returncode == 2
    assert said.count("\n") == 1
    assert "--pty" in said


@pytest.mark.parametrize("scale", ["0", "-1", "fast", "nan"])
def test_a_time_scale_that_makes_no_sense_is_refused(path: Path, scale: str) -> None:
    program = Program(path, "--time-scale", scale)
    program.process.communicate(timeout=PATIENCE_S)
    assert program.process.returncode == 2


def test_a_cell_s_file_says_which_arm_and_how_it_speaks_and_at_another_speed_nothing_is_understood(
    path: Path, tmp_path: Path
) -> None:
    made = yaml.safe_load((folders.HOUSE / "etc" / "simcell.yaml").read_text())
    made["arm"] |= {
        "start_deg": [0, 60, -150, 0, -40, 0],
        "baud": 4800,
        "manners": {"joint_signs": [1, -1, 1, 1, 1, 1]},
    }
    (tmp_path / "cell.yaml").write_text(yaml.safe_dump(made))
    program = Program(path, "--truth", str(tmp_path / "cell.yaml"), "--time-scale", "20")
    with serial.Serial(str(path), 9600, timeout=0.5) as line:
        line.write(b"WHERE\r")
        assert b"JT1" not in line.read(400)
    with serial.Serial(str(path), 4800, timeout=0.5) as line:
        line.write(b"!!\rWHERE\r")
        answer = line.read(400)
    assert [float(word) for word in answer.split(b"JT6")[1].split()[:6]] == [0, -60, -150, 0, -40, 0]
    program.ends()


def test_a_cell_s_file_that_cannot_be_used_is_told_in_one_line(path: Path, tmp_path: Path) -> None:
    program = Program(path, "--truth", str(tmp_path / "none.yaml"))
    _, said = program.process.communicate(timeout=PATIENCE_S)
    assert program.process.returncode == 2
    assert "none.yaml: cannot be read" in said
    assert said.count("\n") == 1
