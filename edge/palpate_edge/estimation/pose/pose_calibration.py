"""The calibration of a sensor that is known by its pictures alone, as its file has it."""

from __future__ import annotations

import hashlib

import msgspec
import numpy as np

from palpate_edge.common.arrays import Array
from palpate_edge.estimation.calibration import CalibrationSource
from palpate_edge.estimation.pose.kernel_expansion import Expansion, PackedArray
from palpate_edge.estimation.pose.local_expansion import LocalExpansion
from palpate_edge.estimation.pose.network import Networks
from palpate_edge.geometry.picture_sensor import PictureSensor
from palpate_edge.vision.appearance import Appearance

FORMAT = "palpate-pose-calibration"
VERSION = 1


class Modes(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Principal components: mean (d,) and vectors (d, m) of observations (d,)."""

    mean: PackedArray
    vectors: PackedArray


class Guide(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """From the marker density to the displacement of every marker: density modes -> displacement modes."""

    density: Modes
    centres: PackedArray
    expansion: Expansion


class LabelGroup(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Labels, by their places in the calibration's list, that one expansion gives; a label is the sum of its
    groups."""

    labels: tuple[int, ...]
    expansion: Expansion


class LabelCorrection(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Corrections of a regression that was learned on other sensors, to be added: its labels (k,) times trend
    (k, k), offset (k,), and the sums of the groups."""

    trend: PackedArray
    offset: PackedArray
    groups: tuple[LabelGroup, ...]


class PoseCalibration(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One sensor's calibration.

    beads: x, y in px of every marker at rest; diameter_px: of a marker; weakest_strength: of a spot that may
    be a marker (blob_detection); contact_threshold_px: root mean square displacement above which something
    touches; displacement: modes of the markers' displacements (2 n,), centres: of the presses in them;
    groups: expansions of the labels; half_widths: expansion of the logarithm of the half width of each
    label's 95 % interval; mean: of each label over the presses; checksum: over all other fields; local:
    better expansions of some labels, about the groups' results; those of one label are added; networks:
    corrections of some labels, by the groups' results and by the local expansions of these labels;
    correction: of the groups' results, where these come from other sensors.
    """

    sensor: PictureSensor
    appearance: Appearance
    diameter_px: float
    weakest_strength: float
    beads: tuple[tuple[float, float], ...]
    contact_threshold_px: float
    labels: tuple[str, ...]
    mean: tuple[float, ...]
    displacement: Modes
    guide: Guide
    centres: PackedArray
    groups: tuple[LabelGroup, ...]
    half_widths: Expansion
    source: CalibrationSource
    format: str = FORMAT
    version: int = VERSION
    checksum: str = ""
    local: tuple[LocalExpansion, ...] | msgspec.UnsetType = msgspec.UNSET
    networks: Networks | msgspec.UnsetType = msgspec.UNSET
    correction: LabelCorrection | msgspec.UnsetType = msgspec.UNSET

    def digest(self) -> str:
        """Return the SHA-256, hex, over all fields but the checksum."""
        return hashlib.sha256(msgspec.json.encode(msgspec.structs.replace(self, checksum=""))).hexdigest()

    def rest_px(self) -> Array:
        """Return the places (n, 2) of the markers at rest."""
        return np.array(self.beads, dtype=np.float64)
