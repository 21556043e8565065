"""The URDF of a hand, from the model of its hand.toml: links, joints and their limits, fingertip frames.

The root link is `HAND_FRAME`. A joint angle is that of the host. Each fingertip's frame F is a link with the
name of its site (hand.toml, ``model.tip_sites``). Geoms of primitive shape are visuals; meshes are left out.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import mujoco
import numpy as np

from palpate_edge.common.arrays import Array
from palpate_host.common.rotation import exp, to_rpy
from palpate_host.config.hand_config import HandConfig
from palpate_host.control.hand_model import model_of
from palpate_host.ros.contents import HAND_FRAME

JOINT_TYPES = {int(mujoco.mjtJoint.mjJNT_HINGE): "revolute", int(mujoco.mjtJoint.mjJNT_SLIDE): "prismatic"}
SPHERE, CAPSULE, CYLINDER, BOX = (
    int(shape)
    for shape in (
        mujoco.mjtGeom.mjGEOM_SPHERE,
        mujoco.mjtGeom.mjGEOM_CAPSULE,
        mujoco.mjtGeom.mjGEOM_CYLINDER,
        mujoco.mjtGeom.mjGEOM_BOX,
    )
)


@dataclass(frozen=True, slots=True)
class LinkPose:
    """A pose relative to a link. position_m: (3,). rotation: (3, 3)."""

    position_m: Array
    rotation: Array

    @classmethod
    def of(cls, position_m: Array, quaternion_wxyz: Array) -> LinkPose:
        """Make one of MuJoCo's fields."""
        flat = np.empty(9)
        mujoco.mju_quat2Mat(flat, quaternion_wxyz)
        return cls(np.array(position_m), flat.reshape(3, 3))

    @classmethod
    def shifted(cls, position_m: Array) -> LinkPose:
        """Make one without rotation."""
        return cls(np.array(position_m), np.eye(3))

    def then(self, other: LinkPose) -> LinkPose:
        """Return `other`, which is relative to this one, relative to the same link."""
        return LinkPose(
            self.position_m + self.rotation @ other.position_m, np.asarray(self.rotation @ other.rotation)
        )

    @property
    def is_identity(self) -> bool:
        """True for the pose of the link itself."""
        return not self.position_m.any() and np.array_equal(self.rotation, np.eye(3))

    def element(self) -> Element:
        """Return the element ``origin``."""
        return Element("origin", xyz=_numbers(*self.position_m), rpy=_numbers(*to_rpy(self.rotation)))


def urdf_of(config: HandConfig) -> str:
    """Return the URDF as text. Raises ConfigError as `model_of`."""
    model = model_of(config)
    robot = Element("robot", name="palpate_hand")
    SubElement(robot, "link", name=HAND_FRAME)
    for body in range(1, model.nbody):
        robot.extend(_body(model, body, config))
    links = {link.get("name") for link in robot.iter("link")}
    for site in config.model.tip_sites:
        if site not in links:  # in a hand read from a URDF the site is a link already
            robot.extend(_tip(model, site))
    ElementTree.indent(robot)
    return ElementTree.tostring(robot, encoding="unicode", xml_declaration=True) + "\n"


def _body(model: mujoco.MjModel, body: int, config: HandConfig) -> Iterator[Element]:
    """Yield the links and joints from a body's parent to the body.

    A body with several joints turns about them one after the other: each but the last has an empty link.
    """
    parent, name = _link(model, int(model.body_parentid[body])), _link(model, body)
    place = LinkPose.of(model.body_pos[body], model.body_quat[body])
    first = int(model.body_jntadr[body])
    joints = range(first, first + int(model.body_jntnum[body]))
    for joint in joints:
        anchor = model.jnt_pos[joint]
        is_last = joint == joints[-1] and not anchor.any()
        child = name if is_last else f"{model.joint(joint).name}_link"
        origin = place.then(LinkPose.shifted(anchor)).then(_at_zero(model, joint))
        yield _moving(model, joint, parent, child, origin, config)
        if is_last:
            yield _with_mass(model, body)
            return
        yield Element("link", name=child)
        parent, place = child, LinkPose.shifted(-anchor)
    yield _fixed(parent, name, place)
    yield _with_mass(model, body)


def _link(model: mujoco.MjModel, body: int) -> str:
    return HAND_FRAME if body == 0 else model.body(body).name or f"body_{body}"


def _at_zero(model: mujoco.MjModel, joint: int) -> LinkPose:
    """Return where a joint is at the angle 0: MuJoCo's frames are those at its reference angle."""
    reference = float(model.qpos0[model.jnt_qposadr[joint]])
    axis = model.jnt_axis[joint]
    if JOINT_TYPES[int(model.jnt_type[joint])] == "prismatic":
        return LinkPose.shifted(-reference * axis)
    return LinkPose(np.zeros(3), exp(-reference * axis) if reference else np.eye(3))


def _moving(
    model: mujoco.MjModel, joint: int, parent: str, child: str, origin: LinkPose, config: HandConfig
) -> Element:
    name = model.joint(joint).name
    settings = next(one for one in config.joints if one.name == name)
    element = _joint(name, JOINT_TYPES[int(model.jnt_type[joint])], parent, child, origin)
    SubElement(element, "axis", xyz=_numbers(*model.jnt_axis[joint]))
    SubElement(
        element,
        "limit",
        lower=_numbers(settings.min_rad),
        upper=_numbers(settings.max_rad),
        effort=_numbers(settings.torque_limit_Nm),
        velocity=_numbers(config.limits.joint_speed_rad_s),
    )
    return element


def _joint(name: str, kind: str, parent: str, child: str, origin: LinkPose) -> Element:
    element = Element("joint", name=name, type=kind)
    element.append(origin.element())
    SubElement(element, "parent", link=parent)
    SubElement(element, "child", link=child)
    return element


def _fixed(parent: str, child: str, origin: LinkPose) -> Element:
    return _joint(f"{child}_fixed", "fixed", parent, child, origin)


def _with_mass(model: mujoco.MjModel, body: int) -> Element:
    link = Element("link", name=_link(model, body))
    if model.body_mass[body] > 0.0:
        inertial = SubElement(link, "inertial")
        inertial.append(LinkPose.of(model.body_ipos[body], model.body_iquat[body]).element())
        SubElement(inertial, "mass", value=_numbers(model.body_mass[body]))
        xx, yy, zz = (_numbers(value) for value in model.body_inertia[body])
        SubElement(inertial, "inertia", ixx=xx, ixy="0", ixz="0", iyy=yy, iyz="0", izz=zz)
    first = int(model.body_geomadr[body])
    for geom in range(first, first + int(model.body_geomnum[body])):
        place = LinkPose.of(model.geom_pos[geom], model.geom_quat[geom])
        for offset_m, shape in _shapes(int(model.geom_type[geom]), *model.geom_size[geom].tolist()):
            visual = SubElement(link, "visual")
            visual.append(place.then(LinkPose.shifted(np.array([0.0, 0.0, offset_m]))).element())
            SubElement(visual, "geometry").append(shape)
    return link


def _shapes(kind: int, x: float, y: float, z: float) -> Iterator[tuple[float, Element]]:
    """Yield offsets (m, along z) and shapes of a geom; x, y, z is its MuJoCo size: radius and half length, or
    half edges. A capsule is a cylinder and two spheres."""
    if kind == BOX:
        yield 0.0, Element("box", size=_numbers(2 * x, 2 * y, 2 * z))
    if kind in (CAPSULE, CYLINDER):
        yield 0.0, Element("cylinder", radius=_numbers(x), length=_numbers(2 * y))
    for offset_m in {SPHERE: (0.0,), CAPSULE: (-y, y)}.get(kind, ()):
        yield offset_m, Element("sphere", radius=_numbers(x))


def _tip(model: mujoco.MjModel, site: str) -> Iterator[Element]:
    number = model.site(site).id
    parent = _link(model, int(model.site_bodyid[number]))
    yield _fixed(parent, site, LinkPose.of(model.site_pos[number], model.site_quat[number]))
    yield Element("link", name=site)


def _numbers(*values: float) -> str:
    return " ".join(f"{value:.12g}" for value in values)
