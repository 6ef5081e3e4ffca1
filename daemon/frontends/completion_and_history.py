"""What the prompt offers by itself: earlier commands at the arrows, and at Tab what the daemon says a line may be."""

from collections.abc import AsyncGenerator, Awaitable, Callable, Iterable
from pathlib import Path

from prompt_toolkit.completion import CompleteEvent, Completer, Completion
from prompt_toolkit.document import Document
from prompt_toolkit.history import History

from daemon.store.files import write_atomically
from daemon.store.outside import FileError, open_to_append, read_file

HISTORY_LINES = 1000
LARGEST_HISTORY = 4_000_000


class DaemonCompleter(Completer):
    """Tab asks the daemon what the line may become."""

    def __init__(self, ask: Callable[[str], Awaitable[list[str]]]) -> None:
        self._ask = ask

    def get_completions(self, document: Document, complete_event: CompleteEvent) -> Iterable[Completion]:
        """None without waiting: the daemon must be asked."""
        return ()

    async def get_completions_async(
        self, document: Document, complete_event: CompleteEvent
    ) -> AsyncGenerator[Completion, None]:
        """The last word of each line that the daemon offers."""
        typed = document.text_before_cursor
        start = typed.rfind(" ") + 1
        for option in await self._ask(typed):
            end = "" if option.endswith("/") else " "
            yield Completion(f"{option[start:]}{end}", start - len(typed), display=option[start:])


class CommandHistory(History):
    """Commands of earlier sessions, one a line, as a shell keeps them; answers to questions are none."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._path = path
        self.remember = True

    def load_history_strings(self) -> Iterable[str]:
        """Newest first; the file is cut where it has become long."""
        try:
            lines = read_file(self._path, LARGEST_HISTORY).decode(errors="replace").splitlines()
            if len(lines) > 2 * HISTORY_LINES:
                write_atomically(self._path, "\n".join([*lines[-HISTORY_LINES:], ""]).encode())
        except (FileError, OSError):
            return []
        return lines[: -HISTORY_LINES - 1 : -1]

    def append_string(self, string: str) -> None:
        """Keep a command, unless it is the answer to a question."""
        for line in string.splitlines() if self.remember else ():
            if line.strip():
                super().append_string(line.strip())

    def store_string(self, string: str) -> None:
        """Write it behind the others; where that cannot be, this session remembers it all the same."""
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            with open(self._path, "a", encoding="utf-8", opener=open_to_append) as file:
                file.write(f"{string}\n")
        except OSError:
            return
