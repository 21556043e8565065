"""The content of each kind of ROS message as a plain value; contents.py makes them.

Units are those of ROS (REP 103): m, rad, N, N m. Times are Unix time in us.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

OK, WARN, ERROR, STALE = 0, 1, 2, 3
"""Levels of diagnostic_msgs/DiagnosticStatus."""

Vector = tuple[float, float, float]
NO_VECTOR: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class JointContent:
    """For sensor_msgs/JointState: rad, rad/s and measured torque in N m; NaN where a value is unknown."""

    topic: str
    time_us: int
    names: tuple[str, ...]
    position: tuple[float, ...]
    velocity: tuple[float, ...]
    effort: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class WrenchContent:
    """For geometry_msgs/WrenchStamped: what the object does to the dome, about the origin of `frame`."""

    topic: str
    time_us: int
    frame: str
    force_N: Vector
    torque_Nm: Vector


@dataclass(frozen=True, slots=True)
class PointContent:
    """For geometry_msgs/PointStamped, in m."""

    topic: str
    time_us: int
    frame: str
    point_m: Vector


@dataclass(frozen=True, slots=True)
class PoseContent:
    """For geometry_msgs/PoseStamped; the quaternion is x, y, z, w."""

    topic: str
    time_us: int
    frame: str
    position_m: Vector
    quaternion: tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class Transform:
    """For geometry_msgs/TransformStamped: where the frame `child` is in `parent`; quaternion x, y, z, w."""

    time_us: int
    parent: str
    child: str
    position_m: Vector
    quaternion: tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class TransformsContent:
    """For tf2_msgs/TFMessage; is_static: sent once, on a topic that keeps it for late subscribers."""

    topic: str
    transforms: tuple[Transform, ...]
    is_static: bool = False


@dataclass(frozen=True, slots=True)
class PictureContent:
    """For sensor_msgs/CompressedImage: a JPEG."""

    topic: str
    time_us: int
    frame: str
    jpeg: bytes


@dataclass(frozen=True, slots=True)
class NumberContent:
    """For std_msgs/Float64."""

    topic: str
    value: float


@dataclass(frozen=True, slots=True)
class TextContent:
    """For std_msgs/String."""

    topic: str
    text: str


@dataclass(frozen=True, slots=True)
class PartDiagnosis:
    """For one diagnostic_msgs/DiagnosticStatus; level: OK, WARN, ERROR or STALE."""

    name: str
    level: int
    message: str
    values: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class DiagnosisContent:
    """For diagnostic_msgs/DiagnosticArray."""

    topic: str
    time_us: int
    parts: tuple[PartDiagnosis, ...]


MessageContent = (
    JointContent
    | WrenchContent
    | PointContent
    | PoseContent
    | TransformsContent
    | PictureContent
    | NumberContent
    | TextContent
    | DiagnosisContent
)
