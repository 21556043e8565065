"""A hand whose drives do not know their zero, and the checks that the host finds it."""

import msgspec
import pytest

from palpate_host.common.mode import Mode
from palpate_host.config.hand_config import HomingConfig, RunConfig, StartMode
from palpate_twin.drives.drive_plant import JointParameters


def homing_config(config, **homing):
    """Return the hand with [homing] to its lower limit switches, waiting for commands."""
    fingers = tuple(
        msgspec.structs.replace(
            finger,
            joints=tuple(msgspec.structs.replace(joint, home_rad=joint.min_rad) for joint in finger.joints),
        )
        for finger in config.fingers
    )
    return msgspec.structs.replace(
        config,
        fingers=fingers,
        homing=HomingConfig(**{"method": 17, "search_rad_s": 3.0, **homing}),
        run=RunConfig(start=StartMode.COMMAND),
    )


def shifted(joint):
    """Return the parameters of a joint whose drive's zero is 0.2 rad off."""
    return JointParameters(
        load_stiffness_Nm_rad=0.0,
        grasp_rad=joint.min_rad + 0.1,
        min_rad=joint.min_rad - 0.2,
        max_rad=joint.max_rad - 0.2,
    )


def check_homed(config, rig):
    """Every joint was homed in turn before the host was ready, and shows its true angle."""
    modes = list(dict.fromkeys(status.mode for status in rig.statuses))
    assert modes == [Mode.INIT, Mode.CHECK, Mode.HOME, Mode.READY]
    reasons = list(dict.fromkeys(s.reason for s in rig.statuses if s.mode is Mode.HOME))
    assert reasons == [f"homing drive of {joint.name}" for joint in config.joints]
    for joint, told in zip(config.joints, rig.statuses[-1].joints, strict=True):
        assert told.position_rad == pytest.approx(joint.min_rad, abs=0.01)
