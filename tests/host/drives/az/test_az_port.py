"""AzPort against simulated drives behind a real serial line (two pseudo terminals)."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from contextlib import closing, suppress

import pytest

from palpate_edge.common.errors import BusError
from palpate_host.drives.az import alarms, motor
from palpate_host.drives.az.axis import AxisSettings, AzAxis, ExtraRead
from palpate_host.drives.az.port import AzPort, Parity
from palpate_host.drives.az.registers import MOTOR_TEMPERATURE, AzStatus, Input
from palpate_host.drives.az.temperature import AzTemperatures
from palpate_host.drives.cia402_device import Cia402Device
from palpate_twin.drives.az.az_server import AzServer
from palpate_twin.drives.az.pty_line import pty_line
from palpate_twin.drives.az.simulated_az import SimulatedAz
from palpate_twin.drives.drive_plant import JointParameters

BAUD_RATE = 230_400
MOTOR = motor.AzMotor()
FREE_JOINT = JointParameters(load_stiffness_Nm_rad=0.0)


@pytest.fixture
def drives() -> dict[int, SimulatedAz]:
    return {1: SimulatedAz(MOTOR, FREE_JOINT), 2: SimulatedAz(MOTOR)}


@pytest.fixture
def line(drives: dict[int, SimulatedAz]) -> Iterator[str]:
    with pty_line(BAUD_RATE) as (host_end, drive_end), AzServer(drives).serve(drive_end, BAUD_RATE):
        yield host_end


@pytest.fixture
def port(line: str) -> Iterator[AzPort]:
    """A loaded machine may reply late."""
    with closing(AzPort(line, BAUD_RATE, Parity.NONE, reply_timeout_s=20.0)) as opened:
        yield opened


def test_velocity_moves_the_joint_and_is_read_back(port: AzPort) -> None:
    for _ in range(60):
        words = port.move(1, motor.velocity_operation(MOTOR, 1.0, 1.0))
        time.sleep(0.005)
    answer = motor.motion(MOTOR, words)
    assert answer.velocity_rad_s == pytest.approx(1.0, abs=0.05)
    assert answer.position_rad > 0.1


def test_position_is_reached(port: AzPort) -> None:
    deadline = time.monotonic() + 5.0
    position = math.nan
    while time.monotonic() < deadline and not abs(position - 0.3) < 0.002:
        position = motor.motion(MOTOR, port.move(1, motor.position_operation(MOTOR, 0.3, 1.0))).position_rad
    assert position == pytest.approx(0.3, abs=0.002)


def test_torque_bends_the_load_by_its_own_stiffness(port: AzPort) -> None:
    """k (q - q_g) = tau at rest: 0.4 N m on 4 N m/rad is 0.1 rad."""
    position = math.nan
    for _ in range(100):
        position = motor.motion(MOTOR, port.move(2, motor.torque_operation(MOTOR, -0.4))).position_rad
    assert position == pytest.approx(-0.1, abs=0.005)


def test_the_drive_returns_to_its_own_zero(port: AzPort, drives: dict[int, SimulatedAz]) -> None:
    """ZHOME (HM-60262E, driver input command): HOME-END and no MOVE when it is there."""
    drives[1].plant.position_rad = 0.2
    assert AzStatus.HOME_END not in port.health(1).status
    port.command(1, Input.ZHOME)
    assert AzStatus.MOVE in port.health(1).status
    deadline = time.monotonic() + 5.0
    while AzStatus.HOME_END not in port.health(1).status and time.monotonic() < deadline:
        time.sleep(0.01)
    health = port.health(1)
    assert AzStatus.HOME_END in health.status and AzStatus.MOVE not in health.status
    assert motor.motion(MOTOR, port.motion(1)).position_rad == pytest.approx(0.0, abs=0.002)


def test_own_watchdog_stops_a_drive_that_hears_nothing(port: AzPort, drives: dict[int, SimulatedAz]) -> None:
    port.watch(1, 100)
    port.move(1, motor.velocity_operation(MOTOR, 1.0, 1.0))
    time.sleep(0.3)
    health = port.health(1)
    assert health.alarm == alarms.COMMUNICATION_TIMEOUT
    assert AzStatus.ALM_A in health.status
    assert drives[1].torque_Nm == 0.0
    port.command(1, Input.ALM_RST)
    port.command(1, Input(0))
    assert port.health(1).alarm == 0


def test_stop_holds_and_free_lets_go(port: AzPort, drives: dict[int, SimulatedAz]) -> None:
    port.move(1, motor.velocity_operation(MOTOR, 1.0, 1.0))
    port.command(1, Input.STOP)
    time.sleep(0.2)
    assert motor.motion(MOTOR, port.motion(1)).velocity_rad_s == pytest.approx(0.0, abs=0.01)
    port.command(2, Input.FREE)
    assert drives[2].torque_Nm == 0.0


def test_units_of_a_monitor(port: AzPort) -> None:
    assert port.value(1, MOTOR_TEMPERATURE) == pytest.approx(30.0)


def test_temperatures_are_those_of_drive_and_motor(port: AzPort, drives: dict[int, SimulatedAz]) -> None:
    drives[1].driver_degC, drives[1].motor_degC = 61.3, -4.7
    assert port.temperatures(1) == AzTemperatures(driver_degC=61.3, motor_degC=-4.7)


def test_heat_outlives_a_reset_that_was_on_its_way(port: AzPort, drives: dict[int, SimulatedAz]) -> None:
    axis = AzAxis(AxisSettings(device_id=1, motor=MOTOR, torque_limit_Nm=0.5))
    for motor_degC, error_code in [(75.0, 0), (75.1, 0x4310), (70.0, 0)]:
        drives[1].motor_degC = motor_degC
        axis.measure(0, port)
        axis.reset_fault()
        assert axis.state(0).error_code == error_code


def test_heat_beside_an_alarm_is_told_however_seldom_the_node_looks(
    port: AzPort, drives: dict[int, SimulatedAz]
) -> None:
    axis = AzAxis(AxisSettings(device_id=1, motor=MOTOR, torque_limit_Nm=0.5))
    node = Cia402Device(5, axis)
    drives[1].raise_alarm(0x30)
    drives[1].motor_degC = 80.0
    for extra in (ExtraRead.HEALTH, ExtraRead.TEMPERATURES, ExtraRead.HEALTH):
        axis.exchange(0, port, extra)
    frames = [*node.process(0, ()).frames_out, *node.process(10_000, ()).frames_out]
    codes = [int.from_bytes(frame.data[:2], "little") for frame in frames if frame.can_id == 0x085]
    assert codes == [0xFF30, 0x4310]


def test_missing_drive_is_named_and_the_port_lives_on(line: str) -> None:
    with closing(AzPort(line, BAUD_RATE, Parity.NONE, reply_timeout_s=0.5)) as port:
        with pytest.raises(BusError, match=r"AZ drive 9 on .* does not respond"):
            port.motion(9)
        for _ in range(20):  # a loaded machine may reply late
            with suppress(BusError):
                assert port.health(1).alarm == 0
                return
    pytest.fail("a drive that is there does not respond")


def test_missing_port_is_named() -> None:
    with pytest.raises(BusError, match="/dev/no-such-adapter: cannot be opened"):
        AzPort("/dev/no-such-adapter")
