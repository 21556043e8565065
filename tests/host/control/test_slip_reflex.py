"""The answer to slip under the pose law: more grip in the next tick, slowly relaxing, and turns that wait."""

import msgspec
import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

from palpate_host.common.mode import Mode
from palpate_host.common.tip_contact import TipContact
from palpate_host.config.control_config import ControlLaw
from palpate_host.config.packaged import MODELS
from palpate_host.control.hold_report import hold_status, hold_warning
from palpate_host.control.holding.grasp_forces import internal_ratio
from palpate_host.control.manipulation import Manipulation
from palpate_host.control.tip_friction import TipFriction
from palpate_host.control.virtual_frame import virtual_frame
from palpate_host.service.host import load_hand

START_RAD = np.tile([0.0, 0.1405, 1.4285], 3)
TICK_S = 0.01
NAMES = ("finger-1", "finger-2", "finger-3")


@pytest.fixture(scope="module")
def wide():
    return load_hand(MODELS / "table4-wide.toml")


class Hold:
    """A controller that holds an object which does not move."""

    def __init__(self, wide, law=ControlLaw.POSE, rpy_deg=(0.0, 0.0, 0.0), **pose_law):
        config, hand = wide
        config = msgspec.structs.replace(
            config,
            control=msgspec.structs.replace(config.control, law=law),
            pose_law=msgspec.structs.replace(config.pose_law, **pose_law),
            target=msgspec.structs.replace(config.target, rpy_deg=rpy_deg),
        )
        self.config = config.pose_law
        self.pose = hand.pose(START_RAD)
        self.control = Manipulation(config)
        self.frames = 0
        for _ in range(5):
            self.frame()
        self.tick()

    def frame(self, slips=(), ratio=0.05, begin=()):
        """One frame of every finger; the fingers in `slips` and `begin` flag slip and its onset."""
        for finger in range(3):
            contact = TipContact(
                received_at_us=self.frames * 33_333,
                exposed_at_us=self.frames * 33_333,
                sequence=self.frames,
                latency_us=0,
                position_mm=(0.0, 0.0, 30.0),
                normal_force_N=2.0,
                shear_N=(2.0 * ratio, 0.0),
                valid=True,
                in_contact=True,
                slip=finger in slips,
                slip_begins=finger in begin,
                quality=255,
            )
            self.control.add_contact(finger, contact, self.pose)
        self.frames += 1

    def tick(self):
        R_vir = virtual_frame(self.pose.tip_centre_m)
        return self.control.torque_Nm(Mode.MANIPULATE, self.pose, np.zeros(9), R_vir, TICK_S)

    @property
    def warning(self):
        return hold_warning(self.control, self.config, NAMES)

    @property
    def grip_N(self):
        return self.control.pose_law.grip_N


def test_the_next_tick_grips_harder_and_the_grip_relaxes(wide):
    hold = Hold(wide)
    before_N, before = hold.grip_N, hold.tick()
    hold.frame(slips=[1])
    torque = hold.tick()
    assert hold.grip_N == pytest.approx(1.5 * before_N, rel=0.02)
    assert np.abs(torque - before).max() > 0.05
    for _ in range(50):  # relax_s
        hold.tick()
    assert hold.grip_N - before_N == pytest.approx(0.5 * before_N * np.exp(-1), rel=0.05)


def test_no_grip_answers_where_internal_forces_alone_have_used_up_the_friction(wide):
    hold = Hold(wide)
    law, before_N = hold.control.pose_law, hold.grip_N
    ratio = internal_ratio(law.object.grip, 1)
    law.squeeze(1, ratio - 1e-3)
    assert hold.grip_N == before_N
    law.squeeze(1, ratio + 1e-3)
    assert hold.grip_N == pytest.approx(1.5 * before_N)


@pytest.mark.parametrize(("answers", "grown", "friction"), [(True, 1.5, 0.27), (False, 1.0, 0.4)])
def test_the_onset_of_slip_is_answered_where_it_is_asked_for(wide, answers, grown, friction):
    hold = Hold(wide, onset_reflex=answers)
    before_N = hold.grip_N
    hold.frame(begin=[1], ratio=0.3)
    hold.tick()
    assert hold.grip_N == pytest.approx(grown * before_N, rel=0.02)
    assert hold_status(hold.control).friction == pytest.approx((0.4, friction, 0.4))


def test_slip_of_several_tips_is_one_answer_and_the_grip_stays_bounded(wide):
    hold = Hold(wide, most_grip_N=8.0)
    before_N = hold.grip_N
    hold.frame(slips=[0, 1, 2])
    hold.tick()
    assert hold.grip_N == pytest.approx(1.5 * before_N, rel=0.02)
    for _ in range(20):
        hold.frame(slips=[0, 1, 2])
        hold.tick()
        assert hold.grip_N <= 8.0
    assert (np.abs(hold.tick()) <= 0.5).all()


def test_tips_that_slide_before_the_object_is_held_do_not_slip(wide):
    hold = Hold(wide)
    hold.control.pose_law.drop()
    hold.frame(slips=[0, 1, 2], ratio=0.3)
    status = hold_status(hold.control)
    assert (status.friction, status.slips) == ((0.4,) * 3, (0,) * 3)
    assert status.friction_ratio == pytest.approx((0.3,) * 3)


def test_only_the_friction_of_the_tip_that_slips_is_lowered(wide):
    hold = Hold(wide)
    hold.frame(slips=[1], ratio=0.3)
    status = hold_status(hold.control)
    assert status.friction == pytest.approx((0.4, 0.27, 0.4))
    assert status.friction_ratio == pytest.approx((0.3,) * 3)
    assert status.friction_margin == pytest.approx((0.1, -0.03, 0.1))
    assert status.slips == (0, 1, 0)
    assert hold.warning.startswith("finger-2: slipped, so less friction is assumed; weight unknown")


def test_a_lowered_friction_gives_more_grip_for_the_same_load(wide):
    """A grip that is determined by the load grows when the friction falls, here from 0.4 to 0.225."""
    grips, friction = [], []
    for slips in ([], [0, 1, 2]):
        hold = Hold(wide, integral_per_s=0.0)
        hold.frame(slips=slips, ratio=0.25)
        hold.control.pose_law.target.shift(np.array([0.0, 0.0, 0.012]))
        for _ in range(300):
            hold.tick()
        grips.append(hold.grip_N)
        friction.append(hold.control.friction.tips[0].friction)
    assert friction[1] < 0.25
    assert grips[1] == pytest.approx(friction[0] / friction[1] * grips[0], rel=0.1)


@pytest.mark.parametrize("law", list(ControlLaw))
def test_without_the_reflex_nothing_changes_but_the_status(wide, law):
    """The paper's law has no reflex; the pose law's can be switched off."""
    flagged, quiet = Hold(wide, law, slip_reflex=False), Hold(wide, law, slip_reflex=False)
    for _ in range(5):
        flagged.frame(slips=[0, 1, 2])
        quiet.frame()
        np.testing.assert_array_equal(flagged.tick(), quiet.tick())
    assert hold_status(flagged.control).slips == (5, 5, 5)
    assert not hold_status(flagged.control).turn_waits


def test_a_turn_goes_back_to_where_friction_holds(wide):
    """Friction a little below what the internal forces use turns back, a little above rests, more goes on."""
    hold = Hold(wide, rpy_deg=(0.0, 20.0, 0.0))

    def ticks(count, reserve=None):
        """Tick with this friction beyond what the internal forces use; None: without a slip.

        Returns the share of the ramp's time that has passed.
        """
        for _ in range(count):
            used = hold.control.friction.tips[0].friction - hold.control.pose_law.reserve
            gap = 0.0 if reserve is None else 0.4 - used - reserve
            hold.control.friction.tips = [TipFriction(0.4, gap=gap, slips=20)] * 3
            hold.tick()
        return float(np.interp(hold.control.turned, turned, passed))

    passed = np.linspace(0.0, 1.0, 10_001)
    turned = CubicHermiteSpline([0.0, 1.0], [0.0, 1.0], [0.0, 0.0])(passed)
    assert ticks(100) == pytest.approx(0.5, abs=0.02)
    assert ticks(50, -0.01) == pytest.approx(0.25, abs=0.02)
    assert hold_status(hold.control).turn_waits
    assert "the turn waits" in hold.warning
    rests_at = ticks(2, 0.01)
    assert ticks(50, 0.01) == rests_at
    assert ticks(50, 0.05) == pytest.approx(rests_at + 0.25, abs=0.02)
    assert ticks(300) == 1.0
