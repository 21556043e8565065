"""Time of one tick of the pose law of 4 x 4 joints: kinematics, estimate, wrench, contact forces."""

from __future__ import annotations

import time
from pathlib import Path

import msgspec
import numpy as np

import palpate_host
from bench.timing import Row, table
from palpate_host.common.mode import Mode
from palpate_host.config import hand_reader
from palpate_host.config.control_config import ControlLaw
from palpate_host.config.geometry_config import Axis
from palpate_host.config.hand_config import HandConfig
from palpate_host.control.hand_model import model_of, source_of
from palpate_host.control.kinematics import HandKinematics
from palpate_host.control.manipulation import Manipulation
from palpate_host.control.object_orientation import contact_normal
from palpate_host.control.virtual_frame import virtual_frame

TABLE_4 = Path(palpate_host.__file__).parent / "models" / "table4-wide.toml"
FINGERS = 4
START_RAD = (0.0, 0.1, 0.14, 1.33)
TICKS = 3000
TICK_S = 1e-3


def four_by_four() -> HandConfig:
    """Return Table 4's hand with four fingers and a second flexion at the root, under the pose law."""
    config = hand_reader.load(TABLE_4)
    geometry, finger = config.geometry, config.fingers[0]
    assert geometry is not None
    links = (
        msgspec.structs.replace(geometry.links[0], joints=(Axis.ABDUCTION, Axis.FLEXION)),
        *geometry.links[1:],
    )
    fingers = []
    for number in range(FINGERS):
        joints = [finger.joints[0], finger.joints[1], finger.joints[1], finger.joints[2]]
        fingers.append(
            msgspec.structs.replace(
                finger,
                name=f"finger-{number + 1}",
                joints=tuple(
                    msgspec.structs.replace(joint, name=f"joint_{number}_{k}")
                    for k, joint in enumerate(joints)
                ),
            )
        )
    azimuths = tuple(360.0 * number / FINGERS for number in range(FINGERS))
    return msgspec.structs.replace(
        config,
        fingers=tuple(fingers),
        geometry=msgspec.structs.replace(geometry, base_azimuth_deg=azimuths, links=links),
        model=msgspec.structs.replace(
            config.model, tip_sites=tuple(f"tip_{number + 1}" for number in range(FINGERS))
        ),
        control=msgspec.structs.replace(config.control, law=ControlLaw.POSE),
    )


def report() -> str:
    """Return the table."""
    return table("Pose law, 4 fingers x 4 joints, processor time", rows())


def rows() -> list[Row]:
    """Return the times of kinematics alone and of a whole tick of the law."""
    config = four_by_four()
    names = [joint.name for joint in config.joints]
    hand = HandKinematics(model_of(config), names, config.model.tip_sites, source_of(config))
    manipulation, start = Manipulation(config), np.tile(START_RAD, FINGERS)
    pose = hand.pose(start)
    R_vir = virtual_frame(pose.tip_centre_m)
    law = manipulation.pose_law
    assert law is not None
    for finger in range(FINGERS):
        normal = contact_normal(pose, finger, (0.0, 0.0, 30.0))
        assert normal is not None
        for frame in range(config.control.reference_frames):
            law.add_contact(finger, normal, pose, R_vir, frame)
            manipulation.orientation.add(finger, R_vir.T @ normal, frame)
    kinematics, ticks = [], []
    for tick in range(TICKS):
        q = start + 0.05 * np.sin(0.01 * tick + np.arange(len(start)))
        begin = time.thread_time()
        pose = hand.pose(q)
        between = time.thread_time()
        manipulation.torque_Nm(Mode.MANIPULATE, pose, start, virtual_frame(pose.tip_centre_m), TICK_S)
        ticks.append(time.thread_time() - begin)
        kinematics.append(between - begin)
    return [
        Row("kinematics, Jacobians, gravity (MuJoCo)", np.array(kinematics)),
        Row("whole tick of the pose law", np.array(ticks)),
    ]
