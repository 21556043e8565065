"""The fingertip without threads, sockets and clock: bus frames, contacts and failures in, bus frames out.

It ties the node, the bus's clock and the monitor over frames together, and decides what is an emergency. A
contact is on the bus as valid only while frames come: the first deadline that passes withdraws it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.can_bus.clock_sync import BusClock, ClockState
from palpate_edge.can_bus.reconnecting_bus import BusState, BusStateChange, Stamped
from palpate_edge.common.contact import Contact, refused_contact
from palpate_edge.common.errors import BusError, CameraStalledError, CaptureError
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
from palpate_edge.node.fingertip_objects import LATENCY_HISTOGRAM, BusClockState, Health
from palpate_edge.node.nmt import NmtCommand, NmtState
from palpate_edge.node.slave import SlaveOutput

REPORT_EVERY_US = 1_000_000  # 2042h
RESETS = frozenset({NmtCommand.RESET_NODE, NmtCommand.RESET_COMMUNICATION})
BUS_CLOCK_STATES = {
    ClockState.FREE: BusClockState.NONE,
    ClockState.SYNCHRONISED: BusClockState.LOCKED,
    ClockState.LOST: BusClockState.FREE_RUNNING,
}


@dataclass(frozen=True, slots=True)
class CoreStep:
    """frames_out: to send, in order; next_due_us: when to call `poll` again at the latest; events: of the
    node, for the rim to see to what is its own."""

    frames_out: tuple[CanFrame, ...]
    next_due_us: int
    events: tuple[Event, ...]


class FingertipCore:
    """All times are local microseconds (LocalClock); the bus's own go no further than `clock`."""

    def __init__(self, node: FingertipNode, name: str, timeout_us: int, now_us: int) -> None:
        self.clock = BusClock()
        self.monitor = FrameMonitor(timeout_us, now_us)
        self.emergencies = ActiveEmergencies(node.slave.emcy)
        self._node = node
        self._name = name
        self._frames_out: list[CanFrame] = []
        self._events: list[Event] = []
        self._withdrawn = True  # nothing valid is on the bus yet
        self._capture_failed = False
        self._sequence = 0
        self._withdrawals = 0  # each takes a sequence number of its own
        self._report_at_us = now_us

    @property
    def state(self) -> NmtState:
        return self._node.slave.state

    def latencies(self) -> list[int]:
        """2040h: frames by their time from exposure to publication."""
        return [int(self._node.slave.read(LATENCY_HISTOGRAM, 1 + bin_)) for bin_ in range(8)]

    def receive(self, now_us: int, frames: Sequence[Stamped]) -> None:
        """Bus frames with their local arrival times. Raises BusError when another node has our id."""
        arrived_us = [stamp_us for stamp_us, _ in frames]
        self._take(self._node.process(now_us, [frame for _, frame in frames], arrived_us))

    def contact(self, now_us: int, contact: Contact) -> tuple[CanFrame, ...]:
        """The estimate of a frame; returns its TPDOs, to send before anything else is done."""
        self._sequence = contact.sequence
        self._withdrawn = not contact.valid
        return self._publish(now_us, contact)

    def frame_seen(self, now_us: int, contact: Contact, health: Health) -> None:
        """What the contact just sent says of camera and beads, with the board's health then."""
        self.monitor.frame_estimated(now_us, contact, health.frames_dropped)
        self._capture_failed = False
        self.emergencies.set(Emergency.CAMERA_LOST, False)
        self.emergencies.set(Emergency.CAMERA_STALLED, False)
        self.emergencies.set(Emergency.BEADS_LOST, self.monitor.beads_are_lost(now_us))
        self.emergencies.set(Emergency.OVERRUN, self.monitor.overruns())
        self._node.report_health(health)

    def capture_failed(self, now_us: int, error: CaptureError) -> None:
        """The source has failed and is tried again, or the daemon is about to end."""
        self._capture_failed = True
        stalled = isinstance(error, CameraStalledError)
        self.emergencies.set(Emergency.CAMERA_LOST, not stalled)
        self.emergencies.set(Emergency.CAMERA_STALLED, stalled)
        self._withdraw(now_us, str(error))

    def stop(self, now_us: int) -> None:
        """The daemon ends: what is on the bus is not valid any more."""
        self._withdraw(now_us, "the fingertip is stopped")

    def bus_state_changed(self, change: BusStateChange) -> None:
        """After bus-off the node does what 1029h asks for; by default it waits to be started again."""
        if change.state is BusState.UP and change.after_bus_off:
            self._node.slave.communication_error(Emergency.BUS_OFF_RECOVERED)
            self._node.slave.emcy.clear(Emergency.BUS_OFF_RECOVERED)

    def error_passive(self, passive: bool) -> None:
        self.emergencies.set(Emergency.ERROR_PASSIVE, passive)

    def light(self, *, lost: bool, too_hot: bool) -> None:
        """What the LED ring's controller says, where there is one."""
        self.emergencies.set(Emergency.LIGHT_LOST, lost)
        self.emergencies.set(Emergency.LED_TOO_HOT, too_hot)

    def poll(self, now_us: int) -> CoreStep:
        """Serve what is due, and hand over what there is to send."""
        if self.monitor.is_stalled(now_us) and not self._capture_failed:
            self.emergencies.set(Emergency.CAMERA_STALLED, True)
            self._withdraw(now_us, "no frame in time: the camera stalls")
        self.emergencies.set(Emergency.CLOCK_LOST, self.clock.state(now_us) is ClockState.LOST)
        if now_us >= self._report_at_us:
            self._report_at_us = now_us + REPORT_EVERY_US
            self._report_clock(now_us)
        output = self._node.process(now_us, [])
        self._take(output)
        due_us = min(output.next_due_us, self._report_at_us)
        if not self._withdrawn:
            due_us = min(due_us, self.monitor.stalls_at_us)
        step = CoreStep(tuple(self._frames_out), due_us, tuple(self._events))
        self._frames_out.clear()
        self._events.clear()
        return step

    def _withdraw(self, now_us: int, reason: str) -> None:
        if not self._withdrawn:
            self._withdrawn = True
            self._withdrawals += 1
            refused = refused_contact(self._sequence, now_us, reason, 0, 0)
            self._frames_out += self._publish(now_us, refused)

    def _publish(self, now_us: int, contact: Contact) -> tuple[CanFrame, ...]:
        """On the bus an exposure is told on the bus's clock, and a withdrawal counts as a frame."""
        self._node.publish(
            contact,
            now_us - contact.exposed_at_us,
            sequence=contact.sequence + self._withdrawals,
            exposed_us=self.clock.to_bus_us(contact.exposed_at_us),
        )
        return self._node.slave.due_tpdos(now_us)

    def _report_clock(self, now_us: int) -> None:
        state = BUS_CLOCK_STATES[self.clock.state(now_us)]
        self._node.report_bus_clock(state, self.clock.drift_ppb, self.clock.error_us(now_us))

    def _take(self, output: SlaveOutput) -> None:
        self._frames_out += output.frames_out
        self._events += output.events
        for event in output.events:
            self._handle(event)

    def _handle(self, event: Event) -> None:
        if isinstance(event, NodeIdConflict):
            raise BusError(
                f"{self._name}: node id 0x{self._node.slave.node_id:02X} is used twice: a frame "
                f"0x{event.can_id:03X} came from another node; give one of them another [node] id"
            )
        if isinstance(event, SyncReceived):
            self.clock.sync(event.arrived_us)
        elif isinstance(event, TimeStampReceived):
            self.clock.time_stamp(event.stamp_us)
        elif isinstance(event, NmtStateChanged) and event.command in RESETS:
            self.emergencies.after_reset()
