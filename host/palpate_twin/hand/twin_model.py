"""MuJoCo model of a hand and the grasped object, with the addresses of joints, tips and object.

Both engines use it: the rolling one takes M, C and g from it and adds Eqs. (4)-(8), the other one lets MuJoCo
compute the contact forces. Only the tips' spheres and the object collide; links pass through everything.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from palpate_edge.common.arrays import Array
from palpate_edge.common.errors import ConfigError
from palpate_host.config.hand_config import HandConfig
from palpate_host.config.twin_config import TwinConfig
from palpate_host.control.hand_model import compiled, source_of, spec_of
from palpate_twin.hand.prism import Prism, prism_of

OBJECT = "twin_object"


@dataclass(frozen=True, slots=True)
class TwinModel:
    """The compiled model with the indices of its parts.

    q_address, v_address: (nq,) indices of the joints in qpos and qvel, in the order of hand.toml. start_rad:
    (nq,) start pose. range_rad: (nq, 2) joint limits, infinite if a joint has none. The object's free joint
    has 7 values from object_q in qpos (position, quaternion) and 6 from object_v in qvel (velocity in the
    hand frame, angular velocity in the object's frame).
    """

    model: mujoco.MjModel
    twin: TwinConfig
    prism: Prism
    tip_radius_m: float
    damping_Nms_rad: Array
    start_rad: Array
    range_rad: Array
    q_address: Array
    v_address: Array
    tip_sites: tuple[int, ...]
    tip_geoms: tuple[int, ...]
    object_body: int
    object_q: int
    object_v: int

    def start(self) -> mujoco.MjData:
        """Return the start state: at rest in the start pose, with kinematics computed."""
        data = mujoco.MjData(self.model)
        data.qpos[self.q_address] = self.start_rad
        data.qpos[self.object_q : self.object_q + 7] = (*self.twin.object.position_m, 1.0, 0.0, 0.0, 0.0)
        mujoco.mj_forward(self.model, data)
        return data


def twin_model(config: HandConfig, *, with_contacts: bool, has_B: bool = True) -> TwinModel:
    """Build the model of a hand.

    with_contacts: MuJoCo computes the contacts. has_B: the joints have the damping B of Eq. (10), which then
    must not be commanded as a torque. The object's weight is compensated, as in Eq. (5).

    Raises ConfigError if hand.toml has no [twin] or if its start pose does not match the fingers.
    """
    twin = config.twin
    if twin is None:
        raise ConfigError("hand.toml has no [twin] section: add one with start_pose_rad and the object")
    for finger in config.fingers:
        if len(finger.joints) != len(twin.start_pose_rad):
            raise ConfigError(
                f"twin.start_pose_rad has {len(twin.start_pose_rad)} angles, but {finger.name} has"
                f" {len(finger.joints)} joints: give one angle per joint of a finger"
            )
    prism = prism_of(twin.object)
    spec = spec_of(config)
    for geom in spec.geoms:
        geom.contype = geom.conaffinity = 0
    _add_sky(spec)
    _add_object(spec, prism)
    _add_tips(spec, config, twin, with_contacts)
    names = [joint.name for joint in config.joints]
    for joint in spec.joints:
        if joint.name in names:
            joint.armature = twin.armature_kgm2
    model = compiled(spec, source_of(config))
    joints = [model.joint(name).id for name in names]
    free = model.body(OBJECT).jntadr[0]
    return TwinModel(
        model=model,
        twin=twin,
        prism=prism,
        tip_radius_m=config.control.tip_radius_m,
        damping_Nms_rad=has_B * np.array([j.B_Nms_rad for j in config.joints]) + twin.joint_friction_Nms_rad,
        start_rad=np.tile(twin.start_pose_rad, len(config.fingers)),
        range_rad=np.where(model.jnt_limited[joints, None], model.jnt_range[joints], (-np.inf, np.inf)),
        q_address=model.jnt_qposadr[joints],
        v_address=model.jnt_dofadr[joints],
        tip_sites=tuple(model.site(name).id for name in config.model.tip_sites),
        tip_geoms=tuple(model.geom(_sphere(name)).id for name in config.model.tip_sites),
        object_body=model.body(OBJECT).id,
        object_q=int(model.jnt_qposadr[free]),
        object_v=int(model.jnt_dofadr[free]),
    )


def _sphere(site: str) -> str:
    return f"twin_{site}"


def _add_sky(spec: mujoco.MjSpec) -> None:
    """Add the background of rendered images."""
    spec.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=(1.0, 1.0, 1.0),
        rgb2=(0.84, 0.88, 0.93),
        width=64,
        height=384,
    )


def _add_object(spec: mujoco.MjSpec, prism: Prism) -> None:
    spec.add_mesh(name=OBJECT, uservert=prism.vertices_m.ravel())
    body = spec.worldbody.add_body(
        name=OBJECT,
        explicitinertial=True,
        mass=prism.mass_kg,
        inertia=prism.inertia_kgm2,
        gravcomp=1.0,
    )
    body.add_freejoint()
    body.add_geom(
        name=OBJECT,
        type=mujoco.mjtGeom.mjGEOM_MESH,
        meshname=OBJECT,
        contype=0,
        conaffinity=0,
        rgba=(0.85, 0.65, 0.3, 1.0),
    )


def _add_tips(spec: mujoco.MjSpec, config: HandConfig, twin: TwinConfig, with_contacts: bool) -> None:
    for site in list(spec.sites):
        if site.name not in config.model.tip_sites:
            continue
        site.parent.add_geom(
            name=_sphere(site.name),
            type=mujoco.mjtGeom.mjGEOM_SPHERE,
            pos=site.pos,
            size=(config.control.tip_radius_m, 0.0, 0.0),
            contype=0,
            conaffinity=0,
            mass=0.0,
            rgba=(0.75, 0.85, 0.95, 0.6),
        )
        if with_contacts:
            friction = twin.tip.friction
            spec.add_pair(
                geomname1=_sphere(site.name),
                geomname2=OBJECT,
                condim=3,
                friction=(friction, friction, 0.0, 0.0, 0.0),
            )
