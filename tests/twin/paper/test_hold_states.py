"""A hold in the whole chain, in virtual time: a weight is learned, an object pulled away is a fault."""

import msgspec
import numpy as np

from palpate_host.common.mode import Mode
from palpate_host.config.control_config import ControlLaw
from palpate_host.config.twin_config import DisturbanceConfig
from palpate_host.service.host import load_hand
from palpate_twin.cli.options import PACKAGED
from palpate_twin.closed_loop.lockstep import LockstepLoop
from palpate_twin.closed_loop.tactile_rendering import TrueContactSource
from palpate_twin.paper.shake import lifted
from palpate_twin.paper.trial import make_engine

START_S = 1.0


def loop_with(disturbances, **pose_law):
    """The whole chain of table4-wide under the pose law, held; and the statuses of its ticks."""
    config, hand = load_hand(PACKAGED["table4-wide"])
    later = tuple(msgspec.structs.replace(one, start_s=one.start_s + START_S) for one in disturbances)
    config = msgspec.structs.replace(
        config,
        control=msgspec.structs.replace(config.control, law=ControlLaw.POSE),
        pose_law=msgspec.structs.replace(config.pose_law, **pose_law),
        target=msgspec.structs.replace(config.target, rpy_deg=(0.0, 0.0, 0.0)),
        twin=msgspec.structs.replace(config.twin, disturbances=later),
    )
    statuses = []
    engine = make_engine(config, "mujoco", has_B=False)
    loop = LockstepLoop(
        *(config, hand, engine, TrueContactSource(30.0, 0.15, 1, 0.03)), on_tick=statuses.append
    )
    loop.run(START_S + 0.5)
    assert loop.status is not None
    assert loop.status.hold is not None
    assert loop.status.hold.is_load_known
    return loop, engine, statuses


def test_an_unknown_weight_is_learned_within_a_second():
    """0.3 kg lifted within a second: the object sinks by 2 mm at most."""
    loop, engine, statuses = loop_with(lifted(0.3, 0.5))
    start_m, seen = engine.object_position_m, len(statuses)
    loop.run(1.0)
    sunk_mm = 1e3 * (start_m - engine.object_position_m)[2]
    warnings = {status.warning for status in statuses[seen:]}
    assert any("weight unknown" in warning for warning in warnings)
    assert 0.0 < sunk_mm < 2.0
    loop.run(1.0)
    hold = loop.status.hold
    assert hold.is_load_known
    np.testing.assert_allclose(hold.load_N, [0.0, 0.0, 0.3 * 9.81], atol=0.15)
    assert 1e3 * abs((start_m - engine.object_position_m)[2]) < 0.3


def test_an_object_that_is_pulled_away_is_a_fault():
    """5 N along -z: the hand ends the hold at twice the workspace."""
    loop, _, statuses = loop_with([DisturbanceConfig(start_s=0.6, force_N=(0.0, 0.0, -5.0))], reach_mm=3.0)
    loop.run(1.0)
    modes = [status.mode for status in statuses]
    assert modes[-1] is Mode.FAULT
    first = next(status for status in statuses if status.mode is Mode.FAULT)
    assert first.reason.startswith("the object is far beyond the workspace, pose_law.reach_mm = 3")
    before = statuses[modes.index(Mode.FAULT) - 1]
    assert "the object is beyond the workspace" in before.warning
