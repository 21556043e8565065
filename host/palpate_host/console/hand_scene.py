"""The hand as lines, points and arrows in the palm's frame, from one status; pure."""

from __future__ import annotations

import msgspec
import mujoco
import numpy as np

from palpate_edge.common.arrays import Array
from palpate_host.common.status import FingerStatus, HostStatus
from palpate_host.config.hand_config import HandConfig
from palpate_host.control.hand_model import model_of

Point = tuple[float, float, float]
DIGITS = 5  # of a coordinate in m


class FingerScene(msgspec.Struct, frozen=True):
    """One finger. chain_m: joints from the palm to the tip, then the dome's centre; apex_m: the dome's apex;
    contact_m, force_N: of the contact, the force on the dome along its inward normal; None without."""

    name: str
    chain_m: list[Point]
    apex_m: Point
    contact_m: Point | None
    force_N: Point | None


class HandScene(msgspec.Struct, frozen=True):
    """All fingers. dome_radius_m: of the fingertips."""

    dome_radius_m: float
    fingers: list[FingerScene]


class SceneMaker:
    """Computes the scenes of one hand. Not thread-safe."""

    def __init__(self, config: HandConfig) -> None:
        """Raises ConfigError as `model_of`."""
        self._config, self._model = config, model_of(config)
        self._data = mujoco.MjData(self._model)
        self._q_address = [int(self._model.joint(joint.name).qposadr[0]) for joint in config.joints]

    def of(self, status: HostStatus) -> HandScene | None:
        """Return the hand of a status; None while a joint's position is not known."""
        q_rad = [joint.position_rad for joint in status.joints if joint.position_rad is not None]
        if len(q_rad) < len(self._q_address):
            return None
        self._data.qpos[self._q_address] = q_rad
        mujoco.mj_kinematics(self._model, self._data)
        sites = self._config.model.tip_sites
        fingers = [self._finger(*each) for each in zip(status.fingers, sites, strict=True)]
        return HandScene(self._config.control.tip_radius_m, fingers)

    def _finger(self, finger: FingerStatus, site: str) -> FingerScene:
        tip = self._data.site(site)
        centre_m, rotation = tip.xpos.copy(), tip.xmat.reshape(3, 3).copy()
        chain = [*self._bodies(int(self._model.site(site).bodyid[0])), centre_m]
        apex_m = centre_m + self._config.control.tip_radius_m * rotation[:, 2]
        contact_m = force_N = None
        if finger.in_contact and finger.position_mm is not None:
            offset_m = rotation @ np.array(finger.position_mm) / 1000
            contact_m = _point(centre_m + offset_m)
            if finger.normal_force_N is not None:
                force_N = _point(-finger.normal_force_N * offset_m / np.linalg.norm(offset_m))
        return FingerScene(
            finger.name, [_point(place) for place in chain], _point(apex_m), contact_m, force_N
        )

    def _bodies(self, body: int) -> list[Array]:
        """Return the places (3,) of the bodies from the palm to `body`."""
        places = []
        while body > 0:
            places.append(self._data.xpos[body].copy())
            body = int(self._model.body_parentid[body])
        return places[::-1]


def _point(vector: Array) -> Point:
    x, y, z = (round(float(value), DIGITS) for value in vector)
    return x, y, z
