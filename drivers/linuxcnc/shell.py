"""One connection to LinuxCNC's remote shell: a line out, a line back. It knows no arm.

Source: LinuxCNC 2.9, manual page linuxcncrsh(1). `get NAME` is answered by the name and its words, `set NAME ...` by
`SET NAME ACK` or `NAK` once LinuxCNC's task has it (a tenth of a second), which says nothing of whether it worked.
One connection at a time may set anything: the one that said `enable` last.
"""

import asyncio
from collections.abc import Callable, Sequence
from contextlib import suppress

ANSWER_S, ASKED = 2.0, 3
LONGEST = 4096
"""Bytes of a line; more is no answer of a remote shell's."""


class ShellError(Exception):
    """The remote shell does not answer, or not as it should: what and where, on one line."""


class RemoteShell:
    """See the module. on_line: takes every line, and whether it was sent."""

    def __init__(self, host: str, port: int, on_line: Callable[[str, bool], None]) -> None:
        self.where = f"LinuxCNC's remote shell at {host}:{port}"
        self._host, self._port, self._on_line = host, port, on_line
        self._turn = asyncio.Lock()
        self._streams: tuple[asyncio.StreamReader, asyncio.StreamWriter] | None = None

    @property
    def connected(self) -> bool:
        """Whether there is a connection."""
        return self._streams is not None

    async def open(self, name: str, password: str) -> None:
        """Connect, be let in, and have every line answered. Raises ShellError."""
        await self.close()
        try:
            async with asyncio.timeout(ANSWER_S):
                self._streams = await asyncio.open_connection(self._host, self._port, limit=LONGEST)
        except (OSError, TimeoutError) as error:
            why = getattr(error, "strerror", None) or "no answer"
            raise ShellError(f"{self.where}: {why}: does LinuxCNC run, with linuxcncrsh?") from error
        try:
            answer = await self._exchange(f"hello EMC {name} 1.0", "set echo off", "set verbose on")
            while not answer.startswith(("SET VERBOSE", "HELLO NAK")):  # what is said before echo is off
                answer = await self._exchange()
        except ShellError as error:
            raise ShellError(f"{self.where} does not know `hello`") from error
        if not answer.endswith("ACK"):
            await self.close()
            raise ShellError(f"{self.where} refuses the connection ({answer!r})")
        await self.tell(f"enable {password}")

    async def close(self) -> None:
        """Leave; safe to call twice."""
        streams, self._streams = self._streams, None
        if streams is not None:
            streams[1].close()
            with suppress(OSError):
                await streams[1].wait_closed()

    async def ask(self, name: str) -> list[str]:
        """The words of an answer, without the name. Asked again where another connection asked at the same moment: the
        shell then mixes up the words of both. Raises ShellError."""
        for _ in range(ASKED):
            answer = await self._exchange(f"get {name}")
            first, *words = answer.split()
            if first.lower() == name and words != ["NAK"]:
                return words
        raise ShellError(f"{self.where}: {name!r} was answered by {answer!r}")

    async def tell(self, text: str, may: Callable[[], None] | None = None) -> None:
        """`set TEXT`. may: called right before it is sent; what it raises comes out of here, and nothing was sent.
        Raises ShellError."""
        answer = await self._exchange(f"set {text}", may=may)
        if answer.split()[-1:] != ["ACK"]:
            raise ShellError(f"{self.where} refuses {text.partition(' ')[0]!r} ({answer!r})")

    async def _exchange(self, *lines: str, may: Callable[[], None] | None = None) -> str:
        """Send lines, if any, and take the next one that comes; to its end, also where whoever asked goes away: the
        answer would be taken for the next one."""
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
                    while not answer:  # it ends some lines twice
                        answer = (await reader.readuntil(b"\n")).decode("ascii", "replace").strip()
            except (OSError, EOFError, TimeoutError, asyncio.LimitOverrunError) as error:
                await self.close()
                raise ShellError(f"{self.where} does not answer {' '.join(lines)[:40]!r}") from error
            self._on_line(answer, False)
            return answer
