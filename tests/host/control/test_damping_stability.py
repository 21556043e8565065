"""The slowest tick at which the joints' sampled damping is stable, against a simulation of free joints."""

import msgspec
import numpy as np
import pytest
from click.testing import CliRunner

from palpate_edge.common.errors import ConfigError
from palpate_host.cli.main import cli
from palpate_host.config.control_config import ControlLaw
from palpate_host.config.packaged import MODELS
from palpate_host.control.damping_stability import check_damping, is_stable, slowest_tick_Hz
from palpate_host.service.host import load_hand

HAND = MODELS / "table4-wide.toml"
PARTS = 200


@pytest.fixture(scope="module")
def wide():
    return load_hand(HAND)


def grows(inertia, B, friction, tick_s):
    """Step free joints in small parts, with torques from the velocities of the tick before."""
    v, torque = np.linspace(1.0, 2.0, len(B)), np.zeros(len(B))
    begun = np.abs(v).max()
    for _ in range(300):
        next_torque = -B * v
        for _ in range(PARTS):
            v = v + tick_s / PARTS * np.linalg.solve(inertia, torque - friction * v)
        torque = next_torque
    return np.abs(v).max() > begun


@pytest.mark.parametrize("friction", [0.0, 0.05])
@pytest.mark.parametrize("joints", [1, 3])
def test_the_bound_is_that_of_a_simulation(joints, friction):
    rng = np.random.default_rng(joints)
    root = rng.normal(0.0, 5e-3, (joints, joints))
    inertia, B = 5e-4 * np.eye(joints) + root @ root.T, rng.uniform(0.05, 0.1, joints)
    ticks_s = np.geomspace(1e-3, 0.1, 200)
    stable = [is_stable(inertia, B, friction, tick_s) for tick_s in ticks_s]
    last = stable.index(False) - 1
    assert stable[0]
    assert not any(stable[last + 1 :])
    assert not grows(inertia, B, friction, 0.97 * ticks_s[last])
    assert grows(inertia, B, friction, 1.05 * ticks_s[last])


def test_without_friction_a_single_joint_has_the_bound_of_its_inertia():
    """v[k+1] = v[k] - B T/M v[k-1] is stable for B T < M."""
    inertia = np.array([[5e-4]])
    assert is_stable(inertia, np.array([0.07]), 0.0, 0.999 * 5e-4 / 0.07)
    assert not is_stable(inertia, np.array([0.07]), 0.0, 1.001 * 5e-4 / 0.07)


def at(config, tick_Hz, law=ControlLaw.POSE):
    control = msgspec.structs.replace(config.control, tick_Hz=tick_Hz, law=law)
    return msgspec.structs.replace(config, control=control)


def test_a_tick_that_loses_the_object_is_refused_with_the_one_that_fits(wide):
    config, hand = wide
    slowest_Hz = slowest_tick_Hz(config, hand)
    assert 50 < slowest_Hz < 66  # in the twin a turn by 30 deg slips at 50 and is good at 66
    with pytest.raises(ConfigError, match=r"tick_Hz = 50 is too slow .* set control.tick_Hz to 65 at least"):
        check_damping(at(config, 50), hand)
    check_damping(at(config, slowest_Hz), hand)
    check_damping(at(config, 50, ControlLaw.PAPER), hand)
    unknown = msgspec.structs.replace(config.twin, armature_kgm2=0.0)
    check_damping(msgspec.structs.replace(at(config, 50), twin=unknown), hand)


def test_check_refuses_such_a_hand(tmp_path):
    text = HAND.read_text().replace("tick_Hz = 100", "tick_Hz = 50")
    text = text.replace("\n[control]\n", '\n[control]\nlaw = "pose"\n')
    (tmp_path / "hand.toml").write_text(text)
    result = CliRunner().invoke(cli, ["check", "--config", str(tmp_path / "hand.toml"), "--offline"])
    assert isinstance(result.exception, ConfigError)
    assert "set control.tick_Hz to" in str(result.exception)
