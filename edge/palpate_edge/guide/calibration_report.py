"""Verdict on a calibration in words, and its figures."""

from __future__ import annotations

from palpate_edge.daemon.check_rows import Verdict
from palpate_edge.estimation.calibration import Calibration
from palpate_edge.guide.guide_view import Judgement
from palpate_edge.guide.picture_steps import Figures

POOR_SPREAD_PERCENT = 5.0
POOR_RESIDUAL_DIAMETERS = 0.15
"""Residual of the layout over a bead's diameter: beads were drawn 0.2 mm off of 3 mm at most."""


def report_judgement(calibration: Calibration) -> Judgement:
    """Judge a calibration: what can be relied upon, and what would make it better."""
    source = calibration.source
    if not calibration.model:
        text = "only the paper's method: pip install 'palpate[train]' gives the correction model"
        return Judgement(Verdict.WARN, text)
    if _residual_diameters(calibration) > POOR_RESIDUAL_DIAMETERS:
        text = "the beads do not fit sensor.toml well: compare its layout and camera with the sensor"
        return Judgement(Verdict.WARN, text)
    spread_percent = source.weighed_spread_percent
    if spread_percent is None and calibration.stiffness_scale is None:
        return Judgement(Verdict.WARN, "positions, and no force: add presses on a kitchen scale")
    if spread_percent is not None and spread_percent > POOR_SPREAD_PERCENT:
        text = (
            f"the weights disagree by {spread_percent:.0f} %: look for a wrong number of grams in weights.csv"
        )
        return Judgement(Verdict.WARN, text)
    if not source.presses:
        text = (
            "positions to about a millimetre and forces to 3 to 7 % of the largest, as on simulated sensors; "
            "presses at known places would show it on this one"
        )
        return Judgement(Verdict.OK, text)
    return Judgement(Verdict.OK, "positions and forces, from presses at known places")


def report_figures(calibration: Calibration) -> Figures:
    """Return the figures of a calibration."""
    source = calibration.source
    spread_percent, scale = source.weighed_spread_percent, calibration.stiffness_scale
    dropped = sum(one.count for one in source.dropped)
    return [
        ("beads", str(len(calibration.beads))),
        ("layout residual", f"{calibration.residual_px:.2f} px"),
        ("contact above", f"{calibration.contact_threshold_px:.3f} px of skin motion"),
        ("presses", f"{source.presses} placed, {source.weighed} weighed, {dropped} left out"),
        ("stiffness", "unknown" if scale is None else f"{scale:.3f} of the dome model's"),
        ("weights disagree by", "–" if spread_percent is None else f"{spread_percent:.1f} %"),
    ]


def _residual_diameters(calibration: Calibration) -> float:
    diameters_px = sorted(bead.diameter_px for bead in calibration.beads)
    return calibration.residual_px / diameters_px[len(diameters_px) // 2]
