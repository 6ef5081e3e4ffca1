"""`facetctl`: the operator's tool. Which module serves which offline job; everything else is said to the daemon.

Exit status: 0 done, 1 not done (refused, missed), 2 not understood, or no daemon there.
"""

from __future__ import annotations

import argparse
import importlib
import importlib.util
import json
import shlex
import sys
from pathlib import Path
from typing import Any

from daemon.doors.client import DaemonLink, NotThereError
from daemon.store.outside import FileError, read_file

OFFLINE: dict[str, str] = {
    "recognise": "daemon.jobs.offline",
    "model": "daemon.jobs.offline",
    "calibrate": "daemon.calibration.cli",
    "review": "daemon.review.cli",
    "replay": "daemon.review.cli",
    "runs": "daemon.review.cli",
    "export": "daemon.review.cli",
    "tail": "daemon.review.cli",
    "cameras": "daemon.jobs.cameras",
    "snap": "daemon.jobs.cameras",
    "stream": "daemon.jobs.cameras",
    "demo": "daemon.jobs.demo",
}
"""Command -> the module that registers it. `train` is both: with --views a job on files, without it the daemon's."""
DONE, NOT_DONE, NOT_UNDERSTOOD = 0, 1, 2
LARGEST_SCRIPT = 1_000_000
USAGE = """usage: facetctl [--socket PATH] [--json] COMMAND...

Talk to the running daemon:
  facetctl console             a prompt with completion and history (control-C stops the arm)
  facetctl COMMAND...          one command: status, look, pick cube, ... (`facetctl help` asks the daemon for all)
  facetctl script FILE         commands from a file, one a line; ends at the first that is not done
Jobs without a daemon (each with --help):
  {jobs}
  train --views FILE           teach from image files
  doctor, bundle               also work when no daemon runs
"""


def main(arguments: list[str] | None = None) -> int:
    """Run one command; returns its exit status."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    socket_path, as_json = _take_options(words)
    if not words or words[0] in ("-h", "--help"):
        print(USAGE.format(jobs=", ".join(OFFLINE)))
        return DONE if words else NOT_UNDERSTOOD
    try:
        if _needs_no_daemon(words):
            return _offline(OFFLINE.get(words[0], "daemon.jobs.offline"), [*words, *(["--json"] if as_json else [])])
        return _online(words, socket_path, as_json)
    except NotThereError as error:
        print(f"facetctl: {error}", file=sys.stderr)
        return NOT_UNDERSTOOD
    except KeyboardInterrupt:
        return NOT_DONE
    except BrokenPipeError:
        sys.stderr.close()
        return NOT_DONE


def _needs_no_daemon(words: list[str]) -> bool:
    """Whether it is a job on files; `train` and `calibrate` are both, told apart by what follows."""
    if words[0] == "train":
        return len(words) > 1
    if words[0] == "calibrate":
        return "--left" in words or words[1:2] in ([], ["-h"], ["--help"], ["quick"], ["import"], ["export"])
    return words[0] in OFFLINE


def _take_options(words: list[str]) -> tuple[Path | None, bool]:
    """Take --json and --socket off the front, and --json off the end, of what was typed."""
    socket_path, as_json = None, False
    while words and words[0] in ("--json", "--socket"):
        option = words.pop(0)
        if option == "--json":
            as_json = True
        elif words:
            socket_path = Path(words.pop(0))
    if words and words[-1] == "--json":
        words.pop()
        as_json = True
    return socket_path, as_json


def _offline(module: str, words: list[str]) -> int:
    """A job of a module that offers register(subparsers)."""
    parser = argparse.ArgumentParser(prog="facetctl")
    subparsers = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    importlib.import_module(module).register(subparsers)
    args = parser.parse_args(words)
    status: int = args.run(args)
    return status


def _online(words: list[str], socket_path: Path | None, as_json: bool) -> int:
    if words[0] in ("doctor", "bundle") and socket_path is None:
        try:
            link = DaemonLink()
        except NotThereError:
            return _without_daemon(words[0], as_json)
        link.close()
    with DaemonLink(socket_path) as link:
        if words[0] == "console":
            from daemon.doors.prompt import converse

            return converse(link)
        if words[0] == "script":
            return _script(link, words[1:], as_json)
        return _one_shot(link, shlex.join(words), as_json, "one-shot")


def _one_shot(link: DaemonLink, text: str, as_json: bool, door: str) -> int:
    def say(line: str) -> None:
        print(line, file=sys.stderr if as_json else sys.stdout, flush=True)

    asks = sys.stdin.isatty() and not as_json and door == "one-shot"
    done = link.do(text, door, say, _ask if asks else None)
    return show(done, as_json)


def show(done: dict[str, Any], as_json: bool) -> int:
    """Print an answer: text for people (what was not done on stderr), or everything as one JSON object."""
    status = int(done["status"])
    if as_json:
        print(json.dumps({"status": status, "text": done["text"], **done["data"]}), flush=True)
    elif done["text"]:
        error = "error" in done["data"]
        print(
            f"facetctl: {done['text']}" if error else done["text"], file=sys.stderr if error else sys.stdout, flush=True
        )
    return status


def _ask(question: str) -> str:
    try:
        return input(f"{question} ")
    except EOFError:
        return ""


def _script(link: DaemonLink, words: list[str], as_json: bool) -> int:
    """Commands from a file (`-`: stdin), one a line; # begins a comment."""
    if len(words) != 1:
        print("facetctl: usage: facetctl script FILE", file=sys.stderr)
        return NOT_UNDERSTOOD
    try:
        text = sys.stdin.read() if words[0] == "-" else read_file(Path(words[0]), LARGEST_SCRIPT).decode()
    except FileError as error:
        print(f"facetctl: {error}", file=sys.stderr)
        return NOT_UNDERSTOOD
    except UnicodeDecodeError as error:
        print(f"facetctl: {words[0]}: {error}", file=sys.stderr)
        return NOT_UNDERSTOOD
    for number, line in enumerate(text.splitlines(), 1):
        if not line.split("#")[0].strip():
            continue
        status = _one_shot(link, line, as_json, "script")
        if status != DONE:
            print(f"facetctl: {words[0]}:{number}: not done; the rest is left out", file=sys.stderr)
            return status
    return DONE


def _without_daemon(command: str, as_json: bool) -> int:
    """doctor and bundle when no daemon runs."""
    from daemon.commands.keeping import doctor_answer
    from daemon.config import load_config
    from daemon.store import places
    from daemon.store.outside import FileError
    from daemon.upkeep import bundle, doctor

    try:
        config = load_config(places.config_file())
        if command == "bundle":
            path = bundle.pack(config, Path.cwd())
            return show({"text": f"{path}: send this file.", "data": {"file": str(path)}, "status": DONE}, as_json)
    except (FileError, OSError) as error:
        print(f"facetctl: {error}", file=sys.stderr)
        return NOT_UNDERSTOOD
    answer = doctor_answer(doctor.examine(config, running=False))
    return show({"text": answer.text, "data": answer.data, "status": answer.status}, as_json)


if __name__ == "__main__":
    sys.exit(main())
