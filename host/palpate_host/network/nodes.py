"""The other nodes of the bus as the host knows them: their last frames, and the frames for them.

Input are frames with their time stamps; every tick begins with the frames of `tick`. A reason that stops the
hand remains in `fault` or `stop`, one line each, until `recover`; the first reason is kept.
"""

from __future__ import annotations

from dataclasses import dataclass

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.arrays import Array
from palpate_edge.common.contact_quantities import POSE_NODE_OFFSET
from palpate_edge.common.errors import BusError
from palpate_edge.node.emcy import is_temperature
from palpate_edge.node.emergencies import Emergency
from palpate_host.common.command import Accepted, CommandError
from palpate_host.common.mode import MOVING, Mode
from palpate_host.common.status import Counters
from palpate_host.common.tip_contact import TipContact
from palpate_host.config.hand_config import HandConfig
from palpate_host.control.kinematics import HandKinematics, HandPose
from palpate_host.drives.drive_group import DriveGroup
from palpate_host.drives.identify import SDO_REQUEST_ID
from palpate_host.drives.registry import CIA402
from palpate_host.network.boot_check import BootCheck
from palpate_host.network.drive_contract import drive_contract
from palpate_host.network.finger_state import FingerRecord
from palpate_host.network.joint_history import JointHistory
from palpate_host.network.nmt_master import (
    EMCY_ID,
    HEARTBEAT_ID,
    NMT_ID,
    SYNC,
    Network,
    TimeStampProducer,
    foreign_stop,
)
from palpate_host.network.verified_boot import VerifiedBoot
from palpate_host.safety import runaway

EXPOSURE_AHEAD_LIMIT_US = 50_000

NMT_STOP = "stopped by another NMT master"


@dataclass(frozen=True, slots=True)
class PairedContact:
    """A valid contact of a finger with the hand's pose at its exposure."""

    finger: int
    contact: TipContact
    pose: HandPose


class Nodes:
    """Drives, fingertips and NMT of one hand; `receive` takes the identifiers `accept_ids`."""

    def __init__(self, config: HandConfig, hand: HandKinematics, *, verifies: bool = True) -> None:
        """verifies: read fingertips before their contacts are used."""
        network = config.network
        self._config = config
        self._hand = hand
        self._tick_us = 1_000_000 // config.control.tick_Hz
        self.drives = DriveGroup(config)
        without_nmt = {drive.node_id for drive in self.drives.drives if not drive.uses_nmt}
        self.network = Network(
            {node: name for node, name in config.node_names.items() if node not in without_nmt},
            network.host_node,
            network.heartbeat_ms * 1000,
            network.heartbeat_timeout_ms * 1000,
        )
        self.fingers = [
            FingerRecord(
                finger.name,
                finger.fingertip_node,
                poses=finger.fingertip_node + POSE_NODE_OFFSET not in config.node_names,
                serial=finger.serial,
                calibration=finger.calibration,
                software=finger.software,
                data_bitrate=config.bus.data_bitrate,
                verifies=verifies,
            )
            for finger in config.fingers
        ]
        self._finger_of_node = {finger.node_id: finger for finger in self.fingers}
        follows, axes = config.control.drives_follow, config.node_axes
        own = {joint.drive_node for joint in config.joints if joint.drive == CIA402 and verifies}
        drive_checks = [
            BootCheck(node, self.network.name(node), drive_contract(node, follows, axes.get(node, ())))
            for node in sorted(own)
        ]
        self._boot = VerifiedBoot([finger.boot for finger in self.fingers] + drive_checks)
        self._finger_by_id = {
            can_id: i for i, finger in enumerate(self.fingers) for can_id in finger.tip.receive_ids
        }
        self._time_stamps = TimeStampProducer()
        self._history = JointHistory(config.control.tick_Hz)
        self._last_sync_us: int | None = None
        self.fault = self.stop = self.last_emergency = ""
        self.counters = Counters()

    @property
    def accept_ids(self) -> tuple[int, ...]:
        """Identifiers of the host's inputs: for receive filters, and to select the inputs in a log.

        The host's own SYNC is one of them: 1013h carries its time stamp.
        """
        nodes = self._config.node_names
        beats = [HEARTBEAT_ID + node for node in nodes]
        emergencies = [EMCY_ID + node for node in nodes]
        requests = [SDO_REQUEST_ID + finger.node_id for finger in self.fingers]
        others = {NMT_ID, SYNC.can_id, *beats, *emergencies, *requests, *self._boot.reply_ids}
        return tuple(sorted(others | self.drives.receive_ids | self._finger_by_id.keys()))

    def receive(self, stamp_us: int, frame: CanFrame) -> PairedContact | None:
        """Take a frame; return a contact for the controller. A frame that contradicts its EDS is a fault."""
        try:
            return self._receive(stamp_us, frame)
        except BusError as exc:
            self.fault = self.fault or str(exc)
            return None

    def tick(self, tick_us: int) -> list[CanFrame]:
        """Record the joint angles of the last SYNC; return the frames of this tick, SYNC last."""
        drives, asked_us = self.drives, self._last_sync_us
        if asked_us is not None:
            if tick_us > (due_us := asked_us + self._tick_us):
                drives.excuse(due_us, tick_us)
            angles = drives.angles() if drives.sampled_after(asked_us) else None
            if angles is not None:
                self._history.add(asked_us, angles[0])
        self._last_sync_us = tick_us
        is_up = [not drive.uses_nmt or self.network.is_up(drive.node_id) for drive in drives.drives]
        reads = self._boot_requests(tick_us)
        tips = [finger.node_id for finger in self.fingers]
        ready = self._boot.verified([*drives.identified(), *tips])
        frames = [*self._time_stamps.due(tick_us), *self.network.due(tick_us, ready)]
        return [*frames, *drives.requests(tick_us, is_up), *reads, SYNC]

    def _boot_requests(self, tick_us: int) -> list[CanFrame]:
        """Return the reads of the fingertips and identified drives that are up and not verified.

        A node whose heartbeat has timed out is read again when it is back: it may be another one.
        """
        readable = []
        for node_id in [*self.drives.identified(), *self._finger_of_node]:
            if self.network.heartbeat_timed_out(node_id, tick_us):
                self._boot.restart(node_id)
            elif self.network.is_up(node_id):
                readable.append(node_id)
        return self._boot.requests(tick_us, readable)

    def fault_now(self, tick_us: int, mode: Mode, qdot_rad_s: Array | None) -> str:
        """Return why the hand has to stop in a mode that moves joints, or an empty text; do a homing step."""
        if mode not in (*MOVING, Mode.HOME):
            return ""
        drives, network = self.drives, self.network
        for drive in drives.drives:
            if network.heartbeat_timed_out(drive.node_id, tick_us):
                return f"{network.name(drive.node_id)}: heartbeat lost"
        emergency = self.last_emergency or "no EMCY"
        if mode is Mode.HOME:
            self._forget_joints()  # the drives' zeros move
            drives.homing.step(tick_us)
            problem = drives.homing.problem
            return problem and f"{problem}; {emergency}"
        waiting = drives.waiting()
        if waiting:
            return f"{waiting} left operation enabled; {emergency}"
        lost = drives.lost_joint(tick_us, self._config.staleness.joint_stop_ms * 1000)
        if lost or qdot_rad_s is None:
            return lost
        torque_Nm = [drive.torque_Nm for drive in drives.drives]
        return runaway.joint_fault(self._config.joints, torque_Nm, qdot_rad_s, self._config.limits)

    def bus_lost(self) -> None:
        """Drop the nodes' states, after the bus was lost."""
        self._time_stamps = TimeStampProducer()
        self._last_sync_us = None
        self._forget_joints()
        self.drives.forget()
        for finger in self.fingers:
            finger.forget()

    def recover(self) -> None:
        """Clear the reasons of the stop and reset every node."""
        self.fault = self.stop = self.last_emergency = ""
        self._forget_joints()
        self.network.restart()
        for node_id in self._config.node_names:
            self._booted(node_id)
        for finger in self.fingers:
            finger.forget()

    def accept(self, node_id: int) -> Accepted:
        """Use a fingertip as it is; return the difference that is accepted.

        Raises CommandError for another node, and when nothing differs that may be accepted.
        """
        finger = self._finger_of_node.get(node_id)
        difference = None if finger is None else finger.boot.accept()
        if finger is None or difference is None:
            problem = self._boot.problem(node_id) or "no difference was found"
            raise CommandError(
                f"node 0x{node_id:02X}: only another calibration, software or serial number of a fingertip"
                f" can be accepted: {problem}"
            )
        wanted, value = difference
        return Accepted(finger.name, wanted.key_in_hand, value, wanted.value)

    def _forget_joints(self) -> None:
        self._history = JointHistory(self._config.control.tick_Hz)

    def _receive(self, stamp_us: int, frame: CanFrame) -> PairedContact | None:
        node_id = frame.can_id & 0x7F
        if frame.remote:
            self.counters.foreign_frames += 1
        elif frame.can_id == SYNC.can_id:
            self._time_stamps.sync_left(stamp_us)
        elif frame.can_id == NMT_ID:
            if foreign_stop(frame, self._config.network.host_node):
                self.stop = self.stop or NMT_STOP
            self._boot.receive_nmt(frame)
        elif frame.can_id in self._finger_by_id:
            return self._receive_contact(self._finger_by_id[frame.can_id], stamp_us, frame)
        elif frame.can_id in self.drives.receive_ids:
            self.drives.receive(stamp_us, frame)
            if frame.can_id in self._boot.reply_ids:
                self._boot.receive(frame)
        elif frame.can_id in self._boot.reply_ids:
            self._boot.receive(frame)
        elif frame.can_id == SDO_REQUEST_ID + node_id and node_id in self._finger_of_node:
            self._boot.receive_request(node_id, frame)
        elif frame.can_id == HEARTBEAT_ID + node_id and node_id in self._config.node_names:
            self._receive_heartbeat(node_id, stamp_us, frame)
        elif frame.can_id == EMCY_ID + node_id and node_id in self._config.node_names:
            self._receive_emergency(node_id, frame)
        else:
            self.counters.foreign_frames += 1
        return None

    def _receive_heartbeat(self, node_id: int, stamp_us: int, frame: CanFrame) -> None:
        was_operating = self.network.operates(node_id)
        if self.network.receive(stamp_us, frame) is not None:
            self._booted(node_id)
        elif was_operating and not self.network.operates(node_id):
            self._boot.restart(node_id)  # its PDOs may change while it is not operational

    def _booted(self, node_id: int) -> None:
        self.drives.booted(node_id)
        self._boot.restart(node_id)
        finger = self._finger_of_node.get(node_id)
        if finger is not None:
            finger.tip.forget()
            finger.is_calibrated = True  # until an emergency says otherwise

    def unchecked(self, *, needs_contacts: bool) -> list[str]:
        """Return what the start waits for: nodes that are not operational or not verified, with the problem
        that was found, and calibrations, if `needs_contacts`, without which no contact is ever valid."""
        waiting = set(self.network.not_operating())
        names = [
            self._boot.problem(node_id) or self.network.name(node_id)
            for node_id in self._config.node_names
            if node_id in waiting or not self._boot.is_verified(node_id)
        ]
        uncalibrated = [finger.name for finger in self.fingers if needs_contacts and not finger.is_calibrated]
        return names + [f"a calibration of {name} (palpate-edge calibrate)" for name in uncalibrated]

    def _receive_emergency(self, node_id: int, frame: CanFrame) -> None:
        """Count an emergency; a drive's temperature is a fault in every mode, even if the drive goes on.

        A fingertip's temperature is no fault: its light is dimmed by its own controller.
        """
        self.counters.emergencies += 1
        code = int.from_bytes(frame.data[:2], "little")
        name = self.network.name(node_id)
        if code == Emergency.NO_CALIBRATION and node_id in self._finger_of_node:
            self._finger_of_node[node_id].is_calibrated = False
        self.last_emergency = f"{name}: EMCY {code:04X}h"
        if is_temperature(code) and self.drives.has(node_id):
            reason = f"{name}: temperature beyond its limit (EMCY {code:04X}h): let it cool, then recover"
            self.fault = self.fault or reason

    def _receive_contact(self, index: int, stamp_us: int, frame: CanFrame) -> PairedContact | None:
        finger = self.fingers[index]
        if not finger.boot.is_verified:
            finger.unverified += 1
            return None
        contact = finger.tip.receive(stamp_us, frame)
        if contact is None:
            return None
        name, limits = self._config.fingers[index].name, self._config.limits
        self.fault = self.fault or runaway.force_fault(name, contact, limits)
        pose = self._pose_at_exposure(contact, stamp_us)
        if pose is None:
            finger.unpaired += 1
            return None
        finger.note(contact)
        return PairedContact(index, contact, pose) if contact.valid else None

    def _pose_at_exposure(self, contact: TipContact, stamp_us: int) -> HandPose | None:
        """Return the pose at the exposure; None if it is before the joints' history or ahead of the clock."""
        if contact.exposed_at_us > stamp_us + EXPOSURE_AHEAD_LIMIT_US:
            return None
        q_rad = self._history.at(contact.exposed_at_us)
        return None if q_rad is None else self._hand.pose(q_rad)
