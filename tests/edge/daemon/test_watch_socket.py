"""The daemon's watch socket: who gets what, and that no watcher holds the daemon up."""

from __future__ import annotations

import json
import os
import socket
import stat
from contextlib import closing

import msgspec
import pytest

from palpate_edge.common.contact import refused_contact
from palpate_edge.common.errors import ConfigError
from palpate_edge.daemon.watching.watch_messages import (
    BeadsShown,
    WatchedFingertip,
    WatchedFrame,
    WatchRefusedError,
)
from palpate_edge.daemon.watching.watch_socket import MOST_WATCHERS, WatchSocket, decode_message

FINGERTIP = WatchedFingertip("finger", "none", None, False, False, "/nowhere")
BEADS = BeadsShown([(1.5, 2.5)] * 300, [(1.0, 2.0)] * 300, [7])


def execute(request):
    if request.command == "light":
        raise WatchRefusedError(f"level {request.level} is refused")
    return f"did {request.command}"


def frame(number):
    return WatchedFrame(refused_contact(number, 0, "none", 0, 0), 1.5, BEADS)


@pytest.fixture
def served(tmp_path):
    with closing(WatchSocket(tmp_path / "finger.watch", FINGERTIP, execute)) as made:
        yield made


@pytest.fixture
def connect(served, tmp_path):
    """Connect a watcher, which has got the description."""
    opened = []

    def watcher():
        connection = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        opened.append(connection)
        connection.settimeout(5)
        connection.connect(str(tmp_path / "finger.watch"))
        served.serve()
        return connection

    yield watcher
    for connection in opened:
        connection.close()


def ask(served, connection, **request):
    connection.send(json.dumps(request).encode())
    served.serve()
    return decode_message(connection.recv(1 << 18))


def test_a_watcher_gets_the_description_answers_and_pictures_on_request(served, connect):
    watcher, other = connect(), connect()
    assert decode_message(watcher.recv(1 << 18)) == decode_message(other.recv(1 << 18)) == FINGERTIP
    assert ask(served, watcher, number=4, command="tare").text == "did tare"
    answer = ask(served, watcher, number=5, command="light", level=9)
    assert (answer.number, answer.refused) == (5, "level 9 is refused")
    assert not served.is_watched
    ask(served, watcher, number=6, command="pictures")
    assert served.is_watched
    served.send(frame(3))
    assert decode_message(watcher.recv(1 << 18)) == frame(3)
    other.setblocking(False)
    with pytest.raises(BlockingIOError):
        other.recv(1 << 18)
    ask(served, watcher, number=7, command="no_pictures")
    assert not served.is_watched


def test_a_watcher_that_leaves_is_forgotten(served, connect):
    watcher = connect()
    watcher.recv(1 << 18)
    ask(served, watcher, number=1, command="pictures")
    watcher.close()
    served.serve()
    assert not served.is_watched


def test_a_watcher_that_does_not_read_misses_packets_and_holds_nobody_up(served, connect):
    idle, reader = connect(), connect()
    reader.recv(1 << 18)
    for watcher in (idle, reader):
        watcher.send(b'{"number": 1, "command": "pictures"}')
    served.serve()
    reader.recv(1 << 18)
    for number in range(500):
        served.send(frame(number))
        assert decode_message(reader.recv(1 << 18)).contact.sequence == number
    idle.setblocking(False)
    waiting = 0
    with pytest.raises(BlockingIOError):
        while idle.recv(1 << 18):
            waiting += 1
    assert 2 < waiting < 400


ODD = (b"\0", b"[]", b'{"number": 1}', b"[" * 1000, b"\xff" * 5000)
ODD += (b'{"number": 1, "command": "fly"}', b'{"number": 1, "command": "light", "level": 256}')


@pytest.mark.parametrize("packet", ODD, ids=range(len(ODD)))
def test_a_watcher_that_sends_something_else_is_disconnected(served, connect, packet):
    watcher = connect()
    watcher.recv(1 << 18)
    watcher.send(packet)
    served.serve()
    assert watcher.recv(1 << 18) == b""


def test_more_watchers_than_allowed_are_disconnected(served, connect):
    watchers = [connect() for _ in range(MOST_WATCHERS + 1)]
    for watcher in watchers[:-1]:
        assert watcher.recv(1 << 18)
    assert watchers[-1].recv(1 << 18) == b""


def test_the_socket_is_its_users_whatever_the_umask_and_goes_with_the_daemon(tmp_path):
    path = tmp_path / "finger.watch"
    former = os.umask(0)
    try:
        made = WatchSocket(path, FINGERTIP, execute)
    finally:
        os.umask(former)
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    with pytest.raises(ConfigError, match="another daemon"):
        WatchSocket(path, FINGERTIP, execute)
    made.close()
    assert not path.exists()


def test_a_socket_of_a_killed_daemon_is_replaced_and_a_file_is_not(tmp_path):
    path = tmp_path / "finger.watch"
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as killed:
        killed.bind(str(path))
    WatchSocket(path, FINGERTIP, execute).close()
    path.write_text("mine")
    with pytest.raises(ConfigError, match="is no socket"):
        WatchSocket(path, FINGERTIP, execute)
    assert path.read_text() == "mine"
    with pytest.raises(ConfigError, match="short path"):
        WatchSocket(tmp_path / ("x" * 120), FINGERTIP, execute)


def test_a_message_of_another_version_is_none():
    assert decode_message(b'{"type": "newer"}') is None
    assert decode_message(msgspec.json.encode(FINGERTIP)) == FINGERTIP
