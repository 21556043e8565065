"""Turning labels between the axes that two sensors' tables name x and y.

A robot's axes need not be those of the image, and sideways motion may be that of the object or of the
sensor. Tilt and shear are vectors in the image plane, so two tables differ by one angle and one sign.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_edge.geometry.picture_sensor import LabelAxes

PAIRS = (("tilt_x_deg", "tilt_y_deg"), ("shear_x_mm", "shear_y_mm"))
MOTIONS = ("shear_x_mm", "shear_y_mm", "torsion_deg")


@dataclass(frozen=True, slots=True)
class AxisChange:
    """turn_rad: of the vectors' coordinates; sign: of shear and torsion."""

    turn_rad: float = 0.0
    sign: float = 1.0

    def applied(self, values: Array, labels: Sequence[str]) -> Array:
        """Return label values (s, k) about the other axes."""
        changed = values.copy()
        c, s = np.cos(self.turn_rad), np.sin(self.turn_rad)
        for pair in PAIRS:
            if set(pair) <= set(labels):
                at = [labels.index(label) for label in pair]
                changed[:, at] = values[:, at] @ np.array([[c, s], [-s, c]])
        motions = [place for place, label in enumerate(labels) if label in MOTIONS]
        changed[:, motions] *= self.sign
        return changed


def declared_change(source: LabelAxes, target: LabelAxes) -> AxisChange:
    """Return the change from one table's axes to another's, as both are declared."""
    sign = 1.0 if source.motion_of == target.motion_of else -1.0
    return AxisChange(float(np.deg2rad(source.x_axis_deg - target.x_axis_deg)), sign)


def measured_change(predicted: Array, values: Array, labels: Sequence[str]) -> AxisChange | None:
    """Return the change that brings predicted labels (s, k) nearest to a table's (s, k); None without tilt or
    shear in both directions."""
    turns = []
    for pair in PAIRS:
        if set(pair) <= set(labels):
            at = [labels.index(label) for label in pair]
            turns.append(np.vdot(_complex(predicted[:, at]), _complex(values[:, at])))
    if not turns:
        return None
    turn_rad = float(np.angle(turns[0]))
    if len(turns) < len(PAIRS):
        return AxisChange(turn_rad)
    return AxisChange(turn_rad, 1.0 if np.cos(np.angle(turns[1]) - turn_rad) > 0 else -1.0)


def _complex(vectors: Array) -> Array:
    return np.asarray(vectors[:, 0] + 1j * vectors[:, 1])
