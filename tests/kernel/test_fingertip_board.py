"""The whole board: the daemon with a V4L2 camera and a CAN card, both of which are lost and found again."""

from __future__ import annotations

from contextlib import contextmanager

import pytest

from kernel_guest.cameras import v4l2_ctl
from kernel_guest.links import receive
from palpate_edge.can_bus.bus import BusConfig, open_bus
from palpate_edge.can_bus.can_frame import CanFrame

pytestmark = pytest.mark.vm


@contextmanager
def host_on(link):
    with open_bus(BusConfig(interface="socketcan", channel=link.name), "host") as bus:
        yield bus


def emergency(bus):
    """Return the error code of the next EMCY."""
    while True:
        for frame in receive(bus, 1):
            if frame.can_id == 0x090:
                return int.from_bytes(frame.data[:2], "little")


def test_what_is_pulled_out_is_told_and_comes_back(
    camera, can_cards, run_fingertip, vga_calibration, wait_until
):
    """vivid shows its test picture and no beads: every frame is rejected, and the daemon logs the reason."""
    capture = f'source = "v4l2"\npath = "{camera}"\ntimeout_ms = 2000\n'
    ours, hosts = can_cards
    with host_on(hosts) as host:
        fingertip = run_fingertip(ours.name, capture, vga_calibration)
        wait_until(lambda: CanFrame(0x710, b"\x7f") in receive(host, 1))
        host.send([CanFrame(0x000, b"\x01\x10")])
        wait_until(lambda: emergency(host) == 0xFF03)  # beads lost
        contact = next(frame for frame in iter(lambda: receive(host, 1)[-1], None) if frame.can_id == 0x290)
        assert contact.data[6] & 0x04 == 0, "not valid"
        v4l2_ctl(camera, "-c", "disconnect=1")
        wait_until(lambda: emergency(host) == 0xFF01)  # camera lost
        wait_until(lambda: "camera gives frames again" in fingertip.said())
    ours.down()
    wait_until(lambda: "bus is down" in fingertip.said())
    ours.up()
    with host_on(hosts) as host:
        wait_until(lambda: 0x390 in {frame.can_id for frame in receive(host, 1)})
    wait_until(lambda: fingertip.health().bus.restarts == 1)
    assert fingertip.health().camera.source == str(camera)
    assert fingertip.stop() == 0
