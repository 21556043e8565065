"""Kernel ridge regression from canonical fields to contact direction, force and uncertainty.

The field is split into its shape (norm 1) and its size (logarithm of the norm): a press keeps nearly the
same shape while it deepens, so shape determines the place, and force over size is nearly constant.

Kernel expansions are added: one fitted to the dome model (presses of other domes), and one for the place and
one for the force fitted to what the sensor's own presses leave of it. Either kind may be absent.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from palpate_edge.calibration.training.answer_field import AnswerField, fit_answer_field
from palpate_edge.calibration.training.apex_stiffness import (
    ApexStiffness,
    apex_stiffness,
    typical_force_interval,
)
from palpate_edge.calibration.training.dome_model import DomeModel
from palpate_edge.calibration.training.gaussian_kernel import gaussian_kernel
from palpate_edge.calibration.training.inverse_factor import inverse_factor
from palpate_edge.calibration.training.left_out import LeftOut, force_misses_N, mean_miss_N
from palpate_edge.calibration.training.projection import Projection, fit_projection
from palpate_edge.calibration.training.samples import Samples, WeighedSamples
from palpate_edge.calibration.training.torsion import KnownTorsions, fit_torsion
from palpate_edge.calibration.training.trained_expansion import TrainedExpansion, joined_expansion
from palpate_edge.calibration.training.uncertainty.confidence_radius import (
    ConfidenceRadius,
    constant_radius,
    fit_radius,
    left_out_residuals,
    strangeness,
)
from palpate_edge.calibration.training.uncertainty.interval import Interval, fit_interval
from palpate_edge.calibration.training.uncertainty.left_out_regions import region_errors
from palpate_edge.common.arrays import Array, Mask
from palpate_edge.estimation.calibration import RegionErrors

DOME_LENGTH, DOME_RIDGE = 1.0, 5e-3
ALONE_LENGTH, ALONE_RIDGE = 2.58, 3e-5  # of the dome model without presses of the sensor
FIRM = 0.5  # of the median size of the dome model's fields; the force of a smaller one is less exact
# Length and ridge of the sensor's own parts.
LENGTHS, RIDGES = (0.7, 1.5, 4.0), (1e-4, 1e-3, 1e-2, 1e-1, 1.0)
SETTINGS = len(LENGTHS) * len(RIDGES)  # pairs of them
VARIED_NOISE = 4.0  # of turned presses and those with hidden beads, over a plain one's
CHOOSINESS = 10.0  # power of the smallest score over a setting's own, by which settings are averaged
LEAST_SCORE = 1e-9  # mm, N; forces that are all zero are learned without error, by each setting
FEWEST_PRESSES = 5  # that a difference to the dome model is learned from


@dataclass(frozen=True, slots=True)
class Regression:
    """A fitted model.

    centres (c, q), their kernel's length, weights (c, 7) and offset (7,): direction, force over size in
    N/mm, log radius; hidden_slope: log radius a blind spot. stiffness_scale: forces of this
    sensor over the dome model's; None without presses of known force, and then forces are the dome's.
    answer_field: what field an answer would make. torsion_weights (c,): torsion over size, N; None without
    presses of known torsion. force95, torsion95: 95 % half widths of force and torsion, None where unknown.
    apex: of weighed presses, when the stiffness comes from them. regions: errors of presses left out in turn;
    left_out: predictions of these, None with too few.
    """

    projection: Projection
    centres: Array
    length: float
    weights: Array
    offset: Array
    hidden_slope: float
    stiffness_scale: float | None
    answer_field: AnswerField
    torsion_weights: Array | None = None
    force95: Interval | None = None
    torsion95: Interval | None = None
    apex: ApexStiffness | None = None
    regions: tuple[RegionErrors, ...] = ()
    left_out: LeftOut | None = None

    def predict(self, fields: Array, hidden: Array) -> tuple[Array, Array, Array]:
        """Unit directions (s, 3), forces (s, 3) N and 95 % radii (s,) mm."""
        points = self.projection.points(fields)
        raw = gaussian_kernel(points, self.centres, self.length) @ self.weights + self.offset
        force = raw[:, 3:6] * np.linalg.norm(fields, axis=1, keepdims=True)
        return _unit(raw[:, :3]), force, np.exp(raw[:, 6] + self.hidden_slope * hidden)

    def torsions_Nmm(self, fields: Array) -> Array | None:
        """Torsions (s,) about the inward normal; None where they were not learned."""
        if self.torsion_weights is None:
            return None
        kernels = gaussian_kernel(self.projection.points(fields), self.centres, self.length)
        return np.asarray(kernels @ self.torsion_weights * np.linalg.norm(fields, axis=1))

    def misfit(self, fields: Array) -> Array:
        """(s,): squared distance of each field's shape to that of a contact with the answer."""
        direction, force, _ = self.predict(fields, np.zeros(len(fields)))
        size = np.linalg.norm(fields, axis=1)
        off = fields / size[:, None] - self.projection.mean
        answered = self.answer_field.shapes(direction, force, size) @ self.projection.components.T
        return np.asarray(((off - answered) ** 2).sum(axis=1))


def fit(
    samples: Samples | None,
    dome: DomeModel | None,
    radius_mm: float,
    progress: Callable[[int, int], None] = lambda _done, _total: None,
    weighed: WeighedSamples | None = None,
    open_rad: float = 0.0,
) -> Regression:
    """Fit to the sensor's own samples, to the dome model, or to both (at least one).

    radius_mm: of the dome, on which position errors are measured. Settings and uncertainty come from
    predictions of presses left out in turn. weighed: gives the stiffness when no sample has a force; needs
    the dome model. open_rad: see constant_radius; for the dome model alone.
    """
    taught = samples is not None and (dome is None or samples.press.max() + 1 >= FEWEST_PRESSES)
    projection = _project(samples, dome, taught=taught)
    settings = (DOME_LENGTH, DOME_RIDGE) if taught else (ALONE_LENGTH, ALONE_RIDGE)
    base = _fit_dome(projection, dome, *settings) if dome is not None else None
    scale = apex = None
    has_forces = samples is not None and samples.has_forces
    if samples is not None and has_forces:
        scale = 1.0 if base is None else _stiffness_scale(projection, base, samples)
    elif base is not None and weighed is not None:
        apex = apex_stiffness(base.at(projection.points(weighed.fields)), weighed)
        scale = apex.scale
    if base is not None and scale is not None:
        factor = np.array([1, 1, 1, scale, scale, scale])
        base = TrainedExpansion(base.centres, base.length, base.weights * factor, base.offset * factor)
    if samples is not None and not has_forces:
        samples = _with_assumed_forces(samples, projection, base)
    progress(1, 1 + SETTINGS)
    own: list[TrainedExpansion] = []
    radius, left_out = constant_radius(radius_mm, open_rad), None
    given = None
    if samples is not None and taught:
        points = projection.points(samples.fields)
        given = None if base is None else base.at(points)
        own, radius, left_out = _fit_own(points, given, samples, radius_mm, progress)
    answer_field = fit_answer_field(projection.mean, projection.components, samples, dome)
    strange = None
    if own and samples is not None and dome is not None:
        strange = strangeness(dome.directions, samples.directions)
    whole = joined_expansion(base, own, radius, strange)
    regression = Regression(
        projection=projection,
        centres=whole.centres,
        length=whole.length,
        weights=whole.weights,
        offset=whole.offset,
        hidden_slope=radius.hidden_slope,
        stiffness_scale=scale,
        answer_field=answer_field,
        apex=apex,
    )
    if apex is not None and dome is not None:
        regression = replace(regression, force95=typical_force_interval(dome, apex.scale))
    if samples is None or left_out is None:
        return regression
    error_mm = _position_error_mm(left_out, samples, radius_mm)
    forces_N = _forces_N(left_out, samples)
    dome_N = None if given is None else _forces_N(given, samples)
    regression = replace(
        regression,
        regions=region_errors(samples, error_mm, radius.held),
        left_out=LeftOut(samples, _unit(left_out[:, :3]), forces_N, radius, dome_N),
    )
    if has_forces:
        regression = replace(regression, force95=fit_interval(force_misses_N(forces_N, samples), samples))
    return regression if samples.torsions_Nmm is None else _with_torsion(regression, samples, dome)


def _with_torsion(regression: Regression, samples: Samples, dome: DomeModel | None) -> Regression:
    """Return the regression with the torsion of the samples, which must be known."""
    assert samples.torsions_Nmm is not None
    centres = regression.centres

    def kernels(points: Array) -> Array:
        return gaussian_kernel(points, centres, regression.length)

    others = None
    if dome is not None and dome.twisted is not None and regression.stiffness_scale is not None:
        fields = dome.twisted.fields
        torsions_Nmm = regression.stiffness_scale * dome.twisted.torsions
        others = KnownTorsions(
            kernels(regression.projection.points(fields)), torsions_Nmm / np.linalg.norm(fields, axis=1)
        )
    own = kernels(regression.projection.points(samples.fields))
    torsion = fit_torsion(own, kernels(centres), samples, others)
    torsion95 = fit_interval(np.abs(torsion.left_out_Nmm - samples.torsions_Nmm), samples)
    if torsion95 is None:
        return regression
    return replace(regression, torsion_weights=torsion.weights, torsion95=torsion95)


def _project(samples: Samples | None, dome: DomeModel | None, *, taught: bool) -> Projection:
    """Components of all shapes, and where the sensor's own presses teach too, the dome model's metric.

    The dome model alone is better without it: parts that matter little in one kind of dome keep the answer
    right in another. Presses that are left out in turn must not have taught it.
    """
    fields = np.concatenate([part.fields for part in (samples, dome) if part is not None])
    if dome is None or not taught:
        return fit_projection(fields, None, None)
    noise, off = _force_noise(dome), _targets(dome.fields, dome.directions, dome.forces)
    off -= _offset(off, noise)
    off[:, 3:] /= np.sqrt(noise)[:, None]
    deviation = [np.sqrt((part**2).mean()) * np.ones(3) for part in (off[:, :3], off[:, 3:])]
    return fit_projection(fields, dome.fields, off / np.concatenate(deviation))


def _force_noise(dome: DomeModel) -> Array:
    """Return the variance (n,) of each press's force over its field's size, over that of a firm press."""
    size = np.linalg.norm(dome.fields, axis=1)
    return np.asarray(np.maximum(1.0, FIRM * np.median(size) / size) ** 2)


def _varied_noise(plain: Mask) -> Array:
    """Return the variance (n,) of turned presses and those with hidden beads, over that of plain ones."""
    return np.where(plain, 1.0, VARIED_NOISE)


def _offset(targets: Array, noise: Array) -> Array:
    """Return the mean (6,) of targets (n, 6), that of forces by their noise (n,)."""
    force = np.average(targets[:, 3:], axis=0, weights=1.0 / noise)
    return np.concatenate([targets[:, :3].mean(axis=0), force])


def _fit_dome(projection: Projection, dome: DomeModel, length: float, ridge: float) -> TrainedExpansion:
    points, faint = projection.points(dome.fields), _force_noise(dome)
    noise = _varied_noise(np.zeros(len(points), np.bool_) if dome.plain is None else dome.plain)
    target = _targets(dome.fields, dome.directions, dome.forces)
    offset = _offset(target, faint)
    gram, off = gaussian_kernel(points, points, length), target - offset
    places = np.linalg.solve(gram + np.diag(ridge * noise), off[:, :3])
    forces = np.linalg.solve(gram + np.diag(ridge * noise * faint), off[:, 3:])
    return TrainedExpansion(points, length, np.concatenate([places, forces], axis=1), offset)


def _with_assumed_forces(samples: Samples, projection: Projection, base: TrainedExpansion | None) -> Samples:
    """Return the samples with the dome model's forces, inward ones without it, in place of unknown ones.

    The place is then learned as from any presses; the forces are never given out.
    """
    size = np.linalg.norm(samples.fields, axis=1, keepdims=True)
    relative = -samples.directions if base is None else base.at(projection.points(samples.fields))[:, 3:]
    return replace(samples, forces_N=np.asarray(relative * size))


def _stiffness_scale(projection: Projection, base: TrainedExpansion, samples: Samples) -> float:
    """Least squares of the sensor's forces on the dome model's, over the plain samples."""
    plain = samples.plain
    given = base.at(projection.points(samples.fields[plain]))[:, 3:]
    truth = _targets(samples.fields, samples.directions, samples.forces_N)[plain, 3:]
    return float((given * truth).sum() / (given**2).sum())


def _fit_own(
    points: Array,
    given: Array | None,
    samples: Samples,
    radius_mm: float,
    progress: Callable[[int, int], None],
) -> tuple[list[TrainedExpansion], ConfidenceRadius, Array]:
    """The sensor's own expansions with the log radius, one a length; how far left-out presses were missed,
    and their predicted targets (s, 6).

    points (s, q) of the samples; given (s, 6): targets by the dome model, None without one.
    All settings take part, those the most that predict left-out presses best: the best one alone is a matter
    of chance with few presses. The ridge is the noise of a firm press as it was measured; that of a faint
    one is as many times as large as its error may be (motion.faintness), squared.
    """
    target = _targets(samples.fields, samples.directions, samples.forces_N)
    groups = [np.flatnonzero(samples.press == press) for press in np.unique(samples.press)]
    known = np.broadcast_to(target.mean(axis=0), target.shape) if given is None else given
    noise = np.diag(samples.faintness**2 * _varied_noise(samples.plain))
    fitted, held_out = [], []
    for length in LENGTHS:
        gram = gaussian_kernel(points, points, length)
        for ridge in RIDGES:
            factor = inverse_factor(gram + ridge * noise)
            weights = factor.T @ (factor @ (target - known))
            fitted.append(weights)
            held_out.append(target - left_out_residuals(factor, weights, groups))
            progress(1 + len(fitted), 1 + SETTINGS)
    shares = _shares(held_out, samples, radius_mm)
    left_out = (shares * held_out).sum(axis=0)
    error_mm = _position_error_mm(left_out, samples, radius_mm)
    by_length = shares[:, 0, 0].reshape(len(LENGTHS), -1).sum(axis=1)
    chosen = LENGTHS[int(by_length.argmax())]
    gram = gaussian_kernel(points, points, chosen)
    radius = fit_radius(gram, error_mm, samples, groups, radius_mm)
    summed = (shares * fitted).reshape(len(LENGTHS), len(RIDGES), *target.shape).sum(axis=1)
    offset = np.append(target.mean(axis=0) if given is None else np.zeros(6), 0.0)
    own = [
        TrainedExpansion(
            points,
            length,
            np.column_stack([weights, radius.weights * (length == chosen)]),
            offset / len(LENGTHS),
        )
        for length, weights in zip(LENGTHS, summed, strict=True)
    ]
    return own, radius, left_out


def _shares(held_out: list[Array], samples: Samples, radius_mm: float) -> Array:
    """Return the share (settings, 1, 6) of each setting in each target, from its left-out predictions."""
    scores = np.array(
        [
            (
                _position_score(_position_error_mm(some, samples, radius_mm), samples),
                _force_score(some, samples),
            )
            for some in held_out
        ]
    )
    scores = np.maximum(scores, LEAST_SCORE)
    shares = (scores.min(axis=0) / scores) ** CHOOSINESS
    return np.repeat(shares / shares.sum(axis=0), 3, axis=1)[:, None]


def _targets(fields: Array, directions: Array, forces: Array) -> Array:
    """(s, 6): direction, and force over the field's size."""
    return np.concatenate([directions, forces / np.linalg.norm(fields, axis=1, keepdims=True)], axis=1)


def _forces_N(prediction: Array, samples: Samples) -> Array:
    """Return the forces (s, 3) of predicted targets (s, 6)."""
    return np.asarray(prediction[:, 3:] * np.linalg.norm(samples.fields, axis=1, keepdims=True))


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))


def _position_error_mm(prediction: Array, samples: Samples, radius_mm: float) -> Array:
    """Return the distances (s,) between predicted (s, 6) and true places."""
    return np.asarray(radius_mm * np.linalg.norm(_unit(prediction[:, :3]) - samples.directions, axis=1))


def _position_score(error_mm: Array, samples: Samples) -> float:
    """Return the mean error of the plain samples, of firm ones above all."""
    plain = samples.plain
    return float(np.average(error_mm[plain], weights=1.0 / samples.faintness[plain]))


def _force_score(prediction: Array, samples: Samples) -> float:
    """Return the mean error of the plain samples' force, N: a few large ones of few presses decide less than
    in the root mean square."""
    return mean_miss_N(_forces_N(prediction, samples), samples)
