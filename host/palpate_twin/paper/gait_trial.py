"""A large turn by finger gaiting in MuJoCo: the law alone, 1000 times a second, with delayed contacts.

The object's pose when the hand has grasped it is given to the planner, as a camera or a fixture would give
it; from then on the law knows joint angles and contacts alone. All errors are those of the true object.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np

from palpate_edge.common.arrays import Array
from palpate_host.common import rotation
from palpate_host.common.gait_plan import GaitPlan
from palpate_host.common.mode import Mode
from palpate_host.config.hand_config import HandConfig
from palpate_host.control.gait.finger_reach import FingerReach, ObjectPath
from palpate_host.control.gait.gait import GaitPhase
from palpate_host.control.gait.object_shape import shape_of
from palpate_host.control.gait.turn_planner import plan_turn
from palpate_host.control.kinematics import HandKinematics, HandPose
from palpate_host.control.manipulation import Manipulation
from palpate_host.control.virtual_frame import virtual_frame
from palpate_host.service.host import load_hand
from palpate_twin.hand.engine import Engine, LostGraspError
from palpate_twin.paper.delayed_contacts import DelayedContacts
from palpate_twin.paper.trial import TICK_S, trial_contacts, trial_setup
from palpate_twin.paper.trial_parameters import Trial

HELD_S = 1.0
"""Time from the start until the turn is planned: by then the hand holds the object."""
AFTER_S = 1.0
"""Time from the end of the turn to the measurement."""
MOST_S = 120.0
DROPPED_M = 0.05
START_SHIFT_M = 0.0015
NOT_OVER = "gait not over in time"


@dataclass(frozen=True, slots=True)
class GaitOutcome:
    """Result of one run.

    error_deg, moved_mm: the object's orientation from the commanded one, and its centre of mass from where it
    was. moved_most_mm: the same on the way. slip_mm: longest path of a tip on the object. normal_N: largest
    normal force of a tip. duration_s: of the turn. problem: why it ended early, empty if it did not.
    """

    plan: GaitPlan
    regrasped: int
    error_deg: float
    moved_mm: float
    moved_most_mm: float
    slip_mm: float
    normal_N: float
    duration_s: float
    problem: str = ""
    is_dropped: bool = False


class GaitMeasurement:
    """The true object and tips from the moment of its creation on."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self._start_R, self._start_m = engine.object_rotation, engine.object_position_m
        self._slip_m, self._moved_most_m, self._normal_N = engine.slip_m.copy(), 0.0, 0.0
        self.is_dropped = False

    @property
    def _moved_m(self) -> float:
        return rotation.norm(self._engine.object_position_m - self._start_m)

    def note(self) -> None:
        """Take the present state of the engine."""
        self._moved_most_m = max(self._moved_most_m, self._moved_m)
        self.is_dropped = self.is_dropped or self._moved_m > DROPPED_M
        touching = [one.normal_force_N for one in self._engine.tip_contacts() if one is not None]
        self._normal_N = max(self._normal_N, *touching, 0.0)

    def outcome(
        self, plan: GaitPlan, turn: Array, regrasped: int, duration_s: float, problem: str
    ) -> GaitOutcome:
        """Return the result of a turn by `turn` (3, 3) that took duration_s."""
        return GaitOutcome(
            plan=plan,
            regrasped=regrasped,
            error_deg=rotation.angle_deg(turn @ self._start_R @ self._engine.object_rotation.T),
            moved_mm=1e3 * self._moved_m,
            moved_most_mm=1e3 * self._moved_most_m,
            slip_mm=1e3 * float((self._engine.slip_m - self._slip_m).max()),
            normal_N=self._normal_N,
            duration_s=duration_s,
            problem=problem,
            is_dropped=self.is_dropped,
        )


def run_gait(hand_toml: Path, axis: Array, angle_deg: float, trial: Trial) -> GaitOutcome:
    """Run one turn by an angle about an axis (3,) of the hand; the same arguments give the same bits.

    Raises GaitRefusedError when the turn cannot be planned.
    """
    loaded, hand = load_hand(hand_toml)
    config, engine = trial_setup(shifted(loaded, trial.seed), "mujoco", trial)
    return GaitRun(config, hand, engine, trial).run(axis, math.radians(angle_deg))


def shifted(config: HandConfig, seed: int) -> HandConfig:
    """Return the hand with the object up to `START_SHIFT_M` away along each axis."""
    if config.twin is None:
        return config
    grasped = config.twin.object
    x, y, z = grasped.position_m + START_SHIFT_M * np.random.default_rng(seed).uniform(-1.0, 1.0, 3)
    grasped = msgspec.structs.replace(grasped, position_m=(float(x), float(y), float(z)))
    return msgspec.structs.replace(config, twin=msgspec.structs.replace(config.twin, object=grasped))


class GaitRun:
    """State of one run: engine, controller and delayed contacts."""

    def __init__(self, config: HandConfig, hand: HandKinematics, engine: Engine, trial: Trial) -> None:
        self._config, self._hand, self._engine, self._trial = config, hand, engine, trial
        self.control = Manipulation(config)
        self._contacts = DelayedContacts(engine, hand, trial, trial_contacts(config, trial), HELD_S)
        self._ticks = 0

    @property
    def time_s(self) -> float:
        """The simulated time since the start."""
        return self._ticks * TICK_S

    def run_until(self, end_s: float) -> None:
        """Simulate up to this time since the start."""
        while self._ticks < round(end_s / TICK_S):
            self._tick()

    def run(self, axis: Array, angle_rad: float) -> GaitOutcome:
        """Grasp, plan, turn, and hold for `AFTER_S`."""
        engine, control = self._engine, self.control
        self.run_until(HELD_S)
        if self._trial.has_weight:
            engine.remove_support()
        plan = self.plan(axis, angle_rad)
        measured = GaitMeasurement(engine)
        control.start_gait(plan)
        assert control.gait is not None
        gait, begin, end = control.gait, self._ticks, None
        while end is None or self._ticks < end + round(AFTER_S / TICK_S):
            self._tick()
            measured.note()
            if end is None and gait.is_over:
                end = self._ticks
            if measured.is_dropped or self._ticks - begin > MOST_S / TICK_S:
                break
        return measured.outcome(
            plan,
            rotation.exp(angle_rad * axis),
            gait.regrasped,
            TICK_S * ((self._ticks if end is None else end) - begin),
            "" if gait.phase is GaitPhase.DONE else gait.reason or NOT_OVER,
        )

    def plan(self, axis: Array, angle_rad: float) -> GaitPlan:
        """Return the plan from the present grasp; the law then follows the object's centre of mass."""
        law, engine = self.control.pose_law, self._engine
        if law is None or law.object is None:
            raise LostGraspError(
                "the hand did not grasp the object within a second: correct twin.start_pose_rad"
            )
        law.follow_point(engine.object_position_m)
        R, config = law.object.R, self._config
        shape = shape_of(engine.twin.prism.all_faces_m()).moved(R.T @ engine.object_rotation, np.zeros(3))
        depth_m = config.control.tip_radius_m - float(law.object.radius_m.mean())
        return plan_turn(
            FingerReach(self._hand, config, depth_m),
            shape,
            ObjectPath(law.object.place_m, R, axis),
            engine.q_rad,
            angle_rad,
            config.pose_law.friction,
        )

    def _tick(self) -> None:
        now_s, engine = self._ticks * TICK_S, self._engine
        pose: HandPose = self._hand.pose(engine.q_rad)
        self._contacts.expose(now_s, pose, may_lift=True)
        self._contacts.deliver(now_s, self.control)
        # B qdot acts in the simulated joints.
        no_velocity = np.zeros(self._hand.joint_count)
        R_vir = virtual_frame(pose.tip_centre_m)
        torque_Nm = self.control.torque_Nm(Mode.MANIPULATE, pose, no_velocity, R_vir, TICK_S)
        for _ in range(round(TICK_S / engine.step_s)):
            engine.step(torque_Nm)
        self._ticks += 1
