"""One finger is silent under the pose law, in the whole chain: BLIND, HOLD, FAULT, and the object stays."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from palpate_host.common import rotation
from palpate_host.common.mode import Mode
from palpate_host.config.control_config import ControlLaw
from palpate_host.config.twin_config import DisturbanceConfig
from palpate_host.service.host import load_hand
from palpate_twin.cli.options import PACKAGED
from palpate_twin.closed_loop.lockstep import LockstepLoop
from palpate_twin.closed_loop.tactile_rendering import TrueContactSource
from palpate_twin.paper.shake import lifted
from palpate_twin.paper.trial import make_engine

pytestmark = pytest.mark.slow
GRAVITY_M_S2 = 9.81


class SilentContacts(TrueContactSource):
    """True contacts with noise; frames of the fingers in `silent` are not valid."""

    def __init__(self):
        super().__init__(30.0, 0.15, 1, 0.03)
        self.silent = set()

    def contact(self, finger, truth, exposed_at_us, sequence):
        found = super().contact(finger, truth, exposed_at_us, sequence)
        return replace(found, valid=finger not in self.silent)


class HeldWeight:
    """A hand in the chain that has lifted a mass, and turns it or not. pushes: on the object."""

    def __init__(self, mass_kg, model="table4-wide", lifted_from_s=0.5, rpy_deg=(0.0, 0.0, 0.0), pushes=()):
        config, hand = load_hand(PACKAGED[model])
        config = msgspec.structs.replace(
            config,
            control=msgspec.structs.replace(config.control, law=ControlLaw.POSE),
            target=msgspec.structs.replace(config.target, rpy_deg=rpy_deg),
            twin=msgspec.structs.replace(
                config.twin, disturbances=(*lifted(mass_kg, lifted_from_s), *pushes)
            ),
        )
        self.engine, self.contacts = make_engine(config, "mujoco", has_B=False), SilentContacts()
        self.samples = []
        self.loop = LockstepLoop(config, hand, self.engine, self.contacts, on_tick=self._keep)

    def _keep(self, status):
        engine = self.engine
        touching = [one.normal_force_N for one in engine.tip_contacts() if one is not None]
        force_N = max(touching, default=0.0)
        self.samples.append((status, engine.object_position_m, engine.object_rotation, force_N))

    def of_mode(self, mode):
        """The time in s, the farthest way in mm, angle in deg and force in N of the samples of one mode."""
        found = [sample for sample in self.samples if sample[0].mode is mode]
        (first, start_m, start_R, _), (last, *_) = found[0], found[-1]
        way_mm = max(1e3 * rotation.norm(sample[1] - start_m) for sample in found)
        angle_deg = max(rotation.angle_deg(sample[2] @ start_R.T) for sample in found)
        return 1e-6 * (last.time_us - first.time_us), way_mm, angle_deg, max(sample[3] for sample in found)


@pytest.mark.parametrize(
    ("model", "mass_kg", "finger"),
    [("table4-wide", 0.1, 0), ("table4-wide", 0.2, 1), ("table4-wide", 0.3, 2), ("table4-four", 0.3, 1)],
)
def test_the_object_stays_until_the_fault(model, mass_kg, finger):
    held = HeldWeight(mass_kg, model)
    held.loop.run(3.0)
    assert held.loop.status.mode is Mode.MANIPULATE
    held.samples.clear()
    held.contacts.silent.add(finger)
    held.loop.run(3.3)
    modes = [sample[0].mode for sample in held.samples]
    entered = [mode for before, mode in zip([None, *modes], modes, strict=False) if mode is not before]
    assert entered == [Mode.MANIPULATE, Mode.BLIND, Mode.HOLD, Mode.FAULT]
    time_s, way_mm, angle_deg, force_N = held.of_mode(Mode.HOLD)
    assert time_s == pytest.approx(2.0, abs=0.05)
    assert way_mm < 2.0
    assert angle_deg < 1.0
    assert force_N < 10.0
    assert held.loop.status.reason == f"finger-{finger + 1}: no valid frame for more than 3000 ms"


@pytest.mark.parametrize(("size_N", "start_s", "most_mm"), [(1.0, 4.5, 8.0), (3.0, 4.9, 20.0)])
def test_a_push_in_hold_moves_the_object_like_a_spring(size_N, start_s, most_mm):
    """For 0.2 s. Back within 0.3 mm, and nothing slips; 3 N need the firm grip of HOLD."""
    push = DisturbanceConfig(start_s=start_s, duration_s=0.2, force_N=(0.0, 0.0, -size_N))
    held = HeldWeight(0.2, pushes=(push,))
    held.loop.run(3.0)
    held.contacts.silent.add(1)
    held.loop.run(2.8)
    assert held.loop.status.mode is Mode.HOLD
    _, way_mm, _, force_N = held.of_mode(Mode.HOLD)
    assert 1.0 < way_mm < most_mm
    assert force_N < 10.0
    start_m = next(one[1] for one in held.samples if one[0].mode is Mode.HOLD)
    assert rotation.norm(held.engine.object_position_m - start_m) < 0.3e-3


def test_a_weight_that_is_not_known_yet_is_held_too_and_the_law_goes_on():
    """HOLD begins while 0.3 kg are lifted: what is added after that, 0.6 N, pulls at stiff joints alone."""
    held = HeldWeight(0.3, lifted_from_s=2.2)
    held.loop.run(2.0)
    held.contacts.silent.add(1)
    held.loop.run(1.2)
    assert held.loop.status.mode is Mode.HOLD
    held.samples.clear()
    held.loop.run(1.5)
    _, way_mm, angle_deg, force_N = held.of_mode(Mode.HOLD)
    assert way_mm < 6.0
    assert (angle_deg, force_N) < (1.0, 10.0)
    held.samples.clear()
    held.contacts.silent.clear()
    held.loop.run(2.5)
    assert held.loop.status.mode is Mode.MANIPULATE
    np.testing.assert_allclose(held.loop.status.hold.load_N[2], 0.3 * GRAVITY_M_S2, atol=0.2)


def test_a_turn_goes_on_after_hold():
    held = HeldWeight(0.2, rpy_deg=(0.0, 20.0, 0.0))
    held.loop.run(1.6)
    start_R = next(one[2] for one in held.samples if one[0].mode is Mode.MANIPULATE)
    assert 0.1 < held.loop.status.turned < 0.9
    held.contacts.silent.add(1)
    held.loop.run(2.0)
    assert held.loop.status.mode is Mode.HOLD
    held.loop.run(0.5)
    _, way_mm, angle_deg, force_N = held.of_mode(Mode.HOLD)
    assert way_mm < 2.0
    assert angle_deg < 1.0
    assert force_N < 10.0
    held.contacts.silent.clear()
    held.loop.run(3.0)
    assert held.loop.status.mode is Mode.MANIPULATE
    goal = rotation.from_rpy_deg(0.0, 20.0, 0.0) @ start_R
    assert rotation.angle_deg(goal @ held.engine.object_rotation.T) < 1.0
