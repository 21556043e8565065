"""Engine `mujoco`: the same hand and object with MuJoCo's contacts, so that tips can slip.

MuJoCo detects the contacts and computes friction and motion. These settings reproduce the paper's tips:

- Softness, Eq. (8): the contact's damper is xi; its spring is set before each step to the secant k Delta r,
  which gives a static force of k Delta r^2. MuJoCo's impedance d adds d/(1 - d) of the contact's effective
  mass to the normal motion; 0.5 adds that mass (3.5 g) once and keeps xi stable in steps of 0.5 ms.
- Contact point: on the object's face, as x_i, not in the middle of the overlap.
- Torsion, Eq. (7): a viscous moment about the normal.
- Creep: MuJoCo's friction is a damper. impratio makes it a hundred times stiffer, and the noslip iterations
  remove the rest; noslip alone would give normal forces with an error of 5 %.
- Joint limits: as stiff as the step allows. With MuJoCo's defaults, light links exceed them by 0.1 rad.
"""

from __future__ import annotations

import mujoco
import numpy as np
import numpy.typing as npt

from palpate_edge.common.arrays import Array
from palpate_twin.hand.disturbance import Load
from palpate_twin.hand.engine import STEP_S, EngineContact, EngineState
from palpate_twin.hand.twin_model import TwinModel

IMPEDANCE = 0.5
NOSLIP_ITERATIONS = 5
CONTACT_ROWS = 3  # rows per contact at the end of the constraints: normal and two tangents
IMPRATIO = 100.0
HARDEST_STEPS = 2.0  # shortest stable time constant of a constraint in MuJoCo, in steps


class FrictionHand(EngineState):
    """Engine with MuJoCo's frictional contacts; the state is MuJoCo's data."""

    def __init__(self, twin: TwinModel, step_s: float = STEP_S) -> None:
        """Start at the twin's start pose. twin: built with contacts."""
        model = twin.model
        model.opt.timestep = step_s
        model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        model.opt.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
        model.opt.noslip_iterations = NOSLIP_ITERATIONS
        model.opt.impratio = IMPRATIO
        model.dof_damping[twin.v_address] = twin.damping_Nms_rad
        model.pair_solimp[:, :2] = IMPEDANCE
        model.jnt_solref[:, 0] = HARDEST_STEPS * step_s
        super().__init__(twin, step_s)
        self._tip_of_geom = np.full(model.ngeom, -1)
        self._tip_of_geom[list(twin.tip_geoms)] = np.arange(len(twin.tip_geoms))
        self._tip_bodies = model.geom_bodyid[list(twin.tip_geoms)]
        # A contact of effective inverse mass A has the stiffness K if |solref| = K (1 - d) A.
        inverse_mass = model.body_invweight0[self._tip_bodies, 0] + model.body_invweight0[twin.object_body, 0]
        scale = (1.0 - IMPEDANCE) * inverse_mass
        self._stiffness_scale = twin.twin.tip.k_N_m2 * scale
        # One contact pair per tip, in their order; the first number is set before each step.
        model.pair_solref[:, 0], model.pair_solref[:, 1] = -1.0, -twin.twin.tip.xi_Ns_m * scale
        self._force = np.zeros(6)
        self._is_supported = True

    @property
    def time_s(self) -> float:
        return float(self.data.time)

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

    def remove_support(self) -> None:
        self._is_supported = False
        self.twin.model.body_gravcomp[self.twin.object_body] = 0.0

    def tip_contacts(self) -> tuple[EngineContact | None, ...]:
        """Return the contacts of the last step."""
        contact, force = self.data.contact, self._force
        points_m = contact.pos.copy()
        found: list[EngineContact | None] = [None] * len(self._tip_bodies)
        for row, tip in enumerate(self._tip_of_geom[contact.geom1].tolist()):
            mujoco.mj_contactForce(self.twin.model, self.data, row, force)
            on_object_N = force[1:3] @ contact.frame[row, 3:].reshape(2, 3)
            found[tip] = EngineContact(points_m[row], float(force[0]), -on_object_N)
        return tuple(found)

    def step(self, torque_Nm: Array) -> None:
        """Advance by one step: the stages of MuJoCo's step, with the contacts' softness set in between."""
        model, data = self.twin.model, self.data
        load = self._disturb()
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
        self._apply_wrenches(normal, self._tip_bodies[tips], load)
        mujoco.mj_fwdActuation(model, data)
        mujoco.mj_fwdAcceleration(model, data)
        mujoco.mj_fwdConstraint(model, data)
        rows = data.efc_vel[data.nefc - CONTACT_ROWS * len(tips) :].reshape(-1, CONTACT_ROWS)
        self.slip_m[tips] += self.step_s * np.hypot(rows[:, 1], rows[:, 2])
        mujoco.mj_implicit(model, data)

    def _soften(self, tips: npt.NDArray[np.int64], normal: Array) -> None:
        """Apply Eq. (8). A contact's first geom is the tip (spheres precede meshes): its normal is C_iY."""
        contact = self.data.contact
        distance_m = contact.dist  # -Delta r
        contact.solref[:, 0] = self._stiffness_scale[tips] * distance_m
        contact.pos[:] += (0.5 * distance_m)[:, None] * normal

    def _disturb(self) -> Load | None:
        """Return the load of this step; the model gets its friction and the part of the weight that acts."""
        before = self._load
        load = self._advance_load(self.time_s)
        if load is not None and load is not before:
            model, twin = self.twin.model, self.twin
            model.pair_friction[:, :2] = twin.twin.tip.friction if load.friction is None else load.friction
            carried = twin.prism.mass_kg / (twin.prism.mass_kg + load.added_mass_kg)
            model.body_gravcomp[twin.object_body] = carried if self._is_supported else 0.0
        return load

    def _apply_wrenches(self, normal: Array, bodies: npt.NDArray[np.int32], load: Load | None) -> None:
        """Apply Eq. (7) as moments on the touching tips and on the object, and the load on the object."""
        grasped, velocity, applied = self.twin.object_body, self.data.cvel, self.data.xfrc_applied
        twist = np.vecdot(normal, (velocity.take(bodies, axis=0) - velocity[grasped])[:, :3])
        moment = (-self.twin.twin.tip.b_Nms * twist)[:, None] * normal
        applied[:] = 0.0
        applied[bodies, 3:] = moment
        applied[grasped, 3:] = -np.add.reduce(moment)
        if load is not None:
            applied[grasped, :3] += load.force_N
            applied[grasped, 3:] += load.torque_Nm
