"""Verdict on a calibration in words, and its figures."""

from __future__ import annotations

from collections.abc import Sequence

from palpate_edge.daemon.check_rows import Verdict
from palpate_edge.estimation.calibration import Calibration, CalibrationSource, JigErrors, RegionErrors
from palpate_edge.guide.guide_view import Judgement
from palpate_edge.guide.picture_steps import Figures

POOR_SPREAD_PERCENT = 5.0
NAMED_FRAMES = 6  # of reference frames at fault
GOOD_MM, LEAST_HELD = 0.6, 0.8  # mean error of 20 presses (docs/accuracy.md); share in the 95 % radius
POOR_JIG_MM = 1.2  # holes of a jig as printed are 0.3 to 0.8 mm off (python -m bench.jig)
POOR_RESIDUAL_DIAMETERS = 0.15
"""Residual of the layout over a bead's diameter: beads were drawn 0.2 mm off of 3 mm at most."""


def report_judgement(calibration: Calibration) -> Judgement:
    """Judge a calibration: what can be relied upon, and what would make it better."""
    source, spread_percent = calibration.source, calibration.source.weighed_spread_percent
    if source.touched_references or source.moved_references:
        text = _reference_fault(source)
    elif not calibration.model:
        text = "only the paper's method: pip install 'palpate[train]' gives the correction model"
    elif _residual_diameters(calibration) > POOR_RESIDUAL_DIAMETERS:
        text = "the beads do not fit sensor.toml well: compare its layout and camera with the sensor"
    elif spread_percent is not None and spread_percent > POOR_SPREAD_PERCENT:
        text = (
            f"the weights disagree by {spread_percent:.0f} %: look for a wrong number of grams in weights.csv"
        )
    elif source.regions:
        return _judge_regions(source.regions)
    elif source.jig is not None:
        return _judge_jig(source.jig)
    elif calibration.stiffness_scale is None:
        text = "positions, and no force: add presses on a kitchen scale"
    else:
        text = (
            "positions to about a millimetre and forces to 2 to 4 % of the largest, as on simulated sensors; "
            "presses at known places would show it on this one"
        )
        return Judgement(Verdict.OK, text)
    return Judgement(Verdict.WARN, text)


def _reference_fault(source: CalibrationSource) -> str:
    """Return which reference frames differ from the others, and what to do."""
    names, what = source.touched_references, "the dome was touched or released there"
    if not names:
        names, what = source.moved_references, "the camera or the sensor moved there"
    listed = ", ".join(names[:NAMED_FRAMES]) + (", ..." if len(names) > NAMED_FRAMES else "")
    return (
        f"{len(names)} of {source.reference_frames} reference frames differ from the others ({listed}): "
        f"{what}; take them again with the dome untouched, or delete these"
    )


def _judge_jig(jig: JigErrors) -> Judgement:
    if jig.left_out_mm > POOR_JIG_MM:
        text = (
            f"presses through the jig are {jig.left_out_mm:.2f} mm off: look for a hole taken for another, "
            "or a jig that is turned or not down on the housing"
        )
        return Judgement(Verdict.WARN, text)
    if not jig.used:
        text = f"the jig confirms the dome model: {jig.left_out_mm:.2f} mm off at its holes, nothing adjusted"
    else:
        text = (
            f"holes left out in turn are {jig.left_out_mm:.2f} mm off, {jig.without_mm:.2f} without the jig; "
            "the print's own error is in both"
        )
    return Judgement(Verdict.OK, text)


def weakest_region(regions: Sequence[RegionErrors]) -> RegionErrors:
    """Return the region where more presses would help most: one with none, else that of the largest error."""
    empty = [region for region in regions if not region.presses]
    return empty[-1] if empty else max(regions, key=lambda region: region.mean_mm)


def _judge_regions(regions: Sequence[RegionErrors]) -> Judgement:
    presses = sum(region.presses for region in regions)
    mean_mm = sum(region.presses * region.mean_mm for region in regions) / presses
    held = sum(region.held for region in regions) / presses
    weakest = weakest_region(regions)
    error = f"{weakest.mean_mm:.2f} mm" if weakest.presses else "no press"
    text = (
        f"presses left out in turn are {mean_mm:.2f} mm off, {100 * held:.0f} % within their 95 % radius; "
        f"more presses help most {_degrees(weakest)} above the base ({error})"
    )
    is_good = mean_mm <= GOOD_MM and held >= LEAST_HELD and all(region.presses for region in regions)
    return Judgement(Verdict.OK if is_good else Verdict.WARN, text)


def _degrees(region: RegionErrors) -> str:
    return f"{region.low_deg} to {region.high_deg} deg"


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
        *([] if source.jig is None else [("jig", _jig_errors(source.jig))]),
        *region_figures(source.regions),
    ]


def _jig_errors(jig: JigErrors) -> str:
    effect = "adjusts the dome model" if jig.used else "changes nothing"
    return f"{jig.holes} holes, {jig.left_out_mm:.2f} mm off ({jig.without_mm:.2f} without); {effect}"


def region_figures(regions: Sequence[RegionErrors]) -> Figures:
    """Return the errors of presses left out in turn, and how many are within their 95 % radius."""
    return [(f"{_degrees(region)} above the base", _errors(region)) for region in regions]


def _errors(region: RegionErrors) -> str:
    if not region.presses:
        return "no press"
    held = f"{region.held} of {region.presses} in radius"
    return f"{region.mean_mm:.2f} mm, at most {region.largest_mm:.2f}; {held}"


def _residual_diameters(calibration: Calibration) -> float:
    diameters_px = sorted(bead.diameter_px for bead in calibration.beads)
    return calibration.residual_px / diameters_px[len(diameters_px) // 2]
