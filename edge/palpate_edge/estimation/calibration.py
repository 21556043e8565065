"""The calibration of one sensor: everything that the estimator knows of it."""

from __future__ import annotations

import hashlib

import msgspec
import numpy as np

from palpate_edge.common.arrays import Indices
from palpate_edge.estimation.contact_fit.contact_fields import ContactFields
from palpate_edge.estimation.contact_fit.place_stiffness import PlaceStiffness
from palpate_edge.estimation.field_smoothing.typical_fields import TypicalFields
from palpate_edge.estimation.paper_method import PaperModel
from palpate_edge.geometry.sensor import CameraPose, Sensor
from palpate_edge.vision.appearance import Appearance, unlit_grey
from palpate_edge.vision.beads import COLOUR_FIT, SLOPED_LIGHT, FitChannels, FitLight, Reference
from palpate_edge.vision.shading import Shading

FORMAT = "palpate-calibration"
VERSION = 5


class Bead(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One bead of the untouched sensor.

    x_px, y_px, diameter_px: in the image; contrast: grey levels; area: in bead disks; slope_x, slope_y: of
    the skin's grey, over the contrast, a pixel; unevenness: see subpixel.Refined; ring: its index.
    """

    x_px: float
    y_px: float
    diameter_px: float
    contrast: float
    area: float
    slope_x: float
    slope_y: float
    unevenness: float
    ring: int


class DroppedPresses(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Train frames left out for one reason: their number, and the names of the first few."""

    reason: str
    count: int
    frames: tuple[str, ...]


class FittedBead(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A bead whose place is measured by its symmetry, and how far that is from its centroid at rest."""

    bead: int
    x_px: float
    y_px: float


class RegionErrors(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """Errors of presses left out in turn, from low_deg to high_deg above the base plane.

    presses: their number; mean_mm, largest_mm: of their position errors; held: how many are within their 95 %
    radius.
    """

    low_deg: int
    high_deg: int
    presses: int
    mean_mm: float = 0.0
    largest_mm: float = 0.0
    held: int = 0


class JigErrors(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Mean position errors of firm presses through a jig's holes.

    holes, presses: their numbers; without_mm: of the dome model; left_out_mm: of each hole by the others;
    used: whether the jig's places adjusted the dome model.
    """

    holes: int
    presses: int
    without_mm: float
    left_out_mm: float
    used: bool


class CalibrationSource(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """Origin of a calibration.

    dataset: its folder; reference_frames, presses, weighed: numbers of frames, placed and weighed presses
    that were used; dropped: what was left out; weighed_spread_percent: what the model misses the weighed
    forces by, in % of the largest, None when the stiffness is not from them; regions: errors of presses left
    out in turn, empty with too few; jig: errors of presses through a jig, None without one;
    touched_references, moved_references: names of reference frames that differ from the others. Files of
    earlier versions lack the last fields.
    """

    dataset: str
    reference_frames: int
    presses: int
    dropped: tuple[DroppedPresses, ...] = ()
    weighed: int = 0
    weighed_spread_percent: float | None = None
    regions: tuple[RegionErrors, ...] = ()
    jig: JigErrors | None = None
    touched_references: tuple[str, ...] = ()
    moved_references: tuple[str, ...] = ()


class Calibration(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One sensor's calibration.

    contact_threshold_px: skin motion (root mean square) above which something touches;
    contact_threshold_N: the normal force that causes it where the dome is stiffest, None without presses of
    known force; residual_px: root mean square distance of the beads from the fitted layout; model: the
    correction model's ONNX file, empty without one; stiffness_scale: the sensor's forces over the dome
    model's, None without presses of known force (then no force is estimated); fit_sigma_px: see
    beads.Reference, unset where places are centroids; bead_noise_px: standard deviation of an exact bead's
    place along an axis; fit_channels, fit_light: see beads.Reference, unset for colour and for sloped light
    (all four are unset in older files); fitted_beads: those whose places are fitted though the others' are
    centroids, unset without any; typical: by which the beads' displacement is smoothed before the correction
    model, unset in older files, whose model is of displacements as measured; contact_fields: by which its
    place is improved, and place_stiffness: by which its force is, both unset in older files and where they do
    not help; checksum: over all other fields.
    """

    sensor: Sensor
    pose: CameraPose
    appearance: Appearance
    beads: tuple[Bead, ...]
    contact_threshold_px: float
    paper: PaperModel
    residual_px: float
    source: CalibrationSource
    model: bytes = b""
    stiffness_scale: float | None = None
    contact_threshold_N: float | None = None
    fit_sigma_px: float | msgspec.UnsetType = msgspec.UNSET
    fit_channels: FitChannels | msgspec.UnsetType = msgspec.UNSET
    fit_light: FitLight | msgspec.UnsetType = msgspec.UNSET
    fitted_beads: tuple[FittedBead, ...] | msgspec.UnsetType = msgspec.UNSET
    bead_noise_px: float | msgspec.UnsetType = msgspec.UNSET
    typical: TypicalFields | msgspec.UnsetType = msgspec.UNSET
    contact_fields: ContactFields | msgspec.UnsetType = msgspec.UNSET
    place_stiffness: PlaceStiffness | msgspec.UnsetType = msgspec.UNSET
    format: str = FORMAT
    version: int = VERSION
    checksum: str = ""

    def digest(self) -> str:
        """Return the SHA-256, hex, over all fields but the checksum."""
        return hashlib.sha256(msgspec.json.encode(msgspec.structs.replace(self, checksum=""))).hexdigest()

    def reference(self) -> Reference:
        """Return the beads of the untouched sensor."""
        fit_offset_px = None
        if isinstance(self.fitted_beads, tuple):
            fit_offset_px = np.full((len(self.beads), 2), np.nan)
            for fitted in self.fitted_beads:
                fit_offset_px[fitted.bead] = fitted.x_px, fitted.y_px
        return Reference(
            position_px=np.array([(bead.x_px, bead.y_px) for bead in self.beads]),
            diameter_px=np.array([bead.diameter_px for bead in self.beads]),
            contrast=np.array([bead.contrast for bead in self.beads]),
            area=np.array([bead.area for bead in self.beads]),
            shading=Shading(
                np.array([(bead.slope_x, bead.slope_y) for bead in self.beads]), unlit_grey(self.appearance)
            ),
            unevenness=np.array([bead.unevenness for bead in self.beads]),
            fit_sigma_px=self.fit_sigma_px if isinstance(self.fit_sigma_px, float) else None,
            fit_channels=self.fit_channels if isinstance(self.fit_channels, str) else COLOUR_FIT,
            fit_light=self.fit_light if isinstance(self.fit_light, str) else SLOPED_LIGHT,
            fit_offset_px=fit_offset_px,
        )

    @property
    def noise_px(self) -> float:
        """Standard deviation of an exact bead's place along an axis, px; 0 in a file without it."""
        return self.bead_noise_px if isinstance(self.bead_noise_px, float) else 0.0

    @property
    def typical_fields(self) -> TypicalFields | None:
        """Typical fields of the contacts; None in a file without them."""
        return self.typical if isinstance(self.typical, TypicalFields) else None

    def ring_of(self) -> Indices:
        """Return the ring index of each bead, (n,)."""
        return np.array([bead.ring for bead in self.beads], dtype=np.intp)
