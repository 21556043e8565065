"""The frames of a hand for TF: its URDF's, as robot_state_publisher makes them, and the object's. Pure.

| topic | content | when |
|---|---|---|
| /tf_static | links at fixed joints, among them the fingertips' frames F | once |
| /tf | links at moving joints; `object`, as the topic object | every tick in which all angles are known |
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_host.common.rotation import exp, from_rpy_deg
from palpate_host.ros.contents import quaternion
from palpate_host.ros.message_contents import (
    JointContent,
    MessageContent,
    PoseContent,
    Transform,
    TransformsContent,
    Vector,
)

OBJECT_FRAME = "object"


@dataclass(frozen=True, slots=True)
class UrdfJoint:
    """A joint of the URDF at its angle 0. axis: (3,), None for a fixed joint; rotation: (3, 3)."""

    name: str
    parent: str
    child: str
    position_m: Array
    rotation: Array
    axis: Array | None
    slides: bool

    def transform(self, time_us: int, prefix: str, angle: float = 0.0) -> Transform:
        """Return the child's place in the parent at an angle in rad, or at a length in m if it slides."""
        position_m, rotation = self.position_m, self.rotation
        if self.axis is not None and self.slides:
            position_m = position_m + rotation @ (angle * self.axis)
        elif self.axis is not None:
            rotation = np.asarray(rotation @ exp(angle * self.axis))
        x, y, z = position_m.tolist()
        return Transform(time_us, prefix + self.parent, prefix + self.child, (x, y, z), quaternion(rotation))


class HandFrames:
    """The transforms of one hand."""

    def __init__(self, urdf: str, prefix: str = "") -> None:
        """urdf: as text. prefix: put before every frame, as in ``left/``."""
        joints = [_joint(element) for element in ElementTree.fromstring(urdf).iter("joint")]
        self._fixed = [joint for joint in joints if joint.axis is None]
        self._moving = [joint for joint in joints if joint.axis is not None]
        self._prefix = prefix

    def fixed(self, time_us: int) -> TransformsContent:
        """Return the transforms that never change."""
        transforms = tuple(joint.transform(time_us, self._prefix) for joint in self._fixed)
        return TransformsContent("/tf_static", transforms, is_static=True)

    def of_tick(self, contents: Iterable[MessageContent]) -> Iterator[TransformsContent]:
        """Yield the transforms of a tick from its other contents."""
        transforms: list[Transform] = []
        for content in contents:
            if isinstance(content, JointContent):
                angles = dict(zip(content.names, content.position, strict=True))
                if not any(map(math.isnan, angles.values())):
                    transforms += (
                        joint.transform(content.time_us, self._prefix, angles[joint.name])
                        for joint in self._moving
                    )
            elif isinstance(content, PoseContent):
                child = self._prefix + OBJECT_FRAME
                place = content.position_m, content.quaternion
                transforms.append(Transform(content.time_us, content.frame, child, *place))
        if transforms:
            yield TransformsContent("/tf", tuple(transforms))


def _joint(element: Element) -> UrdfJoint:
    kind = element.attrib["type"]
    origin = element.find("origin")
    place = {} if origin is None else origin.attrib
    rpy_deg = map(math.degrees, _vector(place.get("rpy", "0 0 0")))
    axis = element.find("axis")
    return UrdfJoint(
        element.attrib["name"],
        _link(element, "parent"),
        _link(element, "child"),
        np.array(_vector(place.get("xyz", "0 0 0"))),
        from_rpy_deg(*rpy_deg),
        None if kind == "fixed" or axis is None else np.array(_vector(axis.attrib["xyz"])),
        slides=kind == "prismatic",
    )


def _link(element: Element, end: str) -> str:
    found = element.find(end)
    assert found is not None  # urdf.py writes both ends of every joint
    return found.attrib["link"]


def _vector(text: str) -> Vector:
    x, y, z = map(float, text.split())
    return x, y, z
