"""Labels of a point in the displacement modes: first regression, local ones about it, networks about both."""

from __future__ import annotations

import numpy as np

from palpate_edge.common.arrays import Array, Floats
from palpate_edge.estimation.pose.kernel_expansion import ExpansionRunner
from palpate_edge.estimation.pose.local_expansion import LocalExpansionRunner
from palpate_edge.estimation.pose.network import NetworkRunner
from palpate_edge.estimation.pose.pose_calibration import PoseCalibration


class LabelRunner:
    """Computes the labels that a calibration learned. First results that nothing needs are left out."""

    def __init__(self, calibration: PoseCalibration) -> None:
        self._count = len(calibration.labels)
        centres = calibration.centres.array()
        local = calibration.local or ()
        self._networks = NetworkRunner(calibration.networks) if calibration.networks else None
        given = {label for expansion in local for label in expansion.given}
        needed = set(range(self._count)) if self._networks else given
        replaced = {label for expansion in local for label in expansion.labels} - needed
        self._groups = [
            (list(group.labels), ExpansionRunner(group.expansion, centres))
            for group in calibration.groups
            if not replaced.issuperset(group.labels)
        ]
        correction = calibration.correction or None
        self._correction = (
            (
                correction.trend.array(),
                correction.offset.array(),
                [(list(each.labels), ExpansionRunner(each.expansion, centres)) for each in correction.groups],
            )
            if correction
            else None
        )
        self._local = [LocalExpansionRunner(expansion, centres) for expansion in local]
        self._alike = [  # of each local expansion the first one with the same nearness
            next(number for number, other in enumerate(self._local) if runner.has_nearness_of(other))
            for runner in self._local
        ]
        self._half_widths = ExpansionRunner(calibration.half_widths, centres)

    def at(self, point: Floats) -> Array:
        """Return the labels (k,) at one point (m,)."""
        values = np.zeros(self._count)
        for labels, runner in self._groups:
            values[labels] += runner.at(point)
        if self._correction:
            trend, offset, groups = self._correction
            values += values @ trend + offset
            for labels, runner in groups:
                values[labels] += runner.at(point)
        first = values.copy()
        nearness = {number: self._local[number].nearness(first) for number in set(self._alike)}
        outputs = [
            local.at(point, nearness[number]) for local, number in zip(self._local, self._alike, strict=True)
        ]
        for local in self._local:
            values[local.labels] = 0.0
        for local, output in zip(self._local, outputs, strict=True):
            values[local.labels] += output
        if self._networks:
            corrected = self._networks.labels
            inputs = [
                output
                for local, output in zip(self._local, outputs, strict=True)
                if set(local.labels) <= set(corrected)
            ]
            values[corrected] += self._networks.at(np.concatenate([first, *inputs], dtype=np.float64))
        return values

    def half_widths_at(self, point: Floats) -> Array:
        """Return the half widths (k,) of the labels' 95 % intervals at one point (m,)."""
        return np.asarray(np.exp(self._half_widths.at(point).astype(np.float64)))
