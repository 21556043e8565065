"""The contents of message_contents.py as messages of rclpy."""

from __future__ import annotations

from functools import singledispatch
from typing import Any

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import (
    Point,
    PointStamped,
    PoseStamped,
    Quaternion,
    TransformStamped,
    Vector3,
    WrenchStamped,
)
from sensor_msgs.msg import CompressedImage, JointState
from std_msgs.msg import Float64, Header, String

from palpate_host.ros.message_contents import (
    DiagnosisContent,
    JointContent,
    NumberContent,
    PictureContent,
    PointContent,
    PoseContent,
    TextContent,
    Transform,
    TransformsContent,
    Vector,
    WrenchContent,
)


@singledispatch
def message_of(content: object) -> Any:
    """Return a `MessageContent` as a message."""
    raise TypeError(f"no message for {content!r}")


@message_of.register
def _joint_state(content: JointContent) -> Any:
    return JointState(
        header=_header(content.time_us),
        name=content.names,
        position=content.position,
        velocity=content.velocity,
        effort=content.effort,
    )


@message_of.register
def _wrench(content: WrenchContent) -> Any:
    message = WrenchStamped(header=_header(content.time_us, content.frame))
    message.wrench.force = _filled(Vector3, content.force_N)
    message.wrench.torque = _filled(Vector3, content.torque_Nm)
    return message


@message_of.register
def _point(content: PointContent) -> Any:
    header = _header(content.time_us, content.frame)
    return PointStamped(header=header, point=_filled(Point, content.point_m))


@message_of.register
def _pose(content: PoseContent) -> Any:
    message = PoseStamped(header=_header(content.time_us, content.frame))
    message.pose.position = _filled(Point, content.position_m)
    message.pose.orientation = _quaternion(content.quaternion)
    return message


@message_of.register
def _transforms(content: TransformsContent) -> Any:
    from tf2_msgs.msg import TFMessage  # noqa: PLC0415 (the wheels lack it)

    return TFMessage(transforms=list(map(_transform, content.transforms)))


def _transform(transform: Transform) -> Any:
    message = TransformStamped(header=_header(transform.time_us, transform.parent))
    message.child_frame_id = transform.child
    message.transform.translation = _filled(Vector3, transform.position_m)
    message.transform.rotation = _quaternion(transform.quaternion)
    return message


def _quaternion(quaternion: tuple[float, float, float, float]) -> Any:
    x, y, z, w = quaternion
    return Quaternion(x=x, y=y, z=z, w=w)


@message_of.register
def _picture(content: PictureContent) -> Any:
    header = _header(content.time_us, content.frame)
    return CompressedImage(header=header, format="jpeg", data=content.jpeg)


@message_of.register
def _number(content: NumberContent) -> Any:
    return Float64(data=content.value)


@message_of.register
def _text(content: TextContent) -> Any:
    return String(data=content.text)


@message_of.register
def _diagnosis(content: DiagnosisContent) -> Any:
    parts = [
        DiagnosticStatus(
            level=bytes([part.level]),
            name=part.name,
            message=part.message,
            values=[KeyValue(key=key, value=value) for key, value in part.values.items()],
        )
        for part in content.parts
    ]
    return DiagnosticArray(header=_header(content.time_us), status=parts)


def _header(time_us: int, frame: str = "") -> Any:
    seconds, rest_us = divmod(time_us, 1_000_000)
    return Header(stamp=Time(sec=seconds, nanosec=1000 * rest_us), frame_id=frame)


def _filled(kind: Any, vector: Vector) -> Any:
    x, y, z = vector
    return kind(x=x, y=y, z=z)
