"""The fingertip as a node: a slave of ``fingertip.eds`` that publishes contacts and the board's health."""

from __future__ import annotations

import hashlib
from bisect import bisect_right
from collections.abc import Sequence

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.can_bus.clock_sync import ClockState
from palpate_edge.common.contact import Contact
from palpate_edge.common.contact_quantities import (
    AI_AUTOZERO,
    CONTACT_TPDOS,
    FD_TPDO,
    POSE_TPDOS,
    SensorOutputs,
)
from palpate_edge.node.eds import load_eds
from palpate_edge.node.fd_bus import on_fd_bus
from palpate_edge.node.fingertip_objects import (
    CALIBRATION_HASH,
    COUNTERS,
    DATA_BITRATE,
    DOME_OUTPUTS,
    EXPOSURE_TIME,
    LATENCY_BINS_US,
    LATENCY_HISTOGRAM,
    LED_SET_POINT,
    LOCATION,
    METHOD,
    MODEL_HASH,
    NEVER_GIVEN,
    SEQUENCE,
    UINT16_MAX,
    UINT32_MAX,
    Counter,
    Health,
    MethodCode,
    encode_bus_clock,
    encode_contact,
    encode_health,
    never_given_flags,
)
from palpate_edge.node.object_dictionary import Entry, Value
from palpate_edge.node.parsed_eds import FINGERTIP_EDS
from palpate_edge.node.pdo_parameters import with_tpdos_enabled
from palpate_edge.node.sdo_abort import AbortCode, SdoAbortError
from palpate_edge.node.slave import Slave, SlaveOutput
from palpate_edge.node.stored_parameters import NOTHING_STORED, StoredParameters, without_storage

AUTOZERO_SIGNATURE = int.from_bytes(b"zero", "little")
TARE_IN_CONTACT_SIGNATURE = int.from_bytes(b"ZERO", "little")
"""Values of 6125h. The second one tares in spite of a contact: a dent that remains when nothing touches."""
HASH_DIGITS = 16
LOCATION_CHARACTERS = 64
SOFTWARE_VERSION, SERIAL_NUMBER = (0x100A, 0), (0x1018, 4)


class FingertipNode:
    """CANopen node of one fingertip.

    The application has to act on two ObjectWritten events: tare at 6125h (CiA 404, AI autozero), set the LED
    level at 2030h.
    """

    def __init__(
        self,
        node_id: int,
        method: MethodCode,
        calibration_hash: str,
        *,
        model_hash: str = "",
        serial_number: int = 0,
        kept: StoredParameters = NOTHING_STORED,
        stores: bool = True,
        has_led: bool = False,
        outputs: SensorOutputs = DOME_OUTPUTS,
        data_bitrate: int | None = None,
    ) -> None:
        """Make the node. Raises ConfigError when `node_id` is not in 1..127 or 255 (id by LSS).

        kept: stored parameters; a node id in it takes precedence over `node_id`. stores: whether the
        application can store parameters; a master reads it in 1010h. has_led: whether an LED
        controller exists; without one, writes to 2030h are rejected. outputs: what the calibration gives;
        with poses, their TPDOs are enabled. data_bitrate: bit/s of the data phase of CAN FD frames; a contact
        is then one CAN FD frame. None on a classic bus.
        """
        od = load_eds(FINGERTIP_EDS, node_id)
        if data_bitrate is not None:
            od = on_fd_bus(od, poses=outputs.pose)
        elif outputs.pose:
            od = with_tpdos_enabled(od, POSE_TPDOS)
        if not stores:
            od = without_storage(od)
        self._is_touched = False
        software = od.entry(*SOFTWARE_VERSION).default
        constants = repr((software, method, calibration_hash, model_hash, serial_number, outputs))
        constants += f" {data_bitrate}" if data_bitrate else ""
        device = hashlib.sha256(constants.encode()).hexdigest()[:HASH_DIGITS]
        self.slave = Slave(od, self._check_write, kept.on_device(device))
        self._has_led = has_led
        self._outputs = outputs
        self.slave.write(METHOD, 0, int(method))
        self.slave.write(NEVER_GIVEN, 0, never_given_flags(outputs))
        self.slave.write(DATA_BITRATE, 0, data_bitrate or 0)
        self.slave.write(CALIBRATION_HASH, 0, calibration_hash[:HASH_DIGITS])
        self.slave.write(MODEL_HASH, 0, model_hash[:HASH_DIGITS])
        self.slave.write(*SERIAL_NUMBER, serial_number)
        self._uncounted: list[tuple[bool, int]] = []  # valid, latency_us

    @property
    def led_set_point(self) -> int:
        """The LED level in 2030h."""
        return int(self.slave.read(LED_SET_POINT))

    def set_led(self, level: int) -> None:
        """Set 2030h, 0 (off) to 255, as a master's write does."""
        self.slave.write(LED_SET_POINT, 0, level)

    def process(
        self, now_us: int, frames_in: Sequence[CanFrame], arrived_us: Sequence[int] | None = None
    ) -> SlaveOutput:
        """Count the published contacts, then process frames and timers as :meth:`Slave.process`."""
        self._count()
        return self.slave.process(now_us, frames_in, arrived_us)

    def publish(
        self, contact: Contact, latency_us: int, *, sequence: int | None = None, exposed_us: int | None = None
    ) -> None:
        """Set a contact's objects and trigger its TPDOs: see :meth:`Slave.due_tpdos`.

        The next `process` counts it in 2040h and 2041h. sequence, exposed_us: values for the bus; None: those
        of the contact. latency_us: from the exposure until now.
        """
        if contact.valid:
            self._is_touched = contact.in_contact
        objects = encode_contact(contact, latency_us, self._outputs)
        if sequence is not None:
            objects[SEQUENCE, 0] = sequence & UINT16_MAX
        if exposed_us is not None:
            objects[EXPOSURE_TIME, 0] = exposed_us & UINT32_MAX
        self.slave.write_all(objects)
        self.slave.trigger((*CONTACT_TPDOS, FD_TPDO))  # those that are enabled
        self._uncounted.append((contact.valid, latency_us))

    def _count(self) -> None:
        for valid, latency_us in self._uncounted:
            for index, subindex in (
                (COUNTERS, Counter.FRAMES_ESTIMATED if valid else Counter.FRAMES_REFUSED),
                (LATENCY_HISTOGRAM, 1 + bisect_right(LATENCY_BINS_US, latency_us)),
            ):
                count = int(self.slave.read(index, subindex)) + 1
                self.slave.write(index, subindex, count & UINT32_MAX)
        self._uncounted.clear()

    def report_health(self, health: Health) -> None:
        """Set the objects of TPDO 4, which its event timer sends."""
        self.slave.write_all(encode_health(health))

    def report_bus_clock(self, state: ClockState, drift_ppb: float, standard_error_us: float) -> None:
        """Set the objects of the bus clock, 2042h."""
        self.slave.write_all(encode_bus_clock(state, drift_ppb, standard_error_us))

    def _check_write(self, entry: Entry, value: Value) -> None:
        """Raise SdoAbortError for an invalid write to one of the fingertip's own objects.

        The location has at most 64 characters; the LED level needs an LED controller.
        """
        if entry.index == AI_AUTOZERO:
            self._check_tare(value)
        if entry.index == LOCATION and len(str(value)) > LOCATION_CHARACTERS:
            raise SdoAbortError(AbortCode.TOO_LONG)
        if entry.index == LED_SET_POINT and not self._has_led:
            raise SdoAbortError(AbortCode.DEVICE_STATE)

    def _check_tare(self, value: Value) -> None:
        """Raise SdoAbortError for a value that is no signature, and for a tare that would hide a contact.

        The last valid frame decides whether there is one. A pose sensor has no tare: its rest is part of what
        it learned.
        """
        if value not in (AUTOZERO_SIGNATURE, TARE_IN_CONTACT_SIGNATURE):
            raise SdoAbortError(AbortCode.NOT_STORED)
        if not self._outputs.place or (self._is_touched and value == AUTOZERO_SIGNATURE):
            raise SdoAbortError(AbortCode.DEVICE_STATE)
