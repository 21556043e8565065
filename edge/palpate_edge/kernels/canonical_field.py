"""The canonical field of the beads' displacement, in canonical_field.c."""

from __future__ import annotations

import ctypes
import math
from typing import NamedTuple

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_edge.kernels.library import POINTER, addresses, kernel
from palpate_edge.kernels.padding import padded_length, padded_rows

_POINTERS = (
    "scaled",
    "tangents",
    "scaled_beads",
    "unit",
    "mm_per_px",
    "inverse",
    "modes",
    "variances",
    "displacement_px",
    "moved_mm",
    "weights",
    "amounts",
    "turned",
    "turned_weights",
    "kernel",
    "mean_motion",
    "gravity",
    "values",
)


MeanMotion = tuple[float, float, float, float, float, float]
"""Mean displacement of all beads in F, and mean of the beads' directions times their displacement, in mm."""


class FieldNoise(NamedTuple):
    """bead_noise: variance of a bead's place, relative to the field's. The others are of displacements that
    are not smoothed: noise_mm2: variance of a bead's place on the sphere, 0 where it is unknown;
    noise_weight: of that variance; least_signal: of a frame's mean square displacement, the rest is noise at
    most."""

    bead_noise: float
    noise_mm2: float
    noise_weight: float
    least_signal: float


class _CanonicalField(ctypes.Structure):
    _fields_ = [
        *((name, ctypes.c_int32) for name in ("beads", "padded_beads", "directions")),
        *((name, ctypes.c_double) for name in FieldNoise._fields),
        *((name, POINTER) for name in _POINTERS),
    ]


class CanonicalFieldKernel:
    """Interpolates the displacement of one sensor's n beads to g directions of the canonical frame.

    covariance (g, padded n), float32: of the directions and the beads about the last azimuth.
    """

    def __init__(
        self,
        directions: Array,
        tangents: Array,
        unit: Array,
        mm_per_px: Array,
        covariance: Array,
        noise: FieldNoise,
        *,
        length: float,
    ) -> None:
        """directions (g, 3), tangents (2, g, 3): in the canonical frame; unit (n, 3): of the beads in F;
        mm_per_px (n, 3, 2); covariance (n, n): of the beads; length: of the covariance, on the unit
        sphere."""
        count, beads, padded = len(directions), len(unit), padded_length(len(unit))
        shapes = tangents.shape, mm_per_px.shape, covariance.shape
        if shapes != ((2, count, 3), (beads, 3, 2), (beads, beads)):
            raise ValueError(f"geometry of the beads does not fit {beads} beads and {count} directions")
        self.covariance = np.zeros((count, padded), np.float32)
        self._displacement_px, self._weights = np.zeros((beads, 2)), np.zeros((3, beads))
        variances, modes = np.linalg.eigh(covariance)
        self._gravity, self._values, self._mean_motion = np.zeros(2), np.zeros(2 * count), np.zeros(6)
        singles = {
            "scaled": np.ascontiguousarray(math.sqrt(3.0) / length * directions, dtype=np.float32),
            "tangents": np.ascontiguousarray(tangents, dtype=np.float32),
            "scaled_beads": padded_rows(math.sqrt(3.0) / length * unit.T),
            "turned": np.zeros((3, padded), np.float32),
            "turned_weights": np.zeros((3, padded), np.float32),
            "kernel": self.covariance,
        }
        doubles = {
            "unit": np.ascontiguousarray(unit),
            "mm_per_px": np.ascontiguousarray(mm_per_px),
            "inverse": np.linalg.inv(covariance + noise.bead_noise * np.eye(beads)),
            "modes": np.ascontiguousarray(modes),
            "variances": variances,
            "displacement_px": self._displacement_px,
            "moved_mm": np.zeros((3, beads)),
            "weights": self._weights,
            "amounts": np.zeros((3, beads)),
            "mean_motion": self._mean_motion,
            "gravity": self._gravity,
            "values": self._values,
        }
        self._arrays = singles, doubles
        struct = _CanonicalField(
            beads,
            padded,
            count,
            *noise,
            **addresses(singles, np.float32),
            **addresses(doubles, np.float64),
        )
        self._struct = ctypes.byref(struct)
        self._move = kernel("canonical_mean_motion", POINTER)
        self._turn = kernel("canonical_turn", POINTER, ctypes.c_double, ctypes.c_double)
        self._weighed = kernel("canonical_weighed", POINTER, ctypes.c_double, ctypes.c_double)
        self._field = kernel("canonical_field", POINTER, ctypes.c_int32, ctypes.c_double, ctypes.c_double)

    def mean_motion(self, displacement_px: Array) -> MeanMotion:
        """Return the mean motion of the beads for their displacement (n, 2) in the image."""
        np.copyto(self._displacement_px, displacement_px)
        self._move(self._struct)
        x, y, z, around_x, around_y, around_z = self._mean_motion.tolist()
        return x, y, z, around_x, around_y, around_z

    def turn(self, azimuth_rad: float) -> None:
        """Compute the covariance about an azimuth of the canonical frame."""
        self._turn(self._struct, math.cos(azimuth_rad), math.sin(azimuth_rad))

    def read(self, displacement_px: Array, turn_rad: float, *, all_exact: bool) -> tuple[float, Array]:
        """Return the azimuth, rad, and the field (2 g,), mm, of a displacement (n, 2) in the image.

        The field: meridional components, then azimuthal ones. The azimuth is that of the centre of gravity of
        the squared displacement, which is interpolated, plus turn_rad. all_exact: the displacement is
        measured, all beads exact; else it is smoothed. Computes the covariance about the azimuth.
        """
        np.copyto(self._displacement_px, displacement_px)
        self._field(self._struct, all_exact, math.cos(turn_rad), math.sin(turn_rad))
        x, y = self._gravity.tolist()
        return math.atan2(y, x) + turn_rad, self._values.copy()

    def read_weighed(self, weights: Array, azimuth_rad: float) -> Array:
        """Return the field (2 g,), mm, about an azimuth, of beads with weights (n, 3) in F from elsewhere.

        Computes the covariance about the azimuth.
        """
        np.copyto(self._weights, weights.T)
        self._weighed(self._struct, math.cos(azimuth_rad), math.sin(azimuth_rad))
        return self._values.copy()
