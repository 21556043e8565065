"""What is told to systemd, over a real datagram socket, and when the watchdog is fed."""

from __future__ import annotations

import os
import socket
from contextlib import closing

import pytest

from palpate_edge.common.local_sockets.sd_notify import Notifier, WatchdogGate


@pytest.fixture(params=["path", "abstract"])
def systemd(request, tmp_path):
    """(a socket that listens like systemd's, the environment that it gives its service)."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        address = str(tmp_path / "notify") if request.param == "path" else f"@palpate-test-{os.getpid()}"
        listener.bind("\0" + address[1:] if address.startswith("@") else address)
        listener.settimeout(5)
        yield listener, {"NOTIFY_SOCKET": address}


def test_messages_are_those_of_sd_notify(systemd):
    listener, environment = systemd
    with closing(Notifier(environment)) as notifier:
        notifier.ready("node 0x10 on can0")
        notifier.status("30 frames/s")
        notifier.feed_watchdog()
        notifier.stopping()
    said = [listener.recv(1024) for _ in range(4)]
    assert said == [
        b"READY=1\nSTATUS=node 0x10 on can0",
        b"STATUS=30 frames/s",
        b"WATCHDOG=1",
        b"STOPPING=1",
    ]


def test_without_systemd_nothing_is_said_and_nothing_watched():
    with closing(Notifier({})) as notifier:
        notifier.ready("")
        assert notifier.watchdog_us is None


def test_a_socket_that_is_gone_is_no_fault(tmp_path):
    with closing(Notifier({"NOTIFY_SOCKET": str(tmp_path / "nobody")})) as notifier:
        notifier.feed_watchdog()


@pytest.mark.parametrize(
    ("environment", "expected"),
    [
        ({"WATCHDOG_USEC": "10000000"}, 10_000_000),
        ({"WATCHDOG_USEC": "10000000", "WATCHDOG_PID": "77"}, 10_000_000),
        ({"WATCHDOG_USEC": "10000000", "WATCHDOG_PID": "78"}, None),
        ({"WATCHDOG_USEC": "soon"}, None),
        ({}, None),
    ],
)
def test_the_watchdogs_time_is_systemds_and_for_this_process(environment, expected):
    with closing(Notifier({"NOTIFY_SOCKET": "/x", **environment}, pid=77)) as notifier:
        assert notifier.watchdog_us == expected


def fed_at(progress, until_s=10.0):
    """Seconds at which a gate of 3 s lets the watchdog be fed; progress(now_s) -> (frames, bus frames)."""
    gate = WatchdogGate(3_000_000)
    return [
        ms / 1000
        for ms in range(0, round(1000 * until_s), 100)
        if gate.may_feed(1000 * ms, *progress(ms / 1000))
    ]


def test_it_is_fed_each_third_of_its_time_while_all_goes_on():
    assert fed_at(lambda s: (1 + 30 * s, 1 + 300 * s)) == [float(second) for second in range(10)]


@pytest.mark.parametrize("frozen", ["camera", "bus"])
def test_it_starves_when_either_stands_still(frozen):
    def progress(s):
        still, moving = 1 + 30 * min(s, 4.0), 1 + 30 * s
        return (still, moving) if frozen == "camera" else (moving, still)

    assert max(fed_at(progress)) == 4.0


def test_it_is_fed_again_when_that_goes_on():
    times = fed_at(lambda s: (1 + max(s, 5.0), 1 + s))
    assert [time for time in times if 0 < time <= 5] == []
    assert 6.0 in times


def test_without_a_watchdog_nothing_is_due():
    gate = WatchdogGate(None)
    assert gate.due_us is None
    assert not gate.may_feed(10**9, 1, 1)
