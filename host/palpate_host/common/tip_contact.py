"""One fingertip's contact as the host uses it."""

from __future__ import annotations

from dataclasses import dataclass

from palpate_edge.common.contact_quantities import OptionalQuantities


@dataclass(frozen=True, slots=True)
class TipContact(OptionalQuantities):
    """One frame's contact, received from the bus; vectors in the dome's frame F.

    exposed_at_us: on the host's clock (epoch us), unwrapped from the bus clock's 32 bits.
    in_contact counts only together with valid.
    """

    received_at_us: int
    exposed_at_us: int
    sequence: int
    latency_us: int
    position_mm: tuple[float, float, float]
    normal_force_N: float
    shear_N: tuple[float, float]
    valid: bool
    in_contact: bool
    slip: bool
    quality: int
