"""Time of one tick of the control law on Table 3's hand (3 x 5 joints): host, plain numpy and Pinocchio.

A tick computes kinematics, Jacobians and gravity, then Eqs. (9)-(16) and the limits. The law is the same code
in all three; the hand's terms come from different implementations. `disagreement` compares their results.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin

import palpate_host
from bench.timing import Row, table
from palpate_edge.common.arrays import Array
from palpate_host.common import rotation
from palpate_host.config.geometry_config import GeometryConfig
from palpate_host.config.hand_config import HandConfig
from palpate_host.control.control_law import joint_torque_Nm, limit_torque_Nm
from palpate_host.control.gains import Gains, gains_of
from palpate_host.control.kinematics import HandPose
from palpate_host.control.virtual_frame import contact_frame, desired_virtual_frame, virtual_frame
from palpate_host.service.host import load_hand

TABLE_3 = Path(palpate_host.__file__).parent / "models" / "table3.toml"
POSES = 500
ROUNDS = 5
G_M_S2 = 9.81
Terms = Callable[[Array], HandPose]


def base(geometry: GeometryConfig, azimuth_deg: float) -> tuple[Array, Array]:
    """Return axes (3, 3) and position (3,) of a finger's base; +x points to the hand's axis."""
    a = np.radians(azimuth_deg)
    place_m = geometry.base_circle_m * np.array([np.cos(a), np.sin(a), 0.0])
    return rotation.exp(np.array([0.0, 0.0, a + np.pi])), place_m


class NumpyHand:
    """The hand of a [geometry], computed link by link in plain numpy."""

    def __init__(self, config: HandConfig) -> None:
        geometry = config.geometry
        assert geometry is not None
        self._links = geometry.links
        self._bases = [base(geometry, azimuth_deg) for azimuth_deg in geometry.base_azimuth_deg]

    def pose(self, q_rad: Array) -> HandPose:
        """Return the pose, as `HandKinematics.pose` does."""
        joints = len(q_rad) // len(self._bases)
        centre, turn = np.zeros((3, 3)), np.zeros((3, 3, 3))
        jacobian, gravity = np.zeros((3, 3, len(q_rad))), np.zeros(len(q_rad))
        for finger, (R, place) in enumerate(self._bases):
            first = finger * joints
            axes, origins = np.empty((joints, 3)), np.empty((joints, 3))
            turned, end, joint = R, place, 0
            for link in self._links:
                for axis in link.joints:
                    vector = np.array(axis.vector)
                    axes[joint], origins[joint] = turned @ vector, end
                    turned = turned @ rotation.exp(q_rad[first + joint] * vector)
                    joint += 1
                along_m = link.length_m / 2 if link.centre_of_mass_m is None else link.centre_of_mass_m
                arms = end + along_m * turned[:, 2] - origins[:joint]
                lift = axes[:joint, 0] * arms[:, 1] - axes[:joint, 1] * arms[:, 0]
                gravity[first : first + joint] += link.mass_kg * G_M_S2 * lift
                end = end + link.length_m * turned[:, 2]
            centre[finger], turn[finger] = end, turned
            jacobian[finger, :, first : first + joints] = np.cross(axes, end - origins).T
        return HandPose(q_rad, centre, jacobian, turn, gravity)


class PinocchioHand:
    """The same hand in Pinocchio, built joint by joint, as its MJCF reader supports only one finger."""

    def __init__(self, config: HandConfig) -> None:
        geometry = config.geometry
        assert geometry is not None
        model = pin.Model()
        self._tips = []
        names = iter(joint.name for joint in config.joints)
        for azimuth_deg, tip in zip(geometry.base_azimuth_deg, config.model.tip_sites, strict=True):
            R, place_m = base(geometry, azimuth_deg)
            parent, placement = 0, pin.SE3(R, place_m)
            for link in geometry.links:
                for axis in link.joints:
                    joint = pin.JointModelRevoluteUnaligned(*axis.vector)
                    parent = model.addJoint(parent, joint, placement, next(names))
                    placement = pin.SE3.Identity()
                along_m = link.length_m / 2 if link.centre_of_mass_m is None else link.centre_of_mass_m
                body = pin.Inertia(link.mass_kg, np.array([0, 0, along_m]), np.diag(link.inertia_kgm2))
                model.appendBodyToJoint(parent, body, pin.SE3.Identity())
                placement = pin.SE3(np.eye(3), np.array([0, 0, link.length_m]))
            self._tips.append(model.addFrame(pin.Frame(tip, parent, 0, placement, pin.FrameType.OP_FRAME)))
        self._model, self._data = model, model.createData()

    def pose(self, q_rad: Array) -> HandPose:
        """Return the pose, as `HandKinematics.pose` does."""
        model, data = self._model, self._data
        pin.computeJointJacobians(model, data, q_rad)
        pin.updateFramePlacements(model, data)
        aligned = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        return HandPose(
            q_rad,
            np.array([data.oMf[tip].translation for tip in self._tips]),
            np.array([pin.getFrameJacobian(model, data, tip, aligned)[:3] for tip in self._tips]),
            np.array([data.oMf[tip].rotation for tip in self._tips]),
            pin.computeGeneralizedGravity(model, data, q_rad),
        )


def law(terms: Terms, gains: Gains, normals: Array, R_d: Array, q_rad: Array, qdot_rad_s: Array) -> Array:
    """Compute one tick: the hand's terms, R_vir, R_c, R_d_vir, u and its limits."""
    pose = terms(q_rad)
    R_vir = virtual_frame(pose.tip_centre_m)
    R_d_vir = desired_virtual_frame(R_d, R_vir.T.dot(contact_frame(normals)))
    return limit_torque_Nm(joint_torque_Nm(pose, qdot_rad_s, R_vir, R_d_vir, gains), q_rad, gains)


def hands() -> dict[str, Terms]:
    """Return the implementations of the hand's terms; plain numpy is first and the reference."""
    config, hand = load_hand(TABLE_3)
    return {
        "plain numpy": NumpyHand(config).pose,
        "Pinocchio": PinocchioHand(config).pose,
        "the host (MuJoCo)": hand.pose,
    }


def cases() -> tuple[Gains, Array, Array, list[tuple[Array, Array]]]:
    """Return gains, contact normals (3, 3), target (3, 3), and joint angles with velocities."""
    config, _ = load_hand(TABLE_3)
    assert config.twin is not None
    rng = np.random.default_rng(0)
    start = np.tile(config.twin.start_pose_rad, 3)
    moved = [(start + rng.uniform(-0.1, 0.1, 15), rng.uniform(-1, 1, 15)) for _ in range(POSES)]
    angle = np.radians([30.0, 150.0, 270.0])
    normals = np.column_stack((np.cos(angle), np.sin(angle), np.zeros(3)))
    turn = rotation.from_rpy_deg(5.0, -10.0, 20.0)
    return gains_of(config), normals, turn @ contact_frame(normals), moved


def disagreement() -> float:
    """Return the largest difference of a torque from the first implementation, in N m."""
    gains, normals, R_d, moved = cases()
    found = [np.array([law(terms, gains, normals, R_d, *one) for one in moved]) for terms in hands().values()]
    return max(float(np.abs(other - found[0]).max()) for other in found[1:])


def report() -> str:
    """Return the table."""
    title = "Kinematics, gravity, Eqs. (9)-(16) and limits, 3 fingers x 5 joints, processor time"
    return table(title, rows())


def rows() -> list[Row]:
    """Return the rows in processor time; the calls alternate, so that all have the same machine load."""
    gains, normals, R_d, moved = cases()
    implementations = hands()
    seconds: dict[str, list[float]] = {name: [] for name in implementations}
    for number in range(ROUNDS):
        for one in moved:
            for name, terms in implementations.items():
                begin = time.thread_time()
                law(terms, gains, normals, R_d, *one)
                if number:
                    seconds[name].append(time.thread_time() - begin)
    return [Row(f"tick 3 x 5, {name}", np.array(found)) for name, found in seconds.items()]
