"""Loads on the object against Newton and Euler, in both engines, and friction that changes."""

import math

import msgspec
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from palpate_edge.common.errors import ConfigError
from palpate_host.config import hand_reader
from palpate_host.config.control_config import ControlMode
from palpate_host.config.twin_config import DisturbanceConfig
from palpate_host.service.host import load_hand
from palpate_twin.cli.options import PACKAGED
from palpate_twin.hand.disturbance import Schedule
from palpate_twin.paper.trial import make_engine, run_trial
from palpate_twin.paper.trial_parameters import Trial

HAND = PACKAGED["table4-wide"]
ENGINES = ("eqs", "mujoco")
G_M_S2 = 9.81
PLACE_M = (1.0, 0.3, 1.0)


@pytest.fixture(scope="module")
def config():
    return load_hand(HAND)[0]


def engine_with(config, name, *disturbances, place_m=None):
    twin = msgspec.structs.replace(config.twin, disturbances=disturbances)
    if place_m is not None:
        twin = msgspec.structs.replace(twin, object=msgspec.structs.replace(twin.object, position_m=place_m))
    return make_engine(msgspec.structs.replace(config, twin=twin), name)


def free_engine(config, name, *disturbances):
    """Return an engine whose object is beside the hand, so that nothing touches it."""
    return engine_with(config, name, *disturbances, place_m=PLACE_M)


def run(engine, seconds):
    for _ in range(round(seconds / engine.step_s)):
        engine.step(np.zeros(9))


@pytest.mark.parametrize("name", ENGINES)
def test_a_force_accelerates_the_object_while_it_acts(config, name):
    """F t/m for 0.1 s, then the same velocity: x = F/m t1 (t - t1/2)."""
    force = DisturbanceConfig(start_s=0.05, duration_s=0.1, force_N=(0.2, -0.1, 0.3))
    engine = free_engine(config, name, force)
    run(engine, 0.05)
    np.testing.assert_allclose(engine.object_position_m, PLACE_M, atol=1e-12)
    run(engine, 0.3)
    moved = np.array(force.force_N) / config.twin.object.mass_kg * 0.1 * (0.3 - 0.05)
    np.testing.assert_allclose(engine.object_position_m - PLACE_M, moved, rtol=5e-3)


@pytest.mark.parametrize("name", ENGINES)
def test_a_torque_turns_the_object_about_the_hands_axis(config, name):
    """About a principal axis, in the hand's frame: angle = torque t^2 / (2 I)."""
    engine = free_engine(config, name, DisturbanceConfig(torque_Nm=(0.0, 0.0, 2e-3)))
    run(engine, 0.2)
    turn = Rotation.from_matrix(engine.object_rotation).as_rotvec()
    angle = 2e-3 * 0.2**2 / 2 / engine.twin.prism.inertia_kgm2[2]
    np.testing.assert_allclose(turn, [0, 0, angle], rtol=5e-3, atol=1e-9)


@pytest.mark.parametrize("name", ENGINES)
@pytest.mark.parametrize("is_supported", [True, False])
def test_an_added_mass_has_inertia_and_weight(config, name, is_supported):
    """Only the added weight moves both masses while the object is supported; then both fall."""
    mass, added = config.twin.object.mass_kg, 0.05
    push = DisturbanceConfig(force_N=(0.3, 0.0, 0.0))
    engine = free_engine(config, name, DisturbanceConfig(added_mass_kg=added), push)
    if not is_supported:
        engine.remove_support()
    run(engine, 0.2)
    along, _, height = engine.object_position_m - PLACE_M
    falls = G_M_S2 * (added / (mass + added) if is_supported else 1.0)
    assert height == pytest.approx(-falls * 0.2**2 / 2, rel=5e-3)
    assert along == pytest.approx(0.3 / (mass + added) * 0.2**2 / 2, rel=5e-3)


def test_loads_that_overlap_add_up():
    first = DisturbanceConfig(duration_s=0.2, force_N=(1.0, 0.0, 0.0), friction=0.3)
    later = DisturbanceConfig(start_s=0.1, force_N=(0.0, 2.0, 0.0), added_mass_kg=0.1, friction=0.6)
    schedule = Schedule((first, later), step_s=1e-3)
    load = schedule.next_load(0.0)
    assert (*load.force_N, load.added_mass_kg, load.friction) == (1.0, 0.0, 0.0, 0.0, 0.3)
    assert schedule.next_load(0.05) is None
    load = schedule.next_load(0.1)
    assert (*load.force_N, load.added_mass_kg, load.friction) == (1.0, 2.0, 0.0, 0.1, 0.6)
    load = schedule.next_load(0.2)
    assert (*load.force_N, load.friction) == (0.0, 2.0, 0.0, 0.6)
    assert schedule.next_load(math.inf) is None


def test_less_friction_lets_the_object_slide():
    """A push of 1 N: the grasp holds it at a friction of 0.5, not at 0.05."""
    slips_mm = []
    for friction in (None, 0.05):
        push = DisturbanceConfig(start_s=0.1, duration_s=0.1, force_N=(0.0, 0.0, -1.0), friction=friction)
        trial = Trial(ControlMode.PROPOSED, (0.0, 0.0, 0.0), duration_s=0.25, disturbances=(push,))
        slips_mm.append(run_trial(HAND, "mujoco", trial).slip_mm.max())
    assert slips_mm[0] < 0.1
    assert slips_mm[1] > 1.0


def test_rolling_contacts_have_no_friction_to_change(config):
    with pytest.raises(ConfigError, match="the engine eqs has no friction"):
        engine_with(config, "eqs", DisturbanceConfig(friction=0.3))


def test_disturbances_are_read_from_hand_toml(tmp_path):
    copy = tmp_path / "hand.toml"
    table = "\n[[twin.disturbances]]\nstart_s = 1.0\nforce_N = [0.0, 0.0, -2.0]\n"
    copy.write_text(HAND.read_text() + table)
    (one,) = hand_reader.load(copy).twin.disturbances
    assert (one.start_s, one.force_N, one.duration_s) == (1.0, (0.0, 0.0, -2.0), math.inf)
    copy.write_text(HAND.read_text() + table.replace("start_s = 1.0", "start_s = -1.0"))
    with pytest.raises(ConfigError, match="start_s"):
        hand_reader.load(copy)
