"""Rights of users at the socket: who may connect, and who may only look (deploy/README.md, "Who may do what").

| user, as the kernel reports it | rights |
| --- | --- |
| root, the daemon's own user | all |
| a member of `console.group` (by default the daemon's own group) | all |
| a member of `console.look_group` | look: nothing moves, no model changes; also stop, disable, abort, pause |
| anybody else | none: the connection is refused |

Everybody may stop motion; only users with all rights may permit it again (`resume`, `enable`). The grade of a command
(console/interpreter.py) decides what it needs. A serial terminal has the rights of `console.tty.may`.
"""

import contextlib
import grp
import os
import pwd
import socket
import struct
from dataclasses import dataclass
from typing import Literal

from daemon.config import ConsoleSettings
from daemon.errors import FacetdError


class FrontendError(FacetdError):
    """A frontend cannot be opened: which, why, what to do."""


May = Literal["look", "all"]
SO_PEERGROUPS = 59
"""Linux since 4.13, <asm-generic/socket.h>; Python has no name for it."""
MOST_GROUPS = 256
"""The most groups of a user that Python can read."""


@dataclass(frozen=True)
class Peer:
    """The user and the process at the other end of a connection."""

    process: int
    user: int
    groups: frozenset[int]

    def __str__(self) -> str:
        try:
            name = pwd.getpwuid(self.user).pw_name
        except KeyError:
            name = f"uid {self.user}"
        return f"{name} (process {self.process})"


def peer_of(connection: socket.socket) -> Peer:
    """The peer as the kernel reports it, not as it names itself."""
    packed = connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, struct.calcsize("3i"))
    process, user, group = struct.unpack("3i", packed)
    more = b""
    with contextlib.suppress(OSError):  # somebody in more groups than can be asked for is in the first one only
        more = connection.getsockopt(socket.SOL_SOCKET, SO_PEERGROUPS, 4 * MOST_GROUPS)
    return Peer(process, user, frozenset({group, *struct.unpack(f"{len(more) // 4}I", more)}))


class Rights:
    """The table above, for one configuration. Raises FrontendError where this machine has no such group."""

    def __init__(self, console: ConsoleSettings) -> None:
        self.group = os.getegid() if console.group is None else _group("group", console.group)
        self._look_group = None if console.look_group is None else _group("look_group", console.look_group)

    @property
    def mode(self) -> int:
        """File mode of the socket: open to all where there is a look_group, as then each peer's rights decide."""
        return 0o660 if self._look_group is None else 0o666

    def of(self, peer: Peer) -> May | None:
        """What a peer may do; None: nothing."""
        if peer.user in (0, os.geteuid()) or self.group in peer.groups:
            return "all"
        return "look" if self._look_group in peer.groups else None


def _group(key: str, name: str) -> int:
    try:
        return grp.getgrnam(name).gr_gid
    except KeyError:
        raise FrontendError(f"console.{key}: there is no group {name!r} on this machine") from None
