"""Calibration of a sensor from a pose model and few presses of its own, or none.

The model's presses, brought into this sensor's image (transferred.py), stand in for its own: they give the
modes of displacement, the guide from marker density to displacement, and a first regression of the labels.
That is the average of regressions on the presses as they are and turned (turned_presses.py).
The axes of this table follow from own presses (label_axes.py). What the first regression has wrong is learned
from them (correction.py) and added.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import msgspec
import numpy as np

from palpate_edge.calibration.measurement import dropped_presses
from palpate_edge.calibration.pose.correction import OwnCorrection, fit_correction
from palpate_edge.calibration.pose.label_axes import AxisChange, declared_change, measured_change
from palpate_edge.calibration.pose.label_vectors import LabelVector, label_vectors
from palpate_edge.calibration.pose.pose_model import PoseModel
from palpate_edge.calibration.pose.press_matching import MIN_FOUND_TO_LEARN, is_clean
from palpate_edge.calibration.pose.principal_modes import PrincipalModes, principal_modes
from palpate_edge.calibration.pose.regression.kernel_regression import choose_settings, evenly, fit
from palpate_edge.calibration.pose.regression.label_regression import kinds_of
from palpate_edge.calibration.pose.regression.metric_learning import LearnedMetric, learn_metrics
from palpate_edge.calibration.pose.rest_markers import find_rest_markers
from palpate_edge.calibration.pose.spots import press_spots
from palpate_edge.calibration.pose.transferred import PressesHere, presses_here
from palpate_edge.calibration.pose.turned_presses import turned_presses
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
TURNED_LABELS = ("depth", "tilt")  # kinds that the skin shows; how far it slips differs more than it leans
MOST_JUDGED = 400  # presses that are predicted from all others
STRONGEST = 24  # directions of a metric; a board computes a distance for every press, turn and kind
OFF = 0.3  # deviations of a label; about what a model has wrong on another sensor
UNSEEN_SENSOR = 2.0  # errors on a sensor without presses over those on the model's own, left out
COVERING = 0.95


@dataclass(frozen=True, slots=True)
class TurnedFit:
    """Regression of one kind of labels on the presses after one turn: an expansion about `points` (s, m) for
    the labels at the places `some`. error (e, k): of presses predicted from all others."""

    some: list[int]
    points: Array
    expansion: Expansion
    error: Array

    def changed(self, change: AxisChange, labels: Sequence[str]) -> TurnedFit:
        """Return it for labels about other axes."""
        own = [labels[place] for place in self.some]
        weights, offset, error = (
            change.applied(values.astype(np.float64), own)
            for values in (self.expansion.weights.array(), self.expansion.offset.array()[None], self.error)
        )
        expansion = msgspec.structs.replace(self.expansion, weights=packed(weights), offset=packed(offset[0]))
        return replace(self, expansion=expansion, error=error)


@dataclass(frozen=True, slots=True)
class Base:
    """Regression of each kind of labels on the model's presses, the average over some turns of these: `fits`
    has a list for each kind. modes: of the presses after all turns; metrics: of each kind."""

    modes: PrincipalModes
    kinds: list[list[int]]
    metrics: list[LearnedMetric]
    fits: list[list[TurnedFit]]

    def predicted(self, points: Array) -> Array:
        """Return the labels (c, k) at points (c, m)."""
        labels = np.zeros((len(points), sum(len(some) for some in self.kinds)))
        for some, fits in zip(self.kinds, self.fits, strict=True):
            for fitted in fits:
                runner = ExpansionRunner(fitted.expansion, fitted.points)
                each = [runner.at(point) for point in points.astype(np.float32)]
                labels[:, some] += np.array(each) / len(fits)
        return labels

    def changed(self, change: AxisChange, labels: Sequence[str]) -> Base:
        """Return it for labels about other axes."""
        return replace(self, fits=[[each.changed(change, labels) for each in fits] for fits in self.fits])

    def centres(self) -> Array:
        """Return the points of all turns; those of the kind with most turns are those of all kinds."""
        return np.concatenate([each.points for each in max(self.fits, key=len)])


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
    targets, base = change.applied(here.targets, dataset.labels), base.changed(change, dataset.labels)
    centres = np.concatenate([base.centres(), points])
    groups, half_width = _groups(base, len(centres), targets.shape[1])
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
        centres=packed(centres),
        groups=groups,
        half_widths=Expansion(
            packed(np.eye(centres.shape[1])),
            packed(np.zeros((len(centres), len(dataset.labels)))),
            packed(np.log(np.maximum(half_width, 1e-9))),
        ),
        source=CalibrationSource(dataset.folder.resolve().name, len(dataset.reference), len(points), dropped),
        correction=_packed(base, targets, corrections, len(centres)) if corrections else msgspec.UNSET,
    )


def _learn(here: PressesHere, labels: Sequence[str], rest_px: Array) -> tuple[Base, Guide]:
    """Return modes, metrics and guide from the model's presses."""
    turned = turned_presses(here, rest_px, labels)
    modes = principal_modes(np.concatenate([each.displacement_px for each in turned]), DISPLACEMENT_MODES)
    points = modes.coordinates(here.displacement_px)
    kinds = kinds_of(labels)
    learned = learn_metrics(points, points.var(axis=0), [here.targets[:, some] for some in kinds])
    metrics = [_strongest(rounds[METRIC_ROUND], points) for rounds in learned]
    fits: list[list[TurnedFit]] = [[] for _ in kinds]
    for number, each in enumerate(turned):
        after = modes.coordinates(each.displacement_px)
        turned_back = _rotation(after, points)
        for some, metric, of_kind in zip(kinds, metrics, fits, strict=True):
            if number == 0 or labels[some[0]].startswith(TURNED_LABELS):
                of_kind.append(_fit_turned(after, turned_back, metric, each.targets, some))
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
    return Base(modes, kinds, metrics, fits), guide


def _fit_turned(
    points: Array, turned_back: Array, learned: LearnedMetric, targets: Array, some: list[int]
) -> TurnedFit:
    """Fit the labels `some` of targets (s, k) at points (s, m) that turned_back (m, m) turns to where the
    metric was learned."""
    judged = evenly(len(points), MOST_JUDGED)
    metric = turned_back @ learned.metric
    fitted = fit(points, metric, targets[:, some], SMOOTHER * learned.ridge, judged)
    return TurnedFit(some, points, fitted.expansion, targets[judged][:, some] - fitted.left_out)


def _strongest(learned: LearnedMetric, points: Array) -> LearnedMetric:
    """Return a metric without the directions in which points (s, m) differ least."""
    size = (points @ learned.metric).std(axis=0)
    return replace(learned, metric=learned.metric[:, np.argsort(-size)[:STRONGEST]])


def _rotation(points: Array, others: Array) -> Array:
    """Return the orthogonal matrix (m, m) that brings points (s, m) nearest to others (s, m)."""
    left, _, right = np.linalg.svd(points.T @ others)
    return np.asarray(left @ right)


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
        return change, [], np.zeros((0, base.modes.vectors.shape[1]))
    points = base.modes.coordinates(own.displacement_px)
    predicted = base.predicted(points)
    change = measured_change(predicted, own.targets, dataset.labels) or change
    first, targets = (change.applied(values, dataset.labels) for values in (predicted, here.targets))
    vectors = label_vectors(here, dataset.labels)
    left, deviation = own.targets - first, _deviations(targets, vectors)
    scaled = (first - targets.mean(axis=0)) / deviation
    corrections = []
    for some, learned in zip(base.kinds, base.metrics, strict=True):
        size = OFF * deviation[some]
        vector = next((one for one in vectors if list(one.places) == some), None)
        found = fit_correction(points, learned.metric, scaled, left[:, some] / size, vector, vectors)
        corrections.append(found.in_units(deviation, size))
    return change, corrections, points


def _deviations(targets: Array, vectors: Sequence[LabelVector]) -> Array:
    """Return the standard deviation (l,) of each label of targets (s, l), one for x and y of a vector."""
    deviation = targets.std(axis=0)
    for vector in vectors:
        places = list(vector.places)
        deviation[places] = np.sqrt(np.square(deviation[places]).mean())
    return np.asarray(deviation)


def _groups(base: Base, count: int, labels: int) -> tuple[tuple[LabelGroup, ...], Array]:
    """Return the groups of the model's regression with weights of `count` centres, of which the base's are
    the first, and the half widths (labels,) on a sensor without presses of its own."""
    groups, half_width = [], np.zeros(labels)
    for some, fits in zip(base.kinds, base.fits, strict=True):
        for number, fitted in enumerate(fits):
            weights, start = np.zeros((count, len(some))), number * len(fitted.points)
            weights[start : start + len(fitted.points)] = fitted.expansion.weights.array() / len(fits)
            offset = packed(fitted.expansion.offset.array() / len(fits))
            expansion = msgspec.structs.replace(fitted.expansion, weights=packed(weights), offset=offset)
            groups.append(LabelGroup(tuple(some), expansion))
            error = np.quantile(np.abs(fitted.error), COVERING, axis=0)
            half_width[some] += UNSEEN_SENSOR * error / len(fits)
    return tuple(groups), half_width


def _packed(base: Base, targets: Array, corrections: list[OwnCorrection], count: int) -> LabelCorrection:
    """Return the corrections of all kinds, for labels in their units; own centres are the last of `count`."""
    order = _order(base.kinds)
    trend = np.hstack([each.trend for each in corrections])[:, order]
    offset = np.concatenate([each.offset for each in corrections])[order] - targets.mean(axis=0) @ trend
    groups = []
    for some, each in zip(base.kinds, corrections, strict=True):
        weights = np.vstack([np.zeros((count - len(each.weights), len(some))), each.weights])
        expansion = Expansion(packed(each.metric), packed(weights), packed(np.zeros(len(some))), "matern")
        groups.append(LabelGroup(tuple(some), expansion))
    return LabelCorrection(packed(trend), packed(offset), tuple(groups))


def _order(kinds: list[list[int]]) -> Indices:
    """Return where each label is among the labels of all kinds in turn."""
    return np.argsort([label for some in kinds for label in some])
