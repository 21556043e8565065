"""hand.toml: which hand, which nodes, which gains and limits. Read once, checked whole, immutable."""

from __future__ import annotations

import enum
from pathlib import Path
from typing import Annotated

import msgspec

from palpate_edge.can_bus.bus import BusConfig
from palpate_edge.common.config_file import Strict, parse_toml, read_toml
from palpate_edge.common.errors import ConfigError
from palpate_host.common.joint_command import Follows
from palpate_host.config.geometry_config import GeometryConfig
from palpate_host.config.twin_config import TwinConfig

GUIDE = "docs/configuration.md lists every key of a hand"
FEWEST_FINGERS = 3  # fewer give no virtual frame, Eq. (12)

Positive = Annotated[float, msgspec.Meta(gt=0)]
NotNegative = Annotated[float, msgspec.Meta(ge=0)]
NodeId = Annotated[int, msgspec.Meta(ge=1, le=127)]
Text = Annotated[str, msgspec.Meta(min_length=1)]
Name = Annotated[str, msgspec.Meta(pattern=r"^\S+$", description="one word in quotes, without spaces")]
"""Names stand in log headers and option lists."""
CalibrationHash = Annotated[
    str, msgspec.Meta(pattern="^[0-9a-f]{16}$", description="16 digits 0-9, a-f in quotes, as in 2001h")
]
Milliseconds = Annotated[int, msgspec.Meta(ge=1, le=600_000)]


class ControlMode(enum.Enum):
    """Which law turns the object: the paper's (contacts correct the frame) or Tahara's (blind)."""

    PROPOSED = "proposed"
    BLIND = "blind"


class ControlLaw(enum.Enum):
    """Law of a held object: the paper's, of its orientation, or that of its whole pose (pose_law.py)."""

    PAPER = "paper"
    POSE = "pose"


class ForceLaw(enum.Enum):
    """Effect of the measured contact force on the grasp (contact_force.py)."""

    OPEN = "open"
    INTEGRAL = "integral"
    ADMITTANCE = "admittance"


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


class ControlConfig(Strict, frozen=True):
    """Gains of Eqs. (9)-(14) (described at control.Gains) and how the object's orientation is followed.

    law: `pose` uses [pose_law] in place of K_r, friction_ratio, integral_per_s and the terms that carry.
    reference_frames: contacts a finger must give before its normal is a reference.
    contact_filter_s: low-pass on R_vir^T R_c; 0 turns it off. settle_ms: grasping before the object is
    turned. integral_per_s: rate at which the error that a proportional law leaves is taken out once the ramp
    is done; 0: as the paper. object_weight_N, position_stiffness_N_m: carry a grasped object, up is the
    hand's +z; 0: as the paper, whose object has no weight. release_ms: how long the fingers open after a
    release. velocity_joints: the drives turn with torque / B_d: u has then neither gravity nor damping.
    force_law, force_per_s: regulate the contact force, and how fast. soft_limit_rad: before the end of a
    joint's range the torque outwards fades. drives_follow: quantity that the drives follow; B_d_Nms_rad,
    speed_limit_rad_s, acceleration_limit_rad_s2: of velocity and position; torque_rate_Nm_s: of torque
    (drives/joint_orders.py).
    """

    mode: ControlMode
    tick_Hz: Annotated[int, msgspec.Meta(ge=10, le=1000)]
    f_d_N: Positive
    K_r: NotNegative
    tip_radius_m: Positive
    friction_ratio: Positive
    contact_filter_s: NotNegative
    reference_frames: Annotated[int, msgspec.Meta(ge=1, le=1000)]
    settle_ms: Milliseconds
    release_ms: Milliseconds = 500
    soft_limit_rad: NotNegative = 0.05
    velocity_joints: bool = False
    drives_follow: Follows = Follows.TORQUE
    B_d_Nms_rad: Positive = 0.4
    speed_limit_rad_s: Positive = 2.0
    acceleration_limit_rad_s2: Positive = 50.0
    torque_rate_Nm_s: Positive = 50.0
    force_law: ForceLaw = ForceLaw.OPEN
    force_per_s: NotNegative = 2.0
    integral_per_s: NotNegative = 0.0
    object_weight_N: NotNegative = 0.0
    position_stiffness_N_m: NotNegative = 0.0
    law: ControlLaw = ControlLaw.PAPER


class PoseLawConfig(Strict, frozen=True):
    """Gains and limits of control.law = "pose" (pose_law.py).

    position_stiffness_N_m, orientation_stiffness_Nm_rad: upper limits, which slow ticks reduce.
    position_damping_Ns_m, orientation_damping_Nms_rad: added to that of the joints. integral_per_s: rate at
    which a steady load is learned. friction: ratio of tangential to normal force that the grip provides for.
    most_grip_N: largest normal force of a tip that is commanded. relax_s: time constant with which the grip
    relaxes.
    contact_time_s: time constant with which contact normals correct the orientation. doubt_deg: a normal
    further from the expected one is left out. tip_stiffness_N_m2: k of Eq. (8), by which a loaded tip is
    smaller; 0: rigid. reach_mm, reach_deg: farthest target of a move from the pose where the hold began.
    slip_reflex: a tip that slips gets more grip, and its friction is estimated (tip_friction.py).
    onset_reflex: the same for a tip where slip begins, a flag that abrupt pushes set too.
    """

    position_stiffness_N_m: Positive = 1000.0
    position_damping_Ns_m: NotNegative = 20.0
    orientation_stiffness_Nm_rad: Positive = 4.0
    orientation_damping_Nms_rad: NotNegative = 0.03
    integral_per_s: NotNegative = 4.0
    friction: Positive = 0.4
    most_grip_N: Positive = 10.0
    relax_s: Positive = 0.5
    contact_time_s: Positive = 0.5
    doubt_deg: Positive = 8.0
    tip_stiffness_N_m2: NotNegative = 0.0
    reach_mm: Positive = 20.0
    reach_deg: Positive = 45.0
    slip_reflex: bool = True
    onset_reflex: bool = False


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
    """The whole of hand.toml; make it with `load`. geometry: in place of model.mjcf."""

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


def load(path: Path) -> HandConfig:
    """Read and check hand.toml; model.mjcf becomes a whole path.

    ConfigError (one line: file, key, way out) when it is missing, garbled, has an unknown or a missing key, a
    value out of range, or one node id for two nodes.
    """
    return _checked(path, read_toml(path, HandConfig, guide=GUIDE))


def parse(path: Path, text: str) -> HandConfig:
    """Return the text of a hand.toml as `load` does; the file at `path` need not exist yet."""
    return _checked(path, parse_toml(text.encode(), path, HandConfig, guide=GUIDE))


def _checked(path: Path, config: HandConfig) -> HandConfig:
    _check_nodes(path, config)
    _check_axes(path, config)
    _check_ranges(path, config)
    if config.model.mjcf is not None:
        model = msgspec.structs.replace(config.model, mjcf=str(path.parent / config.model.mjcf))
        config = msgspec.structs.replace(config, model=model)
    return config


def _check_nodes(path: Path, config: HandConfig) -> None:
    users: dict[int, str] = {config.network.host_node: "network.host_node"}
    shared: set[int] = set()
    for finger in config.fingers:
        claims = [(finger.fingertip_node, f"fingertip_node of {finger.name}")]
        for joint in finger.joints:
            if joint.drive_node not in shared:
                claims.append((joint.drive_node, f"drive_node of {joint.name}"))
            if joint.axis is not None:
                shared.add(joint.drive_node)
        for node, user in claims:
            if node in users:
                raise ConfigError(
                    f"{path}: node id 0x{node:02X} is used twice, by {users[node]} and by {user}: change one"
                )
            users[node] = user
    for key, names in (
        ("fingers.joints.name", [joint.name for joint in config.joints]),
        ("fingers.name", [finger.name for finger in config.fingers]),
        ("model.tip_sites", list(config.model.tip_sites)),
    ):
        for name in names:
            if names.count(name) > 1:
                raise ConfigError(f"{path}: {key} {name!r} is used twice: every one needs its own")


def _check_axes(path: Path, config: HandConfig) -> None:
    """Check the joints that are axes of a node with several."""
    users: dict[tuple[int, int], str] = {}
    for joint in config.joints:
        axis, node = joint.axis, joint.drive_node
        if axis is None:
            if node in config.node_axes:
                raise ConfigError(
                    f"{path}: node 0x{node:02X} has several axes, and {joint.name} names none:"
                    " set its fingers.joints.axis, or another drive_node"
                )
            continue
        where = f"{path}: fingers.joints.axis of {joint.name}"
        if (node, axis) in users:
            raise ConfigError(
                f"{path}: axis {axis} of node 0x{node:02X} is used twice, by {users[node, axis]} and by"
                f" {joint.name}: change one"
            )
        users[node, axis] = joint.name
        if joint.drive != "cia402":
            raise ConfigError(f"{where} needs drive = 'cia402', not {joint.drive!r}: remove one of them")
        if config.bus.data_bitrate is None:
            raise ConfigError(
                f"{where} needs a CAN FD bus, whose frames hold several axes: set bus.data_bitrate, or give"
                " each joint a drive_node of its own"
            )


def _check_ranges(path: Path, config: HandConfig) -> None:
    if len(config.model.tip_sites) != len(config.fingers):
        raise ConfigError(
            f"{path}: model.tip_sites has {len(config.model.tip_sites)} names for"
            f" {len(config.fingers)} [[fingers]]: give each finger its tip"
        )
    if (config.model.mjcf is None) == (config.geometry is None):
        raise ConfigError(
            f"{path}: needs either model.mjcf or [geometry]: name a file, or give the hand's shape"
        )
    for joint in config.joints:
        if joint.direction == 0:
            raise ConfigError(f"{path}: fingers.joints.direction of {joint.name} is 0: set 1 or -1")
        if joint.min_rad >= joint.max_rad:
            raise ConfigError(
                f"{path}: fingers.joints.min_rad of {joint.name} is not below its max_rad:"
                " exchange or correct them"
            )
    control = config.control
    if control.drives_follow is not Follows.TORQUE and control.force_law is not ForceLaw.ADMITTANCE:
        raise ConfigError(
            f"{path}: control.drives_follow = {control.drives_follow.value!r} needs control.force_law ="
            " 'admittance': without the sensor's force such joints go on closing"
        )
    if control.law is ControlLaw.POSE and not (
        control.mode is ControlMode.PROPOSED
        and control.drives_follow is Follows.TORQUE
        and not control.velocity_joints
        and control.force_law is ForceLaw.OPEN
    ):
        raise ConfigError(
            f"{path}: control.law = 'pose' needs control.mode = 'proposed', drives that follow torque,"
            " velocity_joints = false and force_law = 'open': correct these, or set law = 'paper'"
        )
    if config.homing is not None and config.homing.method > 0:
        for joint in config.joints:
            if joint.home_rad is None:
                raise ConfigError(
                    f"{path}: [homing] with method {config.homing.method} needs fingers.joints.home_rad of"
                    f" {joint.name}: give its angle at the home position"
                )
    s = config.staleness
    if not s.warn_ms < s.freeze_ms < s.hold_ms < s.stop_ms:
        raise ConfigError(
            f"{path}: staleness tiers must grow, warn_ms < freeze_ms < hold_ms < stop_ms,"
            f" not {s.warn_ms}, {s.freeze_ms}, {s.hold_ms}, {s.stop_ms}: correct [staleness]"
        )
    if config.network.heartbeat_ms >= config.network.heartbeat_timeout_ms:
        raise ConfigError(
            f"{path}: network.heartbeat_timeout_ms must exceed heartbeat_ms: use 3 times or more"
        )
