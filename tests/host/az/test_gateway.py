"""AZ drives as CiA 402 nodes: a foreign 402 master, the gateway, and simulated drives on a serial line."""

from __future__ import annotations

import threading
import time
import uuid
from collections.abc import Callable, Iterator
from pathlib import Path

import canopen
import pytest
from canopen.profiles.p402 import BaseNode402

from palpate_edge.bus import open_bus
from palpate_host.drives.az import alarms, gateway
from palpate_host.drives.az import config as az_config
from palpate_host.drives.az.config import AzConfig
from palpate_host.drives.cia402 import CIA402_EDS
from palpate_host.twin.az.az_server import AzServer, simulated_port

NODE = 5
WAIT_S = 20.0
AZ_TOML = """
[bus]
interface = "virtual"
channel = "{channel}"

[[ports]]
path = "{path}"
parity = "none"
timeout_ms = 1000
axes = [{{drive_node = 5, device_id = 1, torque_limit_Nm = 0.5}}]
"""


@pytest.fixture
def config(tmp_path: Path) -> AzConfig:
    path = tmp_path / "az.toml"
    path.write_text(AZ_TOML.format(channel=uuid.uuid4().hex, path=tmp_path / "port"))
    return az_config.load(path)


@pytest.fixture
def line(config: AzConfig) -> Iterator[AzServer]:
    with simulated_port(config.ports[0]) as server:
        yield server


@pytest.fixture
def slow_replies(monkeypatch: pytest.MonkeyPatch) -> None:
    """A loaded test machine may answer late; what is lost is told by a killed line, not by a late one."""
    monkeypatch.setattr(gateway, "REPLY_TIMEOUT_S", 2.0)


@pytest.fixture
def node(config: AzConfig, line: AzServer, slow_replies: None) -> Iterator[BaseNode402]:
    stop = threading.Event()

    def serve() -> None:
        with open_bus(config.bus, "gateway") as bus:
            gateway.run_gateway(bus, config, stop)

    network = canopen.Network()
    network.connect(interface="virtual", channel=config.bus.channel)
    master = BaseNode402(NODE, str(CIA402_EDS))
    network.add_node(master)
    thread = threading.Thread(target=serve)
    thread.start()
    try:
        master.nmt.wait_for_bootup(WAIT_S)
        network.sync.start(0.01)
        yield master
    finally:
        network.sync.stop()
        network.disconnect()
        stop.set()
        thread.join()


def eventually(holds: Callable[[], bool]) -> bool:
    until = time.monotonic() + WAIT_S
    while not holds() and time.monotonic() < until:
        time.sleep(0.01)
    return holds()


def feed(node: BaseNode402, controlword: int, torque_per_mille: int) -> None:
    data = controlword.to_bytes(2, "little") + b"\x0a" + torque_per_mille.to_bytes(2, "little", signed=True)
    node.network.send_message(0x200 + NODE, data)


def enable(node: BaseNode402, torque_per_mille: int, seconds: float) -> None:
    """Command every 20 ms, as a host does, through the state machine and then with a torque."""
    for controlword in (0x06, 0x07, 0x0F):
        feed(node, controlword, 0)
        time.sleep(0.02)
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        feed(node, 0x0F, torque_per_mille)
        time.sleep(0.02)


def statusword(node: BaseNode402) -> int:
    return int(node.sdo[0x6041].raw)


def test_a_foreign_master_moves_an_az_joint(node: BaseNode402, line: AzServer) -> None:
    """0.19 N m over 0.4 N m s/rad is 0.48 rad/s, until the load, 4 N m/rad, takes the limit of 0.5 N m."""
    node.nmt.state = "OPERATIONAL"
    enable(node, 100, 0.5)
    with line.lock:
        position_rad = line.drives[1].plant.position_rad
    assert 0.04 < position_rad < 0.13
    assert statusword(node) & 0x6F == 0x27
    assert eventually(lambda: abs(node.sdo[0x6064].raw) > 0)


def test_silence_of_the_master_lets_the_joint_go(node: BaseNode402, line: AzServer) -> None:
    node.nmt.state = "OPERATIONAL"
    enable(node, 100, 0.2)
    assert eventually(lambda: statusword(node) & 0x4F == 0x08)
    assert eventually(lambda: line.drives[1].torque_Nm == 0.0)


def test_an_alarm_of_the_drive_is_a_fault_of_the_node_and_resets(node: BaseNode402, line: AzServer) -> None:
    with line.lock:
        line.drives[1].raise_alarm(0x30)
    assert eventually(lambda: node.sdo[0x603F].raw == 0xFF30)
    assert eventually(lambda: any(error.code == 0xFF30 for error in node.emcy.log))
    node.nmt.state = "OPERATIONAL"

    def reset() -> bool:
        feed(node, 0x00, 0)
        feed(node, 0x80, 0)
        time.sleep(0.05)
        return statusword(node) & 0x4F == 0x40 and node.sdo[0x603F].raw == 0

    assert eventually(reset)
    assert line.drives[1].alarm == 0


def test_a_gateway_that_is_gone_leaves_the_drives_to_their_own_watchdog(
    config: AzConfig, line: AzServer, slow_replies: None
) -> None:
    with gateway.PortThread(config.ports[0]).running():
        assert line.drives[1].alarm == 0
    with line.lock:
        line.drives[1].advance(time.monotonic_ns() // 1000 + 1_100_000)
    assert line.drives[1].alarm == alarms.COMMUNICATION_TIMEOUT
