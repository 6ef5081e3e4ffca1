"""`python -m drivers.simcell.controller --pty PATH`: a simulated VAL II controller for any program to talk to."""

from __future__ import annotations

import argparse
import os
import signal
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from drivers.simcell.arm import SimulatedArm
from drivers.simcell.controller.core import Controller
from drivers.simcell.controller.machine import Machine
from drivers.simcell.controller.manners import Manners, drawn
from drivers.simcell.controller.server import PtyServer
from drivers.simcell.truth import TruthError, load_truth

PERSON_AT_THE_PANEL_S = 2.0


def main(arguments: list[str] | None = None) -> int:
    """Serve until SIGINT or SIGTERM. Exit status 2 where PATH cannot be created."""
    options = _parser().parse_args(arguments)
    try:
        controller, baud = _of_cell(options) if options.truth else (_alone(options), options.baud)
    except TruthError as error:
        print(error, file=sys.stderr)
        return 2
    over, signalled = os.pipe()  # not an Event: a handler may run while the lock that it would take is held
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda *_: os.write(signalled, b"!"))
    with PtyServer(controller, baud, options.time_scale, at_any_speed=options.truth is None) as server:
        try:
            _link(options.pty, server.port)
        except OSError as error:
            print(f"--pty {options.pty}: {error.strerror}; name a path that can be created", file=sys.stderr)
            return 2
        print(f"VAL II controller on {options.pty} ({server.port}), {baud} baud", flush=True)
        os.read(over, 1)
        if options.pty.is_symlink() and os.readlink(options.pty) == server.port:
            options.pty.unlink()
    return 0


def _of_cell(options: argparse.Namespace) -> tuple[Controller, int]:
    """The controller of a simulated cell's file, calibrated, without a TOOL, and its baud rate. Raises TruthError."""
    settings = load_truth(options.truth).arm
    arm = SimulatedArm(settings.geometry(), np.radians(settings.start_deg))
    arm.tool = np.eye(4)
    made = Controller(Machine(arm, settings.controller_manners(), cold=settings.cold or options.cold))
    made.machine.calibrated = True
    return made, settings.baud


def _alone(options: argparse.Namespace) -> Controller:
    manners = Manners(
        prompt_after_move=options.prompt_after_move,
        arm_power_after_s=PERSON_AT_THE_PANEL_S,
        line_ends=options.line_ends,
    )
    if options.manners is not None:
        manners = replace(drawn(np.random.default_rng(options.manners)), arm_power_after_s=PERSON_AT_THE_PANEL_S)
    return Controller(Machine(SimulatedArm(), manners, cold=options.cold))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m drivers.simcell.controller", description="A simulated VAL II controller with a PUMA."
    )
    parser.add_argument("--pty", type=Path, required=True, metavar="PATH", help="becomes a link to the terminal")
    parser.add_argument("--time-scale", type=_positive, default=1.0, metavar="X", help="seconds of its time per second")
    parser.add_argument("--baud", type=int, default=9600, help="pace of the line (default 9600)")
    parser.add_argument("--cold", action="store_true", help="as after mains on: power-up questions, arm not calibrated")
    parser.add_argument(
        "--prompt-after-move", choices=("start", "end"), default="start", help="when DO MOVE gives the prompt back"
    )
    parser.add_argument(
        "--line-ends", choices=("cr", "lf", "both"), default="cr", help="what ends a line; both: LF CR gets two prompts"
    )
    parser.add_argument(
        "--truth",
        type=Path,
        metavar="FILE",
        help="the arm, manners and speed of a simulated cell's file (simcell.yaml)",
    )
    parser.add_argument("--manners", type=int, metavar="SEED", help="manners drawn at random")
    return parser


def _positive(text: str) -> float:
    value = float(text)
    if not 0 < value <= 1000:
        raise argparse.ArgumentTypeError(f"{text}: expected more than 0, at most 1000")
    return value


def _link(path: Path, port: str) -> None:
    """Make path a symbolic link to port; a stale link is replaced, anything else is not. Raises OSError."""
    if path.is_symlink():
        path.unlink()
    path.symlink_to(port)


if __name__ == "__main__":
    sys.exit(main())
