"""One fingertip's contact as the host uses it."""

from __future__ import annotations

from dataclasses import dataclass

from palpate_edge.common.contact_quantities import FlatPose, OptionalQuantities


@dataclass(frozen=True, slots=True)
class TipContact(OptionalQuantities):
    """One frame's contact, received from the bus; vectors in the dome's frame F.

    exposed_at_us: on the host's clock (epoch us), unwrapped from the bus clock's 32 bits.
    valid: the frame was not rejected. in_contact counts only together with it. position_mm, normal_force_N,
    shear_N: None in a valid contact of a sensor that never gives them; unknown is not zero.
    flat_pose: of a flat object; None unless the sensor gives poses. slip, slip_begins: the object slides, or
    begins to.
    """

    received_at_us: int
    exposed_at_us: int
    sequence: int
    latency_us: int
    position_mm: tuple[float, float, float] | None
    normal_force_N: float | None
    shear_N: tuple[float, float] | None
    valid: bool
    in_contact: bool
    slip: bool
    quality: int
    flat_pose: FlatPose | None = None
    slip_begins: bool = False
