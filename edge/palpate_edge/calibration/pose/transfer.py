"""Calibration of a sensor from a pose model and few presses of its own, or none.

The model's presses, brought into this sensor's image (transferred.py), stand in for its own: they give the
modes of displacement, the guide from marker density to displacement, and a first regression of the labels.
The axes of this table follow from own presses (label_axes.py). What the first regression has wrong is learned
from them (correction.py) and added.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import msgspec
import numpy as np

from palpate_edge.calibration.measurement import dropped_presses
from palpate_edge.calibration.pose.correction import OwnCorrection, fit_correction
from palpate_edge.calibration.pose.label_axes import AxisChange, declared_change, measured_change
from palpate_edge.calibration.pose.pose_model import PoseModel
from palpate_edge.calibration.pose.press_matching import MIN_FOUND_TO_LEARN, is_clean
from palpate_edge.calibration.pose.principal_modes import PrincipalModes, principal_modes
from palpate_edge.calibration.pose.regression.kernel_regression import choose_settings, fit
from palpate_edge.calibration.pose.regression.label_regression import kinds_of
from palpate_edge.calibration.pose.regression.metric_learning import LearnedMetric, learn_metrics
from palpate_edge.calibration.pose.rest_markers import find_rest_markers
from palpate_edge.calibration.pose.spots import press_spots
from palpate_edge.calibration.pose.transferred import PressesHere, presses_here
from palpate_edge.common.arrays import Array, Indices, Mask
from palpate_edge.datasets.pose_dataset import PoseDataset
from palpate_edge.estimation.calibration import CalibrationSource
from palpate_edge.estimation.pose.kernel_expansion import Expansion, ExpansionRunner, packed
from palpate_edge.estimation.pose.marker_density import MarkerDensity
from palpate_edge.estimation.pose.pairing import PairedMarkers, Pairing
from palpate_edge.estimation.pose.pose_calibration import Guide, LabelCorrection, LabelGroup, PoseCalibration
from palpate_edge.geometry.picture_sensor import LabelAxes
from palpate_edge.vision.blob_detection import Blobs

METRIC_ROUND = 0  # of metric_learning; later ones fit the model's own sensors only
FEWEST_OWN = 5  # presses; fewer change nothing
DENSITY_MODES, DISPLACEMENT_MODES = 60, 80
GUIDE_LENGTHS = (1.0, 2.0, 4.0)
GUIDED = 12  # displacement modes by which the guide's settings are chosen
SMOOTHER = 10.0  # ridge over the one that fits the model's own sensors best
OFF = 0.3  # deviations of a label; about what a model has wrong on another sensor
UNSEEN_SENSOR = 2.0  # errors on a sensor without presses over those on the model's own, left out
COVERING = 0.95


@dataclass(frozen=True, slots=True)
class Base:
    """Regression on the model's presses: points (s, m) in the modes, each kind's metric and ridge."""

    modes: PrincipalModes
    points: Array
    kinds: list[list[int]]
    metrics: list[LearnedMetric]


def calibrate_with_model(
    dataset: PoseDataset,
    model: PoseModel,
    progress: Callable[[int, int], None] = lambda _done, _total: None,
) -> PoseCalibration:
    """Calibrate a sensor with its reference frames, a pose model, and the train split of its presses, if any.

    Raises CalibrationError when the markers are not found or the model is of another kind of sensor.
    """
    presses = dataset.split("train")
    rest = find_rest_markers(dataset)
    here = presses_here(model, rest.position_px, dataset.labels)
    base, guide = _learn(here, dataset.labels, rest.position_px)
    spots = press_spots(dataset, presses, rest, lambda done: progress(done, len(presses) + 1))
    matches = _matched(rest.position_px, spots, base.modes, guide)
    good = _good(matches)
    moved = np.array([(match.position_px - rest.position_px).ravel() for match in matches]).reshape(
        len(matches), rest.position_px.size
    )
    own = PressesHere(
        moved[good], np.array([press.values for press in presses]).reshape(-1, len(dataset.labels))[good]
    )
    change, corrections, points = _adapt(base, here, own, dataset, model.axes)
    targets = change.applied(here.targets, dataset.labels)
    groups, half_width = _groups(base, targets, len(points))
    if corrections:
        half_width = np.concatenate([each.half_width for each in corrections])[_order(base.kinds)]
    dropped = dropped_presses(
        "markers could not be followed",
        [press for press, kept in zip(presses, good.tolist(), strict=True) if not kept],
    )
    if not len(points):
        unused = [press for press, kept in zip(presses, good.tolist(), strict=True) if kept]
        dropped += dropped_presses(f"fewer than {FEWEST_OWN} own presses are not learned from", unused)
    progress(len(presses) + 1, len(presses) + 1)
    count = len(base.points) + len(points)
    return PoseCalibration(
        sensor=dataset.sensor,
        appearance=rest.appearance,
        diameter_px=rest.diameter_px,
        weakest_strength=rest.weakest_strength,
        beads=tuple((x, y) for x, y in rest.position_px.tolist()),
        contact_threshold_px=rest.contact_threshold_px,
        labels=dataset.labels,
        mean=tuple((own.targets if len(points) else targets).mean(axis=0).tolist()),
        displacement=base.modes.as_modes(),
        guide=guide,
        centres=packed(np.vstack([base.points, points])),
        groups=groups,
        half_widths=Expansion(
            packed(np.eye(base.points.shape[1])),
            packed(np.zeros((count, len(dataset.labels)))),
            packed(np.log(np.maximum(half_width, 1e-9))),
        ),
        source=CalibrationSource(dataset.folder.resolve().name, len(dataset.reference), len(points), dropped),
        correction=_packed(base, targets, corrections) if corrections else msgspec.UNSET,
    )


def _learn(here: PressesHere, labels: Sequence[str], rest_px: Array) -> tuple[Base, Guide]:
    """Return modes, metrics and guide from the model's presses."""
    modes = principal_modes(here.displacement_px, DISPLACEMENT_MODES)
    points = modes.coordinates(here.displacement_px)
    kinds = kinds_of(labels)
    learned = learn_metrics(points, modes.variance, [here.targets[:, some] for some in kinds])
    density = MarkerDensity(rest_px)
    codes = np.array(
        [density.of(rest_px + moved.reshape(-1, 2)) for moved in here.displacement_px], dtype=np.float64
    )
    density_modes = principal_modes(codes, DENSITY_MODES)
    centres = density_modes.coordinates(codes)
    (settings,) = choose_settings(
        centres, density_modes.variance, [points[:, :GUIDED]], (0.0,), GUIDE_LENGTHS
    )
    fitted = fit(centres, settings.metric(density_modes.variance), points, settings.ridge)
    guide = Guide(density_modes.as_modes(), packed(centres), fitted.expansion)
    return Base(modes, points, kinds, [rounds[METRIC_ROUND] for rounds in learned]), guide


def _matched(rest_px: Array, spots: list[Blobs], modes: PrincipalModes, guide: Guide) -> list[PairedMarkers]:
    """Pair the spots of each own press with the markers, from where the guide expects them."""
    density, pairing = MarkerDensity(rest_px), Pairing(rest_px)
    mean, vectors = guide.density.mean.array(), guide.density.vectors.array()
    runner = ExpansionRunner(guide.expansion, guide.centres.array())
    matches = []
    for some in spots:
        point = (density.of(some.position_px) - mean) @ vectors
        moved = modes.values(runner.at(point.astype(np.float32)).astype(np.float64))
        matches.append(pairing.match(rest_px + moved.reshape(-1, 2), some))
    return matches


def _good(matches: list[PairedMarkers]) -> Mask:
    return np.array([is_clean(match, MIN_FOUND_TO_LEARN) for match in matches], dtype=np.bool_)


def _adapt(
    base: Base, here: PressesHere, own: PressesHere, dataset: PoseDataset, axes: LabelAxes | None
) -> tuple[AxisChange, list[OwnCorrection], Array]:
    """Return the change to this table's axes, a correction for each kind, and the own points (c, m) about
    which these are; none of them with fewer than `FEWEST_OWN` presses."""
    change = declared_change(axes or LabelAxes(), dataset.sensor.labels or LabelAxes())
    if len(own.targets) < FEWEST_OWN:
        return change, [], np.zeros((0, base.points.shape[1]))
    points = base.modes.coordinates(own.displacement_px)
    predicted = np.empty_like(own.targets)
    for some, learned in zip(base.kinds, base.metrics, strict=True):
        expansion = fit(
            base.points, learned.metric, here.targets[:, some], SMOOTHER * learned.ridge
        ).expansion
        runner = ExpansionRunner(expansion, base.points)
        predicted[:, some] = [runner.at(point) for point in points.astype(np.float32)]
    change = measured_change(predicted, own.targets, dataset.labels) or change
    first, targets = (change.applied(values, dataset.labels) for values in (predicted, here.targets))
    left, deviation = own.targets - first, targets.std(axis=0)
    scaled = (first - targets.mean(axis=0)) / deviation
    corrections = []
    for some, learned in zip(base.kinds, base.metrics, strict=True):
        size = OFF * deviation[some]
        found = fit_correction(points, learned.metric, scaled, left[:, some] / size)
        corrections.append(found.times(size))
    return change, corrections, points


def _groups(base: Base, targets: Array, own: int) -> tuple[tuple[LabelGroup, ...], Array]:
    """Return the groups of the model's regression, followed by `own` centres without weight, and the half
    widths (k,) on a sensor without presses of its own."""
    groups, half_width = [], np.empty(targets.shape[1])
    for some, learned in zip(base.kinds, base.metrics, strict=True):
        fitted = fit(base.points, learned.metric, targets[:, some], SMOOTHER * learned.ridge)
        weights = np.vstack([fitted.expansion.weights.array(), np.zeros((own, len(some)))])
        groups.append(
            LabelGroup(tuple(some), msgspec.structs.replace(fitted.expansion, weights=packed(weights)))
        )
        error = np.abs(targets[:, some] - fitted.left_out)
        half_width[some] = UNSEEN_SENSOR * np.quantile(error, COVERING, axis=0)
    return tuple(groups), half_width


def _packed(base: Base, targets: Array, corrections: list[OwnCorrection]) -> LabelCorrection:
    """Return the corrections of all kinds, for labels in their units."""
    order = _order(base.kinds)
    trend = np.hstack([each.trend for each in corrections])[:, order] / targets.std(axis=0)[:, None]
    offset = np.concatenate([each.offset for each in corrections])[order] - targets.mean(axis=0) @ trend
    groups = []
    for some, each in zip(base.kinds, corrections, strict=True):
        weights = np.vstack([np.zeros((len(base.points), len(some))), each.weights])
        expansion = Expansion(packed(each.metric), packed(weights), packed(np.zeros(len(some))), "matern")
        groups.append(LabelGroup(tuple(some), expansion))
    return LabelCorrection(packed(trend), packed(offset), tuple(groups))


def _order(kinds: list[list[int]]) -> Indices:
    """Return where each label is among the labels of all kinds in turn."""
    return np.argsort([label for some in kinds for label in some])
