"""The status stream: lines that a reader can decode, and a reader that cannot hold up the loop."""

import os
import socket

import msgspec
import pytest

from palpate_edge.common.errors import ConfigError
from palpate_host.common.status import HostStatus
from palpate_host.service.status_stream import StatusStream


@pytest.fixture(scope="module")
def status(bench, table_4):
    return bench.VirtualBench(*table_4).run(0.3)


def decode(line):
    return msgspec.json.decode(line, type=HostStatus)


def test_file(tmp_path, status):
    path = tmp_path / "status.jsonl"
    stream = StatusStream(path)
    stream.write(status)
    stream.write(status)
    stream.close()
    stream.close()
    assert [decode(line) for line in path.read_bytes().splitlines()] == [status, status]


def test_unix_socket(tmp_path, status):
    path = tmp_path / "view.sock"
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as listener:
        listener.bind(str(path))
        listener.listen()
        stream = StatusStream(path)
        with listener.accept()[0] as reader, reader.makefile("rb") as lines:
            stream.write(status)
            assert decode(lines.readline()) == status
        for _ in range(3):
            stream.write(status)  # the reader has gone: nothing happens
        stream.close()


def test_a_slow_reader_loses_whole_lines_only(tmp_path, status):
    path = tmp_path / "view.pipe"
    os.mkfifo(path)
    reader = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    stream = StatusStream(path)
    for _ in range(200):
        stream.write(status)
    assert stream.lines_lost > 0
    data = b""
    for _ in range(3):
        while chunk := _read(reader):
            data += chunk
        stream.write(status)
    stream.close()
    data += _read(reader)
    os.close(reader)
    *whole, _cut = data.split(b"\n")
    assert len(whole) > 2 and all(decode(line) == status for line in whole)


def _read(reader):
    try:
        return os.read(reader, 1 << 20)
    except BlockingIOError:
        return b""


def test_a_pipe_without_reader_is_refused(tmp_path):
    path = tmp_path / "view.pipe"
    os.mkfifo(path)
    with pytest.raises(ConfigError, match=r"view.pipe: cannot be opened .*start its reader first") as caught:
        StatusStream(path)
    assert "\n" not in str(caught.value)
