"""Time of one tick of a turn by finger gaiting, against one of the pose law alone, and of its plan."""

from __future__ import annotations

import math
import time

import numpy as np

from bench.timing import Row, table
from palpate_edge.common.arrays import Array
from palpate_host.config.control_config import ControlMode
from palpate_host.control.gait.gait import GaitPhase
from palpate_host.service.host import load_hand
from palpate_twin.cli.options import PACKAGED
from palpate_twin.paper.gait_trial import HELD_S, GaitRun
from palpate_twin.paper.trial import trial_setup
from palpate_twin.paper.trial_parameters import Trial

HELD_TICKS_S, ANGLE_DEG = 1.0, 40.0
LIFTED = (GaitPhase.LIFT, GaitPhase.CARRY, GaitPhase.APPROACH)


def report() -> str:
    """Return the table, and the time of the plan."""
    config, hand = load_hand(PACKAGED["table4-four"])
    trial = Trial(ControlMode.PROPOSED, (0.0, 0.0, 0.0), noise_mm=0.15)
    config, engine = trial_setup(config, "mujoco", trial)
    run = GaitRun(config, hand, engine, trial)
    run.run_until(HELD_S)
    durations: list[tuple[GaitPhase | None, float]] = []
    law = run.control.torque_Nm

    def timed(*arguments: object) -> Array:
        begin = time.thread_time()
        torque_Nm = law(*arguments)  # type: ignore[arg-type]
        seconds = time.thread_time() - begin
        durations.append((None if run.control.gait is None else run.control.gait.phase, seconds))
        return torque_Nm

    run.control.torque_Nm = timed  # type: ignore[method-assign, assignment]
    run.run_until(HELD_S + HELD_TICKS_S)
    begin = time.thread_time()
    plan = run.plan(np.array([0.0, 0.0, 1.0]), math.radians(ANGLE_DEG))
    plan_s = time.thread_time() - begin
    run.control.start_gait(plan)
    while run.control.gait is not None and not run.control.gait.is_over:
        run.run_until(run.time_s + 0.1)
    rows = [
        Row("pose law", np.array([one for phase, one in durations if phase is None])),
        Row(
            "turn by gaiting, a finger lifted", np.array([one for phase, one in durations if phase in LIFTED])
        ),
    ]
    title = "One tick, 4 fingers x 3 joints, processor time, without kinematics"
    return (
        f"{table(title, rows)}\nplan of {ANGLE_DEG:g} deg about z, {plan.regrasps} regrasps: {plan_s:.1f} s"
    )
