"""Unix sockets of the local programs: their peers, and files that a killed program left behind."""

from __future__ import annotations

import socket
import struct
from pathlib import Path
from typing import NamedTuple

PROBE_S = 1.0
_UCRED = struct.Struct("iII")  # pid, uid, gid: struct ucred of unix(7)


class Peer(NamedTuple):
    """The process at the other end of a Unix socket. pid: 0 where another pid namespace hides it."""

    pid: int
    uid: int
    gid: int


def peer_of(connection: socket.socket) -> Peer:
    """Return the process that connected, as the kernel noted it at that time."""
    raw = connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _UCRED.size)
    return Peer(*_UCRED.unpack(raw))


def remove_if_stale(path: Path, kind: socket.SocketKind) -> bool:
    """Remove a socket on which no process listens. Return False when one does. Raises OSError.

    kind: SOCK_STREAM or SOCK_SEQPACKET, that of the listener. path: an existing socket.
    """
    with socket.socket(socket.AF_UNIX, kind) as probe:
        probe.settimeout(PROBE_S)
        try:
            probe.connect(str(path))
        except ConnectionRefusedError:
            path.unlink()
            return True
    return False
