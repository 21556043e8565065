"""hand.toml: which hand, which nodes, which gains and limits. Read once, checked whole, immutable."""

from __future__ import annotations

import enum
from typing import Annotated

import msgspec

from palpate_edge.can_bus.bus import BusConfig
from palpate_edge.common.config_file import Strict
from palpate_host.config.control_config import ControlConfig, PoseLawConfig
from palpate_host.config.geometry_config import GeometryConfig
from palpate_host.config.twin_config import TwinConfig
from palpate_host.config.value_types import (
    CalibrationHash,
    Milliseconds,
    Name,
    NodeId,
    NotNegative,
    Positive,
    Text,
)

FEWEST_FINGERS = 3  # fewer give no virtual frame, Eq. (12)


class ModelConfig(Strict, frozen=True):
    """mjcf: an MJCF or URDF file, relative to hand.toml; without it the model is made from [geometry].

    tip_sites: frame F of each dome, finger by finger; in a URDF, the links that have it.
    """

    tip_sites: Annotated[tuple[Name, ...], msgspec.Meta(min_length=FEWEST_FINGERS)]
    mjcf: Text | None = None


class JointConfig(Strict, frozen=True):
    """One joint and its drive: q = direction * drive's angle + zero_offset_rad.

    home_rad: q where homing finds its switch. drive: the drive's key in the registry (drives/registry.py).
    axis: of a node with several axes, which other joints may name too; None for a node of its own.
    """

    name: Name
    drive_node: NodeId
    direction: Annotated[int, msgspec.Meta(ge=-1, le=1)]
    zero_offset_rad: float
    min_rad: float
    max_rad: float
    B_Nms_rad: NotNegative
    torque_limit_Nm: Positive
    home_rad: float | None = None
    drive: Name = "cia402"
    axis: Annotated[int, msgspec.Meta(ge=0, le=7)] | None = None


class FingerConfig(Strict, frozen=True):
    """A finger: its fingertip's node and its joints from the base outwards.

    calibration, serial, software: 2001h, 1018h:04 and 100Ah of its fingertip; another fingertip is refused.
    Without software it needs the version of the host's EDS. Recordings are bound to the calibration.
    """

    name: Name
    fingertip_node: NodeId
    joints: Annotated[tuple[JointConfig, ...], msgspec.Meta(min_length=1)]
    calibration: CalibrationHash | None = None
    serial: Annotated[int, msgspec.Meta(ge=0, le=0xFFFF_FFFF)] | None = None
    software: Text | None = None


class TargetConfig(Strict, frozen=True):
    """Turn of the object about the hand's fixed axes, and its duration (>= 1 s advised)."""

    rpy_deg: tuple[float, float, float]
    ramp_s: NotNegative


class StalenessConfig(Strict, frozen=True):
    """Age of the oldest finger's contact at which the host warns, goes blind, only grasps, or stops.

    lost_ms: time with contact at fewer than two fingers after which a held object is lost.
    joint_stop_ms: age of a joint's position at which the host stops; up to twice that where the host itself
    was late with its SYNC.
    """

    warn_ms: Milliseconds
    freeze_ms: Milliseconds
    hold_ms: Milliseconds
    stop_ms: Milliseconds
    joint_stop_ms: Milliseconds
    lost_ms: Milliseconds = 250


class LimitsConfig(Strict, frozen=True):
    """Limits of measured values; beyond one of them the hand goes to fault (runaway.py).

    contact_force_N: of a fingertip, normal or shear. joint_speed_rad_s: of any joint. torque_ratio: torque
    that a drive reports over its joint's torque_limit_Nm.
    """

    contact_force_N: Positive = 20.0
    joint_speed_rad_s: Positive = 20.0
    torque_ratio: Annotated[float, msgspec.Meta(ge=1)] = 1.5


class StartMode(enum.Enum):
    """AUTO: grasp and turn by [target] as soon as possible; a fault ends the process.

    COMMAND: wait in READY for the operator's commands, and after a fault for `recover`.
    """

    AUTO = "auto"
    COMMAND = "command"


class RunConfig(Strict, frozen=True):
    """Behaviour of `palpate-host run`. real_time: request SCHED_FIFO and locked memory (real_time.py)."""

    start: StartMode = StartMode.AUTO
    real_time: bool = False


class HomingConfig(Strict, frozen=True):
    """Homing of drives without an absolute zero, one after another, before the hand is ready.

    method: 6098h; 17 and 18 seek the lower and the upper limit switch, 37 is here, -1 the drive's own way.
    search_rad_s, zero_rad_s: towards the switch and off it. timeout_s: of each joint.
    """

    method: Annotated[int, msgspec.Meta(ge=-128, le=37)]
    timeout_s: Positive = 20.0
    search_rad_s: Positive = 0.3
    zero_rad_s: Positive = 0.05
    acceleration_rad_s2: Positive = 10.0


class NetworkConfig(Strict, frozen=True):
    """The host as a CANopen node, and how long a node's heartbeat may be away."""

    host_node: NodeId = 0x7F
    heartbeat_ms: Milliseconds = 100
    heartbeat_timeout_ms: Milliseconds = 500


class HandConfig(Strict, frozen=True):
    """The whole of hand.toml; hand_reader.load reads it. geometry: in place of model.mjcf."""

    model: ModelConfig
    fingers: Annotated[tuple[FingerConfig, ...], msgspec.Meta(min_length=FEWEST_FINGERS)]
    control: ControlConfig
    target: TargetConfig
    staleness: StalenessConfig
    bus: BusConfig
    network: NetworkConfig = NetworkConfig()
    run: RunConfig = RunConfig()
    limits: LimitsConfig = LimitsConfig()
    pose_law: PoseLawConfig = PoseLawConfig()
    homing: HomingConfig | None = None
    geometry: GeometryConfig | None = None
    twin: TwinConfig | None = None

    def starting(self, start: StartMode) -> HandConfig:
        """Return the same hand with this value of run.start."""
        return msgspec.structs.replace(self, run=msgspec.structs.replace(self.run, start=start))

    @property
    def joints(self) -> tuple[JointConfig, ...]:
        """Every joint, finger by finger: the order of q everywhere in the host."""
        return tuple(joint for finger in self.fingers for joint in finger.joints)

    @property
    def axis_names(self) -> dict[int, dict[int, str]]:
        """Node id -> axis -> joint of the drive nodes with several axes, in the order of the axes."""
        nodes: dict[int, dict[int, str]] = {}
        for joint in self.joints:
            if joint.axis is not None:
                nodes.setdefault(joint.drive_node, {})[joint.axis] = joint.name
        return {node: dict(sorted(names.items())) for node, names in nodes.items()}

    @property
    def node_axes(self) -> dict[int, tuple[int, ...]]:
        """Node id -> the axes of a drive node with several, in the order of their numbers."""
        return {node: tuple(names) for node, names in self.axis_names.items()}

    @property
    def node_names(self) -> dict[int, str]:
        """Node id -> who it is, for messages and for a log's header."""
        names: dict[int, str] = {}
        for joint in self.joints:
            kind = "drive" if joint.axis is None else "axes"
            above = names.get(joint.drive_node)
            names[joint.drive_node] = f"{above}, {joint.name}" if above else f"{kind} of {joint.name}"
        return names | {finger.fingertip_node: f"fingertip of {finger.name}" for finger in self.fingers}
