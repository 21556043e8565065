"""AZ drives as CiA 402 nodes: a foreign 402 master, the gateway, and simulated drives on a serial line."""

from __future__ import annotations

import gc
import logging
import math
import struct
import threading
import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import canopen
import pytest
from canopen.profiles.p402 import BaseNode402

from palpate_bus.eds.cia402 import CIA402_EDS
from palpate_edge.can_bus.bus import open_bus
from palpate_edge.common.errors import BusError
from palpate_edge.common.local_sockets.sd_notify import Notifier
from palpate_host.drives.az import alarms, axis, gateway
from palpate_host.drives.az import config as az_config
from palpate_host.drives.az.config import AzConfig
from palpate_host.drives.az.registers import DRIVER_TEMPERATURE
from palpate_twin.drives.az.az_server import AzServer, simulated_port
from palpate_twin.drives.az.simulated_az import SimulatedAz
from palpate_twin.drives.drive_plant import JointParameters

NODE = 5
WAIT_S = 20.0
CYCLIC_POSITION, CYCLIC_VELOCITY, CYCLIC_TORQUE, HOMING = 8, 9, 10, 6  # 6060h
RAD = math.tau / 360_000  # an increment of the node, its 6092h: a thousandth of a degree
AZ_TOML = """
[bus]
interface = "virtual"
channel = "{channel}"

[[ports]]
path = "{path}"
parity = "none"
timeout_ms = 10000
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
    """Allow late replies of a loaded machine, but before the drives' own 10 s; losses are of killed lines."""
    monkeypatch.setattr(gateway, "REPLY_TIMEOUT_S", 8.0)


@pytest.fixture
def node(config: AzConfig, line: AzServer, slow_replies: None) -> Iterator[BaseNode402]:
    stop = threading.Event()

    def serve() -> None:
        with open_bus(config.bus, "gateway") as bus, closing(Notifier({})) as notifier:
            gateway.run_gateway(bus, config, stop, notifier)

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


@pytest.fixture
def no_deadline(node: BaseNode402) -> None:
    """A loaded test machine may command late: 1400h:05 off, where its 200 ms are not what is tested."""
    node.sdo[0x1400][5].raw = 0


def eventually(holds: Callable[[], bool]) -> bool:
    until = time.monotonic() + WAIT_S
    while not holds() and time.monotonic() < until:
        time.sleep(0.01)
    return holds()


def feed(node: BaseNode402, controlword: int, torque_per_mille: int, mode: int = CYCLIC_TORQUE) -> None:
    data = struct.pack("<HBh", controlword, mode, torque_per_mille)
    node.network.send_message(0x200 + NODE, data)


def enable(
    node: BaseNode402,
    torque_per_mille: int,
    seconds: float,
    mode: int = CYCLIC_TORQUE,
    controlword: int = 0x0F,
    arrived: Callable[[], bool] = lambda: False,
) -> None:
    """Command every 20 ms, as a host does: through the state machine, then in the mode, until `arrived`."""
    for word in (0x06, 0x07, 0x0F):
        feed(node, word, 0, mode)
        time.sleep(0.02)
    until = time.monotonic() + seconds
    while time.monotonic() < until and not arrived():
        feed(node, controlword, torque_per_mille, mode)
        time.sleep(0.02)


def statusword(node: BaseNode402) -> int:
    return int(node.sdo[0x6041].raw)


def test_the_garbage_collector_passes_over_what_the_gateway_was_built_of(node: BaseNode402) -> None:
    assert gc.get_freeze_count() > 0


@pytest.mark.usefixtures("no_deadline")
def test_a_foreign_master_moves_an_az_joint(node: BaseNode402, line: AzServer) -> None:
    """0.19 N m over 0.4 N m s/rad is 0.48 rad/s, until the load, 4 N m/rad, takes the limit of 0.5 N m."""
    node.nmt.state = "OPERATIONAL"
    enable(node, 100, 0.5)
    with line.lock:
        position_rad = line.drives[1].plant.position_rad
    assert 0.04 < position_rad < 0.13
    assert statusword(node) & 0x6F == 0x27
    assert eventually(lambda: abs(node.sdo[0x6064].raw) > 0)


@pytest.mark.usefixtures("no_deadline")
def test_a_foreign_master_turns_an_az_joint_with_a_velocity(node: BaseNode402, line: AzServer) -> None:
    """Without a load, which would stop the joint in the end, however late a loaded machine looks at it."""
    assert node.sdo[0x6092][1].raw == 360_000
    with line.lock:
        line.drives[1].plant.parameters = JointParameters(load_stiffness_Nm_rad=0.0)
    node.nmt.state = "OPERATIONAL"
    node.sdo[0x60FF].raw = velocity = 3_600  # 0.063 rad/s
    enable(node, 0, 0.3, CYCLIC_VELOCITY)
    begin, position = time.monotonic(), node.sdo[0x6064].raw
    enable(node, 0, WAIT_S, CYCLIC_VELOCITY, arrived=lambda: node.sdo[0x6064].raw > position + velocity)
    assert time.monotonic() - begin > 0.8  # a second, but for the age of the answers
    with line.lock:
        assert line.drives[1].plant.velocity_rad_s == pytest.approx(velocity * RAD, rel=0.05)


@pytest.mark.usefixtures("no_deadline")
def test_a_foreign_master_sends_an_az_joint_to_a_position(node: BaseNode402, line: AzServer) -> None:
    node.nmt.state = "OPERATIONAL"
    node.sdo[0x607A].raw = target = -3_600  # 0.063 rad; the load, 4 N m/rad, takes 0.25 of the 0.5 N m
    enable(node, 0, WAIT_S, CYCLIC_POSITION, arrived=lambda: abs(node.sdo[0x6064].raw - target) <= 50)
    with line.lock:
        assert line.drives[1].plant.position_rad == pytest.approx(target * RAD, abs=0.002)


@pytest.mark.usefixtures("no_deadline")
def test_homing_by_the_drive_itself(node: BaseNode402, line: AzServer) -> None:
    """Method -1 is the maker's own: ZHOME, to the zero of the drive's absolute encoder."""
    with line.lock:
        line.drives[1].plant.position_rad = 0.1
    node.nmt.state = "OPERATIONAL"
    node.sdo[0x6098].raw = -1
    enable(node, 0, WAIT_S, HOMING, 0x1F, arrived=lambda: bool(statusword(node) & 1 << 12))
    assert statusword(node) & (1 << 12 | 1 << 13) == 1 << 12
    with line.lock:
        assert line.drives[1].plant.position_rad == pytest.approx(0.0, abs=0.002)


def test_silence_of_the_master_lets_the_joint_go(node: BaseNode402, line: AzServer) -> None:
    node.nmt.state = "OPERATIONAL"
    enable(node, 100, 0.2)
    assert eventually(lambda: statusword(node) & 0x4F == 0x08)
    assert eventually(lambda: line.drives[1].torque_Nm == 0.0)


def test_an_alarm_of_the_drive_is_a_fault_of_the_node_and_resets(
    node: BaseNode402, line: AzServer, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO, "palpate.az")
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
    logged = [(record.levelname, record.getMessage()) for record in caplog.records]
    assert [level for level, text in logged if "drive 1 on" in text] == ["ERROR", "INFO"]
    assert "alarm 30h" in next(text for level, text in logged if level == "ERROR")


def test_a_gateway_that_is_gone_leaves_the_drives_to_their_own_watchdog(
    config: AzConfig, line: AzServer, slow_replies: None
) -> None:
    with gateway.PortThread(config.ports[0]).running():
        assert line.drives[1].alarm == 0
    with line.lock:
        line.drives[1].advance(time.monotonic_ns() // 1000 + 10_100_000)
    assert line.drives[1].alarm == alarms.COMMUNICATION_TIMEOUT


@pytest.fixture
def measured(line: AzServer) -> Callable[[], None]:
    """Waits until the gateway has acted on temperatures that it read from now on."""
    drive, reads = line.drives[1], 0
    read = drive.read

    def counted(now_us: int, address: int, count: int) -> list[int]:
        nonlocal reads
        reads += address == DRIVER_TEMPERATURE.address
        return read(now_us, address, count)

    drive.read = counted  # type: ignore[method-assign]

    def wait() -> None:
        begin = reads
        assert eventually(lambda: reads >= begin + 2)

    return wait


def heat(line: AzServer, driver_degC: float, motor_degC: float) -> None:
    with line.lock:
        line.drives[1].driver_degC, line.drives[1].motor_degC = driver_degC, motor_degC


def told(node: BaseNode402, code: int) -> int:
    """How often the node has said this by EMCY."""
    return sum(error.code == code for error in node.emcy.log)


def is_reset(node: BaseNode402) -> bool:
    """Whether a rising edge of bit 7 leads out of Fault."""
    feed(node, 0x00, 0)
    feed(node, 0x80, 0)
    time.sleep(0.05)
    return statusword(node) & 0x4F == 0x40


@pytest.mark.usefixtures("no_deadline")
@pytest.mark.parametrize("hot", [(75.1, 30.0), (30.0, 75.1)], ids=["drive", "motor"])
def test_an_axis_above_its_limit_is_switched_off_until_it_has_cooled(
    node: BaseNode402, line: AzServer, measured: Callable[[], None], hot: tuple[float, float]
) -> None:
    """The limit is 75 degC, 5 K of it to cool: 4310h is CiA 402-2's excess temperature of a drive."""
    node.nmt.state = "OPERATIONAL"
    heat(line, 75.0, 75.0)
    enable(node, 100, WAIT_S, arrived=lambda: line.drives[1].torque_Nm > 0.0)
    measured()
    assert told(node, 0x4310) == 0
    heat(line, *hot)
    enable(node, 100, WAIT_S, arrived=lambda: statusword(node) & 0x4F == 0x08)
    assert node.sdo[0x603F].raw == 0x4310
    assert eventually(lambda: told(node, 0x4310) == 1)
    assert next(error.register for error in node.emcy.log if error.code == 0x4310) == 0x09
    assert eventually(lambda: line.drives[1].torque_Nm == 0.0)
    heat(line, 70.1, 70.1)
    measured()
    assert not is_reset(node)
    assert told(node, 0x4310) == 1 and told(node, 0x0000) == 0  # Fault was not left for a moment either
    heat(line, 70.0, 70.0)
    measured()
    assert is_reset(node)
    assert node.sdo[0x603F].raw == 0 and node.sdo[0x1001].raw == 0
    enable(node, 100, WAIT_S, arrived=lambda: line.drives[1].torque_Nm > 0.0)
    assert statusword(node) & 0x6F == 0x27


def test_a_master_that_asks_anew_is_told_of_the_heat_anew(node: BaseNode402, line: AzServer) -> None:
    heat(line, 30.0, 80.0)
    assert eventually(lambda: told(node, 0x4310) == 1)
    node.nmt.state = "RESET COMMUNICATION"
    assert eventually(lambda: told(node, 0x4310) == 2)
    assert node.sdo[0x603F].raw == 0x4310


def test_heat_is_told_of_a_drive_that_is_in_fault_already(
    node: BaseNode402, line: AzServer, measured: Callable[[], None]
) -> None:
    """The reset that then helps ends both errors."""
    with line.lock:
        line.drives[1].raise_alarm(0x30)
    assert eventually(lambda: told(node, 0xFF30) == 1)
    heat(line, 30.0, 80.0)
    assert eventually(lambda: told(node, 0x4310) == 1)
    node.nmt.state = "OPERATIONAL"
    heat(line, 30.0, 60.0)
    measured()
    assert eventually(lambda: is_reset(node) and node.sdo[0x1001].raw == 0)


def deny_temperatures(drive: SimulatedAz) -> None:
    """The drive answers a read of its temperatures with Modbus' illegal address."""
    knows = drive.readable
    drive.readable = (  # type: ignore[method-assign]
        lambda address, count: address != DRIVER_TEMPERATURE.address and knows(address, count)
    )


def test_a_drive_without_temperatures_is_refused_at_the_start(
    config: AzConfig, line: AzServer, slow_replies: None
) -> None:
    deny_temperatures(line.drives[1])
    with (
        pytest.raises(BusError, match=r"AZ drive 1 on .* rejects the request"),
        gateway.PortThread(config.ports[0]).running(),
    ):
        pass


def test_a_drive_that_tells_no_temperature_any_more_is_lost(
    node: BaseNode402, line: AzServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert node.sdo[0x603F].raw == 0
    monkeypatch.setattr(axis, "TEMPERATURE_AGE_LIMIT_US", 500_000)
    with line.lock:
        deny_temperatures(line.drives[1])
    assert eventually(lambda: node.sdo[0x603F].raw == 0x7500)
