"""Regulation of the contact force with the fingertips' measurements, Eq. (3). Optional.

The paper only observes the force. Both laws act along the contact's normal n_i, from the contact to the tip's
centre; the object presses on the tip with f_n along it.

ADMITTANCE is for joints that turn with torque / B_d (geared drives under velocity command). The object's
reaction does not reach such a joint by itself, so f_n n_i is added to the tip's commanded force, and the
joint stops when both are equal. INTEGRAL is for torque-commanded joints: it trims the grasp until f_n equals
the desired grasp force.
"""

from __future__ import annotations

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_host.common.tip_contact import TipContact
from palpate_host.config.control_config import ControlConfig, ForceLaw

TRIM_RATIO = 0.5
"""Largest trim of a finger over its grasp force."""


class ContactForce:
    """The last measured force of each finger, and the integral of its error."""

    def __init__(self, fingers: int, control: ControlConfig, oldest_s: float) -> None:
        """oldest_s: age from which a measured force is no longer used."""
        self._law, self._per_s, self._oldest_s = control.force_law, control.force_per_s, oldest_s
        self._force_N = np.zeros(fingers)
        self._normal_F = np.tile([0.0, 0.0, -1.0], (fingers, 1))
        self._age_s = np.full(fingers, np.inf)
        self._trim_N = np.zeros(fingers)

    @property
    def is_on(self) -> bool:
        """False for the law OPEN, which leaves the grasp force as commanded."""
        return self._law is not ForceLaw.OPEN

    def note(self, finger: int, contact: TipContact) -> None:
        """Take the contact of one finger's valid frame; one without force or place is no measurement."""
        if contact.normal_force_N is None or contact.position_mm is None:
            return
        self._age_s[finger] = 0.0
        self._force_N[finger] = contact.normal_force_N if contact.in_contact else 0.0
        if contact.in_contact:
            point = np.array(contact.position_mm)
            self._normal_F[finger] = -point / max(float(np.linalg.norm(point)), 1e-9)

    def tip_force_N(self, grasp_N: Array, tip_rotation: Array, dt_s: float) -> Array:
        """Return the forces (n, 3) that are added to the tips' grasp forces (n, 3) in this tick.

        Without a recent measurement ADMITTANCE cancels the finger's command, so that its joints stop instead
        of closing further; INTEGRAL keeps the trim.
        """
        self._age_s += dt_s
        is_fresh = self._age_s <= self._oldest_s
        normal = np.einsum("iab,ib->ia", tip_rotation, self._normal_F)
        if self._law is ForceLaw.ADMITTANCE:
            return np.asarray(np.where(is_fresh[:, None], self._force_N[:, None] * normal, -grasp_N))
        desired_N = -np.einsum("ia,ia->i", grasp_N, normal)
        change_N = self._per_s * dt_s * (desired_N - self._force_N) * (is_fresh & (self._force_N > 0.0))
        bound_N = TRIM_RATIO * np.abs(desired_N)
        self._trim_N = np.minimum(np.maximum(self._trim_N + change_N, -bound_N), bound_N)
        return np.asarray(-self._trim_N[:, None] * normal)
