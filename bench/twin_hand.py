"""Processor time per step of the simulated hand and object, and of the paper's run."""

from __future__ import annotations

import time
from pathlib import Path

import mujoco
import numpy as np

import palpate_host
from bench.timing import Row, table, time_each
from palpate_host.control.control_law import joint_torque_Nm
from palpate_host.control.gains import gains_of
from palpate_host.service.host import load_hand
from palpate_twin.hand.engine import Engine
from palpate_twin.paper.figure_data import Law
from palpate_twin.paper.trial import ENGINES, make_engine, run_trial

MODELS = Path(palpate_host.__file__).parent / "models"
STEPS = 400
PAPER_S = 10.0
NAMES = {"eqs": "Eqs. (4)-(8)", "mujoco": "MuJoCo with friction"}


def report() -> str:
    """Return the table of steps, and the time of the paper's run."""
    steps = table("The twin's hand and object, steps of 0.5 ms, processor time", rows())
    return f"{steps}\n\n{_paper_runs()}"


def rows() -> list[Row]:
    """Return the times of steps of both grasping hands with both engines; the first row is the reference."""
    found: list[Row] = []
    for hand_name in ("table3", "table4"):
        config, hand = load_hand(MODELS / f"{hand_name}.toml")
        for engine_name in ENGINES:
            engine = make_engine(config, engine_name)
            u = joint_torque_Nm(
                hand.pose(engine.q_rad), np.zeros(hand.joint_count), None, None, gains_of(config)
            )
            if not found:
                found.append(Row("M, C and g of 3 x 5 joints and object (MuJoCo)", _times(_terms(engine))))
            found.append(
                Row(f"step, {hand_name}, {NAMES[engine_name]}", _times(lambda e=engine, u=u: e.step(u)))
            )
    return found


def _paper_runs() -> str:
    """Return the processor time of one run of Fig. 17 as text."""
    lines = [f"The paper's run of {PAPER_S:g} s, 30 deg of yaw, processor time"]
    for engine_name, name in NAMES.items():
        begin = time.process_time()
        run_trial(MODELS / "table3.toml", engine_name, Law.PROPOSED.trial(2, PAPER_S, 0.0, 1))
        lines.append(f"table3, {name:22s} {time.process_time() - begin:6.1f} s")
    return "\n".join(lines)


def _terms(engine: Engine):
    model, data = engine.twin.model, engine.data
    M, bias = np.zeros((model.nv, model.nv)), np.zeros(model.nv)

    def terms() -> None:
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_makeM(model, data)
        mujoco.mj_fullM(model, data, M)
        mujoco.mj_comVel(model, data)
        mujoco.mj_rne(model, data, 0, bias)

    return terms


def _times(call) -> np.ndarray:
    return time_each(lambda _: call(), range(STEPS), time.thread_time)
