"""hand.toml's [geometry]: the links of every finger."""

from __future__ import annotations

import enum
from typing import Annotated

import msgspec

from palpate_host.config.value_types import NotNegative, Positive


class Axis(enum.Enum):
    """Direction of a joint's movement."""

    ABDUCTION = "abduction"
    FLEXION = "flexion"

    @property
    def vector(self) -> tuple[float, float, float]:
        """The axis in the finger's frame."""
        return (1.0, 0.0, 0.0) if self is Axis.ABDUCTION else (0.0, 1.0, 0.0)


class LinkConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A link and the joints at its base, in the order in which they turn it.

    centre_of_mass_m: from the base along the link, the middle by default. inertia_kgm2: about the centre of
    mass, x, y, z of the link. radius_m: of the capsule that is drawn.
    """

    length_m: Positive
    mass_kg: Positive
    inertia_kgm2: tuple[Positive, Positive, Positive]
    joints: Annotated[tuple[Axis, ...], msgspec.Meta(min_length=1)]
    centre_of_mass_m: NotNegative | None = None
    radius_m: Positive = 0.008


class GeometryConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """base_circle_m: radius on which the fingers stand, at base_azimuth_deg, counter-clockwise from above."""

    base_circle_m: Positive
    base_azimuth_deg: Annotated[tuple[float, ...], msgspec.Meta(min_length=1)]
    links: Annotated[tuple[LinkConfig, ...], msgspec.Meta(min_length=1)]
