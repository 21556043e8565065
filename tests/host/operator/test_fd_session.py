"""A hand on a CAN FD hub, each part a process: its contacts are CAN FD frames, and all else is classic.

Where a finger's drives are axes of one node, its frames are CAN FD frames too.
"""

from __future__ import annotations

import sys

import pytest
from tests.host.axes_hand import axes_text
from tests.host.hand_on_hub import PATIENCE_S, TIPS, Running, patient_hand, put_on_the_bus

from palpate_bus.logs.candump import read_log
from palpate_host import Hand
from palpate_host.common.command import CommandError
from palpate_host.common.mode import Mode

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("real_time")]

CAN_FD = "data_bitrate = 5_000_000"
TPDO_10 = 0x400
HUB = ("--data-bitrate", "5000000", "--txqueuelen", "1000")  # a queue for a machine that others share


@pytest.fixture
def running():
    made = Running()
    yield made
    made.stop()


@pytest.fixture
def config(tmp_path):
    """Table 4's hand on a CAN FD hub."""
    return patient_hand(tmp_path, CAN_FD)


def test_the_host_takes_contacts_from_can_fd_frames(config, tmp_path, running):
    put_on_the_bus(running, config, *HUB, "--log", tmp_path / "bus.log")
    with Hand.open(config, tmp_path / "s", timeout_s=PATIENCE_S) as hand:
        status = hand.wait_for(
            lambda status: all(finger.complete > 20 for finger in status.fingers), PATIENCE_S, "touch"
        )
        assert {finger.incomplete + finger.extra_missing for finger in status.fingers} == {0}
    running.stop()
    frames = [record.frame for record in read_log(tmp_path / "bus.log").records]
    assert {(frame.can_id, len(frame.data)) for frame in frames if frame.fd} == {
        (TPDO_10 + node, 32) for node in (0x10, 0x11, 0x12)
    }


def test_axes_of_three_nodes_grasp_and_turn(config, tmp_path, running):
    """Drives, fingertips and host are processes; the frames of each node hold its three axes."""
    config.write_text(axes_text(config.read_text().replace(CAN_FD, "")))
    put_on_the_bus(running, config, *HUB, "--log", tmp_path / "bus.log")
    with Hand.open(config, tmp_path / "s", timeout_s=PATIENCE_S) as hand:
        assert hand.grasp(PATIENCE_S).mode is Mode.GRASP
        status = hand.rotate((0.0, 0.0, 5.0), ramp_s=0.3)
        assert status.mode is Mode.MANIPULATE
        assert {joint.drive_state for joint in status.joints} == {"operation enabled"}
    running.stop()
    pdos = [record.frame for record in read_log(tmp_path / "bus.log").records]
    pdos = [frame for frame in pdos if frame.can_id in range(0x180, 0x400) and frame.can_id & 0x7F < 0x10]
    assert {(frame.can_id, len(frame.data), frame.fd) for frame in pdos} == {
        part for node in (1, 2, 3) for part in ((0x180 + node, 48, True), (0x200 + node, 12, True))
    }


def test_fingertips_of_a_classic_bus_are_named_with_the_key_to_set(config, tmp_path, running):
    """They are on the same hub, whose classic frames reach them, so the host reads 2005h and finds 0."""
    put_on_the_bus(running, config, *HUB)
    running.kill("fingertips")
    classic = tmp_path / "classic.toml"
    classic.write_text(config.read_text().replace(CAN_FD, ""))
    running.start("fingertips", sys.executable, TIPS, classic, until="on the bus")
    reason = r"\(check: .*2005h:00 is 0x0, .*set bus\.data_bitrate to 5000000 in its finger\.toml"
    with pytest.raises(CommandError, match=reason):
        Hand.open(config, tmp_path / "s", timeout_s=15)
