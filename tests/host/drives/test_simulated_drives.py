"""The simulated drive against CiA 402-2 (state machine, cyclic synchronous torque) and against mechanics."""

from __future__ import annotations

import math
import struct
import subprocess
import sys
import threading
import time
import uuid
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import can
import canopen
import pytest
from canopen.profiles.p402 import BaseNode402
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate_bus.eds.cia402 import CIA402_EDS, DriveState
from palpate_edge.can_bus.bus import Bus, BusConfig, open_bus
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.errors import BusError, ConfigError
from palpate_edge.node.slave import SlaveOutput
from palpate_host.config import hand_reader
from palpate_host.config.packaged import MODELS
from palpate_host.drives.serve_devices import serve_devices
from palpate_twin.drives.drive_plant import JointParameters, JointPlant
from palpate_twin.drives.hand_drives import drives_of
from palpate_twin.drives.simulated_drives import SimulatedDrive

TABLE_4_HAND = MODELS / "table4.toml"
START = CanFrame(0x000, b"\x01\x00")
SYNC = CanFrame(0x080)
WAIT_S = 10.0


def rpdo(controlword: int, torque_per_mille: int = 0, mode: int = 10) -> CanFrame:
    return CanFrame(0x205, struct.pack("<Hbh", controlword, mode, torque_per_mille))


def statusword(drive: SimulatedDrive) -> int:
    return int(drive.slave.read(0x6041))


@pytest.fixture
def drive() -> SimulatedDrive:
    """Node 5 in NMT OPERATIONAL at time 0."""
    drive = SimulatedDrive(5)
    drive.process(0, (START,))
    return drive


@pytest.fixture
def enabled(drive: SimulatedDrive) -> SimulatedDrive:
    drive.process(0, (rpdo(0x06), rpdo(0x07), rpdo(0x0F)))
    assert drive.state is DriveState.OPERATION_ENABLED
    return drive


# CiA 402-2: statusword bits 6, 5, 3-0 under the mask of the table of state coding.
STATE_CODING = {
    DriveState.SWITCH_ON_DISABLED: (0x4F, 0x40),
    DriveState.READY_TO_SWITCH_ON: (0x6F, 0x21),
    DriveState.SWITCHED_ON: (0x6F, 0x23),
    DriveState.OPERATION_ENABLED: (0x6F, 0x27),
    DriveState.QUICK_STOP_ACTIVE: (0x6F, 0x07),
    DriveState.FAULT: (0x4F, 0x08),
}
SOD, RTSO, SO, OE, QSA, FAULT = STATE_CODING


@pytest.mark.parametrize(
    ("path", "state"),
    [
        ([], SOD),
        ([0x06], RTSO),
        ([0x06, 0x07], SO),
        ([0x06, 0x07, 0x0F], OE),
        ([0x06, 0x0F], OE),
        ([0x06, 0x07, 0x0F, 0x07], SO),
        ([0x06, 0x07, 0x0F, 0x06], RTSO),
        ([0x06, 0x07, 0x0F, 0x00], SOD),
        ([0x06, 0x07, 0x0F, 0x02], QSA),
        ([0x06, 0x07, 0x0F, 0x02, 0x0F], OE),
        ([0x06, 0x07, 0x0F, 0x02, 0x00], SOD),
        ([0x06, 0x07, 0x06], RTSO),
        ([0x06, 0x07, 0x00], SOD),
        ([0x06, 0x02], SOD),
        ([0x07], SOD),
        ([0x0F], SOD),
        ([0x80], SOD),
    ],
)
def test_controlwords_lead_through_the_states(
    drive: SimulatedDrive, path: list[int], state: DriveState
) -> None:
    for controlword in path:
        drive.process(0, (rpdo(controlword),))
    mask, value = STATE_CODING[state]
    assert statusword(drive) & mask == value


def test_a_fault_resets_at_the_rising_edge_of_bit_7_only(enabled: SimulatedDrive) -> None:
    enabled.process(0, (rpdo(0x8F),))
    enabled.process(1_000_000, ())
    assert enabled.state is DriveState.FAULT
    enabled.process(1_000_001, (rpdo(0x8F),))
    assert enabled.state is DriveState.FAULT
    enabled.process(1_000_002, (rpdo(0x00), rpdo(0x80)))
    assert enabled.state is DriveState.SWITCH_ON_DISABLED
    assert enabled.slave.read(0x603F) == 0


def test_the_status_is_told_on_entering_operational() -> None:
    sent = SimulatedDrive(5).process(0, (START,)).frames_out
    assert [frame.can_id for frame in sent] == [0x705, 0x285]
    assert struct.unpack("<Hbh", sent[1].data)[0] & 0x4F == 0x40


def test_a_change_of_the_statusword_is_sent_at_once(drive: SimulatedDrive) -> None:
    sent = drive.process(10, (rpdo(0x06),)).frames_out
    assert [frame.can_id for frame in sent] == [0x285]
    word, mode, torque = struct.unpack("<Hbh", sent[0].data)
    assert (word & 0x6F, mode, torque) == (0x21, 10, 0)
    assert drive.process(20, (rpdo(0x06),)).frames_out == ()


def test_status_comes_every_100_ms_and_position_at_every_sync(drive: SimulatedDrive) -> None:
    drive.process(10, (rpdo(0x06),))
    at_100_ms = drive.process(100_010, ()).frames_out
    assert 0x285 in [frame.can_id for frame in at_100_ms]
    for now_us in (100_020, 100_030, 100_040):
        answer = drive.process(now_us, (SYNC,)).frames_out
        assert [frame.can_id for frame in answer] == [0x185]
        assert len(answer[0].data) == 8


def test_torque_turns_the_joint_against_its_load_only_when_enabled(drive: SimulatedDrive) -> None:
    drive.process(0, (rpdo(0x06, 100),))
    drive.process(150_000, (rpdo(0x07, 100),))
    assert drive.plant.position_rad == 0.0
    for step in range(1, 21):
        drive.process(150_000 + step * 50_000, (rpdo(0x0F, 100), SYNC))
    # 100 per mille of 1.9 N m against 4 N m/rad, in units of 0.001 degree
    expected_increments = math.degrees(0.19 / 4.0) * 1000
    position, velocity = struct.unpack("<ii", drive.process(1_160_000, (SYNC,)).frames_out[0].data)
    assert position == pytest.approx(expected_increments, abs=2)
    assert abs(velocity) < 10
    assert drive.slave.read(0x6077) == 100


def test_torque_is_held_within_6072(enabled: SimulatedDrive) -> None:
    write_300 = CanFrame(0x605, struct.pack("<BHBHxx", 0x2B, 0x6072, 0, 300))
    enabled.process(1, (write_300, rpdo(0x0F, -900)))
    assert enabled.slave.read(0x6077) == -300
    assert statusword(enabled) & 1 << 11


def test_6072_takes_the_rated_torque_and_refuses_more(drive: SimulatedDrive) -> None:
    output = drive.process(1, (CanFrame(0x605, struct.pack("<BHBHxx", 0x2B, 0x6072, 0, 1000)),))
    assert output.frames_out[0].data == struct.pack("<BHB4x", 0x60, 0x6072, 0)
    output = drive.process(1, (CanFrame(0x605, struct.pack("<BHBHxx", 0x2B, 0x6072, 0, 1001)),))
    assert output.frames_out[0].data == struct.pack("<BHBI", 0x80, 0x6072, 0, 0x0609_0031)


def test_a_mode_that_6502_lacks_gives_no_torque(drive: SimulatedDrive) -> None:
    for controlword in (0x06, 0x07, 0x0F):
        drive.process(0, (rpdo(controlword, 500, mode=4),))
    assert drive.slave.read(0x6061) == 0
    assert drive.slave.read(0x6077) == 0
    assert int(drive.slave.read(0x6502)) == 1 << 0 | 1 << 2 | 1 << 5 | 1 << 7 | 1 << 8 | 1 << 9


def test_silence_of_the_host_takes_the_torque_away(enabled: SimulatedDrive) -> None:
    output = enabled.process(1_000, (rpdo(0x0F, 200),))
    assert output.next_due_us <= 201_000
    assert enabled.process(200_999, ()).frames_out[-1].can_id != 0x085
    sent = enabled.process(201_000, ()).frames_out
    emcy = next(frame for frame in sent if frame.can_id == 0x085)
    assert emcy.data == struct.pack("<HB5x", 0x8250, 0x11)
    assert enabled.state is DriveState.FAULT
    assert enabled.slave.read(0x6077) == 0
    assert enabled.slave.read(0x603F) == 0x8250


@pytest.mark.parametrize("command", [0x02, 0x80, 0x82], ids=["stop", "pre-operational", "reset comm"])
def test_leaving_operational_takes_the_torque_away(enabled: SimulatedDrive, command: int) -> None:
    enabled.process(1, (rpdo(0x0F, 200), CanFrame(0x000, bytes([command, 5]))))
    assert enabled.state is DriveState.FAULT
    assert enabled.torque_per_mille == 0


def test_a_fault_is_told_and_its_end_too(enabled: SimulatedDrive) -> None:
    output = enabled.process(1, (CanFrame(0x000, b"\x80\x05"),))
    assert emergencies(output.frames_out) == [struct.pack("<HB5x", 0x8100, 0x11)]
    output = enabled.process(3, (START, rpdo(0x80)))
    assert emergencies(output.frames_out) == [bytes(8)]
    assert enabled.slave.read(0x1001) == 0


def emergencies(frames: Sequence[CanFrame]) -> list[bytes]:
    return [frame.data for frame in frames if frame.can_id == 0x085]


def test_a_node_reset_switches_off_and_keeps_the_position(enabled: SimulatedDrive) -> None:
    enabled.process(1, (rpdo(0x0F, 200),))
    enabled.process(150_000, (rpdo(0x0F, 200),))
    before_rad = enabled.plant.position_rad
    enabled.process(150_000, (CanFrame(0x000, b"\x81\x05"),))
    assert enabled.state is DriveState.SWITCH_ON_DISABLED
    assert enabled.plant.position_rad == before_rad > 0.04
    assert enabled.slave.read(0x6071) == 0


def test_quick_stop_gives_no_torque(enabled: SimulatedDrive) -> None:
    enabled.process(1, (rpdo(0x0F, 200), rpdo(0x02, 200)))
    assert enabled.state is DriveState.QUICK_STOP_ACTIVE
    assert enabled.torque_per_mille == 0


def test_free_joint_reaches_the_speed_where_friction_balances() -> None:
    free = JointParameters(load_stiffness_Nm_rad=0.0, load_damping_Nms_rad=0.0, max_rad=1000.0)
    plant = JointPlant(free)
    plant.advance(500_000, 0.1)
    assert plant.velocity_rad_s == pytest.approx(0.1 / 0.05, rel=1e-6)


def test_free_joint_without_friction_accelerates_by_torque_over_inertia() -> None:
    free = JointParameters(
        friction_Nms_rad=0.0, load_stiffness_Nm_rad=0.0, load_damping_Nms_rad=0.0, max_rad=1000.0
    )
    plant = JointPlant(free)
    plant.advance(100_000, 0.01)
    inertia_kgm2 = 9.2e-7 * 20 * 20
    assert plant.velocity_rad_s == pytest.approx(0.1 * 0.01 / inertia_kgm2, rel=1e-9)


def test_joint_stops_at_its_limits() -> None:
    plant = JointPlant(JointParameters(min_rad=-0.1, max_rad=0.2))
    plant.advance(900_000, 1.9)
    assert (plant.position_rad, plant.velocity_rad_s) == (0.2, 0.0)
    plant.advance(900_000, -1.9)
    assert (plant.position_rad, plant.velocity_rad_s) == (-0.1, 0.0)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 5_000), st.integers(0, 0x7FF), st.binary(max_size=8)), max_size=30))
def test_no_frame_makes_a_drive_raise_or_give_torque_outside_operation_enabled(
    traffic: list[tuple[int, int, bytes]],
) -> None:
    drive = SimulatedDrive(5)
    now_us = 0
    for pause_us, can_id, data in traffic:
        now_us += pause_us
        drive.process(now_us, (START, CanFrame(can_id, data), CanFrame(0x205, data)))
        assert drive.state is DriveState.OPERATION_ENABLED or drive.slave.read(0x6077) == 0


def test_the_drives_of_a_hand_take_direction_offset_and_limits_from_it() -> None:
    config = hand_reader.load(TABLE_4_HAND)
    drives = drives_of(config, (0.0, 0.348, 1.221))
    assert [drive.slave.node_id for drive in drives] == [joint.drive_node for joint in config.joints]
    for drive, joint in zip(drives, config.joints, strict=True):
        q_rad = joint.direction * drive.plant.position_rad + joint.zero_offset_rad
        assert q_rad == pytest.approx((0.0, 0.348, 1.221)[config.joints.index(joint) % 3])
        assert drive.plant.parameters.max_rad - drive.plant.parameters.min_rad == pytest.approx(
            joint.max_rad - joint.min_rad
        )


def test_a_mirrored_drive_starts_at_its_own_angle_and_limits(tmp_path: Path) -> None:
    """q = -drive + 0.25: curl_1 at 1.221 rad within 0..1.8 is the drive at -0.971 within -1.55..0.25."""
    old = "drive_node = 3, direction = 1, zero_offset_rad = 0.0"
    hand = tmp_path / "hand.toml"
    hand.write_text(
        TABLE_4_HAND.read_text().replace(old, "drive_node = 3, direction = -1, zero_offset_rad = 0.25")
    )
    config = hand_reader.load(hand)
    plant = drives_of(config, (0.0, 0.348, 1.221))[2].plant
    assert plant.position_rad == pytest.approx(-0.971)
    assert (plant.parameters.min_rad, plant.parameters.max_rad) == pytest.approx((-1.55, 0.25))


def test_a_pose_of_the_wrong_length_is_refused() -> None:
    config = hand_reader.load(TABLE_4_HAND)
    with pytest.raises(ConfigError, match="pose-rad"):
        drives_of(config, (0.0, 0.348))


class Running:
    """Drives served by `serve_devices` in a thread, on an in-process bus."""

    def __init__(self, drives: list[SimulatedDrive]) -> None:
        self.channel = uuid.uuid4().hex
        self.error: BusError | None = None
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, args=(drives,))
        self._opened = threading.Event()

    def __enter__(self) -> Running:
        self._thread.start()
        assert self._opened.wait(WAIT_S)
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()

    def join(self) -> None:
        self._thread.join(WAIT_S)

    def _run(self, drives: list[SimulatedDrive]) -> None:
        with open_bus(BusConfig(interface="virtual", channel=self.channel), "drives") as bus:
            self._opened.set()
            try:
                serve_devices(bus, drives, self._stop)
            except BusError as error:
                self.error = error


def eventually(holds: Callable[[], bool]) -> bool:
    until = time.monotonic() + WAIT_S
    while not holds() and time.monotonic() < until:
        time.sleep(0.01)
    return holds()


def test_the_402_profile_of_another_master_enables_and_moves_a_drive() -> None:
    with Running([SimulatedDrive(5)]) as running:
        network = canopen.Network()
        network.NOTIFIER_CYCLE = 0.05
        network.connect(channel=running.channel, interface="virtual")
        try:
            node = network.add_node(BaseNode402(5, str(CIA402_EDS)))
            node.sdo.RESPONSE_TIMEOUT = WAIT_S
            node.TIMEOUT_SWITCH_STATE_FINAL = WAIT_S
            node.sdo[0x1400][5].raw = 0  # this master sends RPDOs at changes only
            node.nmt.wait_for_heartbeat(WAIT_S)
            node.setup_402_state_machine()
            node.nmt.state = "OPERATIONAL"
            assert eventually(lambda: node.state == "SWITCH ON DISABLED")
            node.sdo[0x6060].raw = 10
            node.state = "OPERATION ENABLED"
            assert node.state == "OPERATION ENABLED"
            node.rpdo[1][0x6040].raw = 0x0F
            node.rpdo[1][0x6060].raw = 10
            node.rpdo[1][0x6071].raw = 50
            node.rpdo[1].transmit()
            assert eventually(lambda: node.sdo[0x6064].raw >= 500)
            node.state = "SWITCH ON DISABLED"
            assert node.state == "SWITCH ON DISABLED"
        finally:
            network.disconnect()


def test_a_second_node_with_the_same_id_stops_the_process() -> None:
    with Running([SimulatedDrive(5), SimulatedDrive(6)]) as running:
        with can.Bus(running.channel, interface="virtual") as stranger:
            stranger.send(can.Message(arbitration_id=0x706, data=[0], is_extended_id=False))
            running.join()
        assert running.error is not None
        assert "node id 0x06 is taken" in str(running.error)


class ListeningDrive(SimulatedDrive):
    """A drive that notes what it is asked with."""

    def __init__(self, node_id: int) -> None:
        super().__init__(node_id)
        self.heard: list[int] = []

    def process(self, now_us: int, frames_in: Sequence[CanFrame]) -> SlaveOutput:
        self.heard += [frame.can_id for frame in frames_in]
        return super().process(now_us, frames_in)


def test_a_drive_hears_what_is_for_it_and_not_what_is_for_others() -> None:
    mine, other = ListeningDrive(5), ListeningDrive(6)
    with (
        Running([mine, other]) as running,
        open_bus(BusConfig(interface="virtual", channel=running.channel), "master") as bus,
    ):
        bus.send([CanFrame(0x206, struct.pack("<Hbh", 0x06, 10, 0)), rpdo(0x06), SYNC])
        assert eventually(lambda: (mine.heard, other.heard) == ([0x205, 0x080], [0x206, 0x080]))


def test_two_runs_of_the_same_frames_are_the_same() -> None:
    traffic = [(at_us, (rpdo(0x0F, at_us // 1000 % 90), SYNC)) for at_us in range(0, 400_000, 10_000)]

    def run() -> list[tuple[CanFrame, ...]]:
        drive = SimulatedDrive(5)
        drive.process(0, (START, rpdo(0x06), rpdo(0x07)))
        return [drive.process(at_us, frames).frames_out for at_us, frames in traffic]

    assert run() == run()


HUB = "from palpate_bus.cli.main import bus; bus()"
DRIVES = "from palpate_twin.cli.drives import drives; drives()"


@contextmanager
def running(program: str, *arguments: str) -> Iterator[subprocess.Popen[str]]:
    """A process that has said its first line; killed if it still runs at the end."""
    command = [sys.executable, "-c", program, *arguments]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stderr is not None
            assert process.stderr.readline()
            yield process
        finally:
            process.kill()


def test_the_command_serves_every_drive_of_a_hand_and_stops_at_sigterm(tmp_path: Path) -> None:
    socket = tmp_path / "hub.sock"
    on_the_hub = f'interface = "palpate"\nchannel = "{socket}"'
    hand = tmp_path / "hand.toml"
    hand.write_text(TABLE_4_HAND.read_text().replace('interface = "palpate"', on_the_hub))
    config = BusConfig(interface="palpate", channel=str(socket))
    with (
        running(HUB, "hub", "--socket", str(socket)),
        open_bus(config, "test") as bus,
        running(DRIVES, "--config", str(hand)) as process,
    ):
        booted: set[int] = set()
        assert eventually(lambda: boot_ups(bus, booted) == {0x700 + node for node in range(1, 10)})
        process.terminate()
        _, said = process.communicate(timeout=WAIT_S)
        assert (process.returncode, "9 switch on disabled" in said) == (0, True)


def boot_ups(bus: Bus, seen: set[int]) -> set[int]:
    seen |= {frame.can_id for _, frame in bus.receive(0) if frame.data == b"\x00"}
    return seen
