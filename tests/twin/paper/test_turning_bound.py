"""The bound of the paper's turning gain in the whole chain: it oscillates beyond, and holds as advised."""

import re

import msgspec
import numpy as np
import pytest

from palpate_host.common import rotation
from palpate_host.control.turning_stability import turning_gain
from palpate_host.service.host import load_hand
from palpate_twin.cli.options import PACKAGED
from palpate_twin.closed_loop.lockstep import LockstepLoop, turning_samples
from palpate_twin.closed_loop.tactile_rendering import TrueContactSource
from palpate_twin.paper.trial import make_engine

OBSERVED_S = 3.0


def control_of(config, **changes):
    return msgspec.structs.replace(
        config,
        control=msgspec.structs.replace(config.control, integral_per_s=1.0, **changes),
        target=msgspec.structs.replace(config.target, rpy_deg=(0.0, 0.0, 0.0)),
    )


def held(config, hand):
    """Hold the object for a while; nothing pushes. Return its ringing in deg and its slip in mm.

    The ringing is the largest standard deviation of the rotation in half a second: beyond the bound the
    amplitude rises and falls irregularly.
    """
    engine = make_engine(config, "mujoco", has_B=False)
    loop = LockstepLoop(config, hand, engine, TrueContactSource(30.0, 0.15, 1))
    loop.run(1.0)
    loop.run(OBSERVED_S)
    turning = turning_samples(loop.record)
    R_0 = turning[0].object_rotation
    angles = np.array([rotation.angle_deg(sample.object_rotation @ R_0.T) for sample in turning])
    ringing_deg = max(float(part.std()) for part in np.array_split(angles, round(OBSERVED_S / 0.5)))
    return ringing_deg, 1e3 * float(engine.slip_m.max())


@pytest.mark.slow
@pytest.mark.parametrize("name", ["table4-wide", "table4"])
def test_the_bound_is_that_of_the_twin(name):
    """Twice the shipped grasp rings by degrees and slips; the advised K_r and the advised tick hold it."""
    config, hand = load_hand(PACKAGED[name])
    f_d_N = 2.0 * config.control.f_d_N
    strong = control_of(config, f_d_N=f_d_N)
    gain = turning_gain(strong, hand)
    assert gain is not None
    assert not gain.is_stable
    assert held(strong, hand)[0] > 1.0
    K_r, tick_Hz = (float(re.search(rf"{key} to ([0-9.]+)", gain.warning)[1]) for key in ("K_r", "tick_Hz"))
    for changes in ({"K_r": K_r}, {"tick_Hz": int(tick_Hz)}):
        ringing_deg, slip_mm = held(control_of(config, f_d_N=f_d_N, **changes), hand)
        assert ringing_deg < 0.15
        assert slip_mm < 0.3
