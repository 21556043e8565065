"""A large turn by finger gaiting in the whole chain: host core, bus, nodes and drives in lock step.

The host gets the command that an operator gives, with the corners of the object where it is then, plans and
carries it out within the supervisor's limits. All errors are those of the true object.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import msgspec
import numpy as np

from palpate_edge.common.arrays import Array
from palpate_host.common import rotation
from palpate_host.common.command import CommandError, Reorient
from palpate_host.common.mode import Mode
from palpate_host.common.status import HoldStatus, HostStatus
from palpate_host.service.host import load_hand
from palpate_twin.closed_loop.lockstep import LockstepLoop
from palpate_twin.hand.engine import Engine, LostGraspError
from palpate_twin.paper.gait_trial import (
    AFTER_S,
    MOST_S,
    NOT_OVER,
    GaitMeasurement,
    GaitOutcome,
    shifted,
)
from palpate_twin.paper.trial import make_engine, trial_contacts
from palpate_twin.paper.trial_parameters import Trial, trial_config

HELD_S = 2.5
"""Time from the start to the command: by then the hand holds the object, and has learned its weight."""
RAMP_S = 0.5
CORNER_DIGITS = 2
OVER = ("done", "stopped", "refused")


def run_gait_in_chain(hand_toml: Path, rpy_deg: tuple[float, float, float], trial: Trial) -> GaitOutcome:
    """Run one turn by the command `Reorient`; the same arguments give the same bits.

    Raises CommandError when the turn cannot be planned, LostGraspError when the object was not held.
    """
    loaded, hand = load_hand(hand_toml)
    config = trial_config(shifted(loaded, trial.seed), trial)
    config = msgspec.structs.replace(config, target=msgspec.structs.replace(config.target, ramp_s=RAMP_S))
    engine = make_engine(config, "mujoco", has_B=False)
    holds: list[HoldStatus] = []
    measured: GaitMeasurement | None = None

    def note(status: HostStatus) -> None:
        if status.hold is not None:
            holds.append(status.hold)
        if measured is not None:
            measured.note()

    contacts = trial_contacts(config, trial)
    loop = LockstepLoop(config, hand, engine, contacts, trial.has_weight, on_tick=note)
    loop.run(HELD_S)
    if loop.status is None or loop.status.mode is not Mode.MANIPULATE:
        raise LostGraspError("the hand did not grasp the object: correct twin.start_pose_rad")
    measured = GaitMeasurement(engine)
    holds.clear()
    loop.host.command(Reorient(rpy_deg, corners_mm(engine)))
    loop.run_until(_is_over, MOST_S)
    last, reason = holds[-1], loop.status.reason
    if loop.planned is None or loop.planned.plan is None:
        raise CommandError(last.gait_reason or reason)
    lifted = [hold.lifted for hold in holds]
    regrasped = sum(was is not None and now is None for was, now in pairwise(lifted))
    turning = [hold for hold in holds if hold.gait not in (None, "planning", *OVER)]
    duration_s = len(turning) / config.control.tick_Hz
    loop.run(AFTER_S)
    problem = "" if last.gait == "done" else last.gait_reason or reason or NOT_OVER
    return measured.outcome(
        loop.planned.plan, rotation.from_rpy_deg(*rpy_deg), regrasped, duration_s, problem
    )


def _is_over(status: HostStatus) -> bool:
    gait = None if status.hold is None else status.hold.gait
    return gait in OVER or status.mode is Mode.FAULT


def corners_mm(engine: Engine) -> tuple[tuple[float, float, float], ...]:
    """Return the corners of the true object in the hand's frame, as a camera or a fixture would give them."""
    corners_m: Array = engine.twin.prism.vertices_m @ engine.object_rotation.T + engine.object_position_m
    rounded = np.round(1e3 * corners_m, CORNER_DIGITS).tolist()
    return tuple((x, y, z) for x, y, z in rounded)
