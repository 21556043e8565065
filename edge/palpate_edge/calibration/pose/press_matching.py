"""Displacement of every marker in every press, from spots in no order and presses in no order.

Presses are joined from the untouched sensor on, each to the one joined before whose marker density is
nearest: between them markers move by a fraction of their spacing. A regression from density to displacement,
in which each press is predicted from the others, then corrects what was joined wrongly; it is also the guide
by which single frames are read.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate_edge.calibration.pose.principal_modes import PrincipalModes, principal_modes
from palpate_edge.calibration.pose.regression.kernel_regression import choose_settings, evenly, fit
from palpate_edge.common.arrays import Array, Mask
from palpate_edge.common.errors import CalibrationError
from palpate_edge.estimation.pose.kernel_expansion import ExpansionRunner, packed
from palpate_edge.estimation.pose.marker_density import MarkerDensity
from palpate_edge.estimation.pose.pairing import PairedMarkers, Pairing
from palpate_edge.estimation.pose.pose_calibration import Guide
from palpate_edge.vision.blob_detection import Blobs

DENSITY_MODES, DISPLACEMENT_MODES = 60, 80
MIN_FOUND, MAX_ROUGHNESS = 0.93, 0.08  # share of the markers, spacings: of a press that others are joined to
MAX_DOUBT = 0.02
MIN_FOUND_TO_LEARN = 0.6
ROUNDS = 2  # of regression and pairing
MOST_GUIDES = 1200
FEWEST_PRESSES = 20
POWERS, LENGTHS = (0.0,), (1.0, 2.0, 4.0)


@dataclass(frozen=True, slots=True)
class MatchedPresses:
    """displacement_px (s, 2 n) of the markers, good (s,): presses that may be learned from; modes of the
    displacements; guide: from density to displacement."""

    displacement_px: Array
    good: Mask
    modes: PrincipalModes
    guide: Guide


def match_presses(rest_px: Array, spots: list[Blobs]) -> MatchedPresses:
    """Pair the spots of each press with the markers at rest (n, 2).

    Raises CalibrationError when fewer than `FEWEST_PRESSES` can be read.
    """
    density, pairing = MarkerDensity(rest_px), Pairing(rest_px)
    places = [rest_px, *(some.position_px for some in spots)]
    codes = np.array([density.of(place) for place in places], dtype=np.float64)
    density_modes = principal_modes(codes[1:], DENSITY_MODES)
    points = density_modes.coordinates(codes)
    matches = _join(points, rest_px, pairing, spots)
    for _ in range(ROUNDS):
        modes, guide, expected = _regress(points[1:], density_modes, rest_px, matches)
        matches = [
            pairing.match(rest_px + moved.reshape(-1, 2), some)
            for moved, some in zip(expected, spots, strict=True)
        ]
    displacement = np.array([(match.position_px - rest_px).ravel() for match in matches])
    good = np.array([is_clean(match, MIN_FOUND_TO_LEARN) for match in matches])
    return MatchedPresses(displacement, good, modes, guide)


def _join(points: Array, rest_px: Array, pairing: Pairing, spots: list[Blobs]) -> list[PairedMarkers]:
    """Pair press by press; points (s + 1, m): of the untouched sensor, then of the presses."""
    presses = points[1:]
    nearest = np.square(presses - points[0]).sum(axis=1)
    parent = np.full(len(presses), -1)
    matches: dict[int, PairedMarkers] = {}
    waiting = np.ones(len(presses), dtype=np.bool_)
    for _ in range(len(presses)):
        press = int(np.where(waiting, nearest, np.inf).argmin())
        start_px = rest_px if parent[press] < 0 else matches[int(parent[press])].position_px
        matches[press] = match = pairing.match(start_px, spots[press])
        waiting[press] = False
        if is_clean(match):
            squared = np.square(presses - presses[press]).sum(axis=1)
            closer = squared < nearest
            nearest[closer], parent[closer] = squared[closer], press
    return [matches[press] for press in range(len(presses))]


def is_clean(match: PairedMarkers, min_found: float = MIN_FOUND) -> bool:
    """Return whether enough markers were found, all where their neighbours have them."""
    enough = match.found.mean() >= min_found
    return bool(enough and match.roughness <= MAX_ROUGHNESS and match.doubt <= MAX_DOUBT)


def _regress(
    points: Array, density_modes: PrincipalModes, rest_px: Array, matches: list[PairedMarkers]
) -> tuple[PrincipalModes, Guide, Array]:
    """Fit displacement to density; also return the displacement (s, 2 n) of each press by the others."""
    clean = np.flatnonzero([is_clean(match) for match in matches])
    if len(clean) < FEWEST_PRESSES:
        raise CalibrationError(
            f"the markers of {len(clean)} of {len(matches)} presses can be followed from the reference "
            f"frames, at least {FEWEST_PRESSES} are needed: check the reference frames and "
            "markers.diameter_px, or record more presses with small steps between them"
        )
    displacement = np.array([(matches[press].position_px - rest_px).ravel() for press in clean])
    modes = principal_modes(displacement, DISPLACEMENT_MODES)
    some = evenly(len(clean), MOST_GUIDES)
    centres, targets = points[clean[some]], modes.coordinates(displacement[some])
    (settings,) = choose_settings(centres, density_modes.variance, [targets[:, :12]], POWERS, LENGTHS)
    fitted = fit(centres, settings.metric(density_modes.variance), targets, settings.ridge)
    runner = ExpansionRunner(fitted.expansion, centres)
    expected = np.array([runner.at(point.astype(np.float32)) for point in points], dtype=np.float64)
    expected[clean[some]] = fitted.left_out
    guide = Guide(density_modes.as_modes(), packed(centres), fitted.expansion)
    return modes, guide, modes.values(expected)
