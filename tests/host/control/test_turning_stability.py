"""The bound of the turning gain against tick and damping, and what is advised beyond it."""

import re

import msgspec
import numpy as np
import pytest
from click.testing import CliRunner

from palpate_host.cli.main import cli
from palpate_host.config.control_config import ControlLaw
from palpate_host.config.packaged import MODELS
from palpate_host.control.control_law import orientation_force_N
from palpate_host.control.gains import gains_of
from palpate_host.control.turning_stability import ADVISED_MARGIN, fastest_rate_per_s, turning_gain
from palpate_host.control.virtual_frame import virtual_frame
from palpate_host.service.host import load_hand

HAND = MODELS / "table4-wide.toml"


@pytest.fixture(scope="module")
def wide():
    return load_hand(HAND)


def with_control(config, **changes):
    return msgspec.structs.replace(config, control=msgspec.structs.replace(config.control, **changes))


def margin(wide, **changes):
    found = turning_gain(with_control(wide[0], **changes), wide[1])
    assert found is not None
    return found.margin


def test_the_margin_falls_with_force_gain_and_period(wide):
    as_shipped = margin(wide)
    assert as_shipped > 1.0
    assert margin(wide, f_d_N=8.0) == pytest.approx(as_shipped / 2)
    assert margin(wide, K_r=1.75) == pytest.approx(2 * as_shipped)
    assert margin(wide, tick_Hz=1000) == pytest.approx(10 * as_shipped)


def test_each_of_the_three_ways_out_leaves_the_advised_margin(wide):
    text = turning_gain(with_control(wide[0], f_d_N=8.0), wide[1]).warning
    f_d_N, K_r, tick_Hz = (
        float(re.search(rf"{key} to ([0-9.]+)", text)[1]) for key in ("f_d_N", "K_r", "tick_Hz")
    )
    for change in ({"f_d_N": f_d_N}, {"f_d_N": 8.0, "K_r": K_r}, {"f_d_N": 8.0, "tick_Hz": int(tick_Hz)}):
        assert ADVISED_MARGIN <= margin(wide, **change) < 1.02 * ADVISED_MARGIN
    assert turning_gain(*wide).warning == ""


def test_an_object_that_rolls_is_slower_than_free_tips(wide):
    """Free joints obey B dq/dt = u: their eigenvalues bound those of joints that the object couples."""
    config, hand = wide
    gains = gains_of(config)
    middle = np.array([(joint.min_rad + joint.max_rad) / 2 for joint in config.joints])
    R_d = virtual_frame(hand.pose(middle).tip_centre_m)

    def u(q):
        pose = hand.pose(q)
        force = orientation_force_N(pose.tip_centre_m, virtual_frame(pose.tip_centre_m), R_d, gains)
        return np.einsum("iak,ia->k", pose.tip_jacobian_m, force)

    slopes = np.array([(u(middle + 1e-5 * e) - u(middle - 1e-5 * e)) / 2e-5 for e in np.eye(9)]).T
    free = np.abs(np.linalg.eigvals(slopes / gains.B_Nms_rad[:, None])).max()
    assert 0.2 * free < fastest_rate_per_s(hand, middle, gains) < free


def test_a_loop_with_that_delay_grows_beyond_the_bound_and_decays_below_it():
    """dy/dt = -k y(t - T) in steps of T/1000: the bound k T = pi/2."""
    for share, grows in ((0.95, False), (1.05, True)):
        steps, k = 1000, share * np.pi / 2
        y = [1.0] * steps
        for i in range(steps, 40 * steps):
            y.append(y[i - 1] - k / steps * y[i - steps])
        late, early = np.abs(y[-10 * steps :]).max(), np.abs(y[10 * steps : 20 * steps]).max()
        assert (late > early) == grows


def test_the_pose_law_limits_its_own_gains(wide):
    assert turning_gain(with_control(wide[0], law=ControlLaw.POSE), wide[1]) is None


def test_check_names_a_gain_that_does_not_fit(tmp_path):
    path = tmp_path / "hand.toml"
    for f_d_N, warns in ((4.0, False), (8.0, True)):
        path.write_text(HAND.read_text().replace("f_d_N = 4.0", f"f_d_N = {f_d_N}"))
        result = CliRunner().invoke(cli, ["check", "--config", str(path), "--offline"])
        assert result.exit_code == 0, result.output
        assert ("warning: the grasp may oscillate: control.f_d_N = 8" in result.output) == warns
        assert "times as much is stable at 100 ticks a second" in result.output
