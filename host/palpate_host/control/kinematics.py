"""The hand's kinematics and gravity torques from its MuJoCo model.

All quantities are in the hand frame, the world of the MJCF: the palm in z = 0, +z towards the object. x_ci is
always the CENTRE of tip i, never the contact: the paper's text uses x_i for both, Eqs. (10)-(14) mean the
centre.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import mujoco
import numpy as np
import numpy.typing as npt

from palpate_edge.common.arrays import Array
from palpate_edge.common.errors import ConfigError


class HandPose(NamedTuple):
    """The quantities of the hand in one joint configuration that Eqs. (9)-(16) use.

    q_rad: (nq,) the configuration it was computed for.
    tip_centre_m: (n, 3), row i is x_ci.
    tip_jacobian_m: (n, 3, nq), J_i = d x_ci / dq. The paper prints J as 15 x 3 and uses its transpose;
        here u = J_i^T F with J_i of 3 x nq.
    tip_rotation: (n, 3, 3), columns of [i] are the axes of frame F of dome i.
    gravity_Nm: (nq,) g(q), the torque that holds the hand up.
    tip_turn_jacobian: (n, 3, nq), the tips' angular velocities are [i] dq/dt; None where it was not computed.
    jacobian: (2 n 3, nq), the rows of tip_jacobian_m above those of tip_turn_jacobian; None likewise.
    """

    q_rad: Array
    tip_centre_m: Array
    tip_jacobian_m: Array
    tip_rotation: Array
    gravity_Nm: Array
    tip_turn_jacobian: Array | None = None
    jacobian: Array | None = None


class HandKinematics:
    """The kinematics of one hand; joints and tips in the order of the configuration.

    Pure for its callers: the MuJoCo data is scratch memory that carries nothing from one call to the next, so
    a deep copy is the same object. Not thread-safe: each thread needs its own.
    """

    def __init__(
        self, model: mujoco.MjModel, joints: Sequence[str], tip_sites: Sequence[str], source: str
    ) -> None:
        """Raise ConfigError, with `source`, when the model lacks a named joint or site or has further
        joints."""
        self._model = model
        joint_ids = [_named(model, source, mujoco.mjtObj.mjOBJ_JOINT, name) for name in joints]
        if model.nv != len(joints) or model.nq != len(joints):
            raise ConfigError(
                f"{source} has {model.nv} degrees of freedom, hand.toml has {len(joints)} joints:"
                " list every joint once under fingers.joints"
            )
        self._joint_count = len(joint_ids)
        self._q_address = _index([int(model.jnt_qposadr[j]) for j in joint_ids])
        self._v_address = _index([int(model.jnt_dofadr[j]) for j in joint_ids])
        self._sites = [_named(model, source, mujoco.mjtObj.mjOBJ_SITE, name) for name in tip_sites]
        self._site_rows = _index(self._sites)
        self._scratch = data = mujoco.MjData(model)
        # Every access to a field of MjData makes a new array; these views stay valid.
        self._q_rad, self._site_m, self._axes = data.qpos, data.site_xpos, data.site_xmat.reshape(-1, 3, 3)
        self._gravity_Nm = np.zeros(self._joint_count)
        self._jacobians = np.zeros((2, len(self._sites), 3, self._joint_count))
        self._of_sites = list(zip(*self._jacobians, self._sites, strict=True))

    def __deepcopy__(self, _memo: object) -> HandKinematics:
        return self

    @property
    def joint_count(self) -> int:
        """The length nq of q."""
        return self._joint_count

    def tip_centres_m(self, q_rad: Array) -> Array:
        """Return the centres of the tips (fingers, 3) at `q_rad` (nq,), in a sixth of the time of `pose`."""
        self._q_rad[self._q_address] = q_rad
        mujoco.mj_kinematics(self._model, self._scratch)
        return np.array(self._site_m[self._site_rows])

    def pose(self, q_rad: Array) -> HandPose:
        """Return kinematics, Jacobians and gravity torques at `q_rad` (nq,)."""
        model, data = self._model, self._scratch
        tip_centres_m = self.tip_centres_m(q_rad)
        mujoco.mj_comPos(model, data)
        mujoco.mj_rne(model, data, 0, self._gravity_Nm)
        for along, turning, site in self._of_sites:
            mujoco.mj_jacSite(model, data, along, turning, site)
        jacobians = np.array(self._jacobians[..., self._v_address])
        return HandPose(
            q_rad=np.array(q_rad, dtype=np.float64),
            tip_centre_m=tip_centres_m,
            tip_jacobian_m=jacobians[0],
            tip_rotation=self._axes[self._site_rows].copy(),
            gravity_Nm=np.array(self._gravity_Nm[self._v_address]),
            tip_turn_jacobian=jacobians[1],
            jacobian=jacobians.reshape(-1, self._joint_count),
        )

    def inertia_kgm2(self, q_rad: Array) -> Array:
        """Return the inertia (nq, nq) of the links, and of rotors that the model has, at `q_rad` (nq,)."""
        model, data = self._model, self._scratch
        self.tip_centres_m(q_rad)
        mujoco.mj_comPos(model, data)
        mujoco.mj_crb(model, data)
        inertia = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, inertia)
        return np.asarray(inertia[self._v_address][:, self._v_address])


def _index(numbers: list[int]) -> slice | npt.NDArray[np.int64]:
    """Return the numbers as an index into an array: a slice, which is faster, when they are consecutive."""
    first = numbers[0] if numbers else 0
    if numbers == list(range(first, first + len(numbers))):
        return slice(first, first + len(numbers))
    return np.array(numbers)


def _named(model: mujoco.MjModel, source: str, kind: mujoco.mjtObj, name: str) -> int:
    """Return the number of a joint or site. Raises ConfigError with the names that the model has."""
    number = int(mujoco.mj_name2id(model, kind, name))
    if number >= 0:
        return number
    if kind == mujoco.mjtObj.mjOBJ_JOINT:
        word, names = "joint", [model.joint(i).name for i in range(model.njnt)]
    elif source.endswith(".urdf"):  # a URDF's tips are links
        word, names = "link", [model.body(i).name for i in range(1, model.nbody)]
    else:
        word, names = "site", [model.site(i).name for i in range(model.nsite)]
    found = f"its {word}s: {', '.join(names)}" if names else f"it has no {word}s"
    raise ConfigError(
        f"{source} has no {word} {name!r}; {found}: correct the name in hand.toml or in the model"
    )
