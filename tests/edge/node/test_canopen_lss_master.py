"""A foreign LSS master, the `canopen` package's, gives ten fingertips their node ids."""

from __future__ import annotations

import random
import types
from collections.abc import Callable, Iterable

import canopen
import canopen.lss
import pytest

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.node.events import StoreRequested
from palpate_edge.node.fingertip import FingertipNode
from palpate_edge.node.fingertip_objects import MethodCode
from palpate_edge.node.object_dictionary import UNCONFIGURED_NODE_ID
from palpate_edge.node.parsed_eds import FINGERTIP_EDS
from palpate_edge.node.slave import SlaveOutput

NODES = 10
UNANSWERED_S = 1.0


class UnnamedFingertip:
    """A fingertip without a node id that stores what LSS tells it."""

    def __init__(self, serial_number: int, node_id: int = UNCONFIGURED_NODE_ID) -> None:
        self.node = FingertipNode(node_id, MethodCode.PAPER, "", serial_number=serial_number)
        self.stored_node_id: int | None = None

    def process(self, now_us: int, frames: tuple[CanFrame, ...]) -> SlaveOutput:
        output = self.node.process(now_us, frames)
        for event in output.events:
            if isinstance(event, StoreRequested):
                self.stored_node_id = event.parameters.node_id
                self.node.slave.store_finished(True)
        return output


class DirectBus:
    """A master whose requests the nodes have answered before it waits: silence costs no time.

    What several nodes say at once and alike is one frame, as it is on a wire.
    """

    def __init__(self, fingertips: Iterable[UnnamedFingertip]) -> None:
        self.network = canopen.Network()
        self.network.send_message = self._send  # type: ignore[method-assign]
        self.network.lss.RESPONSE_TIMEOUT = 1e-6
        self._fingertips = list(fingertips)
        self._now_us = 0

    def _send(self, can_id: int, data: bytes, remote: bool = False) -> None:
        self._now_us += 1_000
        request = (CanFrame(can_id, bytes(data), remote),)
        answers = [
            answer
            for frames in (request, ())  # what is stored is answered by the second call
            for fingertip in self._fingertips
            for answer in fingertip.process(self._now_us, frames).frames_out
        ]
        for answer in dict.fromkeys(answers):
            self.network.notify(answer.can_id, bytearray(answer.data), self._now_us / 1e6)


@pytest.fixture(autouse=True)
def no_pauses(monkeypatch: pytest.MonkeyPatch) -> None:
    """The master pauses for slow devices after every request; ours are not."""
    monkeypatch.setattr(canopen.lss, "time", types.SimpleNamespace(sleep=lambda _seconds: None))


def test_fastscan_with_ten_unconfigured_nodes() -> None:
    serials = random.Random(404).sample(range(2**32), NODES)
    fingertips = {serial: UnnamedFingertip(serial) for serial in serials}
    network = DirectBus(fingertips.values()).network
    found = []
    for node_id in range(0x10, 0x10 + NODES):
        seen, identity = network.lss.fast_scan()
        assert seen
        assert identity[:3] == [0, 0x404, 0x10000]
        found.append(identity[3])
        assert network.lss.inquire_node_id() == UNCONFIGURED_NODE_ID
        network.lss.configure_node_id(node_id)
        network.lss.store_configuration()
        network.lss.send_switch_state_global(network.lss.WAITING_STATE)
        fingertip = fingertips[identity[3]]
        assert (fingertip.stored_node_id, fingertip.node.slave.node_id) == (node_id, node_id)
    assert network.lss.fast_scan() == (False, None)
    assert found == sorted(serials)
    for node_id, serial in enumerate(found, 0x10):
        node = network.add_node(canopen.RemoteNode(node_id, str(FINGERTIP_EDS)))
        assert node.sdo[0x1018][4].raw == serial


@pytest.mark.long
def test_a_node_is_selected_by_its_identity_and_moved(
    canopen_master: Callable, boots_after: Callable
) -> None:
    fingertips = [UnnamedFingertip(7, 0x10), UnnamedFingertip(8, 0x11)]
    with canopen_master(*(fingertip.process for fingertip in fingertips)) as network:
        network.lss.RESPONSE_TIMEOUT = UNANSWERED_S
        with pytest.raises(canopen.lss.LssError):
            network.lss.send_switch_state_selective(0, 0x404, 0x10000, 9)
        assert network.lss.send_switch_state_selective(0, 0x404, 0x10000, 8)
        assert network.lss.inquire_lss_address(canopen.lss.CS_INQUIRE_SERIAL_NUMBER) == 8
        assert network.lss.inquire_node_id() == 0x11
        network.lss.configure_node_id(0x1F)
        with pytest.raises(canopen.lss.LssError, match="1"):
            network.lss.configure_bit_timing(2)  # the link sets the bit rate
        network.lss.send_switch_state_global(network.lss.WAITING_STATE)
        assert boots_after(network, 0x82, 0x1F)
        assert [fingertip.node.slave.node_id for fingertip in fingertips] == [0x10, 0x1F]
