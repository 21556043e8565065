"""The onset of slip in the whole chain, in virtual time: from the flagged frame to the force."""

import dataclasses

import msgspec
import pytest

from palpate_edge.node.fingertip_objects import ContactFlag
from palpate_host.config.control_config import ControlLaw
from palpate_host.service.host import load_hand
from palpate_twin.cli.options import PACKAGED
from palpate_twin.closed_loop.lockstep import LockstepLoop
from palpate_twin.closed_loop.tactile_rendering import TrueContactSource
from palpate_twin.paper.trial import make_engine

ANSWER_US = 30_000
SETTLE_S = 1.5


class OnsetOnce(TrueContactSource):
    """True contacts; the first one after `begin` flags the onset of slip."""

    is_due = False

    def contact(self, *which):
        found = super().contact(*which)
        begins, self.is_due = self.is_due, False
        return dataclasses.replace(found, slip_begins=begins)


def normal_N(engine):
    return sum(touch.normal_force_N for touch in engine.tip_contacts() if touch is not None)


@pytest.mark.slow
def test_the_hand_grips_harder_within_30_ms_of_the_flagged_frame():
    config, hand = load_hand(PACKAGED["table4-wide"])
    config = msgspec.structs.replace(
        config,
        control=msgspec.structs.replace(config.control, law=ControlLaw.POSE),
        pose_law=msgspec.structs.replace(config.pose_law, onset_reflex=True),
        target=msgspec.structs.replace(config.target, rpy_deg=(0.0, 0.0, 0.0)),
    )
    engine, source = make_engine(config, "mujoco", has_B=False), OnsetOnce(30.0, 0.15, 1, 0.03)
    tpdo_2 = {0x280 + finger.fingertip_node for finger in config.fingers}
    flagged_us, forces = [], []

    def note(stamp_us, frame):
        if frame.can_id in tpdo_2 and frame.data[6] & ContactFlag.SLIP_BEGINS:
            flagged_us.append(stamp_us)

    loop = LockstepLoop(
        *(config, hand, engine, source),
        on_frame=note,
        on_step=lambda now_us: forces.append((now_us, normal_N(engine))),
    )
    loop.run(SETTLE_S)
    source.is_due, settled = True, [force_N for _, force_N in forces[-200:]]
    loop.run(0.15)
    (flag_us,) = flagged_us
    answered = [force_N for at_us, force_N in forces if flag_us + ANSWER_US < at_us < flag_us + 2 * ANSWER_US]
    assert loop.status.hold.slips.count(1) == 1
    assert min(answered) > 1.2 * max(settled)
