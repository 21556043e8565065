"""A hand that palpate was not made for runs from its file alone: stranger/hand.toml and its MJCF."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pinocchio as pin
import pytest
from click.testing import CliRunner

from palpate_edge.common.arrays import Array
from palpate_edge.common.errors import ConfigError
from palpate_host.cli.main import cli
from palpate_host.common.mode import Mode
from palpate_host.config.hand_config import HandConfig
from palpate_host.control.hand_model import model_of
from palpate_host.control.kinematics import HandKinematics
from palpate_host.service.host import load_hand
from palpate_host.service.host_core import HostCore
from palpate_twin.closed_loop.lockstep import LockstepLoop, final_error_deg
from palpate_twin.closed_loop.tactile_rendering import TrueContactSource
from palpate_twin.paper.trial import make_engine

STRANGER = Path(__file__).parents[1] / "stranger" / "hand.toml"


@pytest.fixture(scope="module")
def stranger() -> tuple[HandConfig, HandKinematics]:
    return load_hand(STRANGER)


def by_pinocchio(config: HandConfig, q_rad: Array) -> tuple[Array, Array, Array]:
    """Tip places (3, 3), Jacobians (3, 3, 12) and gravity (12,) of the same MJCF, read by Pinocchio."""
    model = pin.buildModelFromMJCF(config.model.mjcf)
    model.gravity.linear = np.array([0.0, 0.0, -9.81])  # its reader leaves it at none
    data = model.createData()
    ids = [model.getJointId(joint.name) for joint in config.joints]
    q_of, v_of = ([getattr(model.joints[i], name) for i in ids] for name in ("idx_q", "idx_v"))
    q = np.empty(model.nq)
    q[q_of] = q_rad
    pin.computeJointJacobians(model, data, q)
    pin.updateFramePlacements(model, data)
    tips = [model.getFrameId(name) for name in config.model.tip_sites]
    aligned = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    jacobians = np.array([pin.getFrameJacobian(model, data, tip, aligned)[:3] for tip in tips])
    gravity = pin.computeGeneralizedGravity(model, data, q)
    places = np.array([data.oMf[tip].translation for tip in tips])
    return places, jacobians[:, :, v_of], gravity[v_of]


def test_kinematics_and_gravity_are_those_of_another_library(
    stranger: tuple[HandConfig, HandKinematics],
) -> None:
    config, hand = stranger
    low = np.array([joint.min_rad for joint in config.joints])
    high = np.array([joint.max_rad for joint in config.joints])
    for share in np.random.default_rng(0).uniform(0, 1, (20, 12)):
        pose = hand.pose(low + share * (high - low))
        places, jacobians, gravity = by_pinocchio(config, pose.q_rad)
        np.testing.assert_allclose(pose.tip_centre_m, places, atol=1e-9)
        np.testing.assert_allclose(pose.tip_jacobian_m, jacobians, atol=1e-9)
        np.testing.assert_allclose(pose.gravity_Nm, gravity, atol=1e-6)


def test_its_tips_are_where_its_published_dimensions_put_them(
    stranger: tuple[HandConfig, HandKinematics],
) -> None:
    """All joints at 0: the finger on +y stands 60 deg from upright, 30 + 50 + 35 + 28 mm long."""
    _, hand = stranger
    along = 0.030 + 0.050 + 0.035 + 0.028
    expected = [0.0, 0.05 + 0.015 - along * np.cos(np.pi / 3), 0.017 + 0.17902 + along * np.sin(np.pi / 3)]
    np.testing.assert_allclose(hand.pose(np.zeros(12)).tip_centre_m[0], expected, atol=1e-5)


def test_the_start_checks_it(stranger: tuple[HandConfig, HandKinematics]) -> None:
    """The numbering of the fingers is right; two of them exchanged are refused."""
    config, hand = stranger
    HostCore(config, hand)
    first, second, third = config.fingers
    sites = config.model.tip_sites
    swapped = msgspec.structs.replace(
        config,
        fingers=(second, first, third),
        model=msgspec.structs.replace(config.model, tip_sites=(sites[1], sites[0], sites[2])),
    )
    names = [joint.name for joint in swapped.joints]
    model = HandKinematics(model_of(swapped), names, swapped.model.tip_sites, "stranger")
    with pytest.raises(ConfigError, match="numbered clockwise"):
        HostCore(swapped, model)


def test_the_commands_take_it() -> None:
    for arguments in (["simulate", "hand", "--hand", str(STRANGER)], ["contract", "--config", str(STRANGER)]):
        done = CliRunner().invoke(cli, arguments)
        assert done.exit_code == 0, done.output
        assert "J3_3" in done.output


@pytest.mark.long
def test_it_grasps_and_turns_an_object(stranger: tuple[HandConfig, HandKinematics]) -> None:
    """Lock step: its own drives and fingertips on a bus, physics with friction. 10 deg of yaw."""
    config, hand = stranger
    engine = make_engine(config, "mujoco", has_B=False)
    loop = LockstepLoop(config, hand, engine, TrueContactSource(1e3 * config.control.tip_radius_m, 0.09, 1))
    record = loop.run(5.0)
    assert not record.failure
    assert record.samples[-1].mode is Mode.MANIPULATE
    error_deg, rpy_deg = final_error_deg(record, config.target.rpy_deg)
    assert error_deg < 2.5
    np.testing.assert_allclose(rpy_deg[-1], [0.0, 0.0, 10.0], atol=2.5)
    assert 1e3 * engine.slip_m.max() < 2.0
    forces = [touch.normal_force_N for touch in engine.tip_contacts() if touch is not None]
    assert len(forces) == 3 and min(forces) > 0.5 and max(forces) < 5.0
