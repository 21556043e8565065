"""One fingertip's contact as the host uses it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class TipContact:
    """One frame's contact as the bus told it; vectors in the dome's frame F.

    exposed_at_us: on the host's clock (epoch us), unwrapped from the bus clock's 32 bits.
    in_contact counts only with valid. torsion_Nmm: None when the fingertip's method gives none.
    """

    received_at_us: int
    exposed_at_us: int
    sequence: int
    latency_us: int
    position_mm: tuple[float, float, float]
    normal_force_N: float
    shear_N: tuple[float, float]
    torsion_Nmm: float | None
    valid: bool
    in_contact: bool
    slip: bool
    quality: int
