"""Press dataset -> Calibration: layout and camera from the reference frames, the rest from the presses."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray

from palpate_edge.calibration.measurement import Measured, measure
from palpate_edge.calibration.mounting import check_mounting, find_mounting
from palpate_edge.calibration.training.dome_model import DomeModel
from palpate_edge.datasets.press_dataset import Press, PressDataset
from palpate_edge.estimation.calibration import Bead, Calibration, CalibrationSource, FittedBead, JigErrors
from palpate_edge.estimation.contact_fit.contact_fields import ContactFields
from palpate_edge.estimation.contact_fit.place_stiffness import PlaceStiffness
from palpate_edge.estimation.field_smoothing.typical_fields import TypicalFields
from palpate_edge.estimation.paper_method import PaperModel, RawContact, fit_paper_model, raw_contact
from palpate_edge.estimation.virtual_points import VirtualPointMesh
from palpate_edge.geometry.angles import polar_angle, rotation_about_z
from palpate_edge.geometry.sensor import Sensor
from palpate_edge.vision.beads import COLOUR_FIT, SLOPED_LIGHT, Reference

if TYPE_CHECKING:
    from palpate_edge.calibration.training.kernel_ridge import Regression
    from palpate_edge.calibration.training.samples import TrainingPress

Progress = Callable[[int, int], None]  # done, total

MIN_PRESS_FORCE_N = 0.1  # lighter presses say nothing about the paper's polynomials
TRAINING_STEPS = 100  # of the progress bar


@dataclass(frozen=True, slots=True)
class _Trained:
    """The correction model's ONNX file, empty without one, and the regression in it; the sensor's contact
    fields and stiffness by place, unset where they do not help."""

    model: bytes = b""
    regression: Regression | None = None
    contact_fields: ContactFields | msgspec.UnsetType = msgspec.UNSET
    place_stiffness: PlaceStiffness | msgspec.UnsetType = msgspec.UNSET


def calibrate(
    dataset: PressDataset,
    progress: Progress = lambda _done, _total: None,
    *,
    dome: DomeModel | None = None,
) -> Calibration:
    """Calibrate one sensor with its reference frames and the train split of its presses, if any.

    dome: the dome model that the correction model starts from (extra ``train``); without it there is no
    correction model, and the paper's method is all. Raises CalibrationError where the reference frames do
    not show the layout or the camera is turned, DatasetError for bad files.
    """
    presses = dataset.split("train")
    images = len(dataset.reference) + len(presses)
    total = images + (TRAINING_STEPS if dome is not None else 0)
    measured = _upright(dataset.sensor, measure(dataset, presses, lambda done: progress(done, total)))
    trained, jig, typical = _Trained(), None, None
    open_rad = 0.0
    if dome is not None and not dataset.sensor.markers.rings:
        measured, open_rad = _with_camera_of_presses(dataset.sensor, dome, measured)
    if dome is not None:
        measured = _with_fitted_beads(dataset, dome, measured)
        dome = _seen(dataset.sensor, dome, measured)
        measured, dome, jig = _adjusted(dataset.sensor, dome, measured)
        if jig is not None and jig.used:
            open_rad = 0.0  # its holes determine the angles
        typical = _typical_fields(dataset.sensor, dome, measured)
        trained = _train(
            dataset.sensor, dome, measured, typical, open_rad, lambda done: progress(images + done, total)
        )
    ring_of, reference = measured.registration.ring_of, measured.reference
    off_px = measured.view.project(measured.registration.layout_mm) - measured.reference.position_px
    return Calibration(
        sensor=dataset.sensor,
        pose=measured.registration.pose,
        appearance=measured.registration.appearance,
        beads=_beads(measured.reference, ring_of),
        contact_threshold_px=measured.threshold_px,
        contact_threshold_N=measured.threshold_N,
        paper=_fit_paper(measured, ring_of, dataset.sensor.markers.radius_mm),
        residual_px=float(np.sqrt((off_px**2).sum(axis=1).mean())),
        source=_source(dataset, measured, trained.regression, jig),
        model=trained.model,
        stiffness_scale=None if trained.regression is None else trained.regression.stiffness_scale,
        fit_sigma_px=msgspec.UNSET if reference.fit_sigma_px is None else reference.fit_sigma_px,
        fit_channels=msgspec.UNSET if reference.fit_channels == COLOUR_FIT else reference.fit_channels,
        fit_light=msgspec.UNSET if reference.fit_light == SLOPED_LIGHT else reference.fit_light,
        fitted_beads=_fitted_beads(reference),
        bead_noise_px=measured.bead_noise_px,
        typical=msgspec.UNSET if typical is None else typical,
        contact_fields=trained.contact_fields,
        place_stiffness=trained.place_stiffness,
    )


def _fitted_beads(reference: Reference) -> tuple[FittedBead, ...] | msgspec.UnsetType:
    if reference.fit_offset_px is None:
        return msgspec.UNSET
    offsets = enumerate(reference.fit_offset_px.tolist())
    return tuple(FittedBead(bead, x_px, y_px) for bead, (x_px, y_px) in offsets if math.isfinite(x_px))


def _source(
    dataset: PressDataset, measured: Measured, regression: Regression | None, jig: JigErrors | None
) -> CalibrationSource:
    apex = None if regression is None else regression.apex
    weighed = sum(press.is_weighed for press, _ in measured.touches)
    return CalibrationSource(
        dataset.folder.resolve().name,
        len(dataset.reference),
        len(measured.touches) - weighed,
        measured.dropped,
        weighed,
        None if apex is None else 100 * apex.spread,
        () if regression is None else regression.regions,
        jig,
        measured.touched_references,
        measured.moved_references,
    )


def _fit_paper(measured: Measured, ring_of: NDArray[np.intp], radius_mm: float) -> PaperModel:
    """Fit the paper's correction function and, where forces are known, its stiffness to the presses."""
    placed = replace(measured, touches=tuple(touch for touch in measured.touches if not touch[0].is_weighed))
    firm, raw = _raw_contacts(placed, ring_of, radius_mm)
    has_forces = all(press.force_N is not None for press in firm)
    places = _places(firm)
    return fit_paper_model(
        theta_raw=np.array([contact.theta_rad for contact in raw]),
        theta_true=polar_angle(places),
        spread_px=np.array([contact.spread_px for contact in raw]),
        force_N=np.array([press.normal_force_N for press in firm]) if has_forces else None,
    )


def _raw_contacts(
    measured: Measured, ring_of: NDArray[np.intp], radius_mm: float
) -> tuple[list[Press], list[RawContact]]:
    """Return the presses of known place that are firm enough for the paper's method, and their uncorrected
    contacts."""
    mesh = VirtualPointMesh(measured.reference.position_px, ring_of)
    firm = [
        (press, beads)
        for press, beads in measured.touches
        if press.position_mm is not None
        and (press.normal_force_N is None or press.normal_force_N >= MIN_PRESS_FORCE_N)
    ]
    raw = [
        raw_contact(mesh, mesh.points(beads.position_px, beads.found), measured.view, radius_mm)
        for _, beads in firm
    ]
    return [press for press, _ in firm], raw


def _places(presses: list[Press]) -> NDArray[np.float64]:
    """Return the places (n, 3) of presses."""
    return np.array([press.position_mm for press in presses], dtype=np.float64).reshape(-1, 3)


def _upright(sensor: Sensor, measured: Measured) -> Measured:
    """Return the measurement with a learned layout turned as the presses are; refuse a drawn one turned."""
    firm, raw = _raw_contacts(measured, measured.registration.ring_of, sensor.markers.radius_mm)
    mounting = find_mounting(np.array([contact.phi_rad for contact in raw]), _places(firm))
    check_mounting(mounting, can_turn=not sensor.markers.rings)
    if mounting.upright:
        return measured
    from palpate_edge.calibration.training.learned_camera import turned  # noqa: PLC0415 - rarely needed

    return turned(measured, sensor, rotation_about_z(mounting.turn_rad))


def _with_camera_of_presses(sensor: Sensor, dome: DomeModel, measured: Measured) -> tuple[Measured, float]:
    from palpate_edge.calibration.training.learned_camera import (  # noqa: PLC0415 - extra `train`
        with_camera_of_presses,
    )

    return with_camera_of_presses(measured, sensor, dome)


def _with_fitted_beads(dataset: PressDataset, dome: DomeModel, measured: Measured) -> Measured:
    from palpate_edge.calibration.fitted_beads import with_fitted_beads  # noqa: PLC0415 - extra `train`

    return with_fitted_beads(dataset, dome.for_markers(dataset.sensor.markers.radius_mm), measured)


def _seen(sensor: Sensor, dome: DomeModel, measured: Measured) -> DomeModel:
    """Return the dome model as this sensor shows it.

    With inexact beads presses as other sensors show them are the better basis of own presses.
    """
    from palpate_edge.calibration.seen_presses import seen_by  # noqa: PLC0415 - extra `train`
    from palpate_edge.calibration.training.kernel_ridge import FEWEST_PRESSES  # noqa: PLC0415
    from palpate_edge.calibration.training.samples import training_presses  # noqa: PLC0415

    presses = training_presses(measured)
    taught = len(presses) >= FEWEST_PRESSES
    if measured.is_inexact and taught:
        return dome
    of_size = dome.for_markers(sensor.markers.radius_mm)
    return seen_by(
        measured.reader(sensor.markers.radius_mm), measured.view, of_size, presses if taught else ()
    )


def _adjusted(
    sensor: Sensor, dome: DomeModel, measured: Measured
) -> tuple[Measured, DomeModel, JigErrors | None]:
    """Return the measurement and the dome model adjusted to the places of a jig, and the jig's errors."""
    from palpate_edge.calibration.training.dome_adjustment import fit_adjustment  # noqa: PLC0415
    from palpate_edge.calibration.training.learned_camera import (  # noqa: PLC0415 - extra `train`
        estimated_directions,
        turned,
    )
    from palpate_edge.calibration.training.samples import jig_presses  # noqa: PLC0415

    presses = jig_presses(measured)
    if not presses:
        return measured, dome, None
    given = estimated_directions(
        measured.reader(sensor.markers.radius_mm),
        [press.beads for press in presses],
        dome.for_markers(sensor.markers.radius_mm),
    )
    radius_mm, is_drawn = sensor.dome.outer_radius_mm, bool(sensor.markers.rings)
    adjustment = fit_adjustment(given, presses, radius_mm, is_drawn=is_drawn)
    turn, _ = cv2.Rodrigues(adjustment.numbers[:3])
    return turned(measured, sensor, np.asarray(turn)), adjustment.stretched(dome), adjustment.errors


def _typical_fields(sensor: Sensor, dome: DomeModel, measured: Measured) -> TypicalFields:
    """Return the typical fields of the dome model's contacts and the sensor's own."""
    from palpate_edge.calibration.training.samples import training_presses  # noqa: PLC0415 - extra `train`
    from palpate_edge.calibration.training.typical_contacts import typical_fields  # noqa: PLC0415

    reader = measured.reader(sensor.markers.radius_mm)
    own = [reader.read(press.beads).values for press in training_presses(measured)]
    return typical_fields(
        reader,
        np.array(own).reshape(-1, dome.fields.shape[1]),
        dome.fields,
        smooths_all=measured.is_inexact,
    )


def _train(
    sensor: Sensor,
    dome: DomeModel,
    measured: Measured,
    typical: TypicalFields,
    open_rad: float,
    progress: Callable[[int], None],
) -> _Trained:
    """Return the correction model and what improves its answers on this sensor.

    open_rad: see confidence_radius.constant_radius.
    There are contact fields only where the typical ones smooth all frames and where they improve the places.
    """
    from palpate_edge.calibration.contact_fit.combined_place import fit_combined_place  # noqa: PLC0415
    from palpate_edge.calibration.training.kernel_ridge import fit  # noqa: PLC0415 - extra `train`
    from palpate_edge.calibration.training.onnx_export import export  # noqa: PLC0415
    from palpate_edge.calibration.training.place_stiffness import refit_evenly  # noqa: PLC0415
    from palpate_edge.calibration.training.samples import (  # noqa: PLC0415
        REGION_SHARE,
        make_samples,
        training_presses,
        weighed_samples,
    )

    radius_mm = sensor.markers.radius_mm
    reader = measured.reader(radius_mm, typical)
    presses, weighed = training_presses(measured), weighed_samples(measured, reader)
    of_size = dome.for_markers(radius_mm)

    def fit_to(touches: Sequence[TrainingPress], report: Progress = lambda _done, _total: None) -> Regression:
        return fit(
            make_samples(reader, touches, region_share=REGION_SHARE) if touches else None,
            of_size,
            sensor.dome.outer_radius_mm,
            report,
            weighed,
            open_rad,
        )

    regression, stiffness = refit_evenly(
        fit_to(presses, lambda done, steps: progress(TRAINING_STEPS * done // steps)),
        presses,
        fit_to,
    )
    place_stiffness: PlaceStiffness | msgspec.UnsetType = msgspec.UNSET
    if stiffness is not None:
        place_stiffness = stiffness.stiffness
        regression = replace(regression, force95=stiffness.force95)
    trained = _Trained(
        export(regression, sensor.fingerprint(), dome.fields), regression, place_stiffness=place_stiffness
    )
    if not typical.smooths_all:
        return trained
    combined = fit_combined_place(
        reader,
        measured.bead_noise_px,
        presses,
        of_size,
        regression,
        sensor.dome.outer_radius_mm,
    )
    if combined is None:
        return trained
    return replace(
        trained,
        regression=replace(regression, regions=combined.regions),
        contact_fields=combined.fields,
    )


def _beads(reference: Reference, ring_of: NDArray[np.intp]) -> tuple[Bead, ...]:
    assert reference.shading is not None
    assert reference.unevenness is not None
    columns = (
        *reference.position_px.T,
        reference.diameter_px,
        reference.contrast,
        reference.area,
        *reference.shading.slope.T,
        reference.unevenness,
    )
    values = zip(*(column.tolist() for column in columns), ring_of.tolist(), strict=True)
    return tuple(Bead(*looks) for looks in values)
