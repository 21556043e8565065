"""The experiment's report: angles by scipy, the table's cells, the page and its picture."""

from __future__ import annotations

import base64
import html
import re
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from palpate_host.config.control_config import ControlMode
from palpate_host.experiment.protocol import ExperimentConfig, PoseConfig, TrialCase, TurnConfig
from palpate_host.experiment.report import write_report
from palpate_host.experiment.result import TrialResult

FAILURE = "a finger has no contact"
TARGET_DEG = (0.0, 0.0, 20.0)
TURN, POSE = TurnConfig("yaw<20>", TARGET_DEG), PoseConfig("sideways")
EXPERIMENT = ExperimentConfig(hand="table4", on="twin", poses=(POSE,), turns=(TURN,), seconds=3.0)


def yaw(angle_deg: float) -> np.ndarray:
    return Rotation.from_euler("z", angle_deg, degrees=True).as_matrix()


def trial(
    law: ControlMode,
    yaws_deg: tuple[float, ...],
    true_deg: tuple[float, ...] = (),
    slip_mm: np.ndarray | None = None,
    failure: str = "",
) -> TrialResult:
    """A trial whose object turns about z to these angles, a second apart."""
    time_s = np.arange(len(yaws_deg), dtype=np.float64)
    turns = ([yaw(one) for one in yaws_deg], [yaw(one) for one in true_deg])
    case = TrialCase(POSE, TURN, law)
    return TrialResult(case, Path("trial"), time_s, *turns, slip_mm, len(yaws_deg), failure)


def proposed() -> TrialResult:
    slip_mm = np.array([0.1, 0.75, 0.3])
    return trial(ControlMode.PROPOSED, (0.0, 12.0, 17.5, 19.1, 18.0), (0.0, 19.0), slip_mm)


def blind() -> TrialResult:
    return trial(ControlMode.BLIND, (0.0, 14.0), failure=FAILURE)


def test_errors_are_angles_to_the_target_at_the_end() -> None:
    assert proposed().error_deg == pytest.approx(2.0)
    assert proposed().true_error_deg == pytest.approx(1.0)
    assert blind().error_deg == pytest.approx(6.0)
    assert blind().true_error_deg is None
    np.testing.assert_allclose(proposed().rpy_deg[:, 2], (0.0, 12.0, 17.5, 19.1, 18.0), atol=1e-9)
    np.testing.assert_allclose(proposed().rpy_deg[:, :2], 0.0, atol=1e-9)


def test_the_angle_is_that_of_the_whole_rotation() -> None:
    """By scipy: turned about another axis than the target's."""
    turned = Rotation.from_euler("xyz", (3.0, -4.0, 18.0), degrees=True)
    rest = Rotation.from_euler("z", 20.0, degrees=True) * turned.inv()
    case = TrialCase(POSE, TURN, ControlMode.BLIND)
    result = TrialResult(case, Path("trial"), np.zeros(1), [turned.as_matrix()], (), None, 1, "")
    assert result.error_deg == pytest.approx(np.degrees(rest.magnitude()))


@pytest.mark.parametrize(
    ("yaws_deg", "settled_s"),
    [((0.0, 12.0, 17.5, 19.1, 18.0), 2.0), ((20.0, 21.9, 20.0), 0.0), ((20.0, 22.1, 20.0), 2.0)],
)
def test_a_turn_has_settled_when_it_stays_within_2_deg(yaws_deg: tuple[float, ...], settled_s: float) -> None:
    assert trial(ControlMode.PROPOSED, yaws_deg).settling_s == settled_s


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a report of three trials."""
    folder = tmp_path_factory.mktemp("report")
    worse = trial(ControlMode.PROPOSED, (0.0, 16.0))
    assert write_report(folder, EXPERIMENT, [proposed(), worse, blind()]) == folder / "report.html"
    return folder


def test_the_tables_of_both_files_have_the_same_cells(report: Path) -> None:
    lines = (report / "report.md").read_text().replace("-0.0", "0.0").splitlines()
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[-3:]]
    assert rows == [
        ["yaw<20>", "sideways", "proposed", "2.00", "1.00", "0.0, 0.0, 18.0", "2.0", "0.75", "completed"],
        ["yaw<20>", "sideways", "proposed", "4.00", "", "0.0, 0.0, 16.0", "1.0", "", "completed"],
        ["yaw<20>", "sideways", "blind (Tahara)", "6.00", "", "0.0, 0.0, 14.0", "1.0", "", FAILURE],
    ]
    page = (report / "report.html").read_text().replace("-0.0", "0.0")
    assert re.findall(r"<td>(.*?)</td>", page) == [html.escape(cell) for row in rows for cell in row]
    assert page.count("<th>") == lines[-4].count("|") - 1 == len(rows[0])


def test_the_summary_has_the_mean_and_the_largest_error_of_each_law(report: Path) -> None:
    text = (report / "report.md").read_text()
    assert "3 trials on the simulated hand, 3 s each." in text
    assert "proposed: 3.00 deg on average, 4.00 at most. blind (Tahara): 6.00 deg on average" in text


def test_the_picture_has_a_panel_for_each_turn_and_pose_and_is_in_the_page(report: Path) -> None:
    picture = (report / "turns.svg").read_bytes()
    assert base64.b64encode(picture).decode() in (report / "report.html").read_text()
    text = picture.decode()
    assert text.count("object sideways") == 1 and "(a) yaw" in text
    for law in ("proposed", "blind (Tahara)"):
        assert all(f"{angle}, {law}" in text for angle in ("roll", "pitch", "yaw"))
