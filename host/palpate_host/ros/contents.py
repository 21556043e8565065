"""Contents of the ROS messages of one hand, as plain values made from the host's status. Pure.

| topic | value | when |
|---|---|---|
| joint_states | `JointContent` | every tick |
| FINGER/wrench | `WrenchContent` | every valid frame of a sensor that gives forces |
| FINGER/contact | `PointContent` | every valid frame with a contact |
| object | `PoseContent` | every tick with an orientation of the contact frame, Eq. (16) |
| orientation_error | `NumberContent`, rad | every tick with such an orientation |
| FINGER/image_raw/compressed | `PictureContent` | every picture (pictures.py) |
| turned | `NumberContent`, 0 to 1 | every tick |
| mode | `TextContent` | every change; `NO_HOST` while the host is silent |
| /diagnostics | `DiagnosisContent` | once a second, and at every change of mode or warning |

Units are those of ROS (REP 103): m, rad, N, N m. Times are Unix time in us; those of a fingertip are of the
frame's exposure.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping

import mujoco
import numpy as np

from palpate_edge.common.arrays import Array
from palpate_host.common.mode import STARTING, STOPPED, Mode
from palpate_host.common.status import FingerStatus, HostStatus, JointStatus
from palpate_host.control.kinematics import HandKinematics
from palpate_host.ros.message_contents import (
    ERROR,
    NO_VECTOR,
    OK,
    STALE,
    WARN,
    DiagnosisContent,
    JointContent,
    MessageContent,
    NumberContent,
    PartDiagnosis,
    PointContent,
    PoseContent,
    TextContent,
    Vector,
    WrenchContent,
)

HAND_FRAME = "hand"
"""Frame of the palm, root of the URDF."""

NO_HOST = "no host"
"""The mode while the host is silent."""

DIAGNOSIS_US = 1_000_000
EQUATOR_MM = 1.0
"""Below this height of a contact in F the z part of its shear is taken as 0: the bus does not carry it."""


def topic_name(name: str) -> str:
    """Return a name of hand.toml as ROS allows it in a topic: letters, digits and underscores."""
    token = re.sub(r"\W", "_", name, flags=re.ASCII)
    return f"_{token}" if token[:1].isdigit() else token


class HandContents:
    """The messages of one hand, tick by tick; remembers what was sent last."""

    def __init__(self, hand: HandKinematics, tip_frames: Mapping[str, str], prefix: str = "") -> None:
        """tip_frames: finger -> frame F of its dome. prefix: put before every frame, as in ``left/``."""
        self._hand, self._prefix = hand, prefix
        self._frames = {finger: prefix + frame for finger, frame in tip_frames.items()}
        self._sequences: dict[str, int | None] = {}
        self._mode = self._diagnosed = ""
        self._next_diagnosis_us = 0

    def of_tick(self, status: HostStatus) -> list[MessageContent]:
        """Return the messages of a tick. A fingertip's are made once, when its sequence number is new."""
        contents: list[MessageContent] = [_joints(status), NumberContent("turned", status.turned or 0.0)]
        contents += self._object(status)
        for finger in status.fingers:
            if finger.sequence is not None and finger.sequence != self._sequences.get(finger.name):
                self._sequences[finger.name] = finger.sequence
                contents += self._touch(finger, status.time_us)
        contents += self._changed_mode(status.mode.value)
        summary = f"{status.mode.value}{status.reason}{status.warning}"
        if status.time_us >= self._next_diagnosis_us or summary != self._diagnosed:
            self._diagnosed, self._next_diagnosis_us = summary, status.time_us + DIAGNOSIS_US
            contents.append(DiagnosisContent("/diagnostics", status.time_us, tuple(_parts(status))))
        return contents

    def of_silence(self, time_us: int, reason: str) -> list[MessageContent]:
        """Return the messages that report a silent host: once, until it is back."""
        contents = self._changed_mode(NO_HOST)
        if contents:
            self._diagnosed = ""
            part = PartDiagnosis("palpate: hand", STALE, reason, {})
            contents.append(DiagnosisContent("/diagnostics", time_us, (part,)))
        return contents

    def _changed_mode(self, mode: str) -> list[MessageContent]:
        if mode == self._mode:
            return []
        self._mode = mode
        return [TextContent("mode", mode)]

    def _object(self, status: HostStatus) -> Iterator[MessageContent]:
        if status.orientation_error_deg is not None:
            yield NumberContent("orientation_error", math.radians(status.orientation_error_deg))
        q_rad = [joint.position_rad for joint in status.joints if joint.position_rad is not None]
        if status.R_c is None or len(q_rad) != len(status.joints):
            return
        x, y, z = self._hand.tip_centres_m(np.array(q_rad)).mean(axis=0).tolist()
        frame = self._prefix + HAND_FRAME
        yield PoseContent("object", status.time_us, frame, (x, y, z), quaternion(np.array(status.R_c)))

    def _touch(self, finger: FingerStatus, tick_us: int) -> Iterator[MessageContent]:
        if not finger.valid or finger.age_ms is None:
            return
        topic, frame = topic_name(finger.name), self._frames[finger.name]
        exposed_us = tick_us - round(1000 * finger.age_ms)
        if finger.position_mm is not None and finger.in_contact:
            x, y, z = (1e-3 * value for value in finger.position_mm)
            yield PointContent(f"{topic}/contact", exposed_us, frame, (x, y, z))
        force_N, torque_Nm = NO_VECTOR, NO_VECTOR
        if finger.in_contact:
            if finger.position_mm is None or finger.normal_force_N is None:
                return
            force_N, torque_Nm = wrench(
                finger.position_mm, finger.normal_force_N, finger.shear_N, finger.torsion_Nmm
            )
        yield WrenchContent(f"{topic}/wrench", exposed_us, frame, force_N, torque_Nm)


def wrench(
    position_mm: Vector, normal_N: float, shear_N: tuple[float, float] | None, torsion_Nmm: float | None
) -> tuple[Vector, Vector]:
    """Return force (N) and torque (N m) on a dome about the origin of F.

    The normal force and the torsion act along the inward normal, towards the origin. The shear lies across
    it; its z part follows from its x and y part. A shear or torsion that is not given counts as 0.
    """
    point = np.array(position_mm)
    distance_mm = float(np.linalg.norm(point))
    inward = -point / distance_mm if distance_mm else np.zeros(3)
    x_N, y_N = shear_N or (0.0, 0.0)
    z_N = -(x_N * point[0] + y_N * point[1]) / point[2] if abs(point[2]) >= EQUATOR_MM else 0.0
    force = normal_N * inward + np.array([x_N, y_N, z_N])
    torque = 1e-3 * (np.cross(point, force) + (torsion_Nmm or 0.0) * inward)
    return _vector(force), _vector(torque)


def quaternion(R: Array) -> tuple[float, float, float, float]:
    """Return x, y, z, w of a rotation matrix (3, 3)."""
    w_first = np.empty(4)
    mujoco.mju_mat2Quat(w_first, R.ravel())
    w, x, y, z = w_first.tolist()
    return x, y, z, w


def _vector(v: Array) -> Vector:
    x, y, z = v.tolist()
    return x, y, z


def _known(value: float | None) -> float:
    return math.nan if value is None else value


def _joints(status: HostStatus) -> JointContent:
    joints = status.joints
    return JointContent(
        "joint_states",
        status.time_us,
        tuple(joint.name for joint in joints),
        tuple(_known(joint.position_rad) for joint in joints),
        tuple(_known(joint.velocity_rad_s) for joint in joints),
        tuple(_known(joint.torque_Nm) for joint in joints),
    )


def _parts(status: HostStatus) -> Iterator[PartDiagnosis]:
    mode = status.mode
    is_starting = mode in STARTING and mode is not Mode.READY
    level = ERROR if mode in STOPPED else WARN if status.warning or is_starting else OK
    text = f"{mode.value}: {status.reason}" + (f" ({status.warning})" if status.warning else "")
    counters = status.counters
    values = {"ticks": counters.ticks, "late ticks": counters.late_ticks, "emergencies": counters.emergencies}
    yield PartDiagnosis("palpate: hand", level, text, {key: str(count) for key, count in values.items()})
    yield from map(_finger_part, status.fingers)
    yield from map(_joint_part, status.joints)


def _finger_part(finger: FingerStatus) -> PartDiagnosis:
    if finger.sequence is None:
        return PartDiagnosis(f"palpate: {finger.name}", ERROR, "no frame received", {})
    touch = "in contact" if finger.in_contact else "no contact"
    level, text = (OK, touch) if finger.valid else (WARN, "frame rejected")
    values = {
        "frames per second": f"{finger.frames_per_s:.1f}",
        "age of the last frame, ms": "" if finger.age_ms is None else f"{finger.age_ms:.0f}",
        "quality": str(finger.quality),
        "incomplete contacts": str(finger.incomplete),
        "lost frames": str(finger.lost_frames),
    }
    return PartDiagnosis(f"palpate: {finger.name}", level, text, values)


def _joint_part(joint: JointStatus) -> PartDiagnosis:
    if joint.position_rad is None:
        return PartDiagnosis(f"palpate: {joint.name}", ERROR, "no position", {})
    level = ERROR if "fault" in joint.drive_state.lower() else OK
    return PartDiagnosis(f"palpate: {joint.name}", level, joint.drive_state, {})
