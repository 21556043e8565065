"""The paper's experiment: grasp an object, then turn it, with delayed contacts at 30 Hz.

The controller is the host's (`manipulation.Manipulation`), without bus and drives: it computes u of Eq. (9)
in every tick from contacts that arrive `delay_s` after their exposure. The damping -B qdot of Eq. (10) is
part of the simulated joints, where it is continuous as in the paper; a sampled damping would oscillate on
Table 3's light links.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_host.common import rotation
from palpate_host.common.mode import Mode
from palpate_host.config.control_config import ControlMode
from palpate_host.config.hand_config import HandConfig
from palpate_host.control.kinematics import HandKinematics
from palpate_host.control.manipulation import Manipulation
from palpate_host.control.virtual_frame import virtual_frame
from palpate_host.service.host import load_hand
from palpate_twin.closed_loop.tactile_rendering import ContactSource, TrueContactSource
from palpate_twin.hand.engine import Engine, LostGraspError
from palpate_twin.hand.friction import FrictionHand
from palpate_twin.hand.rolling import RollingHand
from palpate_twin.hand.twin_model import TwinModel, twin_model
from palpate_twin.paper.delayed_contacts import DelayedContacts
from palpate_twin.paper.trial_parameters import Trial, after, trial_config, with_disturbances

TICK_S = 1e-3
RECORD_S = 0.02
SLID_M = 1e-3
ENGINES: dict[str, Callable[[TwinModel], Engine]] = {"eqs": RollingHand, "mujoco": FrictionHand}


@dataclass(frozen=True, slots=True)
class Outcome:
    """Result of one run.

    time_s: (n,), 0 at the start of the turn; rpy_deg: (n, 3) rotation of the object since then; poses: (n)
    its rotation and position in the hand frame. error_deg: final angle between true and desired orientation.
    slip_mm: (n,) sliding distance of each tip since the start of the turn. friction_ratio: largest ratio of
    tangential to normal force. energy_error: spurious energy divided by the dissipated energy (engine eqs
    only). lost_s: time at which the object was lost, which ends the run; None if it was held to the end.
    slid_s: first time at which a tip had slid by SLID_M, None without. normal_N: largest normal force of a
    tip. slips: number of slips that the host has answered.
    """

    trial: Trial
    time_s: Array
    rpy_deg: Array
    poses: tuple[tuple[Array, Array], ...]
    error_deg: float
    slip_mm: Array
    friction_ratio: float
    energy_error: float | None
    lost_s: float | None = None
    slid_s: float | None = None
    normal_N: float = 0.0
    slips: int = 0


def make_engine(config: HandConfig, name: str, *, has_B: bool = True) -> Engine:
    """Create an engine: ``eqs`` (Eqs. (4)-(8)) or ``mujoco`` (frictional contacts). The object has no weight.

    has_B: the simulated joints have the damping B of Eq. (10).
    """
    return ENGINES[name](twin_model(config, with_contacts=name == "mujoco", has_B=has_B))


def run_trial(hand_toml: Path, engine_name: str, trial: Trial) -> Outcome:
    """Run one trial; the same arguments give the same bits.

    Raises LostGraspError if the object is lost before the turn.
    """
    loaded, hand = load_hand(hand_toml)
    config, engine = trial_setup(loaded, engine_name, trial)
    return TrialRun(config, hand, engine, trial, trial_contacts(config, trial)).run()


def trial_contacts(config: HandConfig, trial: Trial) -> TrueContactSource:
    """Return the true contacts with the noise and the slip flag of a trial."""
    return TrueContactSource(
        1e3 * config.control.tip_radius_m,
        trial.noise_mm,
        trial.seed,
        trial.force_noise,
        sees_slip=trial.sees_slip,
    )


def trial_setup(config: HandConfig, engine_name: str, trial: Trial) -> tuple[HandConfig, Engine]:
    """Return the hand with the trial's parameters, and the engine with its disturbances."""
    config = trial_config(config, trial)
    config = with_disturbances(config, after(trial.disturbances, config.control.settle_ms * 1e-3))
    return config, make_engine(config, engine_name)


class TrialRun:
    """State of one run: engine, controller and delayed contacts."""

    def __init__(
        self,
        config: HandConfig,
        hand: HandKinematics,
        engine: Engine,
        trial: Trial,
        contacts: ContactSource,
    ) -> None:
        self._hand, self._engine, self._trial = hand, engine, trial
        self._control = Manipulation(config)
        self._settle_s, self._ramp_s = config.control.settle_ms * 1e-3, config.target.ramp_s
        self._contacts = DelayedContacts(engine, hand, trial, contacts, self._settle_s)

    def run(self) -> Outcome:
        """Run to the end of the trial, or until the object is lost."""
        engine, trial = self._engine, self._trial
        ticks = round((self._settle_s + trial.duration_s) / TICK_S)
        settle_ticks, record_ticks = round(self._settle_s / TICK_S), round(RECORD_S / TICK_S)
        start = energy = None
        slip_m, ratio = np.zeros(len(engine.slip_m)), 0.0
        poses: list[tuple[Array, Array]] = []
        lost_s = slid_s = None
        normal_N = 0.0
        for tick in range(ticks + 1):
            now_s = tick * TICK_S
            if tick == settle_ticks:
                start, slip_m = engine.object_rotation, engine.slip_m.copy()
                energy = self._energy()
                if trial.has_weight:
                    engine.remove_support()
            try:
                if tick >= settle_ticks and (tick - settle_ticks) % record_ticks == 0:
                    ratio = max(ratio, self._friction_ratio())
                    normal_N = max(normal_N, self._normal_N())
                    if slid_s is None and float((engine.slip_m - slip_m).max()) > SLID_M:
                        slid_s = now_s - self._settle_s
                    poses.append((engine.object_rotation, engine.object_position_m))
                torque = self._torque_Nm(now_s, turning=tick >= settle_ticks)
            except LostGraspError:
                if start is None:
                    raise
                lost_s = now_s - self._settle_s
                break
            if tick == settle_ticks and any(trial.xyz_mm):
                self._control.move(trial.xyz_mm, trial.rpy_deg, self._ramp_s)
            for _ in range(round(TICK_S / engine.step_s)):
                engine.step(torque)
        assert start is not None
        turns = [rotation.to_rpy_deg(R @ start.T) for R, _ in poses]
        goal = rotation.from_rpy_deg(*trial.rpy_deg) @ start
        return Outcome(
            trial=trial,
            time_s=np.asarray(RECORD_S * np.arange(len(poses))),
            rpy_deg=np.array(turns),
            poses=tuple(poses),
            error_deg=rotation.angle_deg(goal @ poses[-1][0].T),
            slip_mm=1e3 * (engine.slip_m - slip_m),
            friction_ratio=ratio,
            energy_error=self._energy_error(energy),
            lost_s=lost_s,
            slid_s=slid_s,
            normal_N=normal_N,
            slips=max(tip.slips for tip in self._control.friction.tips),
        )

    def _torque_Nm(self, now_s: float, turning: bool) -> Array:
        pose = self._hand.pose(self._engine.q_rad)
        self._contacts.expose(now_s, pose)
        self._contacts.deliver(now_s, self._control)
        mode = Mode.HOLD
        if turning:
            mode = Mode.BLIND if self._trial.mode is ControlMode.BLIND else Mode.MANIPULATE
        # B qdot acts in the simulated joints.
        no_velocity = np.zeros(self._hand.joint_count)
        return self._control.torque_Nm(mode, pose, no_velocity, virtual_frame(pose.tip_centre_m), TICK_S)

    def _friction_ratio(self) -> float:
        loaded = [one for one in self._engine.tip_contacts() if one is not None and one.normal_force_N > 0.0]
        ratios = [float(np.linalg.norm(contact.friction_N)) / contact.normal_force_N for contact in loaded]
        return max(ratios, default=0.0)

    def _normal_N(self) -> float:
        loaded = [one.normal_force_N for one in self._engine.tip_contacts() if one is not None]
        return max(loaded, default=0.0)

    def _energy(self) -> tuple[float, float, float] | None:
        engine = self._engine
        if not isinstance(engine, RollingHand):
            return None
        return engine.energy_J(), engine.account.work_J, engine.account.dissipated_J

    def _energy_error(self, start: tuple[float, float, float] | None) -> float | None:
        now = self._energy()
        if now is None or start is None:
            return None
        energy, work, dissipated = (after - before for after, before in zip(now, start, strict=True))
        return (energy - work + dissipated) / dissipated
