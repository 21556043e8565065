"""Interface of the estimators of contacts and of poses, and of their stand-in without a calibration."""

from __future__ import annotations

from enum import Enum
from typing import Protocol

import msgspec

from palpate_edge.common.arrays import Array, Mask
from palpate_edge.common.contact import Contact
from palpate_edge.common.contact_quantities import SensorOutputs
from palpate_edge.common.frame import Frame
from palpate_edge.vision.picture_measure import PictureMeasure


class Method(Enum):
    """Method by which a contact is computed from the beads. POSE: of a sensor without a dome."""

    PAPER = "paper"
    CORRECTED = "corrected"
    POSE = "pose"


class EstimatorHealth(msgspec.Struct, frozen=True):
    """Counters since the start, and the drift.

    frames: tracked; refused: rejected, with or without tracking; beads_lost: summed over frames; searches: of
    the whole image; drift_px: of the untouched skin since the reference frames or the last tare, root mean
    square. Poses have no searches and no drift.
    """

    frames: int
    refused: int
    beads_lost: int
    searches: int = 0
    drift_px: float = 0.0


class BeadsInView(msgspec.Struct, frozen=True):
    """The beads of a frame in its pixels, to look at.

    position_px (n, 2): measured where `found` (n,), else predicted; rest_px (n, 2): the same without contact,
    so that the difference is the displacement by the contact.
    """

    position_px: Array
    rest_px: Array
    found: Mask


class FrameEstimator(Protocol):
    """Interface of an estimator.

    method: None without a calibration; outputs: parts of a contact that the calibration gives; picture:
    measures of a recent frame, None where they are not taken; beads: of the last frame, None where they were
    not tracked.
    """

    @property
    def method(self) -> Method | None: ...

    @property
    def outputs(self) -> SensorOutputs: ...

    @property
    def picture(self) -> PictureMeasure | None: ...

    @property
    def health(self) -> EstimatorHealth: ...

    @property
    def beads(self) -> BeadsInView | None: ...

    def estimate(self, frame: Frame) -> Contact:
        """Return the contact of the next frame; a rejected frame gives `valid` False and the reason."""
        ...

    def tare(self, *, accepts_contact: bool) -> None:
        """Take the next frames as the untouched sensor, where the method has such a reference.

        accepts_contact: False cancels the tare when one of them shows a contact.
        """
        ...
