"""Commands to the host core, and what stops the hand, in virtual time on the whole bus."""

import dataclasses
import struct

import msgspec
import numpy as np
import pytest

from palpate_bus.eds.cia402 import DriveState
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_host.common import rotation
from palpate_host.common.command import CommandError, Grasp, Move, Recover, Release, Rotate, Stop
from palpate_host.common.mode import Mode
from palpate_host.config.hand_config import RunConfig, StartMode

TICK_US = 10_000


@pytest.fixture
def waiting(bench, table_4):
    """A hand that waits for commands, READY."""
    config, hand = table_4
    config = msgspec.structs.replace(config, run=RunConfig(start=StartMode.COMMAND))
    rig = bench.VirtualBench(config, hand)
    assert rig.run(1.0).mode is Mode.READY
    return rig


def entered_us(rig, mode):
    return next(status.time_us for status in rig.statuses if status.mode is mode)


def powered(rig):
    return [drive.state for drive in rig.drives if drive.state is DriveState.OPERATION_ENABLED]


def test_it_waits_and_moves_by_commands_alone(waiting):
    assert "command grasp" in waiting.statuses[-1].reason
    assert all(joint.command_Nm == 0.0 for joint in waiting.statuses[-1].joints)
    waiting.core.command(Grasp())
    status = waiting.run(1.0)
    assert status.mode is Mode.GRASP and any(joint.command_Nm != 0.0 for joint in status.joints)
    assert status.R_d is None
    waiting.core.command(Rotate((0.0, 0.0, 5.0), ramp_s=0.2))
    status = waiting.run(0.5)
    assert status.mode is Mode.MANIPULATE and status.target_rpy_deg == (0.0, 0.0, 5.0)
    waiting.core.command(Release())
    assert waiting.run(0.3).mode is Mode.RELEASE
    status = waiting.run(0.5)
    assert status.mode is Mode.READY and all(joint.command_Nm == 0.0 for joint in status.joints)


def test_release_pushes_the_fingers_open(waiting):
    """Positive flexion closes, so the curl joints go back."""
    waiting.core.command(Grasp())
    closed = waiting.run(1.0)
    waiting.core.command(Release())
    opened = waiting.run(0.45)
    for joint in (2, 5, 8):
        assert opened.joints[joint].position_rad < closed.joints[joint].position_rad


def test_turns_add_up_from_where_the_object_was_to_be(waiting):
    waiting.core.command(Grasp())
    waiting.run(1.0)
    waiting.core.command(Rotate((0.0, 0.0, 4.0), ramp_s=0.1))
    first = waiting.run(0.5).R_d
    waiting.core.command(Rotate((0.0, 0.0, 3.0), ramp_s=0.1))
    second = waiting.run(0.5).R_d
    assert rotation.to_rpy_deg(np.array(second) @ np.array(first).T)[2] == pytest.approx(3.0, abs=1e-6)


@pytest.mark.parametrize(
    ("command", "way_out"),
    [(Rotate((0.0, 0.0, 1.0)), "grasp first"), (Recover(), "nothing to recover from")],
)
def test_a_command_out_of_turn_is_refused_and_changes_nothing(waiting, command, way_out):
    with pytest.raises(CommandError, match=way_out) as caught:
        waiting.core.command(command)
    assert "mode ready" in str(caught.value) and "\n" not in str(caught.value)
    assert waiting.run(0.1).mode is Mode.READY


def test_a_move_under_the_papers_law_is_refused_and_is_not_in_the_records(waiting):
    """A recorded command that the host refused would make every replay of the run differ."""
    waiting.core.command(Grasp())
    waiting.run(1.0)
    with pytest.raises(CommandError, match=r"it needs control\.law = 'pose'"):
        waiting.core.command(Move((0.0, 0.0, 5.0)))
    waiting.run(0.1)
    assert [given.event for status in waiting.statuses for given in status.inputs.events] == [Grasp()]


def stop_by_command(rig):
    rig.core.command(Stop())


def stop_by_nmt(rig):
    rig.host_queue.append((rig.now_us + 1, CanFrame(0x000, b"\x02\x00")))


@pytest.mark.parametrize("stop", [stop_by_command, stop_by_nmt])
def test_the_operators_stop_is_one_tick_away_and_recover_leads_back(waiting, stop):
    waiting.core.command(Grasp())
    waiting.run(1.0)
    now_us = waiting.now_us
    stop(waiting)
    status = waiting.run(0.02)
    assert status.mode is Mode.STOP and entered_us(waiting, Mode.STOP) - now_us <= TICK_US + 1000
    with pytest.raises(CommandError, match="recover first"):
        waiting.core.command(Grasp())
    waiting.run(1.0)
    assert not waiting.output.finished and not powered(waiting)
    waiting.core.command(Recover())
    status = waiting.run(1.0)
    assert status.mode is Mode.READY and len(powered(waiting)) == 9
    waiting.core.command(Grasp())
    waiting.run(0.7)
    waiting.core.command(Rotate((0.0, 0.0, 2.0)))
    assert waiting.run(0.2).mode is Mode.MANIPULATE


def test_a_start_from_another_master_stops_nothing(waiting):
    waiting.host_queue.append((waiting.now_us + 1, CanFrame(0x000, b"\x01\x00")))
    waiting.host_queue.append((waiting.now_us + 2, CanFrame(0x000, b"\x02\x33")))
    assert waiting.run(0.1).mode is Mode.READY


def test_sigterm_ends_a_waiting_host_even_after_a_fault(waiting):
    waiting.core.command(Grasp())
    waiting.run(0.7)
    waiting.silent.add(3)
    waiting.run(2.0)
    assert waiting.statuses[-1].mode is Mode.FAULT and not waiting.output.finished
    waiting.core.request_stop()
    waiting.run(0.2)
    assert waiting.output.finished and "curl_1" in waiting.output.failure
    assert [f.data[:1] for _, f in waiting.log[-12:] if f.can_id == 0] == [b"\x02"] * 12


def test_a_lost_drive_comes_back_by_recover_alone(waiting):
    """Its heartbeat stops: a fault. It speaks again: nothing moves. Recover: all nine are enabled."""
    waiting.core.command(Grasp())
    waiting.run(0.7)
    waiting.silent.add(3)
    assert waiting.run(1.5).mode is Mode.FAULT
    waiting.silent.clear()
    assert waiting.run(1.0).mode is Mode.FAULT and not powered(waiting)
    waiting.core.command(Recover())
    status = waiting.run(2.0)
    assert status.mode is Mode.READY and len(powered(waiting)) == 9


def test_too_much_force_on_one_fingertip_is_a_fault(bench, table_4):
    """20.1 N where 20 N is allowed; 19.9 N is not. One tick after the frame that tells."""
    pressing_N = 19.9

    class Pressed(bench.VirtualBench):
        def _feel_and_publish(self, now_us):
            make = bench.contact_at
            bench.contact_at = lambda *a: dataclasses.replace(make(*a), normal_force_N=pressing_N)
            try:
                super()._feel_and_publish(now_us)
            finally:
                bench.contact_at = make

    rig = Pressed(*table_4)
    assert rig.run(1.5).mode is Mode.MANIPULATE
    pressing_N, began_us = 20.1, rig.now_us
    status = rig.run(1.0)
    assert status.mode is Mode.FAULT and "contact force 20.1 N, limits.contact_force_N is 20" in status.reason
    assert entered_us(rig, Mode.FAULT) - began_us <= bench.FRAME_PERIOD_US + TICK_US + 1000


def test_a_joint_that_runs_away_is_a_fault(bench, table_4):
    rig = bench.VirtualBench(*table_4)
    rig.run(1.5)
    rig.drives[4].plant.velocity_rad_s = 60.0
    status = rig.run(0.1)
    assert status.mode is Mode.FAULT and status.reason.startswith("flexion_2: ")
    assert status.reason.endswith("limits.joint_speed_rad_s is 20")


def test_a_drive_that_reports_more_torque_than_its_limit_is_a_fault(bench, table_4):
    """6077h of curl_1 says 0.76 N m (400 per mille of 1.9); torque_limit_Nm is 0.5, the fault is at 0.75."""

    def lie(stamp_us, frame):
        if frame.can_id == 0x283 and stamp_us > bench.START_US + 1_500_000:
            return [(stamp_us, CanFrame(0x283, frame.data[:-2] + (400).to_bytes(2, "little")))]
        return [(stamp_us, frame)]

    rig = bench.VirtualBench(*table_4, to_host=lie)
    status = rig.run(2.0)
    assert status.mode is Mode.FAULT
    assert status.reason == "curl_1: its drive reports 0.76 N m, torque_limit_Nm is 0.5"


def said_by(rig, node_id, code, register):
    """An emergency of CiA 301 from this node, on its way to the host."""
    rig.host_queue.append((rig.now_us + 1, CanFrame(0x080 + node_id, struct.pack("<HB5x", code, register))))


def test_a_fingertip_without_calibration_keeps_the_host_in_check(bench, table_4):
    """It says so itself after its boot-up, and again after each reset."""
    config, hand = table_4
    rig = bench.VirtualBench(msgspec.structs.replace(config, run=RunConfig(start=StartMode.COMMAND)), hand)

    def with_emergency(stamp_us, frame):
        yield stamp_us, frame
        if frame.can_id == 0x711 and frame.data == b"\0":
            yield stamp_us + 1, CanFrame(0x091, struct.pack("<HB5x", 0xFF07, 0x81))

    rig.to_host = with_emergency
    status = rig.run(1.0)
    assert status.mode is Mode.CHECK
    assert status.reason == "waiting for a calibration of finger-2 (palpate-edge calibrate)"
    assert not powered(rig)
    rig.to_host = lambda stamp_us, frame: [(stamp_us, frame)]
    rig.core.command(Stop())
    rig.run(1.0)
    rig.core.command(Recover())
    assert rig.run(1.0).mode is Mode.READY


@pytest.mark.parametrize("code", [0x4000, 0x4210, 0x4310, 0x4FFF])
def test_a_drive_beyond_its_temperature_is_a_fault_before_it_moves_too(waiting, code):
    said_by(waiting, 3, code, 0x09)
    status = waiting.run(0.02)
    assert status.mode is Mode.FAULT
    assert status.reason == (
        f"drive of curl_1 (node 0x03): temperature beyond its limit (EMCY {code:04X}h):"
        " let it cool, then recover"
    )


@pytest.mark.parametrize(
    ("node_id", "code"),
    [(3, 0x3FFF), (3, 0x5000), (3, 0x0000), (0x11, 0x4200), (0x11, 0x4310)],
    ids=["voltage", "hardware", "error reset", "a fingertip's LED", "a fingertip"],
)
def test_other_emergencies_are_told_and_the_hand_goes_on(waiting, node_id, code):
    waiting.core.command(Grasp())
    waiting.run(0.7)
    said_by(waiting, node_id, code, 0x09)
    status = waiting.run(0.1)
    assert status.mode is Mode.GRASP
    assert status.last_emergency.endswith(f"(node 0x{node_id:02X}): EMCY {code:04X}h")
