"""The host's status as Foxglove topics, the same in MCAP files and over a WebSocket.

| topic | schema |
|---|---|
| /joint_states | JointStates: position, velocity, measured torque |
| /joint_commands | JointStates: commanded torque as effort |
| /tf | FrameTransforms: `hand` to each dome's frame F, named as the finger |
| /tactile/FINGER/contact | Point3InFrame, m, in F; while a valid contact is there |
| /tactile/FINGER/force | SceneUpdate: a sphere at the contact, an arrow of 10 mm a newton |
| /tactile/FINGER/quantities | JSON: every quantity of the contact; null where it is not known |
| /object | PoseInFrame: orientation of the contact frame, Eq. (16), at the centroid of the tips |
| /diagnostics | Log: every change of mode, with its reason, and of warning |
| /host/status | JSON: the host's whole status of the tick, from which every other topic is made |
"""

from __future__ import annotations

from collections.abc import Iterable

import foxglove
import msgspec
import numpy as np
from foxglove import channels
from foxglove import messages as fg
from scipy.spatial.transform import Rotation

from palpate_edge.common.arrays import Array
from palpate_edge.common.contact_quantities import QUANTITIES
from palpate_host.common.mode import Mode
from palpate_host.common.status import FingerStatus, HostStatus
from palpate_host.control.kinematics import HandKinematics
from palpate_host.recording.mcap_reader import STATUS_TOPIC

HAND_FRAME = "hand"
ARROW_M_PER_N = 0.010
ARROW_DIAMETER_M = 0.002
CONTACT_DIAMETER_M = 0.003
ARROW_COLOUR = fg.Color(r=0.9, g=0.3, b=0.1, a=1.0)
QUANTITIES_SCHEMA = {
    "title": "palpate.Quantities",
    "type": "object",
    "properties": {
        quantity.column: {"type": ["number", "null"], "description": f"{quantity.name}, {quantity.unit}"}
        for quantity in QUANTITIES
    },
}
STATUS_SCHEMA = {
    "title": "palpate.HostStatus",
    "type": "object",
    "properties": {
        "time_us": {"type": "integer"},
        "mode": {"type": "string"},
        "reason": {"type": "string"},
        "orientation_error_deg": {"type": ["number", "null"]},
        "fingers": {"type": "array"},
        "joints": {"type": "array"},
    },
}


class HandTopics:
    """The channels of one hand; `write` logs a tick to the sinks of the context."""

    def __init__(self, context: foxglove.Context, hand: HandKinematics, fingers: Iterable[str]) -> None:
        self._hand = hand
        self._context = context  # its channels close when it is deleted
        names = tuple(fingers)
        self._states = channels.JointStatesChannel("/joint_states", context=context)
        self._commands = channels.JointStatesChannel("/joint_commands", context=context)
        self._tf = channels.FrameTransformsChannel("/tf", context=context)
        self._object = channels.PoseInFrameChannel("/object", context=context)
        self._log = channels.LogChannel("/diagnostics", context=context)
        self._contacts = {
            name: channels.Point3InFrameChannel(f"/tactile/{name}/contact", context=context) for name in names
        }
        self._forces = {
            name: channels.SceneUpdateChannel(f"/tactile/{name}/force", context=context) for name in names
        }
        self._quantities = {
            name: foxglove.Channel(f"/tactile/{name}/quantities", schema=QUANTITIES_SCHEMA, context=context)
            for name in names
        }
        self._status = foxglove.Channel(STATUS_TOPIC, schema=STATUS_SCHEMA, context=context)
        self._encoder = msgspec.json.Encoder()
        self._last_sequence: dict[str, int | None] = {}
        self._last_message = ("", "", "")

    def repeat(self) -> None:
        """Write mode and contacts again with the next tick, for a reader that has just come."""
        self._last_sequence, self._last_message = {}, ("", "", "")

    def write(self, status: HostStatus) -> None:
        """Write one tick. A contact is written once, when its sequence number is new."""
        time_ns = status.time_us * 1000
        stamp = fg.Timestamp(time_ns // 1_000_000_000, time_ns % 1_000_000_000)
        self._status.log(self._encoder.encode(status), log_time=time_ns)
        self._write_joints(status, stamp, time_ns)
        self._write_poses(status, stamp, time_ns)
        for finger in status.fingers:
            if finger.sequence != self._last_sequence.get(finger.name):
                self._last_sequence[finger.name] = finger.sequence
                self._write_contact(finger, stamp, time_ns)
        message = (status.mode.value, status.reason, status.warning)
        if message != self._last_message and status.mode is not Mode.UNKNOWN:
            self._last_message = message
            level = fg.LogLevel.Warning if status.warning else fg.LogLevel.Info
            text = f"{status.mode.value}: {status.reason}" + (
                f" ({status.warning})" if status.warning else ""
            )
            self._log.log(fg.Log(timestamp=stamp, level=level, message=text, name="host"), log_time=time_ns)

    def _write_joints(self, status: HostStatus, stamp: fg.Timestamp, time_ns: int) -> None:
        states = [
            fg.JointState(
                name=joint.name,
                position=joint.position_rad,
                velocity=joint.velocity_rad_s,
                effort=joint.torque_Nm,
            )
            for joint in status.joints
        ]
        commands = [fg.JointState(name=joint.name, effort=joint.command_Nm) for joint in status.joints]
        self._states.log(fg.JointStates(timestamp=stamp, joints=states), log_time=time_ns)
        self._commands.log(fg.JointStates(timestamp=stamp, joints=commands), log_time=time_ns)

    def _write_poses(self, status: HostStatus, stamp: fg.Timestamp, time_ns: int) -> None:
        q_rad = [joint.position_rad for joint in status.joints if joint.position_rad is not None]
        if len(q_rad) != len(status.joints):
            return
        pose = self._hand.pose(np.array(q_rad))
        transforms = [
            fg.FrameTransform(
                timestamp=stamp,
                parent_frame_id=HAND_FRAME,
                child_frame_id=finger.name,
                translation=_vector(centre),
                rotation=_quaternion(rotation),
            )
            for finger, centre, rotation in zip(
                status.fingers, pose.tip_centre_m, pose.tip_rotation, strict=True
            )
        ]
        self._tf.log(fg.FrameTransforms(transforms=transforms), log_time=time_ns)
        if status.R_c is not None:
            centroid = _vector(pose.tip_centre_m.mean(axis=0))
            oriented = fg.Pose(position=centroid, orientation=_quaternion(np.array(status.R_c)))
            self._object.log(
                fg.PoseInFrame(timestamp=stamp, frame_id=HAND_FRAME, pose=oriented), log_time=time_ns
            )

    def _write_contact(self, finger: FingerStatus, stamp: fg.Timestamp, time_ns: int) -> None:
        measured = {quantity.column: quantity.of(finger) for quantity in QUANTITIES}
        self._quantities[finger.name].log(self._encoder.encode(measured), log_time=time_ns)
        force = self._forces[finger.name]
        known = finger.valid and finger.position_mm is not None
        if finger.position_mm is not None and known:
            x, y, z = (value * 1e-3 for value in finger.position_mm)
            point = fg.Point3(x=x, y=y, z=z)
            self._contacts[finger.name].log(
                fg.Point3InFrame(timestamp=stamp, frame_id=finger.name, point=point), log_time=time_ns
            )
        if not known or finger.normal_force_N is None:
            gone = fg.SceneEntityDeletion(timestamp=stamp, type=fg.SceneEntityDeletionType.All)
            force.log(fg.SceneUpdate(deletions=[gone]), log_time=time_ns)
            return
        inward = -np.array([x, y, z]) / np.linalg.norm([x, y, z])
        arrow = fg.ArrowPrimitive(
            pose=fg.Pose(position=fg.Vector3(x=x, y=y, z=z), orientation=_along(inward)),
            shaft_length=ARROW_M_PER_N * finger.normal_force_N,
            shaft_diameter=ARROW_DIAMETER_M,
            head_length=2 * ARROW_DIAMETER_M,
            head_diameter=2 * ARROW_DIAMETER_M,
            color=ARROW_COLOUR,
        )
        size = fg.Vector3(x=CONTACT_DIAMETER_M, y=CONTACT_DIAMETER_M, z=CONTACT_DIAMETER_M)
        sphere = fg.SpherePrimitive(
            pose=fg.Pose(
                position=fg.Vector3(x=x, y=y, z=z), orientation=fg.Quaternion(x=0.0, y=0.0, z=0.0, w=1.0)
            ),
            size=size,
            color=ARROW_COLOUR,
        )
        entity = fg.SceneEntity(
            timestamp=stamp,
            frame_id=finger.name,
            id="normal force",
            frame_locked=True,
            arrows=[arrow],
            spheres=[sphere],
        )
        force.log(fg.SceneUpdate(entities=[entity]), log_time=time_ns)


def _vector(v: Array) -> fg.Vector3:
    return fg.Vector3(x=float(v[0]), y=float(v[1]), z=float(v[2]))


def _quaternion(R: Array) -> fg.Quaternion:
    x, y, z, w = Rotation.from_matrix(R).as_quat()
    return fg.Quaternion(x=float(x), y=float(y), z=float(z), w=float(w))


def _along(direction: Array) -> fg.Quaternion:
    """Return an orientation whose +x is `direction` (3,), a unit vector."""
    rotation, _ = Rotation.align_vectors([direction], [[1.0, 0.0, 0.0]])
    return _quaternion(rotation.as_matrix())
