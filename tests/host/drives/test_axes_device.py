"""A drive node with several axes against CiA 402-2: objects n * 800h higher, each axis with its own states.

Bytes and indices are worked out here from the numbers of the standard.
"""

from __future__ import annotations

import struct

import pytest

from palpate_bus.eds.cia402 import DriveState
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.errors import ConfigError
from palpate_host.drives.cia402_modes import OperationMode
from palpate_host.drives.cia402_motion import MotorState
from palpate_twin.drives.drive_plant import JointParameters
from palpate_twin.drives.simulated_drives import SimulatedAxes

NODE = 5
START = CanFrame(0x000, bytes([1, NODE]))
SYNC = CanFrame(0x080)
TORQUE_MODE = 10
AXES = (0, 1, 2, 3, 4)
ENABLE = (0x06, 0x07, 0x0F)


def sdo_write(index: int, subindex: int, value: int, size: int) -> CanFrame:
    command = {1: 0x2F, 2: 0x2B, 4: 0x23}[size]
    return CanFrame(0x600 + NODE, struct.pack("<BHB", command, index, subindex) + value.to_bytes(4, "little"))


def mapping(communication: int, cob_id: int, words: list[int]) -> list[CanFrame]:
    """CiA 301: PDO off, no objects, the objects, their number, PDO on."""
    parameters = communication + 0x200
    slots = [sdo_write(parameters, slot, word, 4) for slot, word in enumerate(words, 1)]
    return [
        sdo_write(communication, 1, cob_id | 1 << 31, 4),
        sdo_write(parameters, 0, 0, 1),
        *slots,
        sdo_write(parameters, 0, len(words), 1),
        sdo_write(communication, 1, cob_id, 4),
    ]


def objects(axis: int, *numbers: tuple[int, int]) -> list[int]:
    return [(index + 0x800 * axis) << 16 | bits for index, bits in numbers]


COMMAND = [word for axis in AXES for word in objects(axis, (0x6040, 16), (0x6071, 16))]
STATE = [
    word for axis in AXES for word in objects(axis, (0x6041, 16), (0x6064, 32), (0x606C, 32), (0x6077, 16))
]


def command(*pairs: tuple[int, int]) -> CanFrame:
    """RPDO 1 with controlword and torque of each axis: 20 bytes, a length of CAN FD."""
    return CanFrame(0x200 + NODE, b"".join(struct.pack("<Hh", *pair) for pair in pairs), fd=True)


def make_node() -> SimulatedAxes:
    """A node with five axes, configured and started."""
    node = SimulatedAxes(NODE, {axis: JointParameters(grasp_rad=0.1 * axis) for axis in AXES})
    node.process(0, ())
    requests = [*mapping(0x1400, 0x200 + NODE, COMMAND), *mapping(0x1800, 0x180 + NODE, STATE)]
    requests += [sdo_write(0x6060 + 0x800 * axis, 0, TORQUE_MODE, 1) for axis in AXES]
    for request in requests:
        (answer,) = node.process(0, (request,)).frames_out
        assert answer.can_id == 0x580 + NODE and answer.data[0] == 0x60, answer.data.hex()
    node.process(0, (START,))
    return node


@pytest.fixture
def node() -> SimulatedAxes:
    return make_node()


@pytest.fixture
def enabled(node: SimulatedAxes) -> SimulatedAxes:
    for word in ENABLE:
        node.process(0, (command(*[(word, 0)] * 5),))
    assert states(node) == [DriveState.OPERATION_ENABLED] * 5
    return node


def states(node: SimulatedAxes) -> list[DriveState]:
    return [axis.state for axis in node.axes]


def fd_frames(frames: tuple[CanFrame, ...]) -> list[CanFrame]:
    return [frame for frame in frames if frame.fd]


def test_every_axis_has_the_objects_of_the_profile_800h_higher(node: SimulatedAxes) -> None:
    for axis in range(8):
        assert node.slave.read(0x67FF + 0x800 * axis) == 402 | 1 << 18
        assert node.slave.read(0x6076 + 0x800 * axis) == 1900
    assert node.slave.read(0x1000) == 0xFFFF << 16 | 402  # CiA 301: several devices, each with its 67FFh


def test_one_frame_of_64_bytes_has_the_state_of_five_axes(enabled: SimulatedAxes) -> None:
    (frame,) = fd_frames(enabled.process(10, (SYNC,)).frames_out)
    assert (frame.can_id, len(frame.data)) == (0x185, 64)
    for axis in AXES:
        word, position, velocity, torque = struct.unpack_from("<Hiih", frame.data, 12 * axis)
        assert word & 0x6F == 0x27
        assert (position, velocity, torque) == (round(0.1 * axis * 360_000 / 6.283185307), 0, 0)
    assert frame.data[60:] == bytes(4)


def test_each_axis_follows_its_own_controlword_and_torque(enabled: SimulatedAxes) -> None:
    enabled.process(0, (command((0x0F, 100), (0x06, 0), (0x0F, -200), (0x02, 0), (0x00, 0)),))
    enabled.process(50_000, ())
    assert [state.value for state in states(enabled)] == [
        "operation enabled",
        "ready to switch on",
        "operation enabled",
        "quick stop active",
        "switch on disabled",
    ]
    moved = [motor.plant.position_rad - 0.1 * axis for axis, motor in enumerate(enabled.motors)]
    assert moved[0] > 1e-3 and moved[2] < -1e-3 and moved[1] == moved[3] == moved[4] == 0.0


def test_the_torque_limit_of_an_axis_is_its_own(enabled: SimulatedAxes) -> None:
    enabled.process(0, (sdo_write(0x6072 + 2 * 0x800, 0, 50, 2), command(*[(0x0F, 300)] * 5)))
    (frame,) = fd_frames(enabled.process(10, (SYNC,)).frames_out)
    torques = [struct.unpack_from("<h", frame.data, 12 * axis + 10)[0] for axis in AXES]
    assert torques == [300, 300, 50, 300, 300]


def test_a_silent_host_takes_the_torque_of_every_axis_away(enabled: SimulatedAxes) -> None:
    """1400h:05 is 200 ms."""
    enabled.process(0, (command(*[(0x0F, 300)] * 5),))
    enabled.process(199_999, ())
    assert states(enabled) == [DriveState.OPERATION_ENABLED] * 5
    sent = enabled.process(200_000, ()).frames_out
    assert states(enabled) == [DriveState.FAULT] * 5
    emergencies = [frame.data for frame in sent if frame.can_id == 0x80 + NODE]
    assert {data[:2] for data in emergencies} == {b"\x50\x82"}
    assert [enabled.slave.read(0x6077 + 0x800 * axis) for axis in AXES] == [0] * 5
    assert [motor._command.torque_Nm for motor in enabled.motors] == [0.0] * 5


def test_leaving_operational_takes_the_torque_of_every_axis_away(enabled: SimulatedAxes) -> None:
    enabled.process(10, (CanFrame(0x000, bytes([0x80, NODE])),))
    assert states(enabled) == [DriveState.FAULT] * 5


class FaultyMotor:
    rated_torque_mNm = 1900

    def __init__(self, error_code: int = 0) -> None:
        self.error_code = error_code

    def state(self, now_us: int) -> MotorState:  # noqa: ARG002 - has no time of its own
        return MotorState(0.0, 0.0, self.error_code)

    def order(self, now_us: int, command: object) -> None:
        pass

    def reset_fault(self) -> None:
        self.error_code = 0


def test_a_fault_of_one_axis_leaves_the_others_and_is_reset_alone(
    enabled: SimulatedAxes, monkeypatch: pytest.MonkeyPatch
) -> None:
    faulty = FaultyMotor(0x2310)
    monkeypatch.setattr(enabled.axes[3], "_motor", faulty)
    sent = enabled.process(10, (SYNC,)).frames_out
    assert [CanFrame(0x85, b"\x10\x23\x01\x03\0\0\0\0")] == [f for f in sent if f.can_id == 0x85]  # axis 3
    assert states(enabled) == [*[DriveState.OPERATION_ENABLED] * 3, DriveState.FAULT, states(enabled)[0]]
    assert (enabled.slave.read(0x603F + 3 * 0x800), enabled.slave.read(0x603F)) == (0x2310, 0)
    cleared = enabled.process(20, (command((0x0F, 0), (0x0F, 0), (0x0F, 0), (0x80, 0), (0x0F, 0)),))
    assert states(enabled)[3] is DriveState.SWITCH_ON_DISABLED and not faulty.error_code
    assert [f.data[:3] for f in cleared.frames_out if f.can_id == 0x85] == [b"\0\0\0"]


def test_an_axis_without_a_motor_has_no_mode() -> None:
    node = SimulatedAxes(NODE, {1: JointParameters()})
    assert [bool(node.slave.read(0x6502 + 0x800 * axis)) for axis in range(3)] == [False, True, False]
    with pytest.raises(ConfigError, match=r"node 0x05 has no axis 8: give its joints axes from 0 to 7"):
        SimulatedAxes(NODE, {8: JointParameters()})


def test_a_frame_of_another_length_is_no_command(enabled: SimulatedAxes) -> None:
    """Zeros up to a length of CAN FD belong to the frame; more bytes are reported and not used."""
    short = CanFrame(0x205, command(*[(0x00, 0)] * 5).data[:16], fd=True)
    sent = enabled.process(10, (short,)).frames_out
    assert [f.data[:2] for f in sent if f.can_id == 0x85] == [b"\x10\x82"]
    assert states(enabled) == [DriveState.OPERATION_ENABLED] * 5
    longer = CanFrame(0x205, command(*[(0x0F, 0)] * 5).data + bytes(4), fd=True)
    sent = enabled.process(20, (longer,)).frames_out
    assert [f.data[:2] for f in sent if f.can_id == 0x85] == [b"\x20\x82", b"\0\0"]


def test_a_node_that_follows_velocity_maps_60ffh_of_each_axis() -> None:
    """3 axes: 18 bytes and two zeros, which make 20, a length of CAN FD."""
    node = SimulatedAxes(NODE, dict.fromkeys(range(3), JointParameters()))
    words = [word for axis in range(3) for word in objects(axis, (0x6040, 16), (0x60FF, 32))]
    node.process(0, tuple(mapping(0x1400, 0x200 + NODE, words)))
    modes = [sdo_write(0x6060 + 0x800 * axis, 0, OperationMode.CYCLIC_VELOCITY.value, 1) for axis in range(3)]
    node.process(0, (*modes, START))
    for word in ENABLE:
        data = b"".join(struct.pack("<Hi", word, speed) for speed in (0, 10_000, -10_000)) + bytes(2)
        sent = node.process(0, (CanFrame(0x205, data, fd=True),)).frames_out
        assert not [frame for frame in sent if frame.can_id == 0x85]
    for now_us in range(1000, 100_000, 1000):
        node.process(now_us, ())
    moved = [motor.plant.position_rad for motor in node.motors]
    assert abs(moved[0]) < 1e-4 < moved[1] and moved[2] == pytest.approx(-moved[1])
