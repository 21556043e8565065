"""Two CAN cards (SJA1000 behind PCI) on one cable: a driver with a bit rate, a queue and a controller."""

from __future__ import annotations

import json
import subprocess
import threading

import pytest

from kernel_guest.links import PATIENCE_S, receive
from palpate_edge.can_bus.bus import BusConfig, open_bus
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.errors import BusError

pytestmark = pytest.mark.vm


def opened(link):
    return open_bus(BusConfig(interface="socketcan", channel=link.name), "finger-1")


def test_frames_cross_the_cable(can_cards):
    with opened(can_cards[0]) as ours, opened(can_cards[1]) as stranger:
        frames = [CanFrame(0x190, bytes(range(8))), CanFrame(0x701, remote=True)]
        ours.send(frames)
        assert receive(stranger, 2) == frames


def test_a_flood_through_the_default_queue_loses_and_repeats_nothing(can_cards):
    """The driver's queue holds ten frames; 600 go through it at once."""
    (answer,) = json.loads(subprocess.check_output(["ip", "-json", "link", "show", "can0"]))
    assert answer["txqlen"] == 10
    frames = [CanFrame(0x180 + number % 64, number.to_bytes(8, "big")) for number in range(600)]
    with opened(can_cards[0]) as ours, opened(can_cards[1]) as stranger:
        sender = threading.Thread(target=ours.send, args=(frames,))
        sender.start()
        assert receive(stranger, len(frames)) == frames
        sender.join()


def test_a_card_that_goes_down_is_an_error_and_serves_again_when_up(can_cards):
    with opened(can_cards[0]) as bus:
        can_cards[0].down()
        with pytest.raises(BusError, match="cannot receive"):
            bus.receive(PATIENCE_S)
    can_cards[0].up()
    with opened(can_cards[0]) as bus, opened(can_cards[1]) as stranger:
        stranger.send([CanFrame(0x80)])
        assert receive(bus, 1) == [CanFrame(0x80)]
