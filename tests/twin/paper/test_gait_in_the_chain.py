"""Large turns by finger gaiting in the whole chain at 100 Hz, in virtual time: host core, bus, nodes, drives.

The operator's command is planned, carried out within the limits, and rests or ends where contacts are in
doubt. All errors are those of the true object.
"""

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from palpate_host.common import rotation
from palpate_host.common.command import CommandError, Grasp, Move, Reorient
from palpate_host.common.gait_plan import GaitPlan, Regrasp
from palpate_host.common.mode import Mode
from palpate_host.common.tick_inputs import Planned
from palpate_host.config.control_config import ControlLaw, ControlMode
from palpate_host.service.host import load_hand
from palpate_twin.cli.options import PACKAGED
from palpate_twin.closed_loop.lockstep import LockstepLoop
from palpate_twin.closed_loop.tactile_rendering import TrueContactSource
from palpate_twin.paper.gait_chain import corners_mm
from palpate_twin.paper.gait_runs import GaitCase, run_case
from palpate_twin.paper.gait_trial import shifted
from palpate_twin.paper.trial import make_engine
from palpate_twin.paper.trial_parameters import Trial

pytestmark = pytest.mark.slow
HAND = PACKAGED["table4-four"]
TRIAL = Trial(
    *(ControlMode.PROPOSED, (0.0, 0.0, 0.0)),
    noise_mm=0.15,
    force_noise=0.03,
    has_weight=True,
    law=ControlLaw.POSE,
)
HELD_S, TICK_S = 2.5, 0.01
SHARE = (1.0, 0.0, 1.0, 0.45)


class DoubtfulContacts(TrueContactSource):
    """True contacts with noise. lost: fingers whose frames have no contact; silent: whose are not valid."""

    def __init__(self, seed):
        super().__init__(30.0, 0.15, seed, 0.03)
        self.lost, self.silent = set(), set()

    def contact(self, finger, truth, exposed_at_us, sequence):
        found = super().contact(finger, None if finger in self.lost else truth, exposed_at_us, sequence)
        return replace(found, valid=finger not in self.silent)


class HeldHand:
    """The hand of four fingers in the chain; it holds the object within 1.5 mm of its place."""

    def __init__(self, seed=1):
        config, hand = load_hand(HAND)
        target = msgspec.structs.replace(config.target, rpy_deg=(0.0, 0.0, 0.0), ramp_s=0.5)
        config = msgspec.structs.replace(shifted(config, seed), target=target)
        self.engine = make_engine(config, "mujoco", has_B=False)
        self.contacts, self.statuses = DoubtfulContacts(seed), []
        self.moved_m, self.normal_N = [], []
        self.loop = LockstepLoop(
            *(config, hand, self.engine, self.contacts), has_weight=True, on_tick=self._keep
        )
        self.start_m = self.engine.object_position_m
        self.loop.run(HELD_S)
        assert self.loop.status.mode is Mode.MANIPULATE
        self.start_m, self.start_R = self.engine.object_position_m, self.engine.object_rotation
        self.moved_m, self.normal_N = [], []

    def _keep(self, status):
        self.statuses.append(status)
        self.moved_m.append(rotation.norm(self.engine.object_position_m - self.start_m))
        touching = [one.normal_force_N for one in self.engine.tip_contacts() if one is not None]
        self.normal_N.append(max(touching, default=0.0))

    @property
    def hold(self):
        return self.loop.status.hold

    @property
    def corners_mm(self):
        return corners_mm(self.engine)

    def command(self, command):
        self.loop.host.command(command)

    def run_until(self, condition, timeout_s):
        """Run until the status meets the condition."""
        for _ in range(round(timeout_s / TICK_S)):
            self.loop.run(TICK_S)
            if condition(self.loop.status):
                return
        raise AssertionError(f"not within {timeout_s} s: {self.loop.status.reason}, {self.hold}")

    def lift(self):
        """Let finger-2 take hold again on its face, and run until it is lifted."""
        law = self.loop.host._control.pose_law
        R_T = law.object.R.T
        law.follow_point(self.start_m)
        normals = tuple(map(tuple, (law.object.grip.normal @ law.object.R).tolist()))
        point_m = tuple((R_T @ np.array([0.004, 0.04, 0.0])).tolist())
        step = Regrasp(1, normals[1], point_m, 0.008, SHARE, (1.0,) * 4, 0.2)
        self.loop.host._control.start_gait(GaitPlan((0.0, 0.0, 1.0), 0.0, normals, (step,)))
        self.run_until(lambda status: "carry, finger-2 is lifted" in status.reason, 3.0)
        assert self.hold.lifted == 1
        assert self.loop.status.reason == "turning by finger gaiting: carry, finger-2 is lifted"


@pytest.mark.parametrize(("axis", "seed"), [(0, 1), (2, 1), (2, 2)])
def test_a_quarter_turn_by_command(axis, seed):
    outcome = run_case(HAND, GaitCase(axis, 90.0, replace(TRIAL, seed=seed), in_chain=True))
    assert not isinstance(outcome, str), outcome
    assert (outcome.problem, outcome.is_dropped) == ("", False)
    assert outcome.regrasped == outcome.plan.regrasps > 0
    assert outcome.error_deg < 2.0
    assert outcome.moved_mm < 2.0
    assert outcome.moved_most_mm < 3.0
    assert outcome.normal_N < 10.0


def test_the_refusal_of_a_turn_is_the_result_of_its_run():
    found = run_case(PACKAGED["table4-wide"], GaitCase(2, 90.0, TRIAL, in_chain=True))
    assert isinstance(found, str)
    assert "a hand of 3 fingers holds with too few" in found


def test_a_turn_that_cannot_be_planned_is_refused_with_the_reason_and_the_hand_holds():
    held = HeldHand()
    with pytest.raises(CommandError, match="no volume"):
        held.command(Reorient((0.0, 0.0, 90.0), ((0.0, 0.0, 0.0),) * 4))
    small = tuple(tuple(0.6 * np.array(corner)) for corner in held.corners_mm)
    with pytest.raises(CommandError, match=r"the tip of finger \d is -?\d+\.\d mm from the object"):
        held.command(Reorient((0.0, 0.0, 90.0), small))
    held.command(Reorient((0.0, 0.0, 90.0), held.corners_mm))
    held.loop.run(0.05)
    assert held.loop.status.reason == "holding: a turn by finger gaiting is being planned"
    held.loop.host.planned(Planned(None, "the turn is refused: why"))
    held.run_until(lambda status: status.hold.gait == "refused", 3.0)
    assert held.hold.gait_reason == "the turn is refused: why"
    assert held.hold.gait_reason in held.loop.status.warning
    held.loop.run(0.5)
    assert held.moved_m[-1] < 1e-3


@pytest.mark.parametrize("which", ["silent", "lost"])
def test_a_gait_rests_while_a_contact_is_in_doubt(which):
    """A finger that holds is silent, or gives a frame without contact, while another is lifted."""
    held = HeldHand()
    held.lift()
    getattr(held.contacts, which).add(2)
    held.run_until(lambda status: status.mode is Mode.BLIND, 0.5)
    getattr(held.contacts, which).clear()
    tip_m = held.loop.host._control.gait._tip_d_m
    held.loop.run(2.0 * TICK_S)
    assert held.loop.status.mode is Mode.BLIND
    np.testing.assert_array_equal(held.loop.host._control.gait._tip_d_m, tip_m)
    held.run_until(lambda status: status.hold.gait == "done", 5.0)
    assert held.hold.lifted is None
    assert max(held.moved_m) < 3e-3


def test_a_gait_stops_when_a_finger_loses_the_object_and_grasp_ends_it():
    held = HeldHand()
    held.lift()
    with pytest.raises(CommandError, match="finger gaiting is under way"):
        held.command(Move((0.0, 0.0, 1.0)))
    held.contacts.lost.add(3)
    held.run_until(lambda status: status.hold.gait == "stopped", 0.5)
    held.contacts.lost.clear()
    held.loop.run(0.3)
    assert held.loop.status.mode is Mode.MANIPULATE
    why, way_out = held.loop.status.reason.split("; ")
    assert why == "gait stopped: finger 4 lost the object"
    assert way_out == "finger-2 is lifted: palpate-host command grasp lets it take hold"
    with pytest.raises(CommandError, match="finger 2 is lifted; grasp first"):
        held.command(Move((0.0, 0.0, 1.0)))
    held.command(Grasp())
    held.run_until(lambda status: status.hold.lifted is None, 4.0)
    assert (held.loop.status.mode, held.hold.gait) == (Mode.GRASP, "stopped")
    assert held.hold.gait_reason == "gait stopped: ended by a command"
    assert all(finger.in_contact for finger in held.loop.status.fingers)
    held.command(Move((0.0, 0.0, 1.0)))
    held.loop.run(0.5)
    assert held.loop.status.mode is Mode.MANIPULATE
    assert max(held.moved_m) < 4e-3


def test_a_lost_object_while_a_finger_is_lifted_is_a_fault():
    held = HeldHand()
    held.lift()
    held.contacts.lost.update({0, 2})
    held.run_until(lambda status: status.mode is Mode.FAULT, 0.6)
    assert held.loop.status.reason.startswith("the object is lost: no contact of finger-1, finger-3")


def test_a_finger_that_stays_without_contact_leads_to_hold_and_the_lifted_finger_stays_lifted():
    """HOLD keeps the object where it is; `grasp` lets the lifted finger take hold when contacts are back."""
    held = HeldHand()
    held.lift()
    held.contacts.silent.add(2)
    held.run_until(lambda status: status.mode is Mode.HOLD, 1.5)
    assert "finger-3: no contact for more than 1000 ms" in held.loop.status.reason
    before_m = held.engine.object_position_m
    held.normal_N = []
    held.loop.run(1.5)
    assert (held.loop.status.mode, held.hold.lifted) == (Mode.HOLD, 1)
    assert held.engine.tip_contacts()[1] is None
    assert rotation.norm(held.engine.object_position_m - before_m) < 2e-3
    assert max(held.normal_N) < 10.0
    held.contacts.silent.clear()
    held.run_until(lambda status: status.mode is Mode.MANIPULATE, 1.5)
    assert held.hold.gait_reason == "gait stopped: a contact is too old"
    held.command(Grasp())
    held.run_until(lambda status: status.hold.lifted is None, 4.0)
    assert all(finger.in_contact for finger in held.loop.status.fingers)
    assert rotation.norm(held.engine.object_position_m - before_m) < 3e-3
