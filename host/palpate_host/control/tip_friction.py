"""Friction at one tip: the measured friction ratio, and an estimate of the friction that the skin has.

With the normal force N, the tangential force T and the torsion m about the normal, a contact sticks inside
the ellipsoid (T/(mu N))^2 + (m/(mu N r_t))^2 <= 1 (Howe, Cutkosky: Practical force-motion models for sliding
manipulation, Int. J. Robotics Research 15, 1996). The friction ratio is therefore sqrt(T^2 + (m/r_t)^2)/N.
A Hertzian contact of radius a = sqrt(r depth) has r_t = 3 pi/16 a; the depth is sqrt(N/k), Eq. (8).

The estimate begins with `pose_law.friction`. A ratio that the contact has held without slip in each of
`HELD_FRAMES` frames is a lower bound of friction and raises it. Slip sets it to `SAFE_SHARE` of the ratio at
which the contact slipped. It recovers with the time constant `RECOVER_S`, which doubles with each slip of one
hold: a hand whose object really has less friction does not test it again and again.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from palpate_host.common.tip_contact import TipContact

SAFE_SHARE = 0.9
LARGEST_STEP = 0.5
"""Smallest estimate after a slip over that before it: a false alarm costs a factor of two in grip at most."""
LEAST_FRICTION = 0.1
HELD_FRAMES = 5
RECOVER_S = 30.0
ANSWER_US = 30_000
"""Time from an answer until it acts on the skin; slip in frames exposed before that is the same slip."""
NOTABLE_GAP = 0.02
LEAST_NORMAL_N = 0.1
LEAST_HEIGHT = 0.1
"""Smallest z of a contact over its distance from the dome's centre: below it shear z does not follow."""


@dataclass(frozen=True, slots=True)
class TipFriction:
    """The state of one tip's estimate.

    prior: the friction of hand.toml. gap: by how much slip lowers it. bound: ratio held without slip.
    ratio: of the last contact, None where it is unknown. held: ratios of the last frames without slip.
    slips: number of answered ones. answered_us: time from which a flag shows a new slip (epoch us).
    """

    prior: float
    gap: float = 0.0
    bound: float = 0.0
    ratio: float | None = None
    held: tuple[float, ...] = ()
    slips: int = 0
    answered_us: int = 0

    @property
    def friction(self) -> float:
        """The estimate, for which the grip provides."""
        return max(self.prior - self.gap, self.bound)

    @property
    def margin(self) -> float | None:
        """The friction ratio that is left; negative where the ratio exceeds the estimate."""
        return None if self.ratio is None else self.friction - self.ratio

    @property
    def is_lowered(self) -> bool:
        """True while slip lowers the estimate by more than `NOTABLE_GAP`."""
        return self.friction < self.prior - NOTABLE_GAP

    def after_contact(self, contact: TipContact, ratio: float | None) -> TipFriction:
        """Return the state after one contact with this friction ratio; `slips` grows with a new slip."""
        if (contact.slip or contact.slip_begins) and contact.in_contact:
            is_new = contact.exposed_at_us >= self.answered_us
            after = self._after_slip(ratio) if is_new else self
            answered_us = contact.received_at_us + ANSWER_US if is_new else self.answered_us
            return replace(after, ratio=ratio, held=(), answered_us=answered_us)
        held = (*self.held, ratio)[-HELD_FRAMES:] if ratio is not None else ()
        bound = max(self.bound, min(held)) if len(held) == HELD_FRAMES else self.bound
        return replace(self, ratio=ratio, held=held, bound=bound)

    def after_tick(self, dt_s: float) -> TipFriction:
        """Return the state after dt_s, in which the estimate has recovered a little."""
        if self.gap == 0.0:
            return self
        return replace(self, gap=self.gap * math.exp(-dt_s / (RECOVER_S * 2.0 ** (self.slips - 1))))

    def _after_slip(self, ratio: float | None) -> TipFriction:
        slipped_at = self.friction if ratio is None else ratio
        low = max(SAFE_SHARE * slipped_at, LARGEST_STEP * self.friction, LEAST_FRICTION)
        low = min(low, self.friction)
        gap = max(self.prior - low, 0.0)
        return replace(self, gap=gap, bound=min(self.bound, low), slips=self.slips + 1)


def friction_ratio(contact: TipContact, tip_radius_m: float, tip_stiffness_N_m2: float) -> float | None:
    """Return sqrt(T^2 + (m/r_t)^2)/N of a contact; None without contact or where a force is unknown.

    tip_stiffness_N_m2: k of Eq. (8). Torsion counts where it is measured and k is not 0. The bus carries two
    components of the shear; the third follows, since shear is tangential to the dome.
    """
    normal_N = contact.normal_force_N
    if not (contact.valid and contact.in_contact) or normal_N is None or normal_N < LEAST_NORMAL_N:
        return None
    if contact.shear_N is None or contact.position_mm is None:
        return None
    (x, y, z), (x_N, y_N) = contact.position_mm, contact.shear_N
    if abs(z) < LEAST_HEIGHT * math.hypot(x, y, z):
        return None
    tangential_N = math.hypot(x_N, y_N, (x * x_N + y * y_N) / z)
    if contact.torsion_Nmm is None or tip_stiffness_N_m2 == 0.0:
        return tangential_N / normal_N
    radius_m = math.sqrt(tip_radius_m * math.sqrt(normal_N / tip_stiffness_N_m2))
    twisting_N = 1e-3 * contact.torsion_Nmm / (3.0 * math.pi / 16.0 * radius_m)
    return math.hypot(tangential_N, twisting_N) / normal_N
