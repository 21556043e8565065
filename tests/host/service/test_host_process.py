"""`run` as a process on the local hub with simulated drives: an orderly stop, and failures with a reason."""

import contextlib
import json
import os
import re
import signal
import socket
import subprocess
import sys
import time

import pytest

from palpate_edge.can_bus.bus import BusConfig, open_bus
from palpate_host.cli.command import status_text
from palpate_host.operator.client import NoHostError, OperatorClient
from palpate_host.operator.protocol import Status

PROGRAMS = {
    "hub": "from palpate_bus.cli.main import bus; bus()",
    "drives": "from palpate_twin.cli.drives import drives; drives()",
    "run": (
        "import sys\n"
        "from palpate_edge.common.errors import PalpateError\n"
        "from palpate_host.cli.run import run\n"
        "try:\n"
        "    run(standalone_mode=False)\n"
        "except PalpateError as exc:\n"
        "    print(f'error: {exc}', file=sys.stderr)\n"
        "    sys.exit(exc.exit_status)\n"
    ),
}
PATIENCE_S = 60.0


class Processes:
    def __init__(self):
        self.running = []

    def start(self, program, *arguments):
        process = subprocess.Popen(
            [sys.executable, "-c", PROGRAMS[program], *map(str, arguments)],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        self.running.append(process)
        return process

    def stop(self):
        for process in reversed(self.running):
            if process.poll() is None:
                process.terminate()
            process.communicate(timeout=PATIENCE_S)


@pytest.fixture
def processes():
    started = Processes()
    yield started
    started.stop()


@pytest.fixture
def hub(tmp_path, processes):
    path = tmp_path / "hub.sock"
    process = processes.start("hub", "hub", "--socket", path)
    assert "hub: listening" in process.stderr.readline()
    return path, process


@pytest.fixture
def config(tmp_path, hub, bench):
    """Table 4 on this hub, blind by choice: drives alone move it."""
    text = bench.TABLE_4.read_text().replace('start = "command"', 'start = "auto"')
    text = text.replace('interface = "palpate"', f'interface = "palpate"\nchannel = "{hub[0]}"')
    path = tmp_path / "hand.toml"
    path.write_text(text)
    return path


def wait_for(condition, what):
    end = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end, f"{what} did not come"
        time.sleep(0.02)


def last_status(path):
    written = path.read_text() if path.exists() else ""
    whole = written[: written.rfind("\n") + 1].splitlines()  # the last may still be on its way
    return json.loads(whole[-1]) if whole else None


def test_run_waits_for_the_missing_fingertips_and_stops_on_sigterm(tmp_path, processes, hub, config):
    drives = processes.start("drives", "--config", config)
    assert "simulated drives" in drives.stderr.readline()
    status_path = tmp_path / "status.jsonl"
    host = processes.start("run", "--config", config, "--status", status_path)

    def only_fingertips_missing():
        status = last_status(status_path)
        return status is not None and status["reason"].startswith(
            "waiting for fingertip of finger-1 (node 0x10)"
        )

    wait_for(only_fingertips_missing, "the drives' start-up")
    with open_bus(BusConfig(interface="palpate", channel=str(hub[0])), "test", [0x000]) as bus:
        host.send_signal(signal.SIGTERM)
        _, said = host.communicate(timeout=PATIENCE_S)
        assert (host.returncode, said) == (0, "")
        stops = [frame.data[1] for _, frame in bus.receive(1.0) if frame.data[0] == 0x02]
    assert sorted(stops) == [*range(1, 10), 0x10, 0x11, 0x12]
    assert last_status(status_path)["mode"] == "stop"


def test_systemd_hears_of_start_life_and_stop(tmp_path, processes, config, monkeypatch):
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as systemd:
        systemd.bind(str(tmp_path / "notify"))
        systemd.settimeout(PATIENCE_S)
        monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
        monkeypatch.setenv("WATCHDOG_USEC", "300000")
        host = processes.start("run", "--config", config)
        assert systemd.recv(500) == b"READY=1\nSTATUS=on palpate"
        assert [systemd.recv(500) for _ in range(3)] == [b"WATCHDOG=1"] * 3
        host.send_signal(signal.SIGTERM)
        host.communicate(timeout=PATIENCE_S)
        assert host.returncode == 0
        while systemd.recv(500) != b"STOPPING=1":
            pass


def test_duration_ends_the_run(processes, config):
    host = processes.start("run", "--config", config, "--duration", 0.1)
    host.communicate(timeout=PATIENCE_S)
    assert host.returncode == 0


def test_lines_that_the_reader_was_too_slow_for_are_in_the_status(tmp_path, processes, config):
    """A pipe nobody reads from fills; the counters of the bus beside it are those of the host's own port."""
    pipe = tmp_path / "status"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    try:
        path = tmp_path / "host.sock"
        processes.start("run", "--config", config, "--status", pipe, "--socket", path, "--start", "command")

        def counters():
            with contextlib.suppress(NoHostError), OperatorClient(path) as client:
                status = client.ask(Status())
                return None if status is None else status.counters

        wait_for(lambda: (found := counters()) is not None and found.status_lines_lost > 3, "a lost line")
        found = counters()
        assert found.ticks > found.status_lines_lost
        assert (found.receive_overruns, found.error_frames, found.bus_restarts) == (0, 0, 0)
        with OperatorClient(path) as client:
            text = status_text(client.ask(Status()))
        assert re.search(
            r"^bus: \d+ frames in, .* 0 receive overruns, .* [1-9]\d* status lines lost$", text, re.M
        )
        assert text.count(" resynchronised; parts: ") == 3
    finally:
        os.close(reader)


def test_a_hub_that_goes_is_a_bus_error(tmp_path, processes, hub, config):
    status_path = tmp_path / "status.jsonl"
    host = processes.start("run", "--config", config, "--status", status_path)
    wait_for(lambda: last_status(status_path) is not None, "the first status")
    os.kill(hub[1].pid, signal.SIGKILL)
    _, said = host.communicate(timeout=PATIENCE_S)
    assert host.returncode == 6
    assert said.startswith("error: ") and said.count("\n") == 1


@pytest.mark.parametrize("end", ["SIGTERM", "--duration"])
def test_a_hand_that_waits_for_commands_outlives_its_hub(tmp_path, processes, hub, config, monkeypatch, end):
    """FAULT with the reason, systemd is told and its watchdog fed; a stop is a clean one meanwhile."""
    status_path = tmp_path / "status.jsonl"
    arguments = ["--config", config, "--start", "command", "--status", status_path]
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as systemd:
        systemd.bind(str(tmp_path / "notify"))
        systemd.settimeout(PATIENCE_S)
        monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
        monkeypatch.setenv("WATCHDOG_USEC", "300000")
        host = processes.start("run", *arguments, *(["--duration", 10] if end == "--duration" else []))
        wait_for(lambda: last_status(status_path) is not None, "the first status")
        os.kill(hub[1].pid, signal.SIGKILL)
        while not (told := systemd.recv(500)).startswith(b"STATUS"):
            assert host.poll() is None
        assert told.startswith(b"STATUS=the bus is down. ") and b"the CAN hub at" in told
        assert [systemd.recv(500).split(b"=")[0] for _ in range(8)].count(b"WATCHDOG") >= 6
        status = last_status(status_path)
        assert status["mode"] == "fault" and "has stopped: start it with" in status["reason"]
        if end == "SIGTERM":
            host.send_signal(signal.SIGTERM)
        _, said = host.communicate(timeout=PATIENCE_S)
    assert host.returncode == 0 and "error" not in said
    assert last_status(status_path)["mode"] == "stop"


def test_no_hub_is_a_bus_error(tmp_path, processes, config, hub):
    hub[1].terminate()
    hub[1].wait(PATIENCE_S)
    host = processes.start("run", "--config", config)
    _, said = host.communicate(timeout=PATIENCE_S)
    assert host.returncode == 6
    assert "no CAN bus at" in said and said.count("\n") == 1
