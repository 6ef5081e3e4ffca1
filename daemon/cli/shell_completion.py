"""Command `facetctl completion bash|zsh`: Tab completion for a shell, from the tables that `--help` shows.

The script asks the running daemon, when Tab is pressed, for words that depend on it (parts, views, positions).
"""

import argparse
import re
from collections.abc import Iterable, Mapping
from importlib import resources

SHELLS = ("bash", "zsh")
FILE_TYPES = frozenset({"Path"})
BEFORE = {"bash": "", "zsh": "autoload -Uz compinit bashcompinit && compinit && bashcompinit\n"}


def options(parser: argparse.ArgumentParser) -> tuple[list[str], list[str], bool]:
    """Words and options of a command, its options that take a file, and whether it has file arguments."""
    words: list[str] = []
    files: list[str] = []
    takes = False
    for action in parser._actions:  # argparse has no public interface for this
        words += action.option_strings
        is_file = getattr(action.type, "__name__", "") in FILE_TYPES
        if is_file:
            files += action.option_strings
            takes = takes or not action.option_strings
        if isinstance(action, argparse._SubParsersAction):
            for name, kind in action.choices.items():
                inner = options(kind)
                words += [name, *inner[0]]
                files += inner[1]
                takes = takes or inner[2]
        elif action.choices is not None:
            words += [str(choice) for choice in action.choices]
    return list(dict.fromkeys(words)), list(dict.fromkeys(files)), takes


def script(shell: str, asked: Iterable[str], jobs: Mapping[str, argparse.ArgumentParser], own: Iterable[str]) -> str:
    """The shell's script. asked: the daemon's commands; jobs: those without a daemon; own: the tool's."""
    asked, own = sorted(asked), sorted(own)
    taken = {name: options(parser) for name, parser in jobs.items()}
    files = sorted({option for _, follows, _ in taken.values() for option in follows} | {"--mesh", "--socket"})
    takers = [*sorted(name for name, (_, _, takes) in taken.items() if takes), "script"]
    cases = [f'            {name}) words="{" ".join(words)}" ;;' for name, (words, _, _) in sorted(taken.items())]
    cases.append(f'            completion) words="{" ".join(SHELLS)}" ;;')
    cases.append('            *) words="--help" ;;')
    values = {
        "files": "|".join(files),
        "first": " ".join(sorted({*asked, *own, *taken, "--help", "--version"})),
        "cases": "\n".join(cases),
        "asked": " ".join(asked),
        "takers": "|".join(takers),
    }
    text = (resources.files("daemon.cli") / "assets" / "completion.sh").read_text()
    return BEFORE[shell] + re.sub("@@([a-z]+)@@", lambda mark: values[mark[1]], text)
