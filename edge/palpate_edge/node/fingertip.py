"""The fingertip as a node: a slave of ``fingertip.eds`` that publishes contacts and the board's health."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from palpate_edge.can_frame import CanFrame
from palpate_edge.contact_type import Contact
from palpate_edge.node.fingertip_objects import (
    AI_AUTOZERO,
    CALIBRATION_HASH,
    METHOD,
    Health,
    Method,
    encode_contact,
    encode_health,
)
from palpate_edge.node.object_dictionary import FINGERTIP_EDS, Entry, ObjectKey, Value, load_eds
from palpate_edge.node.sdo_abort import AbortCode, SdoAbortError
from palpate_edge.node.slave import Output, Slave

CONTACT_TPDOS = (1, 2, 3)
AUTOZERO_SIGNATURE = int.from_bytes(b"zero", "little")
CALIBRATION_HASH_DIGITS = 16


class FingertipNode:
    """The slave of one fingertip.

    An ObjectWritten event for 6125h in its output asks the application to tare (CiA 404, AI autozero).
    """

    def __init__(self, node_id: int, method: Method, calibration_hash: str) -> None:
        """Raises ConfigError when `node_id` is not in 1..127."""
        self.slave = Slave(load_eds(FINGERTIP_EDS, node_id), check_write)
        self.slave.write(METHOD, 0, int(method))
        self.slave.write(CALIBRATION_HASH, 0, calibration_hash[:CALIBRATION_HASH_DIGITS])

    def process(self, now_us: int, frames_in: Sequence[CanFrame]) -> Output:
        """See :meth:`Slave.process`."""
        return self.slave.process(now_us, frames_in)

    def publish(self, contact: Contact, latency_us: int) -> None:
        """Have TPDO 1 to 3 sent by the next :meth:`process`; see :func:`encode_contact` for the clocks."""
        self._write(encode_contact(contact, latency_us))
        self.slave.trigger(CONTACT_TPDOS)

    def report_health(self, health: Health) -> None:
        """Set what TPDO 4 sends when its event timer asks."""
        self._write(encode_health(health))

    def _write(self, objects: Mapping[ObjectKey, int]) -> None:
        for (index, subindex), value in objects.items():
            self.slave.write(index, subindex, value)


def check_write(entry: Entry, value: Value) -> None:
    """Autozero takes its signature only."""
    if entry.index == AI_AUTOZERO and value != AUTOZERO_SIGNATURE:
        raise SdoAbortError(AbortCode.NOT_STORED)
