"""`az gateway` as a process on the local hub: what systemd hears of drives, line and bus, and the end."""

from __future__ import annotations

import os
import signal
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from palpate_edge.can_bus.bus import Bus, open_bus
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_host.drives.az import config as az_config
from palpate_host.drives.az.config import AzConfig
from palpate_twin.drives.az.az_server import simulated_port

NODES = (5, 6)
PATIENCE_S = 60.0
SILENCE_S = 1.5
WATCHDOG_US = 300_000
# A loaded test machine may answer late: no answer is given up while a test stops the simulator.
PROGRAMS = {
    "hub": "from palpate_bus.cli.main import bus; bus()",
    "az": (
        "import sys\n"
        "from palpate_edge.common.errors import PalpateError\n"
        "from palpate_host.cli import az as cli\n"
        "from palpate_host.drives.az import gateway\n"
        "gateway.REPLY_TIMEOUT_S = 30.0\n"
        "try:\n"
        "    cli.az(standalone_mode=False)\n"
        "except PalpateError as exc:\n"
        "    print(f'error: {exc}', file=sys.stderr)\n"
        "    sys.exit(exc.exit_status)\n"
    ),
}
# One line a drive: the watchdog needs both. The drives' own timeout is longer than any of these tests' ends.
AZ_TOML = """
[bus]
interface = "palpate"
channel = "{hub}"

[[ports]]
path = "{folder}/port-5"
parity = "none"
timeout_ms = 10000
axes = [{{drive_node = 5, device_id = 1, torque_limit_Nm = 0.5}}]

[[ports]]
path = "{folder}/port-6"
parity = "none"
timeout_ms = 10000
axes = [{{drive_node = 6, device_id = 1, torque_limit_Nm = 0.5}}]
"""
START = CanFrame(0x000, bytes((0x01, NODES[0])))
SILENCE_OF_A_MINUTE = CanFrame(0x600 + NODES[0], bytes.fromhex("2B001405 60EA0000"))  # 1400h:05, 60,000 ms
READY = b"READY=1\nSTATUS=2 drives on 2 ports and palpate"


@contextmanager
def process(program: str, *words: str | Path) -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, "-c", PROGRAMS[program], *map(str, words)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as running:
        try:
            yield running
        finally:
            running.kill()


def first_line(running: subprocess.Popen[str]) -> str:
    assert running.stderr is not None
    return running.stderr.readline()


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as opened:
        yield opened


@pytest.fixture
def config_path(tmp_path: Path, stack: ExitStack) -> Path:
    """az.toml on a hub that listens; its ports are not there yet."""
    hub = stack.enter_context(process("hub", "hub", "--socket", tmp_path / "hub.sock"))
    assert "hub: listening" in first_line(hub)
    path = tmp_path / "az.toml"
    path.write_text(AZ_TOML.format(hub=tmp_path / "hub.sock", folder=tmp_path))
    return path


@pytest.fixture
def config(config_path: Path) -> AzConfig:
    return az_config.load(config_path)


@pytest.fixture
def systemd(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[socket.socket]:
    """What listens at $NOTIFY_SOCKET of the processes that a test starts."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind(str(tmp_path / "notify"))
        listener.settimeout(PATIENCE_S)
        monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
        monkeypatch.setenv("WATCHDOG_USEC", str(WATCHDOG_US))
        yield listener


def simulate(stack: ExitStack, config_path: Path) -> subprocess.Popen[str]:
    simulator = stack.enter_context(process("az", "simulate", "--config", config_path))
    assert "simulated AZ drives" in first_line(simulator)
    return simulator


def start_gateway(stack: ExitStack, config_path: Path) -> subprocess.Popen[str]:
    """The gateway, its bus open."""
    gateway = stack.enter_context(process("az", "gateway", "--config", config_path))
    assert first_line(gateway) == "az gateway: nodes 5, 6 on 2 ports\n"
    return gateway


def is_silent(listener: socket.socket, seconds: float = SILENCE_S) -> bool:
    listener.settimeout(seconds)
    try:
        listener.recv(500)
    except TimeoutError:
        return True
    finally:
        listener.settimeout(PATIENCE_S)
    return False


def falls_silent(listener: socket.socket) -> bool:
    """Whether one SILENCE_S passes without a word, be there words on their way before."""
    end_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < end_s:
        if is_silent(listener):
            return True
    return False


def heard(bus: Bus) -> set[int]:
    """Identifiers that come within 0.3 s, three heartbeats of a node."""
    end_s = time.monotonic() + 0.3
    found = set()
    while time.monotonic() < end_s:
        found |= {frame.can_id for _, frame in bus.receive(0.05)}
    return found


def test_ready_is_said_when_the_drives_answer_and_their_nodes_are_served(
    systemd: socket.socket, stack: ExitStack, config: AzConfig, config_path: Path
) -> None:
    simulator = simulate(stack, config_path)
    simulator.send_signal(signal.SIGSTOP)
    start_gateway(stack, config_path)
    with open_bus(config.bus, "test") as bus:
        assert is_silent(systemd)
        assert not heard(bus)
        simulator.send_signal(signal.SIGCONT)
        assert systemd.recv(500) == READY
        assert [systemd.recv(500) for _ in range(3)] == [b"WATCHDOG=1"] * 3
        assert {0x700 + node for node in NODES} <= heard(bus)


def test_without_an_adapter_nothing_is_ready(
    systemd: socket.socket, stack: ExitStack, config_path: Path
) -> None:
    gateway = start_gateway(stack, config_path)
    assert gateway.stderr is not None
    assert "port-5: cannot be opened" in gateway.stderr.read()
    assert gateway.wait(PATIENCE_S) == 6
    assert is_silent(systemd, 0.1)


def test_the_watchdog_starves_with_one_line_and_lives_with_it(
    systemd: socket.socket, stack: ExitStack, config: AzConfig, config_path: Path
) -> None:
    with simulated_port(config.ports[0]), simulated_port(config.ports[1]) as line:
        gateway = start_gateway(stack, config_path)
        assert systemd.recv(500) == READY
        with line.lock:  # its drive thinks and does not answer; the other line and the bus go on
            assert falls_silent(systemd)
            with open_bus(config.bus, "test") as bus:
                assert {0x700 + node for node in NODES} <= heard(bus)
        assert systemd.recv(500) == b"WATCHDOG=1"
        gateway.terminate()
        gateway.wait(PATIENCE_S)


def test_a_simulator_that_hangs_starves_the_watchdog(
    systemd: socket.socket, stack: ExitStack, config_path: Path
) -> None:
    simulator = simulate(stack, config_path)
    start_gateway(stack, config_path)
    assert systemd.recv(500) == READY
    assert systemd.recv(500) == b"WATCHDOG=1"
    simulator.send_signal(signal.SIGSTOP)
    assert falls_silent(systemd)
    simulator.send_signal(signal.SIGCONT)
    assert systemd.recv(500) == b"WATCHDOG=1"


def test_at_sigterm_systemd_hears_it_and_the_drives_are_let_go(
    systemd: socket.socket, stack: ExitStack, config: AzConfig, config_path: Path
) -> None:
    """A node was told to go on without commands for a minute: it is the gateway that lets the joint go."""
    with simulated_port(config.ports[0]) as line, simulated_port(config.ports[1]):
        gateway = start_gateway(stack, config_path)
        assert systemd.recv(500) == READY
        drive = line.drives[1]
        with open_bus(config.bus, "test") as bus:
            bus.send([SILENCE_OF_A_MINUTE, START])
            for word in (0x06, 0x07, 0x0F):
                bus.send([ten_percent_torque(word)])
                time.sleep(0.02)
            end_s = time.monotonic() + PATIENCE_S
            while drive.torque_Nm < 0.1:
                assert time.monotonic() < end_s
                time.sleep(0.02)
            os.kill(gateway.pid, signal.SIGTERM)
            gateway.wait(PATIENCE_S)
        with line.lock:
            drive.advance(time.monotonic_ns() // 1000)
            assert (drive.torque_Nm, drive.alarm) == (0.0, 0)
        assert gateway.returncode == 0
        while systemd.recv(500) != b"STOPPING=1":
            pass
        assert is_silent(systemd, 0.1)


def ten_percent_torque(controlword: int) -> CanFrame:
    """RPDO 1 of the first node, cyclic synchronous torque."""
    return CanFrame(0x200 + NODES[0], struct.pack("<HBh", controlword, 10, 100))
