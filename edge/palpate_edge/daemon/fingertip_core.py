"""The fingertip without threads, sockets and clock: bus frames, contacts and failures in, bus frames out.

The core connects the node, the bus clock and the frame monitor, and raises the emergencies. A contact on the
bus is valid only while frames come: when a deadline passes, it is withdrawn.
"""

from __future__ import annotations

from collections.abc import Sequence

import msgspec

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.can_bus.clock_sync import BusClock, ClockState
from palpate_edge.can_bus.reconnecting_bus import BusState, BusStateChange, Stamped
from palpate_edge.common.contact import Contact, refused_contact
from palpate_edge.common.errors import CameraStalledError, CaptureError
from palpate_edge.daemon.frame_monitor import FrameMonitor
from palpate_edge.node.emergencies import ActiveEmergencies, Emergency
from palpate_edge.node.events import (
    Event,
    NmtStateChanged,
    NodeIdConflict,
    SyncReceived,
    TimeStampReceived,
)
from palpate_edge.node.fingertip import FingertipNode
from palpate_edge.node.fingertip_objects import LATENCY_HISTOGRAM, Health
from palpate_edge.node.id_conflict import QUIET_US, IdConflict
from palpate_edge.node.nmt import NmtCommand, NmtState
from palpate_edge.node.slave import SlaveOutput

REPORT_EVERY_US = 1_000_000  # 2042h
OVERRUN_CLEARS_AFTER_US = 1_000_000  # without another lost frame, EMCY 8110h is cleared
RESETS = frozenset({NmtCommand.RESET_NODE, NmtCommand.RESET_COMMUNICATION})


class CoreStep(msgspec.Struct, frozen=True):
    """The result of `poll`. frames_out: to send, in order; next_due_us: the latest time of the next `poll`;
    events: of the node, for the caller to handle."""

    frames_out: tuple[CanFrame, ...]
    next_due_us: int
    events: tuple[Event, ...]


class FingertipCore:
    """The core of one fingertip. All times are local microseconds (LocalClock); only `clock` handles bus
    times. is_calibrated: False reports an emergency, and no overruns: the search for blobs drops frames."""

    def __init__(
        self, node: FingertipNode, timeout_us: int, now_us: int, *, is_calibrated: bool = True
    ) -> None:
        self.clock = BusClock()
        self.monitor = FrameMonitor(timeout_us, now_us)
        self.emergencies = ActiveEmergencies(node.slave.emcy)
        self.emergencies.set(Emergency.NO_CALIBRATION, not is_calibrated)
        self.conflict = IdConflict()
        self._is_calibrated = is_calibrated
        self._node = node
        self._frames_out: list[CanFrame] = []
        self._events: list[Event] = []
        self._withdrawn = True  # nothing valid is on the bus yet
        self._capture_failed = False
        self._sequence = 0
        self._withdrawals = 0  # each uses a sequence number
        self._report_at_us = now_us
        self._overruns = 0
        self._overrun_clears_at_us = 0
        self._now_us = now_us
        self._node_id = node.slave.node_id
        self._is_held = False

    @property
    def conflict_problem(self) -> str:
        """Text about another node with this node's id; empty when there is none."""
        if not self.conflict.is_active:
            return ""
        return (
            f"node id 0x{self._node_id:02X} is used twice: a frame "
            f"0x{self.conflict.can_id:03X} came from another node, so no contacts are sent until "
            f"{QUIET_US / 1e6:.1f} s after its last one; give one of them another [node] id"
        )

    @property
    def state(self) -> NmtState:
        """The node's NMT state."""
        return self._node.slave.state

    def latencies(self) -> list[int]:
        """Return 2040h: frames by their latency, from exposure to publication."""
        return [int(self._node.slave.read(LATENCY_HISTOGRAM, 1 + bin_)) for bin_ in range(8)]

    def receive(self, now_us: int, frames: Sequence[Stamped]) -> None:
        """Process bus frames with their local arrival times."""
        self._now_us = now_us
        arrived_us = [stamp_us for stamp_us, _ in frames]
        self._take(self._node.process(now_us, [frame for _, frame in frames], arrived_us))

    def contact(self, now_us: int, contact: Contact) -> tuple[CanFrame, ...]:
        """Publish the contact of a frame: return its TPDOs, to be sent before anything else."""
        self._sequence = contact.sequence
        self._withdrawn = not contact.valid
        return self._publish(now_us, contact)

    def frame_seen(self, now_us: int, contact: Contact, health: Health) -> None:
        """Update the state of camera and beads after a contact was sent, and report the board's health."""
        self.monitor.frame_estimated(now_us, contact, health.frames_dropped)
        self._capture_failed = False
        self.emergencies.set(Emergency.CAMERA_LOST, False)
        self.emergencies.set(Emergency.CAMERA_STALLED, False)
        self.emergencies.set(Emergency.BEADS_LOST, self.monitor.beads_are_lost(now_us))
        self.emergencies.set(Emergency.OVERRUN, self._is_calibrated and self.monitor.overruns())
        self._node.report_health(health)

    def report_health(self, health: Health) -> None:
        """Set the board's health on the bus, also while no frame comes."""
        self._node.report_health(health)

    def capture_failed(self, now_us: int, error: CaptureError) -> None:
        """Report that the source has failed, before another attempt or before the daemon ends."""
        self._capture_failed = True
        stalled = isinstance(error, CameraStalledError)
        self.emergencies.set(Emergency.CAMERA_LOST, not stalled)
        self.emergencies.set(Emergency.CAMERA_STALLED, stalled)
        self._withdraw(now_us, str(error))

    def stop(self, now_us: int) -> None:
        """Withdraw the contact before the daemon ends."""
        self._withdraw(now_us, "the fingertip is stopped", last=True)

    def bus_state_changed(self, change: BusStateChange) -> None:
        """Apply 1029h after a bus-off; by default the node enters PRE-OPERATIONAL and waits for a start."""
        if change.state is BusState.UP and change.after_bus_off:
            self._node.slave.communication_error(Emergency.BUS_OFF_RECOVERED)
            self._node.slave.emcy.clear(Emergency.BUS_OFF_RECOVERED)

    def receive_overruns(self, now_us: int, count: int) -> None:
        """Report EMCY 8110h when the count of receive overruns has grown. count: since the start.

        The emergency is cleared after OVERRUN_CLEARS_AFTER_US without another overrun.
        """
        if count > self._overruns:
            self._overrun_clears_at_us = now_us + OVERRUN_CLEARS_AFTER_US
            self.emergencies.set(Emergency.RECEIVE_OVERRUN, True)
        self._overruns = count

    def error_passive(self, passive: bool) -> None:
        """Report whether the CAN controller is error passive."""
        self.emergencies.set(Emergency.ERROR_PASSIVE, passive)

    def light(self, *, lost: bool, too_hot: bool) -> None:
        """Report the state of the illumination controller."""
        self.emergencies.set(Emergency.LIGHT_LOST, lost)
        self.emergencies.set(Emergency.LED_TOO_HOT, too_hot)

    def poll(self, now_us: int) -> CoreStep:
        """Process the deadlines that have passed; return the frames to send and the node's events."""
        if self.monitor.is_stalled(now_us) and not self._capture_failed:
            self.emergencies.set(Emergency.CAMERA_STALLED, True)
            self._withdraw(now_us, "no frame in time: the camera stalls")
        self._now_us = now_us
        if now_us >= self._overrun_clears_at_us:
            self.emergencies.set(Emergency.RECEIVE_OVERRUN, False)
        self.conflict.poll(now_us)
        self._apply_conflict()
        self.emergencies.set(Emergency.CLOCK_LOST, self.clock.state(now_us) is ClockState.LOST)
        if now_us >= self._report_at_us:
            self._report_at_us = now_us + REPORT_EVERY_US
            self._report_clock(now_us)
        output = self._node.process(now_us, [])
        self._take(output)
        due_us = min(output.next_due_us, self._report_at_us)
        if self.conflict.due_us is not None:
            due_us = min(due_us, self.conflict.due_us)
        if not self._withdrawn:
            due_us = min(due_us, self.monitor.stalls_at_us)
        if now_us < self._overrun_clears_at_us:
            due_us = min(due_us, self._overrun_clears_at_us)
        step = CoreStep(tuple(self._frames_out), due_us, tuple(self._events))
        self._frames_out.clear()
        self._events.clear()
        return step

    def _withdraw(self, now_us: int, reason: str, *, last: bool = False) -> None:
        """Publish a contact that is not valid, once. last: no TPDO follows, so no inhibit time is kept."""
        if not self._withdrawn:
            self._withdrawn = True
            self._withdrawals += 1
            refused = refused_contact(self._sequence, now_us, reason, 0, 0)
            self._frames_out += self._publish(now_us, refused, last=last)

    def _publish(self, now_us: int, contact: Contact, *, last: bool = False) -> tuple[CanFrame, ...]:
        """Publish with the exposure on the bus clock; each withdrawal counts as a frame."""
        self._node.publish(
            contact,
            now_us - contact.exposed_at_us,
            sequence=contact.sequence + self._withdrawals,
            exposed_us=self.clock.to_bus_us(contact.exposed_at_us),
        )
        return self._node.slave.due_tpdos(now_us, last=last)

    def _report_clock(self, now_us: int) -> None:
        clock = self.clock
        self._node.report_bus_clock(clock.state(now_us), clock.drift_ppb, clock.error_us(now_us))

    def _take(self, output: SlaveOutput) -> None:
        self._frames_out += output.frames_out
        self._events += output.events
        for event in output.events:
            self._handle(event)

    def _handle(self, event: Event) -> None:
        if isinstance(event, NodeIdConflict):
            self.conflict.seen(self._now_us, event.can_id)
            self._apply_conflict()
        elif isinstance(event, SyncReceived):
            self.clock.sync(event.arrived_us)
        elif isinstance(event, TimeStampReceived):
            self.clock.time_stamp(event.stamp_us)
        elif isinstance(event, NmtStateChanged):
            if self._node.slave.node_id != self._node_id:
                self._node_id = self._node.slave.node_id
                self.conflict.end()
                self._apply_conflict()
            if event.command in RESETS:
                self.emergencies.after_reset()

    def _apply_conflict(self) -> None:
        """Withdraw the contact and hold the node while its id is used by another; release it afterwards."""
        conflict, slave = self.conflict, self._node.slave
        self.emergencies.set(
            Emergency.ID_COLLISION, conflict.is_active, conflict.can_id.to_bytes(2, "little")
        )
        if conflict.is_silent and not self._is_held:
            self._withdraw(self._now_us, "another node has the same node id", last=True)
            slave.hold()
        elif self._is_held and not conflict.is_silent:
            slave.release()
        self._is_held = conflict.is_silent
