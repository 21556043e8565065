"""The paper's method: contact position (Eq. 2) and force (Eq. 3) from virtual points.

Choices where the paper leaves a question open:

- Eq. (2): vp_ka is the mean area change about point k, vp_1 the point of the largest one. A neighbour that
  changed as much as the centre would get infinite weight; differences are at least `MIN_AREA_STEP`.
- Eq. (3): P_dist is the change of the two distances from the untouched sensor, so the force is 0 without
  contact. k_est depends on the polar angle ("depending on the position"): a polynomial fitted to presses.
- The raw position lies systematically nearer the base than the contact. The position correction function is
  a polynomial of the polar angle, fitted to presses; it leaves the azimuth unchanged.
- The method gives no shear: the whole force acts along the inward normal.
"""

from __future__ import annotations

import msgspec
import numpy as np

from palpate_edge.common.arrays import Array, Indices
from palpate_edge.common.contact import Vector3
from palpate_edge.estimation.frame_record import FrameRecord, LocatedContact
from palpate_edge.estimation.virtual_points import VirtualPointMesh, VirtualPoints
from palpate_edge.geometry.angles import azimuth, polar_angle
from palpate_edge.geometry.sensor import Sensor, View

MIN_AREA_STEP = 1e-3  # relative area change
MAX_THETA_RAD = np.radians(88.0)


class PaperModel(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One sensor's parameters of the paper's method.

    theta: coefficients t_k of theta = theta_raw (1 + sum_k t_k theta_raw^k), k from 1, angles in rad.
    stiffness_N_px: coefficients of k_est(theta) = sum_k s_k theta^k, N per pixel of P_dist; empty when no
    press of known force was there to fit it: then no force is estimated.
    """

    theta: tuple[float, ...] = ()
    stiffness_N_px: tuple[float, ...] = ()


class RawContact(msgspec.Struct, frozen=True):
    """Eqs. (2)-(3) before any fitted correction.

    centre: virtual point of the largest area change (vp_1); around (k,): its trusted neighbours
    (vp_2..vp_7), and weight (k,): theirs in Eq. (2), of sum 1; point_px (2,): P_c; spread_px: P_dist.
    theta_rad, phi_rad: polar angle and azimuth of the point where the ray through P_c meets the beads'
    sphere.
    """

    centre: int
    around: Indices
    weight: Array
    point_px: Array
    spread_px: float
    theta_rad: float
    phi_rad: float


class PaperMethod:
    """Locates contacts by Eqs. (1) to (3)."""

    def __init__(self, model: PaperModel, mesh: VirtualPointMesh, sensor: Sensor, view: View) -> None:
        """mesh: of the beads' reference."""
        self._model = model
        self._mesh = mesh
        self._view = view
        self._markers_radius_mm = sensor.markers.radius_mm
        self._dome_radius_mm = sensor.dome.outer_radius_mm

    def locate(self, record: FrameRecord) -> LocatedContact:
        """Return the contact; all of the force acts along the inward normal."""
        points = self._mesh.points(record.beads.position_px, record.beads.found)
        raw = raw_contact(self._mesh, points, self._view, self._markers_radius_mm)
        theta_rad = corrected_theta(self._model, raw.theta_rad)
        position = on_dome(theta_rad, raw.phi_rad, self._dome_radius_mm)
        normal_N = normal_force(self._model, theta_rad, raw.spread_px)
        inward = -position / self._dome_radius_mm
        force_N = None if normal_N is None else _vector(normal_N * inward)
        return LocatedContact(_vector(position), normal_N, force_N, None)


def raw_contact(
    mesh: VirtualPointMesh, points: VirtualPoints, view: View, markers_radius_mm: float
) -> RawContact:
    """Evaluate Eqs. (2) and (3) on one frame's virtual points."""
    change = mesh.area_change(points)
    change[~points.trusted] = -np.inf
    centre = int(np.argmax(change))
    around = mesh.neighbours(centre)
    around = around[points.trusted[around]]
    weight = 1.0 / np.maximum(change[centre] - change[around], MIN_AREA_STEP)
    weight /= weight.sum()
    point_px = np.asarray(weight @ mesh.reference_px[around])  # Eq. (2)
    if not len(around):
        point_px = mesh.reference_px[centre]
    before, behind = mesh.ring_neighbours(centre)
    spread_px = _spread(points.position_px, centre, before, behind) - _spread(
        mesh.reference_px, centre, before, behind
    )
    point_mm = view.onto_sphere(point_px[None], markers_radius_mm)
    theta_rad, phi_rad = float(polar_angle(point_mm)[0]), float(azimuth(point_mm)[0])
    return RawContact(centre, around, weight, point_px, spread_px, theta_rad, phi_rad)


def corrected_theta(model: PaperModel, theta_rad: float) -> float:
    """Apply the position correction function: raw polar angle -> polar angle of the contact, rad."""
    factor = 1.0 + sum(c * theta_rad**k for k, c in enumerate(model.theta, start=1))
    return float(np.clip(theta_rad * factor, 0.0, MAX_THETA_RAD))


def normal_force(model: PaperModel, theta_rad: float, spread_px: float) -> float | None:
    """Return F_est = k_est(theta) P_dist (Eq. 3), N, never negative; None without a fitted stiffness."""
    if not model.stiffness_N_px:
        return None
    stiffness = sum(c * theta_rad**k for k, c in enumerate(model.stiffness_N_px))
    return float(max(0.0, stiffness * spread_px))


def on_dome(theta_rad: float, phi_rad: float, radius_mm: float) -> Array:
    """Return the point (3,) in F on a sphere of `radius_mm`."""
    sin = np.sin(theta_rad)
    return radius_mm * np.array([sin * np.cos(phi_rad), sin * np.sin(phi_rad), np.cos(theta_rad)])


def fit_paper_model(
    theta_raw: Array, theta_true: Array, spread_px: Array, force_N: Array | None
) -> PaperModel:
    """Fit both polynomials to n presses by least squares; angles in rad, force_N the normal force.

    Without force_N no stiffness is fitted.
    With fewer than `2 * degree` presses the degree is lowered; without presses the model is empty.
    """
    count = len(theta_raw)
    degree = min(4, count // 2)
    theta: tuple[float, ...] = ()
    if degree:
        powers = np.stack([theta_raw ** (k + 1) for k in range(1, degree + 1)], axis=1)
        theta = _solve(powers, theta_true - theta_raw)
    stiffness: tuple[float, ...] = ()
    if count >= 2 and force_N is not None:
        powers = np.stack([theta_true**k for k in range(min(3, count // 2 + 1))], axis=1)
        stiffness = _solve(powers * spread_px[:, None], force_N)
    return PaperModel(theta, stiffness)


def _solve(matrix: Array, target: Array) -> tuple[float, ...]:
    """Solve by ridge regression, regularised for a few presses."""
    scale = np.maximum(np.sqrt((matrix**2).mean(axis=0)), 1e-12)
    scaled = matrix / scale
    ridge = 1e-4 * len(matrix) * np.eye(matrix.shape[1])
    return tuple(float(c) for c in np.linalg.solve(scaled.T @ scaled + ridge, scaled.T @ target) / scale)


def _spread(points_px: Array, centre: int, before: int, behind: int) -> float:
    """Return ||P_nc+1 - P_nc|| + ||P_nc-1 - P_nc||, pixels (Eq. 3)."""
    return float(
        np.linalg.norm(points_px[behind] - points_px[centre])
        + np.linalg.norm(points_px[before] - points_px[centre])
    )


def _vector(values: Array) -> Vector3:
    """Return an array (3,) as a tuple of floats."""
    return float(values[0]), float(values[1]), float(values[2])
