"""The operator's tool, `facetctl`: commands without a daemon, by their modules; all others go to the running daemon.

Exit status: 0 done, 1 not done (refused, missed), 2 not understood, or no daemon, 3 the daemon did not answer a stop in
time: press the emergency stop.
"""

from __future__ import annotations

import signal
import sys

if (__name__ == "__main__" or sys.argv[0].endswith("facetctl")) and (
    signal.getsignal(signal.SIGINT) is signal.default_int_handler
):
    # Nothing was said to a daemon before main(): control-C ends the tool by the signal, without a traceback.
    signal.signal(signal.SIGINT, signal.SIG_DFL)

import argparse
import contextlib
import difflib
import importlib
import json
import os
import re
import shlex
import shutil
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from daemon import VERSION
from daemon.console.aliases import job_words
from daemon.console.stop_words import withdraws_permission
from daemon.errors import DONE as DONE
from daemon.errors import NOT_DONE as NOT_DONE
from daemon.errors import NOT_UNDERSTOOD as NOT_UNDERSTOOD
from daemon.errors import STOP_UNANSWERED as STOP_UNANSWERED
from daemon.errors import FacetdError, spelt, visible
from daemon.frontends.client import (
    DaemonLink,
    DaemonUnreachableError,
    StopUnansweredError,
    despite_full_disk,
    stop_unanswered,
)
from daemon.store.outside import FileError, fill_standard_files, read_file

if TYPE_CHECKING:
    from daemon.console.interpreter import ConsoleCommand

TRAIN = "daemon.cli.offline"
OFFLINE: dict[str, str] = {
    "recognise": "daemon.cli.offline",
    "model": "daemon.cli.offline",
    "calibrate": "daemon.calibration.cli",
    "review": "daemon.review.cli",
    "replay": "daemon.fleet.cli",
    "runs": "daemon.fleet.cli",
    "fleet": "daemon.fleet.cli",
    "export": "daemon.review.cli",
    "tail": "daemon.review.cli",
    "dashboard": "daemon.dashboard.cli",
    "cameras": "daemon.cli.cameras",
    "snap": "daemon.cli.cameras",
    "stream": "daemon.cli.cameras",
    "demo": "daemon.cli.demo",
    "arm": "daemon.cli.arm",
    "thesis": "daemon.cli.thesis",
}
"""Command without a daemon -> the module that registers it. `train` works on files with --views, else in the daemon."""
OWN: dict[str, tuple[str, str]] = {
    "console": ("console", "a prompt for commands, with completion and history; control-C stops the arm"),
    "script": (
        "script FILE",
        "run commands from a file (- for stdin), one a line, up to the first that fails; a stop on stdin acts at once",
    ),
    "commission": (
        "commission [STEP]",
        "commission a cell, check by check, up to the first pick; continues where it ended last time",
    ),
    "completion": (
        "completion bash|zsh",
        'Tab completion for your shell: eval "$(facetctl completion bash)" in ~/.bashrc',
    ),
}
"""The tool's own commands: usage and meaning."""
BOTH = ("train", "calibrate", "cameras", "model", "doctor", "bundle")
"""Commands of the daemon that also work without it."""
HELP, VERSION_OPTION = ("-h", "--help"), "--version"
LARGEST_SCRIPT = 1_000_000
OWN_CODES = re.compile(r"(\A\r|\x1b\[\d*m)")


def main(arguments: list[str] | None = None) -> int:
    """Run one command; returns its exit status, also where standard files are closed or full."""
    as_signal = signal.getsignal(signal.SIGINT) is signal.SIG_DFL
    try:
        if as_signal:
            signal.signal(signal.SIGINT, signal.default_int_handler)
        _replace_closed_files()
        status = _main(arguments)
        sys.stdout.flush()
        return status
    except KeyboardInterrupt:
        pass
    except BrokenPipeError:
        _discard_output()
    except OSError as error:
        _discard_output()
        with contextlib.suppress(OSError):
            print(f"facetctl: output cannot be written: {error.strerror or error}", file=sys.stderr)
    finally:
        if as_signal:
            signal.signal(signal.SIGINT, signal.SIG_DFL)
    return NOT_DONE


def _replace_closed_files() -> None:
    """Replace closed standard files by /dev/null."""
    fill_standard_files()
    for name in ("stdin", "stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, os.fdopen(os.open(os.devnull, os.O_RDWR), "r" if name == "stdin" else "w"))


def _discard_output() -> None:
    """Discard buffered output: at exit Python would try again to write it, and print an error of its own."""
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _main(arguments: list[str] | None) -> int:
    words = list(sys.argv[1:] if arguments is None else arguments)
    socket_path, as_json = _take_options(words)
    words = job_words(words)
    if VERSION_OPTION in words:
        print(f"facetctl {VERSION}")
        return DONE
    try:
        if not words or any(word in HELP for word in words):
            return _help([word for word in words if word not in HELP], NOT_UNDERSTOOD if not words else DONE)
        if words[0].startswith("-"):
            print(
                f"facetctl: {words[0]}: no such option before a command; `facetctl --help` lists them", file=sys.stderr
            )
            return NOT_UNDERSTOOD
        if words[0] == "completion":
            return _completion(words[1:], socket_path)
        if _works_without_daemon(words):
            if words[0] == "dashboard" and socket_path is not None:
                words[1:1] = ["--socket", str(socket_path)]
            return _offline(OFFLINE.get(words[0], TRAIN), [*words, *(["--json"] if as_json else [])])
        return _online(words, socket_path, as_json)
    except DaemonUnreachableError as error:
        unanswered = isinstance(error, StopUnansweredError) or withdraws_permission(shlex.join(words))
        print(f"facetctl: {stop_unanswered(error) if unanswered else error}", file=sys.stderr)
        return STOP_UNANSWERED if unanswered else NOT_UNDERSTOOD


def _works_without_daemon(words: list[str]) -> bool:
    """Whether a command works without the daemon; those of BOTH depend on their arguments."""
    if words[0] == "train":
        return len(words) > 1
    if words[0] == "calibrate":
        return "--left" in words or words[1:2] in ([], ["quick"], ["board"], ["import"], ["export"])
    if words[0] == "cameras":
        return not {*words[1:]} & {"left", "right", "both"}
    if words[0] == "model":
        return words[1:2] not in ([], ["list"], ["use"])
    return words[0] in OFFLINE


def _take_options(words: list[str]) -> tuple[Path | None, bool]:
    """Remove --json and --socket from the front, and --json from the end, of the typed words; returns their values."""
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


def _parser(modules: Iterable[str]) -> tuple[argparse.ArgumentParser, Mapping[str, argparse.ArgumentParser]]:
    """A parser for the commands of modules, from their register(subparsers), and the parser of each command."""
    parser = argparse.ArgumentParser(prog="facetctl")
    subparsers = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for module in dict.fromkeys(modules):
        importlib.import_module(module).register(subparsers)
    return parser, subparsers.choices


def _offline(module: str, words: list[str]) -> int:
    """Run a command without a daemon. Unusable arguments, files or disks are one line on stderr."""
    parser, jobs = _parser([module])
    args, unknown = parser.parse_known_args(words)
    if unknown:
        jobs[words[0]].error(f"unrecognized arguments: {' '.join(unknown)}")
    out: Any = _SafeOutput(sys.stdout)
    errors: Any = _SafeOutput(sys.stderr)
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(errors):
        try:
            return int(args.run(args))
        except BrokenPipeError:
            raise
        except (FacetdError, OSError) as error:
            from daemon.store.files import plain

            job = f"calibrate {args.kind}" if args.command == "calibrate" else args.command
            print(f"facetctl {job}: {plain(error)}", file=errors)
            return NOT_UNDERSTOOD


class _SafeOutput:
    """Output that may hold texts from files: shows their control characters, and replaces names that are not UTF-8. The
    commands' own colours and carriage returns pass."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        """See TextIO."""
        pieces = OWN_CODES.split(text)
        return self._stream.write("".join(p if k % 2 else spelt(visible(p)) for k, p in enumerate(pieces)))

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


def _help(words: list[str], status: int) -> int:
    """Print the overview, or the help of one command, with or without a running daemon."""
    from daemon.commands import every_command
    from daemon.console.text_layout import prose

    commands = {name: c for c in every_command("simulated") for name in (c.name, *c.aliases)}
    jobs = _parser([*OFFLINE.values(), TRAIN])[1]
    if not words or words[0] == "help":
        print(_overview(commands, jobs))
        return status
    name = words[0]
    if name in OWN:
        print("\n".join([f"facetctl {OWN[name][0]}", *prose(OWN[name][1], _columns())]))
    elif name in commands:
        print(commands[name].described(_columns()))
        if name in BOTH and name in jobs:
            print("\nWithout a daemon, on files:\n")
    if name in jobs:
        kinds = next((a.choices for a in jobs[name]._actions if isinstance(a, argparse._SubParsersAction)), {})
        (kinds[words[1]] if words[1:2] and words[1] in kinds else jobs[name]).print_help()
    if name in OWN or name in commands or name in jobs:
        return status
    close = difflib.get_close_matches(name, [*OWN, *commands, *jobs], 1)
    hint = f"did you mean {close[0]}?" if close else "`facetctl --help` lists the commands"
    print(f"facetctl: {name}: no such command; {hint}", file=sys.stderr)
    return NOT_UNDERSTOOD


def _columns() -> int:
    """The terminal's width, characters."""
    return shutil.get_terminal_size().columns


def _overview(commands: Mapping[str, ConsoleCommand], jobs: Mapping[str, argparse.ArgumentParser]) -> str:
    from daemon.console.text_layout import fold, prose, table

    columns = min(_columns(), 80)
    online = prose(", ".join(sorted({c.name for c in commands.values()})), columns)
    offline = prose(", ".join(sorted({*jobs, "doctor", "bundle"})), columns)
    lines = [
        *fold("usage: facetctl [--socket PATH] [--json] COMMAND...     facetctl COMMAND --help", columns),
        "",
        *table([(f"  {usage}", text) for usage, text in OWN.values()], columns).splitlines(),
        "To the running daemon:",
        *online,
        "Without a daemon:",
        *offline,
        *fold("To begin: `facetd --sim` in one window, `facetctl console` in another.", columns),
    ]
    return "\n".join(lines)


def _completion(words: list[str], socket_path: Path | None) -> int:
    """Print a shell's completion script; or, for `of WORDS...`, the completions of the last word."""
    if words[:1] == ["of"]:
        print("\n".join(_completions(words[1:], socket_path)))
        return DONE
    from daemon.cli.shell_completion import SHELLS, script

    if len(words) != 1 or words[0] not in SHELLS:
        print(f"facetctl: usage: facetctl {OWN['completion'][0]}", file=sys.stderr)
        return NOT_UNDERSTOOD
    from daemon.commands import every_command

    online = [*(c.name for c in every_command("simulated")), "help"]
    print(script(words[0], online, _parser([*OFFLINE.values(), TRAIN])[1], OWN), end="")
    return DONE


def _completions(words: list[str], socket_path: Path | None) -> list[str]:
    """Completions of the last word from the running daemon; without one, the fixed choices."""
    try:
        with DaemonLink(socket_path) as link:
            return [option.rpartition(" ")[2] for option in link.options(" ".join(words))]
    except DaemonUnreachableError:
        from daemon.commands import every_command

        name, *begun = words
        choices = next((c.choices for c in every_command("simulated") if name in (c.name, *c.aliases)), ())
        return [] if callable(choices) or len(begun) != 1 else [c for c in choices if c.startswith(begun[0])]


def _online(words: list[str], socket_path: Path | None, as_json: bool) -> int:
    if words[0] in ("doctor", "bundle") and socket_path is None and not _daemon_runs():
        return _without_daemon(words, as_json)
    if words[0] == "model" and socket_path is None and not _daemon_runs():
        return _model_without_daemon(words[1:], as_json)
    with DaemonLink(socket_path) as link:
        try:
            return _connected(link, words, as_json)
        except KeyboardInterrupt:  # what was said just before may move the arm, and its answer was not waited for yet
            _tell(link.interrupt(_printer(as_json)), sys.stderr)
            return NOT_DONE


def _connected(link: DaemonLink, words: list[str], as_json: bool) -> int:
    if words[0] == "console":
        from daemon.frontends.console import converse

        return converse(link)
    if words[0] == "commission":
        from daemon.cli.commission import run

        return run(link, words[1:])
    if words[0] == "script":
        return _script(link, words[1:], as_json)
    return show(_one_shot(link, shlex.join(words), as_json), as_json)


def _daemon_runs() -> bool:
    try:
        DaemonLink().close()
    except DaemonUnreachableError:
        return False
    return True


def _one_shot(link: DaemonLink, text: str, as_json: bool) -> dict[str, Any]:
    """Run one command. A stop typed at this terminal meanwhile acts at once; any other line is reported as not done."""
    say = _printer(as_json)
    if not sys.stdin.isatty():
        return link.do(text, "one-shot", say)
    from daemon.frontends.keyboard import InputLines

    stops = [DONE]

    def stop(words: str) -> None:
        done = link.stop_separately(words, "one-shot", say)
        stops.append(STOP_UNANSWERED * (done["status"] == STOP_UNANSWERED))
        say(done["text"])

    with InputLines(stop, say) as typed:
        done = link.do(text, "one-shot", say, None if as_json else typed.answer)
    typed.drop()
    return done | {"status": max(done["status"], *stops)}


def _printer(as_json: bool) -> Callable[[str], None]:
    return lambda line: _tell(line, sys.stderr if as_json else sys.stdout)


def show(done: dict[str, Any], as_json: bool) -> int:
    """Print a result: its text (errors on stderr), or all of it as one JSON object; returns its status."""
    status = int(done["status"])
    if as_json:
        print(json.dumps({"status": status, "text": done["text"], **done["data"]}), flush=True)
    elif done["text"]:
        error = "error" in done["data"]
        _tell(f"facetctl: {done['text']}" if error else done["text"], sys.stderr if error else sys.stdout)
    return status


def _tell(text: str, stream: TextIO) -> None:
    """Print a text, wrapped at a terminal, unchanged to a file or a program."""
    from daemon.console.text_layout import fold

    with despite_full_disk():
        print("\n".join(fold(text, _columns())) if stream.isatty() else text, file=stream, flush=True)


def _script(link: DaemonLink, words: list[str], as_json: bool) -> int:
    """Run commands from a file (`-`: stdin), one a line; # begins a comment."""
    if len(words) != 1:
        print("facetctl: usage: facetctl script FILE", file=sys.stderr)
        return NOT_UNDERSTOOD
    from_stdin = words[0] == "-"
    try:
        written = "" if from_stdin else read_file(Path(words[0]), LARGEST_SCRIPT).decode()
    except (FileError, UnicodeDecodeError) as error:
        print(f"facetctl: {error if isinstance(error, FileError) else f'{words[0]}: {error}'}", file=sys.stderr)
        return NOT_UNDERSTOOD
    from daemon.frontends.keyboard import InputLines

    say, statuses = _printer(as_json), list[int]()

    def stop(text: str) -> None:
        statuses.append(show(link.stop_separately(text, "script", say), as_json))

    def dropped(text: str) -> None:
        statuses.append(NOT_DONE)
        say(text)

    with InputLines(stop, dropped) if from_stdin or sys.stdin.isatty() else contextlib.nullcontext() as typed:
        lines = iter(typed.waiting.get, None) if typed is not None and from_stdin else written.splitlines()
        status = _run_lines(link, words[0], lines, lambda: typed is not None and typed.stopped, as_json)
    return max(status, *statuses, DONE)


def _run_lines(link: DaemonLink, script: str, lines: Iterable[str], stopped: Callable[[], bool], as_json: bool) -> int:
    """Run each line after the one before, up to the first failure. stopped: whether a stop came meanwhile."""
    for number, line in enumerate(lines, 1):
        if stopped():
            return _end_script(script, number, "stop", NOT_DONE)
        if not line.split("#")[0].strip():
            continue
        done = link.do(line, "script", _printer(as_json))
        status = show(done, as_json)
        if status != DONE:
            return _end_script(script, number, "not done", status)
        if "interrupted" in done:  # this line may not move the arm, but a later one may
            return _end_script(script, number, "control-C", NOT_DONE)
    return DONE


def _end_script(script: str, number: int, why: str, status: int) -> int:
    print(f"facetctl: {script}:{number}: {why}; the rest was not run", file=sys.stderr)
    return status


def _model_without_daemon(words: list[str], as_json: bool) -> int:
    """`model list` and `model use N` without a daemon: the next start uses that version."""
    from daemon.commands.models import MODEL_USAGE, list_of, version_named
    from daemon.config import load_config
    from daemon.store import folders
    from daemon.store.files import hold
    from daemon.store.model_store import ModelStore

    try:
        store = ModelStore(load_config(folders.config_file()).state)
        if words in ([], ["list"]):
            answer = list_of(store)
            return show({"text": answer.text, "data": answer.data, "status": DONE}, as_json)
        if len(words) != 2:
            raise FacetdError(f"usage: {MODEL_USAGE}")
        version = version_named(store, words[1])
        hold(store.folder)
        store.use(version)
    except (FacetdError, OSError) as error:
        print(f"facetctl: {error}", file=sys.stderr)
        return NOT_UNDERSTOOD
    text = f"Version {version} is in use from the next start of facetd."
    return show({"text": text, "data": {"version": version}, "status": DONE}, as_json)


def _without_daemon(words: list[str], as_json: bool) -> int:
    command, *more = words
    if more:
        print(f"facetctl: {more[0]}: one word too many; usage: {command}", file=sys.stderr)
        return NOT_UNDERSTOOD
    from daemon.commands.maintaining import doctor_answer
    from daemon.config import load_config
    from daemon.maintenance import bundle, doctor
    from daemon.store import folders

    try:
        config = load_config(folders.config_file())
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
