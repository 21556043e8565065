"""Commands of a console to a fingertip: their refusals."""

from __future__ import annotations

import pytest

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.daemon.watching.watch_messages import WatchedFingertip, WatchRefusedError
from palpate_edge.daemon.watching.watched_fingertip import count_tare
from palpate_edge.node.fingertip import FingertipNode
from palpate_edge.node.fingertip_objects import MethodCode

DOME = WatchedFingertip("finger-1", "paper", 30.0, has_light=False, has_tare=True, pictures="")
TARE = CanFrame(0x610, bytes.fromhex("23 25 61 01") + b"zero")
DONE = bytes.fromhex("60 25 61 01 00 00 00 00")
REFUSED = bytes.fromhex("80 25 61 01 21 00 00 08")


def test_the_tares_of_bus_and_console_have_one_rate() -> None:
    node = FingertipNode(0x10, MethodCode.PAPER, "")
    for _ in range(20):
        count_tare(DOME, node.slave.rates, 0)
    answers = [f.data for f in node.process(0, [TARE] * 25).frames_out if f.can_id == 0x590]
    assert answers == [DONE] * 24 + [REFUSED]
    with pytest.raises(WatchRefusedError, match=r"^too many tares: wait a second$"):
        count_tare(DOME, node.slave.rates, 999_999)
    count_tare(DOME, node.slave.rates, 1_000_000)
