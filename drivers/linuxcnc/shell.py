"""A connection to LinuxCNC's remote shell: send a line, receive a line. It knows nothing of arms.

Source: LinuxCNC 2.9, manual page linuxcncrsh(1). The answer to `get NAME` is the name and its values. The answer to
`set NAME ...` is `SET NAME ACK` or `NAK`, once LinuxCNC's task has received it (0.1 s); it does not say whether the
command worked. Only one connection at a time may set anything: the one that sent `enable` last.
"""

import asyncio
from collections.abc import Callable, Sequence
from contextlib import suppress

ANSWER_S, ASKED = 2.0, 3
LONGEST = 4096
"""The most bytes of a line; a longer one does not come from a remote shell."""


class ShellError(Exception):
    """The remote shell does not answer, or answers wrongly; the message says what and where, on one line."""


class RemoteShell:
    """A connection to a remote shell. on_line: called with every line, and whether it was sent (or received)."""

    def __init__(self, host: str, port: int, on_line: Callable[[str, bool], None]) -> None:
        self.where = f"LinuxCNC's remote shell at {host}:{port}"
        self._host, self._port, self._on_line = host, port, on_line
        self._turn = asyncio.Lock()
        self._streams: tuple[asyncio.StreamReader, asyncio.StreamWriter] | None = None

    @property
    def connected(self) -> bool:
        return self._streams is not None

    async def open(self, name: str, password: str) -> None:
        """Connect, log in, and set up the shell so that it answers every line. Raises ShellError."""
        await self.close()
        try:
            async with asyncio.timeout(ANSWER_S):
                self._streams = await asyncio.open_connection(self._host, self._port, limit=LONGEST)
        except (OSError, TimeoutError) as error:
            why = getattr(error, "strerror", None) or "no answer"
            raise ShellError(f"{self.where}: {why}: does LinuxCNC run, with linuxcncrsh?") from error
        try:
            answer = await self._exchange(f"hello EMC {name} 1.0", "set echo off", "set verbose on")
            while not answer.startswith(("SET VERBOSE", "HELLO NAK")):  # skip lines from before echo was off
                answer = await self._exchange()
        except ShellError as error:
            raise ShellError(f"{self.where} does not know `hello`") from error
        if not answer.endswith("ACK"):
            await self.close()
            raise ShellError(f"{self.where} refuses the connection ({answer!r})")
        await self.tell(f"enable {password}")

    async def close(self) -> None:
        """Close the connection; may be called twice."""
        streams, self._streams = self._streams, None
        if streams is not None:
            streams[1].close()
            with suppress(OSError):
                await streams[1].wait_closed()

    async def ask(self, name: str) -> list[str]:
        """Send `get NAME`. Returns the words of the answer, without the name. If another connection sends a request at
        the same moment, the shell mixes up both answers; then it is repeated. Raises ShellError."""
        for _ in range(ASKED):
            answer = await self._exchange(f"get {name}")
            first, *words = answer.split()
            if first.lower() == name and words != ["NAK"]:
                return words
        raise ShellError(f"{self.where}: {name!r} was answered by {answer!r}")

    async def tell(self, text: str, may: Callable[[], None] | None = None) -> None:
        """Send `set TEXT`. may: called immediately before sending; if it raises, nothing is sent and its error
        propagates. Raises ShellError."""
        answer = await self._exchange(f"set {text}", may=may)
        if answer.split()[-1:] != ["ACK"]:
            raise ShellError(f"{self.where} refuses {text.partition(' ')[0]!r} ({answer!r})")

    async def _exchange(self, *lines: str, may: Callable[[], None] | None = None) -> str:
        """Send lines, if any, and receive the next one. This completes even if the caller is cancelled; otherwise the
        next request would get this answer."""
        exchange = asyncio.ensure_future(self._one(lines, may))
        exchange.add_done_callback(lambda done: done.cancelled() or done.exception())
        return await asyncio.shield(exchange)

    async def _one(self, lines: Sequence[str], may: Callable[[], None] | None) -> str:
        async with self._turn:
            if self._streams is None:
                raise ShellError(f"{self.where}: there is no connection")
            if may is not None:
                may()
            reader, writer = self._streams
            try:
                async with asyncio.timeout(ANSWER_S):
                    for line in lines:
                        self._on_line(line, True)
                        writer.write(f"{line}\r\n".encode("ascii", "replace"))
                    answer = ""
                    while not answer:  # the shell ends some lines twice
                        answer = (await reader.readuntil(b"\n")).decode("ascii", "replace").strip()
            except (OSError, EOFError, TimeoutError, asyncio.LimitOverrunError) as error:
                await self.close()
                raise ShellError(f"{self.where} does not answer {' '.join(lines)[:40]!r}") from error
            self._on_line(answer, False)
            return answer
