"""Modbus TCP server for a PLC, on a socket from systemd: signals of the line as coils, the cell's state to read. Needs
the extra `modbus`.

pymodbus encodes and decodes; asyncio has the sockets. One client at a time: a second one is refused. A client's coils
are valid while it sends a request at least every silence_s, and only during its connection.
"""

import asyncio
import os
import socket
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from daemon.errors import FacetdError
from daemon.signals.packml import PackMLState
from daemon.signals.settings import ModbusSettings
from daemon.store.folders import needing

COILS = ("permit_pick", "permit_place", "cycle_start", "part_present", "reset")
"""Coil 0, 1, ...: what a PLC may set; only those in modbus.roles are accepted."""
DISCRETE_INPUTS = ("busy", "part_done", "fault", "enabled")
"""Discrete input 0, 1, ...: what a PLC reads."""
STATE_NUMBERS: Mapping[PackMLState, int] = {
    PackMLState.STOPPED: 2,
    PackMLState.IDLE: 4,
    PackMLState.EXECUTE: 6,
    PackMLState.ABORTED: 9,
    PackMLState.COMPLETE: 17,
}
"""Input register 0: PackML's StateCurrent (ISA-TR88.00.02)."""
WORD = 1 << 16
FIRST_FD = 3
"""The first file descriptor from systemd: sd_listen_fds(3)."""
NAME = "modbus"
"""FileDescriptorName of the socket unit."""
LARGEST_BYTES = 260
"""Length limit of a Modbus TCP frame."""
READ_COILS, READ_DISCRETE_INPUTS, READ_INPUT_REGISTERS, WRITE_COIL, WRITE_COILS = 1, 2, 4, 5, 15
TABLES = {READ_COILS: COILS, WRITE_COIL: COILS, WRITE_COILS: COILS, READ_DISCRETE_INPUTS: DISCRETE_INPUTS}


class ModbusError(FacetdError):
    """Modbus cannot be served: why, and what to do."""


@dataclass(frozen=True)
class PLCReadings:
    """The values that a PLC reads: bits by DISCRETE_INPUTS, and the input registers."""

    bits: Mapping[str, bool]
    registers: Sequence[int]


def readings(packml: PackMLState, done: bool, enabled: bool, clock_s: float, picked: int, failed: int) -> PLCReadings:
    """The values for a PLC. done: part_done is on; the second register counts seconds, which shows that facetd runs."""
    bits = {
        "busy": packml is PackMLState.EXECUTE,
        "part_done": done,
        "fault": packml is PackMLState.ABORTED,
        "enabled": enabled,
    }
    return PLCReadings(bits, (STATE_NUMBERS[packml], int(clock_s) % WORD, picked % WORD, failed % WORD))


class PLCInputs:
    """The signals that the PLC sets. heard: whether it is connected and sends requests often enough."""

    def __init__(self, roles: Sequence[str] = ()) -> None:
        self.roles = tuple(roles)
        self.heard = False
        self._on: set[str] = set()

    def on(self, role: str) -> bool | None:
        """Whether it is on; None, unknown, without a connected PLC."""
        return role in self._on if self.heard else None

    def give(self, role: str, on: bool) -> None:
        (self._on.add if on else self._on.discard)(role)

    def connected(self) -> None:
        """A client connected: every signal is off until it sets it."""
        self.heard = True

    def lost(self) -> None:
        """The client disconnected or fell silent: every signal is unknown."""
        self.heard = False
        self._on.clear()


def inherited_socket(environment: Mapping[str, str] = os.environ) -> socket.socket | None:
    """The listening socket from systemd, not inherited by child processes; None without one."""
    if environment.get("LISTEN_PID") != str(os.getpid()):
        return None
    names = environment.get("LISTEN_FDNAMES", "").split(":")
    count = int(environment.get("LISTEN_FDS", "0"))
    for number, given in enumerate(names[:count], start=FIRST_FD):
        if given == NAME:
            os.set_inheritable(number, False)
            return socket.socket(fileno=number)
    return None


class ModbusServer:
    """Serves one PLC. reads: returns the present values."""

    def __init__(
        self, listener: socket.socket, settings: ModbusSettings, plc: PLCInputs, reads: Callable[[], PLCReadings]
    ) -> None:
        """Raises ModbusError without the extra."""
        with needing("modbus", "modbus", ModbusError):
            from pymodbus import framer, pdu
        self._framer: Callable[[], Any] = lambda: framer.FramerSocket(pdu.DecodePDU(True))
        self._listener, self._silence_s, self._plc, self._reads = listener, settings.silence_s, plc, reads
        self._listener.setblocking(False)

    async def serve(self) -> None:
        """Serve until cancelled."""
        server = await asyncio.start_server(self._client, sock=self._listener)
        async with server:
            await server.serve_forever()

    async def _client(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        if self._plc.heard:
            writer.close()
            return
        self._plc.connected()
        try:
            await self._converse(reader, writer)
        except (TimeoutError, OSError):
            pass  # silent for too long, or disconnected: the PLC connects again
        finally:
            self._plc.lost()
            writer.close()

    async def _converse(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Answer requests until the client disconnects. Raises TimeoutError where none comes in time, OSError."""
        framer, waiting = self._framer(), b""
        while True:
            async with asyncio.timeout(self._silence_s):
                answer = None
                while answer is None:
                    used, answer = await self._answer(framer, waiting)
                    waiting = waiting[used:]
                    if answer is None:
                        more = await reader.read(LARGEST_BYTES)
                        if not more or len(waiting) > LARGEST_BYTES:
                            return
                        waiting += more
                writer.write(answer)
                await writer.drain()

    async def _answer(self, framer: Any, waiting: bytes) -> tuple[int, bytes | None]:
        """The number of bytes consumed, and the answer to the first complete request, or None."""
        from pymodbus.constants import ExcCodes
        from pymodbus.exceptions import ModbusIOException
        from pymodbus.pdu import ExceptionResponse

        try:
            used, request = framer.handleFrame(waiting, 0, 0)
        except ModbusIOException as error:
            refused = ExceptionResponse(error.fcode or 0, ExcCodes.ILLEGAL_FUNCTION)
            refused.transaction_id, refused.dev_id = error.transaction_id, error.dev_id
            return len(waiting), framer.buildFrame(refused)
        if request is None:
            return used, None
        if request.function_code in (*TABLES, READ_INPUT_REGISTERS):
            response = await request.datastore_update(self, request.dev_id)
        else:
            response = ExceptionResponse(request.function_code, ExcCodes.ILLEGAL_FUNCTION)
        response.transaction_id, response.dev_id = request.transaction_id, request.dev_id
        return used, framer.buildFrame(response)

    # pymodbus's interface of a datastore

    async def async_getValues(self, _: int, function: int, address: int, count: int = 1) -> Any:  # noqa: N802
        """Bits or registers from an address, or the exception code."""
        from pymodbus.constants import ExcCodes

        reads = self._reads()
        values: Sequence[bool | int] = reads.registers
        if function in TABLES:
            given = {role: bool(self._plc.on(role)) for role in COILS} if TABLES[function] is COILS else reads.bits
            values = [given[name] for name in TABLES[function]]
        if address + count > len(values):
            return ExcCodes.ILLEGAL_ADDRESS
        return list(values[address : address + count])

    async def async_setValues(self, _: int, __: int, address: int, values: Sequence[bool]) -> Any:  # noqa: N802
        from pymodbus.constants import ExcCodes

        names = COILS[address : address + len(values)]
        if len(names) < len(values) or not set(names) <= set(self._plc.roles):
            return ExcCodes.ILLEGAL_ADDRESS
        for role, on in zip(names, values, strict=True):
            self._plc.give(role, bool(on))
        return None
