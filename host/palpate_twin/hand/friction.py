"""Engine two: the same hand and object with MuJoCo's contacts, so that tips may slip.

MuJoCo finds the contacts, their friction and the motion. What makes the tips those of the paper:

- softness, Eq. (8): a contact's damper is xi, and its spring is set before each step to the secant k Delta r,
  so that the force at rest is k Delta r^2. MuJoCo's impedance d adds d/(1 - d) of the contact's effective
  mass to the normal motion; 0.5 adds once the 3.5 g of it and keeps xi stable in steps of 0.5 ms.
- the contact stands on the object's face, as x_i does, not in the middle of the overlap.
- torsion, Eq. (7): a viscous moment about the normal.
- creep: MuJoCo's friction is a damper. impratio makes it a hundred times harder, the iterations without slip
  (noslip) take the rest away; alone, these would leave the normal forces 5 % off.
- the ends of the joints' ranges are as hard as the step allows: light links sink 0.1 rad into MuJoCo's own.
"""

from __future__ import annotations

import mujoco
import numpy as np
import numpy.typing as npt

from palpate_edge.common.arrays import Array
from palpate_twin.hand.engine import BRAKE_KGM2, STEP_S, TipTouch
from palpate_twin.hand.twin_model import TwinModel

IMPEDANCE = 0.5
NOSLIP_ITERATIONS = 5
CONTACT_ROWS = 3  # of a contact among the constraints, which end with the contacts: normal, two tangents
IMPRATIO = 100.0
HARDEST_STEPS = 2.0  # the shortest time constant of a constraint that MuJoCo keeps stable, in steps


class FrictionHand:
    """Hand and object; `step` moves them on. MuJoCo's data is the state."""

    def __init__(self, twin: TwinModel, step_s: float = STEP_S) -> None:
        """`twin` made with contacts."""
        self.twin, self.step_s = twin, step_s
        model = twin.model
        model.opt.timestep = step_s
        model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        model.opt.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
        model.opt.noslip_iterations = NOSLIP_ITERATIONS
        model.opt.impratio = IMPRATIO
        model.dof_damping[twin.v_address] = twin.damping_Nms_rad
        model.pair_solimp[:, :2] = IMPEDANCE
        model.jnt_solref[:, 0] = HARDEST_STEPS * step_s
        self.data = twin.start()
        self.slip_m = np.zeros(3)
        self._braked = twin.v_address[:0]
        self._tip_of_geom = np.full(model.ngeom, -1)
        self._tip_of_geom[list(twin.tip_geoms)] = np.arange(3)
        self._tip_bodies = model.geom_bodyid[list(twin.tip_geoms)]
        # With |solref| = K (1 - d) A a contact of effective inverse mass A has the stiffness K.
        inverse_mass = model.body_invweight0[self._tip_bodies, 0] + model.body_invweight0[twin.object_body, 0]
        scale = (1.0 - IMPEDANCE) * inverse_mass
        self._hardness = twin.twin.tip.k_N_m2 * scale
        # A pair a tip, in their order; the first number is set before each step.
        model.pair_solref[:, 0], model.pair_solref[:, 1] = -1.0, -twin.twin.tip.xi_Ns_m * scale
        self._force = np.zeros(6)

    @property
    def time_s(self) -> float:
        return float(self.data.time)

    @property
    def q_rad(self) -> Array:
        return np.asarray(self.data.qpos[self.twin.q_address])

    @property
    def qdot_rad_s(self) -> Array:
        return np.asarray(self.data.qvel[self.twin.v_address])

    @property
    def object_rotation(self) -> Array:
        rotation = np.zeros(9)
        start = self.twin.object_q + 3
        mujoco.mju_quat2Mat(rotation, self.data.qpos[start : start + 4])
        return rotation.reshape(3, 3)

    @property
    def object_position_m(self) -> Array:
        start = self.twin.object_q
        return np.array(self.data.qpos[start : start + 3])

    def brake(self, is_braked: npt.NDArray[np.bool_]) -> None:
        twin = self.twin
        self._braked = twin.v_address[is_braked]
        twin.model.dof_armature[twin.v_address] = twin.twin.armature_kgm2 + BRAKE_KGM2 * is_braked

    def take_support_away(self) -> None:
        self.twin.model.body_gravcomp[self.twin.object_body] = 0.0

    def touches(self) -> tuple[TipTouch | None, ...]:
        """As the last step found them."""
        contact, force = self.data.contact, self._force
        points_m = contact.pos.copy()
        found: list[TipTouch | None] = [None, None, None]
        for row, tip in enumerate(self._tip_of_geom[contact.geom1].tolist()):
            mujoco.mj_contactForce(self.twin.model, self.data, row, force)
            on_object_N = force[1:3] @ contact.frame[row, 3:].reshape(2, 3)
            found[tip] = TipTouch(points_m[row], float(force[0]), -on_object_N)
        return tuple(found)

    def step(self, torque_Nm: Array) -> None:
        """MuJoCo's own step, taken apart so that contacts can be made soft before they bear."""
        model, data = self.twin.model, self.data
        if self._braked.size:
            data.qvel[self._braked] = 0.0
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_makeM(model, data)
        mujoco.mj_factorM(model, data)
        mujoco.mj_collision(model, data)
        data.qfrc_applied[self.twin.v_address] = torque_Nm
        contact = data.contact
        tips, normal = self._tip_of_geom.take(contact.geom1), contact.frame[:, :3]
        self._soften(tips, normal)
        mujoco.mj_makeConstraint(model, data)
        mujoco.mj_projectConstraint(model, data)
        mujoco.mj_fwdVelocity(model, data)
        self._resist_twist(normal, self._tip_bodies[tips])
        mujoco.mj_fwdActuation(model, data)
        mujoco.mj_fwdAcceleration(model, data)
        mujoco.mj_fwdConstraint(model, data)
        rows = data.efc_vel[data.nefc - CONTACT_ROWS * len(tips) :].reshape(-1, CONTACT_ROWS)
        self.slip_m[tips] += self.step_s * np.hypot(rows[:, 1], rows[:, 2])
        mujoco.mj_implicit(model, data)

    def _soften(self, tips: npt.NDArray[np.int64], normal: Array) -> None:
        """Eq. (8). A contact's first geom is the tip (spheres precede meshes): its normal is C_iY."""
        contact = self.data.contact
        deep_m = contact.dist  # -Delta r
        contact.solref[:, 0] = self._hardness[tips] * deep_m
        contact.pos[:] += (0.5 * deep_m)[:, None] * normal

    def _resist_twist(self, normal: Array, bodies: npt.NDArray[np.int32]) -> None:
        """Eq. (7), as moments on the bodies of the touching tips and on the object."""
        thing, turning, applied = self.twin.object_body, self.data.cvel, self.data.xfrc_applied
        twist = np.vecdot(normal, (turning.take(bodies, axis=0) - turning[thing])[:, :3])
        moment = (-self.twin.twin.tip.b_Nms * twist)[:, None] * normal
        applied[:] = 0.0
        applied[bodies, 3:] = moment
        applied[thing, 3:] = -np.add.reduce(moment)
