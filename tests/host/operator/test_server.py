"""The control socket: the protocol's refusals, who may connect, and clients that misbehave."""

import contextlib
import os
import socket
import stat
import struct
import subprocess
import sys

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate_edge.common.errors import ConfigError
from palpate_host.common.command import CommandError, Grasp, Move, Recover, Release, Reorient, Rotate, Stop
from palpate_host.operator.client import NoHostError, OperatorClient
from palpate_host.operator.protocol import (
    LONGEST_REQUEST,
    Answer,
    Lines,
    Status,
    Stream,
    decode_answer,
    decode_request,
    encode,
)
from palpate_host.operator.server import MOST_CLIENTS, OperatorSocket, default_control_socket, may_command


@pytest.fixture(scope="module")
def status(bench, table_4):
    return bench.VirtualBench(*table_4).run(0.3)


@pytest.fixture
def server(tmp_path):
    made = OperatorSocket(tmp_path / "s")
    yield made
    made.close()


class Obeyed(list):
    """Takes commands; refuses `recover`."""

    def __call__(self, command):
        if isinstance(command, Recover):
            raise CommandError("nothing to recover from")
        self.append(command)


def connect(tmp_path):
    plain = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    plain.connect(str(tmp_path / "s"))
    plain.settimeout(2.0)
    return plain


def talk(server, plain, data, obeyed, status=None):
    """What comes back after two ticks; b"" when the connection was closed."""
    plain.sendall(data)
    for _ in range(3):
        server.serve(obeyed, status)
    try:
        plain.setblocking(False)
        return plain.recv(1 << 20)
    except BlockingIOError:
        return None


@pytest.mark.parametrize(
    ("line", "request_"),
    [
        (b'{"command":"grasp"}', Grasp()),
        (b'{"command":"rotate","rpy_deg":[30,0,-5.5]}', Rotate((30.0, 0.0, -5.5))),
        (b'{"command":"rotate","rpy_deg":[0,0,1],"ramp_s":2}', Rotate((0.0, 0.0, 1.0), 2.0)),
        (
            b'{"command":"reorient","rpy_deg":[0,0,90],"corners_mm":[[0,0,0],[1,0,0],[0,1,0],[0,0,1]]}',
            Reorient((0.0, 0.0, 90.0), ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))),
        ),
        (b'{"command":"move","xyz_mm":[0,0,10]}', Move((0.0, 0.0, 10.0))),
        (
            b'{"command":"move","xyz_mm":[1,2,3],"rpy_deg":[0,0,5],"ramp_s":2}',
            Move((1.0, 2.0, 3.0), (0.0, 0.0, 5.0), 2.0),
        ),
        (b'{"command":"release"}', Release()),
        (b'{"command":"stop"}', Stop()),
        (b'{"command":"recover"}', Recover()),
        (b'{"command":"status"}', Status()),
        (b'{"command":"stream"}', Stream()),
    ],
)
def test_requests_as_written_by_hand(line, request_):
    assert decode_request(line) == request_
    assert decode_request(encode(request_).strip()) == request_


@pytest.mark.parametrize(
    "line",
    [
        b"",
        b"grasp",
        b"[]",
        b'{"command":"dance"}',
        b'{"command":"grasp","hard":true}',
        b'{"command":"rotate"}',
        b'{"command":"rotate","rpy_deg":[0,0]}',
        b'{"command":"rotate","rpy_deg":[0,0,181]}',
        b'{"command":"rotate","rpy_deg":[0,0,NaN]}',
        b'{"command":"rotate","rpy_deg":[0,0,1e999]}',
        b'{"command":"rotate","rpy_deg":[0,0,1],"ramp_s":-1}',
        b"\xff\xfe",
        b"[" * 4000,
    ],
)
def test_anything_else_is_refused_in_one_line(line):
    with pytest.raises(CommandError, match="not a request") as caught:
        decode_request(line)
    assert "\n" not in str(caught.value)


@given(st.binary(max_size=300))
def test_random_bytes_are_a_request_or_a_refusal(data):
    try:
        decode_request(data)
    except CommandError as exc:
        assert "\n" not in str(exc)


@given(st.lists(st.binary(max_size=40).map(lambda b: b.replace(b"\n", b"")), max_size=8), st.data())
def test_lines_come_out_however_the_stream_is_cut(lines, data):
    stream = b"".join(line + b"\n" for line in lines)
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=6)))
    cutter, found = Lines(100), []
    for begin, end in zip([0, *cuts], [*cuts, len(stream)], strict=True):
        found += cutter.receive(stream[begin:end])
    assert found == lines


def test_commands_are_obeyed_in_order_and_answered_with_the_status(server, tmp_path, status):
    obeyed = Obeyed()
    with connect(tmp_path) as plain:
        said = talk(
            server,
            plain,
            encode(Grasp()) + encode(Rotate((1.0, 2.0, 3.0))) + encode(Recover()),
            obeyed,
            status,
        )
    assert obeyed == [Grasp(), Rotate((1.0, 2.0, 3.0))]
    answers = [decode_answer(line) for line in said.splitlines()]
    assert [answer.error for answer in answers] == ["", "", "nothing to recover from"]
    assert answers[0].status == status


def test_a_stream_gives_every_tick_and_a_reader_that_sleeps_costs_nothing(server, tmp_path, status):
    with connect(tmp_path) as plain:
        talk(server, plain, encode(Stream()), Obeyed(), status)
        for _ in range(3000):
            server.serve(Obeyed(), status)
        (client,) = server._clients.values()
        assert len(client.unsent) <= len(encode(Answer(status=status)))
        plain.settimeout(1.0)
        lines = plain.makefile("rb")
        assert decode_answer(lines.readline()).status == status
        lines.close()


def test_a_line_without_an_end_closes_the_connection(server, tmp_path):
    with connect(tmp_path) as plain:
        said = talk(server, plain, b"x" * (LONGEST_REQUEST + 1), Obeyed())
        assert b"a line of more than" in said
    assert not server._clients


def test_one_who_asks_and_never_reads_loses_the_connection(server, tmp_path, status):
    with connect(tmp_path) as plain:
        plain.setblocking(False)
        for _ in range(4000):
            with contextlib.suppress(BlockingIOError, BrokenPipeError, ConnectionResetError):
                plain.send(encode(Status()) * 100)
            server.serve(Obeyed(), status)
            if not server._clients:
                break
    assert not server._clients


def test_more_clients_than_the_host_serves_are_told_so(server, tmp_path):
    crowd = [connect(tmp_path) for _ in range(MOST_CLIENTS + 1)]
    for _ in range(MOST_CLIENTS + 2):
        server.serve(Obeyed(), None)
    assert b"clients are connected already" in crowd[-1].recv(1000)
    assert len(server._clients) == MOST_CLIENTS
    for one in crowd:
        one.close()


def test_the_socket_is_for_the_user_and_the_group_alone(server, tmp_path):
    assert stat.S_IMODE((tmp_path / "s").stat().st_mode) == 0o660


class Peer:
    """A connection whose other end has these credentials (unix(7), struct ucred) and further groups."""

    def __init__(self, uid, gid, *groups):
        self._told = {
            socket.SO_PEERCRED: struct.pack("3i", 1, uid, gid),
            59: struct.pack(f"{len(groups)}I", *groups),
        }

    def getsockopt(self, level, name, size):
        assert level == socket.SOL_SOCKET and size >= len(self._told[name])
        return self._told[name]


@pytest.mark.parametrize(
    ("credentials", "may"),
    [
        ((0, 999_999), True),
        ((os.getuid(), 999_999), True),
        ((999_998, os.getgid()), True),
        ((999_998, 999_999, 999_997, os.getgid()), True),
        ((999_998, 999_999, 999_997), False),
        ((999_998, 999_999), False),
    ],
)
def test_who_may_command(credentials, may):
    assert may_command(Peer(*credentials)) is may


def test_a_real_peers_groups_are_seen():
    """The kernel's own words, by a process of another user that root has put into this process's group."""
    if os.geteuid() != 0:
        pytest.skip("only root can become another user")
    for groups, may in (([os.getgid(), 4], True), ([4], False)):
        name = f"\0palpate-test-{os.getpid()}-{may}"  # in no file system, so with no permissions
        becomes = f"os.setgroups({groups}); os.setgid(999_999); os.setuid(999_998)"
        calls = f"c = s.socket(s.AF_UNIX); c.connect({name!r}); c.recv(1); c.close()"
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as listener:
            listener.bind(name)
            listener.listen()
            with subprocess.Popen(
                [sys.executable, "-c", f"import os, socket as s; {becomes}; {calls}"]
            ) as peer:
                connection, _ = listener.accept()
                with connection:
                    assert may_command(connection) is may
        assert peer.returncode == 0


def test_a_stranger_is_told_and_closed(server, tmp_path, monkeypatch):
    monkeypatch.setattr("palpate_host.operator.server.may_command", lambda _connection: False)
    with connect(tmp_path) as plain:
        assert b"only root, the host's user and its group" in talk(server, plain, b"", Obeyed())
    assert not server._clients


def test_a_second_host_is_refused_and_a_dead_ones_socket_is_taken(server, tmp_path):
    with pytest.raises(ConfigError, match="a host is running there"):
        OperatorSocket(tmp_path / "s")
    left_over = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    left_over.bind(str(tmp_path / "dead"))
    left_over.close()
    OperatorSocket(tmp_path / "dead").close()
    (tmp_path / "file").write_text("mine")
    with pytest.raises(ConfigError, match="exists and is no socket"):
        OperatorSocket(tmp_path / "file")
    assert (tmp_path / "file").read_text() == "mine"


def test_no_host_is_said_so(tmp_path):
    with pytest.raises(NoHostError, match="no hand is running; start one: palpate-host run"):
        OperatorClient(tmp_path / "nobody")


def test_an_answer_of_another_version_is_no_crash():
    with pytest.raises(
        CommandError, match=r"not a host.s response .status = 3 is not .*: use the same palpate version"
    ):
        decode_answer(b'{"status": 3}')


def test_where_it_is_by_default(monkeypatch, tmp_path):
    monkeypatch.delenv("PALPATE_CONTROL", raising=False)
    monkeypatch.setenv("XDG_RUNTIME_DIR", "/run/user/7")
    assert str(default_control_socket()) == "/run/user/7/palpate-host.sock"
    monkeypatch.setattr("palpate_host.operator.server.SERVICE_DIRECTORY", tmp_path)
    assert default_control_socket() == tmp_path / "palpate-host.sock"
    monkeypatch.setenv("RUNTIME_DIRECTORY", "/run/palpate-host")
    assert str(default_control_socket()) == "/run/palpate-host/palpate-host.sock"
    monkeypatch.setenv("PALPATE_CONTROL", "/x")
    assert str(default_control_socket()) == "/x"


def test_the_status_survives_the_socket(status):
    assert decode_answer(encode(Answer(status=status)).strip()).status == status
    assert msgspec.json.decode(encode(Answer("no")))["error"] == "no"
