"""The verdict on a calibration, for calibrations that differ in one property."""

from __future__ import annotations

from xml.etree import ElementTree

import msgspec
import pytest
from msgspec.structs import replace

from palpate_edge.daemon.check_rows import Verdict
from palpate_edge.estimation.calibration import JigErrors, RegionErrors
from palpate_edge.guide.calibration_report import (
    region_figures,
    report_figures,
    report_judgement,
    weakest_region,
)
from palpate_edge.guide.report_picture import EMPTY, report_svg

GOOD = tuple(RegionErrors(low, low + 15, 8, 0.2, 0.5, 8) for low in (15, 30, 45, 60, 75))

JIG = JigErrors(17, 34, 1.1, 0.4, used=True)


@pytest.fixture
def made(drawn_calibration):
    """A calibration with a model, and with the fields of its source that are given."""

    def make(stiffness_scale=0.1, residual_px=0.2, model=b"model", **source):
        changed = msgspec.structs.replace(drawn_calibration.source, **source)
        return msgspec.structs.replace(
            drawn_calibration,
            model=model,
            stiffness_scale=stiffness_scale,
            residual_px=residual_px,
            source=changed,
        )

    return make


def changed(number, **values):
    return (*GOOD[:number], msgspec.structs.replace(GOOD[number], **values), *GOOD[number + 1 :])


@pytest.mark.parametrize(
    ("values", "verdict", "text"),
    [
        ({"model": b""}, Verdict.WARN, "only the paper's method"),
        ({"residual_px": 9.0}, Verdict.WARN, "the beads do not fit sensor.toml"),
        ({"stiffness_scale": None, "presses": 0}, Verdict.WARN, "positions, and no force"),
        ({"presses": 0, "weighed_spread_percent": 8.0}, Verdict.WARN, "the weights disagree by 8 %"),
        ({"presses": 0, "weighed_spread_percent": 1.0}, Verdict.OK, "positions to about a millimetre"),
        ({"presses": 0, "jig": JIG}, Verdict.OK, "left out in turn are 0.40 mm off, 1.10 without the jig"),
        ({"jig": replace(JIG, used=False)}, Verdict.OK, "confirms the dome model: 0.40 mm off at its holes"),
        ({"jig": replace(JIG, left_out_mm=3.0)}, Verdict.WARN, "look for a hole taken for another"),
        ({"regions": GOOD, "jig": JIG}, Verdict.OK, "0.20 mm off, 100 % within their 95 % radius; more"),
        ({"regions": GOOD}, Verdict.OK, "0.20 mm off, 100 % within their 95 % radius; more"),
        ({"regions": changed(3, mean_mm=4.0)}, Verdict.WARN, "most 60 to 75 deg above the base (4.00 mm)"),
        ({"regions": changed(1, presses=0)}, Verdict.WARN, "most 30 to 45 deg above the base (no press)"),
        ({"regions": tuple(msgspec.structs.replace(region, held=4) for region in GOOD)},
         Verdict.WARN, "50 % within their 95 % radius"),
    ],
)  # fmt: skip
def test_the_verdict(made, values, verdict, text):
    found = report_judgement(made(**values))
    assert found.verdict is verdict
    assert text in found.text


def test_the_figures_of_regions(made):
    regions = changed(1, presses=0)
    assert weakest_region(regions) is regions[1]
    figures = dict(report_figures(made(regions=regions, weighed=3)))
    assert figures["15 to 30 deg above the base"] == "0.20 mm, at most 0.50; 8 of 8 in radius"
    assert figures["30 to 45 deg above the base"] == "no press"
    assert "3 weighed" in figures["presses"]
    assert region_figures(()) == []


def test_the_picture_has_each_region_twice_and_every_figure(made):
    regions = changed(1, presses=0)
    calibration = made(regions=regions)
    tree = ElementTree.fromstring(report_svg(calibration))
    bands = tree.findall(".//{*}path[@fill]")
    assert len(bands) == 2 * len(regions)
    assert sum(band.get("fill") == EMPTY for band in bands) == 2
    shown = [element.text for element in tree.iter("{http://www.w3.org/2000/svg}text")]
    assert "0.20 mm, at most 0.50; 8 of 8 in radius" in shown
    assert " ".join(shown).startswith("warn: presses left out in turn are")
    assert "layout residual" in shown
    assert not ElementTree.fromstring(report_svg(made())).findall(".//{*}path")
